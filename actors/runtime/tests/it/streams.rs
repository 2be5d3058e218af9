//! Streams of set-points are transactions as any other motion: one outcome, rolled back on contact, within limits.

use crate::common::{Ran, Trial, ball};
use mobee_contract::*;
use mobee_controller::ControllerSettings;
use mobee_model::ObjectClass;
use mobee_runtime::system::AgentMaker;
use std::sync::Arc;
use std::time::Duration;

/// Streams `count` set-points, then falls silent; so often, from wherever it is.
struct Streams {
    times: usize,
    count: usize,
    next: fn(k: usize, from: &[f64]) -> Setpoints,
    from: Pose,
    at: usize,
    ends: Vec<MotionEnd>,
    /// After so many set-points it goes on with a move.
    moves: Option<(usize, Target)>,
}

impl Agent for Streams {
    fn next(&mut self, last: Option<MotionEnd>, view: &View) -> Intent {
        self.ends.extend(last);
        if self.ends.len() >= self.times {
            let reached = self.ends.iter().filter(|e| **e == MotionEnd::Reached).count();
            return Intent::Done(Summary {
                text: "streamed".into(),
                figures: vec![("reached".into(), reached as f64)],
            });
        }
        (self.from, self.at) = (view.pose().into(), 1);
        Intent::Stream((self.next)(0, &self.from))
    }
    fn revise(&mut self, _view: &View) -> Option<Intent> {
        if self.at >= self.count {
            return None;
        }
        self.at += 1;
        if let Some((k, target)) = self.moves.as_ref().filter(|(k, _)| self.at >= *k) {
            return (self.at == *k).then(|| Intent::MoveTo(target.clone()));
        }
        Some(Intent::Stream((self.next)(self.at - 1, &self.from)))
    }
    fn export(&self) -> Snapshot {
        Snapshot { kind: "streams".into(), version: 1, state: 0.into() }
    }
    fn import(&mut self, _: Snapshot) -> Result<(), Refusal> {
        Ok(())
    }
}

fn streams(times: usize, count: usize, next: fn(usize, &[f64]) -> Setpoints) -> Option<AgentMaker> {
    streams_and_moves(times, count, next, None)
}

fn streams_and_moves(
    times: usize,
    count: usize,
    next: fn(usize, &[f64]) -> Setpoints,
    moves: Option<(usize, Target)>,
) -> Option<AgentMaker> {
    let make = move || {
        let from: Pose = Vec::new().into();
        Ok(Box::new(Streams { times, count, next, from, at: 0, ends: Vec::new(), moves: moves.clone() })
            as Box<dyn Agent>)
    };
    Some(Arc::new(make))
}

fn velocity(_: usize, _: &[f64]) -> Setpoints {
    Setpoints { motors: vec![0], values: Values::Velocity(vec![10f64.to_radians()]) }
}

fn fast(_: usize, _: &[f64]) -> Setpoints {
    Setpoints { motors: vec![1, 0], values: Values::Velocity(vec![0.0, 1e3]) }
}

/// 0.4 deg per set-point.
fn position(k: usize, from: &[f64]) -> Setpoints {
    let q = from[2] + (0.4 * (k + 1) as f64).to_radians();
    Setpoints { motors: vec![2], values: Values::Position(vec![q]) }
}

fn told(ran: &Ran, is: impl Fn(&Event) -> bool) -> usize {
    ran.events().iter().filter(|e| is(&e.1)).count()
}

fn reached(ran: &Ran) -> f64 {
    ran.end.counts.done["arm"].figures[0].1
}

