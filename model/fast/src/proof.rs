//! Proofs that pairs with a few joints between them stay apart at every pose, by bisecting the joints' ranges.
//!
//! `sweep.rs` computes one ball that contains a shape at every pose: sufficient for a head and a foot, but not for a
//! finger and the forearm, which can't meet at any wrist angle. Here ranges are bisected until in each part the shape's
//! balls are apart from the other shape, or until a pose is found at which they are not. A finger is first tested as a
//! whole.

use crate::chain::{Carried, LaneFrame};
use crate::solids::Sized;
use crate::sweep::{Sphere, above, common};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Maximum number of joints between the two. It affects only speed, as does the next constant: of 4, 5 and 6 this was
/// the best compromise.
const MAX_JOINTS: usize = 5;
/// Maximum number of parts per proof: for a whole finger or hand, and for one shape. Compiling an iCub takes three
/// quarters longer with it, but no finger is placed because of its own forearm.
const MAX_PARTS: [usize; 2] = [8192, 512];

/// Proofs about a scene's solids, for one distance, meters.
pub(crate) struct Proofs<'a> {
    frames: &'a [LaneFrame],
    sized: &'a [Sized],
    distance: f64,
    /// Per frame, computed on demand: ball that contains all that the frame carries, at every pose; in the frame.
    wholes: BTreeMap<usize, Sphere>,
    /// True if all that a frame carries stays apart from a solid.
    known: BTreeMap<(usize, usize), bool>,
}

/// A solid's bounding capsule: midpoint, half axis and radius, in its frame.
struct Capsule {
    middle: Vector3<f64>,
    half: Vector3<f64>,
    radius: f64,
}

impl Capsule {
    fn of(solid: &Sized) -> Self {
        let capsule = solid.shape.bounding_capsule();
        let middle = solid.pose.translation.vector;
        Capsule { middle, half: solid.pose.rotation * capsule.half_axis, radius: capsule.radius }
    }

    /// Distance of a point from its surface.
    fn distance(&self, point: &Vector3<f64>) -> f64 {
        let offset = point - self.middle;
        let along = offset.dot(&self.half) / self.half.norm_squared().max(1e-12);
        (offset - self.half * along.clamp(-1.0, 1.0)).norm() - self.radius
    }

    /// A few balls that contain it, slightly larger.
    fn balls(&self) -> Vec<Sphere> {
        let length = self.half.norm();
        if length < 1e-9 {
            return vec![Sphere { center: self.middle, radius: self.radius }];
        }
        let gaps = (length / self.radius.max(1e-3)).ceil().clamp(1.0, 4.0);
        let radius = self.radius.hypot(length / gaps);
        let center = |i: usize| self.middle + self.half * (2.0 * i as f64 / gaps - 1.0);
        (0..=gaps as usize).map(|i| Sphere { center: center(i), radius }).collect()
    }
}

/// One joint on the path from a shape to another: out of the frame that it carries, or into it.
pub(crate) struct Crossing {
    /// The constant transform between joint and parent.
    turn: Matrix3<f64>,
    shift: Vector3<f64>,
    slide: Option<Vector3<f64>>,
    into: bool,
}

/// A joint within a part of its range: `middle` plus or minus `half`.
#[derive(Clone, Copy, Default)]
pub(crate) struct JointInterval {
    pub middle: f64,
    pub half: f64,
    sine: f64,
    cosine: f64,
    /// Maximum displacement of a point at one meter from the axis, relative to its position at `middle`.
    chord: f64,
}

impl JointInterval {
    pub fn new(middle: f64, half: f64) -> Self {
        let (sine, cosine) = middle.sin_cos();
        JointInterval { middle, half, sine, cosine, chord: 2.0 * (half.min(PI) / 2.0).sin() }
    }
}

/// A part of all joints' ranges, and the ball at its midpoint: the distance from the other shape, the bound of its
/// decrease within the part, and the joint that contributes most to it.
#[derive(Clone, Copy)]
struct RangePart {
    joint_intervals: [JointInterval; MAX_JOINTS],
    distance: f64,
    spread: f64,
    widest: usize,
}

impl Crossing {
    fn new(carried: &Carried, into: bool) -> Self {
        let turn = *carried.before.rotation.to_rotation_matrix().matrix();
        Crossing { turn, shift: carried.before.translation.vector, slide: carried.slide, into }
    }

    /// Transforms a point to the next frame; returns it with the bound of its displacement within the part.
    pub fn cross(&self, point: Vector3<f64>, at: &JointInterval) -> (Vector3<f64>, f64) {
        let point = if self.into { self.turn.tr_mul(&(point - self.shift)) } else { point };
        let sign = if self.into { -1.0 } else { 1.0 };
        let (moved, spread) = match self.slide {
            // Along a direction of the parent's frame, with unchanged axes.
            Some(along) => (point + along * (sign * at.middle), at.half),
            None => {
                let (s, c) = (sign * at.sine, at.cosine);
                let turned = Vector3::new(c * point.x - s * point.y, s * point.x + c * point.y, point.z);
                (turned, at.chord * point.xy().norm())
            }
        };
        (if self.into { moved } else { self.turn * moved + self.shift }, spread)
    }
}

