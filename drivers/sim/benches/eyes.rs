//! What a pair of simulated eyes costs, processor time of one core: the iCub's, 320x240 pixels each, with a hand and a cup among
//! distractors in view, drawn scenery, shadows and noise.
//!
//! ```text
//! cargo bench -p mobee-sim --bench eyes
//! ```
#![allow(clippy::disallowed_methods)] // a measurement of the processor

#[path = "../../../model/fast/benches/measure/mod.rs"]
mod measure;

use measure::{processor_time, sorted};
use mobee_contract::{Time, Truth};
use mobee_model::{Robot, Scene, load_robot, load_world};
use mobee_sim::eyes::{DistractorSettings, LensSettings, SimulatedCameraSettings, SimulatedEye};
use nalgebra::Isometry3;
use std::sync::Arc;
use std::time::Instant;

/// Pairs in a row: the processor's time is told in steps of milliseconds.
const AT_ONCE: u32 = 20;
/// How often.
const ROUNDS: usize = 41;

fn main() {
    let configs = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs");
    let robot = Arc::new(load_robot(format!("{configs}/robots/icub.xml")).expect("a robot").value);
    let world = load_world(format!("{configs}/worlds/cup.xml")).expect("a world").value;
    let scene = Arc::new(Scene::new(vec![(Arc::clone(&robot), Isometry3::identity())], world).expect("a scene"));
    let clock = Instant::now();

    let full = |marker: &str| {
        let mut settings = SimulatedCameraSettings::at(marker);
        let area_m = Some([-0.6, -0.2, -0.3, 0.3]);
        let like = Some("cup".into());
        let distractors = DistractorSettings { count: 8, on: "table".into(), like, hue_deg: [15.0, 40.0], area_m };
        settings.scenery.distractors = Some(distractors);
        settings
    };
    let bent = |marker: &str| SimulatedCameraSettings {
        lens: LensSettings { distortion: [-0.37, 0.2, 0.003, 0.003], ..Default::default() },
        ..full(marker)
    };
    let lit = |marker: &str| {
        let mut settings = full(marker);
        settings.scenery.shadows = false;
        settings
    };
    let plain = |marker: &str| {
        let mut settings = SimulatedCameraSettings::at(marker).ideal();
        settings.scenery.shadows = false;
        settings
    };
    report("all, head at rest", &times(&robot, &scene, &full, 0.0, clock));
    report("all, head turning at 50 deg/s", &times(&robot, &scene, &full, 50.0, clock));
    report("all, with lens distortion", &times(&robot, &scene, &bent, 0.0, clock));
    report("without shadows", &times(&robot, &scene, &lit, 0.0, clock));
    report("without shadows, distractors, noise", &times(&robot, &scene, &plain, 0.0, clock));
}

/// Seconds that a pair of pictures takes.
fn times(
    robot: &Arc<Robot>,
    scene: &Arc<Scene>,
    settings: &dyn Fn(&str) -> SimulatedCameraSettings,
    speed_deg_per_s: f64,
    clock: Instant,
) -> Vec<f64> {
    let eye = |marker| SimulatedEye::new(&settings(marker), robot, 0, 1).expect("an eye");
    let mut eyes = [eye("l_eye"), eye("r_eye")];
    let mut before = [None, None];
    let motor = |name: &str| robot.motor_index(name).expect("a motor");
    let mut frame = 0u32;
    let mut pair = || {
        frame += 1;
        let now = Time::from_secs(f64::from(frame) / 30.0);
        let mut q = robot.home();
        // a triangle of a few degrees about the cup
        let turned = (f64::from(frame) / 30.0 * speed_deg_per_s + 10.0).rem_euclid(40.0);
        q[motor("neck_yaw")] = ((turned - 20.0).abs() - 10.0).to_radians();
        q[motor("neck_pitch")] = -30f64.to_radians();
        q[motor("eyes_tilt")] = -15f64.to_radians();
        q[motor("r_shoulder_pitch")] = -40f64.to_radians();
        q[motor("r_elbow")] = 80f64.to_radians();
        let truth = Truth { scene: Arc::clone(scene), poses: vec![q.into()] };
        for (eye, before) in eyes.iter_mut().zip(&mut before) {
            let (frame, at) = eye.frame(&truth, *before, now).expect("a frame");
            std::hint::black_box(frame);
            *before = Some((at, now));
        }
    };
    let mut round = |_| {
        let begin = processor_time(clock);
        (0..AT_ONCE).for_each(|_| pair());
        (processor_time(clock) - begin) / f64::from(AT_ONCE)
    };
    (0..ROUNDS).map(&mut round).collect()
}

fn report(what: &str, times: &[f64]) {
    let times = sorted(times.to_vec());
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    let [least, median, most] = [at(0.0), at(0.5), at(0.95)];
    println!(
        "{what:36} least {:5.2} ms, median {:5.2}, 95 % {:5.2}: {:4.0} pairs/s",
        1e3 * least,
        1e3 * median,
        1e3 * most,
        1.0 / median
    );
}
