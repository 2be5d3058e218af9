//! What a robot's collision and observation ports tell: its present contacts, in the original's form, and its state.
//!
//! Shapes are numbered as the original numbered them: robot by robot and node by node, a node after its children, solids
//! before fields, then the objects of the world.

use crate::words::string;
use mobee_contract::Latest;
use mobee_model::{Contact, ObjectClass, Robot, Scene, ShapeId};
use mobee_yarp::{Bottle, Value};
use nalgebra::Point3;

/// The contacts of a robot: `((i x y z) (j x y z))` with itself, `(i x y z "ROBOT")` (or `"OBSTACLE"`, `"TARGET"`) with
/// others; a single 0 if there is none. i is the shape's number, x y z its point of contact, world frame.
pub fn collisions(robot: usize, contacts: &[Contact], scene: &Scene) -> Bottle {
    let own = |id: &ShapeId| matches!(id, ShapeId::Robot { robot: r, .. } if usize::from(*r) == robot);
    let mut all = Vec::new();
    for contact in contacts {
        let ends = [(contact.pair.0, contact.points[0]), (contact.pair.1, contact.points[1])];
        let (mine, others): (Vec<_>, Vec<_>) = ends.into_iter().partition(|(id, _)| own(id));
        match (mine.as_slice(), others.as_slice()) {
            ([a, b], []) => all.push(Value::List(Bottle(vec![
                Value::List(Bottle(touch(a, scene))),
                Value::List(Bottle(touch(b, scene))),
            ]))),
            ([a], [b]) => {
                let mut list = touch(a, scene);
                list.push(string(kind(&b.0, scene)));
                all.push(Value::List(Bottle(list)));
            }
            _ => {}
        }
    }
    if all.is_empty() {
        all.push(Value::Int32(0));
    }
    Bottle(all)
}

/// A robot's state: `(time SECONDS) (state WORD) (contacts N) (part NAME (q ...)) ...` with positions in degrees.
pub fn observation(robot: &Robot, latest: &Latest) -> Bottle {
    let entry = |key: &str, value: Value| Value::List(Bottle(vec![string(key), value]));
    let count = i32::try_from(latest.contacts.len()).unwrap_or(i32::MAX);
    let mut all = vec![
        entry("time", Value::Float64(latest.at.secs())),
        entry("state", string(latest.status.word())),
        entry("contacts", Value::Int32(count)),
    ];
    for part in &robot.parts {
        let q = latest.q.get(part.motors.clone()).unwrap_or_default();
        let q = Value::List(Bottle(q.iter().map(|q| Value::Float64(q.to_degrees())).collect()));
        all.push(Value::List(Bottle(vec![string("part"), string(&part.name), q])));
    }
    Bottle(all)
}

fn touch((id, at): &(ShapeId, Point3<f64>), scene: &Scene) -> Vec<Value> {
    let number = i32::try_from(number(id, scene)).unwrap_or(i32::MAX);
    let mut list = vec![Value::Int32(number)];
    list.extend(at.coords.iter().map(|x| Value::Float64(*x)));
    list
}

fn kind(id: &ShapeId, scene: &Scene) -> &'static str {
    match id {
        ShapeId::Robot { .. } => "ROBOT",
        ShapeId::Object { object, .. } => {
            let target =
                |(i, o): (u32, &std::sync::Arc<mobee_model::Object>)| i == *object && o.class == ObjectClass::Target;
            if scene.objects().any(target) { "TARGET" } else { "OBSTACLE" }
        }
    }
}

/// A shape's number in the model, from 1.
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

/// The nodes in the order of their end tags.
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
    fn contacts_are_told_in_the_originals_form() {
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
        assert_eq!(collisions(0, &[], &scene).to_string(), "0");
        let all: usize = robot.nodes.iter().map(|n| n.solids.len() + n.fields.len()).sum();
        let told = collisions(0, &[contact(solid(0), ball), contact(solid(0), solid(1))], &scene);
        let first = number(&solid(0), &scene);
        let second = number(&solid(1), &scene);
        let expected = format!("({first} 1.0 2.0 3.0 OBSTACLE) (({first} 1.0 2.0 3.0) ({second} 4.0 5.0 6.0))");
        assert_eq!(told.to_string(), expected);
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
