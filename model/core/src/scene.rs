//! Robots and objects in one world, and queries for contacts between them.
//!
//! A [`Scene`] is an immutable snapshot; an edit creates a new one with a higher epoch. Planners can hold theirs
//! indefinitely.

mod bodies;
mod edit;
mod label;
mod line;
mod pair_lists;
mod pair_rules;
mod queries;
mod report;
mod skeleton;
mod torques;
mod travel;
mod world;

pub(crate) use bodies::Bodies;
pub use bodies::MAX_PAIRS;
pub use edit::{Edit, SceneError};
pub use label::Labels;
pub use line::LineVerdict;
pub(crate) use pair_lists::PairGroup;
pub use pair_rules::PairRule;
use pair_rules::ResolvedRule;
pub use report::{ContactKind, ReportedContact};
pub use skeleton::{Hinge, Skeleton};
pub use travel::Lever;
pub(crate) use world::SolidWorld;

use crate::engine::{Collider, DefaultEngine, Engine, IndexPair};
use crate::robot::Robot;
use crate::shape::Primitive;
use nalgebra::{Isometry3, Point3, Vector3};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Role of an object for the robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObjectClass {
    /// An obstacle: contact triggers the reflex.
    #[serde(alias = "obs")]
    Obstacle,
    /// A target to reach for; never collides.
    #[serde(alias = "tgt")]
    Target,
    /// Display only; never collides.
    #[serde(alias = "gho")]
    Ghost,
}

impl ObjectClass {
    /// The words in files and requests: for each class its own and that of the original program.
    pub const WORDS: [(&str, ObjectClass); 6] = [
        ("obstacle", ObjectClass::Obstacle),
        ("target", ObjectClass::Target),
        ("ghost", ObjectClass::Ghost),
        ("obs", ObjectClass::Obstacle),
        ("tgt", ObjectClass::Target),
        ("gho", ObjectClass::Ghost),
    ];

    /// The class of a word, in our notation or the original program's (`obs`, `tgt`, `gho`).
    ///
    /// # Examples
    /// ```
    /// # use mobee_model::ObjectClass;
    /// assert_eq!(ObjectClass::of_word("tgt"), ObjectClass::of_word("target"));
    /// assert_eq!(ObjectClass::of_word("goal"), None);
    /// ```
    pub fn of_word(word: &str) -> Option<ObjectClass> {
        ObjectClass::WORDS.iter().find(|(known, _)| *known == word).map(|(_, class)| *class)
    }
}

/// A rigid object of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its name, unique in the world.
    pub name: String,
    /// Its role.
    pub class: ObjectClass,
    /// True if `rm` and `clr` do not remove it.
    pub persistent: bool,
    /// `world_from_object`.
    pub pose: Isometry3<f64>,
    /// Its shapes.
    pub shapes: Vec<Primitive>,
    /// Display color, if the file gives one.
    pub color: Option<[u8; 3]>,
}

impl Object {
    /// Its center in its own frame, meters: the mean of its shapes' centers. Sensors locate an object by this point.
    pub fn middle(&self) -> Vector3<f64> {
        let sum: Vector3<f64> = self.shapes.iter().map(|s| s.pose.translation.vector).sum();
        sum / self.shapes.len().max(1) as f64
    }

    /// Its extent from its origin in a direction of unit length in its own frame, meters; 0 without a shape.
    pub fn extent(&self, toward: &Vector3<f64>) -> f64 {
        let extent = |s: &Primitive| {
            s.pose.translation.vector.dot(toward) + s.shape.extent(&(s.pose.rotation.inverse() * toward))
        };
        self.shapes.iter().map(extent).reduce(f64::max).unwrap_or(0.0)
    }
}

/// Identity of a shape, stable under edits of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ShapeId {
    /// A solid shape of a robot.
    Robot {
        /// Index of the robot in the scene.
        robot: u16,
        /// Index into [`Robot::nodes`].
        node: u16,
        /// Index into the node's solids (or fields, for field pairs).
        shape: u16,
    },
    /// A shape of an object.
    Object {
        /// The object's id, not reused after its removal.
        object: u32,
        /// Index into [`Object::shapes`].
        shape: u16,
    },
}

impl ShapeId {
    /// Index of the shape's robot.
    pub fn robot(self) -> Option<usize> {
        match self {
            ShapeId::Robot { robot, .. } => Some(usize::from(robot)),
            ShapeId::Object { .. } => None,
        }
    }
}

/// Two shapes, the smaller id first. Robots precede objects, so an object is always the second.
pub type Pair = (ShapeId, ShapeId);

/// Two shapes that are near each other or overlap, as found by a query of a [`Scene`] at one configuration.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Contact {
    /// The two shapes.
    pub pair: Pair,
    /// Signed distance in meters; negative is penetration depth.
    pub distance: f64,
    /// The nearest (or deepest) points on the two shapes, world frame.
    pub points: [Point3<f64>; 2],
}

