//! How far solids move when motors do: bounds over all poses within the limits.
//!
//! A hinge that turns by an angle moves no point farther than that angle times the point's distance from its axis. That
//! distance depends on the hinges between; the ball that holds the point at every pose (`sweep.rs`) bounds it. The
//! radius of a capsule or a ball counts for nothing: turned or not, a ball is the same, so the core alone moves.
//!
//! ```text
//! common ── hinge ── hinge ── a      what moves `common` moves both alike and counts for neither
//!       └── hinge ── b
//! ```

use crate::bound::U;
use crate::chain::LaneFrame;
use crate::program::Lever;
use crate::sweep::{Sphere, common};
use std::collections::HashMap;
use std::ops::Range;

/// Rounding of a sum of levers times steps, and of what it is added to, in the lanes; as `bound.rs` has it, with room
/// for sixty motors.
const SUMS: f64 = 160.0 * U;

/// Something that moves as one: a ball around a group, around a region, or a solid.
#[derive(Clone, Debug)]
pub(crate) struct Mover {
    pub frame: usize,
    /// Balls that hold the extreme points of its cores, in its frame: no point of a core goes farther than the farthest
    /// of these.
    pub ends: Vec<Sphere>,
}

/// All movers of a scene, and the sums that were asked for.
#[derive(Clone, Debug, Default)]
pub(crate) struct Movers {
    pub frames: Vec<LaneFrame>,
    /// Balls of groups, of regions, then solids: as steps number them.
    pub movers: Vec<Mover>,
    known: HashMap<(usize, Option<usize>), u32>,
    /// One sum each: a range of levers. The first is empty.
    pub sums: Vec<Range<usize>>,
    pub levers: Vec<Lever>,
}

impl Movers {
    pub fn new(frames: Vec<LaneFrame>) -> Self {
        Movers { frames, sums: vec![0..0], ..Movers::default() }
    }

    /// The sums that bound how far two movers move against each other: one for each of them.
    pub fn between(&mut self, a: usize, b: usize) -> [u32; 2] {
        let common = common(&self.frames, self.movers[a].frame, self.movers[b].frame);
        [self.sum(a, common), self.sum(b, common)]
    }

    fn sum(&mut self, mover: usize, to: Option<usize>) -> u32 {
        if let Some(known) = self.known.get(&(mover, to)) {
            return *known;
        }
        let found = levers(&self.frames, &self.movers[mover], to);
        let sum = if found.is_empty() { 0 } else { self.sums.len() as u32 };
        if sum != 0 {
            let first = self.levers.len();
            self.levers.extend(found);
            self.sums.push(first..self.levers.len());
        }
        self.known.insert((mover, to), sum);
        sum
    }
}

/// How far a mover goes at most in frame `to` (which carries it; or else the world), motor by motor.
fn levers(frames: &[LaneFrame], mover: &Mover, to: Option<usize>) -> Vec<Lever> {
    let (mut ends, mut at) = (mover.ends.clone(), mover.frame);
    let mut levers: Vec<Lever> = Vec::new();
    while Some(at) != to {
        let Some(carried) = frames[at].carried.as_ref() else { break };
        let off_axis = ends.iter().map(|end| end.center.xy().norm() + end.radius).fold(0.0, f64::max);
        let way = if carried.slide.is_some() { 1.0 } else { off_axis };
        let (motor, reach) = (carried.joint.motor, (way * carried.joint.gain.abs() * (1.0 + SUMS)) as f32);
        match levers.iter_mut().find(|l| l.motor == motor) {
            Some(lever) => lever.reach += reach,
            None => levers.push(Lever { motor, reach }),
        }
        ends = ends.iter().map(|end| end.carried(carried)).collect();
        at = carried.parent;
    }
    levers
}
