//! Units of a robot's motors, for texts.

use crate::Axis;
use mobee_model::JointMotion;

/// Joint kinds of a robot's motors, from its description ([`Event::Robot`](crate::Event::Robot)).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotorUnits {
    motors: usize,
    sliding: Vec<usize>,
}

impl MotorUnits {
    /// Units of this number of motors, with these prismatic joints.
    pub fn new(motors: usize, sliding: &[usize]) -> MotorUnits {
        MotorUnits { motors, sliding: sliding.to_vec() }
    }

    /// Units of these motors.
    pub fn of_axes(axes: &[Axis]) -> MotorUnits {
        let sliding = axes.iter().enumerate().filter(|(_, axis)| !axis.motion.is_turn()).map(|(motor, _)| motor);
        MotorUnits { motors: axes.len(), sliding: sliding.collect() }
    }

    /// Indices of the prismatic joints.
    pub fn sliding(&self) -> &[usize] {
        &self.sliding
    }

    /// Joint kind of a motor.
    pub fn of(&self, motor: usize) -> JointMotion {
        if self.sliding.contains(&motor) { JointMotion::Slide } else { JointMotion::Turn }
    }

    /// Formats a distance, rad of encoder, of an unspecified motor: `3.2 deg`, or `3.2 deg or mm` for a robot with
    /// both joint kinds.
    pub fn told(&self, q: f64, digits: usize) -> String {
        self.any(q, digits, "")
    }

    /// Formats a speed, rad/s of encoder, of an unspecified motor.
    pub fn told_speed(&self, speed: f64, digits: usize) -> String {
        self.any(speed, digits, "/s")
    }

    fn any(&self, value: f64, digits: usize, per: &str) -> String {
        let [turn, slide] = [JointMotion::Turn, JointMotion::Slide];
        match self.sliding.len() {
            0 => turn.told(value, digits) + per,
            n if n >= self.motors => slide.told(value, digits) + per,
            _ => format!("{}{per} or {}{per}", turn.told(value, digits), slide.unit()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_an_unspecified_motor_have_all_units_of_the_robot() {
        let q = 3.25_f64.to_radians();
        let format = |motors, sliding: &[usize]| MotorUnits::new(motors, sliding).told_speed(q, 1);
        assert_eq!(format(2, &[]), "3.2 deg/s");
        assert_eq!(format(2, &[1]), "3.2 deg/s or mm/s");
        assert_eq!(format(1, &[0]), "3.2 mm/s");
        assert_eq!(MotorUnits::new(2, &[1]).of(1).told(q, 2), "3.25 mm");
    }
}
