//! Contact detection by effort: the board reports an external torque that is greater than the arm's in free motion.
//!
//! A stiff arm pushes with hundreds of newtons before it lags by a degree. Its torque sensors, or its motors'
//! currents, show the contact while it pushes with tens ([`Sample::external`]). Thresholds are per motor
//! ([`Rules::contact_effort`]). A torque that was present before the motion, of a payload or of the contact that an
//! escape leads out of, counts only by its change.
//!
//! The load reported by a servo includes the arm's weight. Its threshold is high, and a slow arm pushes for seconds
//! before it is reached. Where the weight is known ([`crate::load_model`]), what it leaves unexplained is compared with
//! a low threshold. Until then: weight changes with the configuration, and a contact with time. Therefore a load that
//! rises within a second by more than the arm's motion explains is a contact, too.

use crate::Rules;
use crate::load_model::Unexplained;
use crate::pulse::Pulse;
use mobee_contract::{Pose, Sample, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// Number of consecutive readings that must show a contact: noise, and the jerk of a starting motor, show it in one.
const READINGS: u32 = 3;

/// Time windows in which a rise of the load is evaluated: for a fast arm, and for a slow one.
const WINDOWS: [Duration; 2] = [Duration::from_millis(400), Duration::from_millis(1200)];
/// Rise of the load within a window that counts as a contact, as a share of the threshold: at rest, and in addition
/// per radian of joint motion, which changes the weight and takes speed.
const RISE_SHARES: (f64, f64) = (0.3, 2.0);
/// Factor on the latter for a joint at rest: the weight that it carries changes little.
const RESTING_JOINT_FACTOR: f64 = 0.25;
/// Greatest motion of a joint at rest, rad, unless two counts of its encoder are more.
const REST_BAND: f64 = 0.3 * std::f64::consts::PI / 180.0;
/// Greatest number of stored readings.
const MAX_STORED: usize = 512;

/// Monitors the external torques of one robot.
#[derive(Clone, Debug, Default)]
pub struct EffortWatch {
    /// Number of consecutive readings beyond the threshold, per motor.
    beyond: Vec<u32>,
    /// Torques of the last reading before the motion; and those that the arm's weight left unexplained.
    before: Vec<f64>,
    unexplained_before: Vec<f64>,
    /// Readings of the longest window, oldest first: torques and positions.
    window: VecDeque<(Time, Vec<f64>, Pose)>,
}

/// Motor that something pushes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pushed {
    /// Index of the motor.
    pub motor: usize,
    /// External torque, N m (N for a prismatic joint).
    pub torque: f64,
}

impl EffortWatch {
    /// Processes a reading. Returns the motor that is pushed most, relative to its threshold. `moving`: whether a
    /// motion is in progress. NaN torques are ignored.
    pub fn read(&mut self, pulse: &Pulse, moving: bool, rules: &Rules) -> Option<Pushed> {
        let Pulse { sample, unexplained, .. } = pulse;
        self.beyond.resize(sample.external.len(), 0);
        if !moving {
            self.beyond.fill(0);
            self.before.clone_from(&sample.external);
            let torque = |of: &Option<Unexplained>| of.map_or(0.0, |of| of.torque);
            self.unexplained_before = unexplained.iter().map(torque).collect();
            self.window.clear();
            return None;
        }
        let has_weight = |motor: usize| rules.hold_error(motor) > 0.0;
        let mut rose = Vec::new();
        if (0..sample.external.len()).any(has_weight) {
            self.store(sample);
            rose = WINDOWS.iter().filter_map(|window| self.rose(sample, *window)).collect();
        }
        let rises = |motor: usize, limit: f64| {
            let count = rules.axes.get(motor).map_or(0.0, |axis| axis.resolution);
            let rise = |rise: &Rise| rise.share(motor, REST_BAND.max(2.0 * count));
            if has_weight(motor) { rose.iter().map(rise).fold(0.0, f64::max) / limit } else { 0.0 }
        };
        let before = |motor: usize| self.before.get(motor).copied().filter(|torque| torque.is_finite()).unwrap_or(0.0);
        let share = |(motor, torque): (usize, &f64)| {
            let watched = rules.contact_effort(motor);
            if let (Some(of), Some(_)) = (unexplained.get(motor).copied().flatten(), watched) {
                let before = self.unexplained_before.get(motor).copied().unwrap_or_default();
                return (motor, of.torque, of.torque.abs().min((of.torque - before).abs()) / of.limit);
            }
            let counts = torque.abs().min((torque - before(motor)).abs());
            let share = watched.map_or(0.0, |limit| (counts / limit).max(rises(motor, limit)));
            (motor, *torque, share)
        };
        let shares = sample.external.iter().enumerate().map(share);
        let mut worst: Option<(Pushed, f64)> = None;
        for ((motor, torque, share), beyond) in shares.zip(&mut self.beyond) {
            *beyond = if share > 1.0 { beyond.saturating_add(1) } else { 0 };
            if *beyond >= READINGS && worst.is_none_or(|(_, most)| share > most) {
                worst = Some((Pushed { motor, torque }, share));
            }
        }
        worst.map(|(pushed, _)| pushed)
    }

