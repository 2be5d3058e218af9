//! Time at which a state was read, estimated from the board's stamp and the time of its arrival.
//!
//! Arrivals jitter and stamps do not, but the board's clock differs from ours. The shortest transit time seen
//! so far gives the offset of the two clocks. A state with a much longer transit time is late, as after a
//! stall of a machine or of the network, and is as old as its stamp indicates. If states stay late, the
//! offset is no longer valid: a clock was set, or runs at another rate, as a simulator's does.
//!
//! A steady delay of the states looks like an offset. The stamps of the board's answers distinguish the two:
//! an answer is stamped after its request went out and before it arrived, so the lead of our clock over the
//! board's is at most the time from stamp to arrival.

use mobee_yarp::Stamp;

/// Delay beyond which a state is late, s.
const LATE_AFTER_S: f64 = 0.030;
/// Time for which states may be late before the offset is estimated again, s.
const LATE_FOR: f64 = 0.100;
/// Longest plausible transit time of a state, s. Beyond it, a clock was set.
const MAX_TRANSIT_S: f64 = 1.0;
/// Difference between the stamps of answers and states beyond which they come from two clocks, s: no network
/// delays a state that long.
const TWO_CLOCKS: f64 = 10.0;
/// Number of states in a row with the same time after which the clock of the board counts as stopped.
const STANDS: u32 = 25;
/// Least time between two readings, s.
const LEAST: f64 = 1e-4;
/// Number of states after which the shortest transit time is searched again, to follow a slowly drifting
/// clock.
const WINDOW: u32 = 500;

/// Clock of one board, estimated from its states. Times in seconds on our own monotonic clock.
#[derive(Clone, Debug, Default)]
pub struct Arrivals {
    offset: Option<f64>,
    /// Shortest transit time within the present window.
    shortest: Option<f64>,
    seen: u32,
    /// Arrival of the first state of the present run of late ones, and the shortest transit time among them.
    late: Option<(f64, f64)>,
    last: Option<f64>,
    /// Newest stamp.
    stamp: Option<Stamp>,
    /// True once two consecutive stamps had different times; then the number in a row that had not.
    ticks: bool,
    stood: u32,
}

impl Arrivals {
    /// Same as [`Arrivals::read_at`] for the board's whole stamp. Some boards count their states but give no
    /// time, or always the same; then the arrival counts.
    pub fn state_at(&mut self, arrival: f64, stamp: Option<Stamp>, ahead: Option<f64>) -> Option<f64> {
        let before = std::mem::replace(&mut self.stamp, stamp);
        let Some((before, now)) = before.zip(stamp) else {
            return self.read_at(arrival, stamp.map(|s| s.time), ahead);
        };
        let stands = before.time == now.time && before.count != now.count;
        (self.stood, self.ticks) = if stands { (self.stood + 1, self.ticks) } else { (0, true) };
        // the same reading, published again by a board that reads less often than it publishes
        if stands && self.ticks && self.stood < STANDS {
            return None;
        }
        self.read_at(arrival, Some(now.time).filter(|_| !stands), ahead)
    }

    /// Time at which the state that arrived at `arrival` with this stamp was read, never after its arrival.
    /// `None` if that is not later than the one before: the state was overtaken and is obsolete. `ahead` is
    /// the greatest possible lead of our clock over the board's, if its answers give one.
    fn read_at(&mut self, arrival: f64, stamp: Option<f64>, ahead: Option<f64>) -> Option<f64> {
        let at = match stamp.filter(|s| s.is_finite()) {
            Some(stamp) => {
                let by_stamp = self.stamped(arrival, stamp);
                // the jitter of answers does not affect the times of punctual states
                let latest =
                    ahead.map(|ahead| stamp + ahead + LATE_AFTER_S).filter(|latest| arrival - latest < TWO_CLOCKS);
                by_stamp.min(latest.unwrap_or(f64::INFINITY))
            }
            None => arrival,
        };
        let at = at.min(arrival);
        let is_news = self.last.is_none_or(|last| at >= last + LEAST);
        self.last = if is_news { Some(at) } else { self.last };
        is_news.then_some(at)
    }

