//! The door to collision: what the rest of the house asks about shapes, and what an engine must answer.
//!
//! An [`Engine`] knows shapes on moving frames and pairs of them by number, and nothing of robots, objects or scenes. A scene
//! prepares it once, places it at the frames of a pose and asks:
//!
//! ```text
//! colliders ──prepare──> engine      frames of a pose ──place──> placement
//! engine + placement + pairs ──> contacts, clearance, free       engine + pairs + frames at each step ──> line
//! ```
//!
//! Engines stand side by side by a type parameter: [`crate::Scene`], [`crate::Watch`] and [`crate::Field`] take one, so that the
//! calls are static and the same tests run with each. [`DefaultEngine`] is the one that the house uses. An engine needs three
//! functions ([`Engine::prepare`], [`Engine::place`], [`Engine::near`]); everything else has a default, to be replaced where many
//! pairs at once can be answered faster than one by one.

mod line;
mod scalar;

pub use line::{LineQuery, LineResult, SweptPair};
pub use scalar::ScalarEngine;
pub(crate) use scalar::distances_from_hull;

use crate::hull::Hull;
use crate::shape::{InnerCapsule, Shape};
use nalgebra::{Isometry3, Point3};
use std::fmt::Debug;
use std::sync::Arc;

/// The engine that a [`crate::Scene`] has unless it is told another: this line chooses for the whole house.
pub type DefaultEngine = ScalarEngine;

/// A shape on one of the frames that a pose moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Collider {
    /// The shape.
    pub shape: Shape,
    /// Index of its frame among those that the engine is placed by.
    pub frame: usize,
    /// `frame_from_shape`.
    pub pose: Isometry3<f64>,
    /// What of the shape is solid, in the frame; all of it without. An engine that knows no hulls is on the safe side.
    hull: Option<Arc<Hull>>,
    /// A capsule within what is solid: found once, as a hull's takes a tenth of a millisecond, and engines are prepared at every edit.
    inner: InnerCapsule,
}

impl Collider {
    /// A shape that is solid throughout.
    pub fn new(shape: Shape, frame: usize, pose: Isometry3<f64>) -> Self {
        Self { shape, frame, pose, hull: None, inner: shape.inner_capsule() }
    }

    /// Only a hull within the shape is solid, if there is one; given in the frame.
    pub fn with_hull(mut self, hull: Option<Arc<Hull>>) -> Self {
        if let Some(hull) = &hull {
            self.inner = hull.inner_capsule(&self.shape.bounding_capsule(), &self.pose.inverse());
        }
        Self { hull, ..self }
    }

    /// What of the shape is solid, in the frame; `None`: all of it.
    pub fn hull(&self) -> Option<&Arc<Hull>> {
        self.hull.as_ref()
    }

    /// A capsule within what is solid.
    pub fn inner_capsule(&self) -> InnerCapsule {
        self.inner
    }
}

/// Two colliders by their index in the list that the engine was prepared with.
pub type IndexPair = (u32, u32);

/// How near two shapes are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proximity {
    /// Signed distance in meters; negative is the penetration depth: the length of the shortest translation that parts
    /// the shapes.
    pub distance: f64,
    /// The nearest (or deepest) points on the first and the second shape, world frame.
    pub points: [Point3<f64>; 2],
}

/// A pair of colliders and how near they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairProximity {
    /// Which two.
    pub pair: IndexPair,
    /// How near.
    pub proximity: Proximity,
}

/// What an engine says of a pair when only distances up to a cap matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Near {
    /// The signed distance is at most the cap: measured.
    Within(Proximity),
    /// The signed distance is surely not below this number of meters, which is not below the cap. The cap itself means that
    /// no cheap bound could tell and the pair had to be measured.
    Beyond(f64),
}

