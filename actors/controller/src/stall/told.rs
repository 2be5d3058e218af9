//! What one motor was told, and how far it lags behind a motor that does at least half of it.

use crate::Rules;
use mobee_contract::{Axis, Move, Time};
use std::collections::VecDeque;

/// The share of its speed at which a motor's ghost goes.
const SHARE: f64 = 0.5;
/// Over how long a speed is averaged, seconds: a motor that stalls is slower in the next readings, and its ghost must not be at once; and
/// the noise of slow motors must not make their ghosts fast.
const FADES: f64 = 0.3;
/// From which speed on a motor is fast, in speeds that count as rest: its speed is known at once, beside the noise.
const FAST: f64 = 10.0;
/// The same for the greatest speed of a stream.
const FADES_IN_STREAMS: f64 = 1.0;
/// What a motor has done of the way that it should have gone, at the least: a board may keep its references less well.
const QUARTER: f64 = 4.0;
/// How far a motor may lag behind a stream that it follows freely, in squares of the stream's speed by its acceleration: one and a
/// half where the stream turns round, less where it sets out.
const CATCHES_UP: f64 = 1.5;
/// How long boards go on at a velocity that is not given again.
const WATCHDOG: std::time::Duration = std::time::Duration::from_millis(100);
/// How many set-points are remembered: more than can be on their way.
const SET_POINTS: usize = 256;

/// A motor at a reading.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// When it was read.
    pub at: Time,
    /// Where it is, rad.
    pub q: f64,
    /// How far it came since the reading before, rad.
    pub by: f64,
    /// How fast it is, as the last readings show it, rad/s.
    pub speed: f64,
    /// The time since the reading before, seconds.
    pub dt: f64,
    /// What counts as no lag, rad.
    pub noise: f64,
}

/// What a motor was told, and how it follows.
#[derive(Clone, Debug)]
pub(super) struct Errand {
    /// What.
    pub way: Way,
    /// Where it set out, rad.
    pub from: f64,
    /// How far its ghost is ahead, rad.
    lag: f64,
    /// The greatest lag in this motion, rad.
    pub most: f64,
    /// For how many readings it has been beyond the threshold.
    pub beyond: u32,
}

impl Errand {
    /// Of a motor that is at `from`, rad.
    pub fn new(way: Way, from: f64) -> Errand {
        Errand { way, from, lag: 0.0, most: 0.0, beyond: 0 }
    }

    /// Nobody knows what the motor did until now: it is at `q`, rad.
    pub fn begin_anew(&mut self, q: f64) {
        (self.lag, self.beyond) = (0.0, 0);
        match &mut self.way {
            // whether it has set out is not asked again
            Way::Move(way) => (way.rate, way.secs) = (0.0, f64::INFINITY),
            Way::Positions(stream) => stream.value = q,
            Way::Velocities(_) => {}
        }
    }

    /// How far the motor lags at this reading, rad; zero for one that follows.
    pub fn lag(&mut self, moment: &Moment, axis: &Axis, rules: &Rules) -> f64 {
        let lag = &mut self.lag;
        let by = match &mut self.way {
            Way::Move(way) => way.lag(lag, moment, rules),
            Way::Positions(stream) => stream.behind_positions(lag, moment, axis, rules),
            Way::Velocities(stream) => stream.behind_velocities(lag, moment, axis, rules),
        };
        self.most = self.most.max(by);
        by
    }
}

/// What a motor was told.
#[derive(Clone, Debug)]
pub(super) enum Way {
    /// To go to a position, as its board sees fit.
    Move(Journey),
    /// To be at positions, one after another.
    Positions(Stream),
    /// To go at velocities.
    Velocities(Stream),
}

