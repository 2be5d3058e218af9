//! Sensing stands on supervised actors: it runs in virtual time, what dies of it comes back, what is too much is dropped and counted, and
//! a detector is exchanged between two frames.

use crate::common::{Ran, Trial};
use mobee_contract::*;
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{BesideOffer, CameraSetup, Control, LocatorSetup, NewBeside, PartMaker, SensorSetup};
use std::sync::Arc;
use std::time::Duration;

/// Thirty frames a second, on each of which a ball is farther to the right. Some are said to be older than they are.
struct Stub {
    frames: u32,
    old: Duration,
}

impl Camera for Stub {
    fn period(&self) -> Duration {
        Duration::from_millis(33)
    }
    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        self.frames += 1;
        let intrinsics = Intrinsics { size: [4, 1], focal: [4.0, 4.0], center: [2.0, 0.5], distortion: [0.0; 4] };
        let exposed = Time((now.since(Time::ZERO).saturating_sub(self.old)).as_nanos() as u64);
        Ok(Some(Frame { exposed, intrinsics, pixels: (0..12).map(|k| (self.frames + k) as u8).collect() }))
    }
}

/// Takes as long as three frames do, and knows how many it has seen.
struct Slow {
    name: &'static str,
    seen: u64,
    takes: Duration,
}

const TAKES: Duration = Duration::from_millis(100);

impl Detector for Slow {
    fn detect(&mut self, frame: &Frame) -> Vec<Region> {
        self.seen += 1;
        assert!(self.name != "breaks", "planted");
        let mut center = [f64::from(frame.pixels[0]), self.seen as f64];
        let [u, v] = center;
        if self.name == "raves" {
            center[0] = f64::NAN;
        }
        let bounds = [u - 0.5, v - 0.5, u + 0.5, v + 0.5];
        vec![Region {
            object: self.name.into(),
            center,
            bounds,
            area: 1.0,
            is_clipped: false,
            confidence: 1.0,
            pose: None,
        }]
    }
    fn takes(&self) -> Duration {
        self.takes
    }
    fn export(&self) -> Option<Snapshot> {
        Some(Snapshot { kind: "slow".into(), version: 1, state: self.seen.into() })
    }
    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        if self.name == "forgets" {
            return Err(Refusal::State { what: "it learns otherwise".into() });
        }
        self.seen = from.state.as_u64().unwrap_or(0);
        Ok(())
    }
}

/// Places things where the first motor points, one pixel wide.
struct Pointing(u32);

impl Locator for Pointing {
    fn locate(&mut self, seen: &[Sighting], body: &BodyState) -> Vec<Located> {
        self.0 += 1;
        let place = |s: &Sighting| {
            assert_eq!((&*s.camera, s.at, s.intrinsics.focal[0]), ("eyes/left", body.at, 4.0));
            let covariance = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, f64::from(self.0)]];
            Located { object: s.region.object.clone(), position: [body.q[0], body.q[1], body.q[2]], covariance }
        };
        seen.iter().map(place).collect()
    }
}

fn detector(name: &'static str, takes: Duration) -> PartMaker<dyn Detector> {
    Arc::new(move || Ok(Box::new(Slow { name, seen: 0, takes })))
}

fn eyes(old: Duration) -> SensorSetup {
    let camera = CameraSetup {
        name: "left".into(),
        camera: Arc::new(move || Ok(Box::new(Stub { frames: 0, old }))),
        detector: detector("ball", TAKES),
        max_regions: DEFAULT_MAX_REGIONS,
    };
    let locator = LocatorSetup { robot: "arm".into(), locator: Arc::new(|| Ok(Box::new(Pointing(0)))), gate: None };
    SensorSetup { name: "eyes".into(), cameras: vec![camera], is_simulated: false, locator: Some(locator) }
}

fn run(sensor: SensorSetup, controls: Vec<(u64, Control)>) -> Ran {
    run_with(sensor, controls, 3000)
}

