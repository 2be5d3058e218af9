//! One motor: its control mode, its references, and its present path.

use crate::sim::path::{Bounds, Leg, Path, Profile, State, brake, cruise, follow};
use mobee_contract::{Axis, ControlMode, Time};

/// Lowest reference of a motor, as a share of its greatest. Lower ones are raised to it: in a move of many
/// motors, one with almost no distance to cover, such as the error of an encoder reading, would otherwise
/// creep on long after the others.
const LEAST_REFERENCE: f64 = 1.0 / 5000.0;
/// Interval between setpoints beyond which they are single ones, not a stream, s.
const STREAM_GAP: f64 = 0.1;
/// Shortest plausible interval between setpoints of a stream, s.
const SHORTEST_INTERVAL: f64 = 1e-3;

/// Time for which a motor continues at a velocity that is not renewed, s; then it brakes, as on real boards.
const WATCHDOG: f64 = 0.1;

/// One motor of the plant.
#[derive(Clone, Debug)]
pub struct PlantMotor {
    /// Present control mode.
    pub mode: ControlMode,
    reference: Bounds,
    path: Path,
    began: Time,
    /// Leg to the newest setpoint, and the arrival time of that setpoint.
    leg: Option<(Time, Leg)>,
    /// Block of the motor, if any.
    stop: Option<PlantStop>,
}

/// Obstacle beyond which a motor does not go, although its path does.
#[derive(Clone, Copy, Debug)]
pub struct PlantStop {
    /// Position of the obstacle, rad.
    q: f64,
    /// Direction in which the motor is blocked: 1 or -1.
    direction: f64,
    /// Time since when.
    since: Time,
}

impl PlantMotor {
    /// Creates a motor at rest at `q`, with the initial references.
    pub fn at_rest(q: f64, axis: &Axis) -> PlantMotor {
        PlantMotor {
            mode: ControlMode::Position,
            reference: Bounds { speed: 0.1 * axis.max_speed, acceleration: axis.max_acceleration },
            path: Path::Rest(q),
            began: Time::ZERO,
            leg: None,
            stop: None,
        }
    }

    /// State of the motor.
    pub fn state(&self, now: Time) -> State {
        let state = self.wants(now);
        match self.stop {
            Some(stop) if (state.q - stop.q) * stop.direction > 0.0 => State::rest(stop.q),
            _ => state,
        }
    }

    /// State without the block.
    fn wants(&self, now: Time) -> State {
        match &self.path {
            Path::Rest(q) => State::rest(*q),
            path => path.at(self.passed(now)),
        }
    }

    /// Blocks it at its position, in its direction of motion.
    pub fn hold(&mut self, at: Time) {
        let State { q, v, .. } = self.state(at);
        self.stop.get_or_insert(PlantStop { q, direction: v.signum(), since: at });
    }

    /// Time since when it has been blocked, and the distance to the position that its board commands, rad.
    pub fn held(&self, now: Time) -> Option<(Time, f64)> {
        let stop = self.stop?;
        Some((stop.since, ((self.wants(now).q - stop.q) * stop.direction).max(0.0)))
    }

    /// Unblocks it: from its position it moves to the one that its board commands.
    pub fn release(&mut self, at: Time, profile: Profile, greatest: Bounds) {
        let pushes = self.held(at).is_some_and(|(_, ahead)| ahead > 0.0);
        let state = self.state(at);
        self.stop = None;
        if pushes {
            self.take(at, Path::to(profile, state, self.path.end(), self.reference, greatest));
        }
    }

    /// True if it has come to rest.
    pub fn rests(&self, now: Time) -> bool {
        match &self.path {
            Path::Rest(_) => true,
            path => self.passed(now) >= path.duration(),
        }
    }

    /// True if it reports that its motion is done.
    pub fn is_done(&self, now: Time) -> bool {
        self.passed(now) >= self.path.done()
    }

    /// Sets references, limited to what the axis can do.
    pub fn refer(&mut self, speed: Option<f64>, acceleration: Option<f64>, axis: &Axis) {
        if let Some(v) = speed {
            self.reference.speed = v.clamp(LEAST_REFERENCE * axis.max_speed, axis.max_speed);
        }
        if let Some(a) = acceleration {
            self.reference.acceleration = a.clamp(LEAST_REFERENCE * axis.max_acceleration, axis.max_acceleration);
        }
    }

    /// Starts a position move at `at`, from the present state.
    pub fn go(&mut self, at: Time, to: f64, profile: Profile, greatest: Bounds) {
        self.mode = ControlMode::Position;
        self.leg = None;
        self.take(at, Path::to(profile, self.state(at), to, self.reference, greatest));
    }

    /// Follows a setpoint that arrived at `at`; ignored in other modes.
    pub fn set_point(&mut self, at: Time, to: f64, axis: &Axis) {
        if self.mode != ControlMode::PositionDirect {
            return;
        }
        let greatest = super::greatest(axis);
        let state = self.state(at);
        let interval = |came: Time| at.since(came).as_secs_f64();
        let leg = match self.leg {
            Some((came, leg)) if interval(came) <= STREAM_GAP => {
                Leg::new(leg.at(interval(came)), to, interval(came).max(SHORTEST_INTERVAL), greatest)
            }
            // the first setpoint of a stream is a position to go to
            _ => Leg { from: to, to, seconds: SHORTEST_INTERVAL },
        };
        self.leg = Some((at, leg));
        if state.v == 0.0 && state.q == to && leg.from == to {
            self.take(at, Path::Rest(to));
        } else {
            self.take(at, Path::Pieces(Box::new(follow(state, leg, [axis.min, axis.max], greatest))));
        }
    }

    /// Moves at a velocity that arrived at `at`, until the next command or the watchdog, and never into a
    /// limit.
    pub fn run(&mut self, at: Time, v: f64, axis: &Axis) {
        let greatest = super::greatest(axis);
        self.switch(at, ControlMode::Velocity, greatest);
        self.leg = None;
        let state = self.state(at);
        if v == 0.0 && state.v == 0.0 {
            self.take(at, Path::Rest(state.q));
        } else {
            self.take(at, Path::Pieces(Box::new(cruise(state, v, WATCHDOG, [axis.min, axis.max], greatest))));
        }
    }

    /// Brakes as hard as it can.
    pub fn brake(&mut self, at: Time, greatest: Bounds) {
        self.leg = None;
        let state = self.state(at);
        if self.rests(at) {
            self.take(at, Path::Rest(state.q));
        } else {
            self.take(at, Path::Pieces(Box::new(brake(state, greatest.acceleration))));
        }
    }

    /// Rests immediately at this commanded position, rad.
    pub fn hold_at(&mut self, at: Time, q: f64) {
        self.leg = None;
        self.take(at, Path::Rest(q));
    }

    /// Displaces it immediately by `by`, rad, to a rest.
    pub fn push(&mut self, at: Time, by: f64, axis: &Axis) {
        let q = self.state(at).q;
        self.take(at, Path::Rest((q + by).clamp(axis.min.min(q), axis.max.max(q))));
    }

    /// Switches the control mode; a motor in motion brakes if its mode changes.
    pub fn switch(&mut self, at: Time, mode: ControlMode, greatest: Bounds) {
        if self.mode != mode {
            self.mode = mode;
            self.brake(at, greatest);
        }
    }

    fn take(&mut self, at: Time, path: Path) {
        self.path = path;
        self.began = at;
    }

    fn passed(&self, now: Time) -> f64 {
        now.since(self.began).as_secs_f64()
    }
}
