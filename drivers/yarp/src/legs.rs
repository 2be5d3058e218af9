//! Moves made of setpoints: a trajectory of our own, for boards whose reference speeds are not speeds.
//!
//! ```text
//! begin ──> in motion ──last setpoint──> ending ──at rest: back to position mode──> removed
//! ```
//! All joints of a move are synchronized on the straight line to its target: the share of the path covered
//! grows with a trapezoidal velocity. Time advances with the readings, so that no setpoint jumps after a
//! pause: none is farther than the speed allows. Time stops while a joint lags by more than the board's
//! latency explains. Otherwise setpoints that are delayed and arrive in a bunch would be caught up with at
//! whatever speed the board can reach.

use mobee_contract::{Board, Time};
use std::time::Duration;

/// Share of a motor's speed that is used for planning, which leaves a margin to catch up with a late
/// setpoint.
const PLANNED: f64 = 0.8;
/// Number of the board's periods by which a move may advance from one reading to the next.
const MAX_PERIODS: f64 = 1.0 / PLANNED;

/// Lag of a joint that is tolerated in addition to the latency, as s at its speed and as rad.
const BEHIND: (f64, f64) = (0.1, 0.5 * std::f64::consts::PI / 180.0);

/// One move.
#[derive(Clone, Debug)]
struct MoveLeg {
    motors: Vec<usize>,
    from: Vec<f64>,
    to: Vec<f64>,
    /// Duration at full speed, and of the ramps at both ends, s.
    full: f64,
    ramp: f64,
    /// Elapsed time of the move, s.
    gone: f64,
    /// Lag tolerated per motor, rad.
    behind: Vec<f64>,
}

impl MoveLeg {
    /// Share of the path covered.
    fn share(&self) -> f64 {
        let all = self.full + self.ramp;
        let ramp = self.ramp.max(1e-6);
        let t = self.gone;
        let left = all - self.gone;
        if left <= 0.0 {
            1.0
        } else if t < ramp {
            t * t / (2.0 * ramp * self.full)
        } else if left < ramp {
            1.0 - left * left / (2.0 * ramp * self.full)
        } else {
            (t - 0.5 * ramp) / self.full
        }
    }

    /// True if all its motors follow.
    fn follows(&self, q: &[f64]) -> bool {
        let behind = |((motor, to), most): ((&usize, f64), &f64)| q.get(*motor).is_some_and(|q| (to - q).abs() > *most);
        !self.motors.iter().zip(self.set_points()).zip(&self.behind).any(behind)
    }

    fn set_points(&self) -> Vec<f64> {
        let share = self.share();
        if share >= 1.0 {
            return self.to.clone(); // exact target, without rounding
        }
        self.from.iter().zip(&self.to).map(|(from, to)| from + share * (to - from)).collect()
    }
}

/// Moves in progress, and motors that are settling after one.
#[derive(Clone, Debug, Default)]
pub struct Legs {
    under_way: Vec<MoveLeg>,
    ending: Vec<usize>,
    last: Option<Time>,
}

impl Legs {
    /// Begins a move of `motors` between two configurations (rad), with these speed limits (rad/s). It
    /// replaces earlier moves of these motors.
    pub fn begin(&mut self, motors: Vec<usize>, (from, to): (Vec<f64>, Vec<f64>), speeds: &[f64], board: &Board) {
        self.forget(&motors);
        let lag = board.latency.as_secs_f64() + BEHIND.0;
        let behind = speeds.iter().map(|speed| speed * lag + BEHIND.1).collect();
        let mut leg = MoveLeg { from, to, full: 0.0, ramp: 0.0, gone: 0.0, motors, behind };
        let ways = leg.from.iter().zip(&leg.to).map(|(from, to)| (to - from).abs());
        for ((way, speed), motor) in ways.zip(speeds).zip(&leg.motors) {
            let (speed, acceleration) =
                (PLANNED * speed.max(1e-6), board.axes.get(*motor).map_or(1.0, |axis| axis.max_acceleration));
            leg.full = leg.full.max(way / speed).max((way / acceleration.max(1e-6)).sqrt());
            leg.ramp = leg.ramp.max(speed / acceleration.max(1e-6));
        }
        // a short move has no phase at full speed
        leg.full = leg.full.max(1e-3);
        leg.ramp = leg.ramp.min(leg.full);
        if self.under_way.is_empty() {
            self.last = None;
        }
        self.under_way.push(leg);
    }

