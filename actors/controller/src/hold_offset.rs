//! Hold offsets: how far beside a target a motor is commanded, so that its joint rests at the target.
//!
//! A servo without an integral term rests beside its commanded position by its load over its stiffness: a hobby arm sags by one or two
//! degrees, and by another amount in each pose. The offset is the integral term that the board lacks, in a slow outer loop: it grows by the
//! difference that is measured at rest, once per command, and never beyond [`Axis::hold_error`]. All commands of position pass here on their
//! way to the board, those of the retreat as well; everything else in the program is in measured positions.

use crate::{Rules, within};
use mobee_contract::{Axis, Command, Move, Sample, Time};
use std::sync::Arc;
use std::time::Duration;

/// How long a joint must have stood for its offset to be measured.
pub const SETTLES: Duration = Duration::from_millis(250);
/// A joint stands while its readings differ by no more than this, rad, or by one count and a half of its encoder.
const STANDS: f64 = 0.02 * std::f64::consts::PI / 180.0;

/// The hold offsets of a robot's motors.
#[derive(Clone, Debug)]
pub struct HoldOffsets {
    axes: Arc<[Axis]>,
    joints: Vec<Joint>,
}

/// One motor.
#[derive(Clone, Copy, Debug, Default)]
struct Joint {
    /// Commanded minus measured position at rest, rad.
    offset: f64,
    /// Where it was last commanded, rad; `None`: it was stopped since, or is driven by velocities.
    target: Option<f64>,
    /// The same with its offset, and since when the board has had it.
    sent: f64,
    since: Time,
    /// Where it stands, rad, and since when.
    stands: (f64, Time),
    /// Whether the difference at this command has been measured.
    measured: bool,
}

impl HoldOffsets {
    /// Of this robot, none of them known yet.
    pub fn new(rules: &Rules) -> HoldOffsets {
        HoldOffsets { axes: rules.axes.clone(), joints: vec![Joint::default(); rules.axes.len()] }
    }

    /// Whether any motor of the robot may need one.
    pub fn are_used(&self) -> bool {
        self.axes.iter().any(|axis| axis.hold_error > 0.0)
    }

    /// The command as the board is to have it.
    pub fn apply(&mut self, command: &Command, now: Time) -> Command {
        match command {
            Command::Move(m) if !m.relative => {
                let q = self.shift(&m.motors, &m.q, now);
                Command::Move(Move { q, ..m.clone() })
            }
            Command::Direct { motors, q } => Command::Direct { motors: motors.clone(), q: self.shift(motors, q, now) },
            Command::Stop { motors } | Command::Velocity { motors, .. } => {
                let named = |(m, joint): (usize, &mut Joint)| {
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

    /// Positions of these motors as the board is to have them, rad.
    fn shift(&mut self, motors: &[usize], q: &[f64], now: Time) -> Vec<f64> {
        let of = |(m, q): (&usize, &f64)| {
            let (Some(axis), Some(joint)) = (self.axes.get(*m), self.joints.get_mut(*m)) else { return *q };
            let sent = within(q + joint.offset, axis);
            if joint.target.is_none() || sent != joint.sent {
                (joint.since, joint.measured) = (now, false);
            }
            (joint.target, joint.sent) = (Some(*q), sent);
            sent
        };
        motors.iter().zip(q).map(of).collect()
    }

    /// Measures the offsets of the joints that stand where a command has left them. The motors whose offset changed, each with its offset,
    /// rad.
    pub fn learn(&mut self, sample: &Sample) -> Vec<(usize, f64)> {
        let mut learned = Vec::new();
        let joints = self.joints.iter_mut().zip(self.axes.iter()).zip(sample.q.iter().zip(&sample.done));
        for (m, ((joint, axis), (q, done))) in joints.enumerate().filter(|(_, ((_, axis), _))| axis.hold_error > 0.0) {
            if (q - joint.stands.0).abs() > (1.5 * axis.resolution).max(STANDS) {
                joint.stands = (*q, sample.at);
            }
            let Some(target) = joint.target.filter(|_| *done && !joint.measured) else { continue };
            if sample.at < joint.since.max(joint.stands.1) + SETTLES {
                continue;
            }
            joint.measured = true;
            let offset = (joint.offset + target - q).clamp(-axis.hold_error, axis.hold_error);
            // half a count is nothing that the encoder shows
            if (offset - joint.offset).abs() > (0.5 * axis.resolution).max(STANDS) {
                joint.offset = offset;
                learned.push((m, offset));
            }
        }
        learned
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

    /// Sends it there, and lets it rest beside for so long, in ms; where the board was sent.
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
    fn a_joint_that_sags_is_commanded_above_its_target_once_the_sag_was_measured() {
        let mut offsets = offsets();
        assert_eq!(rest(&mut offsets, (0, 200), 0.5, 0.03), 0.5, "not measured yet");
        assert_eq!(rest(&mut offsets, (210, 300), 0.5, 0.03), 0.5, "the same command again");
        let sent = rest(&mut offsets, (600, 300), 0.5, 0.03);
        assert!((sent - 0.53).abs() < 1e-9, "{sent}");
        let sent = rest(&mut offsets, (1000, 300), 0.2, 0.04);
        assert!((sent - 0.23).abs() < 1e-9, "{sent}: the other pose's sag is measured next");
        let sent = rest(&mut offsets, (1400, 300), 0.2, 0.04);
        assert!((sent - 0.24).abs() < 1e-9, "{sent}");
    }

    #[test]
    fn an_offset_is_bounded_and_leads_to_no_command_beyond_the_limits() {
        let mut offsets = offsets();
        // held by something, not by its weight
        for k in 0..5 {
            let sent = rest(&mut offsets, (400 * k, 300), 0.5, 0.5);
            assert!((0.5..=0.6).contains(&sent), "{sent}");
        }
        assert_eq!(rest(&mut offsets, (4000, 0), 0.95, 0.0), 1.0);
    }

    #[test]
    fn a_stop_leaves_nothing_to_measure() {
        let mut offsets = offsets();
        rest(&mut offsets, (0, 100), 0.5, 0.03);
        offsets.apply(&Command::Stop { motors: vec![] }, Time(110 * MS));
        let sample =
            |at: u64| Sample { seq: at, at: Time(at * MS), q: vec![0.4].into(), done: vec![true], ..Sample::default() };
        assert!((110..1000).step_by(10).all(|at| offsets.learn(&sample(at)).is_empty()));
    }
}
