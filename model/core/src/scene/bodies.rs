//! The robots of a scene, prepared: solid shapes on moving frames, and the tested pairs.
//!
//! Frames and motors are numbered consecutively over all robots, so that all later steps work on vectors and indices,
//! for one robot as for three.

use super::edit::{check_count, check_pose, check_primitive};
use super::travel::{FrameReach, Terms};
use super::{SceneError, ShapeId, Skeleton};
use crate::engine::{Collider, IndexPair};
use crate::robot::Robot;
use nalgebra::Isometry3;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Maximum number of pairs that may touch: more could not be monitored many times per second.
pub const MAX_PAIRS: usize = 1 << 18;

/// A shape of a robot or an object.
#[derive(Clone, Debug)]
pub(crate) struct Solid {
    /// Its public identity.
    pub id: ShapeId,
    /// Its shape for the engine. Frames are numbered over all robots of the scene; objects share the last one, the
    /// world.
    pub collider: Collider,
    /// True if no robot's motion moves it.
    pub fixed: bool,
    /// True if it belongs to a robot's base, which is not tested against the world.
    pub near_root: bool,
}

/// The robots of a scene, with the data derived from them.
#[derive(Debug)]
pub(crate) struct Bodies {
    /// The robots, in the order of configurations.
    pub robots: Vec<Arc<Robot>>,
    /// Per robot: its moving frames.
    pub skeletons: Vec<Skeleton>,
    /// Motion bounds of each robot's shapes.
    pub reach: Vec<FrameReach>,
    /// Index of each robot's first motor among all motors of the scene.
    pub first_motor: Vec<usize>,
    /// Number of motors of all robots.
    pub motors: usize,
    /// Index of each robot's first frame.
    pub first_frame: Vec<usize>,
    /// Number of frames of all robots.
    pub frames: usize,
    /// Solids of all robots in order of their ids.
    pub solids: Vec<Solid>,
    /// Reflex pairs within and between robots that can move relative to each other; indices, sorted.
    pub moving: Vec<IndexPair>,
    /// Reflex pairs within and between robots that can't move relative to each other; indices, sorted.
    pub fixed: Vec<IndexPair>,
    /// Solids that are tested against objects, and can move relative to them; sorted. A base is not tested against the
    /// world that it stands on.
    pub tested: Vec<u32>,
    /// The same for solids that can't move.
    pub tested_fixed: Vec<u32>,
    /// Per frame: bound of the motion of its shapes in the world.
    pub world_travel: Vec<Terms>,
}

impl Bodies {
    /// Prepares robots, each at its `world_from_robot`.
    ///
    /// # Errors
    /// If two robots have the same name, a number is not finite, or there are too many of anything.
    pub fn new(robots: Vec<(Arc<Robot>, Isometry3<f64>)>) -> Result<Self, SceneError> {
        check_count(robots.len(), || "robots of a scene".to_string())?;
        let mut names = BTreeSet::new();
        let mut bodies = Bodies {
            robots: Vec::new(),
            skeletons: Vec::new(),
            reach: Vec::new(),
            first_motor: Vec::new(),
            motors: 0,
            first_frame: Vec::new(),
            frames: 0,
            solids: Vec::new(),
            moving: Vec::new(),
            fixed: Vec::new(),
            tested: Vec::new(),
            tested_fixed: Vec::new(),
            world_travel: Vec::new(),
        };
        for (robot, base) in robots {
            check(&robot, &base)?;
            if !names.insert(robot.name.clone()) {
                return Err(SceneError::Duplicate { kind: "robot", name: robot.name.clone() });
            }
            bodies.add(robot, base)?;
        }
        bodies.moving.sort_unstable();
        bodies.fixed.sort_unstable();
        for (i, solid) in bodies.solids.iter().enumerate().filter(|(_, solid)| !solid.near_root) {
            let list = if solid.fixed { &mut bodies.tested_fixed } else { &mut bodies.tested };
            list.push(i as u32);
        }
        bodies.world_travel = (0..bodies.frames).map(|f| bodies.travel(f, bodies.frames)).collect();
        Ok(bodies)
    }

