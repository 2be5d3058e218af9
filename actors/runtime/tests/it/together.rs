//! I14: robots that collide go back together; who would stand in another's way goes back farther, and its safe pose with it.

use mobee_contract::*;
use mobee_controller::ControllerSettings;
use mobee_journal::check::check_events;
use mobee_model::{Scene, parse_robot};
use mobee_runtime::system::{RobotSetup, Setup, run};
use mobee_runtime::tap::Taps;
use mobee_sim::{SimHardware, SimSettings};
use nalgebra::{Isometry3, Vector3};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

const ARM: &str = include_str!("../../../controller/tests/data/pan.xml");

/// Waits, goes to an angle (degrees) at a share of its speed, and so on.
struct Plan(VecDeque<(Duration, f64, f64)>, bool);

impl Agent for Plan {
    fn next(&mut self, _last: Option<MotionEnd>, _view: &View) -> Intent {
        let Some((pause, deg, speed)) = self.0.front().copied() else {
            return Intent::Done(Summary { text: "all was tried".into(), figures: Vec::new() });
        };
        if !std::mem::replace(&mut self.1, true) {
            return Intent::Wait(pause);
        }
        (self.1, _) = (false, self.0.pop_front());
        Intent::MoveTo(Target { motors: vec![0], q: vec![deg.to_radians()], speed })
    }
    fn export(&self) -> Snapshot {
        Snapshot { kind: "plan".into(), version: 1, state: serde_json::Value::Null }
    }
    fn import(&mut self, _from: Snapshot) -> Result<(), Refusal> {
        Ok(())
    }
}

/// Two arms, 80 cm apart, each at zero when it points at the other. Pauses in seconds, angles in degrees, shares of the speed.
fn collide(history: usize, left: &[(f64, f64, f64)], right: &[(f64, f64, f64)]) -> Vec<(Time, Arc<Event>)> {
    let (taps, told) = Taps::collect();
    let (mut stands, mut robots) = (Vec::new(), Vec::new());
    for (name, home, x, turned, plan) in [("left", -90.0, 0.0, 0.0, left), ("right", 90.0, 0.8, 180.0_f64, right)] {
        let text = ARM.replace("NAME", name).replace("HOME", &home.to_string());
        let robot = Arc::new(parse_robot("arm.xml", &text).map(|l| l.value).unwrap());
        let base = Isometry3::new(Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, 0.0, turned.to_radians()));
        stands.push((robot.clone(), base));
        let hardware = SimHardware::new(&SimSettings::ideal(), &Context { robot, seed: 1 }).unwrap();
        let steps: VecDeque<_> = plan.iter().map(|(s, deg, v)| (Duration::from_secs_f64(*s), *deg, *v)).collect();
        robots.push(RobotSetup {
            name: name.into(),
            hardware: Arc::new(hardware),
            controller: ControllerSettings { history, reserve_m: Some(0.0), ..ControllerSettings::default() },
            rest: None,
            agent: Some(Arc::new(move || Ok(Box::new(Plan(steps.clone(), false)) as Box<dyn Agent>))),
        });
    }
    let setup = Setup::in_virtual_time(Scene::new(stands, Vec::new()).unwrap(), robots, 1, taps.clone());
    let (_tell, controls) = tokio::sync::mpsc::channel(1);
    let end = run(setup, controls, Some(Duration::from_secs(120)), |_| ()).unwrap();
    taps.finish(end.ended_at, Event::Ended { reason: end.reason.to_string() });
    let events = told.events();
    // shown if a test fails
    events.iter().for_each(|(at, e)| println!("{at} {e:?}"));
    assert_eq!(check_events(events.clone()), []);
    events
}

/// Where each robot was rolled back to, degrees.
fn homes(events: &[(Time, Arc<Event>)]) -> Vec<(String, f64)> {
    let home = |e: &Event| match e {
        Event::Outcome { robot, outcome: Outcome::RolledBack, q, .. } => {
            Some((robot.clone(), q[0].to_degrees().round()))
        }
        _ => None,
    };
    let mut homes: Vec<_> = events.iter().filter_map(|(_, e)| home(e)).collect();
    homes.sort_by(|a, b| a.0.cmp(&b.0));
    homes
}

fn moved(events: &[(Time, Arc<Event>)]) -> Vec<String> {
    let of = |e: &Event| if let Event::SafePoseMoved { robot, .. } = e { Some(robot.clone()) } else { None };
    events.iter().filter_map(|(_, e)| of(e)).collect()
}

/// The left one turns slowly past the place where both point at each other; the right one follows it there, rests, and then
/// catches up with it.
const LEFT: [(f64, f64, f64); 1] = [(0.0, 60.0, 0.12)];
const RIGHT: [(f64, f64, f64); 2] = [(12.5, 10.0, 1.0), (0.2, -60.0, 0.6)];

#[test]
fn who_would_stand_in_the_way_goes_back_to_an_earlier_rest() {
    let events = collide(3000, &LEFT, &RIGHT);
    assert_eq!(homes(&events), [("left".to_owned(), -90.0), ("right".to_owned(), 90.0)]);
    assert_eq!(moved(&events), ["right"]);
}

#[test]
fn who_comes_from_elsewhere_is_taken_back_to_its_safe_pose() {
    // at 10 deg it would be in the way; at 75 deg the left one passed it
    let events = collide(3000, &LEFT, &[(8.0, 75.0, 1.0), (0.3, -60.0, 0.2)]);
    assert_eq!(homes(&events), [("left".to_owned(), -90.0), ("right".to_owned(), 75.0)]);
    assert!(moved(&events).is_empty(), "{:?}", moved(&events));
}
