//! Credit: limits the accepted rate of requests.

use crate::Time;

/// A token bucket: a steady flow passes in full, a flood only at the refill rate.
#[derive(Clone, Copy, Debug)]
pub struct Credit {
    left: f64,
    at: Time,
    per_second: f64,
    most: f64,
}

impl Credit {
    /// Creates a full bucket of `most` tokens, refilled at `per_second`.
    pub fn full(now: Time, per_second: f64, most: f64) -> Credit {
        Credit { left: most, at: now, per_second, most }
    }

    /// Takes one token, if there is one.
    pub fn take(&mut self, now: Time) -> bool {
        self.left = (self.left + now.since(self.at).as_secs_f64() * self.per_second).min(self.most);
        self.at = self.at.max(now);
        let is_left = self.left >= 1.0;
        if is_left {
            self.left -= 1.0;
        }
        is_left
    }

    /// Takes `count` more tokens, even if there are fewer: a large request is not split, and the debt delays the next
    /// one.
    pub fn owe(&mut self, count: usize) {
        self.left -= count as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(k: u64) -> Time {
        Time(k * 1_000_000)
    }

    #[test]
    fn a_flood_is_limited_and_a_steady_program_is_not() {
        let mut credit = Credit::full(Time::ZERO, 250.0, 500.0);
        let accepted = (0..100_000_u64).filter(|k| credit.take(Time(k * 100_000))).count();
        assert!((2990..=3000).contains(&accepted), "ten seconds of ten thousand a second: {accepted}");
        assert!((0..5000).all(|k| credit.take(ms(14_000 + 5 * k))), "two hundred a second");
    }

    #[test]
    fn a_large_request_is_taken_whole_and_paid_for() {
        let mut credit = Credit::full(Time::ZERO, 100.0, 200.0);
        assert!(credit.take(Time::ZERO));
        credit.owe(999);
        assert!(!credit.take(ms(8000)), "eight hundred in debt");
        assert!(credit.take(ms(8020)));
    }
}
