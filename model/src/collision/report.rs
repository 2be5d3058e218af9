//! Everything that touches, of every kind: what `model eval` writes.

use crate::distance::{Form, distance_within};
use crate::robot::Primitive;
use crate::scene::{Contact, ObjectClass, Scene, ShapeId};
use nalgebra::Isometry3;

/// What a contact means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Makes the reflex act.
    Reflex,
    /// Shown, but does not count: inside a `noSelfCollision` subtree.
    VisualOnly,
    /// Force-field shapes in each other, or in an obstacle.
    Field,
}

/// A contact with its kind. For fields the shape numbers in the pair count a node's fields, not its solids.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reported {
    /// What it means.
    pub kind: Kind,
    /// Who, how deep, where.
    pub contact: Contact,
}

impl Scene {
    /// Everything that touches (distance zero or less): robots with themselves, with each other and with obstacles, of all
    /// kinds, constant pairs included. Sorted by kind and pair. Not meant for the control loop.
    pub fn report<P: AsRef<[f64]>>(&self, poses: &[P]) -> Vec<Reported> {
        let mut found = Vec::new();
        let nodes: Vec<Vec<Isometry3<f64>>> = self.node_transforms(poses);
        let mut test = |kind, a: (ShapeId, &Primitive, Isometry3<f64>), b: (ShapeId, &Primitive, Isometry3<f64>)| {
            let (a, b) = if a.0 <= b.0 { (a, b) } else { (b, a) };
            let (fa, fb) = (Form::new(&a.1.shape), Form::new(&b.1.shape));
            if (a.2.translation.vector - b.2.translation.vector).norm() > fa.ball + fb.ball {
                return;
            }
            if let Some(near) = distance_within(&fa, &a.2, &fb, &b.2, 0.0) {
                let contact = Contact { pair: (a.0, b.0), distance: near.distance, points: near.points };
                found.push(Reported { kind, contact });
            }
        };
        let robots = self.robots();
        for (r, robot) in robots.iter().enumerate() {
            let on_node = |n: usize, fields: bool| {
                let node = &robot.nodes[n];
                let world_from_node = nodes[r][n];
                let list = if fields { &node.fields } else { &node.solids };
                list.iter().enumerate().map(move |(s, p)| {
                    let id = ShapeId::Robot { robot: r as u16, node: n as u16, shape: s as u16 };
                    (id, p, world_from_node * p.pose)
                })
            };
            let tables = [
                (Kind::Reflex, &robot.pairs.reflex),
                (Kind::VisualOnly, &robot.pairs.visual_only),
                (Kind::Field, &robot.pairs.field),
            ];
            for (kind, pairs) in tables {
                for &(n, m) in pairs {
                    let fields = kind == Kind::Field;
                    for a in on_node(n, fields) {
                        for b in on_node(m, fields).filter(|b| n != m || a.0 < b.0) {
                            test(kind, a, b);
                        }
                    }
                }
            }
            for n in (0..robot.nodes.len()).filter(|n| !robot.nodes[*n].near_root) {
                for (id, object) in self.objects().filter(|(_, o)| o.class == ObjectClass::Obstacle) {
                    for (s, p) in object.shapes.iter().enumerate() {
                        let b = (ShapeId::Object { object: id, shape: s as u16 }, p, object.pose * p.pose);
                        on_node(n, false).for_each(|a| test(Kind::Reflex, a, b));
                        on_node(n, true).for_each(|a| test(Kind::Field, a, b));
                    }
                }
            }
        }
        let solids = &self.bodies().solids;
        for (i, a) in solids.iter().enumerate() {
            for b in &solids[i + 1..] {
                let (ShapeId::Robot { robot: r, node: n, shape: s }, ShapeId::Robot { robot: q, node: m, shape: t }) =
                    (a.id, b.id)
                else {
                    continue;
                };
                if r == q || (a.near_root && b.near_root) {
                    continue;
                }
                let spot = |r: u16, n: u16, s: u16| {
                    let primitive = &robots[usize::from(r)].nodes[usize::from(n)].solids[usize::from(s)];
                    (primitive, nodes[usize::from(r)][usize::from(n)] * primitive.pose)
                };
                let ((pa, xa), (pb, xb)) = (spot(r, n, s), spot(q, m, t));
                test(Kind::Reflex, (a.id, pa, xa), (b.id, pb, xb));
            }
        }
        found.sort_by_key(|r| (r.kind, r.contact.pair));
        found
    }

    /// `world_from_node` of every node, robot by robot.
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
