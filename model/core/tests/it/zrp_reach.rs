//! The motion bounds that the collision engine relies on.

use mobee_model::{Robot, Shape, load_robot};
use nalgebra::{Isometry3, Point3};
use rand::{Rng, SeedableRng};

fn robot(path: &str) -> Robot {
    load_robot(std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)).unwrap().value
}

fn edge() -> Robot {
    robot("tests/data/edge/edge_a.xml")
}

/// Points on the surface of a shape, in its own frame.
fn outline(shape: &Shape) -> Vec<Point3<f64>> {
    let (x, y, z) = match *shape {
        Shape::Sphere { radius } => return [-radius, radius].map(|r| Point3::new(r, 0.0, 0.0)).to_vec(),
        Shape::Box { size } => (size.x / 2.0, size.y / 2.0, size.z / 2.0),
        Shape::Cylinder { radius, height } | Shape::Capsule { radius, height } => (radius, height / 2.0, 0.0),
    };
    [(x, y, z), (-x, y, z), (x, -y, z), (x, y, -z), (-x, -y, -z)].map(|(x, y, z)| Point3::new(x, y, z)).to_vec()
}

fn points(robot: &Robot, frames: &[Isometry3<f64>]) -> Vec<(usize, Point3<f64>)> {
    let mut out = Vec::new();
    for (n, node) in robot.nodes.iter().enumerate() {
        for p in &node.solids {
            out.extend(outline(&p.shape).into_iter().map(|at| (n, frames[n] * p.pose * at)));
        }
    }
    out
}

#[test]
fn no_distance_of_edge_changes_faster_than_reach_allows() {
    reach_holds(&edge(), 300);
}

#[test]
fn no_distance_of_the_katana_changes_faster_than_reach_allows() {
    reach_holds(&robot("configs/robots/katana.xml"), 300);
}

#[test]
fn no_distance_of_the_icub_changes_faster_than_reach_allows() {
    reach_holds(&robot("configs/robots/icub.xml"), 20);
}

fn reach_holds(robot: &Robot, steps: usize) {
    let reach = robot.reach();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let mut tightest: f64 = 0.0;
    for step in 0..steps {
        // A single motor tests the tightness of its own bound; all together test that the bounds add up.
        let alone = (step % 2 == 0).then(|| rng.random_range(0..robot.motors.len()));
        let q: Vec<f64> = robot.motors.iter().map(|m| rng.random_range(m.min..=m.max)).collect();
        let size = rng.random_range(0.001..0.5);
        let mut to = q.clone();
        for (m, motor) in robot.motors.iter().enumerate().filter(|(m, _)| alone.is_none_or(|a| a == *m)) {
            to[m] = (q[m] + rng.random_range(-size..size)).clamp(motor.min, motor.max);
        }
        let bound: f64 = reach.iter().zip(q.iter().zip(&to)).map(|(r, (a, b))| r * (a - b).abs()).sum();
        robot.forward(&q, &mut before);
        robot.forward(&to, &mut after);
        let (a, b) = (points(robot, &before), points(robot, &after));
        for (i, (x, y)) in a.iter().zip(&b).enumerate() {
            let moved = (x.1 - y.1).norm();
            tightest = tightest.max(moved / bound);
            assert!(moved <= bound + 1e-12, "a point moved {moved}, the bound is {bound}");
            for (x2, y2) in a[..i].iter().zip(&b[..i]) {
                let change = ((x.1 - x2.1).norm() - (y.1 - y2.1).norm()).abs();
                assert!(change <= bound + 1e-12, "a distance changed by {change}, the bound is {bound}");
                assert!(robot.moves(x.0, x2.0) || change < 1e-12, "nodes {} and {} moved", x.0, x2.0);
                let movers = robot.movers(Some(x.0), Some(x2.0));
                let moved = alone.is_none_or(|motor| movers.contains(&motor));
                assert!(moved || change < 1e-12, "{alone:?} moved nodes {} and {}: {movers:?}", x.0, x2.0);
            }
        }
    }
    assert!(tightest > 0.3, "the bound is far too wide: {tightest}");
}

#[test]
fn two_nodes_move_if_a_joint_with_a_range_lies_between() {
    let robot = edge();
    assert!(!robot.moves(0, 1), "a joint's own shapes do not turn with it");
    assert!(robot.moves(1, 2));
    assert!(!robot.moves(2, 7));
    assert!(!robot.moves(2, 8), "a joint stands still on its parent");
    assert!(robot.moves(9, 13), "two fingers of one motor");
    assert!(!robot.moves(0, 14), "two roots");
    let fingers = robot.movers(Some(9), Some(13));
    assert!(fingers.len() == 1 && robot.movers(Some(9), None).is_superset(&fingers), "{fingers:?}");
    assert!(robot.movers(Some(0), None).is_empty() && robot.movers(Some(2), Some(2)).is_empty());
}

#[test]
fn positions_outside_the_limits_count_as_the_limit() {
    let robot = edge();
    let (mut at_limit, mut beyond) = (Vec::new(), Vec::new());
    let max: Vec<f64> = robot.motors.iter().map(|m| m.max).collect();
    robot.forward(&max, &mut at_limit);
    robot.forward(&max.iter().map(|q| q + 1.0).collect::<Vec<_>>(), &mut beyond);
    assert_eq!(at_limit, beyond);
}
