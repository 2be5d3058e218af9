//! Scatter of the readings of a joint at rest: counts of a coarse encoder, and noise.
//!
//! A count is the step of which all changes are multiples. Noise is the second difference of readings, which
//! is zero for a steady motion; for independent readings of variance s², its variance is 6 s².

/// Least scatter assumed for readings at rest, deg.
const MIN_NOISE_DEG: f64 = 0.08;
/// Greatest scatter that counts as noise, deg.
const MAX_NOISE_DEG: f64 = 0.5;
/// Number of changes in a row that must be multiples of one step to accept the step as a count.
const MULTIPLES: u32 = 10;
/// Tolerance of a multiple, as a share of the step.
const OFF: f64 = 0.1;
/// Changes below this are rounding of numbers, deg.
const ROUNDING: f64 = 1e-6;
/// Largest number of readings over which noise is averaged.
const AVERAGED: f64 = 100.0;
/// Standard deviations covered by the spread of readings at rest, and by the error of a single reading.
const SPREAD: (f64, f64) = (5.0, 4.0);
/// Scatter in counts of a joint that stands between two counts.
const COUNTS: f64 = 1.5;

/// Encoder of one joint. Degrees or millimeters.
#[derive(Clone, Debug, Default)]
pub struct Encoder {
    /// Last two readings.
    last: Option<f64>,
    before: Option<f64>,
    /// Present estimate of the step, and the number of changes in a row that were multiples of it.
    step: Option<f64>,
    multiples: u32,
    /// Variance of the noise, and the number of readings it is based on.
    variance: f64,
    averaged: f64,
}

impl Encoder {
    /// Adds a reading. `steady` states that the joint rests, except for noise.
    pub fn read(&mut self, q: f64, steady: bool) {
        if !q.is_finite() {
            return;
        }
        let last = self.last.replace(q);
        let before = self.before;
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
            // Euclid's algorithm for the greatest common divisor
            let rest = |step: f64| (change - (change / step).round() * step).abs();
            self.step = Some(self.step.map_or(change, |step| rest(step).max(ROUNDING)));
            self.multiples = 0;
        }
    }

    /// Discards the last readings, which belong to an earlier connection of the board.
    pub fn forget(&mut self) {
        (self.last, self.before) = (None, None);
    }

    /// Standard deviation of the noise at rest, deg.
    pub fn noise(&self) -> f64 {
        self.variance.sqrt()
    }

    /// One count, deg; zero if the encoder shows no counts.
    pub fn count(&self) -> f64 {
        self.step.filter(|_| self.multiples >= MULTIPLES).unwrap_or(0.0)
    }

    /// Greatest difference between readings of a joint at rest, deg.
    pub fn play(&self) -> f64 {
        let noise = SPREAD.0 * self.noise();
        (COUNTS * self.count()).max(noise).clamp(MIN_NOISE_DEG, MAX_NOISE_DEG)
    }

    /// Error of a single reading, deg: a count, or four standard deviations of the noise.
    pub fn resolution(&self) -> f64 {
        self.count().max(SPREAD.1 * self.noise()).min(MAX_NOISE_DEG)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// Readings of a joint by an encoder with noise and counts.
    fn encoder(q: impl Fn(u32) -> f64, (noise, count): (f64, f64), n: u32, steady: bool) -> Encoder {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut encoder = Encoder::default();
        for i in 0..n {
            // the sum of twelve uniform numbers is nearly normal
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
        assert_eq!((quiet.play(), quiet.resolution()), (MIN_NOISE_DEG, 0.0));
        let fine = encoder(|_| 12.0, (0.005, 0.01), 100, true);
        assert_eq!(fine.play(), MIN_NOISE_DEG);
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

    /// A motion counts neither as noise nor as an encoder step, at any speed.
    #[test]
    fn a_motion_is_no_noise() {
        let eases = |i: u32| 20.0 * (1.0 - (0.05 * f64::from(i)).cos());
        let moves = encoder(eases, (0.0, 0.0), 300, false);
        assert_eq!((moves.play(), moves.resolution()), (MIN_NOISE_DEG, 0.0));
    }
}