    fn store(&mut self, sample: &Sample) {
        let longest = WINDOWS.into_iter().max().unwrap_or_default();
        while self.window.len() >= MAX_STORED || self.window.get(1).is_some_and(|(at, ..)| *at + longest <= sample.at) {
            self.window.pop_front();
        }
        self.window.push_back((sample.at, sample.external.clone(), sample.q.clone()));
    }

    /// Changes within a window.
    fn rose(&self, sample: &Sample, window: Duration) -> Option<Rise> {
        let (_, then, q) = self.window.iter().find(|(at, ..)| *at + window > sample.at)?;
        let change = |(now, then): (&f64, &f64)| Some((now - then).abs()).filter(|by| by.is_finite()).unwrap_or(0.0);
        Some(Rise {
            torques: sample.external.iter().zip(then).map(change).collect(),
            moved: sample.q.iter().zip(q.iter()).map(change).collect(),
        })
    }
}

/// Changes of torques, N m, and positions, rad, within a window.
struct Rise {
    torques: Vec<f64>,
    moved: Vec<f64>,
}

impl Rise {
    /// Rise of a motor's torque, N m, divided by the share of the threshold that counts as a contact in view of the
    /// arm's motion. A joint that has moved by at most `stands`, rad, is at rest.
    fn share(&self, motor: usize, stands: f64) -> f64 {
        let arm = self.moved.iter().copied().fold(0.0, f64::max);
        let own = self.moved.get(motor).copied().unwrap_or_default();
        let per_radian = if own <= stands { RESTING_JOINT_FACTOR * RISE_SHARES.1 } else { RISE_SHARES.1 };
        self.torques.get(motor).map_or(0.0, |rose| rose / (RISE_SHARES.0 + per_radian * arm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ControllerSettings;
    use mobee_contract::{Axis, Board};
    use std::time::Duration;

    fn rules(contact_nm: Option<f64>) -> Rules {
        let axis = |contact_effort| Axis {
            max: 1.0,
            max_speed: 1.0,
            max_acceleration: 4.0,
            contact_effort,
            ..Axis::default()
        };
        let period = Duration::from_millis(10);
        let board = Board { axes: vec![axis(5.0), axis(0.0)], period, latency: Duration::ZERO, position_direct: true };
        Rules::new("r", vec![], &ControllerSettings { contact_nm, ..ControllerSettings::default() }, &board)
    }

    fn pulse(sample: Sample) -> Pulse {
        Pulse::new(sample, &Vec::new().into())
    }

    /// Indices of the readings in which the first motor counts as pushed; the second, whose board reports none, never
    /// does.
    fn pushed(rules: &Rules, torques: &[f64]) -> Vec<usize> {
        let mut watch = EffortWatch::default();
        let shows = |torque: f64| Sample { external: vec![torque, 1e6], ..Sample::default() };
        let read =
            |(k, torque): (usize, &f64)| watch.read(&pulse(shows(*torque)), true, rules).map(|pushed| (k, pushed));
        let found: Vec<(usize, Pushed)> = torques.iter().enumerate().filter_map(read).collect();
        assert!(found.iter().all(|(_, pushed)| pushed.motor == 0));
        found.into_iter().map(|(k, _)| k).collect()
    }

    #[test]
    fn three_readings_in_a_row_beyond_the_threshold_are_a_contact() {
        let torques = [0.0, -6.0, -6.0, 4.0, 6.0, f64::NAN, 6.0, -6.0, 6.0, 6.0, 1.0];
        assert_eq!(pushed(&rules(None), &torques), [8, 9]);
        assert_eq!(pushed(&rules(Some(3.0)), &torques), [3, 4, 8, 9], "the threshold of the settings");
        assert_eq!(pushed(&rules(Some(0.0)), &torques), [] as [usize; 0], "not watched");
    }

    #[test]
    fn a_threshold_for_a_board_that_reports_no_torque_is_named_as_unused() {
        let mut rules = rules(Some(3.0));
        assert_eq!(rules.unused(), None);
        rules.axes = rules.axes.iter().map(|axis| Axis { contact_effort: 0.0, ..axis.clone() }).collect();
        assert!(rules.unused().is_some_and(|text| text.contains("`controller.contact_nm` is not used")));
        rules.contact_nm = Some(0.0);
        assert_eq!(rules.unused(), None, "switched off");
    }

    /// Time, ms, at which a hobby arm, whose load includes its weight, detects a contact: with this rise of the load
    /// per second, and these speeds of the joint and of another one, rad/s.
    fn rises(hold_error: f64, per_second: f64, (own, other): (f64, f64)) -> Option<u64> {
        let of = rules(None);
        let axes = of.axes.iter().map(|axis| Axis { hold_error, ..axis.clone() }).collect();
        let rules = Rules { axes, ..of };
        let mut watch = EffortWatch::default();
        let mut read = |ms: u64, moving: bool| {
            let secs = ms as f64 * 1e-3;
            let external = vec![1.0 + per_second * secs, 0.0];
            let q = vec![own * secs, other * secs].into();
            let sample = Sample { at: Time(ms * 1_000_000), external, q, ..Sample::default() };
            watch.read(&pulse(sample), moving, &rules).is_some()
        };
        assert!(!read(0, false));
        (10..1200).step_by(10).find(|ms| read(*ms, true))
    }

    #[test]
    fn load_that_rises_though_the_arm_hardly_moves_is_a_contact() {
        // the threshold is 5 N m
        let contact = |per_second: f64, speeds| rises(0.1, per_second, speeds).unwrap_or(u64::MAX);
        assert!((300..390).contains(&contact(5.0, (0.05, 0.0))), "{}", contact(5.0, (0.05, 0.0)));
        assert!((850..1030).contains(&contact(2.0, (0.02, 0.02))), "slower: {}", contact(2.0, (0.02, 0.02)));
        assert!((1000..1200).contains(&contact(2.0, (0.0, 0.2))), "at rest: {}", contact(2.0, (0.0, 0.2)));
        assert_eq!(rises(0.1, 2.0, (0.2, 0.2)), None, "it moves, and its weight with it");
        assert_eq!(rises(0.1, 0.9, (0.0, 0.0)), None, "the weight may change at this rate");
        assert_eq!(rises(0.0, 4.0, (0.05, 0.0)), None, "its board compensates the weight: the level counts");
    }

    /// A payload, or the contact that an escape leads out of: its release is no contact, an increase is.
    #[test]
    fn a_torque_that_was_there_before_the_motion_counts_by_its_change() {
        let rules = rules(None);
        let mut watch = EffortWatch::default();
        let shows = |torque: f64| Sample { external: vec![torque, 0.0], ..Sample::default() };
        assert_eq!(watch.read(&pulse(shows(8.0)), false, &rules), None);
        let mut read = |torque: f64| (0..5).filter_map(|_| watch.read(&pulse(shows(torque)), true, &rules)).count();
        assert_eq!([8.0, 12.5, 0.0].map(&mut read), [0; 3]);
        assert_eq!([13.5, -6.0].map(&mut read), [3, 5]);
    }
}
