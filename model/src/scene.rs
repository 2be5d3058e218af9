//! Robots and objects in one world: who touches whom.
//!
//! A [`Scene`] is an immutable snapshot; an edit makes a new one with a higher epoch. Planners keep theirs as long as they like.

use crate::robot::{Primitive, Robot};
use nalgebra::{Isometry3, Point3};
use std::sync::Arc;

/// What an object is to the robots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ObjectClass {
    /// Touching it makes the reflex act.
    Obstacle,
    /// Something to reach for; never collides.
    Target,
    /// Shown only; never collides.
    Ghost,
}

/// A rigid object of the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its name, unique in the world.
    pub name: String,
    /// What it is to the robots.
    pub class: ObjectClass,
    /// Whether `rm` and `clr` leave it alone.
    pub persistent: bool,
    /// `world_from_object`.
    pub pose: Isometry3<f64>,
    /// Its shapes.
    pub shapes: Vec<Primitive>,
    /// Display colour, if the file gives one.
    pub color: Option<[u8; 3]>,
}

/// A shape's identity, stable over edits of the scene.
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
        /// The object's id, never used again after its removal.
        object: u32,
        /// Index into [`Object::shapes`].
        shape: u16,
    },
}

/// Two shapes, the smaller id first.
pub type Pair = (ShapeId, ShapeId);

/// Two shapes near or in each other.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Contact {
    /// Which two.
    pub pair: Pair,
    /// Signed distance in metres; negative is penetration depth.
    pub distance: f64,
    /// The nearest (or deepest) points on the two shapes, world frame.
    pub points: [Point3<f64>; 2],
}

/// An immutable world of robots and objects.
#[derive(Clone, Debug)]
pub struct Scene {
    epoch: u64,
    robots: Vec<Arc<Robot>>,
    objects: Vec<(u32, Arc<Object>)>,
}

impl Scene {
    /// Counts edits; equal epochs of one lineage mean equal scenes.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }
    /// The robots, in the order of the poses that every query takes.
    pub fn robots(&self) -> &[Arc<Robot>] {
        &self.robots
    }
    /// The objects with their ids, in order of insertion.
    pub fn objects(&self) -> impl Iterator<Item = (u32, &Arc<Object>)> {
        self.objects.iter().map(|(id, o)| (*id, o))
    }
}
