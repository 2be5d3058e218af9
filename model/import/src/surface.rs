//! Contact between the meshes themselves: the reference for fitted shapes; far too slow for other uses.

use crate::Fit;
use crate::fit::rounded;
use mobee_model::distance;
use mobee_model::{Hull, Hulls, Mesh, Primitive, Robot, Shape};
use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};
use parry3d_f64::bounding_volume::{Aabb, BoundingVolume};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::{self, intersection_test};
use parry3d_f64::shape::{Ball, Capsule, Cuboid, Cylinder, Shape as PartShape, SharedShape, TriMesh, Triangle};
use std::sync::Arc;

/// Collision geometry of a link, in its own frame.
#[derive(Clone, Debug, Default)]
pub struct LinkSurface {
    /// The link's name, which is also that of a marker of the robot.
    pub link: String,
    /// Rotation of `root_from_link` with all joints at zero: nodes have the root's orientation there, links have their
    /// own.
    pub turn: UnitQuaternion<f64>,
    /// Its meshes: surfaces only, so a shape inside a mesh does not touch it.
    pub meshes: Vec<Mesh>,
    /// Its primitive shapes, which are solid.
    pub solids: Vec<Primitive>,
}

impl LinkSurface {
    /// The link's shapes in the frame of its node: those of the file, then those fitted to its meshes.
    pub fn shapes(&self, fit: Option<&Fit>) -> Vec<Primitive> {
        let all = self.solids.iter().cloned().chain(fit.into_iter().flat_map(Fit::primitives));
        all.map(|p| Primitive { pose: self.turn * p.pose, ..p }).collect()
    }

    /// The hulls of the fitted shapes, by index in [`LinkSurface::shapes`].
    pub fn hulls(&self, fit: &Fit) -> Hulls {
        let turned = |hull: &Hull| {
            let points = hull.points().iter().map(|p| (self.turn * p).map(rounded)).collect();
            Hull::new(points, hull.radius()).ok()
        };
        let all = fit.hulls().filter_map(|(i, hull)| Some((self.solids.len() + i, Arc::new(turned(hull)?))));
        all.collect()
    }
}

/// The surfaces of a robot's links, prepared for contact queries.
///
/// # Example
/// ```no_run
/// # use mobee_import::{LinkSurface, Surfaces};
/// # use mobee_model::{Robot, random_poses};
/// # fn example(robot: &Robot, links: &[LinkSurface]) -> Result<(), String> {
/// let surfaces = Surfaces::new(robot, links)?;
/// let in_contact = random_poses(robot, 2012).take(1000).filter(|q| surfaces.meet(&surfaces.frames(robot, q), 0, 1)).count();
/// # Ok(())
/// # }
/// ```
pub struct Surfaces {
    /// In the order of the input.
    links: Vec<PreparedLink>,
}

/// A prepared link.
struct PreparedLink {
    /// Its name.
    name: String,
    /// The node of its marker.
    node: usize,
    /// `node_from_link`.
    turn: UnitQuaternion<f64>,
    /// Its meshes.
    meshes: Vec<TriMesh>,
    /// Its primitives, in our representation and in parry's.
    solids: Vec<(Primitive, SharedShape, Pose)>,
    /// Bounding box of all its shapes, in its frame.
    bounds: Aabb,
}

impl Surfaces {
    /// Prepares the surfaces of links.
    ///
    /// # Errors
    /// A link is not a marker of the robot, or a mesh has no triangles or invalid coordinates.
    pub fn new(robot: &Robot, links: &[LinkSurface]) -> Result<Self, String> {
        let links = links.iter().map(|l| PreparedLink::new(robot, l)).collect::<Result<_, _>>()?;
        Ok(Self { links })
    }

    /// The links' names, in the order of the input; all other functions refer to links by index.
    pub fn links(&self) -> impl ExactSizeIterator<Item = &str> {
        self.links.iter().map(|l| l.name.as_str())
    }

    /// `world_from_link` of every link at the configuration `q`, with the robot's base at the world's origin.
    pub fn frames(&self, robot: &Robot, q: &[f64]) -> Vec<Isometry3<f64>> {
        let mut nodes = Vec::with_capacity(robot.nodes.len());
        robot.forward(q, &mut nodes);
        self.links.iter().map(|l| nodes[l.node] * l.turn).collect()
    }

