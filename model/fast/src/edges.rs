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

use crate::edge_block::middle;
use crate::fast::{FastError, FastScene};
use crate::lanes::{Mask, WIDTH};
use crate::limits::is_within;
use crate::program::Program;
use mobee_model::Pair;

/// An interval is not halved further when nothing moves more than this against anything else from its middle to either
/// end, by the bound that holds at every pose, meters.
const RESOLUTION: f64 = 1e-4;
/// By how many halvings the place of a contact is known less well than that: to less than a millimeter.
const COARSER: u32 = 3;
/// What goes farther than this from its middle is halved without a question, meters: everything would be near.
const START: f64 = 0.2;
/// Most halvings, whatever the length: intervals are numbered in 32 bits, and an edge must end.
const MOST_LEVELS: u32 = 20;
/// An edge with more intervals than this that are not proved is given up: it goes along an obstacle, nearer than the
/// resolution.
const MOST_OPEN: usize = 2048;
/// The latest level to begin with.
const MOST_START: u32 = 8;
/// Edges that are halved in step.
const TOGETHER: usize = 2048;

/// What a straight line in joint space is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeVerdict {
    /// Every pose on it is free: proved, not sampled.
    Free,
    /// A pose on it is not free, and what is before that is, but for stretches on which nothing moves a millimeter.
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
pub(crate) struct Interval {
    pub edge: u32,
    pub index: u32,
    /// Units to ask: a range of [`Edges::units`].
    pub first: u32,
    pub end: u32,
}

/// What is known of an edge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct State {
    /// At which level of halving it begins, and at which the resolution is reached.
    pub start: u32,
    pub levels: u32,
    /// Where it is blocked first, as far as is known.
    pub blocked: Option<Obstruction>,
    /// The first place that was not proved.
    pub uncertified: Option<f64>,
}

