//! Robot model as its file describes it: parts, motors, a tree of nodes, shapes, markers and constraints.

use crate::hull::Hulls;
use crate::shape::Primitive;
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// A robot model. Built by the loaders, and not changed afterward.
///
/// All references are indices: configurations, node tables and pair tables are plain vectors, and a robot can be
/// copied, compared and sent between threads.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// The file's `robotName`.
    pub name: String,
    /// Body parts in order of first appearance.
    pub parts: Vec<Part>,
    /// All motors, part by part and by index within the part. **This is the order of every configuration vector.**
    pub motors: Vec<Motor>,
    /// All links and joints in order of their start tags; a parent always precedes its children.
    pub nodes: Vec<Node>,
    /// Markers in order of appearance.
    pub markers: Vec<Marker>,
    /// Pairs of nodes that are tested against each other: see [`Robot::left_out`].
    pub pairs: NodePairs,
    /// The disabled pairs, if the file lists them; `None`: the adjacency filter of the format decides. Changed only by
    /// [`Robot::leave_out`], since `pairs` is derived from it.
    pub left_out: Option<Vec<LeftOut>>,
    /// Tested pairs with a clearance of their own; changed only by [`Robot::bring_near`].
    pub near: Vec<NearPair>,
    /// Links of the URDF with a visual but without a collision shape: they touch nothing.
    pub bare: Vec<String>,
}

/// A body part, corresponding to a YARP control board.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its name, such as `torso`.
    pub name: String,
    /// Its motors, as a range of [`Robot::motors`].
    pub motors: Range<usize>,
    /// Its root node (the frame of `tolo` and `togl`), if it has any node.
    pub root_node: Option<usize>,
    /// Constraints in conjunctive form: every clause must hold.
    pub clauses: Vec<Clause>,
}

/// A disjunction of half-spaces: satisfied if the value of any member is above zero. Several clauses can describe any
/// region of joint space, also non-convex ones: "the arm is down *or* the torso is turned away".
#[derive(Clone, Debug, PartialEq)]
pub struct Clause(pub Vec<HalfSpace>);

/// A half-space over motor positions: `sum(a_i * degrees(q_i)) + b`, in encoder units (degrees or millimeters, see [`Motor`]).
#[derive(Clone, Debug, PartialEq)]
pub struct HalfSpace {
    /// Pairs of (index into [`Robot::motors`], coefficient).
    pub terms: Vec<(usize, f64)>,
    /// The constant, in encoder units.
    pub b: f64,
}

/// A motor: one encoder, one or several joints. The joints follow it linearly, each over its own range: one tendon may
/// drive three finger joints.
///
/// Its encoder counts *units*: degrees for revolute, millimeters for prismatic motion. Internally a unit is pi/180 in
/// either case, and is called "rad of encoder": thus one tolerance, one speed and one distance in joint space apply to
/// all motors.
#[derive(Clone, Debug, PartialEq)]
pub struct Motor {
    /// Its name, unique within the robot.
    pub name: String,
    /// Index into [`Robot::parts`].
    pub part: usize,
    /// Lower limit, rad of encoder.
    pub min: f64,
    /// Upper limit, rad of encoder.
    pub max: f64,
    /// Home position within the limits, rad of encoder.
    pub home: f64,
    /// Kind of motion: its encoder counts degrees if revolute, millimeters if prismatic.
    pub motion: JointMotion,
    /// Maximum speed, rad/s of encoder, if the file limits it. The limit of the control board applies as well.
    pub max_speed: Option<f64>,
    /// True if it is continuous, so that positions a full turn apart are equivalent (see
    /// [`Motor::nearest_equivalent`]).
    pub continuous: bool,
    /// The joints it drives, as indices into [`Robot::nodes`].
    pub joints: Vec<usize>,
    /// True if it is the first motor created in its part (Jacobian chains end there).
    pub is_part_root: bool,
}

