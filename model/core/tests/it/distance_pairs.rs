//! Promise: the signed distance of every pair of shapes is right: apart, touching, and deeply overlapping.
//!
//! Two checks that share no code with the library. *Apart*: the witness points are on the shapes (so the distance is
//! not too small), and the slab between them along their difference contains no point of either shape (so it is not too
//! large). *Overlapping*: no direction among many, refined, separates the shapes by a shorter translation than the
//! depth.

use crate::engines::{UnderTest, for_every_engine};
use mobee_model::Shape;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

for_every_engine!(
    every_pair_apart_is_bracketed_from_both_sides,
    no_direction_parts_an_overlapping_pair_by_a_shorter_way,
    distances_do_not_depend_on_the_order_or_on_where_the_world_is,
);

type Placed = (Shape, Isometry3<f64>);

/// The farthest point of a shape along `n` (both in the shape's frame), as a coordinate along `n`.
fn support(shape: &Shape, n: &Vector3<f64>) -> f64 {
    match *shape {
        Shape::Sphere { radius } => radius * n.norm(),
        Shape::Capsule { radius, height } => radius * n.norm() + height / 2.0 * n.y.abs(),
        Shape::Cylinder { radius, height } => radius * n.x.hypot(n.z) + height / 2.0 * n.y.abs(),
        Shape::Box { size } => (size / 2.0).dot(&n.abs()),
    }
}

/// Separation of the shapes along unit `n` from `a` to `b`: at most their signed distance.
fn parted(a: &Placed, b: &Placed, n: &Vector3<f64>) -> f64 {
    let between = (b.1.translation.vector - a.1.translation.vector).dot(n);
    let along = |p: &Placed| support(&p.0, &p.1.rotation.inverse_transform_vector(n));
    between - along(a) - along(b)
}

/// Distance of a world point outside a shape (zero inside), with a formula per shape.
fn outside(placed: &Placed, point: &Point3<f64>) -> f64 {
    let p = placed.1.inverse_transform_point(point).coords;
    match placed.0 {
        Shape::Sphere { radius } => (p.norm() - radius).max(0.0),
        Shape::Capsule { radius, height } => {
            let q = Vector3::new(p.x, p.y - p.y.clamp(-height / 2.0, height / 2.0), p.z);
            (q.norm() - radius).max(0.0)
        }
        Shape::Cylinder { radius, height } => {
            let (r, y) = ((p.x.hypot(p.z) - radius).max(0.0), (p.y.abs() - height / 2.0).max(0.0));
            r.hypot(y)
        }
        Shape::Box { size } => (p.abs() - size / 2.0).map(|x| x.max(0.0)).norm(),
    }
}

/// The best separating direction found from many starts by a random search with decreasing steps.
fn search(a: &Placed, b: &Placed, rng: &mut ChaCha8Rng) -> f64 {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    const STARTS: usize = 1500;
    let mut starts: Vec<(f64, Vector3<f64>)> = (0..STARTS)
        .map(|i| {
            let y = 1.0 - 2.0 * (i as f64 + 0.5) / STARTS as f64;
            let (r, t) = ((1.0 - y * y).sqrt(), golden * i as f64);
            Vector3::new(r * t.cos(), y, r * t.sin())
        })
        .chain([a, b].into_iter().flat_map(|p| {
            [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().flat_map(|e| [p.1.rotation * e, -(p.1.rotation * e)])
        }))
        .map(|n| (parted(a, b, &n), n))
        .collect();
    starts.sort_by(|p, q| q.0.total_cmp(&p.0));
    let mut best = f64::NEG_INFINITY;
    for &(mut value, mut n) in starts.iter().take(12) {
        let mut step = 0.1;
        while step > 1e-9 {
            let better = (0..24).find_map(|_| {
                let v = Vector3::new(rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5, rng.random::<f64>() - 0.5);
                let m = (n + v * step).normalize();
                let there = parted(a, b, &m);
                (there > value).then_some((there, m))
            });
            match better {
                Some((v, m)) => (value, n) = (v, m),
                None => step *= 0.5,
            }
        }
        best = best.max(value);
    }
    best
}

fn any_shape(kind: usize, rng: &mut ChaCha8Rng) -> Shape {
    let mut size = || 10f64.powf(rng.random_range(-2.3..-0.5));
    match kind {
        0 => Shape::Sphere { radius: size() },
        1 => Shape::Capsule { radius: size(), height: size() },
        2 => Shape::Cylinder { radius: size(), height: size() },
        3 => Shape::Box { size: Vector3::new(size(), size(), size()) },
        // A tabletop, a post and a coin.
        4 => Shape::Box { size: Vector3::new(1.0, 0.001, 1.5) },
        5 => Shape::Cylinder { radius: 0.01, height: 1.2 },
        _ => Shape::Cylinder { radius: 0.05, height: 0.001 },
    }
}

fn any_pose(reach: f64, rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let mut unit = || rng.random_range(-1.0..1.0);
    let axis = Vector3::new(unit(), unit(), unit()) * std::f64::consts::PI;
    // Sometimes parallel or perpendicular to the other shape, which causes degenerate simplices.
    let rotation = match (unit() * 10.0) as i64 {
        0 => UnitQuaternion::identity(),
        1 => UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::FRAC_PI_2),
        _ => UnitQuaternion::from_scaled_axis(axis),
    };
    Isometry3::from_parts(Translation3::new(unit() * reach, unit() * reach, unit() * reach), rotation)
}

