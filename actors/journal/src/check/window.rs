//! The newest readings of a robot, for checks of single motors.
//!
//! Encoder readings may be wrong: an offset that comes and goes, noise, delayed readings. Each causes a kink,
//! which a second difference shows, while a motor that obeys its acceleration limits hardly has one. Motion
//! that a kink could have feigned is no evidence.

use mobee_contract::{Pose, Time};
use std::collections::VecDeque;
use std::time::Duration;

/// Number of readings in the window.
pub(super) const WINDOW: usize = 16;

/// Time of a reading, seconds since the oldest one, and the motor's position, rad.
type TimedPosition = (f64, f64);

/// The newest readings.
#[derive(Default)]
pub(super) struct Window {
    period: Duration,
    readings: VecDeque<(Time, Pose)>,
    /// Positions of the motors before some readings were lost.
    before: Option<Pose>,
}

impl Window {
    /// Creates the window for a robot with this control period, s.
    pub fn new(period: f64) -> Window {
        Window { period: Duration::try_from_secs_f64(period).unwrap_or_default(), ..Window::default() }
    }

    /// Takes the next reading. Returns true if the window is full.
    pub fn take(&mut self, at: Time, q: &Pose) -> bool {
        match self.readings.back() {
            Some((last, _)) if at <= *last => return false,
            // After a pause the earlier readings no longer apply.
            Some((last, _)) if at.since(*last) > self.period * 2 => self.readings.clear(),
            _ => {}
        }
        if self.readings.len() == WINDOW {
            self.readings.pop_front();
        }
        self.readings.push_back((at, q.clone()));
        self.readings.len() == WINDOW
    }

    /// Positions of the motors before a gap, if a reading at this time would follow a pause or lost readings.
    /// The last reading but one is used: no reading confirms the last one, which may have been a jump.
    pub fn before_pause(&mut self, at: Time) -> Option<Pose> {
        let paused = self.readings.back().is_some_and(|(last, _)| at.since(*last) > self.period * 2);
        self.before.take().or_else(|| self.last_but_one().filter(|_| paused))
    }

    fn last_but_one(&self) -> Option<Pose> {
        let last = self.readings.len().checked_sub(1)?;
        self.readings.get(last.saturating_sub(1)).map(|(_, q)| q.clone())
    }

    /// Clears the window, because readings were lost.
    pub fn forget(&mut self) {
        self.before = self.last_but_one().or(self.before.take());
        self.readings.clear();
    }

    /// Time of the oldest reading.
    pub fn since(&self) -> Time {
        self.readings.front().map_or(Time::ZERO, |(at, _)| *at)
    }

    /// Mean position of a motor, rad.
    pub fn mean(&self, motor: usize) -> f64 {
        mean(self.of(motor).map(|(_, q)| q))
    }

    /// Distance of a motor between the means of the older and the newer half of the readings, rad, and the time
    /// between them, s.
    pub fn way(&self, motor: usize) -> (f64, f64) {
        let half = self.readings.len() / 2;
        let part = |skip: usize| {
            let part = || self.of(motor).skip(skip).take(half);
            (mean(part().map(|(t, _)| t)), mean(part().map(|(_, q)| q)))
        };
        let (t0, q0) = part(0);
        let (t1, q1) = part(half);
        ((q1 - q0).abs(), t1 - t0)
    }

    /// Greatest kink of a motor's readings, rad: the distance of a reading from the line through the two before
    /// it. A jump causes two of them. The third largest is added, because an encoder may jump twice, and noise
    /// may hide as much of a jump as the kinks that it causes itself.
    pub fn kink(&self, motor: usize) -> f64 {
        let [first, second, third] = [0, 1, 2].map(|skip| self.of(motor).skip(skip));
        let kink = |(((t0, a), (t1, b)), (t2, c)): ((TimedPosition, TimedPosition), TimedPosition)| {
            (c - b - (b - a) * (t2 - t1) / (t1 - t0).max(1e-9)).abs()
        };
        let mut kinks: Vec<f64> = first.zip(second).zip(third).map(kink).collect();
        kinks.sort_unstable_by(|a, b| b.total_cmp(a));
        kinks.iter().step_by(2).take(2).sum()
    }

    /// Greatest step of a motor's readings, rad per period, in excess of the steps before and after it. No
    /// motor starts and stops within one period, but an encoder's offset does.
    pub fn jump(&self, motor: usize) -> f64 {
        let period = self.period.as_secs_f64();
        let step = |((t0, a), (t1, b)): (TimedPosition, TimedPosition)| ((b - a) * period / (t1 - t0).max(1e-9)).abs();
        let steps = self.of(motor).zip(self.of(motor).skip(1)).map(step);
        // The motor's motion before the first reading is unknown, and so is the step after the last one.
        let steps: Vec<f64> = std::iter::once(0.0).chain(steps).collect();
        let beyond = |three: &[f64]| match three {
            [before, step, after] => step - before.max(*after),
            _ => 0.0,
        };
        steps.windows(3).map(beyond).fold(0.0, f64::max)
    }

    fn of(&self, motor: usize) -> impl Iterator<Item = TimedPosition> + '_ {
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

    /// A noisy encoder with an offset that comes or goes: the kink accounts for the whole distance, although
    /// the noise hides part of it.
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
        // Without noise the kink counts once.
        assert!(seen(0.0, [0.094, 0.0]).1 < 0.0941);
    }
}
