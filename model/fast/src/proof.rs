//! Pairs that a few joints stand between: kept apart at every pose, or not, by halving the joints' ranges.
//!
//! `sweep.rs` asks for one ball that holds a shape at every pose: enough for a head and a foot, but not for a finger and
//! the forearm, which no bent wrist brings together. Here ranges are halved until in each part the shape's balls are
//! apart from the other shape, or until a pose is found at which they are not. A finger is asked about as a whole first.

use crate::chain::{Carried, LaneFrame};
use crate::compile::Sized;
use crate::sweep::{Sphere, above, common};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::PI;

/// Most joints between the two. A matter of speed alone, as what follows: of 4, 5 and 6 this was the best for what it
/// costs.
const JOINTS: usize = 5;
/// Most parts looked at for one proof, of a whole finger or hand, and of one shape. An iCub compiles in three quarters
/// more time for it, and no finger is placed for its own forearm's sake.
const PARTS: [usize; 2] = [8192, 512];

/// What has been proved of a scene's solids, for one distance, meters.
pub(crate) struct Proofs<'a> {
    frames: &'a [LaneFrame],
    sized: &'a [Sized],
    distance: f64,
    /// Per frame, once it was asked for: holds all that it carries, at every pose; in the frame.
    wholes: BTreeMap<usize, Sphere>,
    /// Whether all that a frame carries keeps apart from a solid.
    known: BTreeMap<(usize, usize), bool>,
}

/// A solid's bounding capsule: middle, half axis and radius, in its frame.
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

    /// How far its surface is from a point.
    fn distance(&self, point: &Vector3<f64>) -> f64 {
        let way = point - self.middle;
        let along = way.dot(&self.half) / self.half.norm_squared().max(1e-12);
        (way - self.half * along.clamp(-1.0, 1.0)).norm() - self.radius
    }

    /// Balls that hold it: few of them, little larger.
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

/// One joint on the way from a shape to another: out of the frame that it carries, or into it.
pub(crate) struct Crossing {
    /// What stands between joint and parent.
    turn: Matrix3<f64>,
    shift: Vector3<f64>,
    slide: Option<Vector3<f64>>,
    into: bool,
}

/// A joint within a part of its range: `middle` give or take `half`.
#[derive(Clone, Copy, Default)]
pub(crate) struct Stance {
    pub middle: f64,
    pub half: f64,
    sine: f64,
    cosine: f64,
    /// How far a point at one meter from the axis is from where it is in the middle, at most.
    chord: f64,
}

impl Stance {
    pub fn new(middle: f64, half: f64) -> Self {
        let (sine, cosine) = middle.sin_cos();
        Stance { middle, half, sine, cosine, chord: 2.0 * (half.min(PI) / 2.0).sin() }
    }
}

/// A part of all joints' ranges, and the ball in its middle: how far that is from the other shape, how much nearer it may
/// be elsewhere in the part, and which joint has most to do with it.
#[derive(Clone, Copy)]
struct Part {
    stances: [Stance; JOINTS],
    distance: f64,
    spread: f64,
    widest: usize,
}

impl Crossing {
    fn new(carried: &Carried, into: bool) -> Self {
        let turn = *carried.before.rotation.to_rotation_matrix().matrix();
        Crossing { turn, shift: carried.before.translation.vector, slide: carried.slide, into }
    }