impl Contact {
    /// The motors of one of the scene's robots that can change the distance of this pair.
    pub fn movers(&self, robots: &[Arc<Robot>], robot: usize) -> BTreeSet<usize> {
        let node = |shape: ShapeId| match shape {
            ShapeId::Robot { robot: r, node, .. } if usize::from(r) == robot => Some(usize::from(node)),
            _ => None,
        };
        robots.get(robot).map(|robot| robot.movers(node(self.pair.0), node(self.pair.1))).unwrap_or_default()
    }
}

/// An immutable world of robots and objects.
///
/// Created by [`Scene::new`]; [`Scene::edit`] derives a changed one. Cloning is cheap. The queries are
/// [`Scene::contacts`], [`Scene::clearance`], [`Scene::free`], [`Scene::line`] and [`Scene::report`]; all of them take
/// one configuration per robot, in the order of [`Scene::robots`].
///
/// `E` is the collision engine; plain `Scene` uses the default.
///
/// # Example
/// ```
/// use mobee_model::{Edit, Object, ObjectClass, Primitive, Scene, Shape, load_robot};
/// use nalgebra::Isometry3;
/// use std::sync::Arc;
///
/// let robot = Arc::new(load_robot("../../configs/robots/katana.xml")?.value);
/// let scene = Scene::new(vec![(robot, Isometry3::identity())], Vec::new())?;
/// let home = scene.home();
/// assert!(scene.free(&home, 0.0));
///
/// // A ball of 5 cm radius about the origin of the last node contains the gripper.
/// let gripper = scene.node_transforms(&home)[0].last().copied().unwrap_or_default();
/// let shapes = vec![Primitive { shape: Shape::Sphere { radius: 0.05 }, pose: Isometry3::identity() }];
/// let class = ObjectClass::Obstacle;
/// let ball = Object { name: "ball".into(), class, persistent: false, pose: gripper, shapes, color: None };
/// let crowded = scene.edit(&Edit::Add(ball))?;
/// let deepest = crowded.clearance(&home, 0.0).expect("something touches");
/// assert!(deepest.distance < 0.0 && crowded.shape_name(deepest.pair.1) == "ball#0");
/// assert!(scene.free(&home, 0.0), "the old snapshot is as it was");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Scene<E: Engine = DefaultEngine> {
    /// Number of edits since [`Scene::new`].
    epoch: u64,
    /// Id of the next object.
    next_object: u32,
    /// Objects with their ids, in order of insertion.
    objects: Vec<(u32, Arc<Object>)>,
    /// Shared by all snapshots derived from one scene: edits do not change the robots.
    bodies: Arc<Bodies>,
    /// Rules for pairs, of queries such as a pick: see [`Scene::with_pair_rules`].
    rules: Arc<[ResolvedRule]>,
    /// Derived from the old one by each edit.
    world: Arc<SolidWorld<E>>,
}

impl Scene {
    /// Creates a scene of robots and objects, with the default engine.
    ///
    /// # Arguments
    /// * `robots`: each with its base pose, `world_from_robot`. Their order is that of the configurations in every
    ///   query.
    /// * `objects`: numbered in this order, from 0.
    ///
    /// # Errors
    /// If two robots or two objects have one name, a size or pose is not finite, or there are too many of anything.
    pub fn new(robots: Vec<(Arc<Robot>, Isometry3<f64>)>, objects: Vec<Object>) -> Result<Self, SceneError> {
        Self::with_engine(robots, objects)
    }
}

impl<E: Engine> Scene<E> {
    /// As [`Scene::new`], for another engine: `Scene::<MyEngine>::with_engine(..)`.
    ///
    /// # Errors
    /// As [`Scene::new`].
    pub fn with_engine(robots: Vec<(Arc<Robot>, Isometry3<f64>)>, objects: Vec<Object>) -> Result<Self, SceneError> {
        let bodies = Arc::new(Bodies::new(robots)?);
        let world = Arc::new(SolidWorld::alone(&bodies));
        let empty = Scene { epoch: 0, next_object: 0, objects: Vec::new(), bodies, rules: Arc::new([]), world };
        let mut scene = empty.with(|scene| objects.into_iter().try_for_each(|object| scene.add(object)))?;
        scene.epoch = 0;
        Ok(scene)
    }

