//! Scalar engine: rejects pair by pair first, then measures exact distances by closed forms and parry's GJK and EPA.
//!
//! The rejection tests are ordered by cost: bounding balls (one square root), the center of one shape against the other
//! if that is a box, then the bounding capsules. At random configurations of a humanoid all but a few percent of the
//! pairs are rejected.

mod closed;
mod exact;
mod form;
mod gjk;
mod overlap;
mod support;

pub use support::distances_from_hull;

use super::{Collider, Engine, IndexPair, Near, Proximity};
use crate::shape::Shape;
use crate::shared_list::SharedList;
use closed::{Segment, segments_squared};

use exact::distance_within;
use form::Form;
use nalgebra::{Isometry3, Point3, Vector3};

/// Collision engine that handles one pair at a time, in `f64`.
#[derive(Clone, Debug)]
pub struct ScalarEngine {
    /// In the order of the colliders; pairs are indices into this list.
    solids: SharedList<PreparedSolid>,
}

/// A prepared collider.
#[derive(Clone, Debug)]
struct PreparedSolid {
    /// Its shape, prepared.
    form: Form,
    /// Index of its frame.
    frame: usize,
    /// `frame_from_shape`.
    pose: Isometry3<f64>,
    /// Half the axis of its outer capsule, in its frame: rotated once here instead of at every configuration.
    half_axis: Vector3<f64>,
}

impl PreparedSolid {
    fn new(c: &Collider) -> Self {
        let form = Form::new(&c.shape);
        let form = match c.hull() {
            Some(hull) => form.hollowed(hull, &c.pose.inverse(), c.inner_capsule()),
            None => form,
        };
        let half_axis = c.pose.rotation * form.outer.half_axis;
        PreparedSolid { form, frame: c.frame, pose: c.pose, half_axis }
    }
}

/// The solids of a [`ScalarEngine`] at one configuration.
#[derive(Clone, Debug, Default)]
pub struct Placement {
    /// `world_from_frame`.
    frames: Vec<Isometry3<f64>>,
    /// Per solid: the axis of its outer capsule, world frame. The bounds need no more, and it costs half of a full
    /// pose. Full poses are computed only for the few pairs that are measured.
    axes: Vec<Segment>,
}

impl Engine for ScalarEngine {
    type Placement = Placement;

    fn prepare(colliders: &[Collider]) -> Self {
        ScalarEngine { solids: SharedList::new(colliders.iter().map(PreparedSolid::new)) }
    }

    fn prepare_after<'a>(&self, kept: usize, colliders: impl Iterator<Item = &'a Collider>) -> Self {
        if kept == self.solids.shared_len() {
            return ScalarEngine { solids: self.solids.followed_by(colliders.skip(kept).map(PreparedSolid::new)) };
        }
        ScalarEngine { solids: SharedList::new(colliders.map(PreparedSolid::new)) }
    }

    fn place(&self, world_from_frame: &[Isometry3<f64>], placement: &mut Placement) {
        placement.set_frames(world_from_frame);
        let frames = &placement.frames;
        placement.axes.clear();
        placement.axes.extend(self.solids.iter().map(|solid| solid.axis(frames)));
    }

    fn place_frames(&self, world_from_frame: &[Isometry3<f64>], placement: &mut Placement) {
        placement.set_frames(world_from_frame);
        // Existing axes may belong to an older configuration: `place_pair` updates the two that `near` reads.
        placement.axes.resize(self.solids.len(), Segment::default());
    }

    fn place_pair(&self, placement: &mut Placement, (i, j): IndexPair) {
        for k in [i as usize, j as usize] {
            placement.axes[k] = self.solids[k].axis(&placement.frames);
        }
    }

    fn near(&self, placement: &Placement, pair: IndexPair, cap: f64) -> Near {
        let bound = self.bound(placement, pair, cap);
        if bound > cap {
            return Near::Beyond(bound);
        }
        self.measure(placement, pair, cap).map_or(Near::Beyond(cap), Near::Within)
    }

    fn touches(&self, placement: &Placement, pair: IndexPair, clearance: f64) -> bool {
        if self.bound(placement, pair, clearance) > clearance {
            return false;
        }
        let i = pair.0 as usize;
        let j = pair.1 as usize;
        let a = &self.solids[i].form;
        let b = &self.solids[j].form;
        // The bound by outer capsules is the distance itself if both shapes are capsules.
        if a.is_capsule() && b.is_capsule() {
            return true;
        }
        // If capsules inside the shapes touch, no measurement is needed: a yes-or-no query has no use for the depth.
        let inner_a = a.inner(&placement.axes[i]);
        let inner_b = b.inner(&placement.axes[j]);
        if segments_squared(&inner_a, &inner_b).sqrt() - a.inner.radius - b.inner.radius <= clearance {
            return true;
        }
        self.measure(placement, pair, clearance).is_some()
    }

    /// Measures exactly at once: without a cap there is nothing to reject.
    fn distance(a: &Shape, world_from_a: &Isometry3<f64>, b: &Shape, world_from_b: &Isometry3<f64>) -> Proximity {
        let a = Form::new(a);
        let b = Form::new(b);
        distance_within(&a, world_from_a, &b, world_from_b, f64::INFINITY).unwrap_or(Proximity {
            distance: f64::INFINITY,
            points: [world_from_a.translation.vector.into(), world_from_b.translation.vector.into()],
        })
    }
}

