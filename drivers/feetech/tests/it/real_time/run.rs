//! The whole system moves an arm of servos: driver actor, history, model, reflex and supervise, in real time.

use crate::arm::{Arm, robot};
use mobee_contract::{
    Agent, Event, Hardware, Intent, MotionEnd, Outcome, Refusal, Snapshot, Summary, Target, Time, View,
};
use mobee_controller::ControllerSettings;
use mobee_journal::check::check_events;
use mobee_model::Scene;
use mobee_runtime::clock::ClockKind;
use mobee_runtime::system::{AgentMaker, Control, RobotSetup, Setup, run_under};
use mobee_runtime::tap::Taps;
use std::sync::Arc;
use std::time::Duration;

/// Goes to each pose of three joints in turn, deg.
struct Tour {
    poses: Vec<[f64; 3]>,
    next: usize,
}

impl Agent for Tour {
    fn next(&mut self, _last: Option<MotionEnd>, _view: &View) -> Intent {
        let Some(pose) = self.poses.get(self.next) else {
            return Intent::Done(Summary { text: "all poses were tried".into(), figures: Vec::new() });
        };
        self.next += 1;
        let q = pose.iter().map(|deg| deg.to_radians()).collect();
        Intent::MoveTo(Target { motors: vec![0, 2, 3], q, speed: 0.7 })
    }
    fn export(&self) -> Snapshot {
        Snapshot { kind: "tour".into(), version: 1, state: self.next.into() }
    }
    fn import(&mut self, from: Snapshot) -> Result<(), Refusal> {
        self.next = from.state.as_u64().unwrap_or(0) as usize;
        Ok(())
    }
}

/// Runs the arm through these poses; the events.
fn tour(arm: &Arc<Arm>, poses: &[[f64; 3]], controls: Vec<(Time, Control)>) -> Vec<(Time, Arc<Event>)> {
    let scene = Scene::new(vec![(Arc::new(robot()), nalgebra::Isometry3::identity())], Vec::new()).expect("a scene");
    let (taps, told) = Taps::collect();
    let poses = poses.to_vec();
    let maker: AgentMaker = Arc::new(move || Ok(Box::new(Tour { poses: poses.clone(), next: 0 }) as Box<dyn Agent>));
    let controller = ControllerSettings {
        history: 6000,
        period_s: 0.01,
        stall_deg: Some(8.0),
        // the machine may take all processors away for half a second
        stale_s: Some(1.0),
        ..ControllerSettings::default()
    };
    let hardware: Arc<dyn Hardware> = Arc::new(Shared(arm.clone()));
    let robot = RobotSetup { name: "so101".into(), hardware, controller, agent: Some(maker), rest: None };
    let setup = Setup { clock: ClockKind::Real, ..Setup::in_virtual_time(scene, vec![robot], 1, taps.clone()) };
    let (_tell, receiver) = tokio::sync::mpsc::channel(4);
    let end = run_under(setup, controls, receiver, Some(Duration::from_secs(60)), |_| ()).expect("a run");
    taps.finish(end.ended_at, Event::Ended { reason: end.reason.to_string() });
    told.events()
}

/// The arm of a test as hardware of a run.
struct Shared(Arc<Arm>);

impl Hardware for Shared {
    fn connect(&self) -> Result<Box<dyn mobee_contract::Driver>, mobee_contract::DriverFault> {
        self.0.hardware.connect()
    }
    fn look(&self) -> Option<Result<Box<dyn mobee_contract::Driver>, mobee_contract::DriverFault>> {
        self.0.hardware.look()
    }
}

fn outcomes(events: &[(Time, Arc<Event>)]) -> Vec<Outcome> {
    let of = |(_, event): &(Time, Arc<Event>)| match &**event {
        Event::Outcome { outcome, .. } => Some(*outcome),
        _ => None,
    };
    events.iter().filter_map(of).collect()
}

const POSES: [[f64; 3]; 6] =
    [[15.0, 5.0, -10.0], [-15.0, -5.0, 10.0], [0.0, 10.0, 0.0], [10.0, 0.0, 15.0], [-10.0, 5.0, 0.0], [0.0, 0.0, 0.0]];

/// An arm whose weight bends its elbow by two degrees reaches each of its targets: one outcome for each motion, and the record holds.
#[test]
fn each_motion_of_an_arm_has_one_outcome() {
    let arm = Arc::new(Arm::new());
    arm.terminal.with(|world| world.servo(3).expect("the elbow").sag = 20.0);
    let events = tour(&arm, &POSES, Vec::new());
    assert_eq!(outcomes(&events), vec![Outcome::Committed; POSES.len()]);
    assert_eq!(check_events(events), []);
    let (at, stored) = arm.terminal.with(|world| {
        let stored = world.servos().map(|s| s.stored_writes).sum::<u64>();
        (world.servo(3).expect("the elbow").position(), stored)
    });
    println!("the elbow rests at {at:.1} of 2048 counts; {:?}", arm.hardware.cycles());
    assert!((at - 2048.0).abs() < 8.0 && stored == 0, "{at} counts, {stored} stored writes");
}

/// A joint that something blocks in mid-motion is rolled back, and the next motion is driven.
#[test]
fn a_motion_into_a_block_is_rolled_back() {
    let arm = Arc::new(Arm::new());
    arm.terminal.with(|world| world.servo(1).expect("the pan joint").block = Some(2148.0));
    let events = tour(&arm, &[[20.0, 0.0, 0.0], [-10.0, 0.0, 0.0]], Vec::new());
    assert_eq!(outcomes(&events), [Outcome::RolledBack, Outcome::Committed]);
    assert_eq!(check_events(events), []);
}