    /// Removes these motors from all moves, because other commands move them from now on.
    pub fn forget(&mut self, motors: &[usize]) {
        for leg in &mut self.under_way {
            let stays: Vec<bool> = leg.motors.iter().map(|m| !motors.contains(m)).collect();
            let remaining =
                |list: &[f64]| list.iter().zip(&stays).filter(|(_, stays)| **stays).map(|(v, _)| *v).collect();
            (leg.from, leg.to, leg.behind) = (remaining(&leg.from), remaining(&leg.to), remaining(&leg.behind));
            leg.motors.retain(|m| !motors.contains(m));
        }
        self.under_way.retain(|leg| !leg.motors.is_empty());
        self.ending.retain(|m| !motors.contains(m));
    }

    /// Stops these motors, or all if the list is empty. They return to position mode once they rest.
    pub fn stop(&mut self, motors: &[usize]) {
        let stopped: Vec<usize> = self.motors().filter(|m| motors.is_empty() || motors.contains(m)).collect();
        self.forget(&stopped);
        self.ending.extend(stopped);
    }

    /// Advances all moves for a reading `q` (rad) and returns the setpoints due, move by move.
    pub fn step(&mut self, now: Time, period: Duration, q: &[f64]) -> Vec<(Vec<usize>, Vec<f64>)> {
        let most = MAX_PERIODS * period.as_secs_f64();
        let gone = self.last.replace(now).map_or(0.0, |last| now.since(last).as_secs_f64().min(most));
        let mut due = Vec::new();
        for leg in &mut self.under_way {
            leg.gone += if leg.follows(q) { gone } else { 0.0 };
            due.push((leg.motors.clone(), leg.set_points()));
        }
        let over = |leg: &MoveLeg| leg.gone >= leg.full + leg.ramp;
        self.ending.extend(self.under_way.iter().filter(|leg| over(leg)).flat_map(|leg| leg.motors.iter().copied()));
        self.under_way.retain(|leg| !over(leg));
        due
    }

    /// Removes and returns the motors that have settled after their moves; only their mode remains to be
    /// switched.
    pub fn rested(&mut self, rests: impl Fn(usize) -> bool) -> Vec<usize> {
        let (over, ending) = self.ending.iter().partition(|m| rests(**m));
        self.ending = ending;
        over
    }

    /// True if a move of this motor has not ended yet.
    pub fn names(&self, motor: usize) -> bool {
        self.motors().any(|m| m == motor)
    }

