//! Serves the images of a file's simulated cameras at image ports.

use miette::Report;
use mobee_compose::config::{Config, ConfigError, Source, StepTrigger};
use mobee_compose::{Composition, compose, derive_seed, sensor_camera};
use mobee_contract::{Camera, CameraContext, Pose, Time, Truth};
use mobee_driver_yarp::{SimBoard, SimClock};
use mobee_model::{Edit, Scene};
use mobee_runtime::system::{CueTrigger, ScriptStep};
use mobee_yarp::{Delivery, Image, Network, OutputPort, PixelCode, Stamp};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::task::{JoinSet, spawn_blocking};
use tokio::time::{MissedTickBehavior, interval};

/// A camera that is served.
pub(super) struct ServedCamera {
    port: String,
    camera: Box<dyn Camera>,
}

/// The boards of one robot.
pub(super) type RobotBoards = Vec<Arc<SimBoard>>;

/// The simulated cameras of a file's sensors, with the names of their ports: `PREFIX/cam/EYE`. Other cameras are
/// skipped.
///
/// # Errors
/// Complaints about the configuration.
pub(super) fn cameras(
    config: &Config,
    source: &Source,
    prefix: impl Fn(&str) -> String,
    boards: &[RobotBoards],
    clock: SimClock,
) -> Result<Vec<ServedCamera>, Report> {
    if config.sensor.is_empty() {
        return Ok(Vec::new());
    }
    let Composition { scene, script, .. } = compose(bare(config), source)?;
    let world = Arc::new(Mutex::new(World::new(scene, script)));
    let scene = lock(&world).at(Time::ZERO);
    let mut served = Vec::new();
    for (i, sensor) in config.sensor.iter().enumerate() {
        let Some(index) = sensor.carrier(config) else { continue };
        let Some(robot) = scene.robots().get(index) else { continue };
        for (k, eye) in sensor.eye.iter().enumerate() {
            let context = CameraContext {
                robot: robot.clone(),
                index,
                seed: derive_seed(config.seed, &format!("{}/{}/camera", sensor.name, eye.name)),
                truth: truth(world.clone(), clock, boards.to_vec()),
            };
            let camera = sensor_camera(source, &format!("sensor[{i}].eye[{k}].camera"), &eye.camera, &context)?;
            if camera.is_simulated() {
                served.push(ServedCamera { port: format!("{}/cam/{}", prefix(&robot.name), eye.name), camera });
            }
        }
    }
    Ok(served)
}

/// The configuration of world and robots only: sensors and agents run in other processes, so only steps at a fixed time
/// remain in the script.
pub(super) fn bare(config: &Config) -> Config {
    let mut bare = config.clone();
    (bare.sensor, bare.yarp) = (Vec::new(), None);
    bare.script.retain(|step| matches!(step.when, StepTrigger::AtS(_)));
    bare.bridge.clear();
    bare.robot.iter_mut().for_each(|robot| robot.agent = None);
    bare
}

/// The world, with the steps of the file's script by the simulation's clock.
struct World {
    scene: Arc<Scene>,
    /// Steps to come, the latest first.
    to_come: Vec<(Time, Edit)>,
}

impl World {
    fn new(scene: Scene, script: Vec<ScriptStep>) -> World {
        let timed = script.into_iter().filter_map(|step| match step.when {
            CueTrigger::At(at) => Some((at, step.edit)),
            _ => None,
        });
        let mut to_come: Vec<(Time, Edit)> = timed.collect();
        // steps of one time in their order in the file
        to_come.sort_by_key(|(at, _)| *at);
        to_come.reverse();
        World { scene: Arc::new(scene), to_come }
    }

    fn at(&mut self, now: Time) -> Arc<Scene> {
        while let Some((_, edit)) = self.to_come.pop_if(|(at, _)| *at <= now) {
            match self.scene.edit(&edit) {
                Ok(scene) => self.scene = Arc::new(scene),
                Err(why) => eprintln!("warning: a step of the script can't be done: {why}"),
            }
        }
        self.scene.clone()
    }
}

fn lock(world: &Mutex<World>) -> MutexGuard<'_, World> {
    world.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The present ground truth, with the robots at the positions of their boards.
fn truth(
    world: Arc<Mutex<World>>,
    clock: SimClock,
    boards: Vec<RobotBoards>,
) -> Arc<dyn Fn() -> Option<Truth> + Send + Sync> {
    Arc::new(move || {
        let scene = lock(&world).at(clock.now());
        let pose = |(robot, boards): (&Arc<mobee_model::Robot>, &RobotBoards)| -> Pose {
            let mut q = robot.home();
            for board in boards {
                let Some(part) = robot.parts.iter().find(|part| part.name == board.part()) else { continue };
                let slots = q.get_mut(part.motors.clone()).into_iter().flatten();
                slots.zip(board.positions()).for_each(|(to, from)| *to = from);
            }
            q.into()
        };
        let poses = scene.robots().iter().zip(&boards).map(pose).collect();
        Some(Truth { scene, poses })
    })
}

/// Opens the cameras' ports, and serves their images while the tasks live.
///
/// # Errors
/// If a port can't be opened, with the remedy.
pub(super) async fn serve(
    network: &Network,
    cameras: Vec<ServedCamera>,
    clock: SimClock,
    speed: f64,
) -> Result<JoinSet<()>, Report> {
    let mut tasks = JoinSet::new();
    for ServedCamera { port, camera } in cameras {
        let opened = OutputPort::open(network, &port, Delivery::Newest).await;
        let port = opened.map_err(|e| ConfigError::plain(e.to_string(), "end the program that holds it, or wait"))?;
        println!("{}", port.name());
        tasks.spawn(show(port, camera, clock, speed));
    }
    Ok(tasks)
}

/// Sends a camera's images while the port has readers.
async fn show(port: OutputPort, mut camera: Box<dyn Camera>, clock: SimClock, speed: f64) {
    let mut stamp = Stamp::default();
    let mut ticks = interval(camera.period().div_f64(speed).max(Duration::from_millis(1)));
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        if port.peers().is_empty() {
            continue;
        }
        let exposed = spawn_blocking(move || (camera.frame(clock.now()), camera)).await;
        let Ok((frame, back)) = exposed else { return eprintln!("warning: {}: the camera failed", port.name()) };
        camera = back;
        let frame = match frame {
            Ok(Some(frame)) => frame,
            Ok(None) => continue,
            Err(why) => return eprintln!("warning: {}: {why}", port.name()),
        };
        let [width, height] = frame.intrinsics.size;
        stamp = stamp.next(clock.wall(frame.exposed));
        if let Ok(image) = Image::new(PixelCode::RGB, width, height, &frame.pixels) {
            port.write(image.encode(), Some(stamp.envelope()));
        }
    }
}
