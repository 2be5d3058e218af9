//! Solids as the lanes test them, with error bounds, and the thresholds of two.

use crate::bound::{REFERENCE, TESTS, U};
use crate::chain::LaneFrame;
use crate::program::{BallAndBox, InnerCapsules, PairTest, ProgramSolid, SolidForm};
use crate::steps::BoundSizes;
use crate::sweep::Sphere;
use mobee_model::{Collider, InnerCapsule, Shape};
use nalgebra::{Isometry3, Point3, Vector3};

/// A solid in its lane frame, with error bounds.
#[derive(Clone, Debug)]
pub(crate) struct Sized {
    pub frame: usize,
    pub pose: Isometry3<f64>,
    pub shape: Shape,
    /// Bound of the displacement of any of its points by rounding, meters.
    error: f64,
    /// Error bound of its axes, spectral norm.
    turn: f64,
    /// True if only a hull within the shape is solid.
    hull: bool,
    /// A capsule inside the solid part.
    inner: InnerCapsule,
}

impl Sized {
    pub fn new(collider: &Collider, frames: &[LaneFrame]) -> Self {
        let frame = &frames[collider.frame];
        let pose = frame.choice.inverse() * collider.pose;
        let error = frame.bound.solid(pose.translation.vector.norm(), collider.shape.bounding_radius());
        let hull = collider.hull().is_some();
        let inner = collider.inner_capsule();
        Sized { frame: collider.frame, pose, shape: collider.shape, error, turn: frame.bound.axes(), hull, inner }
    }

    /// A shape of an object, in the world's frame of this number.
    pub fn of_object(shape: &Shape, pose: &Isometry3<f64>, world: usize) -> Self {
        let bound = LaneFrame::world().bound;
        let error = bound.solid(pose.translation.vector.norm(), shape.bounding_radius());
        let inner = shape.inner_capsule();
        Sized { frame: world, pose: *pose, shape: *shape, error, turn: bound.axes(), hull: false, inner }
    }

    pub fn ball(&self) -> Sphere {
        Sphere { center: self.pose.translation.vector, radius: self.shape.bounding_radius() }
    }

    pub fn size(&self) -> BoundSizes {
        let capsule = self.shape.bounding_capsule();
        let ball = self.shape.bounding_radius();
        let turn = self.is_box().then_some(self.turn);
        BoundSizes { ball, half: capsule.half_axis.norm(), radius: capsule.radius, error: self.error, turn }
    }

    /// Balls that contain the extreme points of its core. For a shape with a hull they contain those of the shape,
    /// since a hull within a round shape moves when the shape rotates about its own axis.
    pub fn ends(&self) -> Vec<Sphere> {
        let at = |v: Vector3<f64>, radius: f64| Sphere { center: (self.pose * Point3::from(v)).coords, radius };
        let signs = [1.0, -1.0];
        let round = |radius: f64| if self.hull { radius } else { 0.0 };
        match self.shape {
            Shape::Sphere { radius } => vec![at(Vector3::zeros(), round(radius))],
            Shape::Capsule { radius, height } => {
                signs.map(|s| at(Vector3::y() * (s * height / 2.0), round(radius))).to_vec()
            }
            Shape::Cylinder { radius, height } => signs.map(|s| at(Vector3::y() * (s * height / 2.0), radius)).to_vec(),
            Shape::Box { size } => {
                let corner = |i: usize| Vector3::from_fn(|k, _| signs[(i >> k) & 1] * size[k] / 2.0);
                (0..8).map(|i| at(corner(i), 0.0)).collect()
            }
        }
    }

    /// The solid of the program; its axes are in rows from `first_axis` on.
    pub fn placed(&self, first_axis: usize) -> ProgramSolid {
        let (own, form) = self.form();
        let mut axes = [[0.0; 3]; 3];
        for (axis, own) in axes.iter_mut().zip(own) {
            *axis = single(&(self.pose.rotation * own));
        }
        ProgramSolid { frame: self.frame, center: single(&self.pose.translation.vector), axes, first_axis, form }
    }

    /// Its sizes for [`pair_test`].
    pub fn side(&self) -> PairSide {
        let capsule = self.shape.bounding_capsule();
        let half = capsule.half_axis.norm();
        let is_round = matches!(self.shape, Shape::Sphere { .. } | Shape::Capsule { .. });
        PairSide {
            ball: self.shape.bounding_radius(),
            error: self.error,
            turn: self.turn,
            half,
            radius: capsule.radius,
            inset: self.inset(),
            is_round,
            is_box: self.is_box(),
            is_ball: self.is_ball(),
            hull: self.hull,
            inner: (self.inner.share * half, self.inner.radius),
        }
    }

