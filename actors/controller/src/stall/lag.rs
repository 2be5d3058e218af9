//! Lag of one motor behind its command, compared with a motor that follows at half the speed at least.

use crate::Rules;
use mobee_contract::{Axis, Move, Time};
use std::collections::VecDeque;

/// Speed of a ghost, as a share of its motor's speed.
const GHOST_SPEED_SHARE: f64 = 0.5;
/// Time constant of the averaged speed, seconds. A stalling motor slows down in the next readings, and its ghost must
/// not do so at once; and the noise of slow motors must not make their ghosts fast.
const SPEED_DECAY: f64 = 0.3;
/// Least speed of a fast motor, in rest speeds: its speed is known at once, since noise is small beside it.
const FAST_RATIO: f64 = 10.0;
/// Time constant of the greatest speed of a stream, seconds.
const STREAM_SPEED_DECAY: f64 = 1.0;
/// Greatest ratio of the expected to the actual distance of a motor that follows: a board may miss its references by
/// this much.
const LAG_SPEED_RATIO: f64 = 4.0;
/// Greatest lag of a motor that follows a stream freely, in units of the stream's squared speed over its
/// acceleration: one and a half where the stream reverses, less where it sets out.
const STREAM_LAG: f64 = 1.5;
/// Time for which boards go on at a velocity that is not repeated.
const VELOCITY_WATCHDOG: std::time::Duration = std::time::Duration::from_millis(100);
/// Greatest number of stored set-points: more than can be in transit.
const MAX_SET_POINTS: usize = 256;

/// State of a motor at a reading.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// Time of the reading.
    pub at: Time,
    /// Position, rad.
    pub q: f64,
    /// Motion since the previous reading, rad.
    pub by: f64,
    /// Speed over the last readings, rad/s.
    pub speed: f64,
    /// Time since the previous reading, seconds.
    pub dt: f64,
    /// Lag that counts as noise, rad.
    pub noise: f64,
}

/// Command that a motor tracks, and its lag.
#[derive(Clone, Debug)]
pub(super) struct TrackedCommand {
    /// Commanded motion.
    pub motion: CommandedMotion,
    /// Position at the beginning, rad.
    pub from: f64,
    /// Lead of the ghost, rad.
    lag: f64,
    /// Greatest lag in this motion, rad.
    pub most: f64,
    /// Number of consecutive readings beyond the threshold.
    pub beyond: u32,
}

impl TrackedCommand {
    /// Creates the state of a motor at `from`, rad.
    pub fn new(motion: CommandedMotion, from: f64) -> TrackedCommand {
        TrackedCommand { motion, from, lag: 0.0, most: 0.0, beyond: 0 }
    }

    /// Starts again at `q`, rad, after a gap in which the motor's motion is unknown.
    pub fn restart(&mut self, q: f64) {
        self.lag = 0.0;
        self.beyond = 0;
        match &mut self.motion {
            // The check whether the motor has set out is not repeated.
            CommandedMotion::Move(profile) => {
                profile.rate = 0.0;
                profile.secs = f64::INFINITY;
            }
            CommandedMotion::Positions(stream) => stream.value = q,
            CommandedMotion::Velocities(_) => {}
        }
    }

    /// Waits while readings were missing, from `before` until `at`: the motor is at `q`, rad, now, and its ghost has not
    /// moved.
    pub fn wait(&mut self, (before, at): (Time, Time), q: f64, rules: &Rules) {
        self.beyond = 0;
        match &mut self.motion {
            CommandedMotion::Move(profile) => profile.shows = profile.shows + at.since(before),
            CommandedMotion::Positions(stream) => {
                stream.value = stream.in_force(at - rules.reaction()).unwrap_or(q);
            }
            CommandedMotion::Velocities(_) => {}
        }
    }

    /// Returns the motor's lag at this reading, rad; zero if it follows.
    pub fn lag(&mut self, moment: &Moment, axis: &Axis, rules: &Rules) -> f64 {
        let lag = &mut self.lag;
        let by = match &mut self.motion {
            CommandedMotion::Move(profile) => profile.lag(lag, moment, rules),
            CommandedMotion::Positions(stream) => stream.behind_positions(lag, moment, axis, rules),
            CommandedMotion::Velocities(stream) => stream.behind_velocities(lag, moment, axis, rules),
        };
        self.most = self.most.max(by);
        by
    }
}

