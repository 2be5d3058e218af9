//! Load a robot, move it, and query where its hand is and what it would touch.
//!
//! `cargo run --release --example 01_load_a_robot`

use mobee_model::{Scene, load_robot, load_world};
use nalgebra::Isometry3;
use std::path::Path;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let configs = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
    let robot = Arc::new(load_robot(configs.join("robots/icub.xml"))?.value);
    let world = load_world(configs.join("worlds/explore.xml"))?.value;
    println!("{} has {} motors in {} parts", robot.name, robot.motors.len(), robot.parts.len());

    // a pose is a position per motor, in rad, in the order of `robot.motors`
    let mut pose = robot.home();
    let elbow = robot.motor_index("r_elbow").ok_or("no r_elbow")?;
    let scene = Scene::new(vec![(robot.clone(), Isometry3::identity())], world)?;
    for elbow_deg in [20.0_f64, 60.0, 100.0] {
        pose[elbow] = elbow_deg.to_radians();
        let hand = robot.markers.iter().position(|m| m.name == "r_hand").ok_or("no r_hand")?;
        let at = robot.markers_at(&pose)[hand].position();
        print!("elbow {elbow_deg:5.1} deg: hand at ({:.3}, {:.3}, {:.3}) m", at.x, at.y, at.z);
        match scene.clearance(&[&pose], 0.2) {
            Some(c) => {
                let (a, b) = (scene.shape_name(c.pair.0), scene.shape_name(c.pair.1));
                println!(", nearest: {a} and {b}, {:.1} mm", c.distance * 1e3);
            }
            None => println!(", nothing within 200 mm"),
        }
    }
    Ok(())
}
