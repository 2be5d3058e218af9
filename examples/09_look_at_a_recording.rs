//! Print a recording's contents, and how to view it:
//!
//! ```sh
//! cargo run --release --example 09_look_at_a_recording runs/NAME-TIME/recording.rrd
//! ```
//!
//! Without a file, it first records a short made-up exploration of the iCub.

use mobee_model::{load_robot, load_world};
use mobee_recorder::{Contents, Recorder, Settings, staged};
use std::collections::BTreeMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn main() -> Result<(), Box<dyn Error>> {
    let path = match std::env::args().nth(1) {
        Some(path) => PathBuf::from(path),
        None => make_up_one()?,
    };
    let contents = Contents::read(&path)?;

    println!("{}: {:.1} s of a run", path.display(), contents.until.secs());
    for (name, value) in &contents.properties {
        println!("  {name}: {value}");
    }
    let mut groups: BTreeMap<&str, (u64, u64)> = BTreeMap::new();
    for (entity, rows) in &contents.rows {
        let group = entity.trim_start_matches('/').split('/').next().unwrap_or_default();
        let (entities, all) = groups.entry(group).or_default();
        *entities += 1;
        *all += rows;
    }
    for (group, (entities, rows)) in groups {
        println!("  {group:9} {entities:4} entities, {rows:7} rows: {}", about(group));
    }
    println!("\nlook at it:           rerun {}", path.display());
    println!("get the viewer:       pip install rerun-sdk==0.36.3");
    println!("without a screen:     tools/shot.sh {} picture.png", path.display());
    Ok(())
}

fn about(group: &str) -> &'static str {
    match group {
        "about" => "the legend",
        "graph" => "the roadmap's feasible part as a graph",
        "joints" => "motor positions, degrees, by part",
        "log" => "events in words",
        "progress" => "edges by state, rollbacks",
        "roadmap" => "the roadmap flat, as seen from the front",
        "state" => "lanes of the filter and of the transaction",
        "world" => "robots, objects, trails, contacts, the roadmap in the world",
        _ => "of another program",
    }
}

/// Records two minutes of made-up motion.
fn make_up_one() -> Result<PathBuf, Box<dyn Error>> {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let robot = Arc::new(load_robot(configs.join("robots/icub.xml"))?.value);
    let objects = load_world(configs.join("worlds/ball.xml"))?.value;
    let motors: Vec<usize> = ["torso", "left_arm"]
        .into_iter()
        .filter_map(|name| robot.part(name))
        .flat_map(|part| part.motors.clone().take(7))
        .collect();
    let stage = staged::Stage { robot, objects, motors, hand: "l_hand".into(), vertices: 15, motions: 45, seed: 2 };
    let path = std::env::temp_dir().join("mobee-example.rrd");
    let settings =
        Settings { path: path.clone(), name: "made up".into(), config: "none".into(), ..Settings::default() };
    let mut recorder = Recorder::new(&settings)?;
    staged::play(&stage, &mut recorder)?;
    Ok(path) // the recorder writes what is left when it is dropped
}
