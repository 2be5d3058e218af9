//! Promise: the colliding pairs of shapes (reflex, visual only and field; self and world) equal those of the original
//! program, except for pairs within 1e-5 m of contact.

use crate::engines::for_every_engine;
use crate::oracle;
use mobee_model::{Contact, ContactKind, Engine, Scene, ShapeId, load_robot, load_world};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

for_every_engine!(edge_robot_self_pairs, original_robots_self_pairs, original_robots_world_pairs,);

/// A pair in the files' notation: pose, kind, four columns.
type Row = (usize, String, [String; 4]);

/// Distance from contact, meters, below which either result is accepted.
const BORDERLINE: f64 = 1e-5;

fn kind(kind: ContactKind) -> &'static str {
    match kind {
        ContactKind::Reflex => "reflex",
        ContactKind::VisualOnly => "visual_only",
        ContactKind::Field => "field",
    }
}

fn columns(scene: &Scene<impl Engine>, contact: &Contact) -> [String; 4] {
    let of = |id: ShapeId| match id {
        ShapeId::Robot { node, shape, .. } => [node.to_string(), shape.to_string()],
        ShapeId::Object { object, shape } => {
            let name = scene.objects().find(|(id, _)| *id == object).map(|(_, o)| o.name.clone());
            [name.unwrap_or_default(), shape.to_string()]
        }
    };
    let ([a, b], [c, d]) = (of(contact.pair.0), of(contact.pair.1));
    [a, b, c, d]
}

/// The signed distance of a pair of the oracle.
fn distance_of<E: Engine>(scene: &Scene<E>, q: &[f64], row: &Row, world: bool) -> f64 {
    let robot = &scene.robots()[0];
    let mut frames = Vec::new();
    robot.forward(q, &mut frames);
    let fields = row.1 == "field";
    let on_node = |node: &str, shape: &str, fields: bool| {
        let node: usize = node.parse().expect("a node number");
        let list = if fields { &robot.nodes[node].fields } else { &robot.nodes[node].solids };
        let p = &list[shape.parse::<usize>().expect("a shape number")];
        (p.shape, frames[node] * p.pose)
    };
    let a = on_node(&row.2[0], &row.2[1], fields);
    let b = if world {
        let object = scene.object(&row.2[2]).expect("the object").1;
        let p = &object.shapes[row.2[3].parse::<usize>().expect("a shape number")];
        (p.shape, object.pose * p.pose)
    } else {
        on_node(&row.2[2], &row.2[3], fields)
    };
    E::distance(&a.0, &a.1, &b.0, &b.1).distance
}

fn compare<E: Engine>(set: &Path, robot: &Path, world: Option<&Path>, pairs: &str) {
    let robot = Arc::new(load_robot(robot).expect("the robot loads").value);
    let objects = world.map(|w| load_world(w).expect("the world loads").value).unwrap_or_default();
    let scene =
        Scene::<E>::with_engine(vec![(robot.clone(), nalgebra::Isometry3::identity())], objects).expect("a scene");
    let poses = oracle::poses(&robot, &set.join("poses.csv"));
    let expected: BTreeSet<Row> = oracle::table(&set.join(pairs))
        .into_iter()
        .map(|r| {
            (r[0].parse().expect("a pose"), r[1].clone(), [r[2].clone(), r[3].clone(), r[4].clone(), r[5].clone()])
        })
        .collect();
    let mut found = BTreeMap::<Row, f64>::new();
    for (id, q) in poses.iter().enumerate() {
        for r in scene.report(&[q]) {
            let with_object = matches!(r.contact.pair.1, ShapeId::Object { .. });
            if with_object == world.is_some() {
                found.insert((id, kind(r.kind).to_string(), columns(&scene, &r.contact)), r.contact.distance);
            }
        }
    }
    let mut borderline = 0;
    for row in expected.iter().filter(|r| !found.contains_key(*r)) {
        let d = distance_of(&scene, &poses[row.0], row, world.is_some());
        assert!(d.abs() < BORDERLINE, "missed {row:?}, here {d:e} apart");
        borderline += 1;
    }
    for (row, d) in found.iter().filter(|(r, _)| !expected.contains(*r)) {
        assert!(d.abs() < BORDERLINE, "found {row:?} at {d:e}, which the original does not have");
        borderline += 1;
    }
    assert!(!expected.is_empty());
    println!(
        "{} {pairs}: {} poses, {} pairs equal, {borderline} borderline",
        set.display(),
        poses.len(),
        expected.len()
    );
}

fn edge_robot_self_pairs<E: Engine>() {
    let data = oracle::own_data("edge");
    compare::<E>(&data, &data.join("edge_a.xml"), None, "self_pairs.csv");
}

fn original_robots_self_pairs<E: Engine>() {
    let Some(shared) = oracle::shared() else { return };
    for name in ["icub", "icub_big_hands"] {
        let robot = shared.join("reference/mobee-original-data").join(format!("{name}.xml"));
        compare::<E>(&shared.join("reference/mobee-oracle").join(name), &robot, None, "self_pairs.csv");
    }
}

fn original_robots_world_pairs<E: Engine>() {
    let Some(shared) = oracle::shared() else { return };
    let (data, sets) = (shared.join("reference/mobee-original-data"), shared.join("reference/mobee-oracle"));
    let world = data.join("world.xml");
    for name in ["icub", "icub_big_hands"] {
        compare::<E>(&sets.join(name), &data.join(format!("{name}.xml")), Some(&world), "world_pairs.csv");
    }
    let icub = sets.join("icub");
    compare::<E>(&icub, &data.join("icub.xml"), Some(&icub.join("world20.xml")), "world20_pairs.csv");
}