impl ScalarEngine {
    /// A lower bound of the signed distance of the pair, meters; stops refining as soon as it exceeds `enough`.
    fn bound(&self, placement: &Placement, (i, j): IndexPair, enough: f64) -> f64 {
        let i = i as usize;
        let j = j as usize;
        let a = &self.solids[i].form;
        let b = &self.solids[j].form;
        let axis_a = &placement.axes[i];
        let axis_b = &placement.axes[j];
        let between = (axis_a.middle - axis_b.middle).norm();
        let mut best = between - a.ball - b.ball;
        if best > enough {
            return best;
        }
        // The ball and capsule around a box such as a table or a wall are far too large: the other shape's ball against
        // the box itself gives a tighter bound.
        if let Some(half) = a.boxed {
            best = best.max(outside(&half, &self.pose(placement, i), &axis_b.middle) - b.ball);
        }
        if let Some(half) = b.boxed {
            best = best.max(outside(&half, &self.pose(placement, j), &axis_a.middle) - a.ball);
        }
        if best > enough {
            return best;
        }
        best.max(segments_squared(axis_a, axis_b).sqrt() - a.outer.radius - b.outer.radius)
    }

    /// The exactly measured pair, if its signed distance is at most `cap` meters.
    fn measure(&self, placement: &Placement, (i, j): IndexPair, cap: f64) -> Option<Proximity> {
        let i = i as usize;
        let j = j as usize;
        let pose_a = self.pose(placement, i);
        let pose_b = self.pose(placement, j);
        distance_within(&self.solids[i].form, &pose_a, &self.solids[j].form, &pose_b, cap)
    }

    /// `world_from_shape`.
    fn pose(&self, placement: &Placement, i: usize) -> Isometry3<f64> {
        placement.frames[self.solids[i].frame] * self.solids[i].pose
    }
}

impl PreparedSolid {
    /// The axis of its outer capsule, world frame.
    fn axis(&self, frames: &[Isometry3<f64>]) -> Segment {
        let frame = &frames[self.frame];
        Segment {
            middle: frame * Point3::from(self.pose.translation.vector),
            half_axis: frame.rotation * self.half_axis,
        }
    }
}

impl Placement {
    /// Copies the frames: the caller reuses its own list for the next configuration.
    fn set_frames(&mut self, world_from_frame: &[Isometry3<f64>]) {
        self.frames.clear();
        self.frames.extend_from_slice(world_from_frame);
    }
}

/// Distance of a point from a box, meters; minus infinity if the point is inside, since this gives no depth.
fn outside(half: &Vector3<f64>, world_from_box: &Isometry3<f64>, point: &Point3<f64>) -> f64 {
    let p = world_from_box.inverse_transform_point(point).coords.abs() - half;
    let distance = p.sup(&Vector3::zeros()).norm();
    if distance > 0.0 { distance } else { f64::NEG_INFINITY }
}