impl Way {
    /// One motor's part in a move, of a motor that is at `from` (rad, rad/s).
    pub fn to(course: &Move, i: usize, (from, speed): (f64, f64), now: Time, rules: &Rules) -> Option<Way> {
        let axis = rules.axes.get(*course.motors.get(i)?)?;
        let to = *course.q.get(i)? + if course.relative { from } else { 0.0 };
        let given =
            |list: &Option<Vec<f64>>, most: f64| list.as_ref().and_then(|v| v.get(i)).map_or(most, |v| v.min(most));
        let (fastest, most) =
            (given(&course.speed, axis.max_speed), given(&course.acceleration, axis.max_acceleration));
        // who goes the other way comes to rest first
        let away = speed * (to - from) < 0.0;
        let brakes = axis.max_acceleration.max(1e-6);
        let (from, turns) =
            if away { (from + speed * speed.abs() / brakes, 2.0 * speed.abs() / brakes) } else { (from, 0.0) };
        let way = (to - from).abs();
        // a minimum-jerk trajectory (Flash and Hogan, 1985): boards that know others are faster
        let secs = (1.875 * way / fastest.max(1e-9)).max((5.774 * way / most.max(1e-9)).sqrt()).max(1e-3);
        let shows = now + rules.reaction() + std::time::Duration::from_secs_f64(turns.min(10.0));
        Some(Way::Move(Journey { from, to, shows, secs, speed: fastest, rate: 0.0 }))
    }

    /// A stream of set-points for a motor that is at `q`, rad: of positions, or of velocities.
    pub fn stream(positions: bool, q: f64) -> Way {
        let new = |value: f64| Stream { points: VecDeque::new(), value, direction: 0.0, speed: 0.0 };
        if positions { Way::Positions(new(q)) } else { Way::Velocities(new(0.0)) }
    }

    /// Whether it is a stream, of positions or of velocities.
    pub fn is_stream_of(&self, positions: bool) -> bool {
        match self {
            Way::Move(_) => false,
            Way::Positions(_) => positions,
            Way::Velocities(_) => !positions,
        }
    }

    /// The stream's next set-point.
    pub fn goes_on(&mut self, value: f64, now: Time) {
        if let Way::Positions(stream) | Way::Velocities(stream) = self {
            if stream.points.len() >= SET_POINTS {
                stream.points.pop_front();
            }
            stream.points.push_back((now, value));
        }
    }

    /// The direction in which it leads now: 1 or -1.
    pub fn direction(&self) -> f64 {
        match self {
            Way::Move(way) => (way.to - way.from).signum(),
            Way::Positions(stream) | Way::Velocities(stream) => stream.direction,
        }
    }
}

/// A move of one motor.
#[derive(Clone, Debug)]
pub(super) struct Journey {
    /// From where, rad.
    from: f64,
    /// To where, rad.
    to: f64,
    /// When it shows in the readings at the latest.
    shows: Time,
    /// How long it should take, seconds.
    secs: f64,
    /// The speed that it was told, rad/s.
    speed: f64,
    /// The ghost's speed as a share of what it has left, 1/s.
    rate: f64,
}

impl Journey {
    fn lag(&mut self, lag: &mut f64, moment: &Moment, rules: &Rules) -> f64 {
        let direction = (self.to - self.from).signum();
        let (left, by) = ((self.to - moment.q) * direction, moment.by * direction);
        if moment.at < self.shows || left <= 0.0 {
            *lag = 0.0;
            return 0.0;
        }
        // of a motor that follows, the ghost takes on the speed; of one that lags no more
        if *lag <= moment.noise {
            let speed = (moment.speed * direction).min(self.speed);
            let rate = if speed > rules.rest_speed { SHARE * speed / left.max(moment.noise) } else { 0.0 };
            let kept = (-moment.dt / FADES).exp();
            let is_fast = speed > FAST * rules.rest_speed;
            self.rate = if is_fast { rate.max(self.rate * kept) } else { rate + (self.rate - rate) * kept };
        }
        let ahead = (left + by - *lag).max(0.0) * (1.0 - (-self.rate * moment.dt).exp());
        *lag = (*lag + ahead - by).clamp(0.0, left);
        // one that never set out has no speed to be measured by
        let part = (moment.at.since(self.shows).as_secs_f64() / self.secs).min(1.0);
        let should = (self.to - self.from).abs() * part.powi(3) * (10.0 - 15.0 * part + 6.0 * part * part);
        let did = ((moment.q - self.from) * direction).max(0.0);
        lag.max((should - QUARTER * did).min(left))
    }
}

