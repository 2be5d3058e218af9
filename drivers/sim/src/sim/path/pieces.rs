//! Motion in pieces of constant acceleration.

use super::{Bounds, State};

/// Largest number of pieces of a path: four to catch up with a setpoint and four to stop on it.
const MAX_PIECES: usize = 9;

/// A piece of constant acceleration: its start state and time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct PathPiece {
    t: f64,
    state: State,
}

/// A motion in pieces of constant acceleration that ends at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Pieces {
    pieces: [PathPiece; MAX_PIECES],
    len: usize,
    /// State after the last piece, and its time.
    last: PathPiece,
}

impl Pieces {
    /// A motion without pieces, at `state`.
    pub fn new(state: State) -> Pieces {
        let state = State { a: 0.0, ..state };
        Pieces { pieces: [PathPiece::default(); MAX_PIECES], len: 0, last: PathPiece { t: 0.0, state } }
    }

    /// Adds `seconds` at acceleration `a`. Pieces without a duration are omitted.
    pub fn push(&mut self, a: f64, seconds: f64) {
        if seconds > 0.0
            && let Some(slot) = self.pieces.get_mut(self.len)
        {
            *slot = PathPiece { t: self.last.t, state: State { a, ..self.last.state } };
            let next = slot.state.after(seconds);
            self.last = PathPiece { t: self.last.t + seconds, state: State { a: 0.0, ..next } };
            self.len += 1;
        }
    }

    /// Sets the exact state after the last piece, to remove rounding errors.
    pub fn finish(&mut self, q: f64, v: f64) {
        self.last.state = State { q, v, a: 0.0 };
    }

    /// State after `t` seconds; at rest after the last piece.
    pub fn at(&self, t: f64) -> State {
        if t >= self.last.t {
            return self.last.state;
        }
        let pieces = self.pieces.get(..self.len).unwrap_or_default();
        match pieces.iter().rev().find(|p| p.t <= t).or(pieces.first()) {
            Some(p) => p.state.after((t - p.t).max(0.0)),
            None => self.last.state,
        }
    }

    /// States at which pieces meet, with their times, from the beginning to the end.
    pub fn joints(&self) -> impl Iterator<Item = (f64, State)> + '_ {
        self.pieces.iter().take(self.len).chain([&self.last]).map(|p| (p.t, p.state))
    }

    /// Same motion in a frame that moves with `speed`; the two frames agree at the beginning.
    pub(super) fn in_moving_frame(mut self, speed: f64) -> Pieces {
        for p in self.pieces.iter_mut().take(self.len).chain([&mut self.last]) {
            p.state.q += speed * p.t;
            p.state.v += speed;
        }
        self
    }

    /// Motion that is cut off after `t` seconds and continues as `rest`.
    pub(super) fn then(&self, t: f64, rest: &Pieces) -> Pieces {
        let mut all = Pieces::new(self.at(0.0));
        for p in self.pieces.iter().take(self.len).filter(|p| p.t < t) {
            all.add(*p);
        }
        // the time between the last piece and the cut is a piece of its own, at constant speed
        if self.last.t < t {
            all.add(self.last);
        }
        for p in rest.pieces.iter().take(rest.len) {
            all.add(PathPiece { t: p.t + t, ..*p });
        }
        all.last = PathPiece { t: rest.last.t + t, ..rest.last };
        all
    }

    fn add(&mut self, piece: PathPiece) {
        if let Some(slot) = self.pieces.get_mut(self.len) {
            *slot = piece;
            self.len += 1;
        }
    }

    /// Seconds to the end of the last piece.
    pub fn duration(&self) -> f64 {
        self.last.t
    }

    /// State after the last piece.
    pub(super) fn last(&self) -> State {
        self.last.state
    }

    /// Position at the end.
    pub fn end(&self) -> f64 {
        self.last.state.q
    }
}

impl State {
    /// State after `t` seconds at constant acceleration.
    fn after(self, t: f64) -> State {
        State { q: self.q + (self.v + 0.5 * self.a * t) * t, v: self.v + self.a * t, a: self.a }
    }

    /// Position of rest after braking now with `deceleration`.
    pub fn stopping_point(self, deceleration: f64) -> f64 {
        self.q + self.v * self.v.abs() / (2.0 * deceleration)
    }
}

/// Braking to a rest at constant `deceleration`.
pub fn brake(from: State, deceleration: f64) -> Pieces {
    let mut p = Pieces::new(from);
    if from.v != 0.0 {
        p.push(-deceleration.copysign(from.v), from.v.abs() / deceleration);
        p.finish(from.stopping_point(deceleration), 0.0);
    }
    p
}

/// From any state to a rest at `to`: accelerate, cruise, decelerate.
///
/// Uses the reference acceleration where it suffices. Brakes harder, up to `greatest`, if the motor moves in
/// the wrong direction or too fast to stop in time. It overshoots only if even that is insufficient, and then
/// by the least distance possible.
pub fn trapezoid(from: State, to: f64, reference: Bounds, greatest: f64) -> Pieces {
    let way = to - from.q;
    let wrong_way = from.v * way < 0.0;
    let needed = if way == 0.0 { f64::INFINITY } else { from.v * from.v / (2.0 * way.abs()) };
    let mut p = Pieces::new(from);
    if from.v != 0.0 && (wrong_way || needed > greatest) {
        p = brake(from, greatest);
    } else if needed > reference.acceleration {
        p.push(-needed.copysign(from.v), from.v.abs() / needed);
        p.finish(to, 0.0);
        return p;
    }
    let State { q, v, .. } = p.last.state;
    let way = (to - q).abs();
    let direction = (to - q).signum();
    let v = v.abs();
    if way > 0.0 {
        let a = reference.acceleration;
        // the peak of a motion without cruising: v_peak^2 = a way + v^2 / 2
        let peak = (a * way + 0.5 * v * v).sqrt().min(reference.speed);
        // above the reference speed it decelerates first
        let turn = a.copysign(peak - v) * direction;
        let covered = (peak * peak - v * v).abs() / (2.0 * a) + peak * peak / (2.0 * a);
        p.push(turn, (peak - v).abs() / a);
        p.push(0.0, ((way - covered) / peak).max(0.0));
        p.push(-a * direction, peak / a);
    }
    p.finish(to, 0.0);
    p
}
