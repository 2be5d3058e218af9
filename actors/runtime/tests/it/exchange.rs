//! A foreign agent and the built-in one take turns while the robot runs, and a service that dies leaves nothing moving.

use crate::common::{Ran, Trial};
use mobee_contract::*;
use mobee_runtime::clock::ClockKind;
use mobee_runtime::system::{Control, Reason};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::mpsc::Sender;

/// A service made of one function, done in its first life. Then, or in its next life if it did not survive that, it ends the run.
struct Does<F>(Mutex<Option<F>>, Sender<Control>);

impl<F> Service for Does<F>
where
    F: FnOnce(Arc<dyn Running>) -> Answer<Result<(), String>> + Send + 'static,
{
    fn name(&self) -> String {
        "foreign".into()
    }
    fn serve(self: Arc<Self>, running: Arc<dyn Running>, until: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(async move {
            let does = self.0.lock().unwrap().take();
            if let Some(does) = does {
                does(running).await?;
            }
            let _ = self.1.try_send(Control::Stop);
            until.await;
            Ok(())
        })
    }
}

const PATIENCE: usize = 2000;

async fn pause() {
    tokio::time::sleep(Duration::from_millis(5)).await;
}

async fn ready(robot: &Arc<dyn Filtered>) {
    for _ in 0..PATIENCE {
        if robot.latest().ready && robot.latest().status == Status::Rest {
            return;
        }
        pause().await;
    }
    panic!("the robot never rests: {:?}", robot.latest());
}

async fn end_of(robot: &Arc<dyn Filtered>, id: CommitId) -> MotionEnd {
    for _ in 0..PATIENCE {
        if let Some(end) = robot.end_of(id) {
            return end;
        }
        pause().await;
    }
    panic!("motion {id:?} never ends");
}

fn commit(motor: usize, deg: f64, speed_deg: f64) -> Commit {
    let target = Target { motors: vec![motor], q: vec![deg.to_radians()], speed: 1.0 };
    Commit { agent: "other".into(), target, speeds: Some(vec![speed_deg.to_radians()]) }
}

fn run(does: impl FnOnce(Arc<dyn Running>) -> Answer<Result<(), String>> + Send + 'static) -> Ran {
    let trial = Trial {
        clock: ClockKind::Real,
        poses: [[4.0, 4.0, 0.0], [-4.0, -4.0, 0.0]].repeat(200),
        limit: Duration::from_secs(60),
        // readings that stay fresh for half a second: a busy machine must not fail the test
        period_s: 0.1,
        ..Trial::default()
    };
    trial.run_all(|_| (), |stop| vec![Arc::new(Does(Mutex::new(Some(does)), stop))])
}

fn commits_of(ran: &Ran) -> Vec<String> {
    let of = |e: &(Time, Arc<Event>)| if let Event::Commit { agent, .. } = &*e.1 { Some(agent.clone()) } else { None };
    ran.events().iter().filter_map(of).collect()
}

/// What the run was warned of.
fn warned(ran: &Ran, of: Option<&str>) {
    let text = |e: &(Time, Arc<Event>)| if let Event::Warning { text } = &*e.1 { Some(text.clone()) } else { None };
    let texts: Vec<String> = ran.events().iter().filter_map(text).collect();
    assert_eq!(texts, of.into_iter().collect::<Vec<_>>(), "{}", ran.lines());
}