    /// Adds one robot, with its pairs with itself and with the robots added before.
    fn add(&mut self, robot: Arc<Robot>, base: Isometry3<f64>) -> Result<(), SceneError> {
        let index = self.robots.len();
        let skeleton = Skeleton::new(&robot, base);
        let first_solid = self.solids.len();
        // Per node, the range of its solids among all solids.
        let mut of_node = Vec::with_capacity(robot.nodes.len());
        for (n, node) in robot.nodes.iter().enumerate() {
            let start = self.solids.len() as u32;
            for (s, primitive) in node.solids.iter().enumerate() {
                let id = ShapeId::Robot { robot: index as u16, node: n as u16, shape: s as u16 };
                let pose = skeleton.in_frame[n] * primitive.pose;
                let hull = node.hulls.get(&s).map(|hull| Arc::new(hull.moved(&skeleton.in_frame[n])));
                let frame = self.frames + skeleton.frame[n];
                self.solids.push(Solid {
                    id,
                    collider: Collider::new(primitive.shape, frame, pose).with_hull(hull),
                    fixed: skeleton.frame[n] == 0,
                    near_root: node.near_root,
                });
            }
            of_node.push(start..self.solids.len() as u32);
        }
        // Counted before the pairs are built: their list could exceed the memory.
        let own: usize = robot.pairs.reflex.iter().map(|&(a, b)| of_node[a].len() * of_node[b].len()).sum();
        if own + first_solid * (self.solids.len() - first_solid) > MAX_PAIRS {
            let what = format!("pairs of shapes of robot `{}`, with itself and the robots before it", robot.name);
            return Err(SceneError::TooMany { what, most: MAX_PAIRS as u32 });
        }
        for &(a, b) in &robot.pairs.reflex {
            // Shapes of one frame are rigidly connected: no motion changes their distance, so it need not be monitored.
            let same = skeleton.frame[a] == skeleton.frame[b];
            let list = if same { &mut self.fixed } else { &mut self.moving };
            for i in of_node[a].clone() {
                for j in of_node[b].clone() {
                    // A node may be paired with itself; then every two of its shapes are listed once.
                    if a != b || i < j {
                        list.push((i.min(j), i.max(j)));
                    }
                }
            }
        }
        // Against the robots added before: everything except base against base.
        for i in 0..first_solid {
            for j in first_solid..self.solids.len() {
                let a = &self.solids[i];
                let b = &self.solids[j];
                // Bases are placed by the user, perhaps on one table; no motion changes their distance.
                if a.near_root && b.near_root {
                    continue;
                }
                let list = if a.fixed && b.fixed { &mut self.fixed } else { &mut self.moving };
                list.push((i as u32, j as u32));
            }
        }
        let colliders: Vec<Collider> = self.solids[first_solid..].iter().map(|s| s.collider.clone()).collect();
        self.reach.push(FrameReach::new(&skeleton, self.frames, &colliders));
        self.first_motor.push(self.motors);
        self.motors += robot.motors.len();
        self.first_frame.push(self.frames);
        self.frames += skeleton.frames();
        self.skeletons.push(skeleton);
        self.robots.push(robot);
        Ok(())
    }

    /// Upper bound of the relative motion between the shapes of two frames of the scene.
    pub fn travel(&self, a: usize, b: usize) -> Terms {
        let owner = |frame: usize| {
            let robot = self.first_frame.partition_point(|first| *first <= frame).checked_sub(1)?;
            let local = frame - self.first_frame[robot];
            (local < self.skeletons[robot].frames()).then_some((robot, local))
        };
        let alone = |(r, f): (usize, usize)| self.reach[r].between(&self.skeletons[r], self.first_motor[r], f, 0);
        match (owner(a), owner(b)) {
            (Some((r, f)), Some((q, g))) if r == q => {
                self.reach[r].between(&self.skeletons[r], self.first_motor[r], f, g)
            }
            // Shapes of different robots, or of a robot and the world: each moves relative to its base, and in the
            // worst case the motions add up.
            (one, other) => one.into_iter().chain(other).flat_map(alone).collect(),
        }
    }

    /// Computes `world_from_frame` of all frames: robot by robot, then the world itself.
    pub fn place<P: AsRef<[f64]>>(&self, poses: &[P], frames: &mut Vec<Isometry3<f64>>) {
        frames.clear();
        for (r, skeleton) in self.skeletons.iter().enumerate() {
            skeleton.place(poses.get(r).map_or(&[], AsRef::as_ref), frames);
        }
        frames.push(Isometry3::identity());
    }
}

/// Checks the numbers and sizes of a robot.
///
/// # Errors
/// If a number is not finite, a size is not above zero, or there are more nodes or shapes than ids.
fn check(robot: &Robot, base: &Isometry3<f64>) -> Result<(), SceneError> {
    let what = format!("robot `{}`", robot.name);
    check_pose(base, &what)?;
    check_count(robot.nodes.len(), || format!("nodes of {what}"))?;
    for (n, node) in robot.nodes.iter().enumerate() {
        let what = format!("node {n} of {what}");
        check_count(node.solids.len().max(node.fields.len()), || format!("shapes of {what}"))?;
        node.solids.iter().chain(&node.fields).try_for_each(|p| check_primitive(p, &what))?;
    }
    Ok(())
}
