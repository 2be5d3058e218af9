//! Report of all contacts of every kind, as `model eval` writes it.

use super::{Contact, ObjectClass, Scene, ShapeId};
use crate::engine::{Collider, Engine, IndexPair, Near};
use crate::hull::Hulls;
use crate::shape::Primitive;
use nalgebra::Isometry3;

/// Meaning of a contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactKind {
    /// Triggers the reflex.
    Reflex,
    /// Displayed, but without effect: inside a `noSelfCollision` subtree.
    VisualOnly,
    /// Force-field shapes that overlap each other or an obstacle.
    Field,
}

/// A contact with its kind. For fields the shape numbers in the pair are indices into a node's fields, not its solids.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReportedContact {
    /// Its meaning.
    pub kind: ContactKind,
    /// The pair, the depth and the points.
    pub contact: Contact,
}

/// The identity of a shape of any kind, and its index among the colliders.
type Listed = (ShapeId, u32);

/// All shapes of a scene, fields included, with one frame per node and per object.
#[derive(Default)]
struct Inventory {
    /// All shapes, in the order in which they were added.
    colliders: Vec<Collider>,
    /// `world_from_node` and `world_from_object`.
    frames: Vec<Isometry3<f64>>,
}

impl Inventory {
    /// Adds the shapes that are fixed to one frame.
    fn add<'a>(
        &mut self,
        frame: &Isometry3<f64>,
        (shapes, hulls): (impl IntoIterator<Item = &'a Primitive>, &Hulls),
        id: impl Fn(u16) -> ShapeId,
    ) -> Vec<Listed> {
        self.frames.push(*frame);
        let frame = self.frames.len() - 1;
        let mut listed = Vec::new();
        for (s, primitive) in shapes.into_iter().enumerate() {
            listed.push((id(s as u16), self.colliders.len() as u32));
            let collider = Collider::new(primitive.shape, frame, primitive.pose);
            self.colliders.push(collider.with_hull(hulls.get(&s).cloned()));
        }
        listed
    }
}

/// A node's shapes.
struct NodeShapes {
    /// Collision shapes.
    solids: Vec<Listed>,
    /// Force-field shapes.
    fields: Vec<Listed>,
}

/// The pairs to test, with the kind of contact of each.
#[derive(Default)]
struct Tests(Vec<(ContactKind, (ShapeId, ShapeId), IndexPair)>);

impl Tests {
    /// Adds a pair, in either order.
    fn add(&mut self, kind: ContactKind, a: &Listed, b: &Listed) {
        // Ids in ascending order; the engine measures them in the same order.
        let (a, b) = if a.0 <= b.0 { (a, b) } else { (b, a) };
        self.0.push((kind, (a.0, b.0), (a.1, b.1)));
    }
}

impl<E: Engine> Scene<E> {
    /// All touching pairs (distance zero or less): robots with themselves, with each other and with obstacles, of all
    /// kinds, constant pairs included.
    ///
    /// # Returns
    /// The contacts sorted by kind and pair; distances in meters, points in the world frame.
    ///
    /// # Performance
    /// Prepares all shapes at each call. Not for the control loop: use [`Scene::contacts`] there.
    pub fn report<P: AsRef<[f64]>>(&self, poses: &[P]) -> Vec<ReportedContact> {
        let transforms = self.node_transforms(poses);
        let mut inventory = Inventory::default();
        let none = Hulls::new();
        let mut robots: Vec<Vec<NodeShapes>> = Vec::new();
        for (r, (robot, world_from_node)) in self.robots().iter().zip(&transforms).enumerate() {
            let nodes = robot.nodes.iter().zip(world_from_node).enumerate().map(|(n, (node, frame))| {
                let id = |s: u16| ShapeId::Robot { robot: r as u16, node: n as u16, shape: s };
                let solids = inventory.add(frame, (&node.solids, &node.hulls), id);
                NodeShapes { solids, fields: inventory.add(frame, (&node.fields, &none), id) }
            });
            robots.push(nodes.collect());
        }
        let obstacles = self.objects().filter(|(_, o)| o.class == ObjectClass::Obstacle);
        let obstacles: Vec<Listed> = obstacles
            .flat_map(|(id, o)| {
                inventory.add(&o.pose, (&o.shapes, &none), |s| ShapeId::Object { object: id, shape: s })
            })
            .collect();

        let mut tests = Tests::default();
        for (robot, shapes) in self.robots().iter().zip(&robots) {
            let tables = [
                (ContactKind::Reflex, &robot.pairs.reflex),
                (ContactKind::VisualOnly, &robot.pairs.visual_only),
                (ContactKind::Field, &robot.pairs.field),
            ];
            for (kind, pairs) in tables {
                let shapes_of =
                    |n: usize| if kind == ContactKind::Field { &shapes[n].fields } else { &shapes[n].solids };
                for &(n, m) in pairs {
                    for a in shapes_of(n) {
                        shapes_of(m).iter().filter(|b| n != m || a.0 < b.0).for_each(|b| tests.add(kind, a, b));
                    }
                }
            }
            // A base stands on the table that it is bolted to, so it is not tested against the world.
            for (_, node) in robot.nodes.iter().zip(shapes).filter(|(node, _)| !node.near_root) {
                for b in &obstacles {
                    node.solids.iter().for_each(|a| tests.add(ContactKind::Reflex, a, b));
                    node.fields.iter().for_each(|a| tests.add(ContactKind::Field, a, b));
                }
            }
        }
        for (r, one) in robots.iter().enumerate() {
            for (q, other) in robots.iter().enumerate().skip(r + 1) {
                let near_root = |robot: usize, node: usize| self.robots()[robot].nodes[node].near_root;
                for (n, a) in one.iter().enumerate() {
                    for (m, b) in other.iter().enumerate() {
                        if near_root(r, n) && near_root(q, m) {
                            continue;
                        }
                        for a in &a.solids {
                            b.solids.iter().for_each(|b| tests.add(ContactKind::Reflex, a, b));
                        }
                    }
                }
            }
        }

        let engine = E::prepare(&inventory.colliders);
        let mut placement = E::Placement::default();
        engine.place(&inventory.frames, &mut placement);
        let touching = tests.0.into_iter().filter_map(|(kind, pair, indices)| {
            let Near::Within(near) = engine.near(&placement, indices, 0.0) else { return None };
            let contact = Contact { pair, distance: near.distance, points: near.points };
            Some(ReportedContact { kind, contact })
        });
        let mut found: Vec<ReportedContact> = touching.collect();
        found.sort_by_key(|r| (r.kind, r.contact.pair));
        found
    }

    /// Forward kinematics of all robots: `world_from_node` of every node, robot by robot, from the robots' base poses.
    ///
    /// # Arguments
    /// * `poses`: as for [`Scene::contacts`].
    pub fn node_transforms<P: AsRef<[f64]>>(&self, poses: &[P]) -> Vec<Vec<Isometry3<f64>>> {
        let bodies = self.bodies();
        let mut frames = Vec::new();
        bodies.place(poses, &mut frames);
        let of_robot = bodies.skeletons.iter().zip(&bodies.first_frame);
        of_robot
            .map(|(s, first)| s.frame.iter().zip(&s.in_frame).map(|(f, x)| frames[first + f] * x).collect())
            .collect()
    }
}