fn run_with(sensor: SensorSetup, controls: Vec<(u64, Control)>, history: usize) -> Ran {
    let controls = controls.into_iter().map(|(ms, control)| (Duration::from_millis(ms), control)).collect();
    let poses = [[4.0, 4.0, 0.0], [-4.0, -4.0, 0.0]].repeat(200);
    let ran =
        Trial { sensors: vec![sensor], controls, limit: Duration::from_secs(10), poses, history, ..Trial::default() }
            .run();
    // the robot has not noticed
    assert_eq!(ran.violations(), vec![]);
    assert_eq!(ran.end.counts.readings_dropped, 0);
    ran
}

fn killed() -> Ran {
    let kill = |ms, name: &str| (ms, Control::Kill(name.into()));
    let all = vec![kill(3_000, "eyes/left/detector"), kill(5_000, "eyes/left/camera"), kill(7_000, "eyes/locator")];
    run(eyes(Duration::ZERO), all)
}

/// What was seen: when it was told, when it was exposed, and the only region.
fn sighted(ran: &Ran) -> Vec<(Time, Time, Region)> {
    seen_by(ran, false)
}

/// The same of the detector in force, or of one that looks on.
fn seen_by(ran: &Ran, shadows: bool) -> Vec<(Time, Time, Region)> {
    let of = |(at, event): (Time, Arc<Event>)| match &*event {
        Event::Sighted { camera, exposed, regions, is_shadow, .. } if *is_shadow == shadows => {
            assert_eq!((camera.as_str(), regions.len()), ("eyes/left", 1));
            Some((at, *exposed, regions[0].clone()))
        }
        _ => None,
    };
    ran.events().into_iter().filter_map(of).collect()
}

/// Where things were said to be, by the time of the exposure.
fn located(ran: &Ran) -> Vec<(Time, Located)> {
    let of = |(_, event): (Time, Arc<Event>)| match &*event {
        Event::Located { sensor, exposed, objects, .. } => {
            assert_eq!((sensor.as_str(), objects.len()), ("eyes", 1));
            Some((*exposed, objects[0].clone()))
        }
        _ => None,
    };
    ran.events().into_iter().filter_map(of).collect()
}

/// What a link counted: sent, handled, dropped, and the most that waited.
fn link(ran: &Ran, wanted: &str) -> (u64, u64, u64, u64) {
    let of = |(_, event): &(Time, Arc<Event>)| match &**event {
        Event::Link { link, sent, handled, dropped, most, .. } if link == wanted => {
            Some((*sent, *handled, *dropped, *most))
        }
        _ => None,
    };
    ran.events().iter().find_map(of).expect("the counters of the link")
}

fn lives(ran: &Ran) -> Vec<String> {
    let of = |(_, event): (Time, Arc<Event>)| match &*event {
        Event::Died { actor, .. } => Some(format!("{actor} died")),
        Event::Restarted { actor, .. } => Some(format!("{actor} is back")),
        _ => None,
    };
    ran.events().into_iter().filter_map(of).collect()
}

#[test]
fn a_sensor_in_virtual_time_comes_back_and_counts_what_it_drops() {
    let ran = killed();
    let back = |actor: &str| [format!("eyes/{actor} died"), format!("eyes/{actor} is back")];
    assert_eq!(lives(&ran), ["left/detector", "left/camera", "locator"].map(back).concat(), "{}", ran.lines());
    let seen = sighted(&ran);
    // detection takes its simulated time, of a frame that was the newest when it began
    for (at, exposed, _) in &seen {
        let late = at.since(*exposed);
        assert!((TAKES..TAKES + Duration::from_millis(40)).contains(&late), "{late:?}");
    }
    let before = |s: f64| seen.iter().filter(|(at, ..)| at.secs() < s).count();
    assert!(before(3.0) > 20 && before(5.0) > before(3.0) + 10 && seen.len() > before(5.0) + 20, "{seen:?}");
    // a new life knows what the one before had learned
    let learned: Vec<f64> = seen.iter().map(|(_, _, region)| region.center[1]).collect();
    assert!(learned.is_sorted() && learned.last() >= Some(&(seen.len() as f64)), "{learned:?}");
    let (sent, handled, dropped, most) = link(&ran, "eyes/left/camera>detector");
    assert!(sent > 250 && handled + dropped + 1 >= sent && dropped > sent / 2, "{sent} {handled} {dropped}");
    assert_eq!(most, 1, "a latest value");
    let placed = located(&ran).len() as u64;
    let (sent, handled, dropped, _) = link(&ran, "eyes/left/detector>locator");
    assert!(sent == seen.len() as u64 && handled + dropped + 1 >= sent && placed + 2 >= handled, "{sent} {handled}");
    assert!(placed > 60, "{placed}");
}

