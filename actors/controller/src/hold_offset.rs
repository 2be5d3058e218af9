//! Hold offsets: the offset of the commanded position from the target, so that the joint rests at the target.
//!
//! A servo without an integral term rests beside its commanded position by its load divided by its stiffness: a hobby
//! arm sags by one or two degrees, by a different amount in each configuration. The offset is the integral term that
//! the board lacks, in a slow outer loop: once per command it grows by the difference measured at rest, up to
//! [`Axis::hold_error`]. All position commands pass here on their way to the board, also those of the retreat. All
//! other code uses measured positions.

use crate::{Rules, within};
use mobee_contract::{Axis, Command, Move, Sample, Time};
use std::sync::Arc;
use std::time::Duration;

/// Time at rest after which the offset of a joint is measured.
pub const SETTLE_TIME: Duration = Duration::from_millis(250);
/// Greatest spread of the readings of a joint at rest, rad, unless one and a half counts of its encoder are more.
const REST_BAND: f64 = 0.02 * std::f64::consts::PI / 180.0;

/// Hold offsets of a robot's motors.
#[derive(Clone, Debug)]
pub struct HoldOffsets {
    axes: Arc<[Axis]>,
    joints: Vec<MotorOffset>,
}

/// Hold offset of one motor.
#[derive(Clone, Copy, Debug, Default)]
struct MotorOffset {
    /// Commanded minus measured position at rest, rad.
    offset: f64,
    /// Last target, rad; `None` if the motor was stopped since, or is driven by velocities.
    target: Option<f64>,
    /// Commanded position: target plus offset, rad; and the time since which the board has had it.
    sent: f64,
    since: Time,
    /// Position at rest, rad, and the time since which the joint has rested there.
    stands: (f64, Time),
    /// True if the difference at this command has been measured.
    measured: bool,
}

impl HoldOffsets {
    /// Starts with zero offsets for this robot.
    pub fn new(rules: &Rules) -> HoldOffsets {
        HoldOffsets { axes: rules.axes.clone(), joints: vec![MotorOffset::default(); rules.axes.len()] }
    }

    /// Returns whether any motor of the robot may need an offset.
    pub fn are_used(&self) -> bool {
        self.axes.iter().any(|axis| axis.hold_error > 0.0)
    }

    /// Adds the offsets to a command for the board.
    pub fn apply(&mut self, command: &Command, now: Time) -> Command {
        match command {
            Command::Move(m) if !m.relative => {
                let q = self.shift(&m.motors, &m.q, now);
                Command::Move(Move { q, ..m.clone() })
            }
            Command::Direct { motors, q } => Command::Direct { motors: motors.clone(), q: self.shift(motors, q, now) },
            Command::Stop { motors } | Command::Velocity { motors, .. } => {
                let named = |(m, joint): (usize, &mut MotorOffset)| {
                    if motors.is_empty() || motors.contains(&m) {
                        joint.target = None;
                    }
                };
                self.joints.iter_mut().enumerate().for_each(named);
                command.clone()
            }
            Command::Move(_) | Command::Mode { .. } | Command::Reference { .. } => command.clone(),
        }
    }

    /// Adds the offsets to the positions of these motors, rad.
    fn shift(&mut self, motors: &[usize], q: &[f64], now: Time) -> Vec<f64> {
        let of = |(m, q): (&usize, &f64)| {
            let (Some(axis), Some(joint)) = (self.axes.get(*m), self.joints.get_mut(*m)) else { return *q };
            let sent = within(q + joint.offset, axis);
            if joint.target.is_none() || sent != joint.sent {
                joint.since = now;
                joint.measured = false;
            }
            joint.target = Some(*q);
            joint.sent = sent;
            sent
        };
        motors.iter().zip(q).map(of).collect()
    }

