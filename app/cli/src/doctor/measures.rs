//! Derives properties of a board from the readings and commands of one motor: resolution, noise, sag, lag, *done* and
//! stop. No clock and no I/O.
//!
//! ```text
//! Record: orders (move, setpoint, stop) and readings (position, done, torque) ──figures──> Figures
//! ```
//! Times are seconds, positions degrees, or millimeters for prismatic joints.

use mobee_driver_yarp::Encoder;

/// Final part of an order's time in which the joint is taken to rest, s.
const REST_S: f64 = 0.4;
/// Minimum number of readings in that time.
const MIN_READINGS: usize = 5;
/// Maximum difference between the halves of a rest beyond the encoder's band, deg.
const MAX_DRIFT_DEG: f64 = 0.04;
/// Distance from its rest within which a joint has arrived, unless its encoder is coarser, deg.
const ARRIVED_DEG: f64 = 0.02;
/// Maximum lag, and the step of the search, s.
const MAX_LAG_AND_STEP_S: (f64, f64) = (0.6, 0.002);
/// Minimum duration of setpoints that show a lag, and the gap that ends a stream, s.
const STREAM_TIMES_S: (f64, f64) = (2.0, 0.3);
/// Minimum speed of setpoints that show a lag beside the encoder's counts, deg/s.
const MIN_SPEED_DEG_PER_S: f64 = 0.5;
/// Minimum motion in this time before a stop, deg and s.
const MIN_MOTION_DEG_S: (f64, f64) = (0.1, 0.1);
/// Time within its band after which a stopped joint rests, and time of its drift after that, s.
const STOP_TIMES_S: (f64, f64) = (0.2, 1.0);
/// Maximum distance from its target at the end, and minimum distance at the stop, of a joint that ran on to it, deg.
const RUN_ON_DEG: (f64, f64) = (0.5, 1.0);

/// A reading of the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    pub at: f64,
    pub q: f64,
    pub done: bool,
    /// External torque, N m or N, if the board reports any.
    pub torque: Option<f64>,
}

/// A command to the board for the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Order {
    /// A move, at a reference speed.
    Move { to: f64, speed: f64 },
    /// A setpoint of a stream.
    Point(f64),
    /// A stop.
    Stop,
}

/// All orders and readings, in their order.
#[derive(Clone, Debug, Default)]
pub(super) struct Record {
    pub readings: Vec<Reading>,
    pub orders: Vec<(f64, Order)>,
}

/// The properties of the board that a record shows.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Figures {
    /// One count of the encoder; 0 if none is visible.
    pub count: f64,
    /// Standard deviation of the noise at rest.
    pub noise: f64,
    /// Commanded minus measured position, one for each rest after a move.
    pub sags: Vec<f64>,
    /// Measured over commanded speed, one for each move.
    pub speeds: Vec<f64>,
    /// Delay of the joint behind its setpoints, s, and their speed.
    pub lag: Option<(f64, f64)>,
    /// *Done*, one for each move: time before the arrival, s, and distance from the rest.
    pub done: Vec<(f64, f64)>,
    /// The first stop during a motion.
    pub stop: Option<StopFigures>,
    /// Greatest external torque that the board reported, and its greatest change from the rest before, N m or N.
    pub torque: Option<(f64, f64)>,
}

/// A stop during a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StopFigures {
    /// Speed at the stop.
    pub speed: f64,
    /// Distance that the joint went on until it rested, negative if it came back.
    pub on: f64,
    /// Time until it rested, s; `None` if it did not.
    pub took: Option<f64>,
    /// Motion in the second after.
    pub drift: f64,
    /// The end of the motion.
    pub end: StopEnd,
}

/// The end of a stopped joint's motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum StopEnd {
    /// It rests where it was stopped, or at the end of its braking.
    Stays,
    /// It went on to its target.
    RunsOn,
    /// It goes on moving after it was stopped.
    Sinks,
}

impl Record {
    /// Computes the properties.
    pub fn figures(&self) -> Figures {
        let encoder = self.encoder();
        let band = (1.5 * encoder.count()).max(4.0 * encoder.noise()).max(ARRIVED_DEG);
        let mut figures =
            Figures { count: encoder.count(), noise: encoder.noise(), lag: self.lag(), ..Figures::default() };
        let mut torque = None::<f64>;
        let mut change = 0.0_f64;
        for span in self.spans() {
            let Order::Move { to, speed } = span.order else { continue };
            let Some(rest) = span.rest(band) else { continue };
            figures.sags.push(to - rest);
            figures.speeds.extend(span.speed(rest).filter(|_| speed > 0.0).map(|seen| seen / speed));
            figures.done.extend(span.done(rest, band));
            let before = span.before.and_then(|reading| reading.torque).unwrap_or_default();
            for seen in span.readings.iter().filter_map(|reading| reading.torque) {
                torque = Some(torque.unwrap_or_default().max(seen.abs()));
                change = change.max((seen - before).abs());
            }
        }
        figures.torque = torque.map(|torque| (torque, change));
        figures.stop = self.stop(band);
        figures
    }