    /// True if the surfaces of links `a` and `b` intersect, given `world_from_link` of all.
    pub fn meet(&self, frames: &[Isometry3<f64>], a: usize, b: usize) -> bool {
        let a_from_b = frames[a].inv_mul(&frames[b]);
        let a = &self.links[a];
        let b = &self.links[b];
        let pose = pose(&a_from_b);
        if !a.bounds.intersects(&b.bounds.transform_by(&pose)) {
            return false;
        }
        let meshes = || a.meshes.iter().any(|m| b.meshes.iter().any(|n| cross(m, n, &pose)));
        let first = || a.meshes.iter().any(|m| b.solids.iter().any(|s| enters(m, s, &pose)));
        let second = || b.meshes.iter().any(|m| a.solids.iter().any(|s| enters(m, s, &pose.inverse())));
        let touch =
            |s: &Primitive, t: &Primitive| distance(&s.shape, &s.pose, &t.shape, &(a_from_b * t.pose)).distance <= 0.0;
        let solids = || a.solids.iter().any(|s| b.solids.iter().any(|t| touch(&s.0, &t.0)));
        meshes() || first() || second() || solids()
    }

    /// True if the surfaces of two links are closer to each other than a distance (meters), given `world_from_link` of
    /// all.
    pub fn near(&self, frames: &[Isometry3<f64>], (a, b): (usize, usize), distance: f64) -> bool {
        let a_from_b = pose(&frames[a].inv_mul(&frames[b]));
        let [a, b] = [a, b].map(|i| self.links[i].shapes());
        // All pairs of these shapes are supported, so an error can't occur.
        let within = |place: &Pose, shape: &dyn PartShape, at: &Pose, other: &dyn PartShape| {
            query::distance(place, shape, at, other).is_ok_and(|d| d.distance < distance)
        };
        let near = |(shape, place): &(&dyn PartShape, Pose), (other, at): &(&dyn PartShape, Pose)| {
            let at = a_from_b * *at;
            match (shape.as_trimesh(), other.as_trimesh()) {
                // The first triangles that are near suffice, whereas parry would search for the nearest.
                (Some(m), Some(n)) => {
                    triangles_facing(m, n, &at, distance).any(|(t, u)| within(&Pose::IDENTITY, &t, &at, &u))
                }
                _ => within(place, *shape, &at, *other),
            }
        };
        a.iter().any(|s| b.iter().any(|t| near(s, t)))
    }

    /// The pairs that intersect, in the same order.
    pub fn meeting(&self, frames: &[Isometry3<f64>], pairs: &[(usize, usize)]) -> Vec<(usize, usize)> {
        pairs.iter().copied().filter(|(a, b)| self.meet(frames, *a, *b)).collect()
    }
}

impl PreparedLink {
    /// Finds the link's node and prepares its shapes.
    fn new(robot: &Robot, link: &LinkSurface) -> Result<Self, String> {
        let name = &link.link;
        let marker = robot.markers.iter().find(|m| m.name == *name);
        let node = marker.ok_or_else(|| format!("link `{name}` is not in the robot"))?.node;
        let meshes: Vec<TriMesh> = link.meshes.iter().map(prepared).collect::<Option<_>>().ok_or_else(|| {
            format!("a mesh of link `{name}` has no triangles, or corners that are not there or not finite")
        })?;
        let prepared_solid = |p: &Primitive| (p.clone(), shared(&p.shape), pose(&p.pose));
        let solids: Vec<_> = link.solids.iter().map(prepared_solid).collect();
        let boxes = meshes.iter().map(|m| m.local_aabb()).chain(solids.iter().map(|s| s.1.compute_aabb(&s.2)));
        let bounds = boxes.reduce(|a, b| a.merged(&b)).unwrap_or_else(Aabb::new_invalid);
        Ok(Self { name: name.clone(), node, turn: link.turn, meshes, solids, bounds })
    }

    /// Its meshes and primitives, each with its pose in the link's frame.
    fn shapes(&self) -> Vec<(&dyn PartShape, Pose)> {
        let meshes = self.meshes.iter().map(|m| (m as &dyn PartShape, Pose::IDENTITY));
        meshes.chain(self.solids.iter().map(|(_, shape, place)| (shape.as_ref(), *place))).collect()
    }
}

/// Converts a mesh to parry's; `None` if it is invalid.
fn prepared(mesh: &Mesh) -> Option<TriMesh> {
    let corners = mesh.vertices.len();
    let sound = mesh.vertices.iter().flatten().all(|c| c.is_finite())
        && mesh.triangles.iter().flatten().all(|i| (*i as usize) < corners);
    let vertices = || mesh.vertices.iter().map(|v| Vector::new(v.x, v.y, v.z)).collect();
    sound.then(|| TriMesh::new(vertices(), mesh.triangles.clone()).ok()).flatten()
}