#[test]
fn numbers_that_are_none_are_left_out_and_told_of_once() {
    let mut sensor = eyes(Duration::ZERO);
    sensor.cameras[0].detector = detector("raves", TAKES);
    let ran = run(sensor, Vec::new());
    let is_empty = |(_, event): &(Time, Arc<Event>)| match &**event {
        Event::Sighted { regions, .. } => regions.is_empty(),
        Event::Located { .. } => false,
        _ => true,
    };
    assert!(ran.events().iter().all(is_empty), "{}", ran.lines());
    assert_eq!(ran.lines().matches("numbers that are none").count(), 1, "{}", ran.lines());
}

#[test]
fn equal_seeds_see_the_same() {
    assert_eq!(killed().lines(), killed().lines());
}

#[test]
fn what_is_seen_is_placed_by_the_body_as_it_was_at_the_exposure() {
    let ran = run(eyes(Duration::from_millis(47)), Vec::new());
    let (mut before, mut compared) = (None, 0);
    let pose = |(at, entry)| if let Entry::Pose { q, .. } = entry { Some((at, q)) } else { None };
    let (poses, placed): (Vec<(Time, Pose)>, _) =
        (ran.told.entries().into_iter().filter_map(pose).collect(), located(&ran));
    for (at, q) in &poses {
        if let Some((then, was)) = before.replace((*at, q.clone())) {
            for (exposed, located) in placed.iter().filter(|(exposed, _)| (then..*at).contains(exposed)) {
                for (m, x) in located.position.iter().enumerate() {
                    let (a, b) = (was[m].min(q[m]), was[m].max(q[m]));
                    assert!((a - 1e-9..=b + 1e-9).contains(x), "{exposed}: {x} is not between {a} and {b}");
                }
                compared += 1;
            }
        }
    }
    assert!(compared > 60 && compared + 2 >= placed.len(), "{compared} of {}", placed.len());
    let moved = |m: usize| placed.iter().map(|(_, l)| l.position[m]).fold(f64::NEG_INFINITY, f64::max);
    assert!(moved(0) > 3f64.to_radians(), "{}", moved(0));
}

#[test]
fn what_was_seen_before_the_history_begins_is_dropped_and_counted() {
    // the ring holds a few seconds, and frames come five seconds late
    let ran = run_with(eyes(Duration::from_secs(5)), Vec::new(), 100);
    let late = sighted(&ran).iter().filter(|(at, ..)| at.secs() > 4.0).count() as u64;
    let (sent, handled, dropped, _) = link(&ran, "eyes/left/detector>locator");
    assert!(late > 40 && dropped >= late, "{late} late ones, {dropped} of {sent} dropped");
    assert_eq!(located(&ran).len() as u64, handled);
}

fn swap(name: &'static str, takes: Duration, fresh: bool) -> Control {
    swap_after(Duration::ZERO, name, takes, fresh)
}

fn swap_after(shadow: Duration, name: &'static str, takes: Duration, fresh: bool) -> Control {
    let terms = SwapPolicy { shadow, probation: Duration::from_secs(2), ..SwapPolicy::default() };
    let maker: PartMaker<dyn Detector> =
        if name == "none" { Arc::new(|| Err("there is no such network".into())) } else { detector(name, takes) };
    let offer = BesideOffer { part: NewBeside::Detector { maker, fresh }, what: name.into(), terms };
    let (reply, _) = tokio::sync::oneshot::channel();
    Control::SwapBeside { name: "eyes/left".into(), offer, reply }
}