/// Buffers, used again for every call.
#[derive(Clone, Debug, Default)]
pub(crate) struct Edges {
    pub states: Vec<State>,
    pub open: Vec<Interval>,
    pub next: Vec<Interval>,
    /// Units of the intervals of this level, and of the next.
    pub units: Vec<u32>,
    pub next_units: Vec<u32>,
    /// Per unit: the lanes that ask about it.
    pub lanes: Vec<Mask>,
    /// A bit per unit that any lane asks about.
    pub wanted: Vec<u64>,
    /// Edges that begin at a later level, that one first; the next ones last.
    pub waiting: Vec<(u32, u32)>,
    /// Motors that any edge moves.
    pub moving: Vec<usize>,
    pub pose: Vec<f64>,
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
        self.halve_all(edges, (COARSER, MOST_OPEN), |state| {
            verdicts.push(match (state.blocked, state.uncertified) {
                (Some(obstruction), _) => EdgeVerdict::Blocked(obstruction),
                (None, Some(at)) => EdgeVerdict::Uncertified { at },
                (None, None) => EdgeVerdict::Free,
            });
        })
    }

    /// As [`FastScene::certify`], yes or no: whether each edge is certified free. Several times as fast where many are
    /// blocked, since any contact answers for its edge.
    ///
    /// # Errors
    /// As [`FastScene::certify`].
    pub fn edges_free(&mut self, edges: &[f64], free: &mut Vec<bool>) -> Result<(), FastError> {
        self.edges_free_within(edges, MOST_OPEN, free)
    }

    /// As [`FastScene::edges_free`], but an edge is given up where more than `most` of its intervals are not proved at a time, and
    /// counts as not free: one that goes close along something takes long to certify, and who has a choice takes another.
    ///
    /// # Errors
    /// As [`FastScene::certify`].
    pub fn edges_free_within(&mut self, edges: &[f64], most: usize, free: &mut Vec<bool>) -> Result<(), FastError> {
        free.clear();
        let is_free = |state: &State| state.blocked.is_none() && state.uncertified.is_none();
        self.halve_all(edges, (MOST_LEVELS, most.min(MOST_OPEN)), |state| free.push(is_free(state)))
    }

    /// Calls with what became of each edge. The place of a contact is known by so many halvings less well than the
    /// resolution; an edge with more intervals open than the second number is given up.
    fn halve_all(
        &mut self,
        edges: &[f64],
        limits: (u32, usize),
        mut done: impl FnMut(&State),
    ) -> Result<(), FastError> {
        let motors = self.motors();
        if motors == 0 || !edges.len().is_multiple_of(2 * motors) {
            return Err(FastError::Edges { given: edges.len(), motors });
        }
        let mut buffers = std::mem::take(&mut self.edges);
        self.keep_still(edges, &mut buffers);
        for edges in edges.chunks(2 * motors * TOGETHER) {
            self.halve_together(edges, limits, &mut buffers);
            buffers.states.iter().for_each(&mut done);
        }
        self.edges = buffers;
        Ok(())
    }

    /// Motors that no edge moves are where they are in all lanes, and what they carry is placed once.
    fn keep_still(&mut self, edges: &[f64], all: &mut Edges) {
        let motors = self.motors();
        self.block.forget(&self.program);
        self.intervals.motions.forget();
        all.moving.clear();
        let Some(first) = edges.get(..motors) else { return };
        for pose in edges.chunks_exact(motors) {
            for ((still, q), first) in self.block.still.iter_mut().zip(pose).zip(first) {
                *still |= q != first;
            }
        }
        for (m, q) in first.iter().enumerate() {
            let (low, high) = self.program.limits[m];
            // What is beyond its limit is looked at on every edge.
            let still = !self.block.still[m] && is_within(*q, (low, high));
            self.block.still[m] = still;
            if still {
                self.block.motors[m].0 = [q.max(low).min(high); WIDTH];
                self.intervals.motions.steps[m].0 = [0.0; WIDTH];
            } else {
                all.moving.push(m);
            }
        }
    }

    fn halve_together(&mut self, edges: &[f64], (coarser, most_open): (u32, usize), all: &mut Edges) {
        let length = 2 * self.motors();
        all.states.clear();
        all.open.clear();
        all.units.clear();
        all.waiting.clear();
        for (e, edge) in edges.chunks_exact(length).enumerate() {
            let state = self.start(edge, &all.moving);
            if state.blocked.is_none_or(|b| b.at > 0.0 && coarser < MOST_LEVELS) {
                all.waiting.push((state.start, e as u32));
            }
            all.states.push(state);
        }
        all.waiting.sort_unstable_by(|a, b| b.cmp(a));
        let mut level = 0;
        while !all.open.is_empty() || !all.waiting.is_empty() {
            self.join_in(level, all);
            all.next.clear();
            all.next_units.clear();
            let open = std::mem::take(&mut all.open);
            for block in open.chunks(WIDTH) {
                self.judge_block(edges, block, level, all);
            }
            all.open = open;
            halve(all, level, (coarser, most_open));
            std::mem::swap(&mut all.units, &mut all.next_units);
            level += 1;
        }
    }

    /// Edges that begin at this level: all parts of them, and all units.
    fn join_in(&self, level: u32, all: &mut Edges) {
        let mut range = None;
        while let Some((_, edge)) = all.waiting.pop_if(|(start, _)| *start <= level) {
            let (first, end) = *range.get_or_insert_with(|| {
                let first = all.units.len() as u32;
                all.units.extend(0..self.program.units.len() as u32);
                (first, all.units.len() as u32)
            });
            all.open.extend((0..1 << level).map(|index| Interval { edge, index, first, end }));
        }
    }

    /// Limits and constraints, and how often the edge may be halved.
    fn start(&self, edge: &[f64], moving: &[usize]) -> State {
        let (from, to) = edge.split_at(self.motors());
        let way: f64 = moving.iter().map(|m| (to[*m] - from[*m]).abs() * self.program.reach[*m]).sum();
        let violated = self.first_beyond_limits(from, to, moving).into_iter().chain(self.first_violation(from, to));
        let mut state = State { start: 0, levels: 0, blocked: None, uncertified: None };
        for (at, sure) in violated {
            if sure && state.blocked.is_none_or(|b| at < b.at) {
                state.blocked = Some(Obstruction { at, pair: None });
            } else if !sure {
                state.uncertified = Some(at);
            }
        }
        if way.is_finite() {
            let level = |half: f64| ((way / 2.0 / half).log2().ceil().max(0.0) as u32).min(MOST_LEVELS);
            state.levels = level(RESOLUTION);
            state.start = level(START).min(MOST_START);
        }
        state
    }
}

/// The next level: both halves of what is not proved, but for what comes after a contact; and what is too short to be
/// halved, or too much.
fn halve(all: &mut Edges, level: u32, (coarser, most_open): (u32, usize)) {
    all.open.clear();
    let parts = f64::from(1u32 << level);
    for of_edge in all.next.chunk_by(|a, b| a.edge == b.edge) {
        let edge = of_edge[0].edge;
        let state = &mut all.states[edge as usize];
        let before = |index: u32, parts: f64| state.blocked.is_none_or(|b| f64::from(index) / parts < b.at);
        let counted = of_edge.iter().take_while(|i| before(i.index, parts)).count();
        let levels = if state.blocked.is_some() { state.levels.saturating_sub(coarser) } else { state.levels };
        if level < levels && counted <= most_open {
            for interval in &of_edge[..counted] {
                for index in [2 * interval.index, 2 * interval.index + 1] {
                    if before(index, 2.0 * parts) {
                        all.open.push(Interval { index, ..*interval });
                    }
                }
            }
        } else if let Some(interval) = of_edge.first().filter(|_| counted > 0) {
            let at = middle(interval, level);
            if state.blocked.is_none_or(|b| at < b.at) {
                state.uncertified = Some(state.uncertified.map_or(at, |u| u.min(at)));
            }
        }
    }
}
