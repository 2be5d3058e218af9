//! Stall detection: number of false stops of free robots, and time until a held robot is stopped.
//!
//! *False stops*: an iCub explores, or moves torso and right arm at random, without unknown obstacles; its simulated
//! boards differ in profile, latency and encoder noise.
//!
//! *Blocks*: in the same random motions an unmodeled obstacle holds one motor after another, each for ten seconds
//! starting at some time of a motion. Reported: the time during which the board commands a motor beyond the obstacle
//! until the filter closes, and by how much at that time. If the commanded excess is below the threshold, there is no
//! stall: the motor is near its target, which it misses. *Late*: stalls within three seconds after the release.
//!
//! `cargo bench --bench stall -- [seeds] [seconds per run of false stops] [runs with five blocks each]` (default 10,
//! 600 and 60)

use mobee::compose::read;
use mobee_contract::{Cause, Context, Entry, Event, Outcome, Sink, Time};
use mobee_runtime::system::{Setup, run};
use mobee_runtime::tap::Taps;
use mobee_sim::{Fault, SimHardware, SimSettings};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Stall threshold, degrees.
const STALL_DEG: f64 = 0.5;
/// Number of blocks per run, their period and their duration, seconds.
const BLOCKS: (u32, f64, f64) = (5, 18.0, 10.0);
/// Time after the release of a motor during which a stall counts as late, seconds.
const LATE_S: f64 = 3.0;

/// Counts of one or several runs.
#[derive(Default)]
struct Tally {
    motions: u32,
    contacts: u32,
    false_stops: u32,
    late: u32,
    blocks: u32,
    rolled_back: u32,
    stalls: u32,
    missed: u32,
    others: u32,
    /// Time from the block to the closed filter, seconds.
    seconds: Vec<f64>,
    /// Commanded position beyond the obstacle at that time, degrees.
    ahead: Vec<f64>,
    /// Maximum commanded position of any motor beyond an obstacle, degrees.
    farthest: f64,
    shown: Vec<String>,
}

/// Tap that classifies and counts stops.
struct Witness {
    board: SimHardware,
    /// Time since which a motor has pushed against an obstacle in this motion.
    began: Option<Time>,
    /// Start times of the blocks that a motor pushed against.
    begun: BTreeSet<Time>,
    /// Time of the last push.
    pushed: Time,
    /// True if a stall closed the filter during the open motion.
    stalled: bool,
    tally: Tally,
}

impl Sink for Witness {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        let pushed = self.board.held(at).into_iter().flatten().filter(|(_, ahead)| *ahead > 0.0);
        let pushed = pushed.max_by(|a, b| a.1.total_cmp(&b.1));
        self.began = pushed.and(self.began.or(Some(at)));
        if let Some((since, ahead)) = pushed {
            self.tally.blocks += u32::from(self.begun.insert(since));
            self.pushed = at;
            self.tally.farthest = self.tally.farthest.max(ahead.to_degrees());
        }
        let Entry::Event(event) = entry else { return Ok(()) };
        match &**event {
            Event::Commit { .. } => self.tally.motions += 1,
            Event::Outcome { outcome, .. } => {
                self.tally.rolled_back +=
                    u32::from(std::mem::take(&mut self.stalled) && *outcome == Outcome::RolledBack);
            }
            Event::Disabled { cause, .. } => {
                self.stalled = matches!(cause, Cause::Stall { .. });
                match (cause, pushed) {
                    (Cause::Stall { .. }, Some((since, ahead))) => {
                        self.tally.stalls += 1;
                        let began = self.began.unwrap_or(since);
                        self.tally.seconds.push(at.since(began).as_secs_f64());
                        self.tally.ahead.push(ahead.to_degrees());
                    }
                    (Cause::Stall { .. }, None)
                        if at.since(self.pushed).as_secs_f64() < LATE_S && self.pushed > Time::ZERO =>
                    {
                        self.tally.late += 1;
                    }
                    (Cause::Stall { .. }, None) => {
                        self.tally.false_stops += 1;
                        let held = self.board.held(at);
                        let pushed = self.pushed;
                        let held: Vec<_> = held.iter().enumerate().filter(|(_, h)| h.is_some()).collect();
                        self.tally.shown.push(format!("{at}: {cause:?}, pushed last at {pushed}, held {held:?}"));
                    }
                    (Cause::TargetMissed, _) => self.tally.missed += 1,
                    (Cause::Contact(_) | Cause::Constraint { .. }, _) => self.tally.contacts += 1,
                    _ => self.tally.others += 1,
                }
            }
            _ => {}
        }
        Ok(())
    }
    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

/// Runs a behavior with these boards, with or without blocks, and adds to `sum`.
fn run_seed(
    file: &Path,
    set: &[String],
    seed: u64,
    settings: &SimSettings,
    secs: f64,
    blocks: Option<f64>,
    sum: &mut Tally,
) {
    let composed = read(file, set).unwrap_or_else(|_| panic!("{} composes", file.display()));
    let robot = composed.scene.robots()[0].clone();
    let moving = |name: &str| name.starts_with("torso") || name.starts_with("r_");
    let motors: Vec<usize> = (0..robot.motors.len()).filter(|m| moving(&robot.motors[*m].name)).collect();
    let board = SimHardware::new(settings, &Context { robot, seed }).expect("boards");
    if let Some(first) = blocks {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for k in 0..BLOCKS.0 {
            let motor = motors[rng.random_range(0..motors.len())];
            let after = Duration::from_secs_f64(rng.random_range(0.02..1.5));
            let from = first + BLOCKS.1 * f64::from(k);
            board.faults().plan(
                Fault::Blocked { motor, after },
                Time::from_secs(from),
                Time::from_secs(from + BLOCKS.2),
            );
        }
    }
    let mut robots = composed.robots;
    robots[0].hardware = Arc::new(board.clone());
    let witness = Arc::new(Mutex::new(Witness {
        board,
        began: None,
        begun: BTreeSet::new(),
        pushed: Time::ZERO,
        stalled: false,
        tally: std::mem::take(sum),
    }));
    let taps = Taps::in_place(witness.clone());
    let setup = Setup { script: composed.script, ..Setup::in_virtual_time(composed.scene, robots, seed, taps) };
    let (_controls, receiver) = tokio::sync::mpsc::channel(1);
    run(setup, receiver, Some(Duration::from_secs_f64(secs)), |_| ()).expect("it runs");
    *sum = std::mem::take(&mut witness.lock().expect("no panic").tally);
}

