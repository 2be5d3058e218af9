//! Agreement of masks with the ground truth, pooled over all pixels of all images.

use super::picture::Mask;
use super::plane::Plane;
use serde::Serialize;

/// Confusion matrix of the pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Confusion {
    /// Pixels of the object that were detected (true positives).
    pub hit: u64,
    /// Pixels of the background that were detected (false positives).
    pub false_alarm: u64,
    /// Pixels of the object that were not detected (false negatives).
    pub miss: u64,
    /// Pixels of the background that were not detected (true negatives).
    pub rest: u64,
}

impl Confusion {
    /// Adds the pixels of an image.
    pub fn add(&mut self, found: &Mask, truth: &Mask) {
        for (found, truth) in found.data.iter().zip(&truth.data) {
            match (found, truth) {
                (true, true) => self.hit += 1,
                (true, false) => self.false_alarm += 1,
                (false, true) => self.miss += 1,
                (false, false) => self.rest += 1,
            }
        }
    }

    /// Returns Matthews' correlation coefficient: 1 for complete agreement, 0 for no correlation,
    /// also if a class of pixels is missing.
    pub fn mcc(&self) -> f64 {
        let [tp, fp, miss, tn] = [self.hit, self.false_alarm, self.miss, self.rest].map(|n| n as f64);
        let root = ((tp + fp) * (tp + miss) * (tn + fp) * (tn + miss)).sqrt();
        if root > 0.0 { (tp * tn - fp * miss) / root } else { 0.0 }
    }
}

/// Histograms of values, rounded down to 0 to 255, in the object and in the background: they
/// evaluate all thresholds in one pass.
#[derive(Clone, Debug)]
pub struct Levels {
    object: [u32; 256],
    beside: [u32; 256],
}

impl Default for Levels {
    fn default() -> Self {
        Levels { object: [0; 256], beside: [0; 256] }
    }
}

impl Levels {
    /// Adds the pixels of an image; values outside 0 to 255 are clamped.
    pub fn add(&mut self, plane: &Plane, truth: &Mask) {
        // Alternate between two tables, so that a repeated value does not wait for its own
        // increment.
        let mut counts = [[0u32; 512]; 2];
        for (values, truths) in plane.data.chunks(2).zip(truth.data.chunks(2)) {
            for ((counts, v), truth) in counts.iter_mut().zip(values).zip(truths) {
                counts[usize::from(*v as u8) | usize::from(*truth) << 8] += 1;
            }
        }
        for counts in counts {
            let (beside, object) = counts.split_at(256);
            self.beside.iter_mut().zip(beside).for_each(|(sum, n)| *sum += n);
            self.object.iter_mut().zip(object).for_each(|(sum, n)| *sum += n);
        }
    }

    /// Returns the correlation coefficient for a threshold.
    pub fn mcc(&self, threshold: usize) -> f64 {
        let sum = |of: &[u32]| of.iter().map(|n| u64::from(*n)).sum::<u64>();
        let hit = sum(&self.object[threshold..]);
        let false_alarm = sum(&self.beside[threshold..]);
        let miss = sum(&self.object[..threshold]);
        let rest = sum(&self.beside[..threshold]);
        Confusion { hit, false_alarm, miss, rest }.mcc()
    }

    /// Returns the threshold with the greatest correlation (in absolute value if `inverted` masks
    /// are equivalent), and that correlation with its sign.
    pub fn best(&self, inverted: bool) -> (u8, f64) {
        let worth = |mcc: f64| if inverted { mcc.abs() } else { mcc };
        let all: Vec<u64> = [&self.object, &self.beside].map(|l| l.iter().map(|n| u64::from(*n)).sum()).into();
        let mut miss = 0;
        let mut rest = 0;
        let mut best = (1, 0.0);
        for threshold in 1..=255u8 {
            miss += u64::from(self.object[threshold as usize - 1]);
            rest += u64::from(self.beside[threshold as usize - 1]);
            let mcc = Confusion { hit: all[0] - miss, false_alarm: all[1] - rest, miss, rest }.mcc();
            if worth(mcc) > worth(best.1) {
                best = (threshold, mcc);
            }
        }
        best
    }
}