#[test]
fn a_velocity_stream_that_goes_quiet_ends_where_it_rests() {
    let ran = Trial { agent: streams(2, 50, velocity), ..Trial::default() }.run();
    assert_eq!(ran.outcomes(), [Outcome::Committed; 2], "{}", ran.lines());
    assert_eq!(reached(&ran), 2.0);
    assert_eq!(ran.violations(), [], "{}", ran.lines());
    let q = ran.hardware.positions(ran.end.ended_at);
    // 50 set-points at 20 ms, and what passes until it is quiet
    assert!((19.0..25.0).contains(&q[0].to_degrees()), "{q:?}");
    // one outcome, and no more than the beginning and the end in the journal
    assert_eq!(told(&ran, |e| matches!(e, Event::Amended { .. })), 2);
    assert_eq!(told(&ran, |e| matches!(e, Event::Streamed { writer: Writer::Agent, .. })), 2);
}

#[test]
fn motors_that_join_a_stream_are_told() {
    fn one_more(k: usize, _: &[f64]) -> Setpoints {
        let motors = if k < 20 { vec![0] } else { vec![0, 2] };
        Setpoints { values: Values::Velocity(vec![0.1; motors.len()]), motors }
    }
    let ran = Trial { agent: streams(1, 50, one_more), ..Trial::default() }.run();
    let named = ran.events().into_iter().filter_map(|e| match &*e.1 {
        Event::Commit { motors, .. } | Event::Amended { motors, .. } => {
            Some(motors.iter().map(|(m, _)| *m).collect::<Vec<_>>())
        }
        _ => None,
    });
    assert_eq!(named.collect::<Vec<_>>(), [vec![0], vec![2], vec![]], "{}", ran.lines());
}