/// Prepared shapes, and the answers to who is how near whom.
///
/// # Example
/// ```
/// use mobee_model::{Collider, Engine, Near, ScalarEngine, Shape};
/// use nalgebra::Isometry3;
///
/// // Two balls on a frame each: the first is the world's, the second moves.
/// let ball = |frame| Collider::new(Shape::Sphere { radius: 0.1 }, frame, Isometry3::identity());
/// let engine = ScalarEngine::prepare(&[ball(0), ball(1)]);
/// let mut placement = Default::default();
/// engine.place(&[Isometry3::identity(), Isometry3::translation(0.25, 0.0, 0.0)], &mut placement);
///
/// let Near::Within(near) = engine.near(&placement, (0, 1), 0.1) else { panic!("5 cm apart") };
/// assert!((near.distance - 0.05).abs() < 1e-12);
/// assert!(matches!(engine.near(&placement, (0, 1), 0.01), Near::Beyond(distance) if distance <= near.distance));
/// assert!(engine.contacts(&placement, &[(0, 1)], 0.0).is_empty());
/// ```
///
/// The value itself holds the prepared shapes; what depends on a pose is in [`Engine::Placement`], of which there may be many.
///
/// # Promises
/// Every engine runs through the same tests (`tests/it/engines.rs`) and must keep what they ask: distances are signed, meters;
/// [`Near::Beyond`] never lies above the true distance; the answer for a pair is a function of its two shapes and frames
/// alone, whatever was asked before. Callers build on the last: a [`crate::Watch`] keeps what it was told until motion can have
/// changed it.
pub trait Engine: Clone + Debug + Send + Sync + 'static {
    /// The shapes at one pose. A fresh one fits every engine of its kind; used again it must not allocate.
    type Placement: Clone + Debug + Default + Send + Sync;

    /// Takes the shapes in; pairs name them by their place in this list. Called once per scene, so it may take its time.
    fn prepare(colliders: &[Collider]) -> Self;

    /// Puts every shape in its place, given `world_from_frame` of all frames.
    fn place(&self, world_from_frame: &[Isometry3<f64>], placement: &mut Self::Placement);

    /// How near a pair is, measured exactly only if that is within `cap` meters.
    fn near(&self, placement: &Self::Placement, pair: IndexPair, cap: f64) -> Near;

    /// As [`Engine::place`] for callers that will look at few pairs: takes the frames in, and the shapes follow by
    /// [`Engine::place_pair`].
    fn place_frames(&self, world_from_frame: &[Isometry3<f64>], placement: &mut Self::Placement) {
        self.place(world_from_frame, placement);
    }

    /// Puts the shapes of one pair in their places, after [`Engine::place_frames`] and before [`Engine::near`].
    fn place_pair(&self, _placement: &mut Self::Placement, _pair: IndexPair) {}

    /// Whether the signed distance of a pair is at most `clearance` meters.
    fn touches(&self, placement: &Self::Placement, pair: IndexPair, clearance: f64) -> bool {
        matches!(self.near(placement, pair, clearance), Near::Within(_))
    }

    /// The pairs nearer than `within` meters, and all that touch, in the order of `pairs`.
    fn contacts(&self, placement: &Self::Placement, pairs: &[IndexPair], within: f64) -> Vec<PairProximity> {
        // Grows from nothing: at nearly every pose of a robot that works there are no contacts, and no allocation either.
        let mut found = Vec::new();
        for &pair in pairs {
            // The margin itself is free and touching is not, so that a margin of zero still reports what touches.
            if let Near::Within(proximity) = self.near(placement, pair, within)
                && (proximity.distance < within || proximity.distance <= 0.0)
            {
                found.push(PairProximity { pair, proximity });
            }
        }
        found
    }

    /// The nearest pair, if any is within `cap` meters; of equally near ones the first.
    fn clearance(&self, placement: &Self::Placement, pairs: &[IndexPair], cap: f64) -> Option<PairProximity> {
        let mut nearest: Option<PairProximity> = None;
        for &pair in pairs {
            // The best so far is the next one's cap: most pairs then end at their cheapest bound.
            let cap = nearest.map_or(cap, |n| n.proximity.distance);
            if let Near::Within(proximity) = self.near(placement, pair, cap)
                && nearest.is_none_or(|n| proximity.distance < n.proximity.distance)
            {
                nearest = Some(PairProximity { pair, proximity });
            }
        }
        nearest
    }

    /// Whether all pairs are farther apart than `clearance` meters. Stops at the first that is not.
    fn free(&self, placement: &Self::Placement, mut pairs: impl Iterator<Item = IndexPair>, clearance: f64) -> bool {
        !pairs.any(|pair| self.touches(placement, pair, clearance))
    }

    /// Judges a motion sampled in equal steps; `frames_at` fills in `world_from_frame` of all frames at a step, and is asked in
    /// ascending order.
    fn line(&self, query: &LineQuery<'_>, frames_at: impl FnMut(u32, &mut Vec<Isometry3<f64>>)) -> LineResult {
        line::advance(self, query, frames_at)
    }

    /// The signed distance of two shapes where they are, whatever it is. For tests and tools: it prepares both anew.
    fn distance(a: &Shape, world_from_a: &Isometry3<f64>, b: &Shape, world_from_b: &Isometry3<f64>) -> Proximity {
        let on_frame = |shape: &Shape, frame| Collider::new(*shape, frame, Isometry3::identity());
        let engine = Self::prepare(&[on_frame(a, 0), on_frame(b, 1)]);
        let mut placement = Self::Placement::default();
        engine.place(&[*world_from_a, *world_from_b], &mut placement);
        match engine.near(&placement, (0, 1), f64::INFINITY) {
            Near::Within(proximity) => proximity,
            Near::Beyond(distance) => Proximity {
                distance,
                points: [world_from_a.translation.vector.into(), world_from_b.translation.vector.into()],
            },
        }
    }
}

/// The signed distance between shape `a` at `world_from_a` and shape `b` at `world_from_b`, by the [`DefaultEngine`].
///
/// # Returns
/// The distance in meters, zero or less where the shapes collide, and the witness points in the world frame.
///
/// # Example
/// ```
/// use mobee_model::{Shape, distance};
/// use nalgebra::{Isometry3, Vector3};
///
/// let (ball, plate) = (Shape::Sphere { radius: 0.1 }, Shape::Box { size: Vector3::new(1.0, 0.02, 1.0) });
/// let above = distance(&ball, &Isometry3::translation(0.0, 0.15, 0.0), &plate, &Isometry3::identity());
/// assert!((above.distance - 0.04).abs() < 1e-12);
/// // Deep in the plate: the shortest way out is up, by the ball's radius and half the plate.
/// let within = distance(&ball, &Isometry3::identity(), &plate, &Isometry3::identity());
/// assert!((within.distance + 0.11).abs() < 1e-12);
/// ```
///
/// # Accuracy
/// Measured (`tests/it/distance_pairs.rs`: balls, capsules, cylinders, boxes, a 1 mm plate of 1 x 1.5 m, a post and a coin, each
/// against each, bracketed from both sides): apart, the error is below 1e-12 m without cylinders and below 1e-6 m with them
/// (GJK alone: 4e-6 m); overlapping, no direction was found that parts a pair by a shorter way than the depth less
/// 1e-8 m. Where cores touch, cylinders are told apart to about 1e-7 m.
pub fn distance(a: &Shape, world_from_a: &Isometry3<f64>, b: &Shape, world_from_b: &Isometry3<f64>) -> Proximity {
    DefaultEngine::distance(a, world_from_a, b, world_from_b)
}