impl<'a> Proofs<'a> {
    pub fn new(frames: &'a [LaneFrame], sized: &'a [Sized], distance: f64) -> Self {
        Proofs { frames, sized, distance, wholes: BTreeMap::new(), known: BTreeMap::new() }
    }

    /// True if two solids are proved to stay apart.
    pub fn apart(&mut self, a: usize, b: usize) -> bool {
        let f = self.sized[a].frame;
        let g = self.sized[b].frame;
        let Some(common) = common(self.frames, f, g) else { return false };
        let depth = |frame: usize| above(self.frames, frame).take_while(|f| *f != common).count();
        // Follow the solid with more joints above the common frame.
        let (a, b) = if depth(f) >= depth(g) { (a, b) } else { (b, a) };
        let f = self.sized[a].frame;
        let g = self.sized[b].frame;
        let mut carriers: Vec<usize> = above(self.frames, f).take_while(|f| *f != common).collect();
        carriers.reverse();
        let other = Capsule::of(&self.sized[b]);
        for root in carriers {
            let known = self.known.get(&(root, b)).copied().unwrap_or_else(|| {
                let crossings = self.crossings(root, g);
                let known = !crossings.is_empty() && {
                    let whole = self.whole(root);
                    self.stays_apart(&whole, &crossings, &other, MAX_PARTS[0])
                };
                self.known.insert((root, b), known);
                known
            });
            if known {
                return true;
            }
        }
        let crossings = self.crossings(f, g);
        let is_apart = |ball: &Sphere| self.stays_apart(ball, &crossings, &other, MAX_PARTS[1]);
        !crossings.is_empty() && Capsule::of(&self.sized[a]).balls().iter().all(is_apart)
    }

    /// Ball that contains all that a frame carries.
    fn whole(&mut self, root: usize) -> Sphere {
        if let Some(known) = self.wholes.get(&root) {
            return *known;
        }
        let carried = self.sized.iter().filter(|s| above(self.frames, s.frame).any(|f| f == root));
        let balls: Vec<Sphere> = carried.map(|s| s.ball().swept(self.frames, s.frame, root)).collect();
        let whole = Sphere::around(&balls);
        self.wholes.insert(root, whole);
        whole
    }

    /// The joints between two frames of one robot; empty if they are too many.
    pub fn crossings(&self, from: usize, to: usize) -> Vec<(Crossing, JointInterval)> {
        let Some(common) = common(self.frames, from, to) else { return Vec::new() };
        let carriers = |frame: usize| {
            let below = above(self.frames, frame).take_while(move |f| *f != common);
            below.filter_map(|f| self.frames[f].carried.as_ref()).collect::<Vec<&Carried>>()
        };
        let up = carriers(from);
        let down = carriers(to);
        if up.len() + down.len() > MAX_JOINTS {
            return Vec::new();
        }
        let all = up.into_iter().map(|c| (c, false)).chain(down.into_iter().rev().map(|c| (c, true)));
        all.map(|(carried, into)| {
            let (low, high) = carried.range;
            (Crossing::new(carried, into), JointInterval::new((low + high) / 2.0, (high - low) / 2.0))
        })
        .collect()
    }

    /// True if a ball is proved to stay apart from a capsule across these joints.
    fn stays_apart(
        &self,
        ball: &Sphere,
        crossings: &[(Crossing, JointInterval)],
        other: &Capsule,
        most: usize,
    ) -> bool {
        let distance = self.distance + ball.radius;
        let part = |joint_intervals: [JointInterval; MAX_JOINTS]| {
            let mut point = ball.center;
            let mut spread = 0.0;
            let mut widest = (0.0, 0);
            for (i, ((crossing, _), joint_interval)) in crossings.iter().zip(&joint_intervals).enumerate() {
                let (next, more) = crossing.cross(point, joint_interval);
                point = next;
                spread += more;
                if more > widest.0 {
                    widest = (more, i);
                }
            }
            RangePart { joint_intervals, distance: other.distance(&point) - distance, spread, widest: widest.1 }
        };
        let mut whole = [JointInterval::default(); MAX_JOINTS];
        whole.iter_mut().zip(crossings).for_each(|(joint_interval, (_, range))| *joint_interval = *range);
        let mut parts = vec![part(whole)];
        for _ in 0..most {
            let Some(next) = parts.pop() else { return true };
            if next.distance <= 0.0 {
                return false;
            }
            if next.distance > next.spread {
                continue;
            }
            let JointInterval { middle, half, .. } = next.joint_intervals[next.widest];
            let [near, far] = [-0.5, 0.5].map(|side| {
                let mut joint_intervals = next.joint_intervals;
                joint_intervals[next.widest] = JointInterval::new(middle + side * half, half / 2.0);
                part(joint_intervals)
            });
            // The nearer half first, so that a contact is found early.
            let (near, far) = if near.distance < far.distance { (near, far) } else { (far, near) };
            parts.extend([far, near]);
        }
        false
    }
}