fn name(kind: usize) -> &'static str {
    ["sphere", "capsule", "cylinder", "box", "plate", "post", "coin"][kind]
}

fn every_pair_apart_is_bracketed_from_both_sides<E: UnderTest>() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for ka in 0..7 {
        for kb in 0..7 {
            let (mut worst, mut apart) = (0.0_f64, 0);
            for _ in 0..1500 {
                let a = (any_shape(ka, &mut rng), any_pose(0.3, &mut rng));
                let b = (any_shape(kb, &mut rng), any_pose(0.3, &mut rng));
                let near = E::distance(&a.0, &a.1, &b.0, &b.1);
                if near.distance <= 0.0 {
                    continue;
                }
                apart += 1;
                let [p, q] = near.points;
                let length = (q - p).norm();
                let off = outside(&a, &p).max(outside(&b, &q)).max((length - near.distance).abs());
                let slack = if length > 1e-7 { near.distance - parted(&a, &b, &((q - p) / length)) } else { 0.0 };
                let error = off.max(slack);
                assert!(error < E::APART, "{} / {}: {error:e} of {near:?}\n{a:?}\n{b:?}", name(ka), name(kb));
                worst = worst.max(error);
            }
            println!("{:8} {:8} apart {apart:5}  worst error {worst:.1e} m", name(ka), name(kb));
        }
    }
}

fn no_direction_parts_an_overlapping_pair_by_a_shorter_way<E: UnderTest>() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for ka in 0..7 {
        for kb in ka..7 {
            let (mut worst, mut over, mut inside) = (0.0_f64, 0.0_f64, 0);
            for _ in 0..2000 {
                let a = (any_shape(ka, &mut rng), any_pose(0.1, &mut rng));
                let b = (any_shape(kb, &mut rng), any_pose(0.1, &mut rng));
                let near = E::distance(&a.0, &a.1, &b.0, &b.1);
                let touch = |d: f64| d > 0.0;
                if touch(near.distance) || inside > 60 {
                    continue;
                }
                inside += 1;
                let reference = search(&a, &b, &mut rng);
                // The search yields a lower bound of the signed distance; the library's result must not be below it.
                let too_deep = reference - near.distance;
                let too_shallow = near.distance - reference;
                assert!(
                    too_deep < E::DEPTH,
                    "{} / {}: {too_deep:e} too deep: {near:?}\n{a:?}\n{b:?}",
                    name(ka),
                    name(kb)
                );
                worst = worst.max(too_deep);
                over = over.max(too_shallow);
                let [p, q] = near.points;
                let points = (q - p).norm() + near.distance;
                assert!(points.abs() < E::DEPTH, "{} / {}: points {points:e} off", name(ka), name(kb));
            }
            println!(
                "{:8} {:8} overlapping {inside:3}  too deep by {worst:.1e} m, beyond the search by {over:.1e} m",
                name(ka),
                name(kb)
            );
        }
    }
}

fn distances_do_not_depend_on_the_order_or_on_where_the_world_is<E: UnderTest>() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..2000 {
        let (ka, kb) = (rng.random_range(0..7), rng.random_range(0..7));
        let a = (any_shape(ka, &mut rng), any_pose(0.2, &mut rng));
        let b = (any_shape(kb, &mut rng), any_pose(0.2, &mut rng));
        let there = any_pose(2.0, &mut rng);
        let straight = E::distance(&a.0, &a.1, &b.0, &b.1).distance;
        let swapped = E::distance(&b.0, &b.1, &a.0, &a.1).distance;
        let moved = E::distance(&a.0, &(there * a.1), &b.0, &(there * b.1)).distance;
        // The depth of a cylinder is computed by expansion, which stops within 1e-5 of the optimum.
        assert!((straight - swapped).abs() < E::DEPTH, "{} / {}: {straight} {swapped}", name(ka), name(kb));
        assert!((straight - moved).abs() < E::DEPTH, "{} / {}: {straight} {moved}", name(ka), name(kb));
    }
}
