//! Edges, certified: each is halved until every part is proved to be free, or a contact is found on it.
//!
//! ```text
//! whole edge        middle too near for the way to its ends: halve, and ask the halves about these pairs alone
//!   half            proved
//!   half
//!     quarter       touches at the middle: what comes after it does not matter any more
//!     quarter ...   shorter than the resolution and still not proved: uncertified
//! ```
//! All edges are halved in step, so that lanes are full and no verdict depends on which edges came together.

use crate::fast::{FastError, FastScene};
use crate::intervals::NONE;
use crate::lanes::{Mask, WIDTH};
use crate::program::Program;
use mobee_model::Pair;

/// An interval is not halved further when nothing moves more than this against anything else from its middle to either
/// end, by the bound that holds at every pose, meters.
const RESOLUTION: f64 = 1e-4;
/// Most halvings, whatever the length: intervals are numbered in 32 bits, and an edge must end.
const MOST_LEVELS: u32 = 20;
/// An edge with more intervals than this that are not proved is given up: it goes along an obstacle, nearer than the
/// resolution.
const MOST_OPEN: usize = 2048;
/// Edges that are halved in step.
const TOGETHER: usize = 2048;
/// How far beyond a limit, rad of encoder, counts as at it: rounding of units.
const AT_LIMIT: f64 = 1e-9;

/// What a straight line in joint space is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeVerdict {
    /// Every pose on it is free: proved, not sampled.
    Free,
    /// A pose on it is not free, and what is before that is, as far as the resolution goes.
    Blocked(Obstruction),
    /// Neither was proved: somewhere on it a pair is nearer to the clearance than the resolution, but none was found to
    /// be beyond it. To whoever moves a robot that is blocked.
    Uncertified {
        /// The first such place, as a share of the way, 0 to 1.
        at: f64,
    },
}

/// What blocks an edge, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstruction {
    /// Share of the way, 0 to 1; the pose there is `from + (to - from) * at`, motor by motor.
    pub at: f64,
    /// A pair that is not farther apart than the clearance there; `None` where a motor is beyond its limit or a
    /// constraint is violated.
    pub pair: Option<Pair>,
}

/// A part of an edge that is not proved yet: the `index`-th of `2^level`.
#[derive(Clone, Copy, Debug)]
struct Interval {
    edge: u32,
    index: u32,
    /// Units to ask: a range of [`Edges::units`].
    first: u32,
    end: u32,
}

/// What is known of an edge.
#[derive(Clone, Copy, Debug)]
struct State {
    /// In how many levels it is halved down to the resolution.
    levels: u32,
    /// Where it is blocked first, as far as is known.
    blocked: Option<Obstruction>,
    /// The first place that was not proved.
    uncertified: Option<f64>,
}

/// Buffers, used again for every call.
#[derive(Clone, Debug, Default)]
pub(crate) struct Edges {
    states: Vec<State>,
    open: Vec<Interval>,
    next: Vec<Interval>,
    /// Units of the intervals of this level, and of the next.
    units: Vec<u32>,
    next_units: Vec<u32>,
    /// Per unit: the lanes that ask about it.
    lanes: Vec<Mask>,
    /// A bit per unit that any lane asks about.
    wanted: Vec<u64>,
    pose: Vec<f64>,
}

impl Edges {
    pub fn new(program: &Program) -> Self {
        let units = program.units.len();
        Edges { lanes: vec![0; units], wanted: vec![0; units.div_ceil(64)], ..Edges::default() }
    }
}

impl FastScene {
    /// Certifies straight lines in joint space: is every pose on them free?
    ///
    /// # Arguments
    /// * `edges`: one after the other; of each the pose at its start, then that at its end, each with the motors of all
    ///   robots in order, rad of encoder. Motors go straight: whoever means the short way round says so by the numbers.
    /// * `verdicts`: emptied first; one per edge. They do not depend on which edges are asked about together.
    ///
    /// # Method
    /// Conservative bisection: at the middle of an interval each pair's distance is compared with the clearance and the
    /// way that the two can move against each other on it (sum over the motors between them of step times reach). What
    /// is farther apart is proved; the rest is asked again in both halves, down to intervals of 0.1 mm. Rounding is in
    /// the bounds. Limits and constraints are linear, so they are solved for.
    ///
    /// # Errors
    /// If the numbers are not a whole number of edges.
    pub fn certify(&mut self, edges: &[f64], verdicts: &mut Vec<EdgeVerdict>) -> Result<(), FastError> {
        verdicts.clear();
        let motors = self.motors();
        if motors == 0 || !edges.len().is_multiple_of(2 * motors) {
            return Err(FastError::Edges { given: edges.len(), motors });
        }
        let mut buffers = std::mem::take(&mut self.edges);
        for edges in edges.chunks(2 * motors * TOGETHER) {
            self.certify_together(edges, &mut buffers);
            verdicts.extend(buffers.states.iter().map(|state| match (state.blocked, state.uncertified) {
                (Some(obstruction), _) => EdgeVerdict::Blocked(obstruction),
                (None, Some(at)) => EdgeVerdict::Uncertified { at },
                (None, None) => EdgeVerdict::Free,
            }));
        }
        self.edges = buffers;
        Ok(())
    }