    /// Each order with the readings until the next one.
    fn spans(&self) -> impl Iterator<Item = Span<'_>> {
        self.orders.iter().enumerate().map(|(i, (at, order))| {
            let until = self.orders.get(i + 1).map_or(f64::INFINITY, |(next, _)| *next);
            let from = self.since(*at);
            let to = self.since(until);
            let readings = self.readings.get(from..to).unwrap_or_default();
            let before = from.checked_sub(1).and_then(|last| self.readings.get(last));
            Span { at: *at, order: *order, before, readings }
        })
    }

    /// Index of the first reading that is not older than `at`.
    fn since(&self, at: f64) -> usize {
        self.readings.partition_point(|reading| reading.at < at)
    }

    fn encoder(&self) -> Encoder {
        let mut encoder = Encoder::default();
        for span in self.spans() {
            let rests = span.rest(f64::INFINITY).is_some();
            let resting = span.readings.last().map_or(f64::INFINITY, |last| last.at - REST_S);
            for reading in span.readings {
                encoder.read(reading.q, rests && reading.at > resting);
            }
        }
        encoder
    }

    /// The delay of the readings behind the longest stream of setpoints, and the stream's speed. At this delay the
    /// variance of their difference is minimal; a constant sag does not count.
    fn lag(&self) -> Option<(f64, f64)> {
        let points: Vec<(f64, f64)> = self
            .orders
            .iter()
            .filter_map(|(at, order)| if let Order::Point(q) = order { Some((*at, *q)) } else { None })
            .collect();
        let streams = points.chunk_by(|(at, _), (next, _)| next - at <= STREAM_TIMES_S.1);
        let lasts = |stream: &[(f64, f64)]| stream.last().map_or(0.0, |l| l.0) - stream.first().map_or(0.0, |f| f.0);
        let points = streams.max_by(|a, b| lasts(a).total_cmp(&lasts(b)))?;
        let ((begin, _), (end, _)) = (*points.first()?, *points.last()?);
        if end - begin < STREAM_TIMES_S.0 {
            return None;
        }
        let readings = self.readings.get(self.since(begin + MAX_LAG_AND_STEP_S.0)..self.since(end)).unwrap_or_default();
        let spread = |lag: f64| {
            let off: Vec<f64> = readings.iter().filter_map(|r| Some(commanded(points, r.at - lag)? - r.q)).collect();
            let mean = mean(&off);
            off.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / off.len().max(1) as f64
        };
        let lags =
            (0..=(MAX_LAG_AND_STEP_S.0 / MAX_LAG_AND_STEP_S.1) as u32).map(|i| f64::from(i) * MAX_LAG_AND_STEP_S.1);
        let lag = lags.map(|lag| (lag, spread(lag))).min_by(|a, b| a.1.total_cmp(&b.1))?.0;
        let steps = points.windows(2).filter_map(|pair| match pair {
            [(a, p), (b, q)] if b > a => Some((q - p).abs()),
            _ => None,
        });
        let speed = steps.sum::<f64>() / (end - begin);
        Some((lag, speed)).filter(|_| readings.len() >= MIN_READINGS && speed >= MIN_SPEED_DEG_PER_S)
    }

    /// The first stop of a joint that moved.
    fn stop(&self, band: f64) -> Option<StopFigures> {
        let stops = self.orders.iter().enumerate().filter(|(_, (_, order))| *order == Order::Stop);
        stops.filter_map(|(i, (at, _))| self.stopped(i, *at, band)).next()
    }

    /// The motion of the joint after order `i`, a stop at this time.
    fn stopped(&self, i: usize, at: f64, band: f64) -> Option<StopFigures> {
        let target = self.orders.get(..i)?.iter().rev().find_map(|(_, order)| match order {
            Order::Move { to, .. } => Some(*to),
            Order::Point(_) | Order::Stop => None,
        })?;
        let last = self.readings.get(self.since(at).checked_sub(1)?)?;
        let earlier = self.readings.get(self.since(last.at - MIN_MOTION_DEG_S.1))?;
        let gone = last.q - earlier.q;
        if gone.abs() < MIN_MOTION_DEG_S.0 {
            return None;
        }
        // the stop may be repeated
        let next = self.orders.get(i + 1..)?.iter().find(|(_, order)| *order != Order::Stop);
        let until = next.map_or(f64::INFINITY, |(next, _)| *next);
        let after = self.readings.get(self.since(at)..self.since(until)).unwrap_or_default();
        let stays = |from: usize| {
            let first = after.get(from)?;
            let stretch = || after.iter().skip(from).take_while(|r| r.at <= first.at + STOP_TIMES_S.0);
            let full = after.last().is_some_and(|last| last.at >= first.at + STOP_TIMES_S.0);
            (full && stretch().all(|r| (r.q - first.q).abs() <= band)).then_some(*first)
        };
        let rest = (0..after.len()).find_map(stays);
        let from = rest.map_or_else(|| after.last().map_or(0.0, |r| r.at - STOP_TIMES_S.1), |r| r.at);
        let near = |at: f64| {
            let around: Vec<f64> = after.iter().filter(|r| (r.at - at).abs() <= 0.05).map(|r| r.q).collect();
            (!around.is_empty()).then(|| mean(&around))
        };
        let end = near(from + STOP_TIMES_S.1).or_else(|| after.last().map(|r| r.q))?;
        // earlier readings are of the braking joint
        let drift = end - near(from + 0.05)?;
        let way = gone.signum();
        let left = |q: f64| (target - q) * way;
        let end_of = if left(last.q) > RUN_ON_DEG.1 && left(end).abs() < RUN_ON_DEG.0 {
            StopEnd::RunsOn
        } else if rest.is_none() || drift.abs() > 2.0 * band + MAX_DRIFT_DEG {
            StopEnd::Sinks
        } else {
            StopEnd::Stays
        };
        Some(StopFigures {
            speed: (gone / (last.at - earlier.at).max(1e-3)).abs(),
            on: way * (rest.map_or(end, |rest| rest.q) - last.q),
            took: rest.map(|rest| rest.at - at),
            drift,
            end: end_of,
        })
    }
}

