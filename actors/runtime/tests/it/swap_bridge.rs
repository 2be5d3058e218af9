//! Swaps of a bridge while it moves a robot: its motions are taken back first, its life ends before the next one begins, and what fails is
//! reverted.

use crate::common::{Ran, Trial};
use mobee_contract::*;
use mobee_runtime::swap::SwapPolicy;
use mobee_runtime::system::{BesideOffer, Control, NewBeside, named_apart};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// What a bridge does once it is served.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Does {
    Moves,
    Panics,
    CanNotBeServed,
    EndsInOrder,
    NeedsTheWall,
}

/// Moves the elbow to and fro under its own name, through a port that only one can have.
struct Hand {
    name: &'static str,
    does: Does,
    port: Arc<AtomicBool>,
}

impl Service for Hand {
    fn name(&self) -> String {
        self.name.into()
    }
    fn runs_in_virtual_time(&self) -> bool {
        self.does != Does::NeedsTheWall
    }
    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            if self.does == Does::CanNotBeServed || self.port.swap(true, Ordering::SeqCst) {
                return Err(format!("the port of {} is taken", self.name));
            }
            let port = Port(self.port.clone());
            tokio::select! {
                biased;
                () = until => {}
                () = self.moves(&running) => {}
            }
            drop(port);
            Ok(())
        })
    }
}

struct Port(Arc<AtomicBool>);

impl Drop for Port {
    fn drop(&mut self) {
        self.0.store(false, Ordering::SeqCst);
    }
}

impl Hand {
    async fn moves(&self, running: &Arc<dyn Running>) {
        let robot = running.robots()[0].clone();
        robot.let_agent_act(false).unwrap();
        let mut deg: f64 = 20.0;
        for k in 0.. {
            running.sleep_until(running.now() + Duration::from_millis(50)).await;
            match self.does {
                Does::Panics if k == 20 => std::panic::resume_unwind(Box::new("planted")),
                Does::EndsInOrder if k == 20 => return,
                _ => {}
            }
            let target = Target { motors: vec![1], q: vec![deg.to_radians()], speed: 0.1 };
            let commit = Commit { agent: self.name.into(), target, speeds: None };
            if robot.latest().ready && robot.commit(commit).await.is_ok() {
                deg = -deg;
            }
        }
    }
}

fn run(swaps: impl Fn(&Arc<AtomicBool>) -> Vec<(u64, Control)>) -> Ran {
    let port = Arc::new(AtomicBool::new(false));
    let controls = swaps(&port).into_iter().map(|(ms, control)| (Duration::from_millis(ms), control)).collect();
    let old: Arc<dyn Service> = Arc::new(Hand { name: "hand", does: Does::Moves, port });
    let ran = Trial { controls, limit: Duration::from_secs(30), ..Trial::default() }.run_all(|_| (), |_| vec![old]);
    assert_eq!(ran.violations(), vec![], "{}", ran.lines());
    ran
}

fn swap(name: &'static str, does: Does, port: &Arc<AtomicBool>) -> Control {
    let terms = SwapPolicy { probation: Duration::from_secs(3), ..SwapPolicy::default() };
    let part = NewBeside::Bridge(Arc::new(Hand { name, does, port: port.clone() }));
    let (reply, _) = tokio::sync::oneshot::channel();
    Control::SwapBeside { name: "hand".into(), offer: BesideOffer { part, what: name.into(), terms }, reply }
}

/// What became of swaps, and who died of whom.
fn told(ran: &Ran) -> Vec<String> {
    let of = |(_, event): (Time, Arc<Event>)| match &*event {
        Event::SwapBeside { name, part: SwapPart::Bridge, step } => {
            assert_eq!(name, "hand");
            Some(match step {
                SwapStep::Offered { what, .. } => format!("{what} is offered"),
                SwapStep::TookOver { .. } => "took over".into(),
                SwapStep::Refused { why } => format!("refused: {why}"),
                SwapStep::Reverted { why } => format!("reverted: {why}"),
                SwapStep::Settled => "settled".into(),
            })
        }
        Event::Died { actor, .. } => Some(format!("{actor} died")),
        Event::Restarted { actor, .. } => Some(format!("{actor} is back")),
        Event::Warning { text } => Some(text.clone()),
        _ => None,
    };
    ran.events().into_iter().filter_map(of).collect()
}

