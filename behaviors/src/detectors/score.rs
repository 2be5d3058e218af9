//! How well masks agree with the truth, pooled over all pixels of all pictures.

use super::picture::Mask;
use super::plane::Plane;
use serde::Serialize;

/// Pixels by what was said of them and what they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Confusion {
    /// The object, and found.
    pub hit: u64,
    /// Not the object, but found.
    pub false_alarm: u64,
    /// The object, but not found.
    pub miss: u64,
    /// Neither.
    pub rest: u64,
}

impl Confusion {
    /// Adds the pixels of a picture.
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

    /// Matthews' correlation coefficient: 1 where all agree, 0 where nothing is told, also if there is no pixel of some sort.
    pub fn mcc(&self) -> f64 {
        let [tp, fp, miss, tn] = [self.hit, self.false_alarm, self.miss, self.rest].map(|n| n as f64);
        let root = ((tp + fp) * (tp + miss) * (tn + fp) * (tn + miss)).sqrt();
        if root > 0.0 { (tp * tn - fp * miss) / root } else { 0.0 }
    }
}

/// How often each value, rounded down to 0 to 255, is in the object and beside it: all thresholds are judged in one pass.
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
    /// Adds the pixels of a picture; values beyond 0 to 255 count as these.
    pub fn add(&mut self, plane: &Plane, truth: &Mask) {
        // counted in turn in two tables, so that a value that is there again need not wait for itself
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

    /// The correlation for a threshold.
    pub fn mcc(&self, threshold: usize) -> f64 {
        let sum = |of: &[u32]| of.iter().map(|n| u64::from(*n)).sum::<u64>();
        let (hit, false_alarm) = (sum(&self.object[threshold..]), sum(&self.beside[threshold..]));
        let (miss, rest) = (sum(&self.object[..threshold]), sum(&self.beside[..threshold]));
        Confusion { hit, false_alarm, miss, rest }.mcc()
    }

    /// The threshold with the greatest correlation (of its size only, if `inverted` masks are as good), and that correlation with its sign.
    pub fn best(&self, inverted: bool) -> (u8, f64) {
        let worth = |mcc: f64| if inverted { mcc.abs() } else { mcc };
        let all: Vec<u64> = [&self.object, &self.beside].map(|l| l.iter().map(|n| u64::from(*n)).sum()).into();
        let (mut miss, mut rest, mut best) = (0, 0, (1, 0.0));
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