/// Motion that a motor is commanded.
#[derive(Clone, Debug)]
pub(super) enum CommandedMotion {
    /// A move to a position, with the board's own profile.
    Move(MoveProfile),
    /// A stream of positions.
    Positions(SetpointStream),
    /// A stream of velocities.
    Velocities(SetpointStream),
}

impl CommandedMotion {
    /// Motion of the `i`-th motor of a move; `from` and `speed`: its present position and speed, rad, rad/s.
    pub fn to(course: &Move, i: usize, (from, speed): (f64, f64), now: Time, rules: &Rules) -> Option<CommandedMotion> {
        let axis = rules.axes.get(*course.motors.get(i)?)?;
        let to = *course.q.get(i)? + if course.relative { from } else { 0.0 };
        let given =
            |list: &Option<Vec<f64>>, most: f64| list.as_ref().and_then(|v| v.get(i)).map_or(most, |v| v.min(most));
        let fastest = given(&course.speed, axis.max_speed);
        let most = given(&course.acceleration, axis.max_acceleration);
        // A motor that moves in the other direction comes to rest first, at half of its greatest acceleration.
        let away = speed * (to - from) < 0.0;
        let brakes = axis.max_acceleration.max(1e-6);
        let (from, turns) =
            if away { (from + speed * speed.abs() / brakes, 2.0 * speed.abs() / brakes) } else { (from, 0.0) };
        let travel = (to - from).abs();
        // Duration of a minimum-jerk trajectory (Flash and Hogan, 1985); boards with other profiles are faster.
        let secs = (1.875 * travel / fastest.max(1e-9)).max((5.774 * travel / most.max(1e-9)).sqrt()).max(1e-3);
        let shows = now + rules.reaction() + std::time::Duration::from_secs_f64(turns.min(10.0));
        Some(CommandedMotion::Move(MoveProfile { from, to, shows, secs, speed: fastest, rate: 0.0 }))
    }

    /// Stream of set-points for a motor at `q`, rad: of positions, or of velocities.
    pub fn stream(positions: bool, q: f64) -> CommandedMotion {
        let new = |value: f64| SetpointStream { points: VecDeque::new(), value, direction: 0.0, speed: 0.0 };
        if positions { CommandedMotion::Positions(new(q)) } else { CommandedMotion::Velocities(new(0.0)) }
    }

    /// Returns whether the motion is a stream of positions (`positions`), or of velocities.
    pub fn is_stream_of(&self, positions: bool) -> bool {
        match self {
            CommandedMotion::Move(_) => false,
            CommandedMotion::Positions(_) => positions,
            CommandedMotion::Velocities(_) => !positions,
        }
    }

    /// Adds the next set-point of a stream.
    pub fn add_set_point(&mut self, value: f64, now: Time) {
        if let CommandedMotion::Positions(stream) | CommandedMotion::Velocities(stream) = self {
            if stream.points.len() >= MAX_SET_POINTS {
                stream.points.pop_front();
            }
            stream.points.push_back((now, value));
        }
    }

    /// Direction of the present motion: 1 or -1.
    pub fn direction(&self) -> f64 {
        match self {
            CommandedMotion::Move(profile) => (profile.to - profile.from).signum(),
            CommandedMotion::Positions(stream) | CommandedMotion::Velocities(stream) => stream.direction,
        }
    }
}

/// Move of one motor.
#[derive(Clone, Debug)]
pub(super) struct MoveProfile {
    /// Start, rad.
    from: f64,
    /// Target, rad.
    to: f64,
    /// Latest time at which the motion shows in the readings.
    shows: Time,
    /// Expected duration, seconds.
    secs: f64,
    /// Commanded speed, rad/s.
    speed: f64,
    /// Speed of the ghost divided by its remaining distance, 1/s.
    rate: f64,
}

impl MoveProfile {
    fn lag(&mut self, lag: &mut f64, moment: &Moment, rules: &Rules) -> f64 {
        let direction = (self.to - self.from).signum();
        let left = (self.to - moment.q) * direction;
        let by = moment.by * direction;
        if moment.at < self.shows || left <= 0.0 {
            *lag = 0.0;
            return 0.0;
        }
        // While the motor follows, the ghost adopts its speed; once it lags, the ghost's speed is no longer updated.
        if *lag <= moment.noise {
            let speed = (moment.speed * direction).min(self.speed);
            let rate = if speed > rules.rest_speed { GHOST_SPEED_SHARE * speed / left.max(moment.noise) } else { 0.0 };
            let retained = (-moment.dt / SPEED_DECAY).exp();
            let is_fast = speed > FAST_RATIO * rules.rest_speed;
            self.rate = if is_fast { rate.max(self.rate * retained) } else { rate + (self.rate - rate) * retained };
        }
        let ahead = (left + by - *lag).max(0.0) * (1.0 - (-self.rate * moment.dt).exp());
        *lag = (*lag + ahead - by).clamp(0.0, left);
        // A motor that never set out has no speed to derive the ghost's speed from.
        let part = (moment.at.since(self.shows).as_secs_f64() / self.secs).min(1.0);
        let should = (self.to - self.from).abs() * part.powi(3) * (10.0 - 15.0 * part + 6.0 * part * part);
        let did = ((moment.q - self.from) * direction).max(0.0);
        lag.max((should - LAG_SPEED_RATIO * did).min(left))
    }
}

