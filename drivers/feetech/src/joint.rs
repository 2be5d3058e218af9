//! One servo at one motor of the robot: counts of its encoder and radians of the model.
//!
//! ```text
//! angle = sign * (count - middle) * 2 pi / 4095 + offset        4095: as LeRobot counts degrees
//! ```

use std::f64::consts::TAU;

/// Radians of one count, by LeRobot's convention: 360 degrees are 4095 counts.
pub const RAD_PER_COUNT: f64 = TAU / 4095.0;

/// A servo as the settings describe it.
#[derive(Clone, Debug, PartialEq)]
pub struct ServoJoint {
    /// The motor's name in the robot model.
    pub name: String,
    /// The servo's id.
    pub id: u8,
    /// First and last count that the driver commands.
    pub range: (i32, i32),
    /// The count of zero degrees before the offset.
    pub middle: f64,
    /// True if greater counts are smaller angles.
    pub inverted: bool,
    /// The model's angle at the middle, rad.
    pub offset: f64,
    /// The offset that the servo must store, if a calibration states it.
    pub homing_offset: Option<i32>,
}

impl ServoJoint {
    /// The angle at this count, rad.
    pub fn angle(&self, count: f64) -> f64 {
        self.sign() * (count - self.middle) * RAD_PER_COUNT + self.offset
    }

    /// The nearest count to this angle within the range.
    pub fn count(&self, angle: f64) -> i32 {
        let count = self.middle + self.sign() * (angle - self.offset) / RAD_PER_COUNT;
        // written so that NaN, which no checked command has, stays at the middle
        let count = if count.is_finite() { count.round() } else { self.middle };
        (count as i32).clamp(self.range.0, self.range.1)
    }

    /// Lower and upper limit of the angle, rad.
    pub fn limits(&self) -> (f64, f64) {
        let ends = [self.range.0, self.range.1].map(|count| self.angle(f64::from(count)));
        let [first, last] = ends;
        (first.min(last), first.max(last))
    }

    fn sign(&self) -> f64 {
        if self.inverted { -1.0 } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn joint(inverted: bool) -> ServoJoint {
        let (range, middle) = ((800, 3300), 2050.0);
        ServoJoint { name: "elbow".into(), id: 3, range, middle, inverted, offset: 0.3, homing_offset: None }
    }

    proptest! {
        /// Every count in the range is an angle that leads back to it; no angle leads out of the range.
        #[test]
        fn counts_survive(count in 800i32..=3300, inverted: bool, wild in any::<f64>()) {
            let joint = joint(inverted);
            let angle = joint.angle(f64::from(count));
            prop_assert_eq!(joint.count(angle), count);
            let (min, max) = joint.limits();
            prop_assert!(angle >= min - 1e-12 && angle <= max + 1e-12);
            let wild = joint.count(wild);
            prop_assert!((800..=3300).contains(&wild));
        }
    }

    /// LeRobot: degrees = (count - middle) * 360 / 4095.
    #[test]
    fn degrees_are_those_of_lerobot() {
        let joint = ServoJoint { offset: 0.0, ..joint(false) };
        assert!((joint.angle(3073.75).to_degrees() - 90.0).abs() < 1e-9);
    }
}
