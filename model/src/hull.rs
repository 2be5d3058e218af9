//! Hulls: what a shape around a part of a mesh really holds.
//!
//! ```text
//! shape (ball, capsule, cylinder, box)   quick to reject, larger than what it was put around
//!   └── hull: some points and a radius   what touches
//! ```

use crate::{Mesh, Shape};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;
use std::sync::Arc;

/// A hull may have so many points at most: each is looked at several times whenever it is measured, and an attribute of a file has its
/// bounds, too.
pub(crate) const MOST_POINTS: usize = 112;
/// How far a hull may stick out of its shape, meters: what rounding makes of a pose that was written as heading and angle.
const ROUNDING: f64 = 1e-6;
/// A picture of a hull is blown up by this at least, meters: what is flat is no solid.
const SEEN: f64 = 1e-3;

/// The convex hull of points, blown up by a radius: a solid within a shape, on the same node.
///
/// The shape is what everybody draws, and what is looked at first; where it may touch, its hull decides. So a hull never makes
/// a contact that its shape would not make.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// `node` frame, meters; at least one.
    points: Vec<Point3<f64>>,
    /// Meters.
    radius: f64,
}

/// The hulls of a node's shapes: which shape, by its number among the node's solids, has which.
pub type Hulls = std::collections::BTreeMap<usize, Arc<Hull>>;

impl Hull {
    /// The hull of these points, meters, blown up by a radius, meters.
    ///
    /// # Errors
    /// The end of a sentence that begins with the hull: no points or too many, or numbers that are no places or no radius.
    pub fn new(points: Vec<Point3<f64>>, radius: f64) -> Result<Self, String> {
        if points.is_empty() || points.len() > MOST_POINTS {
            return Err(format!("has {} points; 1 to {MOST_POINTS} make one", points.len()));
        }
        if !(points.iter().all(|p| p.iter().all(|x| x.is_finite())) && radius.is_finite() && radius >= 0.0) {
            return Err("has numbers that are not finite, or a radius below zero".to_owned());
        }
        Ok(Self { points, radius })
    }

    /// Its points, meters.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// What it is blown up by, meters.
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// The same in another frame.
    pub fn moved(&self, to_from_here: &Isometry3<f64>) -> Self {
        Self { points: self.points.iter().map(|p| to_from_here * p).collect(), radius: self.radius }
    }

    /// Its surface for pictures: where it is blown up, edges are cut off by up to half of the radius.
    pub fn mesh(&self) -> Mesh {
        let by = self.radius.max(SEEN);
        let ball = [-1.0, 0.0, 1.0].map(|x| [-1.0, 0.0, 1.0].map(|y| [-1.0, 0.0, 1.0].map(|z| Vector3::new(x, y, z))));
        // the axes and the corners of a cube: evenly enough, and few
        let ball = ball.as_flattened().as_flattened().iter().filter(|d| matches!(d.norm_squared() as u8, 1 | 3));
        let ball: Vec<Vector3<f64>> = ball.map(|d| d.normalize() * by).collect();
        let around = self.points.iter().flat_map(|p| ball.iter().map(move |d| p.coords + d));
        let around: Vec<Vector> = around.map(|p| Vector::new(p.x, p.y, p.z)).collect();
        let Ok((corners, triangles)) = try_convex_hull(&around) else { return Mesh::default() };
        Mesh { vertices: corners.iter().map(|p| Vector3::new(p.x, p.y, p.z)).collect(), triangles }
    }

    /// Whether it lies within a shape, given the shape's pose in the hull's frame.
    pub fn is_within(&self, shape: &Shape, pose: &Isometry3<f64>) -> bool {
        let depth = |p: &Point3<f64>| shape.depth(&pose.inverse_transform_point(p).coords);
        self.points.iter().all(|p| depth(p) >= self.radius - ROUNDING)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The picture holds what the hull is made of, and is nowhere outside the hull.
    #[test]
    fn the_picture_of_a_hull_is_the_hull() {
        let flat =
            [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.2, 0.0], [0.0, 0.2, 0.0], [0.05, 0.1, 0.0]].map(Point3::from);
        for (points, radius) in [(flat.to_vec(), 0.002), (flat.to_vec(), 0.0), (flat[..1].to_vec(), 0.01)] {
            let mesh = Hull::new(points.clone(), radius).unwrap().mesh();
            assert!(mesh.triangles.len() >= 8, "{points:?}");
            let inside = |p: &Vector3<f64>| {
                let corner = |t: u32| mesh.vertices[t as usize];
                // a hundredth of a millimeter is nothing to a picture
                let holds = |t: &[u32; 3]| {
                    let [a, b, c] = t.map(corner);
                    let normal = (b - a).cross(&(c - a)).try_normalize(1e-12);
                    normal.is_none_or(|normal| normal.dot(&(p - a)) <= 1e-5)
                };
                mesh.triangles.iter().all(holds)
            };
            assert!(points.iter().all(|p| inside(&p.coords)), "{points:?} {radius}");
            let by = radius.max(SEEN) + 1e-12;
            let (low, high) = (Vector3::repeat(-by), Vector3::new(0.1, 0.2, 0.0).add_scalar(by));
            assert!(mesh.vertices.iter().all(|p| *p >= low && *p <= high), "{points:?} {radius}");
        }
    }
}
