//! Contacts at several speeds: the reflex of Algorithm 6, which reacts to near objects, compared with the reflex that
//! looks ahead.
//!
//! An iCub moves torso and right arm at random to free configurations; balls appear around it at random. A separate
//! witness counts, from the measured configurations and the motion between them:
//!
//! * *hard*: a pair reaches a distance of zero or less although this was physically avoidable;
//! * *unavoidable*: the same with a ball that appeared on the robot (within the margin at the first two samples), or on
//!   the path to the configuration in which the robot would have come to rest if it had been stopped at the second
//!   sample after the ball appeared (the first sample shows the ball; then the board's latency and maximum braking), or
//!   that is touched while the robot brakes due to a stop commanded at one of these two samples: no controller can stop
//!   earlier. This applies to a ball for two seconds, or until it is [`APART_M`] away;
//! * *pressed*: the same during an escape, which starts within the margin of such a ball;
//! * *false*: the reflex stopped a motion, and the straight line from there to its target stays outside the margin.
//!
//! `cargo bench --bench look_ahead -- [runs per speed] [seconds per run] [first seed] [clearance, mm]` (default 100,
//! 60, 1, and the clearance that the controller derives)

#![allow(clippy::disallowed_methods)] // measures processor time

use mobee::compose::read;
use mobee_contract::{Axis, Cause, Entry, Event, Outcome, Pose, Sink, Status, Time};
use mobee_model::{Contact, Pair, Scene, ShapeId, Sweep};
use mobee_runtime::system::{Setup, run};
use mobee_runtime::tap::Taps;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Margin of the reflex, meters.
const MARGIN_M: f64 = 0.010;
/// Distance at which a contact has ended, as for the reflex, meters: encoders are noisy, so a slow separation passes zero
/// several times.
const APART_M: f64 = 0.002;
/// Number of balls.
const BALLS: usize = 3;

/// Writes a behavior and its world to a folder.
fn write_files(dir: &Path, seed: u64, speed: f64, reserve: &str, secs: f64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut world = String::from("<WorldList version=\"1.0\">\n");
    let mut script = String::new();
    for k in 0..BALLS {
        let _ =
            writeln!(world, "<object name=\"ball{k}\" type=\"obstacle\" pz=\"-5\"><sphere radius=\"0.04\"/></object>");
        // Each ball appears at a new position every few seconds.
        let mut at = 1.0 + rng.random_range(0.0..4.0);
        while at < secs {
            let [x, y, z]: [f64; 3] =
                [rng.random_range(-0.6..-0.2), rng.random_range(-0.2..0.6), rng.random_range(-0.25..0.35)];
            let _ = writeln!(
                script,
                "[[script]]\nwhen.at_s = {at:.3}\nedit = {{ object = \"ball{k}\", position_m = [{x:.3}, {y:.3}, {z:.3}] }}"
            );
            at += rng.random_range(2.0..8.0);
        }
    }
    world.push_str("</WorldList>\n");
    let robots = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/icub.xml");
    let behavior = format!(
        "seed = {seed}\nworld.file = \"world.xml\"\n[[robot]]\nname = \"icub\"\nmodel = {:?}\n\
         controller = {{ period_ms = 20, history = 6000{reserve} }}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n\
         agent = {{ kind = \"random\", motors = [\"torso\", \"right_arm\"], count = 0, speed = {speed}, checked = true }}\n{script}",
        robots.display().to_string()
    );
    std::fs::write(dir.join("world.xml"), world).expect("a file");
    std::fs::write(dir.join("behavior.toml"), behavior).expect("a file");
}

/// Counts of one or several runs.
#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    motions: u32,
    stops: u32,
    foreseen: u32,
    false_stops: u32,
    hard: u32,
    unavoidable: u32,
    pressed: u32,
    escapes: u32,
    faulted: u32,
}

/// Tap that classifies and counts contacts and stops.
struct Witness {
    axes: Vec<Axis>,
    latency: f64,
    scene: Option<Arc<Scene>>,
    sweep: Option<Sweep>,
    samples: Vec<(Time, Pose)>,
    /// Number of samples since the last edit of the world.
    since_edit: u32,
    /// Ids of the balls that this edit moved: only their contacts can be unavoidable.
    appeared: BTreeSet<u32>,
    /// True if the filter was closed at one of the first two samples since, and the robot is not at rest yet.
    at_once: bool,
    target: Option<Pose>,
    escaping: bool,
    status: Option<Status>,
    /// Pairs in contact, until they are apart again.
    touching: BTreeSet<Pair>,
    /// Pairs with an unavoidable contact, until they are apart again.
    excused: BTreeSet<Pair>,
    tally: Tally,
    /// Descriptions of the hard contacts.
    shown: Vec<String>,
}