/// Who commits, without repetitions.
fn hands(ran: &Ran) -> Vec<String> {
    let of = |(_, event): (Time, Arc<Event>)| match &*event {
        Event::Commit { agent, .. } if agent != "arm/agent" => Some(agent.clone()),
        _ => None,
    };
    let mut all: Vec<String> = ran.events().into_iter().filter_map(of).collect();
    all.dedup();
    all
}

#[test]
fn a_bridge_takes_over_after_the_motions_of_the_one_before_are_taken_back() {
    let swapped = || run(|port| vec![(5_010, swap("other", Does::Moves, port))]);
    let ran = swapped();
    assert_eq!(told(&ran), ["other is offered", "took over", "settled"], "{}", ran.lines());
    assert_eq!(hands(&ran), ["hand", "other"]);
    // what the old one had under way when it was exchanged goes back, and the new one begins after that
    let (mut open, mut orphan, mut back) = (None, None, false);
    for (_, event) in ran.events() {
        match &*event {
            Event::Commit { id, agent, .. } => {
                assert!(agent != "other" || back, "{}", ran.lines());
                open = Some(*id);
            }
            Event::SwapBeside { step: SwapStep::TookOver { .. }, .. } => orphan = open,
            Event::Outcome { id, outcome, cause, .. } => {
                if orphan == Some(*id) {
                    assert_eq!((*outcome, cause), (Outcome::RolledBack, &Some(Cause::AgentDied)));
                    back = true;
                }
                open = None;
            }
            _ => {}
        }
    }
    assert!(back, "nothing was under way\n{}", ran.lines());
    assert_eq!(ran.lines(), swapped().lines(), "equal seeds are exchanged alike");
}

#[test]
fn a_bridge_that_fails_on_probation_is_reverted() {
    for does in [Does::Panics, Does::CanNotBeServed] {
        let ran = run(|port| vec![(5_010, swap("other", does, port))]);
        let why = if does == Does::Panics { "it panicked" } else { "the port of other is taken" };
        let life = ["hand/service died", "hand/service is back"];
        let expected = ["other is offered", "took over", &format!("reverted: {why}"), life[0], life[1]];
        assert_eq!(told(&ran), expected, "{does:?}\n{}", ran.lines());
        // the old one moves again, whatever the new one did
        assert_eq!(hands(&ran).last().map(String::as_str), Some("hand"), "{does:?}");
        let after =
            ran.events().iter().filter(|(at, e)| at.secs() > 12.0 && matches!(&**e, Event::Commit { .. })).count();
        assert!(after > 1, "{does:?}: {after}");
    }
}

#[test]
fn a_bridge_is_killed_on_probation_and_the_one_before_is_back() {
    let ran =
        run(|port| vec![(5_010, swap("other", Does::Moves, port)), (6_500, Control::Kill("hand/service".into()))]);
    assert!(told(&ran).contains(&"reverted: killed".to_owned()), "{}", ran.lines());
    assert_eq!(hands(&ran), ["hand", "other", "hand"]);
}

#[test]
fn swaps_come_one_after_the_other_and_what_does_not_fit_changes_nothing() {
    let ran = run(|port| {
        vec![
            (5_010, swap("wall", Does::NeedsTheWall, port)),
            (6_000, swap("other", Does::Moves, port)),
            (7_000, swap("third", Does::Moves, port)),
            (12_000, swap("done", Does::EndsInOrder, port)),
            (20_000, swap("last", Does::Moves, port)),
        ]
    });
    let each = |who: &str| [format!("{who} is offered"), "took over".into(), "settled".into()];
    // one that has no more to do is trusted, and another can take its place
    assert_eq!(told(&ran), [each("other"), each("done"), each("last")].concat(), "{}", ran.lines());
    assert_eq!(hands(&ran).last().map(String::as_str), Some("last"));
}

#[test]
fn services_of_one_name_are_told_apart() {
    let own = ["yarp", "hand", "yarp", "yarp-2", "yarp"].map(str::to_owned);
    assert_eq!(named_apart(own), ["yarp", "hand", "yarp-2", "yarp-2-2", "yarp-3"]);
}
