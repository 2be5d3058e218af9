//! Learn by trying, or look first: the same reach queries on the same map of an iCub, once in each validation mode.
//!
//! Eighty random free poses of torso and right arm in the world of `explore.toml`, each joined with its eight nearest, and a tour of
//! random ones among them. `QUERIES=1000` asks for more than the thirty that an example has time for.
//!
//! `cargo run --release --example 12_validation_modes`

use mobee_model::{Scene, load_robot, load_world, random_poses};
use nalgebra::Isometry3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

/// Motors by name, with positions in degrees.
type NamedPose = Vec<(String, f64)>;

const SEED: u64 = 7;
const POSES: usize = 80;
/// What a plan keeps from everything: the reflex's margin and 2 mm, meters.
const CLEARANCE: f64 = 0.012;
const MOTORS: [&str; 7] = [
    "r_shoulder_pitch",
    "r_shoulder_roll",
    "r_shoulder_yaw",
    "r_elbow",
    "r_wrist_prosup",
    "r_wrist_pitch",
    "r_wrist_yaw",
];

fn main() -> Result<(), Box<dyn Error>> {
    let queries: usize = std::env::var("QUERIES").ok().and_then(|n| n.parse().ok()).unwrap_or(30);
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("queries.toml");
    let poses = poses(&configs)?;
    println!("{:10} {:>8} {:>7} {:>8} {:>9} {:>10}", "validation", "reached", "missed", "motions", "rollbacks", "time");
    for mode in ["optimistic", "lazy", "verified"] {
        std::fs::write(&file, behavior(&configs, &poses, mode, queries)?)?;
        let done = mobee::run::example(&file.to_string_lossy(), &[])?;
        let counts = &done.end.counts;
        let summary = mobee::run::summary(&done);
        let figures = summary["counters"]["done"]["icub"]["figures"].as_array().cloned().unwrap_or_default();
        let figure = |name: &str| figures.iter().find(|f| f[0] == name).and_then(|f| f[1].as_f64()).unwrap_or(0.0);
        println!(
            "{mode:10} {:8} {:7} {:8} {:9} {:8.0} s",
            figure("goals_reached"),
            figure("goals_missed"),
            counts.commits,
            counts.rolled_back,
            done.end.ended_at.secs()
        );
        assert_eq!(counts.hard_contacts, 0, "nothing is touched in any mode");
        assert!(mode == "optimistic" || counts.rolled_back == 0, "what is certified is not taken back");
    }
    Ok(())
}

/// Random poses that are free, by motor name in degrees.
fn poses(configs: &Path) -> Result<Vec<NamedPose>, Box<dyn Error>> {
    let robot = Arc::new(load_robot(configs.join("robots/icub.xml"))?.value);
    let objects = load_world(configs.join("worlds/explore.xml"))?.value;
    let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], objects)?;
    let named = |name: &&str| robot.motors.iter().position(|m| m.name == *name);
    let torso = robot.part("torso").map(|part| part.motors.clone()).unwrap_or_default();
    let motors: Vec<usize> = torso.chain(MOTORS.iter().filter_map(named)).collect();
    let at_home = robot.home();
    let pose = |q: Vec<f64>| {
        let mut pose = at_home.clone();
        motors.iter().for_each(|m| pose[*m] = q[*m]);
        pose
    };
    let free = random_poses(&robot, SEED).map(pose).filter(|q| scene.free(&[q], CLEARANCE)).take(POSES);
    let degrees = |q: Vec<f64>| motors.iter().map(|m| (robot.motors[*m].name.clone(), q[*m].to_degrees())).collect();
    Ok(free.map(degrees).collect())
}

/// The behavior: a tour of random goals.
fn behavior(configs: &Path, poses: &[NamedPose], mode: &str, queries: usize) -> Result<String, Box<dyn Error>> {
    let path = |file: &str| format!("{:?}", configs.join(file).to_string_lossy());
    let mut text = format!(
        "seed = {SEED}\nworld.file = {}\nrecord.enabled = false\n[[robot]]\nname = \"icub\"\nmodel = {}\n\
         controller = {{ period_ms = 20, history = 6000 }}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n[robot.agent]\nkind = \"roadmap\"\nspeed = 0.1\n\
         neighbors = 8\nvalidation = {mode:?}\n",
        path("worlds/explore.xml"),
        path("robots/icub.xml")
    );
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let goals: Vec<String> = (0..queries).map(|_| format!("p{}", rng.random_range(0..poses.len()))).collect();
    writeln!(text, "goals = {goals:?}")?;
    for (i, pose) in poses.iter().enumerate() {
        writeln!(text, "[[robot.agent.poses]]\nname = \"p{i}\"\n[robot.agent.poses.q_deg]")?;
        for (motor, deg) in pose {
            writeln!(text, "{motor} = {deg:?}")?;
        }
    }
    Ok(text)
}