    fn certify_together(&mut self, edges: &[f64], all: &mut Edges) {
        let length = 2 * self.motors();
        all.states.clear();
        all.open.clear();
        all.units.clear();
        all.units.extend(0..self.program.units.len() as u32);
        let end = all.units.len() as u32;
        for (e, edge) in edges.chunks_exact(length).enumerate() {
            let state = self.start(edge);
            all.open.push(Interval { edge: e as u32, index: 0, first: 0, end });
            all.states.push(state);
        }
        let mut level = 0;
        all.open.retain(|i| all.states[i.edge as usize].blocked.is_none_or(|b| b.at > 0.0));
        while !all.open.is_empty() {
            all.next.clear();
            all.next_units.clear();
            let open = std::mem::take(&mut all.open);
            for block in open.chunks(WIDTH) {
                self.judge_block(edges, block, level, all);
            }
            all.open = open;
            halve(all, level);
            std::mem::swap(&mut all.units, &mut all.next_units);
            level += 1;
        }
    }

    /// Limits and constraints, and how often the edge may be halved.
    fn start(&mut self, edge: &[f64]) -> State {
        let (from, to) = edge.split_at(self.motors());
        let way: f64 = from.iter().zip(to).zip(&self.program.reach).map(|((a, b), reach)| (b - a).abs() * reach).sum();
        let violated = self.first_beyond_limits(from, to).into_iter().chain(self.first_violation(from, to));
        let mut state = State { levels: 0, blocked: None, uncertified: None };
        for (at, sure) in violated {
            if sure && state.blocked.is_none_or(|b| at < b.at) {
                state.blocked = Some(Obstruction { at, pair: None });
            } else if !sure {
                state.uncertified = Some(at);
            }
        }
        if way.is_finite() {
            state.levels = ((way / 2.0 / RESOLUTION).log2().ceil().max(0.0) as u32).min(MOST_LEVELS);
        }
        state
    }

    /// Judges sixteen intervals; those that are not proved go to `next`, still whole.
    fn judge_block(&mut self, edges: &[f64], block: &[Interval], level: u32, all: &mut Edges) {
        let (motors, parts) = (self.motors(), f64::from(1u32 << level));
        let middle = |interval: &Interval| (f64::from(interval.index) + 0.5) / parts;
        for (lane, interval) in block.iter().enumerate() {
            let edge = &edges[interval.edge as usize * 2 * motors..][..2 * motors];
            let (from, to) = edge.split_at(motors);
            let at = middle(interval);
            for m in 0..motors {
                let step = to[m] - from[m];
                let (low, high) = self.program.limits[m];
                self.block.motors[m].0[lane] = (from[m] + step * at).max(low).min(high);
                self.intervals.half[m].0[lane] = (step.abs() * 0.5 / parts) as f32;
            }
        }
        self.ask(block, all);
        self.runner.sweep(&self.program, &mut self.block, &mut self.intervals);
        for (lane, interval) in block.iter().enumerate() {
            let bit = 1 << lane;
            let first = all.next_units.len() as u32;
            let open = self.intervals.open.iter().filter(|(_, lanes)| lanes & bit != 0);
            all.next_units.extend(open.map(|(unit, _)| *unit));
            let end = all.next_units.len() as u32;
            if end == first {
                continue;
            }
            all.next.push(Interval { first, end, ..*interval });
            let at = middle(interval);
            let state = &mut all.states[interval.edge as usize];
            let mut pair = Some(self.intervals.touching[lane]).filter(|pair| *pair != NONE);
            if pair.is_none() && level >= state.levels {
                pair = self.in_doubt(edges, interval.edge as usize, at, lane, &mut all.pose);
            }
            if let Some(pair) = pair
                && state.blocked.is_none_or(|b| at < b.at)
            {
                let (a, b) = self.program.pairs[pair].ids;
                let ids = self.reference.shape_id(a).zip(self.reference.shape_id(b));
                state.blocked = Some(Obstruction { at, pair: ids });
            }
        }
    }

    /// What the lanes ask about, unit by unit.
    fn ask(&mut self, block: &[Interval], all: &mut Edges) {
        self.intervals.asked.clear();
        for (lane, interval) in block.iter().enumerate() {
            for unit in &all.units[interval.first as usize..interval.end as usize] {
                all.lanes[*unit as usize] |= 1 << lane;
                all.wanted[*unit as usize / 64] |= 1 << (unit % 64);
            }
        }
        for (word, bits) in all.wanted.iter_mut().enumerate() {
            while *bits != 0 {
                let unit = word * 64 + bits.trailing_zeros() as usize;
                *bits &= *bits - 1;
                self.intervals.asked.push((unit as u32, std::mem::take(&mut all.lanes[unit])));
            }
        }
    }

