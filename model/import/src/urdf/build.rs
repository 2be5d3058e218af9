//! Converts bodies at the zero position to ZRP nodes.
//!
//! ```text
//! joint ── first link of the body (its shapes) ──┬── links to the origins of the next joints ── joint ── next body
//!                                                └── links to the origins of its other links (their shapes, markers)
//! ```

use super::document::{Document, JointType, UrdfCollision, UrdfGeometry, UrdfJoint, UrdfLink};
use super::mesh::{MeshFile, MeshIssue, Meshes};
use super::sizes::Sizes;
use super::tree::{JointDrive, Tree};
use super::{UrdfOptions, neighbors, upright};
use crate::{Fit, LinkSurface};
use mobee_model::Hulls;
use mobee_model::{JointMotion, Marker, Mesh, Motor, Node, NodeKind, NodePairs, Part, Primitive, Robot, Shape};
use mobee_text::{FileError, SourceText};
use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::FRAC_PI_2;
use std::rc::Rc;

/// Distance below which points are equal, meters; the format treats links below 1e-12 m as having no direction.
const SAME_POINT_M: f64 = 1e-11;
/// Length of links whose end point is irrelevant, meters.
const STUB_LENGTH_M: f64 = 0.01;
/// Maximum number of nodes: the pair tables grow quadratically.
const MAX_NODES: usize = 2048;
/// Maximum number of shapes of all links together.
const MAX_SHAPES: usize = 4096;

/// Links connected by fixed joints, with their frames at the zero position.
struct RigidBody {
    /// Index of each link, and `root_from_link` at zero.
    links: Vec<(usize, Isometry3<f64>)>,
    /// The moving joints below it: joint, and the child link's frame at zero.
    joints: Vec<(usize, Isometry3<f64>)>,
}

/// State of the conversion: its input, and the robot so far.
///
/// Everything is placed in the root frame with all joints at zero: there ZRP's translations and rotations about axes
/// need no fixed rotation between them.
struct Builder<'a> {
    /// The file, for messages.
    source: &'a SourceText,
    /// Contents of the file.
    urdf: &'a Document,
    /// Tree of its links.
    tree: &'a Tree,
    /// Options of the conversion.
    options: &'a UrdfOptions,
    /// Warnings about parts that were skipped or corrected.
    warnings: &'a mut Vec<FileError>,
    /// The robot so far: one part, nodes in the order of the tree.
    robot: Robot,
    /// Per joint of the URDF: its motor.
    motors: Vec<Option<usize>>,
    /// Per link: the node that carries its collision shapes, if it has any.
    shapes_of: Vec<Option<usize>>,
    /// Collision shapes so far.
    shapes: usize,
    /// The mesh files.
    meshes: Meshes<'a>,
    /// Doubts about the sizes of shapes.
    sizes: Sizes,
    /// True if meshes that declare y as up are rotated.
    turns_y_up: bool,
    /// True if primitives are fitted to meshes.
    fits: bool,
    /// Collision geometry of the links as the file gives it.
    surfaces: Vec<LinkSurface>,
    /// The fits to the meshes, by link.
    fitted: BTreeMap<String, Fit>,
}

/// Result of the conversion.
pub(super) struct Built {
    /// The robot.
    pub robot: Robot,
    /// Meshes and shapes of the links that have any.
    pub surfaces: Vec<LinkSurface>,
    /// The fits to the meshes, by link.
    pub fits: BTreeMap<String, Fit>,
}

/// Work item: the first link of a body, its frame at zero, and the node of its parent joint.
type PendingBody = (usize, Isometry3<f64>, Option<usize>);