/// Set-points that go on.
#[derive(Clone, Debug)]
pub(super) struct Stream {
    /// When each was written; the first is in force in the readings.
    points: VecDeque<(Time, f64)>,
    /// What was in force at the last reading.
    value: f64,
    /// Where it leads: 1, -1, or zero before anybody knows.
    direction: f64,
    /// Its greatest speed of late, rad/s.
    speed: f64,
}

impl Stream {
    /// What is in force in readings of this time; forgets what was before.
    fn in_force(&mut self, at: Time) -> Option<f64> {
        while self.points.get(1).is_some_and(|(since, _)| *since <= at) {
            self.points.pop_front();
        }
        self.points.front().filter(|(since, _)| *since <= at).map(|(_, value)| *value)
    }

    /// How far a motor may be behind that catches up as fast as it can, rad.
    fn allows(&self, axis: &Axis) -> f64 {
        CATCHES_UP * self.speed * self.speed / axis.max_acceleration.max(1e-6)
    }

    fn turns(&mut self, direction: f64, lag: &mut f64) {
        if self.direction != direction {
            (self.direction, *lag) = (direction, 0.0);
        }
    }

    fn behind_positions(&mut self, lag: &mut f64, moment: &Moment, axis: &Axis, rules: &Rules) -> f64 {
        let pace = |(a, b): (&(Time, f64), &(Time, f64))| (b.1 - a.1).abs() / b.0.since(a.0).as_secs_f64().max(1e-3);
        let fastest = self.points.iter().zip(self.points.iter().skip(1)).map(pace).fold(0.0, f64::max);
        self.speed = fastest.min(axis.max_speed).max(self.speed * (-moment.dt / FADES_IN_STREAMS).exp());
        let Some(value) = self.in_force(moment.at - rules.reaction()) else { return 0.0 };
        let by = value - std::mem::replace(&mut self.value, value);
        if by != 0.0 {
            self.turns(by.signum(), lag);
        }
        *lag = (*lag + SHARE * by.abs() - moment.by * self.direction).max(0.0);
        // never more than what is left to the set-point
        *lag = lag.min(((value - moment.q) * self.direction).max(0.0));
        *lag - self.allows(axis)
    }

    fn behind_velocities(&mut self, lag: &mut f64, moment: &Moment, axis: &Axis, rules: &Rules) -> f64 {
        self.speed *= (-moment.dt / FADES_IN_STREAMS).exp();
        self.speed = self.points.iter().map(|(_, v)| v.abs()).fold(self.speed, f64::max);
        let Some(value) = self.in_force(moment.at - rules.reaction()) else { return 0.0 };
        let direction = value.signum();
        // the slowest that may be in force by now; none if the board has ceased to believe in it
        let slowest = self.points.iter().map(|(_, v)| v * direction).fold(f64::INFINITY, f64::min);
        let old = self.points.back().is_none_or(|(since, _)| moment.at > *since + WATCHDOG);
        // before a limit a board brakes by itself
        let room = if direction > 0.0 { axis.max - moment.q } else { moment.q - axis.min };
        let reaction = rules.reaction().as_secs_f64();
        let needs = self.speed * reaction + 0.5 * self.speed * self.speed / axis.max_acceleration.max(1e-6);
        self.turns(direction, lag);
        if value == 0.0 || slowest <= 0.0 || old || room <= needs + rules.tolerance {
            *lag = 0.0;
            return 0.0;
        }
        *lag = (*lag + SHARE * slowest * moment.dt - moment.by * direction).max(0.0);
        *lag - self.allows(axis)
    }
}
