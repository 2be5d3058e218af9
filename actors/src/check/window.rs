//! The newest readings of a robot, for those who judge its motors one by one.
//!
//! Encoders may lie: an offset that comes and goes, noise, readings that were held up. Each of them is a kink, which a second
//! difference shows, and a motor that obeys its bounds of acceleration hardly has one: what a kink could have feigned is no evidence.

use mobee_contract::{Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// How many readings are looked at.
pub(super) const WINDOW: usize = 16;

/// When a motor was read, seconds since the oldest reading, and where it was, rad.
type Reading = (f64, f64);

/// The newest readings.
#[derive(Default)]
pub(super) struct Window {
    period: Duration,
    readings: VecDeque<(Time, Pose)>,
    /// Where the motors were before some readings were missed.
    before: Option<Pose>,
}

impl Window {
    /// Of a robot that is controlled with this period, seconds.
    pub fn new(period: f64) -> Window {
        Window { period: Duration::try_from_secs_f64(period).unwrap_or_default(), ..Window::default() }
    }

    /// Takes the next reading; whether there are enough of them now.
    pub fn take(&mut self, at: Time, q: &Pose) -> bool {
        match self.readings.back() {
            Some((last, _)) if at <= *last => return false,
            // after a pause the readings before say nothing
            Some((last, _)) if at.since(*last) > self.period * 2 => self.readings.clear(),
            _ => {}
        }
        if self.readings.len() == WINDOW {
            self.readings.pop_front();
        }
        self.readings.push_back((at, q.clone()));
        self.readings.len() == WINDOW
    }

    /// Where the motors were, if a reading of this time would come after a pause, or after some that were missed. By the last reading
    /// but one: nobody saw what came after the last, which may have been a jump.
    pub fn before_pause(&mut self, at: Time) -> Option<Pose> {
        let paused = self.readings.back().is_some_and(|(last, _)| at.since(*last) > self.period * 2);
        self.before.take().or_else(|| self.last_but_one().filter(|_| paused))
    }

    fn last_but_one(&self) -> Option<Pose> {
        let last = self.readings.len().checked_sub(1)?;
        self.readings.get(last.saturating_sub(1)).map(|(_, q)| q.clone())
    }

    /// Forgets all of them: some were missed.
    pub fn forget(&mut self) {
        self.before = self.last_but_one().or(self.before.take());
        self.readings.clear();
    }

    /// When the oldest was read.
    pub fn since(&self) -> Time {
        self.readings.front().map_or(Time::ZERO, |(at, _)| *at)
    }

    /// The mean position of a motor, rad.
    pub fn mean(&self, motor: usize) -> f64 {
        mean(self.of(motor).map(|(_, q)| q))
    }

    /// How far a motor came from the older half of the readings to the newer one, rad, and in which time, s.
    pub fn way(&self, motor: usize) -> (f64, f64) {
        let half = self.readings.len() / 2;
        let part = |skip: usize| {
            let part = || self.of(motor).skip(skip).take(half);
            (mean(part().map(|(t, _)| t)), mean(part().map(|(_, q)| q)))
        };
        let ((t0, q0), (t1, q1)) = (part(0), part(half));
        ((q1 - q0).abs(), t1 - t0)
    }

    /// The greatest kink of a motor's readings, rad: how far one was from the line through the two before. A jump makes two of them. The
    /// third is added: an encoder may jump twice, and noise may hide a part of a jump that is as large as the kinks that it makes itself.
    pub fn kink(&self, motor: usize) -> f64 {
        let [first, second, third] = [0, 1, 2].map(|skip| self.of(motor).skip(skip));
        let kink = |(((t0, a), (t1, b)), (t2, c)): ((Reading, Reading), Reading)| {
            (c - b - (b - a) * (t2 - t1) / (t1 - t0).max(1e-9)).abs()
        };
        let mut kinks: Vec<f64> = first.zip(second).zip(third).map(kink).collect();
        kinks.sort_unstable_by(|a, b| b.total_cmp(a));
        kinks.iter().step_by(2).take(2).sum()
    }

    /// The greatest step of a motor's readings, rad a period, by which they went faster than both before and after: no motor comes
    /// and rests within one period, but an encoder's offset does.
    pub fn jump(&self, motor: usize) -> f64 {
        let period = self.period.as_secs_f64();
        let step = |((t0, a), (t1, b)): (Reading, Reading)| ((b - a) * period / (t1 - t0).max(1e-9)).abs();
        let steps = self.of(motor).zip(self.of(motor).skip(1)).map(step);
        // nothing is known of the motor before the first, and what comes after the last step is still to be seen
        let steps: Vec<f64> = std::iter::once(0.0).chain(steps).collect();
        let beyond = |three: &[f64]| match three {
            [before, step, after] => step - before.max(*after),
            _ => 0.0,
        };
        steps.windows(3).map(beyond).fold(0.0, f64::max)
    }

    fn of(&self, motor: usize) -> impl Iterator<Item = Reading> + '_ {
        let since = self.since();
        self.readings.iter().filter_map(move |(at, q)| Some((at.since(since).as_secs_f64(), *q.get(motor)?)))
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = values.fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
    sum / f64::max(n, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An offset of encoders that tremble comes or goes: that kink accounts for all of the way, though the noise about it hides a part.
    #[test]
    fn a_jump_among_noise_is_a_kink_as_far_as_it_goes() {
        let seen = |noise: f64, jumps: [f64; 2]| {
            let mut window = Window::new(0.01);
            for k in 0..WINDOW {
                let at = Time::from_secs(0.01 * k as f64);
                let q = if k % 2 == 0 { -noise } else { noise }
                    + if k < 8 { 0.0 } else { jumps[0] }
                    + if k < 10 { 0.0 } else { jumps[1] };
                window.take(at, &[q].into());
            }
            (window.way(0).0, window.kink(0))
        };
        for (noise, jumps) in [(0.005, [0.094, 0.0]), (0.0, [0.077, 0.099]), (0.001, [0.077, 0.099])] {
            let (way, kink) = seen(noise, jumps);
            assert!(way > 0.075 && kink >= way - 1e-9, "{noise} {jumps:?}: {way} {kink}");
        }
        // without noise one counts once
        assert!(seen(0.0, [0.094, 0.0]).1 < 0.0941);
    }
}