/// Converts a shape to parry's.
fn shared(shape: &Shape) -> SharedShape {
    match *shape {
        Shape::Sphere { radius } => SharedShape::new(Ball::new(radius)),
        Shape::Cylinder { radius, height } => SharedShape::new(Cylinder::new(height / 2.0, radius)),
        Shape::Box { size } => SharedShape::new(Cuboid::new(Vector::new(size.x, size.y, size.z) / 2.0)),
        Shape::Capsule { radius, height } => SharedShape::new(Capsule::new_y(height / 2.0, radius)),
    }
}

/// Converts a pose to parry's.
fn pose(isometry: &Isometry3<f64>) -> Pose {
    Pose::from_parts(isometry.translation.vector.into(), isometry.rotation.into())
}

/// True if two surfaces intersect.
fn cross(a: &TriMesh, b: &TriMesh, a_from_b: &Pose) -> bool {
    let corner = |p: Vector| a_from_b * p;
    triangles_facing(a, b, a_from_b, 0.0)
        .any(|(t, u)| triangles_meet(&[t.a, t.b, t.c], &[corner(u.a), corner(u.b), corner(u.c)]))
}

/// The pairs of triangles of two meshes that may be within a distance (meters) of each other, each triangle in the
/// frame of its mesh.
fn triangles_facing<'m>(
    a: &'m TriMesh,
    b: &'m TriMesh,
    a_from_b: &Pose,
    distance: f64,
) -> impl Iterator<Item = (Triangle, Triangle)> + 'm {
    let facing = Facing::new(a_from_b, distance);
    let near = a.bvh().leaf_pairs(b.bvh(), move |n, m| facing.may_be_near(&n.aabb(), &m.aabb()));
    near.map(|(i, j)| (a.triangle(i), b.triangle(j)))
}

/// Proximity test of boxes along the axes of two frames.
struct Facing {
    /// `a_from_b`.
    shift: Vector3<f64>,
    turn: Matrix3<f64>,
    /// Absolute values of the rotation's entries, plus a tolerance for rounding.
    reach: Matrix3<f64>,
    /// Maximum distance that counts as near, meters.
    distance: f64,
}

impl Facing {
    fn new(a_from_b: &Pose, distance: f64) -> Self {
        let columns = [Vector::X, Vector::Y, Vector::Z].map(|axis| plain(a_from_b.rotation * axis));
        let turn = Matrix3::from_columns(&columns);
        Self { shift: plain(a_from_b.translation), turn, reach: turn.abs().add_scalar(1e-12), distance }
    }

    /// False only if one of the six directions of the boxes' edges separates them by more than the distance.
    fn may_be_near(&self, a: &Aabb, b: &Aabb) -> bool {
        let [(at, half), (to, other)] = [a, b].map(|x| (plain(x.center()), plain(x.half_extents())));
        let apart = self.turn * to + self.shift - at;
        let held =
            |apart: Vector3<f64>, reach: Vector3<f64>| (0..3).all(|i| apart[i].abs() <= reach[i] + self.distance);
        held(apart, half + self.reach * other) && held(self.turn.tr_mul(&apart), self.reach.tr_mul(&half) + other)
    }
}

/// Converts a vector to nalgebra's.
fn plain(v: Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

/// True if a mesh intersects a solid shape.
fn enters(mesh: &TriMesh, (_, shape, place): &(Primitive, SharedShape, Pose), mesh_from_other: &Pose) -> bool {
    // All pairs of these shapes are supported, so an error can't occur.
    intersection_test(&Pose::IDENTITY, mesh, &(*mesh_from_other * *place), shape.as_ref())
        .is_ok_and(|hit| hit.intersecting)
}

/// True if two triangles have a point in common, that is, if no axis separates them. For convex polyhedra the candidate
/// axes are the normals of faces and the cross products of two edges; for flat ones also the in-plane normals of edges.
fn triangles_meet(a: &[Vector; 3], b: &[Vector; 3]) -> bool {
    let edges = |t: &[Vector; 3]| [t[1] - t[0], t[2] - t[1], t[0] - t[2]];
    let of_a = edges(a);
    let of_b = edges(b);
    let up_a = of_a[0].cross(of_a[1]);
    let up_b = of_b[0].cross(of_b[1]);
    let is_separated = |axis: Vector| {
        let span = |t: &[Vector; 3]| {
            let along = t.map(|p| axis.dot(p));
            (along[0].min(along[1]).min(along[2]), along[0].max(along[1]).max(along[2]))
        };
        let ((low_a, high_a), (low_b, high_b)) = (span(a), span(b));
        high_a < low_b || high_b < low_a
    };
    !(is_separated(up_a)
        || is_separated(up_b)
        || of_a.iter().any(|e| of_b.iter().any(|f| is_separated(e.cross(*f))))
        || of_a.iter().any(|e| is_separated(e.cross(up_a)))
        || of_b.iter().any(|e| is_separated(e.cross(up_b))))
}
