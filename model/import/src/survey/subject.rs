//! The surveyed robot, alone in a world.

use crate::Surfaces;

use mobee_model::{Collider, DefaultEngine, Engine, Near, Primitive, Robot, Scene, SceneError, Shape};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

/// The robot alone in a world, and the surface of each of its nodes.
///
/// A scene tests every two shapes. At random poses most links are far from each other, so bounding boxes around all
/// shapes of a link are tested first.
pub(super) struct Subject<'a> {
    pub(super) robot: &'a Robot,
    engine: DefaultEngine,
    /// Per node: the range of its shapes in the engine.
    shapes: Vec<Range<u32>>,
    /// Per node: the bounds of its shapes, in its frame.
    bounds: Vec<NodeBounds>,
    /// The tested pairs of nodes that can move relative to each other.
    pub(super) tested: Vec<(usize, usize)>,
    /// Per node: its link's index in the surfaces.
    pub(super) surface_of: BTreeMap<usize, usize>,
}

/// Bounding box and ball of all shapes of a node, in its frame.
struct NodeBounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// Center and radius.
    ball: (Point3<f64>, f64),
    /// Center and radius of the ball around each shape.
    balls: Vec<(Point3<f64>, f64)>,
}

/// All shapes at one configuration.
pub(super) struct PlacedShapes {
    /// `world_from_node`.
    frames: Vec<Isometry3<f64>>,
    placement: <DefaultEngine as Engine>::Placement,
}

impl NodeBounds {
    fn new(shapes: &[Primitive]) -> Self {
        let balls = shapes.iter().map(|s| (Point3::from(s.pose.translation.vector), s.shape.bounding_radius()));
        let balls: Vec<_> = balls.collect();
        let start = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        let (low, high) = shapes.iter().fold(start, |(low, high), s| {
            let half = half_extent(s);
            let at = s.pose.translation.vector;
            (low.inf(&(at - half)), high.sup(&(at + half)))
        });
        let ball = if balls.is_empty() {
            (Point3::origin(), f64::NEG_INFINITY)
        } else {
            (Point3::from((low + high) / 2.0), (high - low).norm() / 2.0)
        };
        Self { low, high, ball, balls }
    }

    /// Distance of a point in the node's frame from the box, meters.
    fn distance(&self, p: &Point3<f64>) -> f64 {
        (self.low - p.coords).sup(&(p.coords - self.high)).map(|d| d.max(0.0)).norm()
    }
}

/// Half the edges of a shape's bounding box along the node's axes.
fn half_extent(p: &Primitive) -> Vector3<f64> {
    let turn = p.pose.rotation.to_rotation_matrix().into_inner().abs();
    match p.shape {
        Shape::Box { size } => turn * (size / 2.0),
        shape => {
            let capsule = shape.bounding_capsule();
            turn * capsule.half_axis.abs() + Vector3::repeat(capsule.radius)
        }
    }
}

impl<'a> Subject<'a> {
    pub(super) fn new(robot: &'a Robot, surfaces: &Surfaces) -> Result<Self, SceneError> {
        // Rejects everything that a scene rejects.
        Scene::new(vec![(Arc::new(robot.clone()), Isometry3::identity())], Vec::new())?;
        let by_name: BTreeMap<&str, usize> = surfaces.links().enumerate().map(|(i, name)| (name, i)).collect();
        let indexed = |(i, node): (usize, &mobee_model::Node)| Some((i, *by_name.get(node.name.as_deref()?)?));
        let surface_of = robot.nodes.iter().enumerate().filter_map(indexed).collect();
        let mut shapes = Vec::new();
        let mut colliders = Vec::new();
        for (frame, node) in robot.nodes.iter().enumerate() {
            let first = colliders.len() as u32;
            let hull = |k: usize| node.hulls.get(&k).cloned();
            let solids = node.solids.iter().enumerate();
            colliders.extend(solids.map(|(k, s)| Collider::new(s.shape, frame, s.pose).with_hull(hull(k))));
            shapes.push(first..colliders.len() as u32);
        }
        let bounds = robot.nodes.iter().map(|n| NodeBounds::new(&n.solids)).collect();
        let tested = robot.pairs.reflex.iter().copied().filter(|(a, b)| robot.moves(*a, *b)).collect();
        Ok(Self { robot, engine: DefaultEngine::prepare(&colliders), shapes, bounds, tested, surface_of })
    }