    fn stamped(&mut self, arrival: f64, stamp: f64) -> f64 {
        let way = arrival - stamp;
        self.shortest = Some(self.shortest.map_or(way, |s| s.min(way)));
        self.seen += 1;
        let delay = self.offset.map_or(f64::NAN, |offset| way - offset);
        let (since, least) = self.late.map_or((arrival, way), |(since, least)| (since, least.min(way)));
        self.late = (delay > LATE_AFTER_S).then_some((since, least));
        let offset = match self.offset {
            Some(offset) if delay <= LATE_AFTER_S || (delay <= MAX_TRANSIT_S && arrival - since <= LATE_FOR) => {
                offset.min(way)
            }
            _ => {
                (self.shortest, self.seen, self.late) = (Some(least), 0, None);
                least
            }
        };
        self.offset = Some(offset);
        if self.seen >= WINDOW {
            (self.offset, self.shortest, self.seen) = (self.shortest, None, 0);
        }
        stamp + offset
    }

    /// Discards the clock estimate, because the board now has another clock.
    pub fn reset(&mut self) {
        *self = Arrivals { last: self.last, ..Arrivals::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jitter_of_arrivals_is_taken_out() {
        let mut arrivals = Arrivals::default();
        let jitter = [0.002, 0.0, 0.008, 0.001, 0.004, 0.0, 0.009, 0.003];
        let mut read = Vec::new();
        for i in 0..80 {
            let t = 0.02 * f64::from(i);
            read.extend(arrivals.read_at(100.0 + t + jitter[i as usize % 8], Some(1.79e9 + t), None));
        }
        for pair in read[8..].windows(2) {
            assert!((pair[1] - pair[0] - 0.02).abs() < 1e-4, "{pair:?}");
        }
    }

    #[test]
    fn a_state_is_never_older_than_the_bound_nor_newer_than_its_arrival() {
        let mut arrivals = Arrivals::default();
        let mut last = f64::NEG_INFINITY;
        // a simulator at half speed, then a clock that was set forward, then none
        for i in 0..400 {
            let t = 0.02 * f64::from(i);
            let stamp = match i {
                0..200 => Some(0.5 * t),
                200..300 => Some(1e6 + t),
                _ => None,
            };
            let at = arrivals.read_at(t, stamp, None).unwrap();
            let oldest = LATE_AFTER_S + LATE_FOR + 0.02;
            assert!(at > last && at <= t && t - at <= oldest, "{i}: {at} of {t}");
            last = at;
        }
        assert!((last - 0.02 * 399.0).abs() < 1e-9);
    }

    #[test]
    fn states_delayed_by_a_stall_are_as_old_as_their_stamps() {
        let mut arrivals = Arrivals::default();
        for i in 0..200 {
            let t = 0.02 * f64::from(i);
            // from 2 s on nothing arrives for 0.4 s, then all states at once
            let arrival = if (2.0..2.4).contains(&t) { 2.4 } else { t };
            let at = arrivals.read_at(arrival, Some(1.79e9 + t), None).unwrap();
            assert!((at - t).abs() < 1e-5, "{i}: {at} of {t}");
        }
        // a permanently longer transit time becomes an offset
        let longer = |i: u32| {
            let t = 0.02 * f64::from(i);
            t - arrivals.read_at(t, Some(1.79e9 + t - 0.1), None).unwrap_or(f64::NAN)
        };
        let ages: Vec<f64> = (200..220).map(longer).collect();
        assert!((0.09..0.11).contains(&ages[5]) && ages[6..].iter().all(|a| *a < 1e-5), "{ages:?}");
    }

    #[test]
    fn a_steady_delay_is_no_offset_if_answers_give_the_clock() {
        // the board's clock is an hour behind ours, or far ahead; its answers take 5 ms, its states 0.9 s from
        // some time on
        for offset in [3600.0, -1.79e9, 0.0] {
            let mut arrivals = Arrivals::default();
            for i in 0..300 {
                let t = 0.02 * f64::from(i);
                let late = if i < 100 { 0.002 } else { 0.9 };
                let Some(at) = arrivals.read_at(t + late, Some(t - offset), Some(offset + 0.005)) else { continue };
                assert!(
                    (t + late - at) >= late - LATE_AFTER_S - 0.006 && at <= t + late + 1e-6,
                    "{offset} {i}: {at} of {t}"
                );
            }
        }
        // answers with the stamps of another clock than the states' are ignored
        let mut arrivals = Arrivals::default();
        assert_eq!(arrivals.read_at(1.0, Some(1.0), Some(-1e9)), Some(1.0));
    }

    #[test]
    fn a_clock_at_half_speed_is_followed_if_answers_give_it() {
        let mut arrivals = Arrivals::default();
        let mut ahead = 0.0;
        for i in 0..1000 {
            let t = 0.02 * f64::from(i);
            // the board is queried every 100 ms
            if i % 5 == 0 {
                ahead = t - 0.5 * t + 0.001;
            }
            let Some(at) = arrivals.read_at(t, Some(0.5 * t), Some(ahead)) else { continue };
            assert!(t - at < LATE_AFTER_S + LATE_FOR + 0.02, "{i}: {at} of {t}");
        }
    }

    #[test]
    fn a_stopped_clock_is_ignored() {
        for time in [0.0, 1.79e9] {
            let mut arrivals = Arrivals::default();
            for count in 0..300 {
                let t = 0.01 * f64::from(count);
                let at = arrivals.state_at(t, Some(Stamp { count, time }), Some(-1.79e9)).unwrap_or(f64::NAN);
                assert!((t - at).abs() < 1e-9, "{time} {count}: {at} of {t}");
            }
        }
        // a repeated reading is not new, and a clock that stops later is noticed
        let mut arrivals = Arrivals::default();
        let read: Vec<bool> = (0..100)
            .map(|count| {
                let t = 0.01 * f64::from(count);
                let time = 7.0 + 0.03 * f64::from(count.min(60) / 3);
                arrivals.state_at(t, Some(Stamp { count, time }), None).is_some()
            })
            .collect();
        assert!(read[3..60].chunks(3).all(|of| of.iter().filter(|news| **news).count() == 1), "{read:?}");
        let stands = 60 + STANDS as usize;
        assert!(!read[61..stands].contains(&true) && !read[stands..].contains(&false), "{read:?}");
        // a duplicate is not new
        let mut arrivals = Arrivals::default();
        let stamp = |count: u32| Some(Stamp { count, time: 7.0 + 0.01 * f64::from(count) });
        let read =
            [(0, 0.0), (1, 0.01), (1, 0.012), (2, 0.02)].map(|(n, t)| arrivals.state_at(t, stamp(n), None).is_some());
        assert_eq!(read, [true, true, false, true]);
    }

    #[test]
    fn a_slow_drift_is_followed() {
        // a fast clock shortens the apparent transit time; for a slow clock the shortest transit time is
        // searched again every 10 s
        for rate in [1.0001, 0.9999] {
            let mut arrivals = Arrivals::default();
            let mut late = 0.0f64;
            for i in 0..5000 {
                let t = 0.02 * f64::from(i);
                late = late.max(t - arrivals.read_at(t, Some(rate * t), None).unwrap());
            }
            assert!((0.0..0.0025).contains(&late), "{rate}: {late}");
        }
    }

    /// Limits: the delay at which a state is late, and the difference beyond which two clocks are assumed.
    #[test]
    fn what_is_just_in_time_is_not_late() {
        let mut arrivals = Arrivals::default();
        assert_eq!(arrivals.read_at(0.0, Some(0.0), None), Some(0.0));
        arrivals.read_at(LATE_AFTER_S, Some(0.0), None);
        let at = arrivals.read_at(0.14, Some(0.09), None);
        assert_eq!(at, Some(0.09), "the first that is late: there was none 0.1 s before");
        // stamps of answers and states that differ by 10 s come from two clocks
        let read = |arrival: f64| Arrivals::default().read_at(arrival, Some(-LATE_AFTER_S), Some(0.0));
        assert_eq!([9.5, TWO_CLOCKS].map(read), [Some(0.0), Some(TWO_CLOCKS)]);
    }

    /// The clock of a new connection is a different one and is trusted at once; the reading times still
    /// increase.
    #[test]
    fn a_new_connection_has_a_clock_of_its_own() {
        let mut arrivals = Arrivals::default();
        (0..100).for_each(|i| _ = arrivals.read_at(0.02 * f64::from(i), Some(7.0 + 0.02 * f64::from(i)), None));
        arrivals.reset();
        assert_eq!(arrivals.read_at(3.0, Some(9.5), None), Some(3.0), "half a second behind the clock of before");
        arrivals.reset();
        assert_eq!(arrivals.read_at(3.0, Some(1.0), None), None, "a state was read then already");
    }

    #[test]
    fn a_state_that_was_overtaken_is_no_news() {
        let mut arrivals = Arrivals::default();
        let read: Vec<bool> = [0, 1, 3, 2, 4]
            .map(|i| {
                let stamp = 7.0 + 0.02 * f64::from(i);
                arrivals.read_at(stamp.max(7.06), Some(stamp), Some(0.001)).is_some()
            })
            .into();
        assert_eq!(read, [true, true, true, false, true]);
    }
}
