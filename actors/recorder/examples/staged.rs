//! Records a simulated exploration, to show the effect of a change to the recorder:
//! `cargo run --release -p mobee-recorder --example staged ROBOT.xml WORLD.xml OUT.rrd [MOTIONS]`;
//! `-` for `OUT.rrd` records nothing.

use mobee_contract::{Entry, Sink, Time};
use mobee_model::{load_robot, load_world};
use mobee_recorder::{Recorder, Settings, staged};
use std::sync::Arc;

struct Nowhere;

impl Sink for Nowhere {
    fn write(&mut self, _: Time, _: &Entry) -> Result<(), String> {
        Ok(())
    }
    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [robot, world, out, more @ ..] = args.as_slice() else {
        return Err("give ROBOT.xml WORLD.xml OUT.rrd [MOTIONS]".into());
    };
    let robot = Arc::new(load_robot(robot)?.value);
    let motors = robot.part("torso").into_iter().chain(robot.part("left_arm")).flat_map(|p| p.motors.clone().take(7));
    let motors: Vec<usize> = motors.collect();
    let stage = staged::Stage {
        motors,
        objects: load_world(world)?.value,
        hand: "l_hand".into(),
        vertices: 20,
        motions: more.first().map_or(Ok(60), |m| m.parse())?,
        seed: 7,
        robot,
    };
    if out == "-" {
        // The cost of the staged run itself.
        println!("{} recorded nowhere", staged::play(&stage, &mut Nowhere)?);
        return Ok(());
    }
    let settings =
        Settings { path: out.into(), name: "staged".into(), config: "staged.toml".into(), ..Settings::default() };
    let mut recorder = Recorder::new(&settings)?;
    let end = staged::play(&stage, &mut recorder)?;
    recorder.flush()?;
    println!("{end} recorded in {out}");
    Ok(())
}
