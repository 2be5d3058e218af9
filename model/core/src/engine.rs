//! Interface between collision engines and the rest of the workspace.
//!
//! An [`Engine`] handles shapes on moving frames, and pairs of shapes by number. It has no notion of robots, objects or
//! scenes. A scene prepares the engine once, places it at the frames of a configuration and queries it:
//!
//! ```text
//! colliders ──prepare──> engine      frames of a pose ──place──> placement
//! engine + placement + pairs ──> contacts, clearance, free       engine + pairs + frames at each step ──> line
//! ```
//!
//! Engines are interchangeable by a type parameter: [`crate::Scene`], [`crate::Watch`] and [`crate::Field`] take one,
//! so that calls are static and the same tests run with each engine. [`DefaultEngine`] is the one used throughout the
//! workspace. An engine needs three functions ([`Engine::prepare`], [`Engine::place`], [`Engine::near`]). All others
//! have defaults, to be replaced if an engine can answer many pairs at once faster than one by one.

mod line;
mod scalar;

pub use line::{LineQuery, LineResult, SweptPair};
pub use scalar::ScalarEngine;
pub use scalar::distances_from_hull;

use crate::hull::Hull;
use crate::shape::{InnerCapsule, Shape};
use nalgebra::{Isometry3, Point3};
use std::fmt::Debug;
use std::sync::Arc;

/// Engine of a [`crate::Scene`] unless another one is given. This line selects the engine for the whole workspace.
pub type DefaultEngine = ScalarEngine;

/// A shape on one of the moving frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Collider {
    /// The shape.
    pub shape: Shape,
    /// Index of its frame in the list that [`Engine::place`] receives.
    pub frame: usize,
    /// `frame_from_shape`.
    pub pose: Isometry3<f64>,
    /// Solid part of the shape, in the frame; `None`: all of it. An engine that ignores hulls is conservative.
    hull: Option<Arc<Hull>>,
    /// A capsule inside the solid part. Computed once: for a hull it takes a tenth of a millisecond, and engines are
    /// prepared at every edit.
    inner: InnerCapsule,
}

impl Collider {
    /// A shape that is solid throughout.
    pub fn new(shape: Shape, frame: usize, pose: Isometry3<f64>) -> Self {
        Self { shape, frame, pose, hull: None, inner: shape.inner_capsule() }
    }

    /// Restricts the solid part to a hull within the shape, given in the frame; `None`: all of the shape.
    pub fn with_hull(mut self, hull: Option<Arc<Hull>>) -> Self {
        if let Some(hull) = &hull {
            self.inner = hull.inner_capsule(&self.shape.bounding_capsule(), &self.pose.inverse());
        }
        Self { hull, ..self }
    }

    /// Solid part of the shape, in the frame; `None`: all of it.
    pub fn hull(&self) -> Option<&Arc<Hull>> {
        self.hull.as_ref()
    }

    /// A capsule inside the solid part.
    pub fn inner_capsule(&self) -> InnerCapsule {
        self.inner
    }
}

/// Two colliders by their index in the list that the engine was prepared with.
pub type IndexPair = (u32, u32);

/// Signed distance of two shapes, with witness points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proximity {
    /// Signed distance in meters. If negative, its magnitude is the penetration depth: the length of the shortest
    /// translation that separates the shapes.
    pub distance: f64,
    /// The nearest (or deepest) points on the first and the second shape, world frame.
    pub points: [Point3<f64>; 2],
}

/// A pair of colliders and its proximity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairProximity {
    /// The two colliders.
    pub pair: IndexPair,
    /// Their distance and witness points.
    pub proximity: Proximity,
}

/// Result for a pair if only distances up to a cap matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Near {
    /// The signed distance is at most the cap, and was measured.
    Within(Proximity),
    /// Lower bound of the signed distance, in meters, not below the cap. If it equals the cap, no cheap bound was
    /// sufficient and the pair had to be measured.
    Beyond(f64),
}