    /// Number of edits: equal epochs of snapshots derived from one scene mean equal scenes. Long-lived holders of a
    /// scene (a planner, a recording) compare it to detect changes of the world.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }
    /// The robots, in the order of the configurations in every query.
    pub fn robots(&self) -> &[Arc<Robot>] {
        &self.bodies.robots
    }
    /// Base pose of a robot: `world_from_robot`. The identity if there is no such robot.
    pub fn base(&self, robot: usize) -> Isometry3<f64> {
        self.bodies.skeletons.get(robot).map_or_else(Isometry3::identity, |s| s.base)
    }
    /// The objects with their ids, in order of insertion.
    pub fn objects(&self) -> impl Iterator<Item = (u32, &Arc<Object>)> {
        self.objects.iter().map(|(id, o)| (*id, o))
    }
    /// The object of that name.
    pub fn object(&self, name: &str) -> Option<(u32, &Arc<Object>)> {
        self.objects().find(|(_, o)| o.name == name)
    }
    /// The home configurations of all robots, rad of encoder.
    pub fn home(&self) -> Vec<Arc<[f64]>> {
        self.robots().iter().map(|r| r.motors.iter().map(|m| m.home).collect()).collect()
    }
    /// A shape's stable name, such as `ur5:forearm_link#0` (robot, link, shape number), `icub:left_arm/31#0` (part and
    /// node number, if the link has no name) or `table#1`.
    pub fn shape_name(&self, id: ShapeId) -> String {
        match id {
            ShapeId::Robot { robot, node, shape } => {
                let Some(owner) = self.robots().get(usize::from(robot)) else {
                    return format!("robot{robot}:{node}#{shape}");
                };
                let of = owner.nodes.get(usize::from(node));
                match of.map(|n| (n.name.as_deref(), owner.parts.get(n.part))) {
                    Some((Some(link), _)) => format!("{}:{link}#{shape}", owner.name),
                    Some((None, Some(part))) => format!("{}:{}/{node}#{shape}", owner.name, part.name),
                    _ => format!("{}:?/{node}#{shape}", owner.name),
                }
            }
            ShapeId::Object { object, shape } => match self.objects.iter().find(|(o, _)| *o == object) {
                Some((_, o)) => format!("{}#{shape}", o.name),
                None => format!("object{object}#{shape}"),
            },
        }
    }
    /// The robots' moving frames, in the order of the robots. Frames are numbered consecutively: those of the first
    /// robot, then those of the second and so on; the last one is the world.
    pub fn skeletons(&self) -> &[Skeleton] {
        &self.bodies.skeletons
    }
    /// All solid shapes, those of the robots before those of the obstacles, on frames numbered as in
    /// [`Scene::skeletons`].
    pub fn colliders(&self) -> impl ExactSizeIterator<Item = &Collider> {
        (0..self.world.solids.len()).map(|i| &self.world.solids[i].collider)
    }
    /// The reflex pairs that can move relative to each other, as indices into [`Scene::colliders`]; every query tests
    /// these.
    pub fn pairs(&self) -> &[IndexPair] {
        &self.world.lists.pairs
    }
    /// The clearance that applies to one of [`Scene::pairs`] if `clearance` meters apply in general: the lower one if
    /// the pair has a clearance of its own. All queries use it, so a pair that is near by design is no contact.
    pub fn pair_clearance(&self, pair: IndexPair, clearance: f64) -> f64 {
        self.world.clearance_of(pair, clearance)
    }
    /// The identity of a collider's shape.
    pub fn shape_id(&self, collider: u32) -> Option<ShapeId> {
        self.world.solids.get(collider as usize).map(|solid| solid.id)
    }
    /// Number of the robots' colliders, which precede those of the objects.
    pub fn robot_colliders(&self) -> usize {
        self.bodies.solids.len()
    }
    /// The robots' colliders that are tested against objects unless a rule omits the pair, in order: all that can move
    /// but those of bases.
    pub fn tested_colliders(&self) -> &[u32] {
        &self.bodies.tested
    }
    /// The robots' colliders that are tested against an object's collider: of [`Scene::pairs`] those with this second
    /// index, in order.
    pub fn tested_against(&self, object: u32) -> Cow<'_, [u32]> {
        let (tested, lists) = (&self.bodies.tested, &self.world.lists);
        let objects = self.robot_colliders()..self.world.solids.len();
        if !objects.contains(&(object as usize)) {
            Cow::Borrowed(&[])
        } else if lists.omits_objects {
            Cow::Owned(tested.iter().copied().filter(|i| lists.pairs.binary_search(&(*i, object)).is_ok()).collect())
        } else {
            Cow::Borrowed(tested)
        }
    }
    /// True if both scenes have the same rules for pairs, and the same robots as [`Scene::has_robots_of`].
    pub fn differs_in_objects_only(&self, other: &Self) -> bool {
        (Arc::ptr_eq(&self.rules, &other.rules) || self.rules == other.rules) && self.has_robots_of(other)
    }
    /// True if both scenes consist of the same robots (not equal ones) at the same base poses.
    pub fn has_robots_of(&self, other: &Self) -> bool {
        let is_same = || {
            let robots = self.robots().iter().zip(other.robots());
            self.robots().len() == other.robots().len()
                && robots.enumerate().all(|(r, (a, b))| Arc::ptr_eq(a, b) && self.base(r) == other.base(r))
        };
        Arc::ptr_eq(&self.bodies, &other.bodies) || is_same()
    }
    /// The engine, with all solid shapes prepared in the order of [`Scene::colliders`].
    pub fn engine(&self) -> &E {
        &self.world.engine
    }
    /// The robots, prepared.
    pub(crate) fn bodies(&self) -> &Bodies {
        &self.bodies
    }
    /// The solids, prepared.
    pub(crate) fn world(&self) -> &SolidWorld<E> {
        &self.world
    }
    /// Touching reflex pairs without a moving joint between them: no motion can change these contacts. All queries
    /// exclude them except [`Scene::report`].
    pub fn static_contacts(&self) -> &[Contact] {
        &self.world.fixed_contacts
    }
}