    /// A point in the next frame, and how far it is from there at most.
    pub fn cross(&self, point: Vector3<f64>, at: &Stance) -> (Vector3<f64>, f64) {
        let point = if self.into { self.turn.tr_mul(&(point - self.shift)) } else { point };
        let sign = if self.into { -1.0 } else { 1.0 };
        let (moved, spread) = match self.slide {
            // Along a direction of the parent's frame, whose axes it keeps.
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

    /// Whether two solids are proved to keep apart.
    pub fn apart(&mut self, a: usize, b: usize) -> bool {
        let (f, g) = (self.sized[a].frame, self.sized[b].frame);
        let Some(common) = common(self.frames, f, g) else { return false };
        let depth = |frame: usize| above(self.frames, frame).take_while(|f| *f != common).count();
        // The one that more joints move is the one that is followed.
        let (a, b) = if depth(f) >= depth(g) { (a, b) } else { (b, a) };
        let (f, g) = (self.sized[a].frame, self.sized[b].frame);
        let mut carriers: Vec<usize> = above(self.frames, f).take_while(|f| *f != common).collect();
        carriers.reverse();
        let other = Capsule::of(&self.sized[b]);
        for root in carriers {
            let known = self.known.get(&(root, b)).copied().unwrap_or_else(|| {
                let crossings = self.crossings(root, g);
                let known = !crossings.is_empty() && {
                    let whole = self.whole(root);
                    self.keeps_apart(&whole, &crossings, &other, PARTS[0])
                };
                self.known.insert((root, b), known);
                known
            });
            if known {
                return true;
            }
        }
        let crossings = self.crossings(f, g);
        let keeps = |ball: &Sphere| self.keeps_apart(ball, &crossings, &other, PARTS[1]);
        !crossings.is_empty() && Capsule::of(&self.sized[a]).balls().iter().all(keeps)
    }

    /// Holds all that a frame carries.
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

    /// The joints between two frames of one robot, none if they are too many.
    pub fn crossings(&self, from: usize, to: usize) -> Vec<(Crossing, Stance)> {
        let Some(common) = common(self.frames, from, to) else { return Vec::new() };
        let carriers = |frame: usize| {
            let below = above(self.frames, frame).take_while(move |f| *f != common);
            below.filter_map(|f| self.frames[f].carried.as_ref()).collect::<Vec<&Carried>>()
        };
        let (up, down) = (carriers(from), carriers(to));
        if up.len() + down.len() > JOINTS {
            return Vec::new();
        }
        let all = up.into_iter().map(|c| (c, false)).chain(down.into_iter().rev().map(|c| (c, true)));
        all.map(|(carried, into)| {
            let (low, high) = carried.range;
            (Crossing::new(carried, into), Stance::new((low + high) / 2.0, (high - low) / 2.0))
        })
        .collect()
    }

    /// Whether a ball keeps apart from a capsule across these joints.
    fn keeps_apart(&self, ball: &Sphere, crossings: &[(Crossing, Stance)], other: &Capsule, most: usize) -> bool {
        let distance = self.distance + ball.radius;
        let part = |stances: [Stance; JOINTS]| {
            let (mut point, mut spread, mut widest) = (ball.center, 0.0, (0.0, 0));
            for (i, ((crossing, _), stance)) in crossings.iter().zip(&stances).enumerate() {
                let (next, more) = crossing.cross(point, stance);
                (point, spread) = (next, spread + more);
                if more > widest.0 {
                    widest = (more, i);
                }
            }
            Part { stances, distance: other.distance(&point) - distance, spread, widest: widest.1 }
        };
        let mut whole = [Stance::default(); JOINTS];
        whole.iter_mut().zip(crossings).for_each(|(stance, (_, range))| *stance = *range);
        let mut parts = vec![part(whole)];
        for _ in 0..most {
            let Some(next) = parts.pop() else { return true };
            if next.distance <= 0.0 {
                return false;
            }
            if next.distance > next.spread {
                continue;
            }
            let Stance { middle, half, .. } = next.stances[next.widest];
            let [near, far] = [-0.5, 0.5].map(|side| {
                let mut stances = next.stances;
                stances[next.widest] = Stance::new(middle + side * half, half / 2.0);
                part(stances)
            });
            // The nearer half first: a contact is found soon.
            let (near, far) = if near.distance < far.distance { (near, far) } else { (far, near) };
            parts.extend([far, near]);
        }
        false
    }
}
