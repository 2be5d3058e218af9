//! Identity of a robot and a world for a map: digests of everything that determines whether a pose
//! is free.

use mobee_model::{NodeKind, ObjectClass, Primitive, Robot, Scene, Shape};
use nalgebra::Isometry3;
use sha2::{Digest, Sha256};

/// Version of the digests; to be incremented when their inputs change.
const DIGEST_VERSION: u32 = 1;

/// Builder of a digest with an unambiguous encoding: different sequences of inputs give different
/// digests.
struct Sum(Sha256);

impl Sum {
    fn new(what: &str) -> Sum {
        let mut sum = Sum(Sha256::new());
        sum.text(what).number(DIGEST_VERSION as usize);
        sum
    }

    fn text(&mut self, text: &str) -> &mut Sum {
        self.number(text.len());
        self.0.update(text);
        self
    }

    fn number(&mut self, n: usize) -> &mut Sum {
        self.0.update((n as u64).to_le_bytes());
        self
    }

    fn reals(&mut self, all: impl IntoIterator<Item = f64>) -> &mut Sum {
        // Adding 0.0 makes both zeros equal.
        all.into_iter().for_each(|x| self.0.update((x + 0.0).to_le_bytes()));
        self
    }

    fn pose(&mut self, pose: &Isometry3<f64>) -> &mut Sum {
        self.reals(pose.translation.vector.iter().copied()).reals(pose.rotation.coords.iter().copied())
    }

    fn shapes(&mut self, shapes: &[Primitive]) -> &mut Sum {
        self.number(shapes.len());
        for Primitive { shape, pose } in shapes {
            match shape {
                Shape::Sphere { radius } => self.text("sphere").reals([*radius]),
                Shape::Cylinder { radius, height } => self.text("cylinder").reals([*radius, *height]),
                Shape::Capsule { radius, height } => self.text("capsule").reals([*radius, *height]),
                Shape::Box { size } => self.text("box").reals(size.iter().copied()),
            };
            self.pose(pose);
        }
        self
    }

    fn hex(self) -> String {
        self.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }
}

/// Computes the digest of a robot: its name, motors with their limits and homes, joints, links,
/// shapes, markers, constraints, and the tested pairs. Two files with equal digests move and
/// collide identically, even if they differ otherwise.
pub fn robot_digest(robot: &Robot) -> String {
    let mut sum = Sum::new("robot");
    sum.text(&robot.name).number(robot.motors.len());
    for m in &robot.motors {
        sum.text(&m.name).text(m.motion.unit()).number(usize::from(m.continuous)).reals([m.min, m.max, m.home]);
    }
    sum.number(robot.nodes.len());
    for node in &robot.nodes {
        sum.number(node.parent.map_or(0, |p| p + 1)).number(usize::from(node.near_root));
        match &node.kind {
            NodeKind::Link { offset } => sum.text("link").reals(offset.iter().copied()),
            NodeKind::Joint { motion, axis, motor, min, max, .. } => {
                sum.text(motion.unit()).number(*motor).reals(axis.iter().copied()).reals([*min, *max])
            }
        };
        sum.shapes(&node.solids);
        for (solid, hull) in &node.hulls {
            sum.text("hull").number(*solid).reals([hull.radius()]).number(hull.points().len());
            sum.reals(hull.points().iter().flat_map(|p| p.iter().copied()));
        }
    }
    sum.number(robot.markers.len());
    for marker in &robot.markers {
        sum.text(&marker.name).number(marker.node).reals(marker.normal.iter().copied());
    }
    for clause in robot.parts.iter().flat_map(|part| &part.clauses) {
        sum.number(clause.0.len());
        for half_space in &clause.0 {
            sum.number(half_space.terms.len()).reals([half_space.b]);
            for (motor, factor) in &half_space.terms {
                sum.number(*motor).reals([*factor]);
            }
        }
    }
    sum.number(robot.pairs.reflex.len());
    for (a, b) in &robot.pairs.reflex {
        sum.number(*a).number(*b);
    }
    sum.hex()
}

/// Computes the digest of the environment of a scene's robots: the poses of their bases, and the
/// obstacles in the order of their names. Targets and ghosts can't be touched and are ignored.
pub fn world_digest(scene: &Scene) -> String {
    let mut sum = Sum::new("world");
    sum.number(scene.robots().len());
    for robot in 0..scene.robots().len() {
        sum.pose(&scene.base(robot));
    }
    let mut obstacles: Vec<_> = scene.objects().map(|(_, o)| o).filter(|o| o.class == ObjectClass::Obstacle).collect();
    obstacles.sort_by(|a, b| a.name.cmp(&b.name));
    for object in obstacles {
        sum.text(&object.name).pose(&object.pose).shapes(&object.shapes);
    }
    sum.hex()
}
