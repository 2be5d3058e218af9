//! Tests of two engines: the default one, and a reference engine that consists only of parry's queries.
//!
//! `for_every_engine!` applies each test to each engine. Another engine needs one more file like the `Parry` here, and
//! one more line in the macro.

use mobee_model::{Collider, Engine, IndexPair, Near, Proximity, Shape};
use nalgebra::{Isometry3, Point3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, SharedShape};

/// Generates tests from functions with one type parameter, an engine: one per engine and function.
macro_rules! for_every_engine {
    ($($promise:ident),+ $(,)?) => {
        mod scalar {
            $(#[test] fn $promise() { super::$promise::<mobee_model::ScalarEngine>(); })+
        }
        mod parry {
            $(#[test] fn $promise() { super::$promise::<crate::engines::Parry>(); })+
        }
    };
}
pub(crate) use for_every_engine;

/// Tolerances of an engine in the tests.
pub trait UnderTest: Engine {
    /// Apart: maximum error of a distance or a witness point, meters.
    const APART: f64;
    /// Overlapping: maximum excess of a depth over the shortest separating translation, meters.
    const DEPTH: f64;
    /// Number of poses in a stream, according to the engine's speed.
    const POSES: usize;
}

impl UnderTest for mobee_model::ScalarEngine {
    const APART: f64 = 1e-6;
    const DEPTH: f64 = 1e-5;
    const POSES: usize = 3000;
}

impl UnderTest for Parry {
    /// GJK stops at nearly parallel sides: 2e-5 m was observed.
    const APART: f64 = 5e-5;
    const DEPTH: f64 = 1e-4;
    const POSES: usize = 600;
}

/// Reference engine: measures every pair by parry's `contact` at any cap, without bounds, preparation or lazy
/// evaluation.
#[derive(Clone, Debug)]
pub struct Parry(Vec<(Collider, SharedShape)>);

impl Engine for Parry {
    /// `world_from_shape` of each.
    type Placement = Vec<Isometry3<f64>>;

    fn prepare(colliders: &[Collider]) -> Self {
        let shape = |shape: &Shape| match *shape {
            Shape::Sphere { radius } => SharedShape::new(Ball::new(radius)),
            Shape::Capsule { radius, height } => SharedShape::new(Capsule::new_y(height / 2.0, radius)),
            Shape::Cylinder { radius, height } => SharedShape::new(Cylinder::new(height / 2.0, radius)),
            Shape::Box { size } => SharedShape::new(Cuboid::new(Vector::new(size.x / 2.0, size.y / 2.0, size.z / 2.0))),
        };
        Parry(colliders.iter().map(|c| (c.clone(), shape(&c.shape))).collect())
    }

    fn place(&self, world_from_frame: &[Isometry3<f64>], placement: &mut Self::Placement) {
        placement.clear();
        placement.extend(self.0.iter().map(|(c, _)| world_from_frame[c.frame] * c.pose));
    }

    fn near(&self, placement: &Self::Placement, (i, j): IndexPair, cap: f64) -> Near {
        let (i, j) = (i as usize, j as usize);
        let pose = |p: &Isometry3<f64>| Pose::from_parts(p.translation.vector.into(), p.rotation.into());
        let (a, b) = (&*self.0[i].1, &*self.0[j].1);
        // Beyond its prediction parry returns nothing; a millimeter is added, so that pairs at the cap are found.
        let prediction = cap.clamp(0.0, 1e3) + 1e-3;
        let contact =
            query::contact(&pose(&placement[i]), a, &pose(&placement[j]), b, prediction).expect("parry knows these");
        let Some(contact) = contact else { return Near::Beyond(cap) };
        if contact.dist > cap {
            return Near::Beyond(contact.dist);
        }
        let point = |p: Vector| Point3::new(p.x, p.y, p.z);
        Near::Within(Proximity { distance: contact.dist, points: [point(contact.point1), point(contact.point2)] })
    }
}