/// Builds the robot. Without `fits` nothing is fitted to meshes, for callers that need only the surfaces.
pub(super) fn build(
    source: &SourceText,
    urdf: &Document,
    tree: &Tree,
    options: &UrdfOptions,
    fits: bool,
    warnings: &mut Vec<FileError>,
) -> Result<Built, FileError> {
    let part = options.part.clone().unwrap_or_else(|| urdf.name.clone());
    let robot = Robot {
        name: urdf.name.clone(),
        parts: vec![Part { name: part, motors: 0..0, root_node: Some(0), clauses: Vec::new() }],
        motors: Vec::new(),
        nodes: Vec::new(),
        markers: Vec::new(),
        pairs: NodePairs::default(),
        left_out: None,
        near: Vec::new(),
        bare: urdf.links.iter().filter(|l| l.bare && !options.visual).map(|l| l.name.clone()).collect(),
    };
    let motors = vec![None; urdf.joints.len()];
    let mut b = Builder {
        source,
        urdf,
        tree,
        options,
        warnings,
        robot,
        motors,
        shapes_of: vec![None; urdf.links.len()],
        shapes: 0,
        meshes: Meshes::new(options),
        sizes: Sizes::default(),
        turns_y_up: false,
        fits,
        surfaces: Vec::new(),
        fitted: BTreeMap::new(),
    };
    b.turns_y_up = upright::turns_y_up(source, urdf, options.up_axis, &mut b.meshes, b.warnings);
    // Motors first: a mimic joint may come before its source in the tree.
    b.create_motors();
    let mut todo = vec![(tree.root, Isometry3::identity(), None)];
    while let Some((link, frame, parent)) = todo.pop() {
        let body = b.body(link, frame)?;
        todo.extend(b.emit(&body, parent)?.into_iter().rev());
    }
    // Placed before all warnings about the fitted shapes.
    let mut doubts = Vec::new();
    b.sizes.warn(source, &mut doubts);
    b.warnings.splice(0..0, doubts);
    // From here on the robot lists its disabled pairs; an SRDF or a survey adds more in the same way.
    b.robot.leave_out(neighbors::neighbors(urdf, tree, &b.shapes_of));
    Ok(Built { robot: b.robot, surfaces: b.surfaces, fits: b.fitted })
}

