//! The vocabs of control boards.

use crate::Vocab;

pub const GET: Vocab = Vocab::new("get");
pub const SET: Vocab = Vocab::new("set");
pub const IS: Vocab = Vocab::new("is");
pub const STAMP: Vocab = Vocab::new("tsta");
pub const OK: Vocab = Vocab::new("ok");
pub const FAIL: Vocab = Vocab::new("fail");
pub const NAK: Vocab = Vocab::new("nak");
pub const PROTOCOL: Vocab = Vocab::new("prot");
pub const AXES: Vocab = Vocab::new("axes");
pub const NAME: Vocab = Vocab::new("name");
pub const KIND: Vocab = Vocab::new("type");
pub const LIMITS: Vocab = Vocab::new("llim");
pub const SPEED_LIMITS: Vocab = Vocab::new("vlim");
pub const MOTORS: Vocab = Vocab::new("mtnm");
pub const MOTOR_ENCODERS: Vocab = Vocab::new("mnum");
pub const CONTROL_MODE: Vocab = Vocab::new("icmd");
pub const INTERACTION: Vocab = Vocab::new("intm");

/// Modes that a joint can be set to and report (spec section 12.2): control modes and interaction modes.
pub mod mode {
    use crate::Vocab;

    /// Idle: accepts no command.
    pub const IDLE: Vocab = Vocab::new("idl");
    /// Force idle: set only; clears a fault.
    pub const FORCE_IDLE: Vocab = Vocab::new("fidl");
    /// Position moves along a trajectory of the board.
    pub const POSITION: Vocab = Vocab::new("pos");
    /// Position direct: setpoints followed immediately.
    pub const DIRECT: Vocab = Vocab::new("posd");
    /// Velocity.
    pub const VELOCITY: Vocab = Vocab::new("vel");
    /// Mixed: position and velocity.
    pub const MIXED: Vocab = Vocab::new("mix");
    /// Torque.
    pub const TORQUE: Vocab = Vocab::new("torq");
    /// Current.
    pub const CURRENT: Vocab = Vocab::new("icur");
    /// Pulse width.
    pub const PWM: Vocab = Vocab::new("ipwm");
    /// Hardware fault; read only.
    pub const HARDWARE_FAULT: Vocab = Vocab::new("hwfa");
    /// Being calibrated; read only.
    pub const CALIBRATING: Vocab = Vocab::new("cal");
    /// Not configured; read only.
    pub const NOT_CONFIGURED: Vocab = Vocab::new("cfgn");
    /// Unknown; read only.
    pub const UNKNOWN: Vocab = Vocab::new("unkw");
    /// Interaction mode: stiff.
    pub const STIFF: Vocab = Vocab::new("stif");
    /// Interaction mode: compliant.
    pub const COMPLIANT: Vocab = Vocab::new("comp");

    /// Control modes that may be set.
    pub const SETTABLE: [Vocab; 9] = [IDLE, FORCE_IDLE, POSITION, DIRECT, VELOCITY, MIXED, TORQUE, CURRENT, PWM];
}