/// True if a shape of the pair belongs to a ball that appeared.
fn involves(appeared: &BTreeSet<u32>, pair: &Pair) -> bool {
    [pair.0, pair.1].iter().any(|shape| matches!(shape, ShapeId::Object { object, .. } if appeared.contains(object)))
}

impl Witness {
    fn distances(scene: &Scene, q: &Pose, within: f64) -> BTreeMap<Pair, f64> {
        scene.contacts(std::slice::from_ref(q), within).iter().map(|c| (c.pair, c.distance)).collect()
    }

    /// The pairs within a distance on the straight line between two configurations.
    fn on_line(scene: &Scene, from: &Pose, to: &Pose, within: f64) -> BTreeSet<Pair> {
        let parts = (scene.travel(0, from, to) / 0.003).ceil().max(1.0);
        let at =
            |k: usize| -> Pose { from.iter().zip(to.iter()).map(|(a, b)| a + (b - a) * k as f64 / parts).collect() };
        (0..=parts as usize).flat_map(|k| Self::distances(scene, &at(k), within).into_keys()).collect()
    }

    /// The configuration in which the robot would come to rest at best.
    fn rest(&self) -> Option<Pose> {
        let [.., (t0, a), (t1, b)] = self.samples.as_slice() else { return None };
        let dt = t1.since(*t0).as_secs_f64();
        let stop = |((a, b), axis): ((&f64, &f64), &Axis)| {
            let v = (b - a) / dt;
            b + v * (self.latency + dt) + v * v.abs() / (2.0 * axis.max_acceleration)
        };
        Some(a.iter().zip(b.iter()).zip(&self.axes).map(stop).collect())
    }

    fn pose(&mut self, at: Time, q: &Pose) {
        let Some(scene) = self.scene.clone() else { return };
        self.samples.push((at, q.clone()));
        if self.samples.len() > 4 {
            self.samples.remove(0);
        }
        self.since_edit += 1;
        if self.since_edit <= 2 {
            // Contacts that no controller can avoid any more.
            let rest = self.rest().unwrap_or_else(|| q.clone());
            let new = |pair: &Pair| involves(&self.appeared, pair);
            self.excused.extend(Self::on_line(&scene, q, &rest, 0.0).into_iter().filter(new));
            self.excused.extend(Self::distances(&scene, q, MARGIN_M).into_keys().filter(new));
        }
        let Some(sweep) = &mut self.sweep else { return };
        let touches = |c: &&Contact| c.distance <= if self.touching.contains(&c.pair) { APART_M } else { 0.0 };
        let now: BTreeSet<Pair> = sweep.to(std::slice::from_ref(q)).iter().filter(touches).map(|c| c.pair).collect();
        for pair in now.difference(&self.touching) {
            match (self.escaping, self.excused.contains(pair) || self.at_once && involves(&self.appeared, pair)) {
                (true, _) => self.tally.pressed += 1,
                (false, true) => self.tally.unavoidable += 1,
                (false, false) => {
                    self.tally.hard += 1;
                    let a = scene.shape_name(pair.0);
                    let b = scene.shape_name(pair.1);
                    self.shown.push(format!("{a} and {b} at {at} while {:?}", self.status));
                }
            }
        }
        if self.since_edit > 200 {
            self.excused.retain(|pair| now.contains(pair));
        }
        self.touching = now;
    }

    fn event(&mut self, event: &Event) {
        match event {
            Event::Commit { target, escape, .. } => {
                self.target = Some(target.clone());
                self.escaping = *escape;
                self.tally.motions += 1;
                self.tally.escapes += u32::from(*escape);
            }
            Event::State { status, .. } => {
                self.status = Some(*status);
                self.at_once &= *status == Status::Stopping;
            }
            Event::Outcome { outcome, .. } => {
                self.escaping = false;
                self.tally.faulted += u32::from(*outcome == Outcome::Faulted);
            }
            Event::Disabled { cause: cause @ (Cause::Contact(_) | Cause::Foreseen(_)), .. } if !self.escaping => {
                // The event precedes the entry of the sample that caused it.
                self.at_once = self.since_edit < 2;
                let (Some(target), Some(scene), Some((_, q))) = (self.target.take(), &self.scene, self.samples.last())
                else {
                    return;
                };
                self.tally.stops += 1;
                if matches!(cause, Cause::Foreseen(_)) {
                    self.tally.foreseen += 1;
                    self.tally.false_stops += u32::from(Self::on_line(scene, q, &target, MARGIN_M).is_empty());
                }
            }
            _ => {}
        }
    }
}