/// Kind of motion of a joint, which determines the units of its motor's encoder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointMotion {
    /// Revolute: rotates about its axis; joints count radians, encoders degrees.
    #[default]
    Turn,
    /// Prismatic: translates along its axis; joints count meters, encoders millimeters.
    Slide,
}

impl JointMotion {
    /// Converts a joint's position (rad or meters) to rad of its motor's encoder, which counts degrees or millimeters.
    pub fn encoder(self, position: f64) -> f64 {
        match self {
            Self::Turn => position,
            Self::Slide => (position * 1000.0).to_radians(),
        }
    }
}

/// A node of the kinematic tree: a link, which translates the frame of its children, or a joint, which rotates or
/// translates it.
///
/// Its own frame, in which its shapes and markers are given, is the one *before* that motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its name, unique in the robot, if the file gives one. For a converted robot it is the link of the URDF that its
    /// shapes belong to.
    pub name: Option<Arc<str>>,
    /// The parent, an index into [`Robot::nodes`]; `None` for a root.
    pub parent: Option<usize>,
    /// Index into [`Robot::parts`].
    pub part: usize,
    /// Link or joint.
    pub kind: NodeKind,
    /// Collision shapes.
    pub solids: Vec<Primitive>,
    /// The hulls of those solids that are larger than their solid part, by index among the solids.
    pub hulls: Hulls,
    /// Shapes of the force field.
    pub fields: Vec<Primitive>,
    /// Color of its shapes in simulated cameras, red, green and blue; `None`: the default color of robots.
    pub color: Option<[u8; 3]>,
    /// True if the file marks this node's subtree `noSelfCollision`.
    pub no_self_collision: bool,
    /// True if it belongs to the base, which is never tested against the world.
    pub near_root: bool,
}

/// The motion of a node: the transform of its children's frame.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeKind {
    /// A pure translation, meters.
    Link {
        /// The link vector.
        offset: Vector3<f64>,
    },
    /// A pure rotation about an axis through the node's origin, or a translation along it.
    Joint {
        /// Rotation or translation.
        motion: JointMotion,
        /// Direction of the axis.
        axis: Unit<Vector3<f64>>,
        /// The motor that drives it, an index into [`Robot::motors`].
        motor: usize,
        /// Position at the motor's lower limit, rad or meters.
        min: f64,
        /// Position at the motor's upper limit, rad or meters.
        max: f64,
        /// Length of the axis as the file gives it, meters (the height of its own cylinder).
        length: f64,
    },
}

/// A named point and direction on a node, such as a hand: the target of reaching motions is given for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Marker {
    /// Its name.
    pub name: String,
    /// The node, an index into [`Robot::nodes`]; the marker is at the origin of that node's frame.
    pub node: usize,
    /// The part it belongs to, an index into [`Robot::parts`].
    pub part: usize,
    /// Unit normal in the node's frame.
    pub normal: Unit<Vector3<f64>>,
    /// Number of display spheres in its trail.
    pub tracer: u32,
}

/// A disabled pair of nodes, with the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// The two nodes, the lower index first; both have names.
    pub nodes: (usize, usize),
    /// Reason for display, such as `neighbors`.
    pub reason: String,
}

/// A pair of nodes that are near each other by design, such as two fingers.
#[derive(Clone, Debug, PartialEq)]
pub struct NearPair {
    /// The two nodes, the lower index first; both have names.
    pub nodes: (usize, usize),
    /// Clearance of the pair, meters: it replaces every larger one, that of the reflex and of planners alike.
    pub clearance: f64,
    /// Reason for display.
    pub reason: String,
}

/// Tested node pairs `(a, b)` with `a <= b`, sorted. Pairs of neighbors in the tree are excluded: they always touch,
/// and would trigger the reflex permanently.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodePairs {
    /// Pairs whose contact triggers the reflex.
    pub reflex: Vec<(usize, usize)>,
    /// Pairs whose contact is displayed but has no effect.
    pub visual_only: Vec<(usize, usize)>,
    /// Pairs whose force-field shapes repel each other.
    pub field: Vec<(usize, usize)>,
}