/// Stream of set-points.
#[derive(Clone, Debug)]
pub(super) struct SetpointStream {
    /// Times and values of the set-points; the first one is in force in the readings.
    points: VecDeque<(Time, f64)>,
    /// Value in force at the last reading.
    value: f64,
    /// Direction of motion: 1, -1, or zero before it is known.
    direction: f64,
    /// Recent greatest speed, rad/s.
    speed: f64,
}

impl SetpointStream {
    /// Returns the set-point in force in readings of this time, and drops earlier ones.
    fn in_force(&mut self, at: Time) -> Option<f64> {
        while self.points.get(1).is_some_and(|(since, _)| *since <= at) {
            self.points.pop_front();
        }
        self.points.front().filter(|(since, _)| *since <= at).map(|(_, value)| *value)
    }

    /// Greatest lag of a motor that catches up as fast as it can, rad.
    fn allows(&self, axis: &Axis) -> f64 {
        STREAM_LAG * self.speed * self.speed / axis.max_acceleration.max(1e-6)
    }

    fn turns(&mut self, direction: f64, lag: &mut f64) {
        if self.direction != direction {
            self.direction = direction;
            *lag = 0.0;
        }
    }

    fn behind_positions(&mut self, lag: &mut f64, moment: &Moment, axis: &Axis, rules: &Rules) -> f64 {
        let pace = |(a, b): (&(Time, f64), &(Time, f64))| (b.1 - a.1).abs() / b.0.since(a.0).as_secs_f64().max(1e-3);
        let fastest = self.points.iter().zip(self.points.iter().skip(1)).map(pace).fold(0.0, f64::max);
        self.speed = fastest.min(axis.max_speed).max(self.speed * (-moment.dt / STREAM_SPEED_DECAY).exp());
        let Some(value) = self.in_force(moment.at - rules.reaction()) else { return 0.0 };
        let by = value - std::mem::replace(&mut self.value, value);
        if by != 0.0 {
            self.turns(by.signum(), lag);
        }
        *lag = (*lag + GHOST_SPEED_SHARE * by.abs() - moment.by * self.direction).max(0.0);
        // at most the distance to the set-point
        *lag = lag.min(((value - moment.q) * self.direction).max(0.0));
        *lag - self.allows(axis)
    }

    fn behind_velocities(&mut self, lag: &mut f64, moment: &Moment, axis: &Axis, rules: &Rules) -> f64 {
        self.speed *= (-moment.dt / STREAM_SPEED_DECAY).exp();
        self.speed = self.points.iter().map(|(_, v)| v.abs()).fold(self.speed, f64::max);
        let Some(value) = self.in_force(moment.at - rules.reaction()) else { return 0.0 };
        let direction = value.signum();
        // The slowest velocity that may be in force by now; none once the board's watchdog has expired.
        let slowest = self.points.iter().map(|(_, v)| v * direction).fold(f64::INFINITY, f64::min);
        let old = self.points.back().is_none_or(|(since, _)| moment.at > *since + VELOCITY_WATCHDOG);
        // A board brakes by itself before a limit.
        let room = if direction > 0.0 { axis.max - moment.q } else { moment.q - axis.min };
        let reaction = rules.reaction().as_secs_f64();
        let needs = self.speed * reaction + 0.5 * self.speed * self.speed / axis.max_acceleration.max(1e-6);
        self.turns(direction, lag);
        if value == 0.0 || slowest <= 0.0 || old || room <= needs + rules.tolerance {
            *lag = 0.0;
            return 0.0;
        }
        *lag = (*lag + GHOST_SPEED_SHARE * slowest * moment.dt - moment.by * direction).max(0.0);
        *lag - self.allows(axis)
    }
}