impl Builder<'_> {
    /// Creates the motors, in the order of the tree.
    fn create_motors(&mut self) {
        let mut todo = vec![self.tree.root];
        while let Some(link) = todo.pop() {
            for &joint in &self.tree.leaving[link] {
                if let Some(limits) = self.tree.limits[joint] {
                    let min = limits.motion.encoder(limits.min);
                    let max = limits.motion.encoder(limits.max);
                    self.motors[joint] = Some(self.robot.motors.len());
                    self.robot.motors.push(Motor {
                        name: self.urdf.joints[joint].name.clone(),
                        part: 0,
                        min,
                        max,
                        home: 0_f64.clamp(min, max),
                        motion: limits.motion,
                        max_speed: limits.speed.map(|v| limits.motion.encoder(v)),
                        continuous: limits.continuous,
                        joints: Vec::new(),
                        is_part_root: self.robot.motors.is_empty(),
                    });
                }
            }
            todo.extend(self.tree.leaving[link].iter().rev().map(|j| self.tree.child[*j]));
        }
        self.robot.parts[0].motors = 0..self.robot.motors.len();
    }

    /// Collects a link and all links connected to it by fixed joints. `frame` is `root_from_link` at zero.
    ///
    /// # Errors
    /// If an axis has no direction.
    fn body(&self, link: usize, frame: Isometry3<f64>) -> Result<RigidBody, FileError> {
        let mut body = RigidBody { links: Vec::new(), joints: Vec::new() };
        let mut todo = vec![(link, frame)];
        while let Some((link, frame)) = todo.pop() {
            body.links.push((link, frame));
            for &joint in &self.tree.leaving[link] {
                let what = &self.urdf.joints[joint];
                let bad = || {
                    let message = format!("the axis of joint `{}` has no direction", what.name);
                    self.source.error(what.at.clone(), message, "write three numbers that are not all zero")
                };
                let at_joint = frame * what.origin;
                match self.tree.drives[joint] {
                    JointDrive::Fixed(0.0) => todo.push((self.tree.child[joint], at_joint)),
                    // A joint without range has a constant position; its child is attached as by a fixed joint.
                    JointDrive::Fixed(position) => {
                        let moved = motion(what).by(&axis(&what.axis).ok_or_else(bad)?, position);
                        todo.push((self.tree.child[joint], at_joint * moved));
                    }
                    JointDrive::Moves { .. } => {
                        axis(&what.axis).ok_or_else(bad)?;
                        body.joints.push((joint, at_joint));
                    }
                }
            }
        }
        Ok(body)
    }

    /// Adds a body's nodes under the joint `parent`; returns the bodies that follow.
    fn emit(&mut self, body: &RigidBody, parent: Option<usize>) -> Result<Vec<PendingBody>, FileError> {
        let Some(&(first, frame)) = body.links.first() else { return Ok(Vec::new()) };
        let start = frame.translation.vector;
        // The body's first node ends at the first point that is needed.
        let points = body.joints.iter().chain(&body.links).map(|(_, f)| f.translation.vector - start);
        // The format rejects a link of zero length. Its end is arbitrary, so it is placed at the origin of a joint or
        // marker, which then needs no link of its own.
        let offset =
            points.into_iter().find(|v| v.norm() > SAME_POINT_M).unwrap_or(Vector3::new(0.0, 0.0, STUB_LENGTH_M));
        let node = self.node(first, parent, NodeKind::Link { offset })?;
        self.robot.nodes[node].name = Some(self.link_name(first).into());
        let end = start + offset;
        for (link, link_frame) in &body.links {
            let solids = self.solids(*link, link_frame.rotation)?;
            let at = link_frame.translation.vector;
            // A link with shapes has a node of its own with the link's name, so that each shape can be traced to its
            // link.
            let shared = *link == first || (solids.is_empty() && (at - start).norm() <= SAME_POINT_M);
            let place = if shared {
                node
            } else {
                let at_point = self.connect(*link, node, at - end)?;
                let place =
                    self.node(*link, Some(at_point), NodeKind::Link { offset: Vector3::new(0.0, 0.0, STUB_LENGTH_M) })?;
                self.robot.nodes[place].name = Some(self.link_name(*link).into());
                place
            };
            if !solids.is_empty() {
                self.shapes_of[*link] = Some(place);
            }
            self.robot.nodes[place].solids.extend(solids);
            self.robot.markers.push(Marker {
                name: self.link_name(*link).to_owned(),
                node: place,
                part: 0,
                normal: Unit::new_normalize(link_frame.rotation * Vector3::z()),
                tracer: 5,
            });
        }
        // Joints after markers: a marker belongs to this body, and everything after a joint rotates with it.
        let mut next = Vec::new();
        for (joint, child_frame) in &body.joints {
            let at_point = self.connect(first, node, child_frame.translation.vector - end)?;
            let moving = self.joint(first, *joint, child_frame, at_point)?;
            next.push((self.tree.child[*joint], *child_frame, Some(moving)));
        }
        Ok(next)
    }

    /// A link's name, without blanks around it.
    fn link_name(&self, link: usize) -> &str {
        &self.urdf.links[link].name
    }

    /// A link's collision shapes: those of the file, and those fitted to its meshes. Nodes have the orientation of the
    /// root, so of a link's frame only its rotation relative to the root remains: `turn`, the rotation of
    /// `root_from_link` at zero.
    ///
    /// # Errors
    /// At the link, if there are too many shapes or one of them is invalid.
    fn solids(&mut self, link: usize, turn: UnitQuaternion<f64>) -> Result<Vec<Primitive>, FileError> {
        let urdf = self.urdf;
        let UrdfLink { name, at, collisions, .. } = &urdf.links[link];
        let mut own = LinkSurface { link: name.clone(), turn, meshes: Vec::new(), solids: Vec::new() };
        for collision in collisions {
            match &collision.geometry {
                UrdfGeometry::Mesh { filename, .. } if self.options.drop_meshes => {
                    let message = format!("link `{name}`: the mesh {filename} is left out");
                    let help = "give the link a shape in the converted file";
                    self.warnings.push(self.source.warning(collision.at.clone(), message, help));
                }
                UrdfGeometry::Mesh { filename, scale } => {
                    let file = self.mesh(name, collision, filename, scale)?;
                    let turn = self.turns_y_up && file.y_up;
                    own.meshes.push(placed(&file.mesh, turn, scale, &collision.origin));
                }
                _ => {
                    own.solids.push(self.shape(link, collision)?);
                    self.sizes.shape(name, collision);
                }
            }
        }
        let solids = if self.fits { self.fitted(link, &own)? } else { Vec::new() };
        self.shapes += solids.len();
        if self.shapes > MAX_SHAPES {
            let message = format!("the robot has more than {MAX_SHAPES} collision shapes");
            return Err(self.source.error(at.clone(), message, "cover what is small by one larger shape"));
        }
        if !own.meshes.is_empty() || !own.solids.is_empty() {
            self.surfaces.push(own);
        }
        Ok(solids)
    }

    /// Fits shapes to the meshes of a link; returns these and its primitive shapes.
    fn fitted(&mut self, link: usize, own: &LinkSurface) -> Result<Vec<Primitive>, FileError> {
        if own.meshes.is_empty() {
            return Ok(own.shapes(None));
        }
        let UrdfLink { name, at, .. } = &self.urdf.links[link];
        let fit = Fit::new(&own.meshes, &self.options.fit).map_err(|why| {
            let help = "leave meshes out with --drop-meshes, or give the link a box, cylinder or sphere";
            self.source.error(at.clone(), format!("the meshes of link `{name}`: {why}"), help)
        })?;
        let shapes = own.shapes(Some(&fit));
        self.fitted.insert(name.clone(), fit);
        Ok(shapes)
    }

    /// The node whose children are at `offset` from the end of `from`: `from` itself, or a new link.
    fn connect(&mut self, link: usize, from: usize, offset: Vector3<f64>) -> Result<usize, FileError> {
        if offset.norm() <= SAME_POINT_M { Ok(from) } else { self.node(link, Some(from), NodeKind::Link { offset }) }
    }

    /// Adds a moving joint under the node `parent`; `frame` is `root_from_joint` at zero. Returns its node, or the
    /// parent if the joint has no motor.
    fn joint(&mut self, link: usize, joint: usize, frame: &Isometry3<f64>, parent: usize) -> Result<usize, FileError> {
        let mut direction = frame.rotation * axis(&self.urdf.joints[joint].axis).unwrap_or(Vector3::z_axis());
        let JointDrive::Moves { source, factor, offset } = self.tree.drives[joint] else { return Ok(parent) };
        let (Some(motor), Some(limits)) = (self.motors[source], self.tree.limits[source]) else { return Ok(parent) };
        // Positions at the motor's limits, in the joint's own unit, which may differ from the motor's (a prismatic
        // finger may follow a revolute joint). For a mimic joint they may be in reverse order.
        let mut min = factor * limits.min + offset;
        let mut max = factor * limits.max + offset;
        if min > max {
            // The format requires limits in ascending order: invert the axis.
            (direction, min, max) = (-direction, -min, -max);
        }
        let motion = motion(&self.urdf.joints[joint]);
        let kind = NodeKind::Joint { motion, axis: direction, motor, min, max, length: 1.0 };
        let node = self.node(link, Some(parent), kind)?;
        self.robot.motors[motor].joints.push(node);
        Ok(node)
    }

    /// Adds a node for a link.
    ///
    /// # Errors
    /// If there are too many; the error is located at the link.
    fn node(&mut self, link: usize, parent: Option<usize>, kind: NodeKind) -> Result<usize, FileError> {
        let index = self.robot.nodes.len();
        if index >= MAX_NODES {
            let message = format!("the robot needs more than {MAX_NODES} nodes");
            return Err(self.source.error(self.urdf.links[link].at.clone(), message, "merge or remove links"));
        }
        let solids = Vec::new();
        let fields = Vec::new();
        let node = Node {
            name: None,
            parent,
            part: 0,
            kind,
            solids,
            hulls: Hulls::new(),
            fields,
            color: None,
            no_self_collision: false,
            near_root: false,
        };
        self.robot.nodes.push(node);
        Ok(index)
    }

    /// A primitive collision shape, in its link's frame.
    fn shape(&self, link: usize, collision: &UrdfCollision) -> Result<Primitive, FileError> {
        let name = self.urdf.links[link].name.as_str();
        let place = collision.origin;
        // URDF's cylinders and capsules are along z, those of ZRP along y.
        let along_z = place * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
        let (shape, pose) = match &collision.geometry {
            UrdfGeometry::Sphere { radius } => (Shape::Sphere { radius: *radius }, place),
            UrdfGeometry::Box { size } => (Shape::Box { size: *size }, place),
            UrdfGeometry::Cylinder { radius, length } => {
                (Shape::Cylinder { radius: *radius, height: *length }, along_z)
            }
            UrdfGeometry::Capsule { radius, length } => (Shape::Capsule { radius: *radius, height: *length }, along_z),
            UrdfGeometry::Mesh { filename, .. } => {
                let issue = MeshIssue::in_file("is no shape");
                return Err(self.bad_mesh(name, collision, filename, &issue));
            }
        };
        let sizes = match shape {
            Shape::Sphere { radius } => [radius; 3],
            Shape::Cylinder { radius, height } | Shape::Capsule { radius, height } => [radius, height, 1.0],
            Shape::Box { size } => size.into(),
        };
        if sizes.iter().any(|s| !(s.is_finite() && *s > 0.0 && *s < 1e6)) {
            let message = format!("link `{name}`: a collision shape has a size that is not above zero");
            return Err(self.source.error(collision.at.clone(), message, "write finite numbers, and sizes above zero"));
        }
        Ok(Primitive { shape, pose })
    }

    /// The mesh of a collision; adds the warnings about its file.
    fn mesh(
        &mut self,
        link: &str,
        collision: &UrdfCollision,
        file: &str,
        scale: &Vector3<f64>,
    ) -> Result<Rc<MeshFile>, FileError> {
        let read = self.meshes.get(file).map_err(|issue| self.bad_mesh(link, collision, file, &issue))?;
        for MeshIssue { message, remedy } in self.meshes.take_notes(file) {
            let message = format!("link `{link}`: the mesh {file} {message}");
            self.warnings.push(self.source.warning(collision.at.clone(), message, remedy));
        }
        self.sizes.mesh(link, collision, (file, &read.mesh), scale);
        Ok(read)
    }

    fn bad_mesh(&self, link: &str, collision: &UrdfCollision, file: &str, issue: &MeshIssue) -> FileError {
        let message = format!("link `{link}`: the mesh {file} {}", issue.message);
        self.source.error(collision.at.clone(), message, issue.remedy.as_str())
    }
}

