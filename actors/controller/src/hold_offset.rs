//! Hold offsets: the offset of the commanded position from the target, so that the joint rests at the target.
//!
//! A servo without an integral term rests beside its commanded position by its load divided by its stiffness: a hobby
//! arm sags by one or two degrees, by a different amount in each configuration. The offset is the integral term that
//! the board lacks, in a slow outer loop: once per command it grows by the difference measured at rest, up to
//! [`Axis::hold_error`]. All position commands pass here on their way to the board, also those of the retreat. All
//! other code uses measured positions.
//!
//! Where the servos report their load, the arm's weight is known in any configuration ([`crate::load_model`]), and with
//! it the sag: its product with the compliance that the joint has shown at rest. The offset then follows the
//! configuration at once, also along a path of set-points, and the loop corrects what is left.

use crate::load_model::{LoadModel, Unexplained};
use crate::{Rules, within};
use mobee_contract::{Axis, Command, Move, Sample, Time};
use mobee_model::Robot;
use std::sync::Arc;
use std::time::Duration;

/// Time at rest after which the offset of a joint is measured.
pub const SETTLE_TIME: Duration = Duration::from_millis(250);
/// Greatest spread of the readings of a joint at rest, rad, unless one and a half counts of its encoder are more.
const REST_BAND: f64 = 0.02 * std::f64::consts::PI / 180.0;
/// Share of the error left at one target that is assumed at the next: friction may act the other way there.
const NEXT_SHARE: f64 = 0.5;
/// Load below which a joint at rest shows nothing of its compliance, as a share of the threshold of a contact: dry
/// friction holds as much.
const LEAST_LOAD: f64 = 0.1;
/// Way of a joint beside which its sag is small, rad.
const LONG_WAY: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Time after which an arm that has not moved counts as at rest when it is stopped.
const SHORT_REST: Duration = Duration::from_millis(100);
/// Speed at which a stopped joint takes up its load, as a share of its greatest.
const HOLD_SPEED_SHARE: f64 = 0.5;
/// Distance of two targets that count as one, rad.
const SAME_TARGET: f64 = 1e-4;
/// Share of the loads and errors of earlier rests in the compliance, at each rest.
const COMPLIANCE_MEMORY: f64 = 0.98;

/// Hold offsets of a robot's motors.
#[derive(Clone, Debug)]
pub struct HoldOffsets {
    axes: Arc<[Axis]>,
    joints: Vec<MotorOffset>,
    /// Weight of the arm, if its servos report their load.
    load: Option<LoadModel>,
    /// Newest reading.
    newest: Sample,
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
    /// Part of the measured offset that the weight does not explain, rad, and the target at which it was measured.
    left: (f64, f64),
    /// Sums over the rests: load times offset, and load squared. Their ratio is the compliance.
    compliance: (f64, f64),
}

impl MotorOffset {
    /// Sag under this weight, N m; zero before the compliance is known.
    fn sag(&self, weight: f64) -> f64 {
        let (product, square) = self.compliance;
        if square > 0.0 { -weight * product / square } else { 0.0 }
    }

    /// Adds a rest with this offset, rad, and external torque, N m.
    fn yields(&mut self, offset: f64, torque: f64, axis: &Axis) {
        if torque.abs() > LEAST_LOAD * axis.contact_effort {
            let (product, square) = self.compliance;
            let sums = (product * COMPLIANCE_MEMORY - torque * offset, square * COMPLIANCE_MEMORY + torque * torque);
            // a joint that its load lifts is held by something else
            self.compliance = (sums.0.max(0.0), sums.1);
        }
    }
}

impl HoldOffsets {
    /// Starts with zero offsets for this robot.
    pub fn new(rules: &Rules) -> HoldOffsets {
        HoldOffsets {
            axes: rules.axes.clone(),
            joints: vec![MotorOffset::default(); rules.axes.len()],
            load: None,
            newest: Sample::default(),
        }
    }

    /// Adds the weight of this robot, if its servos report their load.
    #[must_use]
    pub fn with_weight(self, rules: &Rules, robot: &Robot) -> HoldOffsets {
        HoldOffsets { load: LoadModel::new(rules, robot), ..self }
    }

