//! Swaps of the agent at random instants under random faults: no motion because of one, no command lost (I6), the roadmap
//! handed over unchanged, and every sabotaged version reverted or never taken.
//!
//! `SWAPS=10000` sets how many swaps are tried.

use crate::common::{Ran, Trial, arm, ball};
use mobee_agents::{Explorer, ExplorerSettings};
use mobee_contract::*;
use mobee_model::{Edit, ObjectClass};
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{AgentMaker, Control, Reason};
use mobee_runtime::wiring::{Maker, SwapRequest};
use mobee_sim::Fault;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use std::sync::Arc;
use std::time::Duration;

/// What is wrong with a version.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Wrong {
    Nothing,
    PanicsWhenBuilt,
    IsNotBuilt,
    RefusesState,
    HasAnotherVersion,
    LosesTheMap,
    PanicsAtOnce,
    PanicsAfterTwo,
    PanicsInMidMotion,
    PanicsAtExport,
    IsTooSlow,
}
use Wrong::*;

/// Those that show at the first answer, if not before.
const ALL: [Wrong; 9] = [
    Nothing,
    PanicsWhenBuilt,
    IsNotBuilt,
    RefusesState,
    HasAnotherVersion,
    LosesTheMap,
    PanicsAtOnce,
    PanicsAtExport,
    IsTooSlow,
];

/// An explorer, sabotaged or not.
struct Version {
    explorer: Explorer,
    wrong: Wrong,
    asked: u32,
}

impl Agent for Version {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        self.asked += 1;
        assert!(self.wrong != PanicsAtOnce, "planted");
        assert!(self.wrong != PanicsAfterTwo || self.asked <= 2, "planted");
        self.explorer.next(last, view)
    }
    fn revise(&mut self, view: &View) -> Option<Intent> {
        assert!(self.wrong != PanicsInMidMotion, "planted");
        self.explorer.revise(view)
    }
    fn notes(&mut self) -> Vec<Note> {
        self.explorer.notes()
    }
    fn simulated_latency(&self) -> Duration {
        if self.wrong == IsTooSlow && self.asked > 0 { Duration::from_secs(3) } else { Duration::ZERO }
    }
    fn export(&self) -> Snapshot {
        assert!(self.wrong != PanicsAtExport || self.asked == 0, "planted");
        let mut state = self.explorer.export();
        if self.wrong == LosesTheMap {
            let edges = state.state["map"]["edges"].as_array_mut();
            edges.map(Vec::pop);
        }
        state
    }
    fn import(&mut self, mut from: Snapshot) -> Result<(), Refusal> {
        if self.wrong == RefusesState {
            return Err(Refusal::State { what: "planted".into() });
        }
        from.version += u32::from(self.wrong == HasAnotherVersion);
        self.explorer.import(from)
    }
}

fn version(wrong: Wrong, seed: u64) -> AgentMaker {
    let range = json!({ "pan": [-60, 60], "elbow": [-60, 60], "wrist": [-40, 40] });
    let settings = json!({ "motors": ["arm"], "vertices": 40, "neighbors": 6, "speed": 1.0, "range_deg": range });
    let settings: ExplorerSettings = serde_json::from_value(settings).unwrap();
    Arc::new(move || {
        assert!(wrong != PanicsWhenBuilt, "planted");
        if wrong == IsNotBuilt {
            return Err("planted".into());
        }
        let explorer = Explorer::new(settings.clone(), &Context { robot: arm(), seed }).map_err(|e| e.to_string())?;
        Ok(Box::new(Version { explorer, wrong, asked: 0 }))
    })
}

fn swap(wrong: Wrong, seed: u64, terms: SwapPolicy) -> Control {
    let offer = SwapRequest { maker: Maker(version(wrong, seed)), what: format!("{wrong:?}"), fresh: false, terms };
    let (reply, _) = tokio::sync::oneshot::channel();
    Control::SwapAgent { robot: "arm".into(), offer, reply }
}

const ACTORS: [&str; 6] = ["arm/driver", "arm/history", "arm/supervise", "arm/reflex", "arm/agent", "model"];

/// What became of the swaps of a run.
#[derive(Debug, Default)]
struct Tally {
    offered: u64,
    settled: u64,
    reverted: u64,
    refused: u64,
    gaps: Vec<f64>,
    rehearsed: u64,
}

impl Tally {
    /// Those that came to an end, whichever.
    fn swaps(&self) -> u64 {
        self.settled + self.reverted + self.refused
    }
}

