//! Certification of edges: each is bisected until every part is proved to be free, or a contact is found on it.
//!
//! ```text
//! whole edge        midpoint too close for the motion to its ends: bisect, and test the halves for these pairs only
//!   half            proved
//!   half
//!     quarter       touches at the midpoint: the parts behind it are irrelevant now
//!     quarter ...   shorter than the resolution and still not proved: uncertified
//! ```
//! All edges are bisected in step, so that lanes are full and no verdict depends on which edges are processed together.

use crate::edge_block::middle;
use crate::fast::{FastError, FastScene};
use crate::lanes::{LaneMask, WIDTH};
use crate::limits::is_within;
use crate::program::Program;
use mobee_model::Pair;

/// An interval is not bisected further if nothing moves more than this relative to anything else from its midpoint to
/// either end, by the bound that holds at every pose, meters.
const RESOLUTION_M: f64 = 1e-4;
/// Number of bisections by which the position of a contact is known less precisely than that: to within a millimeter.
const COARSER_LEVELS: u32 = 3;
/// An interval with more motion than this from its midpoint is bisected without a test, meters: everything would be
/// near.
const MAX_TESTED_MOTION_M: f64 = 0.2;
/// Maximum number of bisections of any edge: intervals are numbered in 32 bits, and the bisection must terminate.
const MAX_LEVELS: u32 = 20;
/// Maximum number of unproved intervals of an edge; one with more is abandoned, as it follows an obstacle at less than
/// the resolution.
const MAX_OPEN: usize = 2048;
/// Maximum level at which the bisection starts.
const MAX_START_LEVEL: u32 = 8;
/// Number of edges that are bisected in step.
const EDGES_PER_BATCH: usize = 2048;

/// Verdict on a straight line in joint space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeVerdict {
    /// Every pose on it is free: proved, not sampled.
    Free,
    /// A pose on it is not free. The edge before that pose is free, except for possible stretches on which nothing
    /// moves a millimeter.
    Blocked(Obstruction),
    /// Neither was proved: somewhere on it the distance of a pair differs from the clearance by less than the
    /// resolution, but no contact was found. Treat it as blocked when moving a robot.
    Uncertified {
        /// The first such position, as a fraction of the edge, 0 to 1.
        at: f64,
    },
}

/// The obstruction of an edge, with its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Obstruction {
    /// Fraction of the edge, 0 to 1; the pose there is `from + (to - from) * at`, motor by motor.
    pub at: f64,
    /// A pair that is not farther apart than the clearance there; `None` if a motor is beyond its limit or a constraint
    /// is violated.
    pub pair: Option<Pair>,
}

/// A part of an edge that is not proved yet: the `index`-th of `2^level`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Interval {
    pub edge: u32,
    pub index: u32,
    /// Units to test: a range of [`Edges::units`].
    pub first: u32,
    pub end: u32,
}

/// State of an edge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EdgeCheckState {
    /// The level at which its bisection starts, and the level at which the resolution is reached.
    pub start: u32,
    pub levels: u32,
    /// The first obstruction found so far.
    pub blocked: Option<Obstruction>,
    /// The first position that was not proved.
    pub uncertified: Option<f64>,
}

/// Buffers, reused for every call.
#[derive(Clone, Debug, Default)]
pub(crate) struct Edges {
    pub states: Vec<EdgeCheckState>,
    pub open: Vec<Interval>,
    pub next: Vec<Interval>,
    /// Units of the intervals of this level, and of the next.
    pub units: Vec<u32>,
    pub next_units: Vec<u32>,
    /// Per unit: the lanes in which it is tested.
    pub lanes: Vec<LaneMask>,
    /// A bit per unit that is tested in any lane.
    pub wanted: Vec<u64>,
    /// Edges that start at a later level, as (level, edge); the next ones last.
    pub waiting: Vec<(u32, u32)>,
    /// Motors that any edge moves.
    pub moving: Vec<usize>,
    pub pose: Vec<f64>,
}

impl Edges {
    /// Fits the buffers to a program.
    pub fn fit(&mut self, program: &Program) {
        self.lanes.resize(program.units.len(), 0);
        self.wanted.resize(program.units.len().div_ceil(64), 0);
    }
}

impl FastScene {
    /// Certifies straight lines in joint space: proves that every pose on them is free.
    ///
    /// # Arguments
    /// * `edges`: concatenated; for each the pose at its start, then that at its end, each with the motors of all
    ///   robots in order, rad of encoder. Motors move straight: for the shorter direction of a continuous motor pass an
    ///   equivalent position.
    /// * `verdicts`: cleared first; one per edge. They do not depend on which edges are passed together.
    ///
    /// # Method
    /// Conservative bisection: at the midpoint of an interval each pair's distance is compared with the clearance plus
    /// the relative motion of the two on the interval (sum over the motors between them of step times reach). Pairs
    /// that are farther apart are proved; the rest is tested again in both halves, down to intervals of 0.1 mm. The
    /// bounds include rounding. Limits and constraints are linear, so they are solved for exactly.
    ///
    /// # Errors
    /// If the numbers are not a whole number of edges.
    pub fn certify(&mut self, edges: &[f64], verdicts: &mut Vec<EdgeVerdict>) -> Result<(), FastError> {
        verdicts.clear();
        self.bisect_all(edges, (COARSER_LEVELS, MAX_OPEN), |state| {
            verdicts.push(match (state.blocked, state.uncertified) {
                (Some(obstruction), _) => EdgeVerdict::Blocked(obstruction),
                (None, Some(at)) => EdgeVerdict::Uncertified { at },
                (None, None) => EdgeVerdict::Free,
            });
        })
    }

