//! Contacts of a robot, with shapes numbered as in the original: robot by robot and node by node, a node
//! after its children, solids before fields, then the objects of the world.

use mobee_model::{Contact, ObjectClass, Robot, Scene, ShapeId};
use nalgebra::Point3;

/// A contact of a robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Collision {
    /// With itself.
    Own(Touch, Touch),
    /// With something else, at a point on the robot's side.
    With(Touch, Touched),
}

/// One end of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Number of the shape in the model, from 1.
    pub shape: usize,
    /// Point of contact, m, world frame.
    pub at: Point3<f64>,
}

/// Kind of body that a robot touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touched {
    /// Another robot.
    Robot,
    /// An object to stay away from.
    Obstacle,
    /// An object to reach for.
    Target,
}

/// Contacts of a robot, given by its index in the scene.
pub fn collisions(robot: usize, contacts: &[Contact], scene: &Scene) -> Vec<Collision> {
    let own = |id: &ShapeId| matches!(id, ShapeId::Robot { robot: r, .. } if usize::from(*r) == robot);
    let touch = |(id, at): &(ShapeId, Point3<f64>)| Touch { shape: number(id, scene), at: *at };
    let collision = |contact: &Contact| {
        let ends = [(contact.pair.0, contact.points[0]), (contact.pair.1, contact.points[1])];
        let (mine, others): (Vec<_>, Vec<_>) = ends.into_iter().partition(|(id, _)| own(id));
        match (mine.as_slice(), others.as_slice()) {
            ([a, b], []) => Some(Collision::Own(touch(a), touch(b))),
            ([a], [b]) => Some(Collision::With(touch(a), touched(&b.0, scene))),
            _ => None,
        }
    };
    contacts.iter().filter_map(collision).collect()
}

fn touched(id: &ShapeId, scene: &Scene) -> Touched {
    match id {
        ShapeId::Robot { .. } => Touched::Robot,
        ShapeId::Object { object, .. } => {
            let target =
                |(i, o): (u32, &std::sync::Arc<mobee_model::Object>)| i == *object && o.class == ObjectClass::Target;
            if scene.objects().any(target) { Touched::Target } else { Touched::Obstacle }
        }
    }
}

/// Number of a shape in the model, from 1.
fn number(id: &ShapeId, scene: &Scene) -> usize {
    let mut count = 0;
    for (r, robot) in scene.robots().iter().enumerate() {
        for n in bottom_up(robot) {
            let Some(node) = robot.nodes.get(n) else { continue };
            match id {
                ShapeId::Robot { robot, node, shape } if (usize::from(*robot), usize::from(*node)) == (r, n) => {
                    return count + usize::from(*shape) + 1;
                }
                _ => count += node.solids.len() + node.fields.len(),
            }
        }
    }
    for (i, object) in scene.objects() {
        match id {
            ShapeId::Object { object, shape } if *object == i => return count + usize::from(*shape) + 1,
            _ => count += object.shapes.len(),
        }
    }
    0
}

/// Nodes in the order of their end tags.
fn bottom_up(robot: &Robot) -> Vec<usize> {
    let mut children = vec![Vec::new(); robot.nodes.len()];
    let mut todo = Vec::new();
    for (i, node) in robot.nodes.iter().enumerate().rev() {
        match node.parent.and_then(|p| children.get_mut(p)) {
            Some(list) => list.push(i),
            None => todo.push((i, false)),
        }
    }
    let mut order = Vec::with_capacity(robot.nodes.len());
    while let Some((node, done)) = todo.pop() {
        if done {
            order.push(node);
            continue;
        }
        todo.push((node, true));
        todo.extend(children.get(node).into_iter().flatten().map(|c| (*c, false)));
    }
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use mobee_model::{load_robot, parse_world};
    use nalgebra::Isometry3;
    use std::sync::Arc;

    #[test]
    fn contacts_are_reported_with_the_originals_numbers() {
        let icub = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/robots/icub.xml");
        let robot = Arc::new(load_robot(icub).unwrap().value);
        let world = "<WorldList><object name='ball'><sphere radius='0.1'/></object></WorldList>";
        let objects = parse_world("ball", world).unwrap().value;
        let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], objects).unwrap();
        let solid = |skip: usize| {
            let (node, _) = robot.nodes.iter().enumerate().filter(|(_, n)| !n.solids.is_empty()).nth(skip).unwrap();
            ShapeId::Robot { robot: 0, node: node as u16, shape: 0 }
        };
        let ball = ShapeId::Object { object: 0, shape: 0 };
        let points = [Point3::new(1.0, 2.0, 3.0), Point3::new(4.0, 5.0, 6.0)];
        let contact = |a, b| Contact { pair: (a, b), distance: 0.0, points };
        assert_eq!(collisions(0, &[], &scene), []);
        let all: usize = robot.nodes.iter().map(|n| n.solids.len() + n.fields.len()).sum();
        let reported = collisions(0, &[contact(solid(0), ball), contact(solid(0), solid(1))], &scene);
        let first = number(&solid(0), &scene);
        let second = number(&solid(1), &scene);
        let one = Touch { shape: first, at: points[0] };
        let other = Touch { shape: second, at: points[1] };
        assert_eq!(reported, [Collision::With(one, Touched::Obstacle), Collision::Own(one, other)]);
        assert_eq!(number(&ball, &scene), all + 1);
        let mut numbers: Vec<usize> = Vec::new();
        for (n, node) in robot.nodes.iter().enumerate() {
            for shape in 0..node.solids.len() + node.fields.len() {
                numbers.push(number(&ShapeId::Robot { robot: 0, node: n as u16, shape: shape as u16 }, &scene));
            }
        }
        numbers.sort_unstable();
        assert_eq!(numbers, (1..=all).collect::<Vec<_>>(), "every shape has its own number");
    }
}