impl Sink for Witness {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        match entry {
            Entry::Pose { q, .. } => self.pose(at, q),
            Entry::Event(event) => self.event(event),
            Entry::Scene(scene) => {
                self.sweep = Some(Sweep::of_all(scene.clone(), 0.002, 0.001));
                let before = self.scene.replace(scene.clone());
                let is_new =
                    |id: u32, pose| before.as_ref().is_none_or(|b| b.objects().all(|(i, o)| i != id || o.pose != pose));
                let moved = scene.objects().filter(|(id, o)| is_new(*id, o.pose)).map(|(id, _)| id);
                // Two edits within two samples count as one.
                let recent = std::mem::take(&mut self.appeared).into_iter().filter(|_| self.since_edit < 2);
                self.appeared = moved.chain(recent).collect();
                self.since_edit = 0;
                self.at_once = false;
            }
            Entry::Picture { .. } => {}
        }
        Ok(())
    }
    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

/// Runs one seed, and returns its counts and the descriptions of its hard contacts.
fn run_seed(seed: u64, speed: f64, reserve: &str, secs: f64) -> (Tally, Vec<String>) {
    let dir = tempfile::tempdir().expect("a folder");
    write_files(dir.path(), seed, speed, reserve, secs);
    let composed = read(&dir.path().join("behavior.toml"), &[]).unwrap_or_else(|_| panic!("seed {seed} composes"));
    let board = composed.robots[0].hardware.connect().expect("simulated").board().clone();
    let witness = Arc::new(Mutex::new(Witness {
        axes: board.axes.clone(),
        latency: board.latency.as_secs_f64(),
        scene: None,
        sweep: None,
        samples: Vec::new(),
        since_edit: 0,
        appeared: BTreeSet::new(),
        at_once: false,
        target: None,
        escaping: false,
        status: None,
        touching: BTreeSet::new(),
        excused: BTreeSet::new(),
        tally: Tally::default(),
        shown: Vec::new(),
    }));
    let taps = Taps::in_place(witness.clone());
    let setup =
        Setup { script: composed.script, ..Setup::in_virtual_time(composed.scene, composed.robots, seed, taps) };
    let (_controls, receiver) = tokio::sync::mpsc::channel(1);
    run(setup, receiver, Some(Duration::from_secs_f64(secs)), |_| ()).expect("it runs");
    let mut witness = witness.lock().expect("no panic");
    (witness.tally, std::mem::take(&mut witness.shown))
}

fn main() {
    // Skips `--bench`, which cargo passes.
    let numbers: Vec<f64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let runs = numbers.first().copied().unwrap_or(100.0) as u64;
    let secs = numbers.get(1).copied().unwrap_or(60.0);
    let first = numbers.get(2).copied().unwrap_or(1.0) as u64;
    println!("{runs} runs of {secs} s, seeds from {first}, {BALLS} balls that appear every few seconds");
    println!(
        "| speed | reflex | motions | stops | of these foreseen | false | hard | unavoidable | pressed | escapes | faulted | real-time factor |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|");
    for speed in [0.1, 0.5, 1.0] {
        let ahead = match numbers.get(3) {
            Some(mm) => (format!("looks ahead, {mm} mm"), format!(", reserve_mm = {mm}")),
            None => ("looks ahead".to_owned(), String::new()),
        };
        let by_margin = ("Algorithm 6".to_owned(), ", reserve_mm = 0".to_owned());
        for (looks_ahead, (name, reserve)) in [(false, by_margin), (true, ahead)] {
            let began = Instant::now();
            let mut sum = Tally::default();
            for seed in first..first + runs {
                let (t, shown) = run_seed(seed, speed, &reserve, secs);
                if looks_ahead {
                    shown.iter().for_each(|what| println!("  seed {seed}: {what}"));
                }
                sum.motions += t.motions;
                sum.stops += t.stops;
                sum.foreseen += t.foreseen;
                sum.false_stops += t.false_stops;
                sum.hard += t.hard;
                sum.unavoidable += t.unavoidable;
                sum.pressed += t.pressed;
                sum.escapes += t.escapes;
                sum.faulted += t.faulted;
            }
            let factor = runs as f64 * secs / began.elapsed().as_secs_f64();
            println!(
                "| {:.0} % | {name} | {} | {} | {} | {} | {} | {} | {} | {} | {} | {factor:.0} |",
                speed * 100.0,
                sum.motions,
                sum.stops,
                sum.foreseen,
                sum.false_stops,
                sum.hard,
                sum.unavoidable,
                sum.pressed,
                sum.escapes,
                sum.faulted
            );
        }
    }
}