    pub(super) fn place(&self, q: &[f64]) -> PlacedShapes {
        let mut placed =
            PlacedShapes { frames: Vec::with_capacity(self.robot.nodes.len()), placement: Default::default() };
        self.robot.forward(q, &mut placed.frames);
        self.engine.place(&placed.frames, &mut placed.placement);
        placed
    }

    /// The shapes of two nodes that may be nearer than a margin, by their indices on their nodes.
    fn facing(&self, placed: &PlacedShapes, (a, b): (usize, usize), margin: f64) -> Option<[Vec<usize>; 2]> {
        let x = &self.bounds[a];
        let y = &self.bounds[b];
        let apart = (placed.frames[a] * x.ball.0 - placed.frames[b] * y.ball.0).norm();
        if apart > x.ball.1 + y.ball.1 + margin {
            return None;
        }
        let a_from_b = placed.frames[a].inv_mul(&placed.frames[b]);
        let near = |of: &NodeBounds, to: &NodeBounds, to_from_of: &Isometry3<f64>| -> Vec<usize> {
            let near = |(_, (center, radius)): &(usize, &(Point3<f64>, f64))| {
                to.distance(&(to_from_of * center)) <= radius + margin
            };
            of.balls.iter().enumerate().filter(near).map(|(i, _)| i).collect()
        };
        let facing = [near(x, y, &a_from_b.inverse()), near(y, x, &a_from_b)];
        facing.iter().all(|f| !f.is_empty()).then_some(facing)
    }

    /// The smallest distance of the shapes of two nodes, if it is less than a margin (meters) or they touch.
    pub(super) fn distance(&self, placed: &PlacedShapes, (a, b): (usize, usize), margin: f64) -> Option<f64> {
        let [of_a, of_b] = self.facing(placed, (a, b), margin)?;
        let mut least = None;
        for i in &of_a {
            for j in &of_b {
                let pair = (self.shapes[a].start + *i as u32, self.shapes[b].start + *j as u32);
                if let Near::Within(near) = self.engine.near(&placed.placement, pair, least.unwrap_or(margin))
                    && (near.distance < margin || near.distance <= 0.0)
                {
                    least = Some(near.distance.min(least.unwrap_or(f64::INFINITY)));
                }
            }
        }
        least
    }

    /// The shapes of two nodes that touch or are within a margin (meters) of each other, by their indices on their
    /// nodes.
    pub(super) fn touching<'s>(
        &'s self,
        placed: &'s PlacedShapes,
        (a, b): (usize, usize),
        margin: f64,
    ) -> impl Iterator<Item = (usize, usize)> + 's {
        let [of_a, of_b] = self.facing(placed, (a, b), margin).unwrap_or_default();
        let pair = move |i: usize, j: usize| (self.shapes[a].start + i as u32, self.shapes[b].start + j as u32);
        let all = (0..of_a.len() * of_b.len()).map(move |k| (of_a[k / of_b.len()], of_b[k % of_b.len()]));
        all.filter(move |(i, j)| self.engine.touches(&placed.placement, pair(*i, *j), margin))
    }

    /// The center of the intersection of two touching shapes, world frame; each is given by its node and its index
    /// there.
    pub(super) fn place_of(&self, placed: &PlacedShapes, shapes: [(usize, usize); 2]) -> Option<Point3<f64>> {
        let [a, b] = shapes.map(|(node, shape)| self.shapes[node].start + shape as u32);
        match self.engine.near(&placed.placement, (a, b), 0.0) {
            Near::Within(near) => Some(nalgebra::center(&near.points[0], &near.points[1])),
            Near::Beyond(_) => None,
        }
    }

    /// The pairs of nodes whose shapes are nearer than a margin (meters), each with the smallest distance.
    pub(super) fn near(&self, q: &[f64], margin: f64) -> BTreeMap<(usize, usize), f64> {
        let placed = self.place(q);
        self.tested.iter().filter_map(|pair| Some((*pair, self.distance(&placed, *pair, margin)?))).collect()
    }

    /// The link indices of two nodes, if both have surfaces.
    pub(super) fn surfaces(&self, (a, b): (usize, usize)) -> Option<(usize, usize)> {
        Some((*self.surface_of.get(&a)?, *self.surface_of.get(&b)?))
    }
}