    pub fn is_box(&self) -> bool {
        matches!(self.shape, Shape::Box { .. })
    }

    pub fn is_ball(&self) -> bool {
        matches!(self.shape, Shape::Sphere { .. })
    }

    /// Difference in size between a shape and its core, meters: larger than any rounding error, so that intersecting
    /// cores prove an overlap, but at most half of the shape's smallest half extent.
    fn inset(&self) -> f64 {
        let thin = match self.shape {
            Shape::Sphere { .. } | Shape::Capsule { .. } => return 0.0,
            Shape::Cylinder { radius, height } => radius.min(height / 2.0),
            Shape::Box { size } => size.min() / 2.0,
        };
        (4.0 * (self.error + REFERENCE)).min(thin / 2.0)
    }

    /// Axes and sizes of its shape.
    fn form(&self) -> ([Vector3<f64>; 3], SolidForm) {
        let inset = self.inset() as f32;
        let y = [Vector3::y(); 3];
        match self.shape {
            Shape::Sphere { radius } => (y, SolidForm::Round { half: 0.0, radius: radius as f32 }),
            Shape::Capsule { radius, height } => {
                (y, SolidForm::Round { half: (height / 2.0) as f32, radius: radius as f32 })
            }
            Shape::Cylinder { radius, height } => {
                (y, SolidForm::Cylinder { half: (height / 2.0) as f32, radius: radius as f32, inset })
            }
            Shape::Box { size } => {
                let long = size.imax();
                let order = [long, (long + 1) % 3, (long + 2) % 3];
                let axes = order.map(|i| Vector3::ith(i, 1.0));
                (axes, SolidForm::Box { half: order.map(|i| (size[i] / 2.0) as f32), inset })
            }
        }
    }
}

/// Sizes of a solid that determine the thresholds of its pairs, meters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairSide {
    /// Radius of the bounding ball.
    ball: f64,
    error: f64,
    turn: f64,
    /// Half length and radius of the bounding capsule.
    half: f64,
    radius: f64,
    inset: f64,
    is_round: bool,
    is_box: bool,
    is_ball: bool,
    hull: bool,
    /// Half length and radius of the inner capsule.
    inner: (f64, f64),
}

/// Computes the thresholds of a pair of solids of the program, for its clearance.
pub(crate) fn pair_test(a: (usize, &PairSide), b: (usize, &PairSide), clearance: f64) -> PairTest {
    let [(left, x), (right, y)] = [a, b];
    let is_round = x.is_round && y.is_round;
    let balls = x.ball + y.ball;
    let band = x.error + y.error + TESTS * (balls + clearance) + if is_round { 1e-9 } else { REFERENCE };
    let radii = x.radius + y.radius;
    // Depth of the cores of `distance.rs` inside their shapes.
    let inside: f64 = [x, y].map(|s| if s.is_round { s.radius } else { s.inset }).iter().sum();
    let round_radii: f64 = [x, y].map(|s| if s.is_round { s.radius } else { 0.0 }).iter().sum();
    let up = |x: f64| (x * (1.0 + 4.0 * U)) as f32;
    let ball_and_box = ((x.is_ball && y.is_box) || (x.is_box && y.is_ball)) && !x.hull && !y.hull;
    // The ball's center may be farther from the box than the box's own size.
    let turn = if x.is_box { x.turn } else { y.turn };
    let measured = band + turn * (balls + clearance);
    PairTest {
        a: left as u32,
        b: right as u32,
        ball_squared: up((balls + clearance + band).powi(2)),
        half: [x.half as f32, y.half as f32],
        outer: up(radii + clearance + band),
        inner: ((inside + clearance - band) * (1.0 - 4.0 * U)) as f32,
        apart: up(round_radii + clearance + band),
        round: is_round,
        ball_and_box: ball_and_box.then(|| BallAndBox {
            inner: ((round_radii + clearance - measured) * (1.0 - 4.0 * U)) as f32,
            apart: up(round_radii + clearance + measured),
        }),
        held: (x.hull || y.hull).then_some(InnerCapsules {
            half: [x.inner.0 as f32, y.inner.0 as f32],
            inner: ((x.inner.1 + y.inner.1 + clearance - band) * (1.0 - 4.0 * U)) as f32,
        }),
    }
}

/// A vector in `f32`.
pub(crate) fn single(v: &Vector3<f64>) -> [f32; 3] {
    v.map(|x| x as f32).into()
}