fn one(seed: u64, tally: &mut Tally) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut controls = Vec::new();
    let mut at = Duration::from_millis(100);
    while at < Duration::from_secs(100) {
        at += Duration::from_millis(rng.random_range(100..1000));
        let control = match rng.random_range(0..100) {
            0..=1 => Control::Kill(ACTORS[rng.random_range(0..ACTORS.len())].into()),
            2..=5 => {
                let place = [rng.random_range(-0.6..0.6), rng.random_range(-0.6..0.6), rng.random_range(0.1..0.3)];
                Control::Edit(Edit::Add(ball(&format!("ball{}", controls.len()), place, ObjectClass::Obstacle)))
            }
            6..=9 => Control::Edit(Edit::Clear),
            10 => Control::Recover("arm".into()),
            _ => {
                let wrong = if rng.random_bool(0.4) { Nothing } else { ALL[rng.random_range(0..ALL.len())] };
                let terms = SwapPolicy {
                    shadow: Duration::from_millis([0, 0, 0, 1500][rng.random_range(0..4)]),
                    probation: Duration::from_millis([100, 300, 1500][rng.random_range(0..3)]),
                    ..SwapPolicy::default()
                };
                swap(wrong, rng.random_range(0..1000), terms)
            }
        };
        controls.push((at, control));
    }
    let trial = Trial {
        agent: Some(version(Nothing, seed)),
        objects: vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)],
        seed,
        controls,
        limit: Duration::from_secs(100),
        ..Trial::default()
    };
    let lost = (Time(rng.random_range(1..60_000_000_000)), rng.random_range(50..3000));
    let ran = trial.run_with(|faults| {
        faults.plan(Fault::Lost, lost.0, lost.0 + Duration::from_millis(lost.1));
    });
    judge(seed, &ran, tally);
}

fn judge(seed: u64, ran: &Ran, tally: &mut Tally) {
    assert_ne!(ran.end.reason, Reason::GaveUp, "seed {seed}\n{}", tail(ran));
    assert_eq!(ran.violations(), [], "seed {seed}\n{}", tail(ran));
    assert_eq!(ran.end.counts.commits, ran.end.counts.outcomes(), "seed {seed}\n{}", tail(ran));
    let mut offered = None;
    let mut map = None;
    for (_, event) in ran.events() {
        let Event::Swap { step, .. } = &*event else {
            tally.rehearsed += u64::from(matches!(&*event, Event::Shadow { .. }));
            continue;
        };
        match step {
            SwapStep::Offered { what, .. } => {
                assert_eq!(offered.replace(what.clone()), None, "seed {seed}\n{}", tail(ran));
                tally.offered += 1;
            }
            SwapStep::TookOver { gap, map: hash } => {
                assert!(hash.is_some(), "an explorer has a map");
                map.clone_from(hash);
                tally.gaps.push(*gap);
            }
            SwapStep::Settled => {
                assert_eq!(
                    offered.take().as_deref(),
                    Some("Nothing"),
                    "seed {seed}: it was not found out\n{}",
                    tail(ran)
                );
                tally.settled += 1;
            }
            SwapStep::Reverted { .. } => {
                assert!(offered.take().is_some(), "seed {seed}");
                tally.reverted += 1;
            }
            SwapStep::Refused { .. } => {
                offered.take();
                tally.refused += 1;
            }
        }
    }
}

fn tail(ran: &Ran) -> String {
    let lines = ran.lines();
    let lines: Vec<&str> = lines.lines().collect();
    lines[lines.len().saturating_sub(150)..].join("\n")
}

/// Panics are planted here by the hundred: only those of the test itself are worth reading.
fn be_quiet() {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let text = info.payload().downcast_ref::<&str>().copied().unwrap_or_default();
        if text != "planted" {
            hook(info);
        }
    }));
}

#[test]
fn swaps_at_random_instants_lose_nothing() {
    be_quiet();
    let wanted = std::env::var("SWAPS").ok().and_then(|n| n.parse().ok()).unwrap_or(1000);
    let mut tally = Tally::default();
    let mut seed = 0;
    while tally.swaps() < wanted {
        seed += 1;
        one(seed, &mut tally);
    }
    let swaps = tally.swaps();
    tally.gaps.sort_by(f64::total_cmp);
    let gap = |share: f64| tally.gaps[((tally.gaps.len() - 1) as f64 * share) as usize];
    eprintln!(
        "{swaps} swaps in {seed} runs: {} offered, {} took over, {} settled, {} reverted, {} refused, {} rehearsals; gap p50 {} s, p99 {} s",
        tally.offered,
        tally.gaps.len(),
        tally.settled,
        tally.reverted,
        tally.refused,
        tally.rehearsed,
        gap(0.5),
        gap(0.99)
    );
    assert!(gap(0.99) < 0.02);
    assert!(tally.settled > swaps / 50 && tally.reverted > swaps / 50 && tally.refused > swaps / 50);
}

#[test]
fn a_version_that_breaks_later_is_reverted_and_its_motion_taken_back() {
    be_quiet();
    let terms = SwapPolicy { probation: Duration::from_secs(60), ..SwapPolicy::default() };
    for wrong in [PanicsAfterTwo, PanicsInMidMotion] {
        let edit = |n: u32| Control::Edit(Edit::Add(ball(&format!("far{n}"), [9.0, 9.0, 9.0], ObjectClass::Obstacle)));
        let mut controls = vec![(Duration::from_millis(100), swap(wrong, 1, terms))];
        controls.extend((0..8).map(|n| (Duration::from_millis(3000 + 211 * u64::from(n)), edit(n))));
        let ran = Trial { agent: Some(version(Nothing, 1)), controls, ..Trial::default() }.run();
        let mut tally = Tally::default();
        judge(1, &ran, &mut tally);
        assert_eq!((tally.gaps.len(), tally.reverted), (1, 1), "{wrong:?}\n{}", tail(&ran));
        assert_eq!(ran.end.counts.restarts, 0, "nobody else notices\n{}", tail(&ran));
        let orphaned = ran.lines().contains("AgentDied");
        assert_eq!(orphaned, wrong == PanicsInMidMotion, "a motion that nobody plans is taken back\n{}", tail(&ran));
    }
}
