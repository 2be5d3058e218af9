//! A contact by effort: the board reports a torque from outside that is greater than its arm knows in free motion.
//!
//! A stiff arm pushes with hundreds of newtons before it lags by a degree; its torque sensors, or its motors' currents, show the contact
//! while it pushes with tens ([`Sample::external`]). Thresholds are per motor ([`Rules::contact_effort`]). A torque that was there before the
//! motion, of a payload or of the contact that an escape leads out of, counts by its change alone.

use crate::Rules;
use mobee_contract::Sample;

/// So many readings in a row must show it: noise, and the jerk with which a motor sets out, show it in one.
const READINGS: u32 = 3;

/// Watches the torques from outside of one robot.
#[derive(Clone, Debug, Default)]
pub struct EffortWatch {
    /// Per motor how many readings in a row have been beyond its threshold.
    beyond: Vec<u32>,
    /// The torques of the last reading before the motion.
    before: Vec<f64>,
}

/// A motor that something pushes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pushed {
    /// The motor.
    pub motor: usize,
    /// The torque, N m (N where it slides).
    pub torque: f64,
}

impl EffortWatch {
    /// A reading, in a motion or between two: the motor that is pushed most, by its threshold. Torques that are no numbers are none.
    pub fn read(&mut self, sample: &Sample, moving: bool, rules: &Rules) -> Option<Pushed> {
        self.beyond.resize(sample.external.len(), 0);
        if !moving {
            self.beyond.fill(0);
            self.before.clone_from(&sample.external);
            return None;
        }
        let before = |motor: usize| self.before.get(motor).copied().filter(|torque| torque.is_finite()).unwrap_or(0.0);
        let share = |(motor, torque): (usize, &f64)| {
            let counts = torque.abs().min((torque - before(motor)).abs());
            (motor, *torque, rules.contact_effort(motor).map_or(0.0, |limit| counts / limit))
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

    /// The readings in which the first motor counts as pushed; the second, whose board reports none, never does.
    fn pushed(rules: &Rules, torques: &[f64]) -> Vec<usize> {
        let mut watch = EffortWatch::default();
        let shows = |torque: f64| Sample { external: vec![torque, 1e6], ..Sample::default() };
        let read = |(k, torque): (usize, &f64)| watch.read(&shows(*torque), true, rules).map(|pushed| (k, pushed));
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

    /// A payload, or the contact that an escape leads out of: letting go of it is no contact, more of it is.
    #[test]
    fn a_torque_that_was_there_before_the_motion_counts_by_its_change() {
        let (rules, mut watch) = (rules(None), EffortWatch::default());
        let shows = |torque: f64| Sample { external: vec![torque, 0.0], ..Sample::default() };
        assert_eq!(watch.read(&shows(8.0), false, &rules), None);
        let mut read = |torque: f64| (0..5).filter_map(|_| watch.read(&shows(torque), true, &rules)).count();
        assert_eq!([8.0, 12.5, 0.0].map(&mut read), [0; 3]);
        assert_eq!([13.5, -6.0].map(&mut read), [3, 5]);
    }
}