/// Keeps what was planted from the terminal.
fn silence_planted() {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        if info.payload().downcast_ref::<&str>() != Some(&"planted") {
            hook(info);
        }
    }));
}

/// The steps of all swaps of the detector, without their words.
fn steps(ran: &Ran) -> Vec<String> {
    steps_of(ran, ("eyes/left", SwapPart::Detector))
}

/// The steps of all swaps, which are all of this part, without their words.
fn steps_of(ran: &Ran, whose: (&str, SwapPart)) -> Vec<String> {
    let of = |(_, event): (Time, Arc<Event>)| match &*event {
        Event::SwapBeside { name, part, step } => {
            assert_eq!((name.as_str(), *part), whose);
            Some(match step {
                SwapStep::Offered { what, .. } => what.clone(),
                SwapStep::Refused { why } | SwapStep::Reverted { why } => format!("{step:?}: {why}"),
                step => format!("{step:?}"),
            })
        }
        _ => None,
    };
    ran.events().into_iter().filter_map(of).map(|step| step.split([' ', ':']).next().unwrap().to_owned()).collect()
}

#[test]
fn a_detector_is_exchanged_between_two_frames_and_knows_what_the_one_before_has_learned() {
    let swapped = || run(eyes(Duration::ZERO), vec![(3_000, swap("quick", TAKES / 2, false))]);
    let ran = swapped();
    assert_eq!(steps(&ran), ["quick", "TookOver", "Settled"], "{}", ran.lines());
    assert_eq!(lives(&ran), [""; 0]);
    let seen = sighted(&ran);
    let first = seen.iter().position(|(.., region)| region.object == "quick").expect("it looks");
    assert_eq!(seen[first].2.center[1], seen[first - 1].2.center[1] + 1.0, "it goes on from what is known");
    assert!(seen[first..].iter().all(|(.., region)| region.object == "quick") && first > 20 && seen.len() > 90);
    assert_eq!(ran.lines(), swapped().lines(), "equal seeds are exchanged alike");
}

#[test]
fn a_new_detector_looks_on_first_and_one_that_fails_at_that_is_refused() {
    let shadow = Duration::from_secs(2);
    let ran = run(eyes(Duration::ZERO), vec![(3_000, swap_after(shadow, "quick", TAKES, false))]);
    assert_eq!(steps(&ran), ["quick", "TookOver", "Settled"], "{}", ran.lines());
    let (seen, aside) = (sighted(&ran), seen_by(&ran, true));
    let first = seen.iter().find(|(.., region)| region.object == "quick").expect("it looks").0;
    assert!((5.0..5.5).contains(&first.secs()), "{first}");
    assert!(aside.len() > 10 && aside.iter().all(|(at, _, r)| r.object == "quick" && (3.0..5.5).contains(&at.secs())));
    // both see the same frames
    assert!(aside.iter().all(|(_, exposed, _)| seen.iter().any(|(_, e, _)| e == exposed)));
    let without = run(eyes(Duration::ZERO), Vec::new());
    let before = |ran: &Ran| sighted(ran).into_iter().filter(|(at, ..)| at.secs() < 5.0).collect::<Vec<_>>();
    assert_eq!(before(&ran), before(&without), "who looks on changes nothing");
    silence_planted();
    for (name, takes) in [("breaks", TAKES), ("dreams", Duration::from_secs(2))] {
        let ran = run(eyes(Duration::ZERO), vec![(3_000, swap_after(shadow, name, takes, false))]);
        assert_eq!(steps(&ran), [name, "Refused"], "{}", ran.lines());
        assert_eq!(lives(&ran), [""; 0], "{name}");
        assert!(sighted(&ran).iter().all(|(.., region)| region.object == "ball") && seen_by(&ran, true).is_empty());
    }
}