/// An order, and the readings until the next one.
struct Span<'a> {
    at: f64,
    order: Order,
    before: Option<&'a Reading>,
    readings: &'a [Reading],
}

impl Span<'_> {
    /// The position at the end of the order's time; `None` if the joint does not rest within this band.
    fn rest(&self, band: f64) -> Option<f64> {
        let last = self.readings.last()?;
        let resting: Vec<&Reading> = self.readings.iter().filter(|r| r.at > last.at - REST_S).collect();
        // a reading from before the next order may be fetched after it, and is not done then
        let done = 2 * resting.iter().filter(|r| r.done).count() > resting.len();
        if last.at - self.at < 2.0 * REST_S || !done {
            return None;
        }
        let resting: Vec<f64> = resting.into_iter().map(|r| r.q).collect();
        let (first, second) = resting.split_at(resting.len() / 2);
        let still = (mean(first) - mean(second)).abs() <= band.min(1.0) + MAX_DRIFT_DEG;
        (resting.len() >= MIN_READINGS && still).then(|| mean(&resting))
    }

    /// Speed between 10 % and 90 % of the distance.
    fn speed(&self, rest: f64) -> Option<f64> {
        let from = self.before?.q;
        let way = rest - from;
        let passed = |share: f64| {
            let beyond = |r: &Reading| (r.q - from) / way >= share;
            let (i, after) = self.readings.iter().enumerate().find(|(_, r)| beyond(r))?;
            let before = i.checked_sub(1).and_then(|i| self.readings.get(i))?;
            let part = (share * way + from - before.q) / (after.q - before.q);
            Some(before.at + part.clamp(0.0, 1.0) * (after.at - before.at))
        };
        let took = passed(0.9)? - passed(0.1)?;
        (self.is_long(rest) && took > 0.0).then(|| 0.8 * way.abs() / took)
    }

    /// True for a move of its own, not a correction of the previous one.
    fn is_long(&self, rest: f64) -> bool {
        self.before.is_some_and(|before| (rest - before.q).abs() > 1.0)
    }

    /// Time from *done* until the joint had arrived, s (negative: after it), and its distance from the rest at *done*.
    fn done(&self, rest: f64, band: f64) -> Option<(f64, f64)> {
        let moving = self.readings.iter().position(|r| !r.done).filter(|_| self.is_long(rest))?;
        let done = self.readings.iter().skip(moving).find(|r| r.done)?;
        let away = self.readings.iter().rposition(|r| (r.q - rest).abs() > band)?;
        let arrived = self.readings.get(away + 1)?;
        Some((arrived.at - done.at, (done.q - rest).abs()))
    }
}

/// The commanded position at this time, interpolated between the setpoints.
fn commanded(points: &[(f64, f64)], at: f64) -> Option<f64> {
    let next = points.partition_point(|(t, _)| *t <= at);
    let (t0, q0) = *points.get(next.checked_sub(1)?)?;
    let (t1, q1) = *points.get(next).unwrap_or(&(t0, q0));
    Some(if t1 > t0 { q0 + (q1 - q0) * ((at - t0) / (t1 - t0)).clamp(0.0, 1.0) } else { q0 })
}

fn mean(all: &[f64]) -> f64 {
    all.iter().sum::<f64>() / all.len().max(1) as f64
}

#[cfg(test)]
mod tests;
