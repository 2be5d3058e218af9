//! The bounds on motion that the collision engine relies on.

use mobee_model::{Robot, Shape, parse_robot};
use nalgebra::{Isometry3, Point3};
use rand::{Rng, SeedableRng};

fn edge() -> Robot {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/data/edge/edge_a.xml");
    parse_robot(path, &std::fs::read_to_string(path).unwrap()).unwrap().value
}

/// Points on the outside of a shape, in its own frame.
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
fn no_distance_changes_faster_than_reach_allows() {
    let robot = edge();
    let reach = robot.reach();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let (mut before, mut after) = (Vec::new(), Vec::new());
    let mut tightest: f64 = 0.0;
    for _ in 0..300 {
        let q: Vec<f64> = robot.motors.iter().map(|m| rng.random_range(m.min..=m.max)).collect();
        let step = rng.random_range(0.001..0.5);
        let to: Vec<f64> =
            robot.motors.iter().zip(&q).map(|(m, q)| (q + rng.random_range(-step..step)).clamp(m.min, m.max)).collect();
        let bound: f64 = reach.iter().zip(q.iter().zip(&to)).map(|(r, (a, b))| r * (a - b).abs()).sum();
        robot.forward(&q, &mut before);
        robot.forward(&to, &mut after);
        let (a, b) = (points(&robot, &before), points(&robot, &after));
        for (i, (x, y)) in a.iter().zip(&b).enumerate() {
            let moved = (x.1 - y.1).norm();
            tightest = tightest.max(moved / bound);
            assert!(moved <= bound + 1e-12, "a point moved {moved}, the bound is {bound}");
            for (x2, y2) in a[..i].iter().zip(&b[..i]) {
                let change = ((x.1 - x2.1).norm() - (y.1 - y2.1).norm()).abs();
                assert!(change <= bound + 1e-12, "a distance changed by {change}, the bound is {bound}");
                assert!(robot.moves(x.0, x2.0) || change < 1e-12, "nodes {} and {} moved", x.0, x2.0);
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
