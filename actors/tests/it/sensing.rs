//! Sensing stands on supervised actors: it runs in virtual time, what dies of it comes back, and what is too much is dropped and counted.

use crate::common::{Ran, Trial};
use mobee_actors::system::{Control, SensorSetup};
use mobee_contract::*;
use std::sync::Arc;
use std::time::Duration;

/// Thirty frames a second, on each of which a ball is farther to the right.
struct Stub(u32);

impl Camera for Stub {
    fn period(&self) -> Duration {
        Duration::from_millis(33)
    }
    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        self.0 += 1;
        let intrinsics = Intrinsics { size: [4, 1], focal: [4.0, 4.0], center: [2.0, 0.5] };
        Ok(Some(Frame { exposed: now, intrinsics, pixels: (0..12).map(|k| (self.0 + k) as u8).collect() }))
    }
}

/// Takes as long as three frames do.
struct Slow;

const TAKES: Duration = Duration::from_millis(100);

impl Detector for Slow {
    fn detect(&mut self, frame: &Frame) -> Vec<Region> {
        let center = [f64::from(frame.pixels[0]), 0.5];
        vec![Region { object: "ball".into(), center, size: [1.0, 1.0] }]
    }
    fn takes(&self) -> Duration {
        TAKES
    }
}

fn run() -> Ran {
    let kill = |ms, name: &str| (Duration::from_millis(ms), Control::Kill(name.into()));
    let sensor = SensorSetup {
        name: "left".into(),
        camera: Arc::new(|| Ok(Box::new(Stub(0)))),
        detector: Arc::new(|| Ok(Box::new(Slow))),
    };
    let controls = vec![kill(3_000, "left/detector"), kill(5_000, "left/camera")];
    let limit = Duration::from_secs(10);
    let poses = [[4.0, 4.0, 0.0], [-4.0, -4.0, 0.0]].repeat(200);
    Trial { sensors: vec![sensor], controls, limit, poses, ..Trial::default() }.run()
}

#[test]
fn a_sensor_in_virtual_time_comes_back_and_counts_what_it_drops() {
    let ran = run();
    let mut seen = Vec::new();
    let mut lives = Vec::new();
    let mut link = None;
    for (at, event) in ran.events() {
        match &*event {
            Event::Sighted { sensor, exposed, regions } => {
                assert_eq!((sensor.as_str(), regions.len()), ("left", 1));
                seen.push((at, *exposed));
            }
            Event::Died { actor, .. } => lives.push(format!("{actor} died")),
            Event::Restarted { actor, .. } => lives.push(format!("{actor} is back")),
            Event::Link { link: name, sent, handled, dropped, most, .. } if name == "left/camera>detector" => {
                link = Some((*sent, *handled, *dropped, *most));
            }
            _ => {}
        }
    }
    let both = ["left/detector died", "left/detector is back", "left/camera died", "left/camera is back"];
    assert_eq!(lives, both, "{}", ran.lines());
    // detection takes its simulated time, of a frame that was the newest when it began
    for (at, exposed) in &seen {
        let late = at.since(*exposed);
        assert!((TAKES..TAKES + Duration::from_millis(40)).contains(&late), "{late:?}");
    }
    let before = |s: f64| seen.iter().filter(|(at, _)| at.secs() < s).count();
    assert!(before(3.0) > 20 && before(5.0) > before(3.0) + 10 && seen.len() > before(5.0) + 20, "{seen:?}");
    let (sent, handled, dropped, most) = link.expect("the counters of the link");
    assert!(sent > 250 && handled + dropped + 1 >= sent && dropped > sent / 2, "{sent} {handled} {dropped}");
    assert_eq!(most, 1, "a latest value");
    // the robot has not noticed
    assert_eq!(ran.violations(), vec![]);
    assert_eq!(ran.end.counts.readings_dropped, 0);
}

#[test]
fn equal_seeds_see_the_same() {
    assert_eq!(run().lines(), run().lines());
}