    /// The pair, of those that rounding could decide about in a lane, that touches according to the scalar engine.
    fn in_doubt(&mut self, edges: &[f64], edge: usize, at: f64, lane: usize, pose: &mut Vec<f64>) -> Option<usize> {
        let motors = self.motors();
        let (from, to) = edges[edge * 2 * motors..][..2 * motors].split_at(motors);
        pose.clear();
        pose.extend(from.iter().zip(to).map(|(a, b)| a + (b - a) * at));
        let doubts = self.intervals.doubts.iter().filter(|(_, lanes)| lanes >> lane & 1 != 0);
        let mut pairs = doubts.map(|(pair, _)| *pair);
        pairs.find(|p| self.reference.any_touches(pose, [self.program.pairs[*p].ids].into_iter(), self.clearance))
    }

    /// Where a line first is beyond a motor's limit.
    fn first_beyond_limits(&self, from: &[f64], to: &[f64]) -> Option<(f64, bool)> {
        let mut first: Option<f64> = None;
        for ((a, b), (low, high)) in from.iter().zip(to).zip(&self.program.limits) {
            let inside = |q: &f64| *q >= low - AT_LIMIT && *q <= high + AT_LIMIT;
            let at = match (inside(a), inside(b)) {
                (true, true) => continue,
                (false, _) => 0.0,
                // Not before the place where it is beyond: rounding may not turn it back.
                (true, false) => {
                    let limit = if b > high { high + AT_LIMIT } else { low - AT_LIMIT };
                    (((limit - a) / (b - a)) + 1e-12).clamp(0.0, 1.0)
                }
            };
            let at = if at.is_nan() { 0.0 } else { at };
            first = Some(first.map_or(at, |f| f.min(at)));
        }
        first.map(|at| (at, true))
    }

    /// Where a line first violates a constraint, and whether it surely does there. Half-spaces are linear, so each
    /// clause is violated on one interval.
    fn first_violation(&self, from: &[f64], to: &[f64]) -> Option<(f64, bool)> {
        let mut first: Option<(f64, bool)> = None;
        for clause in &self.program.clauses {
            let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
            for (terms, constant) in &clause.members {
                let value = |q: &[f64]| terms.iter().map(|(m, a)| a * q[*m]).sum::<f64>() + constant - clause.doubt;
                let (v0, v1) = (value(from), value(to));
                match (v0 > 0.0, v1 > 0.0) {
                    (true, true) => leave = -1.0,
                    (true, false) => enter = enter.max(v0 / (v0 - v1)),
                    (false, true) => leave = leave.min(v0 / (v0 - v1)),
                    (false, false) => {}
                }
            }
            if enter > leave || first.is_some_and(|(at, sure)| sure && at <= enter) {
                continue;
            }
            let violated = |at: &f64| {
                let pose: Vec<f64> = from.iter().zip(to).map(|(a, b)| a + (b - a) * at).collect();
                !self.reference.satisfies_constraints(&pose)
            };
            let candidates = [enter, (enter + 1e-9).min(leave), (enter + leave) / 2.0, leave];
            let found = candidates.iter().find(|at| violated(at));
            first = match (found, first) {
                (Some(at), Some((other, true))) => Some((at.min(other), true)),
                (Some(at), _) => Some((*at, true)),
                (None, None) => Some((enter, false)),
                (None, known) => known,
            };
        }
        first
    }
}

/// The next level: both halves of what is not proved, but for what comes after a contact; and what is too short to be
/// halved, or too much.
fn halve(all: &mut Edges, level: u32) {
    all.open.clear();
    let parts = f64::from(1u32 << level);
    for of_edge in all.next.chunk_by(|a, b| a.edge == b.edge) {
        let edge = of_edge[0].edge;
        let state = &mut all.states[edge as usize];
        let before = |index: u32, parts: f64| state.blocked.is_none_or(|b| f64::from(index) / parts < b.at);
        let counted = of_edge.iter().take_while(|i| before(i.index, parts)).count();
        if level < state.levels && counted <= MOST_OPEN {
            for interval in &of_edge[..counted] {
                for index in [2 * interval.index, 2 * interval.index + 1] {
                    if before(index, 2.0 * parts) {
                        all.open.push(Interval { index, ..*interval });
                    }
                }
            }
        } else if let Some(interval) = of_edge.first().filter(|_| counted > 0) {
            let at = (f64::from(interval.index) + 0.5) / parts;
            if state.blocked.is_none_or(|b| at < b.at) {
                state.uncertified = Some(state.uncertified.map_or(at, |u| u.min(at)));
            }
        }
    }
}