#[test]
fn a_detector_that_takes_no_state_or_shall_not_begins_anew() {
    for (name, fresh) in [("forgets", false), ("quick", true)] {
        let ran = run(eyes(Duration::ZERO), vec![(3_000, swap(name, TAKES, fresh))]);
        assert_eq!(steps(&ran), [name, "TookOver", "Settled"]);
        let first = sighted(&ran).into_iter().find(|(.., region)| region.object == name).expect("it looks");
        assert_eq!(first.2.center[1], 1.0, "{name}");
    }
}

#[test]
fn a_detector_that_fails_on_probation_is_reverted_and_one_that_is_none_refused() {
    silence_planted();
    let slow = Duration::from_secs(2);
    for (name, takes, last) in [("breaks", TAKES, "Reverted"), ("dreams", slow, "Reverted"), ("none", TAKES, "Refused")]
    {
        let ran = run(eyes(Duration::ZERO), vec![(3_000, swap(name, takes, false))]);
        let took_over: &[&str] = if last == "Reverted" { &["TookOver"] } else { &[] };
        assert_eq!(steps(&ran), [&[name], took_over, &[last]].concat(), "{name}\n{}", ran.lines());
        // the old one looks again, and knows what it knew
        let seen = sighted(&ran);
        let after: Vec<f64> = seen.iter().filter(|(at, ..)| at.secs() > 6.0).map(|(.., r)| r.center[1]).collect();
        assert!(seen.iter().all(|(.., region)| region.object == "ball"), "{name}");
        assert!(after.len() > 20 && after[0] > 40.0, "{name}: {after:?}");
    }
}

/// The locator of this name takes over after three seconds.
fn swap_locator(name: &'static str) -> Control {
    let terms = SwapPolicy { probation: Duration::from_secs(2), ..SwapPolicy::default() };
    let maker: PartMaker<dyn Locator> = match name {
        "none" => Arc::new(|| Err("there is no such head".into())),
        name => Arc::new(move || Ok(Box::new(Elsewhere { name, asked: 0 }))),
    };
    let offer = BesideOffer { part: NewBeside::Locator { maker, fresh: false }, what: name.into(), terms };
    let (reply, _) = tokio::sync::oneshot::channel();
    Control::SwapBeside { name: "eyes".into(), offer, reply }
}

/// Places everything at one place, or breaks at that.
struct Elsewhere {
    name: &'static str,
    asked: u32,
}

impl Locator for Elsewhere {
    fn locate(&mut self, seen: &[Sighting], _: &BodyState) -> Vec<Located> {
        self.asked += 1;
        assert!(self.name != "breaks", "planted");
        let place = |s: &Sighting| {
            let covariance = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            Located { object: s.region.object.clone(), position: [9.0, 0.0, f64::from(self.asked)], covariance }
        };
        seen.iter().map(place).collect()
    }
    fn takes(&self) -> Duration {
        if self.name == "dreams" { Duration::from_secs(2) } else { Duration::ZERO }
    }
}

#[test]
fn a_locator_is_exchanged_while_its_sensor_runs_and_one_that_fails_is_reverted() {
    silence_planted();
    let is_new = |(_, l): &(Time, Located)| l.position[0] == 9.0;
    let expected: [(&str, &[&str]); 4] = [
        ("quick", &["quick", "TookOver", "Settled"]),
        ("breaks", &["breaks", "TookOver", "Reverted"]),
        ("dreams", &["dreams", "TookOver", "Reverted"]),
        ("none", &["none", "Refused"]),
    ];
    for (name, expected) in expected {
        let ran = run(eyes(Duration::ZERO), vec![(3_000, swap_locator(name))]);
        assert_eq!(steps_of(&ran, ("eyes", SwapPart::Locator)), expected, "{}", ran.lines());
        let placed = located(&ran);
        let late = placed.iter().filter(|(at, _)| at.secs() > 6.0).collect::<Vec<_>>();
        assert!(late.len() > 20, "{name}: {}", late.len());
        assert!(
            placed.iter().all(|p| (name == "quick" && p.0.secs() > 3.5) == is_new(p) || p.0.secs() < 3.5),
            "{name}"
        );
    }
}