/// A collision engine: prepared shapes, and distance queries between them.
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
/// The engine itself stores the prepared shapes. All that depends on the configuration is in [`Engine::Placement`];
/// there may be many placements.
///
/// # Promises
/// Every engine must pass the same tests (`tests/it/engines.rs`): distances are signed, in meters; [`Near::Beyond`]
/// never exceeds the true distance; the result for a pair is a function of its two shapes and frames alone, independent
/// of earlier queries. Callers rely on the last: a [`crate::Watch`] reuses a result until motion can have changed it.
pub trait Engine: Clone + Debug + Send + Sync + 'static {
    /// The shapes at one configuration. A default one fits every engine of its kind; reuse must not allocate.
    type Placement: Clone + Debug + Default + Send + Sync;

    /// Prepares the shapes. Pairs refer to them by their index in this list. Called once per scene, so it may be slow.
    fn prepare(colliders: &[Collider]) -> Self;

    /// As [`Engine::prepare`], given an engine that was prepared with the first `kept` of these shapes, perhaps among
    /// others: an engine may share what it derived from them.
    fn prepare_after<'a>(&self, _kept: usize, colliders: impl Iterator<Item = &'a Collider>) -> Self {
        Self::prepare(&colliders.cloned().collect::<Vec<_>>())
    }

    /// Places all shapes, given `world_from_frame` of all frames.
    fn place(&self, world_from_frame: &[Isometry3<f64>], placement: &mut Self::Placement);

    /// Proximity of a pair, measured exactly only if it is within `cap` meters.
    fn near(&self, placement: &Self::Placement, pair: IndexPair, cap: f64) -> Near;

    /// As [`Engine::place`], for callers that will query few pairs: stores the frames; [`Engine::place_pair`] then
    /// places the shapes.
    fn place_frames(&self, world_from_frame: &[Isometry3<f64>], placement: &mut Self::Placement) {
        self.place(world_from_frame, placement);
    }

    /// Places the shapes of one pair. Call it after [`Engine::place_frames`] and before [`Engine::near`].
    fn place_pair(&self, _placement: &mut Self::Placement, _pair: IndexPair) {}

    /// True if the signed distance of a pair is at most `clearance` meters.
    fn touches(&self, placement: &Self::Placement, pair: IndexPair, clearance: f64) -> bool {
        matches!(self.near(placement, pair, clearance), Near::Within(_))
    }

    /// The pairs nearer than `within` meters and all touching pairs, in the order of `pairs`.
    fn contacts(&self, placement: &Self::Placement, pairs: &[IndexPair], within: f64) -> Vec<PairProximity> {
        // Starts without capacity: at nearly every configuration of a working robot there are no contacts, so nothing
        // is allocated.
        let mut found = Vec::new();
        for &pair in pairs {
            // A distance equal to the margin is free, touching is not: a margin of zero still reports touching pairs.
            if let Near::Within(proximity) = self.near(placement, pair, within)
                && (proximity.distance < within || proximity.distance <= 0.0)
            {
                found.push(PairProximity { pair, proximity });
            }
        }
        found
    }

    /// The nearest pair, if any is within `cap` meters; if several are equally near, the first of them.
    fn clearance(&self, placement: &Self::Placement, pairs: &[IndexPair], cap: f64) -> Option<PairProximity> {
        let mut nearest: Option<PairProximity> = None;
        for &pair in pairs {
            // The best distance so far is the cap for the next pair: most pairs then end at their cheapest bound.
            let cap = nearest.map_or(cap, |n| n.proximity.distance);
            if let Near::Within(proximity) = self.near(placement, pair, cap)
                && nearest.is_none_or(|n| proximity.distance < n.proximity.distance)
            {
                nearest = Some(PairProximity { pair, proximity });
            }
        }
        nearest
    }

    /// True if all pairs are farther apart than `clearance` meters. Stops at the first pair that is not.
    fn free(&self, placement: &Self::Placement, mut pairs: impl Iterator<Item = IndexPair>, clearance: f64) -> bool {
        !pairs.any(|pair| self.touches(placement, pair, clearance))
    }

    /// Checks a motion sampled in equal steps. `frames_at` writes `world_from_frame` of all frames at a step, and is
    /// called with ascending steps.
    fn line(&self, query: &LineQuery<'_>, frames_at: impl FnMut(u32, &mut Vec<Isometry3<f64>>)) -> LineResult {
        line::advance(self, query, frames_at)
    }

    /// The signed distance of two shapes, without a cap. For tests and tools: it prepares both shapes at every call.
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
/// The distance in meters, zero or less if the shapes collide, and the witness points in the world frame.
///
/// # Example
/// ```
/// use mobee_model::{Shape, distance};
/// use nalgebra::{Isometry3, Vector3};
///
/// let ball = Shape::Sphere { radius: 0.1 };
/// let plate = Shape::Box { size: Vector3::new(1.0, 0.02, 1.0) };
/// let above = distance(&ball, &Isometry3::translation(0.0, 0.15, 0.0), &plate, &Isometry3::identity());
/// assert!((above.distance - 0.04).abs() < 1e-12);
/// // Deep in the plate: the shortest separating translation is upward, by the ball's radius and half the plate.
/// let within = distance(&ball, &Isometry3::identity(), &plate, &Isometry3::identity());
/// assert!((within.distance + 0.11).abs() < 1e-12);
/// ```
///
/// # Accuracy
/// Measured (`tests/it/distance_pairs.rs`: balls, capsules, cylinders, boxes, a 1 mm plate of 1 x 1.5 m, a post and a
/// coin, each against each, bracketed from both sides). Apart: the error is below 1e-12 m without cylinders and below
/// 1e-6 m with them (GJK alone: 4e-6 m). Overlapping: no direction was found that separates a pair by a translation
/// shorter than the depth less 1e-8 m. Cylinders with touching cores are resolved to about 1e-7 m.
pub fn distance(a: &Shape, world_from_a: &Isometry3<f64>, b: &Shape, world_from_b: &Isometry3<f64>) -> Proximity {
    DefaultEngine::distance(a, world_from_a, b, world_from_b)
}
