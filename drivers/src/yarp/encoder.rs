//! By how much the readings of a joint at rest differ: the counts of a coarse encoder, and noise.
//!
//! A count shows as the step that all changes are multiples of; noise as the second difference of readings, which a steady motion does
//! not have: for independent readings of variance s², it has the variance 6 s².

/// Readings at rest may always differ by so much, deg.
const LEAST: f64 = 0.08;
/// More is no noise, deg.
const MOST: f64 = 0.5;
/// Changes in a row that are multiples of one step before that is a count of the encoder.
const MULTIPLES: u32 = 10;
/// By which share of a step a multiple may be off.
const OFF: f64 = 0.1;
/// Changes below this are rounding of numbers, deg.
const ROUNDING: f64 = 1e-6;
/// Readings over which noise is averaged, at most.
const AVERAGED: f64 = 100.0;
/// The spread of some readings at rest, in standard deviations; and what a single reading may be off.
const SPREAD: (f64, f64) = (5.0, 4.0);
/// A joint may stand between two counts.
const COUNTS: f64 = 1.5;

/// The encoder of one joint. Degrees or millimeters.
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    /// The last two readings.
    last: Option<f64>,
    before: Option<f64>,
    /// The step so far, and how many changes in a row were multiples of it.
    step: Option<f64>,
    multiples: u32,
    /// The variance of the noise, and of how many readings.
    variance: f64,
    averaged: f64,
}

impl Encoder {
    /// The next reading; `steady`: the joint rests, but for noise.
    pub fn read(&mut self, q: f64, steady: bool) {
        if !q.is_finite() {
            return;
        }
        let (last, before) = (self.last.replace(q), self.before);
        self.before = last;
        let Some(last) = last else { return };
        let change = (q - last).abs();
        if change > ROUNDING {
            self.changed(change);
        }
        if let (Some(before), true) = (before, steady) {
            let second = q - 2.0 * last + before;
            self.averaged = (self.averaged + 1.0).min(AVERAGED);
            self.variance += (second * second / 6.0 - self.variance) / self.averaged;
        }
    }

    fn changed(&mut self, change: f64) {
        let times = self.step.map(|step| change / step);
        if times.is_some_and(|times| times > 0.5 && (times - times.round()).abs() <= OFF) {
            self.multiples = self.multiples.saturating_add(1);
        } else {
            // as Euclid finds the greatest common divisor
            let rest = |step: f64| (change - (change / step).round() * step).abs();
            self.step = Some(self.step.map_or(change, |step| rest(step).max(ROUNDING)));
            self.multiples = 0;
        }
    }

    /// The readings before were of another life of the board.
    pub fn forget(&mut self) {
        (self.last, self.before) = (None, None);
    }

    /// Standard deviation of its noise at rest, deg.
    pub fn noise(&self) -> f64 {
        self.variance.sqrt()
    }

    /// One count, deg; zero if the encoder shows none.
    pub fn count(&self) -> f64 {
        self.step.filter(|_| self.multiples >= MULTIPLES).unwrap_or(0.0)
    }

    /// By how much readings of a joint at rest may differ, deg.
    pub fn play(&self) -> f64 {
        let noise = SPREAD.0 * self.noise();
        (COUNTS * self.count()).max(noise).clamp(LEAST, MOST)
    }

    /// What a single reading may be off by, deg: a count, or four standard deviations of its noise.
    pub fn resolution(&self) -> f64 {
        self.count().max(SPREAD.1 * self.noise()).min(MOST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// The readings of a joint by an encoder with noise and counts.
    fn encoder(q: impl Fn(u32) -> f64, (noise, count): (f64, f64), n: u32, steady: bool) -> Encoder {
        let (mut rng, mut encoder) = (rand_chacha::ChaCha8Rng::seed_from_u64(3), Encoder::default());
        for i in 0..n {
            // twelve uniform numbers are nearly normal
            let normal = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>();
            let q = q(i) + noise * normal;
            let q = if count > 0.0 { (q / count).round() * count } else { q };
            encoder.read(q, steady);
        }
        encoder
    }

    #[test]
    fn a_quiet_encoder_has_the_least_play() {
        let quiet = encoder(|_| 12.0, (0.0, 0.0), 100, true);
        assert_eq!((quiet.play(), quiet.resolution()), (LEAST, 0.0));
        let fine = encoder(|_| 12.0, (0.005, 0.01), 100, true);
        assert_eq!(fine.play(), LEAST);
    }

    #[test]
    fn noise_at_rest_is_measured() {
        for sigma in [0.02, 0.03, 0.05] {
            let measured = encoder(|_| 12.0, (sigma, 0.0), 200, true).resolution() / SPREAD.1;
            assert!((measured / sigma - 1.0).abs() < 0.25, "{measured} for {sigma}");
        }
    }

    #[test]
    fn counts_show_at_rest_and_in_motion() {
        let count = 360.0 / 4096.0;
        let dithers = encoder(|_| 136.5 * count, (0.02, count), 100, true);
        let moves = encoder(|i| 0.37 * f64::from(i), (0.0, count), 100, false);
        for encoder in [dithers, moves] {
            assert!((encoder.count() - count).abs() < 1e-9, "{}", encoder.count());
            assert!(encoder.play() >= COUNTS * count);
        }
    }

    /// A motion at any speed is neither noise nor a count.
    #[test]
    fn a_motion_is_no_noise() {
        let eases = |i: u32| 20.0 * (1.0 - (0.05 * f64::from(i)).cos());
        let moves = encoder(eases, (0.0, 0.0), 300, false);
        assert_eq!((moves.play(), moves.resolution()), (LEAST, 0.0));
    }
}
