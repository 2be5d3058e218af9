//! A sensor that gives up is named, does not stop the run, and can be started again; what is only a bad picture, or too many regions,
//! costs no life.

use super::common::*;
use mobee_contract::*;
use mobee_runtime::system::{CameraSetup, Control, Reason, SensorSetup};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const LENS: Intrinsics = Intrinsics { size: [4, 2], focal: [4.0; 2], center: [2.0, 1.0], distortion: [0.0; 4] };

/// Ten frames a second; every other picture is bad, or all fail while the flag is up.
struct Flaky {
    frames: u32,
    fails: Arc<AtomicBool>,
    skipped: Option<SkippedPictures>,
}

impl Camera for Flaky {
    fn period(&self) -> Duration {
        Duration::from_millis(100)
    }
    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        if self.fails.load(Ordering::SeqCst) {
            return Err("the cable is out".into());
        }
        self.frames += 1;
        if self.frames.is_multiple_of(2) {
            SkippedPictures::add(&mut self.skipped, format!("picture {} is torn", self.frames));
            return Ok(None);
        }
        Ok(Some(Frame { exposed: now, intrinsics: LENS, pixels: vec![0; 24].into() }))
    }
    fn skipped(&mut self) -> Option<SkippedPictures> {
        self.skipped.take()
    }
}

/// Reports so many balls and one cup.
struct Balls(usize);

impl Detector for Balls {
    fn detect(&mut self, _: &Frame) -> Vec<Region> {
        let region = |object: &str, n: usize| Region {
            object: object.into(),
            center: [n as f64, 0.5],
            bounds: [0.0, 0.0, 1.0, 1.0],
            area: 1.0,
            is_clipped: false,
            confidence: 1.0,
            pose: None,
        };
        (0..self.0).map(|n| region("ball", n)).chain([region("cup", 0)]).collect()
    }
    fn takes(&self) -> Duration {
        Duration::from_millis(1)
    }
    fn omitted(&self) -> u64 {
        3
    }
}

fn eyes(fails: &Arc<AtomicBool>, balls: usize) -> SensorSetup {
    let fails = fails.clone();
    let camera = CameraSetup {
        name: "left".into(),
        camera: Arc::new(move || Ok(Box::new(Flaky { frames: 0, fails: fails.clone(), skipped: None }))),
        detector: Arc::new(move || Ok(Box::new(Balls(balls)))),
        max_regions: 4,
    };
    SensorSetup { name: "eyes".into(), cameras: vec![camera], is_simulated: false, locator: None }
}

fn run(sensor: SensorSetup, controls: Vec<(Duration, Control)>) -> Ran {
    let poses = [[4.0, 4.0, 0.0], [-4.0, -4.0, 0.0]].repeat(200);
    let ran =
        Trial { sensors: vec![sensor], controls, limit: Duration::from_secs(20), poses, ..Trial::default() }.run();
    assert_eq!(ran.violations(), vec![]);
    assert_eq!(ran.end.reason, Reason::Time, "the run does not end for it");
    ran
}

fn warnings(ran: &Ran) -> Vec<String> {
    let text =
        |(_, event): (Time, Arc<Event>)| if let Event::Warning { text } = &*event { Some(text.clone()) } else { None };
    ran.events().into_iter().filter_map(text).collect()
}

fn seen(ran: &Ran) -> Vec<(Time, usize, u64)> {
    let seen = |(at, event): (Time, Arc<Event>)| match &*event {
        Event::Sighted { regions, omitted, .. } => Some((at, regions.len(), *omitted)),
        _ => None,
    };
    ran.events().into_iter().filter_map(seen).collect()
}

#[test]
fn bad_pictures_are_skipped_counted_and_warned_of_once() {
    let ran = run(eyes(&Arc::default(), 1), Vec::new());
    assert_eq!((ran.end.counts.restarts, ran.end.counts.gave_up), (0, 0), "{}", ran.lines());
    let skipped = ran.end.counts.pictures_skipped;
    assert!((95..=101).contains(&skipped) && seen(&ran).len() >= 95, "{skipped}");
    let told = warnings(&ran);
    assert!(told.len() == 2 && told.iter().any(|t| t.contains("eyes/left: picture 2 is torn")), "{told:?}");
}

#[test]
fn regions_beyond_the_greatest_number_are_left_out_and_counted() {
    let ran = run(eyes(&Arc::default(), 10), Vec::new());
    let all = seen(&ran);
    // four balls of ten and the cup; three are left out by the detector itself
    assert!(all.len() > 90 && all.iter().all(|(_, kept, omitted)| (*kept, *omitted) == (5, 9)), "{all:?}");
    assert_eq!(ran.end.counts.regions_omitted, 9 * all.len() as u64);
    assert_eq!(warnings(&ran).iter().filter(|t| t.contains("9 regions")).count(), 1, "{:?}", warnings(&ran));
}

#[test]
fn a_sensor_that_gives_up_is_down_until_it_is_started_again() {
    let fails = Arc::new(AtomicBool::new(true));
    let ran = run(eyes(&fails, 1), Vec::new());
    let counts = &ran.end.counts;
    assert_eq!((counts.gave_up, counts.is_given_up), (1, false));
    let why = counts.down.get("eyes").expect("it is named");
    assert!(why.contains("eyes/left/camera died") && why.contains("the cable is out"), "{why}");

    let (reply, answer) = tokio::sync::oneshot::channel();
    let (unknown, refused) = tokio::sync::oneshot::channel();
    let mended = fails.clone();
    let mut sensor = eyes(&fails, 1);
    let make = sensor.cameras[0].camera.clone();
    let made = std::sync::atomic::AtomicU32::new(0);
    // the tenth camera is mended: the nine before have used up the restarts
    sensor.cameras[0].camera = Arc::new(move || {
        if made.fetch_add(1, Ordering::SeqCst) == 9 {
            mended.store(false, Ordering::SeqCst);
        }
        make()
    });
    let controls = vec![
        (Duration::from_secs(10), Control::Restart { name: "ears".into(), reply: unknown }),
        (Duration::from_secs(11), Control::Restart { name: "eyes".into(), reply }),
    ];
    let ran = run(sensor, controls);
    assert_eq!(answer.blocking_recv(), Ok(Ok(())));
    let refused = refused.blocking_recv().expect("an answer").unwrap_err();
    assert!(refused.contains("`ears`") && refused.contains("there are: eyes"), "{refused}");
    let all = seen(&ran);
    assert!(all.len() > 30 && all[0].0.secs() > 11.0, "{} from {:?} on", all.len(), all.first());
    assert!(ran.end.counts.down.is_empty() && ran.end.counts.gave_up == 1, "{:?}", ran.end.counts.down);
}