    /// Measures the offsets of the joints that rest after a command. Returns the motors whose offset changed, each
    /// with its offset, rad.
    pub fn learn(&mut self, sample: &Sample) -> Vec<(usize, f64)> {
        let mut changed = Vec::new();
        let joints = self.joints.iter_mut().zip(self.axes.iter()).zip(sample.q.iter().zip(&sample.done));
        for (m, ((joint, axis), (q, done))) in joints.enumerate().filter(|(_, ((_, axis), _))| axis.hold_error > 0.0) {
            if (q - joint.stands.0).abs() > (1.5 * axis.resolution).max(REST_BAND) {
                joint.stands = (*q, sample.at);
            }
            let Some(target) = joint.target.filter(|_| *done && !joint.measured) else { continue };
            if sample.at < joint.since.max(joint.stands.1) + SETTLE_TIME {
                continue;
            }
            joint.measured = true;
            let offset = (joint.offset + target - q).clamp(-axis.hold_error, axis.hold_error);
            // A change below half a count is not visible to the encoder.
            if (offset - joint.offset).abs() > (0.5 * axis.resolution).max(REST_BAND) {
                joint.offset = offset;
                changed.push((m, offset));
            }
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ControllerSettings;
    use mobee_contract::Board;

    const MS: u64 = 1_000_000;

    /// A motor that may rest a tenth of a radian beside its commanded position.
    fn offsets() -> HoldOffsets {
        let axis = Axis {
            name: "m".into(),
            min: -1.0,
            max: 1.0,
            max_speed: 1.0,
            max_acceleration: 4.0,
            hold_error: 0.1,
            ..Default::default()
        };
        let period = Duration::from_millis(10);
        let board = Board { axes: vec![axis], period, latency: Duration::ZERO, position_direct: true };
        HoldOffsets::new(&Rules::new("r", vec![], &ControllerSettings::default(), &board))
    }

    /// Commands this target, and lets the joint rest beside it for `ms` milliseconds. Returns the position sent to
    /// the board.
    fn rest(offsets: &mut HoldOffsets, (from, ms): (u64, u64), target: f64, sag: f64) -> f64 {
        let direct = Command::Direct { motors: vec![0], q: vec![target] };
        let Command::Direct { q, .. } = offsets.apply(&direct, Time(from * MS)) else { panic!("another command") };
        for at in (from..=from + ms).step_by(10) {
            let sample = Sample {
                seq: at,
                at: Time(at * MS),
                q: vec![q[0] - sag].into(),
                done: vec![true],
                ..Sample::default()
            };
            offsets.learn(&sample);
        }
        q[0]
    }

    #[test]
    fn a_sagging_joint_is_commanded_above_its_target_once_the_sag_is_measured() {
        let mut offsets = offsets();
        assert_eq!(rest(&mut offsets, (0, 200), 0.5, 0.03), 0.5, "not measured yet");
        assert_eq!(rest(&mut offsets, (210, 300), 0.5, 0.03), 0.5, "the same command again");
        let sent = rest(&mut offsets, (600, 300), 0.5, 0.03);
        assert!((sent - 0.53).abs() < 1e-9, "{sent}");
        let sent = rest(&mut offsets, (1000, 300), 0.2, 0.04);
        assert!((sent - 0.23).abs() < 1e-9, "{sent}: the sag at the other target is measured next");
        let sent = rest(&mut offsets, (1400, 300), 0.2, 0.04);
        assert!((sent - 0.24).abs() < 1e-9, "{sent}");
    }

    #[test]
    fn an_offset_is_bounded_and_leads_to_no_command_beyond_the_limits() {
        let mut offsets = offsets();
        // held by an obstacle, not by its weight
        for k in 0..5 {
            let sent = rest(&mut offsets, (400 * k, 300), 0.5, 0.5);
            assert!((0.5..=0.6).contains(&sent), "{sent}");
        }
        assert_eq!(rest(&mut offsets, (4000, 0), 0.95, 0.0), 1.0);
    }

    #[test]
    fn no_offset_is_measured_after_a_stop() {
        let mut offsets = offsets();
        rest(&mut offsets, (0, 100), 0.5, 0.03);
        offsets.apply(&Command::Stop { motors: vec![] }, Time(110 * MS));
        let sample =
            |at: u64| Sample { seq: at, at: Time(at * MS), q: vec![0.4].into(), done: vec![true], ..Sample::default() };
        assert!((110..1000).step_by(10).all(|at| offsets.learn(&sample(at)).is_empty()));
    }
}
