//! Default braking clearance of a robot.
//!
//! The configuration at rest is predicted from the speed, the time until a stop takes effect, and the deceleration of
//! each motor. The clearance covers the error of this prediction: a share of the stopping path of the motor that
//! carries a shape farthest.

use mobee_contract::Axis;
use mobee_model::Robot;
use std::time::Duration;

/// Error of the predicted rest, as a share of the stopping path, beyond the excess length of the predicted path.
/// Measured with an iCub (`cargo bench --bench look_ahead`): at full speed 5 mm, a share of 1.2 %, are not enough, 10
/// mm are.
const STOP_ERROR: f64 = 0.025;
/// The same share for the path of a whole arm with servos, all joints together. Measured with a Panda that explores
/// at 100 deg/s beside a post (`benches/README.md`): 2.5 % leave one hard contact in five minutes.
const FAST_ERROR: f64 = 0.04;
/// Least clearance, meters: encoders are noisy, and the paths of the ghosts are divided into steps of half of it.
const LEAST_M: f64 = 0.002;
/// Least clearance of a robot with a smaller margin than [`LEAST_M`], meters.
const LEAST_BY_MARGIN_M: f64 = 0.0005;

/// Greatest error of a robot's predicted rest, meters.
///
/// # Arguments
/// * `axes`: axes of its board, in the order of its motors.
/// * `reaction`: the longest time from a reading until a stop takes effect.
/// * `speed_share`: the share of the motors' greatest speeds at which it moves.
pub fn stop_error(robot: &Robot, axes: &[Axis], reaction: Duration, speed_share: f64) -> f64 {
    let path = |(axis, reach): (&Axis, f64)| {
        let speed = speed_share * axis.max_speed.abs();
        reach * (speed * reaction.as_secs_f64() + speed * speed / (2.0 * axis.max_acceleration.max(1e-6)))
    };
    STOP_ERROR * axes.iter().zip(robot.reach()).map(path).fold(0.0, f64::max)
}

/// Clearance of a robot whose joints overshoot the paths of their boards ([`Axis::overshoot`]). The overshoot adds up
/// over the joints: it grows with the stopping path, also beyond the margin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FastClearance {
    /// Clearance per meter of path.
    share: f64,
    /// Clearance with all joints at full speed, meters.
    pub most: f64,
}

impl FastClearance {
    /// Computes the clearance of this robot; zero if its joints don't overshoot. Arguments as for [`stop_error`].
    pub fn new(robot: &Robot, axes: &[Axis], reaction: Duration) -> FastClearance {
        let mut way = 0.0;
        let mut beyond = 0.0;
        for (axis, reach) in axes.iter().zip(robot.reach()) {
            let speed = axis.max_speed.abs();
            way += reach * (speed * reaction.as_secs_f64() + speed * speed / (2.0 * axis.max_acceleration.max(1e-6)));
            beyond += reach * axis.overshoot;
        }
        if beyond <= 0.0 || way <= 0.0 {
            return FastClearance::default();
        }
        FastClearance { share: FAST_ERROR + beyond / way, most: FAST_ERROR * way + beyond }
    }

    /// Clearance for a stopping path of this length, meters.
    pub fn after(&self, way: f64) -> f64 {
        self.most.min(self.share * way)
    }
}

/// Clearance of a robot, meters: [`stop_error`] at full speed, at least 2 mm, and at most the margin, since plans
/// come that close to objects.
pub fn braking_clearance(robot: &Robot, axes: &[Axis], reaction: Duration, margin: f64) -> f64 {
    stop_error(robot, axes, reaction, 1.0).max(LEAST_M).min(margin).max(LEAST_BY_MARGIN_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::parse_robot;
    use std::sync::Arc;

    const ARM: &str = include_str!("../../tests/data/pan.xml");

    /// An arm of half a meter; its motor has this speed, rad/s, and this deceleration, rad/s^2.
    fn arm(max_speed: f64, max_acceleration: f64) -> (Robot, Arc<[Axis]>) {
        let robot = parse_robot("arm.xml", &ARM.replace("NAME", "arm").replace("HOME", "0")).unwrap().value;
        let axis = Axis { name: "pan".into(), min: -3.0, max: 3.0, max_speed, max_acceleration, ..Default::default() };
        (robot, vec![axis].into())
    }

    #[test]
    fn an_arm_that_overshoots_has_more_while_it_is_fast() {
        let (robot, axes) = arm(1.0, 4.0);
        let reaction = Duration::from_millis(60);
        assert_eq!(FastClearance::new(&robot, &axes, reaction).after(0.1), 0.0, "a joint that stays on its path");
        let axes: Vec<Axis> = axes.iter().map(|axis| Axis { overshoot: 0.01, ..axis.clone() }).collect();
        let fast = FastClearance::new(&robot, &axes, reaction);
        let reach = robot.reach()[0];
        let way = reach * (0.06 + 1.0 / 8.0);
        assert!((fast.after(way) - (FAST_ERROR * way + 0.01 * reach)).abs() < 1e-12);
        assert!((fast.after(way / 2.0) - fast.most / 2.0).abs() < 1e-12 && fast.after(9.0) == fast.most);
    }

    #[test]
    fn it_grows_with_speed_period_and_latency_and_stays_within_the_margin() {
        let of = |speed, brakes, ms, margin| {
            let (robot, axes) = arm(speed, brakes);
            braking_clearance(&robot, &axes, Duration::from_millis(ms), margin)
        };
        let usual = of(1.0, 4.0, 60, 0.01);
        assert!(usual > 0.002 && usual < 0.01, "{usual}");
        assert!(of(1.5, 4.0, 60, 0.01) > usual, "a faster robot");
        assert!(of(1.0, 2.0, 60, 0.01) > usual, "one that brakes less hard");
        assert!(of(1.0, 4.0, 160, 0.01) > usual, "a longer period or latency");
        assert_eq!(of(0.01, 4.0, 60, 0.01), 0.002, "a slow robot");
        assert_eq!(of(10.0, 4.0, 60, 0.01), 0.01, "not beyond the margin");
        assert_eq!(of(1.0, 4.0, 60, 0.001), 0.001);
        assert_eq!(of(1.0, 4.0, 60, 0.0), 0.0005);
    }
}
