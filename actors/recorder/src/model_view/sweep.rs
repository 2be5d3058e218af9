//! Sweep of each motor through its range, with the others at home.

use mobee_contract::Time;
use mobee_model::{JointMotion, Motor, Robot};

/// Total duration of the sweeps, if the limits per motor allow it, s.
const TOTAL_SECS: f64 = 60.0;
/// Shortest and longest duration of one motor's sweep, s.
const MOTOR_SECS: (f64, f64) = (2.0, 6.0);
/// Time for which the robot is shown at home before the sweeps, s.
pub(super) const AT_HOME: f64 = 2.0;
/// Number of configurations of a sweep, within two.
const POSES: usize = 150;

/// A motor and its successive positions, from home over both limits back to home.
pub(super) struct MotorSweep {
    /// Index into the robot's motors.
    pub(super) motor: usize,
    /// Times, and positions at these times, rad of encoder.
    pub(super) positions: Vec<(Time, f64)>,
}

/// Sweeps of all motors that can move, one after the other.
pub(super) fn sweeps(robot: &Robot) -> Vec<MotorSweep> {
    let moving: Vec<usize> = (0..robot.motors.len()).filter(|m| robot.motors.get(*m).is_some_and(moves)).collect();
    let secs = (TOTAL_SECS / moving.len().max(1) as f64).clamp(MOTOR_SECS.0, MOTOR_SECS.1);
    let sweep = |(i, motor): (usize, usize)| {
        let positions = robot.motors.get(motor).map(positions).unwrap_or_default();
        let step = secs / positions.len().max(1) as f64;
        let begin = AT_HOME + secs * i as f64;
        let at = |(n, q): (usize, f64)| (Time::from_secs(begin + step * n as f64), q);
        MotorSweep { motor, positions: positions.into_iter().enumerate().map(at).collect() }
    };
    moving.into_iter().enumerate().map(sweep).collect()
}

fn moves(motor: &Motor) -> bool {
    let (min, max) = motor.range();
    max > min
}

/// Positions from home down to the lower limit, up to the upper one, and back, including both limits and home.
fn positions(motor: &Motor) -> Vec<f64> {
    let (min, max) = motor.range();
    let way = 2.0 * (max - min);
    let mut all = vec![motor.home];
    for (from, to) in [(motor.home, min), (min, max), (max, motor.home)] {
        let steps = (POSES as f64 * (to - from).abs() / way).ceil() as usize;
        all.extend((1..=steps).map(|i| from + (to - from) * i as f64 / steps as f64));
    }
    all
}

/// Formats a position in the units of its encoder, such as `-83.4°` or `120.0 mm`.
pub(super) fn in_units(motor: &Motor, q: f64) -> String {
    match motor.motion {
        JointMotion::Turn => format!("{:.1}°", q.to_degrees()),
        JointMotion::Slide => format!("{:.1} mm", q.to_degrees()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn motor(min: f64, max: f64, home: f64) -> Motor {
        let (name, motion) = (String::from("m"), JointMotion::Turn);
        let (max_speed, continuous, joints) = (None, false, Vec::new());
        Motor { name, part: 0, min, max, home, motion, max_speed, continuous, joints, is_part_root: true }
    }

    proptest! {
        #[test]
        fn a_sweep_begins_and_ends_at_home_and_reaches_both_limits(
            (min, way, share) in (-7.0_f64..3.0, 1e-6_f64..9.0, 0.0_f64..=1.0),
        ) {
            let (max, home) = (min + way, min + share * way);
            let all = positions(&motor(min, max, home.min(max)));
            let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
            prop_assert!(all.iter().any(|q| near(*q, min)) && all.iter().any(|q| near(*q, max)));
            prop_assert!(near(all[0], home) && near(all[all.len() - 1], home));
            prop_assert!(all.iter().all(|q| (min - 1e-9..=max + 1e-9).contains(q)));
            let widest = all.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
            prop_assert!(widest <= 2.0 * way / POSES as f64 + 1e-9, "a gap of {widest} in {way}");
        }
    }
}
