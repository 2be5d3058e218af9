//! Bounds of the motion of solids with respect to the motors, over all poses within the limits.
//!
//! A revolute joint that rotates by an angle moves a point by at most that angle times the point's distance from its
//! axis. That distance depends on the joints between; the ball that contains the point at every pose (`sweep.rs`)
//! bounds it. The radius of a capsule or a ball is irrelevant: rotation does not change a ball, so only the core moves.
//!
//! ```text
//! common ── hinge ── hinge ── a      joints that move `common` move both alike and are ignored
//!       └── hinge ── b
//! ```

use crate::bound::U;
use crate::chain::LaneFrame;
use crate::program::{MotorLever, Relative};
use crate::sweep::{Sphere, common};
use std::ops::Range;

/// Relative rounding error of a sum of levers times steps, and of the value it is added to, in the lanes; as in
/// `bound.rs`, sufficient for sixty motors.
const SUMS: f64 = 160.0 * U;

/// A rigid thing: a ball around a group or a region, or a solid.
#[derive(Clone, Debug)]
pub(crate) struct Mover {
    pub frame: usize,
    /// Balls that contain the extreme points of its cores, in its frame: no point of a core moves farther than the
    /// farthest of these.
    pub ends: Vec<Sphere>,
}

/// Maximum distance of these balls' points from the origin of their frame, meters.
pub(crate) fn far(ends: &[Sphere]) -> f64 {
    ends.iter().map(|e| e.center.norm() + e.radius).fold(0.0, f64::max)
}

/// Maxima over the robots that bound the error of a point's velocity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slip {
    /// Distance of a mover's points from the origin of its frame, meters.
    size: f64,
    reach: f64,
    turn: f64,
    place: f64,
}

impl Slip {
    /// The bound, with objects whose points are no farther than this from the world's origin, meters.
    pub fn among(&self, objects: f64) -> f64 {
        let across = (2.0 * (self.reach + self.size.max(objects))).max(1.0);
        2.0 * self.turn * across + 2.0 * self.place + 1024.0 * U * across
    }
}

/// All movers of a scene, and the sums computed so far.
#[derive(Clone, Debug, Default)]
pub(crate) struct Movers {
    pub frames: Vec<LaneFrame>,
    /// Balls of groups, of regions, then solids, numbered as in the steps.
    pub movers: Vec<Mover>,
    /// Per mover: the frames for which its sum is computed, with the sum's index.
    known: Vec<Vec<(Option<usize>, u32)>>,
    /// One sum each: a range of levers. The first is empty.
    pub sums: Vec<Range<usize>>,
    pub levers: Vec<MotorLever>,
}

impl Movers {
    pub fn new(frames: Vec<LaneFrame>) -> Self {
        Movers { frames, sums: vec![Range::default()], ..Movers::default() }
    }

    /// The relative motion of two movers.
    pub fn between(&mut self, a: usize, b: usize) -> Relative {
        let common = common(&self.frames, self.movers[a].frame, self.movers[b].frame);
        let sums = [self.sum(a, common), self.sum(b, common)];
        // The world is the last frame.
        Relative { sums, common: common.unwrap_or(self.frames.len() - 1) as u32 }
    }

    /// The motion of a mover relative to the world.
    pub fn in_world(&mut self, mover: usize) -> Relative {
        // The world is the last frame.
        Relative { sums: [self.sum(mover, None), 0], common: (self.frames.len() - 1) as u32 }
    }

    /// Error bound of a point's velocity in the lanes, per radian or meter of joint motion: from the frames' errors,
    /// and from rounding along the chain.
    pub fn slip(&self) -> Slip {
        let size = self.movers.iter().map(|mover| far(&mover.ends)).fold(0.0, f64::max);
        let most = |of: fn(&LaneFrame) -> f64| self.frames.iter().map(of).fold(0.0, f64::max);
        Slip { size, reach: most(|f| f.bound.reach), turn: most(|f| f.bound.turn), place: most(|f| f.bound.place) }
    }

    fn sum(&mut self, mover: usize, to: Option<usize>) -> u32 {
        if self.known.len() <= mover {
            self.known.resize(self.movers.len().max(mover + 1), Vec::new());
        }
        if let Some((_, known)) = self.known[mover].iter().find(|(frame, _)| *frame == to) {
            return *known;
        }
        let found = levers(&self.frames, &self.movers[mover], to);
        let sum = if found.is_empty() { 0 } else { self.sums.len() as u32 };
        if sum != 0 {
            let first = self.levers.len();
            self.levers.extend(found);
            self.sums.push(first..self.levers.len());
        }
        self.known[mover].push((to, sum));
        sum
    }
}

/// Bounds of a mover's motion in frame `to` (which carries it; or else the world), joint by joint outward.
fn levers(frames: &[LaneFrame], mover: &Mover, to: Option<usize>) -> Vec<MotorLever> {
    let mut ends = mover.ends.clone();
    let mut at = mover.frame;
    let mut levers: Vec<MotorLever> = Vec::new();
    while Some(at) != to {
        let Some(carried) = frames[at].carried.as_ref() else { break };
        let off_axis = ends.iter().map(|end| end.center.xy().norm() + end.radius).fold(0.0, f64::max);
        let arm = if carried.slide.is_some() { 1.0 } else { off_axis };
        let gain = carried.joint.gain.abs() * (1.0 + SUMS);
        let turn = if carried.slide.is_some() { 0.0 } else { gain };
        levers.push(MotorLever { motor: carried.joint.motor, reach: (arm * gain) as f32, turn: turn as f32 });
        ends = ends.iter().map(|end| end.carried(carried)).collect();
        at = carried.parent;
    }
    levers.reverse();
    levers
}
