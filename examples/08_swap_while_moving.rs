//! Swap parts of a moving robot: an iCub explores while it gets another agent, a controller with other settings, and an agent that
//! panics. Every step is printed, with its simulated time; no swap moves the robot.
//!
//! `cargo run --release --example 08_swap_while_moving`

use mobee::compose::compose;
use mobee::config::Config;
use mobee_contract::{Agent, Event, Intent, MotionEnd, Refusal, Snapshot, SwapStep, Time, View};
use mobee_controller::ControllerSettings;
use mobee_journal::check::check_events;
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{Control, NewPart, PartOffer, Setup, run_under};
use mobee_runtime::tap::Taps;
use mobee_runtime::wiring::{Maker, SwapRequest};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A version with a bug: it imports the old agent's state, and panics at its first decision.
struct Broken(Snapshot);

impl Agent for Broken {
    fn next(&mut self, _last: Option<MotionEnd>, _view: &View) -> Intent {
        panic!("a bug")
    }
    fn export(&self) -> Snapshot {
        self.0.clone()
    }
    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.0 = from;
        Ok(())
    }
}

/// An agent, offered as a replacement for the running one.
fn agent(what: &str, maker: Maker, shadow: u64) -> Control {
    let terms = SwapPolicy { shadow: Duration::from_secs(shadow), ..SwapPolicy::default() };
    let (reply, _) = tokio::sync::oneshot::channel();
    let offer = SwapRequest { maker, what: what.into(), fresh: false, terms };
    Control::SwapAgent { robot: "icub".into(), offer, reply }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/behaviors/explore.toml");
    let composed = |set: &[&str]| {
        let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
        let (config, source) = Config::load(&file, &set)?;
        compose(config, &source)
    };
    let first = composed(&[])?;
    let mut faster = composed(&["robot.icub.agent.speed=0.3"])?;
    let faster = Maker(faster.robots.remove(0).agent.ok_or("explore.toml has an agent")?);
    let broken =
        Maker(Arc::new(|| Ok(Box::new(Broken(Snapshot { kind: String::new(), version: 0, state: ().into() })))));
    let controller = ControllerSettings { margin_m: 0.008, period_s: 0.01, ..first.robots[0].controller.clone() };
    let (reply, _) = tokio::sync::oneshot::channel();
    let offer = PartOffer {
        part: NewPart::Controller(Box::new(controller)),
        what: "one with a margin of 8 mm and a period of 10 ms".into(),
        terms: SwapPolicy::default(),
    };
    let at = |secs: u64| Time::ZERO + Duration::from_secs(secs);
    let controls = vec![
        (at(20), agent("an explorer that is three times as fast", faster, 10)),
        (at(60), Control::SwapPart { robot: "icub".into(), offer, reply }),
        (at(90), agent("an explorer with a bug", broken, 0)),
    ];

    let (taps, told) = Taps::collect();
    let setup = Setup::in_virtual_time(first.scene, first.robots, 1, taps.clone());
    let (_keep, stop) = tokio::sync::mpsc::channel(1);
    let end = run_under(setup, controls, stop, Some(Duration::from_secs(120)), |_| ())?;
    taps.finish(end.ended_at, Event::Ended { reason: end.reason.to_string() });

    let mut motions = 0;
    let mut steps = Vec::new();
    for (at, event) in told.events() {
        match &*event {
            Event::Outcome { .. } => motions += 1,
            Event::Swap { part, step, .. } => {
                println!("{:7.3} s, after {motions:3} motions: {part}: {step}", at.secs());
                steps.push(step.clone());
            }
            _ => {}
        }
    }
    println!("{:7.3} s, after {motions:3} motions: the end", end.ended_at.secs());
    let violations = check_events(told.events());
    println!("{} broken invariants, {} restarts", violations.len(), end.counts.restarts);
    assert!(violations.is_empty(), "{violations:?}");
    assert_eq!(steps.iter().filter(|s| **s == SwapStep::Settled).count(), 2);
    assert!(matches!(steps.last(), Some(SwapStep::Refused { .. } | SwapStep::Reverted { .. })));
    Ok(())
}