    /// Processes a reading, and returns what the arm's weight leaves unexplained of the loads; empty if its servos
    /// report none.
    pub fn unexplained(&mut self, sample: &Sample) -> Arc<[Option<Unexplained>]> {
        self.newest = sample.clone();
        self.load.as_mut().map(|load| load.read(sample)).unwrap_or_default()
    }

    /// Weight on each motor with these motors at their targets, N m; `None` where it is not known.
    fn weight(&self, motors: &[usize], targets: &[f64]) -> Vec<Option<f64>> {
        let Some(load) = self.load.as_ref().filter(|_| self.newest.q.len() == self.axes.len()) else {
            return Vec::new();
        };
        let mut q = self.newest.q.to_vec();
        for (m, target) in motors.iter().zip(targets) {
            q.get_mut(*m).into_iter().for_each(|q| *q = *target);
        }
        load.weight(&q)
    }

    /// Returns whether any motor of the robot may need an offset.
    pub fn are_used(&self) -> bool {
        self.axes.iter().any(|axis| axis.hold_error > 0.0)
    }

    /// Adds the offsets to a command for the board.
    pub fn apply(&mut self, command: &Command, now: Time) -> Command {
        match command {
            Command::Move(m) if !m.relative => {
                let before: Vec<Option<(f64, f64)>> = m.motors.iter().map(|m| self.commanded(*m)).collect();
                let q = self.shift(&m.motors, &m.q, now);
                let [speed, acceleration] = self.in_time(m, &before, &q);
                Command::Move(Move { q, speed, acceleration, ..m.clone() })
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

    /// Position that the board was last sent to, rad, and its uncertainty: of a motor that was not commanded since a stop,
    /// it is the newest reading, beside which it may hold.
    fn commanded(&self, motor: usize) -> Option<(f64, f64)> {
        let sent = self.joints.get(motor).filter(|joint| joint.target.is_some()).map(|joint| (joint.sent, 0.0));
        let beside = self.axes.get(motor).map_or(0.0, |axis| axis.hold_error);
        sent.or_else(|| self.newest.q.get(motor).map(|q| (*q, beside)))
    }

    /// Speeds and accelerations of a move to `sent`, rad, from `before`: the board is to arrive when the joints would
    /// without offsets. The sag may change by more than the joint moves.
    fn in_time(&self, course: &Move, before: &[Option<(f64, f64)>], sent: &[f64]) -> [Option<Vec<f64>>; 2] {
        let (Some(mut speed), mut acceleration) = (course.speed.clone(), course.acceleration.clone()) else {
            return [None, course.acceleration.clone()];
        };
        let ways =
            course.motors.iter().zip(&course.q).map(|(m, to)| self.newest.q.get(*m).map_or(0.0, |q| (to - q).abs()));
        let ways: Vec<f64> = ways.collect();
        let secs =
            |i: usize| ways.get(i).zip(speed.get(i)).map_or(0.0, |(way, v)| if *v > 0.0 { way / v } else { 0.0 });
        let times: Vec<f64> = (0..speed.len()).map(secs).collect();
        let Some((slowest, longest)) = times.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1)) else {
            return [Some(speed), acceleration];
        };
        let rate = acceleration.as_ref().and_then(|all| Some(all.get(slowest)? / speed.get(slowest)?.max(1e-9)));
        for (i, m) in course.motors.iter().enumerate() {
            let (Some(axis), Some(Some((from, beside))), Some(to)) = (self.axes.get(*m), before.get(i), sent.get(i))
            else {
                continue;
            };
            let own = ways.get(i).is_some_and(|way| *way > LONG_WAY);
            let secs = if own { times.get(i).copied().unwrap_or_default() } else { longest };
            let Some(speed) = speed.get_mut(i).filter(|_| axis.hold_error > 0.0 && secs > 0.0) else { continue };
            let needed = (((to - from).abs() + beside) / secs).min(axis.max_speed);
            let share = if own && *speed > 0.0 { Some(needed / *speed) } else { None };
            *speed = needed;
            if let Some(acceleration) = acceleration.as_mut().and_then(|all| all.get_mut(i)) {
                let scaled = share.map(|share| share * *acceleration).or(rate.map(|rate| rate * needed));
                *acceleration = scaled.unwrap_or(*acceleration).min(axis.max_acceleration);
            }
        }
        [Some(speed), acceleration]
    }

    /// Command that follows this stop, on boards whose stop holds the position that the encoder reads: the motors that
    /// it stops are to hold the newest reading with their load, so that they do not sink below it. `None` if nothing
    /// sinks, or if the load is not known.
    pub fn hold_after(&self, command: &Command) -> Option<Command> {
        let Command::Stop { motors: named } = command else { return None };
        // Encoders that show no motion may be frozen: they do not show where the arm is.
        let moves = |joint: &MotorOffset| self.newest.at < joint.stands.1 + SHORT_REST;
        if !self.joints.iter().any(moves) {
            return None;
        }
        let sinks = |(m, axis): (usize, &Axis)| {
            // a stop changes nothing for a motor at rest
            let done = self.newest.done.get(m).copied().unwrap_or_default();
            let commanded = self.joints.get(m).is_some_and(|joint| joint.target.is_some() && (!done || moves(joint)));
            let stopped = named.is_empty() || named.contains(&m);
            (axis.stop_sinks && commanded && stopped).then_some(m)
        };
        let motors: Vec<usize> = self.axes.iter().enumerate().filter_map(sinks).collect();
        if motors.is_empty() {
            return None;
        }
        let weight = self.weight(&[], &[]);
        let hold = |m: usize| {
            let (joint, axis, q) = (self.joints.get(m)?, self.axes.get(m)?, self.newest.q.get(m)?);
            let weight = weight.get(m).copied().flatten().filter(|_| joint.compliance.1 > 0.0)?;
            let sag = joint.sag(weight).clamp(-axis.hold_error, axis.hold_error);
            Some((m, within(q + sag, axis), HOLD_SPEED_SHARE * axis.max_speed))
        };
        let held: Vec<(usize, f64, f64)> = motors.into_iter().filter_map(hold).collect();
        let (motors, (q, speed)) = held.into_iter().map(|(m, q, speed)| (m, (q, speed))).unzip();
        let motion = Move { motors, q, relative: false, speed: Some(speed), acceleration: None };
        (!motion.motors.is_empty()).then_some(Command::Move(motion))
    }

    /// Adds the offsets to the positions of these motors, rad.
    fn shift(&mut self, motors: &[usize], q: &[f64], now: Time) -> Vec<f64> {
        let weight = self.weight(motors, q);
        let of = |(m, q): (&usize, &f64)| {
            let (Some(axis), Some(joint)) = (self.axes.get(*m), self.joints.get_mut(*m)) else { return *q };
            if let Some(weight) = weight.get(*m).copied().flatten().filter(|_| joint.compliance.1 > 0.0) {
                let (left, at) = joint.left;
                let share = if (q - at).abs() <= SAME_TARGET { 1.0 } else { NEXT_SHARE };
                joint.offset = (joint.sag(weight) + share * left).clamp(-axis.hold_error, axis.hold_error);
            }
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
        let measures = self.joints.iter().any(|joint| joint.target.is_some() && !joint.measured);
        let weight = if measures { self.weight(&[], &[]) } else { Vec::new() };
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
            if let Some(torque) = sample.external.get(m).filter(|torque| torque.is_finite()) {
                joint.yields(joint.sent - q, *torque, axis);
            }
            let sag = weight.get(m).copied().flatten().map_or(0.0, |weight| joint.sag(weight));
            joint.left = (offset - sag, target);
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
    use crate::load_model::tests::{arm, uniform, weight};
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

    /// An SO-101 of servos of 18 N m/rad that move at once: its joints rest where the servos carry the weight.
    struct Sagging {
        offsets: HoldOffsets,
        skeleton: mobee_model::Skeleton,
        ms: u64,
        q: Vec<f64>,
    }

    impl Sagging {
        const STIFFNESS: f64 = 18.0;

        /// Commands these targets, and lets the arm rest for `ms` milliseconds. Returns the greatest error, rad.
        fn rest_at(&mut self, targets: &[f64], ms: u64) -> f64 {
            let motors: Vec<usize> = (0..targets.len()).collect();
            let direct = Command::Direct { motors, q: targets.to_vec() };
            let Command::Direct { q: sent, .. } = self.offsets.apply(&direct, Time(self.ms * MS)) else { panic!() };
            self.q.clone_from(&sent);
            for _ in 0..20 {
                let weight = weight(&self.skeleton, &self.q);
                self.q = sent.iter().zip(weight).map(|(c, w)| c + w / Self::STIFFNESS).collect();
            }
            for _ in (0..ms).step_by(10) {
                self.ms += 10;
                self.reads(true);
            }
            self.q.iter().zip(targets).map(|(q, to)| (q - to).abs()).fold(0.0, f64::max)
        }

        fn reads(&mut self, done: bool) {
            let external = weight(&self.skeleton, &self.q);
            let (at, q, done) = (Time(self.ms * MS), self.q.clone().into(), vec![done; self.q.len()]);
            let sample = Sample { at, q, external, done, ..Sample::default() };
            self.offsets.unexplained(&sample);
            self.offsets.learn(&sample);
        }
    }

    /// The sag differs by degrees between two configurations, and is known before the arm gets there. After a stop the
    /// arm is held where it was, with the load that it has there.
    #[test]
    fn the_offset_follows_the_weight_from_configuration_to_configuration() {
        let (robot, rules) = arm(0.1);
        let skeleton = mobee_model::Skeleton::new(&robot, nalgebra::Isometry3::identity());
        let offsets = HoldOffsets::new(&rules).with_weight(&rules, &robot);
        let mut arm = Sagging { offsets, skeleton, ms: 0, q: robot.motors.iter().map(|m| m.home).collect() };
        let mut state = 5;
        let mut target = || -> Vec<f64> {
            robot.motors.iter().map(|m| 0.8 * (m.min + (m.max - m.min) * uniform(&mut state))).collect()
        };
        let errors: Vec<f64> = (0..60).map(|_| arm.rest_at(&target(), 400)).collect();
        let (first, last) = errors.split_at(40);
        let greatest = |errors: &[f64]| errors.iter().copied().fold(0.0, f64::max).to_degrees();
        assert!(greatest(first) > 0.5, "{} deg", greatest(first));
        assert!(greatest(last) < 0.5, "{} deg", greatest(last));
        // a joint whose target is where it is arrives with the others, though its sag changes
        let mut to = arm.q.clone();
        to[1] -= 1.0;
        let course =
            Move { motors: (0..6).collect(), q: to, relative: false, speed: Some(vec![0.5; 6]), acceleration: None };
        let before: Vec<f64> = (0..6).filter_map(|m| arm.offsets.commanded(m)).map(|(q, _)| q).collect();
        let Command::Move(sent) = arm.offsets.apply(&Command::Move(course), Time(arm.ms * MS)) else { panic!() };
        for ((from, to), speed) in before.iter().zip(&sent.q).zip(sent.speed.unwrap()).skip(2) {
            assert!(
                ((to - from).abs() / speed.max(1e-9) - 2.0).abs() < 1e-6 || from == to,
                "{from} to {to} at {speed}"
            );
        }
        let stop = Command::Stop { motors: Vec::new() };
        assert_eq!(arm.offsets.hold_after(&stop), None, "nothing moves");
        arm.q = target();
        arm.ms += 10_000;
        arm.reads(false);
        let Some(Command::Move(hold)) = arm.offsets.hold_after(&stop) else { panic!("it sinks") };
        let carried = weight(&arm.skeleton, &arm.q);
        for (m, q) in hold.motors.iter().zip(&hold.q) {
            let needed = (-carried[*m] / Sagging::STIFFNESS).clamp(-0.1, 0.1);
            let by = q - arm.q[*m];
            assert!((by - needed).abs() < 8e-3, "motor {m}: by {by}, {needed} needed");
        }
        assert!(hold.motors.contains(&1) && !hold.motors.contains(&0), "the vertical axis carries nothing");
        arm.offsets.apply(&stop, Time(arm.ms * MS));
        assert_eq!(arm.offsets.hold_after(&stop), None, "it is stopped");
    }
}