/// The quantile of a set of values.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get((share * values.len().saturating_sub(1) as f64).round() as usize).copied().unwrap_or(f64::NAN)
}

fn main() {
    // Skips `--bench`, which cargo passes.
    let numbers: Vec<f64> = std::env::args().skip(1).filter_map(|a| a.parse().ok()).collect();
    let seeds = numbers.first().copied().unwrap_or(10.0) as u64;
    let secs = numbers.get(1).copied().unwrap_or(600.0);
    let runs = numbers.get(2).copied().unwrap_or(60.0) as u64;
    let dir = tempfile::tempdir().expect("a folder");
    let random = dir.path().join("random.toml");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/robots/icub.xml");
    let behavior = format!(
        "[[robot]]\nname = \"icub\"\nmodel = {:?}\ncontroller = {{ period_ms = 20, history = 6000, reserve_mm = 0 }}\ndriver = {{ kind = \"sim\", profile = \"ideal\" }}\n\
         agent = {{ kind = \"random\", motors = [\"torso\", \"right_arm\"], count = 0, checked = true }}\n",
        model.display().to_string()
    );
    std::fs::write(&random, behavior).expect("a file");
    let explore = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore.toml");
    let set = |seed: u64, speed: f64, deg: f64| {
        let of = |what: &str| format!("robot.icub.{what}");
        let controller =
            [of(&format!("controller.stall_deg={deg}")), of(&format!("controller.tolerance_deg={}", 0.2 * deg))];
        [vec![format!("seed={seed}"), of(&format!("agent.speed={speed}"))], controller.to_vec()].concat()
    };
    let usual = SimSettings::ideal();
    let text =
        |s: &str| serde_json::from_value::<SimSettings>(serde_json::from_str(s).expect("JSON")).expect("settings");
    let boards = [
        ("as usual", STALL_DEG, usual.clone()),
        (
            "three times the noise, 60 ms late, a reading each 20 ms",
            STALL_DEG,
            text(r#"{"profile":"ideal","noise_deg":0.015,"resolution_deg":0.03,"latency_ms":60,"rate_hz":50}"#),
        ),
        ("constant acceleration", STALL_DEG, text(r#"{"profile":"ideal","move_profile":"trapezoidal"}"#)),
        // Its moves end within a degree.
        ("as iCub_SIM", 10.0 * STALL_DEG, text(r#"{"imitates":"iCub_SIM"}"#)),
    ];
    println!("false stops: {seeds} seeds, {secs} s each");
    println!("| boards | behavior | speed | motions | contacts | missed | false stops |");
    println!("|---|---|---|---|---|---|---|");
    for (name, deg, settings) in &boards {
        for (what, file, speed) in
            [("explores", &explore, 0.1), ("random", &random, 0.1), ("random", &random, 0.5), ("random", &random, 1.0)]
        {
            let mut sum = Tally::default();
            (1..=seeds).for_each(|seed| run_seed(file, &set(seed, speed, *deg), seed, settings, secs, None, &mut sum));
            let Tally { motions, contacts, missed, false_stops, .. } = sum;
            println!(
                "| {name} | {what} | {:.0} % | {motions} | {contacts} | {missed} | {false_stops} |",
                speed * 100.0
            );
            sum.shown.iter().take(3).for_each(|what| println!("  {what}"));
        }
    }
    println!("blocks: {runs} runs of {} blocks", BLOCKS.0);
    println!(
        "| speed | blocks | stalls | rolled back | missed | late | false | s: median | 95 % | most | deg ahead: median | 95 % | most | farthest |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for (speed, first) in [(0.1, 90.0), (0.5, 30.0), (1.0, 20.0)] {
        let mut sum = Tally::default();
        let duration = first + BLOCKS.1 * f64::from(BLOCKS.0);
        (1..=runs).for_each(|seed| {
            run_seed(&random, &set(seed, speed, STALL_DEG), seed, &usual, duration, Some(first), &mut sum)
        });
        let Tally {
            mut seconds,
            mut ahead,
            stalls,
            rolled_back,
            missed,
            late,
            blocks,
            false_stops,
            farthest,
            shown,
            ..
        } = sum;
        let s = [0.5, 0.95, 1.0].map(|share| format!("{:.2}", quantile(&mut seconds, share))).join(" | ");
        let deg = [0.5, 0.95, 1.0].map(|share| format!("{:.1}", quantile(&mut ahead, share))).join(" | ");
        println!(
            "| {:.0} % | {blocks} | {stalls} | {rolled_back} | {missed} | {late} | {false_stops} | {s} | {deg} | {farthest:.1} |",
            speed * 100.0
        );
        shown.iter().take(3).for_each(|what| println!("  {what}"));
    }
}