/// Transforms a mesh to its link's frame, meters; first rotates it if its y is up. The triangles of a mirrored mesh are
/// reversed, so that their normals still point outward.
fn placed(mesh: &Mesh, turn: bool, scale: &Vector3<f64>, link_from_mesh: &Isometry3<f64>) -> Mesh {
    let upright = |v: &Vector3<f64>| if turn { upright::z_up(v) } else { *v };
    let place = |v: &Vector3<f64>| link_from_mesh.transform_point(&upright(v).component_mul(scale).into()).coords;
    let mirrored = scale.product() < 0.0;
    let triangles = mesh.triangles.iter().map(|[a, b, c]| if mirrored { [*a, *c, *b] } else { [*a, *b, *c] });
    Mesh { vertices: mesh.vertices.iter().map(place).collect(), triangles: triangles.collect() }
}

/// The motion of a joint of the file.
pub(super) fn motion(joint: &UrdfJoint) -> JointMotion {
    match joint.joint_type {
        JointType::Prismatic => JointMotion::Slide,
        _ => JointMotion::Turn,
    }
}

/// A joint's axis in its own frame; `None` if it has no direction.
pub(super) fn axis(xyz: &Vector3<f64>) -> Option<Unit<Vector3<f64>>> {
    Unit::try_new(*xyz, 1e-9)
}
