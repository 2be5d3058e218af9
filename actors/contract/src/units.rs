//! What a robot's motors count, for sentences.

use crate::Axis;
use mobee_model::JointMotion;

/// Which of a robot's motors slide, as its description tells ([`Event::Robot`](crate::Event::Robot)).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotorUnits {
    motors: usize,
    sliding: Vec<usize>,
}

impl MotorUnits {
    /// Of so many motors, of which these slide.
    pub fn new(motors: usize, sliding: &[usize]) -> MotorUnits {
        MotorUnits { motors, sliding: sliding.to_vec() }
    }

    /// Of these motors.
    pub fn of_axes(axes: &[Axis]) -> MotorUnits {
        let sliding = axes.iter().enumerate().filter(|(_, axis)| !axis.motion.is_turn()).map(|(motor, _)| motor);
        MotorUnits { motors: axes.len(), sliding: sliding.collect() }
    }

    /// Those that slide, by their number.
    pub fn sliding(&self) -> &[usize] {
        &self.sliding
    }

    /// How a motor moves.
    pub fn of(&self, motor: usize) -> JointMotion {
        if self.sliding.contains(&motor) { JointMotion::Slide } else { JointMotion::Turn }
    }

    /// A way, rad of encoder, that may be any motor's: `3.2 deg`, or `3.2 deg or mm` of a robot that has both kinds.
    pub fn told(&self, q: f64, digits: usize) -> String {
        self.any(q, digits, "")
    }

    /// A speed, rad/s of encoder, that may be any motor's.
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
    fn what_may_be_any_motors_is_told_in_the_units_that_there_are() {
        let q = 3.25_f64.to_radians();
        let told = |motors, sliding: &[usize]| MotorUnits::new(motors, sliding).told_speed(q, 1);
        assert_eq!(told(2, &[]), "3.2 deg/s");
        assert_eq!(told(2, &[1]), "3.2 deg/s or mm/s");
        assert_eq!(told(1, &[0]), "3.2 mm/s");
        assert_eq!(MotorUnits::new(2, &[1]).of(1).told(q, 2), "3.25 mm");
    }
}