#[test]
fn a_position_stream_is_followed_to_its_end() {
    let ran = Trial { agent: streams(2, 50, position), ..Trial::default() }.run();
    assert_eq!(ran.outcomes(), [Outcome::Committed; 2], "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
    let q = ran.hardware.positions(ran.end.ended_at);
    assert!((q[2].to_degrees() - 40.0).abs() < 0.5, "{q:?}");
    assert!(q[0].abs() < 0.01 && q[1].abs() < 0.01, "{q:?}");
    assert_eq!(ran.end.counts.refused, 0, "{}", ran.lines());
}

/// By half a second unless the controller says otherwise, and at most to where it began.
#[test]
fn a_velocity_stream_into_an_obstacle_is_rolled_back() {
    let rests = |undo_s: f64| {
        let objects = vec![ball("ball", [0.5, 0.25, 0.2], ObjectClass::Obstacle)];
        let ran = Trial { objects, agent: streams(1, 500, velocity), undo_s, ..Trial::default() }.run();
        assert_eq!(ran.outcomes(), [Outcome::RolledBack], "{}", ran.lines());
        assert_eq!(reached(&ran), 0.0);
        assert_eq!(ran.end.counts.hard_contacts, 0);
        assert_eq!(ran.violations(), [], "{}", ran.lines());
        let moved = ran.events().iter().find_map(|e| match &*e.1 {
            Event::SafePoseMoved { q, recorded: Some(at), .. } => Some((q[0].to_degrees(), at.secs())),
            _ => None,
        });
        let closed = |e: &Event| matches!(e, Event::Disabled { cause: Cause::Contact(_), .. });
        let closed = ran.events().iter().find(|e| closed(&e.1)).map(|e| e.0.secs()).unwrap();
        let q = ran.hardware.positions(ran.end.ended_at)[0].to_degrees();
        if let Some((to, at)) = moved {
            assert!((q - to).abs() < 0.2, "{q}, sent to {to}");
            assert!((undo_s..undo_s + 0.1).contains(&(closed - at)), "{at}, closed at {closed}");
        }
        (q, moved.is_some())
    };
    let (usual, is_moved) = rests(ControllerSettings::default().undo_s);
    let (longer, is_moved_longer) = rests(1.0);
    assert!(is_moved && is_moved_longer && usual > longer + 4.0 && longer > 1.0, "{usual}, {longer}");
    let (whole, moved) = rests(1000.0);
    assert!(whole.abs() < 0.2 && !moved, "{whole}");
}

#[test]
fn a_position_stream_into_an_obstacle_is_rolled_back() {
    let objects = vec![ball("ball", [0.62, 0.2, 0.2], ObjectClass::Obstacle)];
    let ran = Trial {
        objects,
        agent: streams(1, 200, |k, from| Setpoints { motors: vec![0], ..position(k, from) }),
        ..Trial::default()
    }
    .run();
    assert_eq!(ran.outcomes(), [Outcome::RolledBack], "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn a_stream_that_outlasts_the_history_takes_its_safe_pose_along() {
    let objects = vec![ball("ball", [0.0, 0.5, 0.2], ObjectClass::Obstacle)];
    let ran = Trial { objects, agent: streams(1, 2000, velocity), history: 300, ..Trial::default() }.run();
    assert_eq!(ran.outcomes(), [Outcome::RolledBack], "{}", ran.lines());
    assert!(told(&ran, |e| matches!(e, Event::SafePoseMoved { .. })) > 0, "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn a_velocity_is_lowered_to_the_axis_and_brakes_before_its_limit() {
    let ran = Trial { agent: streams(1, 300, fast), ..Trial::default() }.run();
    assert_eq!(ran.outcomes(), [Outcome::Committed], "{}", ran.lines());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
    let q = ran.hardware.positions(ran.end.ended_at);
    assert!((165.0..170.0).contains(&q[0].to_degrees()), "{q:?}");
}

#[test]
fn a_stop_in_a_stream_ends_it_at_rest() {
    use mobee_runtime::system::Control;
    let controls = vec![(Duration::from_millis(1500), Control::Stop)];
    let ran = Trial { agent: streams(1, 2000, velocity), controls, ..Trial::default() }.run();
    assert_eq!(ran.outcomes(), [Outcome::Faulted], "{}", ran.lines());
    assert!(ran.hardware.speeds(ran.end.ended_at).iter().all(|v| *v == 0.0));
    assert_eq!(ran.violations(), [], "{}", ran.lines());
}

#[test]
fn killing_any_actor_in_a_stream_leaves_one_outcome_and_nothing_moving() {
    use mobee_runtime::system::Control;
    for actor in ["arm/driver", "arm/history", "model", "arm/supervise", "arm/reflex", "arm/agent"] {
        let controls = vec![(Duration::from_millis(1500), Control::Kill(actor.into()))];
        let limit = Duration::from_secs(30);
        let ran = Trial { agent: streams(1, 200, velocity), controls, limit, ..Trial::default() }.run();
        assert_eq!(ran.violations(), [], "{actor}: {}", ran.lines());
        assert!(ran.hardware.speeds(ran.end.ended_at).iter().all(|v| *v == 0.0), "{actor}");
        assert!(!ran.outcomes().is_empty(), "{actor}: {}", ran.lines());
    }
}

#[test]
fn a_move_in_mid_stream_joins_its_transaction_and_may_take_long() {
    for next in [velocity as fn(usize, &[f64]) -> Setpoints, position] {
        // 60 degrees at 2 deg/s or so
        let target = Target { motors: vec![1], q: vec![60f64.to_radians()], speed: 0.05 };
        let ran = Trial { agent: streams_and_moves(1, 100, next, Some((30, target))), ..Trial::default() }.run();
        assert_eq!(ran.outcomes(), [Outcome::Committed], "{}", ran.lines());
        assert_eq!(ran.violations(), [], "{}", ran.lines());
        let q = ran.hardware.positions(ran.end.ended_at);
        assert!((q[1].to_degrees() - 60.0).abs() < 0.2, "{q:?}");
        assert!(q[0].to_degrees() > 5.0 || q[2].to_degrees() > 5.0, "{q:?}");
        let named = ran.events().iter().any(|e| match &*e.1 {
            Event::Amended { motors, .. } => motors.iter().map(|(m, _)| *m).eq([1]),
            _ => false,
        });
        assert!(named, "the move's motor joins: {}", ran.lines());
    }
}
