//! Third-party robots agree with independent readers. `tests/robots/oracle.py` computes the reference with Pinocchio
//! and coal.

use super::robots_corpus::installed;
use flate2::read::GzDecoder;
use mobee_import::{UrdfOptions, load_mesh, parse_urdf};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::PathBuf;

fn table(name: &str) -> String {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name);
    let mut text = String::new();
    GzDecoder::new(std::fs::File::open(path).unwrap()).read_to_string(&mut text).unwrap();
    text
}

/// Bounding box and number of triangles of every mesh, as read by coal: units, nodes, instances and faces agree.
#[test]
fn every_mesh_is_the_one_that_coal_reads() {
    let Some(share) = installed() else { return };
    let mut wrong = Vec::new();
    let table = table("robot_meshes.csv.gz");
    for line in table.lines() {
        let words: Vec<&str> = line.split(',').collect();
        let numbers: Vec<f64> = words[1..].iter().map(|w| w.parse().unwrap()).collect();
        let mesh = match load_mesh(share.join(words[0])) {
            Ok(mesh) => mesh,
            Err(e) => {
                wrong.push(format!("{e}"));
                continue;
            }
        };
        let low = mesh.vertices.iter().fold(Vector3::repeat(f64::INFINITY), |a, v| a.inf(v));
        let high = mesh.vertices.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |a, v| a.sup(v));
        let size = (high - low).norm();
        let off = (low - Vector3::from_column_slice(&numbers[..3]))
            .amax()
            .max((high - Vector3::from_column_slice(&numbers[3..6])).amax());
        if off > 1e-5 * size + 1e-6 {
            wrong.push(format!("{line}: {low:?} {high:?}, {} triangles", mesh.triangles.len()));
        }
    }
    assert!(wrong.is_empty(), "{}\n{}", wrong.len(), wrong.join("\n"));
}

/// A pseudo-random number from 0 to 1.
fn noise(pose: usize, joint: usize) -> f64 {
    ((12.9898 * (pose + 1) as f64 + 78.233 * (joint + 1) as f64).sin() * 1e4).rem_euclid(1.0)
}

fn weight(link: usize, i: usize) -> f64 {
    ((1 + 7 * link + 3 * i) as f64).sin()
}

/// One robot of the table: file, joints with their ranges, and per pose the sums over all links.
type Expected<'a> = (&'a str, BTreeMap<&'a str, (f64, f64)>, Vec<(f64, f64)>);

fn expected(table: &str) -> Vec<Expected<'_>> {
    let mut robots: Vec<Expected<'_>> = Vec::new();
    let number = |w: &str| w.parse::<f64>().unwrap();
    for line in table.lines() {
        let words: Vec<&str> = line.split(',').collect();
        match words[..] {
            ["robot", file] => robots.push((file, BTreeMap::new(), Vec::new())),
            ["joint", name, lo, hi] => drop(robots.last_mut().unwrap().1.insert(name, (number(lo), number(hi)))),
            [positions, turns] => robots.last_mut().unwrap().2.push((number(positions), number(turns))),
            _ => panic!("{line}"),
        }
    }
    robots
}

/// Every link at a thousand poses: positions agree within a nanometer, and so do axes. The sums over all links are
/// compared.
#[test]
fn every_link_is_where_pinocchio_has_it() {
    let Some(share) = installed() else { return };
    let table = table("robot_frames.csv.gz");
    for (file, joints, poses) in expected(&table) {
        let options = UrdfOptions { drop_meshes: true, ..Default::default() };
        // The reference poses extend to the limits, beyond soft ones and beyond those of the PR2's fingers that move
        // against their leaders.
        let text = std::fs::read_to_string(share.join("example-robot-data/robots").join(file)).unwrap();
        let text = text.replace("<safety_controller", "<no_controller");
        let text = text.replace("lower=\"0.0\" upper=\"0.548\"", "lower=\"-0.548\" upper=\"0.548\"");
        let robot = parse_urdf(file, &text, &options).unwrap().value;
        let moving: Vec<&str> = joints.iter().filter(|(_, (lo, hi))| lo < hi).map(|(n, _)| *n).collect();
        let mut motors: Vec<&str> = robot.motors.iter().map(|m| m.name.as_str()).collect();
        motors.sort();
        assert_eq!(motors, moving, "{file}");
        let mut order: Vec<usize> = (0..robot.markers.len()).collect();
        order.sort_by_key(|i| &robot.markers[*i].name);
        assert_eq!(poses.len(), 1000);
        for (pose, (positions, turns)) in poses.iter().enumerate() {
            let at: BTreeMap<&str, f64> = joints
                .iter()
                .enumerate()
                .map(|(i, (name, (lo, hi)))| (*name, lo + noise(pose, i) * (hi - lo)))
                .collect();
            let q: Vec<f64> = robot.motors.iter().map(|m| m.motion.encoder(at[m.name.as_str()])).collect();
            let markers = robot.markers_at(&q);
            let sum = |part: usize, of: &dyn Fn(usize) -> Vector3<f64>| -> f64 {
                let link = |(n, i): (usize, &usize)| (0..3).map(|k| weight(n, part + k) * of(*i)[k]).sum::<f64>();
                order.iter().enumerate().map(link).sum()
            };
            let off = sum(0, &|i| markers[i].position().coords) - positions;
            let turned = sum(3, &|i| markers[i].normal) - turns;
            assert!(off.abs() < 1e-9 && turned.abs() < 1e-9, "{file}, pose {pose}: {off} m, {turned}");
        }
    }
}