    /// As [`FastScene::certify`], yes or no: true for each edge that is certified free. Several times as fast if many
    /// are blocked, since any contact decides its edge.
    ///
    /// # Errors
    /// As [`FastScene::certify`].
    pub fn edges_free(&mut self, edges: &[f64], free: &mut Vec<bool>) -> Result<(), FastError> {
        self.edges_free_within(edges, MAX_OPEN, free)
    }

    /// As [`FastScene::edges_free`], but an edge with more than `most` unproved intervals at a time is abandoned and
    /// counts as not free: an edge close along an obstacle takes long to certify, and a planner can usually choose
    /// another.
    ///
    /// # Errors
    /// As [`FastScene::certify`].
    pub fn edges_free_within(&mut self, edges: &[f64], most: usize, free: &mut Vec<bool>) -> Result<(), FastError> {
        free.clear();
        let is_free = |state: &EdgeCheckState| state.blocked.is_none() && state.uncertified.is_none();
        self.bisect_all(edges, (MAX_LEVELS, most.min(MAX_OPEN)), |state| free.push(is_free(state)))
    }

    /// Calls `done` with the final state of each edge. `limits`: number of bisections by which the position of a
    /// contact is known less precisely than the resolution, and the maximum number of open intervals of an edge.
    fn bisect_all(
        &mut self,
        edges: &[f64],
        limits: (u32, usize),
        mut done: impl FnMut(&EdgeCheckState),
    ) -> Result<(), FastError> {
        let motors = self.motors();
        if motors == 0 || !edges.len().is_multiple_of(2 * motors) {
            return Err(FastError::Edges { given: edges.len(), motors });
        }
        let mut buffers = std::mem::take(&mut self.edges);
        self.fix_unmoved(edges, &mut buffers);
        for edges in edges.chunks(2 * motors * EDGES_PER_BATCH) {
            self.bisect_batch(edges, limits, &mut buffers);
            buffers.states.iter().for_each(&mut done);
        }
        self.edges = buffers;
        Ok(())
    }

    /// Sets motors that no edge moves to their positions in all lanes, so that what they carry is placed once.
    fn fix_unmoved(&mut self, edges: &[f64], all: &mut Edges) {
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
            // A position beyond its limit must be checked on every edge.
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

    fn bisect_batch(&mut self, edges: &[f64], (coarser, most_open): (u32, usize), all: &mut Edges) {
        let length = 2 * self.motors();
        all.states.clear();
        all.open.clear();
        all.units.clear();
        all.waiting.clear();
        for (e, edge) in edges.chunks_exact(length).enumerate() {
            let state = self.start(edge, &all.moving);
            if state.blocked.is_none_or(|b| b.at > 0.0 && coarser < MAX_LEVELS) {
                all.waiting.push((state.start, e as u32));
            }
            all.states.push(state);
        }
        all.waiting.sort_unstable_by(|a, b| b.cmp(a));
        let mut level = 0;
        while !all.open.is_empty() || !all.waiting.is_empty() {
            self.add_starting(level, all);
            all.next.clear();
            all.next_units.clear();
            let open = std::mem::take(&mut all.open);
            for block in open.chunks(WIDTH) {
                self.judge_block(edges, block, level, all);
            }
            all.open = open;
            bisect(all, level, (coarser, most_open));
            std::mem::swap(&mut all.units, &mut all.next_units);
            level += 1;
        }
    }

    /// Adds the edges that start at this level: all parts of them, with all units.
    fn add_starting(&self, level: u32, all: &mut Edges) {
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

    /// Checks limits and constraints, and computes the levels of the bisection.
    fn start(&self, edge: &[f64], moving: &[usize]) -> EdgeCheckState {
        let (from, to) = edge.split_at(self.motors());
        let travel: f64 = moving.iter().map(|m| (to[*m] - from[*m]).abs() * self.program.reach[*m]).sum();
        let violated = self.first_beyond_limits(from, to, moving).into_iter().chain(self.first_violation(from, to));
        let mut state = EdgeCheckState { start: 0, levels: 0, blocked: None, uncertified: None };
        for (at, sure) in violated {
            if sure && state.blocked.is_none_or(|b| at < b.at) {
                state.blocked = Some(Obstruction { at, pair: None });
            } else if !sure {
                state.uncertified = Some(at);
            }
        }
        if travel.is_finite() {
            let level = |half: f64| ((travel / 2.0 / half).log2().ceil().max(0.0) as u32).min(MAX_LEVELS);
            state.levels = level(RESOLUTION_M);
            state.start = level(MAX_TESTED_MOTION_M).min(MAX_START_LEVEL);
        }
        state
    }
}

/// Creates the next level: both halves of the unproved intervals, except those behind a contact. Intervals at the
/// resolution limit, and those of edges with too many, become uncertified.
fn bisect(all: &mut Edges, level: u32, (coarser, most_open): (u32, usize)) {
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