#[test]
fn a_foreign_agent_and_the_built_in_one_take_turns() {
    let ran = run(|running| {
        Box::pin(async move {
            let robot = running.robots()[0].clone();
            for turn in 0..3 {
                robot.let_agent_act(false).unwrap();
                ready(&robot).await;
                let id = loop {
                    match robot.commit(commit(2, 3.0, 20.0)).await {
                        Ok(id) => break id,
                        Err(Refusal::Busy | Refusal::NotReady { .. }) => pause().await,
                        Err(e) => panic!("{e}"),
                    }
                };
                assert_eq!(robot.end_of(id), None);
                // a second motor joins the open motion, whose first keeps its target
                assert_eq!(robot.commit(commit(1, 1.0 + f64::from(turn), 30.0)).await, Ok(id));
                assert_eq!(end_of(&robot, id).await, MotionEnd::Reached);
                let q = robot.latest().q;
                assert!((q[2].to_degrees() - 3.0).abs() < 0.2, "{q:?}");
                assert!((q[1].to_degrees() - 1.0 - f64::from(turn)).abs() < 0.2, "{q:?}");
                robot.let_agent_act(true).unwrap();
                // on a busy machine the motion that was seen may be over before the commit comes
                for attempt in 0..5 {
                    let before = running.now();
                    for _ in 0..PATIENCE {
                        if robot.latest().status == Status::Moving || running.now() > before + Duration::from_secs(4) {
                            break;
                        }
                        pause().await;
                    }
                    match robot.commit(commit(0, 0.0, 20.0)).await {
                        Err(Refusal::Busy) => break,
                        Ok(id) if attempt < 4 => assert_eq!(end_of(&robot, id).await, MotionEnd::Reached),
                        own => panic!("the built-in agent's motion was joined: {own:?}"),
                    }
                }
            }
            Ok(())
        })
    });
    warned(&ran, None);
    let agents = commits_of(&ran);
    assert!(agents.iter().filter(|a| *a == "other").count() >= 3, "{agents:?}");
    assert!(agents.iter().filter(|a| *a == "arm/agent").count() >= 3, "{agents:?}");
    assert_eq!(ran.violations(), vec![]);
}

#[test]
fn an_agent_may_not_take_the_built_in_agents_name() {
    let ran = run(|running| {
        Box::pin(async move {
            let robot = running.robots()[0].clone();
            let refused = robot.commit(Commit { agent: "arm/agent".into(), ..commit(0, 1.0, 10.0) }).await;
            assert_eq!(refused.map_err(|e| e.code()), Err("malformed"));
            let speeds = |speeds: Vec<f64>| Commit { speeds: Some(speeds), ..commit(0, 1.0, 10.0) };
            for wrong in [vec![], vec![0.0], vec![-1.0], vec![f64::NAN], vec![1.0, 1.0]] {
                assert_eq!(robot.commit(speeds(wrong)).await.map_err(|e| e.code()), Err("malformed"));
            }
            Ok(())
        })
    });
    warned(&ran, None);
    assert_eq!(ran.violations(), vec![]);
}

#[test]
fn the_motion_of_a_service_that_panics_is_taken_back() {
    let ran = run(|running| {
        Box::pin(async move {
            let robot = running.robots()[0].clone();
            robot.let_agent_act(false).unwrap();
            ready(&robot).await;
            while robot.commit(commit(0, 60.0, 5.0)).await.is_err() {
                pause().await;
            }
            tokio::time::sleep(Duration::from_millis(300)).await;
            panic!("planted");
        })
    });
    let events = ran.events();
    warned(&ran, Some("service foreign failed: it panicked; it is started again"));
    let lives = |e: &(Time, Arc<Event>)| match &*e.1 {
        Event::Died { actor, reason } => Some(format!("{actor} died: {reason}")),
        Event::Restarted { actor, .. } => Some(format!("{actor} is back")),
        _ => None,
    };
    let told: Vec<String> = events.iter().filter_map(lives).collect();
    assert_eq!(told, ["foreign/service died: it panicked", "foreign/service is back"], "{}", ran.lines());
    let rolled = |e: &(Time, Arc<Event>)| {
        matches!(&*e.1, Event::Outcome { outcome: Outcome::RolledBack, cause: Some(Cause::AgentDied), .. })
    };
    assert!(events.iter().any(rolled), "{}", ran.lines());
    assert_eq!(ran.violations(), vec![]);
}

/// A service that never leaves.
struct Stays;

impl Service for Stays {
    fn name(&self) -> String {
        "stays".into()
    }
    fn serve(self: Arc<Self>, _: Arc<dyn Running>, _: Answer<()>) -> Answer<Result<(), String>> {
        Box::pin(std::future::pending())
    }
}

#[test]
fn a_service_that_does_not_leave_is_left_behind() {
    let limit = Duration::from_millis(300);
    let trial = Trial { clock: ClockKind::Real, period_s: 0.1, limit, ..Trial::default() };
    let ran = trial.run_all(|_| (), |_| vec![Arc::new(Stays)]);
    assert_eq!(ran.end.reason, Reason::Time);
    warned(&ran, Some("service stays did not leave in time, and is left behind"));
    assert_eq!(ran.violations(), vec![]);
}

#[test]
#[should_panic(expected = "VirtualService(\"stays\")")]
fn a_service_that_can_t_run_in_virtual_time_is_refused_there() {
    Trial::default().run_all(|_| (), |_| vec![Arc::new(Stays)]);
}
