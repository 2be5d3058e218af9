//! Motors that a contact has bent: the motion did not name them, and the stop may hold them where they were bent to.
//!
//! A board whose stop holds the measured position makes that position the motor's new target. Without its part in the
//! retreat the motor would stay there, and the next contact would bend it farther.

use crate::Rules;
use crate::history::Recorded;

/// Number of readings whose mean is compared: the noise of one encoder reading must not add a motor to a retreat.
const READINGS: usize = 8;
/// The same for a robot that pushes an obstacle: its retreat begins while the contact still bends it.
const PUSHING_READINGS: usize = 3;
/// Least change between the means before the motion and now, in tolerances. The distance to the safe pose alone is not
/// enough, since the safe pose is a single reading.
const MIN_CHANGE: f64 = 0.5;
/// The same for the mean of fewer readings.
const MIN_PUSHING_CHANGE: f64 = 1.0;

/// Returns the motors that deflect under load and are beyond the tolerance, and their hold error, of the safe pose: both
/// by the mean of the newest readings. `past`: recorded configurations, oldest first; `start`: index of the safe pose;
/// `pushes`: true if the robot still pushes an obstacle.
///
/// A motor whose board states no deflection is never bent: if it is elsewhere, something else has moved it.
pub(super) fn bent_motors(
    rules: &Rules,
    past: &[Recorded],
    (start, safe): (usize, &[f64]),
    pushes: bool,
) -> Vec<usize> {
    let (readings, min_change) = if pushes { (PUSHING_READINGS, MIN_PUSHING_CHANGE) } else { (READINGS, MIN_CHANGE) };
    let before = past.get((start + 1).saturating_sub(READINGS)..=start).unwrap_or_default();
    let now = past.get(past.len().saturating_sub(readings).max(start + 1)..).unwrap_or_default();
    let is_bent = |m: &usize| {
        let compliant = rules.axes.get(*m).is_some_and(|axis| axis.deflection > 0.0);
        let (Some(was), Some(is), Some(safe)) = (mean(before, *m), mean(now, *m), safe.get(*m)) else { return false };
        let beyond = |by: f64, share: f64| by.abs() > share * rules.tolerance + rules.hold_error(*m);
        compliant && beyond(is - safe, 1.0) && beyond(is - was, min_change)
    };
    (0..safe.len()).filter(is_bent).collect()
}

/// Mean position of a motor, rad; `None` without readings.
fn mean(readings: &[Recorded], motor: usize) -> Option<f64> {
    let all: Option<f64> = readings.iter().map(|r| r.q.get(motor)).sum();
    all.filter(|_| !readings.is_empty()).map(|all| all / readings.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::joint_retreat::tests::rules;
    use mobee_contract::{Axis, Time};
    use std::time::Duration;

    /// A robot of two motors, of which the second rests at zero before the motion (its reading at `start` is `safe`,
    /// deg) and at `end` after the stop, deg; `noise` is added to each reading, deg. Returns the motors that are bent.
    fn bent(axis: Axis, (safe, end): (f64, f64), pushes: bool, noise: &mut dyn FnMut() -> f64) -> Vec<usize> {
        let rules = rules(true);
        let named = Axis { deflection: 0.0, ..axis.clone() };
        let rules = Rules { axes: vec![named, axis].into(), ..Rules::clone(&rules) };
        let mut past: Vec<Recorded> = (0..200_u32)
            .map(|k| {
                let rests = if k < 20 { 0.0 } else { end };
                let q = vec![f64::from(k) * 0.01, (rests + noise()).to_radians()];
                Recorded::next(Time::ZERO + Duration::from_millis(10) * k, q.into(), 0.0)
            })
            .collect();
        past[19].q = vec![0.19, safe.to_radians()].into();
        let safe = past[19].q.clone();
        bent_motors(&rules, &past, (19, &safe), pushes)
    }

    fn compliant(hold_error: f64) -> Axis {
        Axis { deflection: 0.02, hold_error, ..Axis::default() }
    }

    #[test]
    fn a_compliant_motor_beyond_the_tolerance_is_bent() {
        let tolerance = rules(true).tolerance.to_degrees();
        for pushes in [false, true] {
            let of = |axis: Axis, by: f64| bent(axis, (0.0, by * tolerance), pushes, &mut || 0.0);
            assert_eq!((of(compliant(0.0), 1.2), of(compliant(0.0), -1.2)), (vec![1], vec![1]));
            assert!(of(compliant(0.0), 0.9).is_empty(), "it rests where it was, within the tolerance");
            assert!(of(Axis::default(), 20.0).is_empty(), "a board that states no deflection: something else moved it");
            let sags = compliant(2.0 * tolerance.to_radians());
            assert!(of(sags.clone(), 2.9).is_empty(), "it sags by as much");
            assert_eq!(of(sags, 3.1), [1]);
        }
        // a motor that one contact after another bends a little farther
        assert_eq!(bent(compliant(0.0), (-0.4 * tolerance, 0.7 * tolerance), false, &mut || 0.0), [1]);
    }

    /// Gaussian noise of 0.03 deg, also of the reading that became the safe pose.
    #[test]
    fn noise_bends_no_motor() {
        let mut state = 7_u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        let mut noise = move || 0.03 * ((0..12).map(|_| uniform()).sum::<f64>() - 6.0);
        for k in 0..2_000 {
            let safe = noise();
            assert!(bent(compliant(0.0), (safe, 0.0), k % 2 == 0, &mut noise).is_empty(), "retreat {k}");
        }
    }
}
