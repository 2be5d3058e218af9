//! A robot as its file describes it: parts, motors, a tree of nodes, shapes, markers and constraints.

use crate::hull::Hulls;
use crate::shape::Primitive;
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::Arc;

/// A robot model. Built by the loaders, never changed afterwards.
///
/// Everything refers to everything else by its number: a pose, a node table and a pair table are plain vectors, and a robot can
/// be copied, compared and sent anywhere.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// The file's `robotName`.
    pub name: String,
    /// Body parts in order of first appearance.
    pub parts: Vec<Part>,
    /// All motors, part by part and by index within the part. **This is the order of every pose vector.**
    pub motors: Vec<Motor>,
    /// All links and joints in order of their start tags; a parent always stands before its children.
    pub nodes: Vec<Node>,
    /// Markers in order of appearance.
    pub markers: Vec<Marker>,
    /// Which pairs of nodes are tested against each other: see [`Robot::left_out`].
    pub pairs: NodePairs,
    /// The pairs that are not, if the file lists them; `None` leaves that to the adjacency filter of the format. Changed only by
    /// [`Robot::leave_out`], since `pairs` follows from it.
    pub left_out: Option<Vec<LeftOut>>,
    /// Links of the URDF that have a visual and no shape that collides: they touch nothing.
    pub bare: Vec<String>,
}

/// A body part, as a YARP control board would serve it.
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

/// A disjunction of half-spaces: satisfied if the value of any member is above zero. Clauses together make any region of joint
/// space, not only convex ones: "the arm is down *or* the torso is turned away".
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

/// A motor: one encoder, one or several joints. The joints follow it linearly, each over its own range: three finger joints
/// may hang on one tendon.
///
/// Its encoder counts *units*: degrees where it turns, millimeters where it slides. Inside the program a unit is pi/180, whatever
/// it counts, and is called "rad of encoder": so one tolerance, one speed and one distance in joint space serve all motors.
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
    /// What its encoder counts: degrees of a turn, or millimeters of a slide.
    pub motion: JointMotion,
    /// Maximum speed, rad/s of encoder, if the file limits it. A board's own limit holds as well.
    pub max_speed: Option<f64>,
    /// Whether it turns without end, so that positions a full turn apart are one (see [`Motor::nearest_equivalent`]).
    pub continuous: bool,
    /// The joints it drives, as indices into [`Robot::nodes`].
    pub joints: Vec<usize>,
    /// Whether it is the first motor created in its part (Jacobian chains end there).
    pub is_part_root: bool,
}

/// How a joint moves what it carries, and so what its motor's encoder counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JointMotion {
    /// About its axis; joints count radians, encoders degrees.
    #[default]
    Turn,
    /// Along its axis; joints count meters, encoders millimeters.
    Slide,
}

impl JointMotion {
    /// A joint's position (rad or meters) as rad of its motor's encoder, which counts degrees or millimeters.
    pub fn encoder(self, position: f64) -> f64 {
        match self {
            Self::Turn => position,
            Self::Slide => (position * 1000.0).to_radians(),
        }
    }
}

/// A node of the kinematic tree: a link, which moves the frame of its children, or a joint, which turns it or slides it.
///
/// Its own frame, in which its shapes and markers are, is the one *before* that motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its name, unique in the robot, if the file gives one: for a converted robot the link of the URDF that its shapes are from.
    pub name: Option<Arc<str>>,
    /// The parent, an index into [`Robot::nodes`]; `None` for a root.
    pub parent: Option<usize>,
    /// Index into [`Robot::parts`].
    pub part: usize,
    /// Link or joint.
    pub kind: NodeKind,
    /// Shapes that collide.
    pub solids: Vec<Primitive>,
    /// What those of them really hold that are more than that: by their number among the solids.
    pub hulls: Hulls,
    /// Shapes of the force field.
    pub fields: Vec<Primitive>,
    /// What simulated cameras see its shapes painted in, red, green and blue; `None`: as robots are.
    pub color: Option<[u8; 3]>,
    /// Whether the file marks this node's subtree `noSelfCollision`.
    pub no_self_collision: bool,
    /// Whether it belongs to the base, which is never tested against the world.
    pub near_root: bool,
}

/// What a node does to the frame of its children.
#[derive(Clone, Debug, PartialEq)]
pub enum NodeKind {
    /// A pure translation, meters.
    Link {
        /// The link vector.
        offset: Vector3<f64>,
    },
    /// A pure rotation about an axis through the node's origin, or a translation along it.
    Joint {
        /// Which of the two.
        motion: JointMotion,
        /// Direction of the axis.
        axis: Unit<Vector3<f64>>,
        /// The motor that drives it, an index into [`Robot::motors`].
        motor: usize,
        /// Where it stands at the motor's lower limit, rad or meters.
        min: f64,
        /// Where it stands at the motor's upper limit, rad or meters.
        max: f64,
        /// Length of the axis as the file gives it, meters (the height of its own cylinder).
        length: f64,
    },
}

/// A named point and direction on a node: what an agent reaches with.
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

/// A pair of nodes that are not tested against each other, and why.
#[derive(Clone, Debug, PartialEq)]
pub struct LeftOut {
    /// The two, the lower number first; each has a name.
    pub nodes: (usize, usize),
    /// For people, such as `neighbors`.
    pub reason: String,
}

/// Node pairs `(a, b)` with `a <= b`, sorted, that are tested: neighbors in the tree always touch, and would keep the reflex busy
/// for ever.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodePairs {
    /// A contact makes the reflex act.
    pub reflex: Vec<(usize, usize)>,
    /// A contact is shown but does not count.
    pub visual_only: Vec<(usize, usize)>,
    /// Force-field shapes that repel each other.
    pub field: Vec<(usize, usize)>,
}
