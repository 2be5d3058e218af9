//! Services are supervised: each dies alone, is served anew, leaves nothing moving, and holds up no pulse.

use crate::common::{Ran, Trial};
use mobee_contract::*;
use mobee_runtime::clock::ClockKind;
use mobee_runtime::system::{Control, Reason};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

type Served = Answer<Result<(), String>>;

/// A service whose lives are told by number what they are to do.
struct Lives<F>(F, AtomicU32);

fn lives(life: impl Fn(u32, Arc<dyn Running>) -> Served + Send + Sync + 'static) -> Arc<dyn Service> {
    Arc::new(Lives(life, AtomicU32::new(0)))
}

impl<F: Fn(u32, Arc<dyn Running>) -> Served + Send + Sync> Service for Lives<F> {
    fn name(&self) -> String {
        "hand".into()
    }
    fn runs_in_virtual_time(&self) -> bool {
        true
    }
    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Served {
        let life = (self.0)(self.1.fetch_add(1, Ordering::SeqCst), running);
        Box::pin(async move {
            tokio::select! {
                biased;
                () = until => Ok(()),
                ended = life => ended,
            }
        })
    }
}

async fn wait(running: &Arc<dyn Running>, secs: f64) {
    running.sleep_until(running.now() + Duration::from_secs_f64(secs)).await;
}

fn commit(motor: usize, deg: f64) -> Commit {
    let target = Target { motors: vec![motor], q: vec![deg.to_radians()], speed: 0.1 };
    Commit { agent: "hand".into(), target, speeds: None }
}

/// Moves the elbow to and fro for ever, whenever the robot rests.
fn to_and_fro(_: u32, running: Arc<dyn Running>) -> Served {
    Box::pin(async move {
        let robot = running.robots()[0].clone();
        robot.let_agent_act(false).unwrap();
        let mut deg = 20.0;
        loop {
            wait(&running, 0.05).await;
            if robot.latest().ready && robot.commit(commit(1, deg)).await.is_ok() {
                deg = -deg;
            }
        }
    })
}

/// What the journal tells of the service.
fn told(ran: &Ran) -> Vec<String> {
    let of = |e: &(Time, Arc<Event>)| match &*e.1 {
        Event::Died { actor, reason } => Some(format!("{actor} died: {reason}")),
        Event::Restarted { actor, .. } => Some(format!("{actor} is back")),
        Event::GaveUp { group } => Some(format!("{group} gave up")),
        Event::Warning { text } => Some(text.clone()),
        _ => None,
    };
    ran.events().iter().filter_map(of).collect()
}

fn killed_twice() -> Ran {
    let kill = |ms| (Duration::from_millis(ms), Control::Kill("hand/service".into()));
    let trial = Trial { controls: vec![kill(5_010), kill(9_770)], limit: Duration::from_secs(20), ..Trial::default() };
    trial.run_all(|_| (), |_| vec![lives(to_and_fro)])
}

#[test]
fn a_service_that_is_killed_in_virtual_time_is_back_and_its_motions_are_taken_back_first() {
    let ran = killed_twice();
    let once = ["hand/service died: killed", "hand/service is back"];
    assert_eq!(told(&ran), [once, once].concat(), "{}", ran.lines());
    assert_eq!(ran.violations(), vec![]);
    // whatever was open at a death is taken back, and there is no new motion before
    let (mut open, mut orphans, mut after) = (None, Vec::new(), 0);
    for (at, event) in ran.events() {
        match &*event {
            Event::Commit { id, agent, .. } if agent == "hand" => {
                (open, after) = (Some(*id), after + u32::from(!orphans.is_empty()));
            }
            Event::Died { .. } => orphans.push((at, open)),
            // what the end of the run cuts off is another matter
            Event::Outcome { id, outcome, cause, .. } if open == Some(*id) && at.secs() < 20.0 => {
                open = None;
                let orphan = orphans.last().is_some_and(|(_, o)| *o == Some(*id));
                let back = *outcome == Outcome::RolledBack && *cause == Some(Cause::AgentDied);
                assert_eq!(orphan, back, "{id:?} {outcome:?}\n{}", ran.lines());
            }
            _ => {}
        }
    }
    assert!(orphans.iter().any(|(_, open)| open.is_some()), "{orphans:?}");
    assert!(after > 3, "{after} motions after its first death\n{}", ran.lines());
}