    fn motors(&self) -> impl Iterator<Item = usize> + '_ {
        self.under_way.iter().flat_map(|leg| leg.motors.iter()).chain(&self.ending).copied()
    }

    /// True if there are no moves.
    pub fn is_empty(&self) -> bool {
        self.under_way.is_empty() && self.ending.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_contract::Axis;
    use proptest::prelude::*;

    const PERIOD: Duration = Duration::from_millis(20);

    fn board() -> Board {
        let axis = |name: &str| Axis {
            name: name.into(),
            min: -3.0,
            max: 3.0,
            max_speed: 1.0,
            max_acceleration: 4.0,
            ..Default::default()
        };
        let axes = vec![axis("a"), axis("b"), axis("c")];
        Board { axes, period: PERIOD, latency: Duration::from_millis(50), position_direct: true }
    }

    /// Setpoints of a move of two motors, one per reading, to its end.
    fn driven(legs: &mut Legs, ms: impl Fn(u64) -> u64) -> Vec<Vec<f64>> {
        let mut all = Vec::new();
        let mut here = vec![f64::NAN; 3];
        for k in 0..100_000 {
            let now = Time(ms(k) * 1_000_000);
            // the robot follows without delay
            let due = legs.step(now, PERIOD, &here);
            for (motors, q) in &due {
                motors.iter().zip(q).for_each(|(m, q)| here[*m] = *q);
            }
            if due.is_empty() {
                break;
            }
            all.extend(due.into_iter().map(|(_, q)| q));
        }
        all
    }

    proptest! {
        /// The setpoints lie on the straight line, in order, within the speed commanded and the motors'
        /// accelerations, and end exactly at the target.
        #[test]
        fn joints_keep_step_on_the_straight_line(
            from in prop::collection::vec(-2.0_f64..2.0, 2), to in prop::collection::vec(-2.0_f64..2.0, 2),
            speeds in prop::collection::vec(0.02_f64..1.0, 2),
        ) {
            let mut legs = Legs::default();
            legs.begin(vec![0, 2], (from.clone(), to.clone()), &speeds, &board());
            let q = driven(&mut legs, |k| 20 * k);
            prop_assert_eq!(q.first(), Some(&from));
            prop_assert_eq!(q.last(), Some(&to));
            let longest = if (to[0] - from[0]).abs() > (to[1] - from[1]).abs() { 0 } else { 1 };
            let share = |q: &[f64], m: usize| (q[m] - from[m]) / (to[m] - from[m]);
            let mut before = [0.0; 2];
            for pair in q.windows(2) {
                for m in 0..2 {
                    let v = (pair[1][m] - pair[0][m]) / 0.02;
                    prop_assert!(v.abs() <= speeds[m] * (1.0 + 1e-9), "{} of {}", v, speeds[m]);
                    prop_assert!((v - before[m]).abs() <= 4.0 * 0.02 * (1.0 + 1e-6) + 1e-9, "{} after {}", v, before[m]);
                    before[m] = v;
                    if (to[m] - from[m]).abs() > 1e-3 && (to[longest] - from[longest]).abs() > 1e-3 {
                        prop_assert!((share(&pair[1], m) - share(&pair[1], longest)).abs() < 1e-9);
                    }
                }
            }
        }
    }

    #[test]
    fn nothing_jumps_after_a_pause() {
        let mut legs = Legs::default();
        legs.begin(vec![1], (vec![0.0], vec![1.0]), &[0.5], &board());
        let q = driven(&mut legs, |k| if k < 50 { 20 * k } else { 20 * k + 3000 });
        let step = q.windows(2).map(|w| (w[1][0] - w[0][0]).abs()).fold(0.0, f64::max);
        assert!(step <= 0.5 * 0.02 + 1e-9, "{step}");
        assert_eq!(q.last(), Some(&vec![1.0]));
    }

    /// The setpoint leads a stuck joint by 0.5 rad/s times 0.15 s (latency and tolerance), plus half a degree.
    #[test]
    fn a_move_waits_for_a_joint_that_does_not_follow() {
        let mut legs = Legs::default();
        legs.begin(vec![1], (vec![0.0], vec![1.0]), &[0.5], &board());
        let last = (0..500).fold(0.0, |_, k| legs.step(Time(k * 20_000_000), PERIOD, &[0.0; 3])[0].1[0]);
        let most = 0.5 * 0.15 + 0.5_f64.to_radians();
        assert!((most..most + 0.0125).contains(&last), "{last}, {most}");
    }

    /// The move continues exactly up to this lag.
    #[test]
    fn a_move_goes_on_while_its_joints_are_just_near_enough() {
        let most = 0.5 * (0.05 + BEHIND.0) + BEHIND.1;
        for (behind, goes) in [(most, true), (most + 1e-9, false)] {
            let mut legs = Legs::default();
            legs.begin(vec![1], (vec![0.0], vec![1.0]), &[0.5], &board());
            let mut step = |ms: u64| legs.step(Time(ms * 1_000_000), PERIOD, &[0.0, -behind, 0.0])[0].1[0];
            assert_eq!((step(0), step(20) > 0.0), (0.0, goes));
        }
    }

    /// With 0.8 rad/s and 4 rad/s^2, a long move takes its distance at that speed and one ramp, a short move
    /// two ramps.
    #[test]
    fn a_move_takes_no_longer_than_its_speed_and_ramps_need() {
        for (way, secs) in [(1.0, 1.25 + 0.2), (0.04, 2.0 * 0.1)] {
            let mut legs = Legs::default();
            legs.begin(vec![1], (vec![0.0], vec![way]), &[1.0], &board());
            let took = 0.02 * driven(&mut legs, |k| 20 * k).len() as f64;
            assert!((secs..secs + 0.05).contains(&took), "{way}: {took}");
        }
    }

    #[test]
    fn a_motor_belongs_to_its_last_command() {
        let mut legs = Legs::default();
        legs.begin(vec![0, 1], (vec![0.0, 0.0], vec![1.0, 1.0]), &[0.5, 0.5], &board());
        legs.begin(vec![1], (vec![0.2], vec![0.0]), &[0.5], &board());
        assert_eq!(legs.step(Time::ZERO, PERIOD, &[0.0, 0.2, 0.0]), [(vec![0], vec![0.0]), (vec![1], vec![0.2])]);
        legs.stop(&[0]);
        assert!(legs.names(0) && legs.names(1));
        assert_eq!(legs.rested(|_| true), [0]);
        legs.forget(&[1]);
        assert!(legs.is_empty());
        // a motor that was stopped and is driven by another command has no mode to restore
        legs.begin(vec![2], (vec![0.0], vec![1.0]), &[0.5], &board());
        legs.stop(&[]);
        assert_eq!(legs.rested(|_| false), [0; 0]);
        legs.forget(&[2]);
        assert_eq!(legs.rested(|_| true), [0; 0]);
    }
}