#[test]
fn runs_with_a_service_are_equal_in_virtual_time() {
    assert_eq!(killed_twice().lines(), killed_twice().lines());
}

#[test]
fn a_service_that_fails_again_and_again_is_gone_and_the_run_goes_on() {
    let limit = Duration::from_secs(30);
    let trial = Trial { poses: [[4.0, 4.0, 0.0], [-4.0, -4.0, 0.0]].repeat(200), limit, ..Trial::default() };
    let fails = |_, running: Arc<dyn Running>| -> Served {
        Box::pin(async move {
            wait(&running, 0.5).await;
            Err("there is no way".into())
        })
    };
    let ran = trial.run_all(|_| (), |_| vec![lives(fails)]);
    let told = told(&ran);
    let count = |what: &str| told.iter().filter(|t| t.contains(what)).count();
    assert_eq!((count("hand/service died: there is no way"), count("hand/service is back")), (9, 8), "{told:#?}");
    assert_eq!(count("hand/services gave up"), 1, "{told:#?}");
    assert_eq!(count("service hand has used up its restarts and is down: there is no way"), 1, "{told:#?}");
    assert_eq!(ran.end.reason, Reason::Time);
    assert_eq!(ran.violations(), vec![]);
}

#[test]
fn a_run_is_kept_until_its_service_ends_in_order() {
    let ends = |_, running: Arc<dyn Running>| -> Served {
        Box::pin(async move {
            wait(&running, 40.0).await;
            Ok(())
        })
    };
    let ran = Trial::default().run_all(|_| (), |_| vec![lives(ends)]);
    assert_eq!(ran.end.reason, Reason::Done);
    assert!((40.0..41.0).contains(&ran.end.ended_at.secs()), "{}", ran.end.ended_at);
    assert_eq!(told(&ran), [""; 0]);
}

#[test]
fn a_service_that_blocks_its_thread_is_replaced_and_can_move_nothing_any_more() {
    let (free, freed) = mpsc::sync_channel::<()>(1);
    let (tell, heard) = mpsc::sync_channel(1);
    let (freed, both) = (Mutex::new(freed), Mutex::new((free, tell)));
    let trial = Trial {
        clock: ClockKind::Real,
        poses: [[4.0, 4.0, 0.0], [-4.0, -4.0, 0.0]].repeat(200),
        period_s: 0.1,
        limit: Duration::from_secs(60),
        ..Trial::default()
    };
    let (freed, both) = (Arc::new(freed), Arc::new(both));
    let ran = trial.run_all(
        |_| (),
        |stop| {
            let life = move |life, running: Arc<dyn Running>| -> Served {
                let (freed, both, stop) = (freed.clone(), both.clone(), stop.clone());
                Box::pin(async move {
                    if life == 0 {
                        let _ = freed.lock().unwrap().recv();
                        let late = running.robots()[0].commit(commit(1, 5.0)).await;
                        let _ = both.lock().unwrap().1.send(late.map_err(|e| e.code()));
                        let _ = stop.try_send(Control::Stop);
                        return Ok(());
                    }
                    let _ = both.lock().unwrap().0.send(());
                    std::future::pending().await
                })
            };
            vec![lives(life)]
        },
    );
    let blocked = "its thread has been blocked for 10 s";
    let warning = format!("service hand failed: {blocked}; it is started again");
    assert_eq!(told(&ran), [warning, format!("hand/service died: {blocked}"), "hand/service is back".into()]);
    assert_eq!(heard.recv(), Ok(Err("not_ready")), "{}", ran.lines());
    assert_eq!(ran.violations(), vec![]);
    let commits = ran.events().iter().filter(|e| matches!(*e.1, Event::Commit { .. })).count();
    assert!(commits > 5, "{commits}: the robot's own agent went on meanwhile");
}
