//! Supervise and reflex together, with a plant of one motor, under random interleavings: I1, I2, I4, I9 and I15.

use super::*;
use crate::command_guard::CommandGuard;
use crate::joint_retreat::JointRetreat;
use crate::ledger::Extent;
use crate::reflex::tests::Alone;
use crate::reflex::{ReflexCore, ReflexIn, ReflexOut};
use crate::{ControllerSettings, Drive, FieldsSettings};
use mobee_contract::{AnswerTime, Axis, Board, ControlMode, Outcome, Refusal, Sample, Target, Values};
use mobee_model::{Contact, NodePairs, Part, Robot, Scene, ShapeId};
use nalgebra::Isometry3;
use proptest::prelude::*;
use std::collections::VecDeque;
use std::time::Duration;

mod admit;
mod cell;
mod ends;
mod exhaustive;
mod halted;
mod readings;
mod reference;
mod two_motors;
mod undo;
use cell::{Cell, Kind, Op};

/// A motor as good as any.
fn axis() -> Axis {
    Axis { name: "m".into(), min: -3.0, max: 3.0, max_speed: 1.7, max_acceleration: 3.5, ..Default::default() }
}

fn op() -> impl Strategy<Value = Op> {
    prop_oneof![
        4 => (-2.5_f64..2.5, any::<bool>()).prop_map(|(q, own)| Op::Commit(q, own)),
        2 => (-0.3_f64..0.3, any::<bool>()).prop_map(|(q, own)| Op::Position(q, own)),
        2 => (-3.0_f64..3.0, any::<bool>()).prop_map(|(v, own)| Op::Velocity(v, own)),
        3 => (-3.0_f64..3.0, 1_u8..60).prop_map(|(v, n)| Op::Stream(v, n)),
        6 => (1_u8..60).prop_map(Op::Samples),
        1 => (1_u8..30).prop_map(Op::Silence),
        2 => prop::option::of(-2.0_f64..2.0).prop_map(Op::Wall),
        1 => Just(Op::Stop),
        1 => Just(Op::AgentDies),
        1 => Just(Op::SuperviseDies),
        1 => Just(Op::ReflexDies),
        1 => Just(Op::Recover),
        6 => (0_u8..3).prop_map(Op::Deliver),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn any_interleaving_fulfills_the_promises(
        kind in prop::sample::select(vec![Kind::Straight, Kind::Fields, Kind::NoReflex, Kind::Velocities]),
        ops in prop::collection::vec(op(), 1..60),
    ) {
        let mut cell = Cell::of(kind);
        cell.apply(Op::Samples(30));
        for op in ops {
            cell.apply(op);
            prop_assert!(cell.outcomes.len() as u64 <= cell.commits, "I2: more outcomes than commits");
        }
        // the recovery phase: everything ends, and the filter is open, or holds where an escape frees it (I15)
        cell.wall = None;
        cell.heal();
        if matches!(cell.supervise.status(), Status::Holding(_)) {
            cell.apply(Op::Commit(cell.q, true));
            cell.heal();
        }
        prop_assert_eq!(cell.supervise.status(), Status::Rest);
        prop_assert!(cell.gate.is_open());
        let expected: Vec<CommitId> = (1..=cell.commits).map(CommitId).collect();
        prop_assert_eq!(cell.outcomes, expected, "I2: exactly one outcome each, in order");
    }
}

#[test]
fn commits_that_do_not_fit_are_refused_with_their_code() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let mut code = |motors: Vec<usize>, q: Vec<f64>, speed: f64| {
        let commit = Commit { agent: "a".into(), target: Target { motors, q, speed }, speeds: None };
        match cell.on(SuperviseIn::Commit(commit), cell.now).first() {
            Some(SuperviseOut::Verdict(Err(refusal))) => refusal.code(),
            _ => "accepted",
        }
    };
    assert_eq!(code(vec![], vec![], 0.5), "malformed");
    assert_eq!(code(vec![0, 0], vec![0.1, 0.1], 0.5), "malformed");
    assert_eq!(code(vec![1], vec![0.1], 0.5), "malformed");
    assert_eq!(code(vec![0], vec![], 0.5), "malformed");
    assert_eq!(code(vec![0], vec![f64::NAN], 0.5), "not_finite");
    assert_eq!(code(vec![0], vec![3.1], 0.5), "limits");
    assert_eq!(code(vec![0], vec![0.1], f64::NAN), "speed");
    assert_eq!(code(vec![0], vec![0.1], 0.0), "speed");
    assert_eq!(code(vec![0], vec![0.1], 0.5), "accepted");
}

#[test]
fn events_of_a_commit_and_its_amendments_have_motors_and_speeds() {
    let journaled = |out: Vec<SuperviseOut>| {
        out.into_iter().find_map(|o| match o {
            SuperviseOut::Event(Event::Commit { motors, .. } | Event::Amended { motors, .. }) => Some(motors),
            _ => None,
        })
    };
    let target = Target { motors: vec![0], q: vec![2.0], speed: 0.5 };
    let commit = |speeds| SuperviseIn::Commit(Commit { agent: "a".into(), target: target.clone(), speeds });
    for (kind, share) in [(Kind::Straight, 0.5), (Kind::Fields, 0.5)] {
        let mut cell = Cell::of(kind);
        cell.apply(Op::Samples(30));
        let most = share * cell.rules.axes[0].max_speed;
        assert_eq!(journaled(cell.on(commit(None), cell.now)), Some(vec![(0, most)]), "its share of the axis'");
        assert_eq!(journaled(cell.on(commit(Some(vec![0.1])), cell.now)), Some(vec![(0, 0.1)]), "its own");
        assert_eq!(journaled(cell.on(commit(Some(vec![9e9])), cell.now)), Some(vec![(0, most)]), "but no more");
    }
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    let setpoints = Setpoints { motors: vec![0], values: Values::Velocity(vec![0.1]) };
    let stream = SuperviseIn::Stream("a".into(), setpoints);
    assert_eq!(journaled(cell.on(stream, cell.now)), Some(vec![(0, cell.rules.axes[0].max_speed)]));
}

#[test]
fn set_points_that_do_not_fit_are_refused_with_their_code() {
    let mut cell = Cell::new();
    let code = |cell: &mut Cell, values: Values| cell.stream(true, values).map_err(|e| e.code());
    assert_eq!(code(&mut cell, Values::Velocity(vec![0.1])), Err("not_ready"));
    cell.apply(Op::Samples(30));
    assert_eq!(code(&mut cell, Values::Velocity(vec![f64::NAN])), Err("not_finite"));
    assert_eq!(code(&mut cell, Values::Velocity(vec![0.1, 0.1])), Err("malformed"));
    assert_eq!(code(&mut cell, Values::Position(vec![f64::INFINITY])), Err("not_finite"));
    assert_eq!(code(&mut cell, Values::Position(vec![3.1])), Err("limits"));
    assert_eq!(code(&mut cell, Values::Position(vec![1.0])), Err("jump"));
    assert_eq!(cell.commits, 0);
    assert_eq!(code(&mut cell, Values::Position(vec![0.1])), Ok(CommitId(1)));
    assert_eq!(code(&mut cell, Values::Position(vec![0.12])), Ok(CommitId(1)));
    assert_eq!(cell.stream(false, Values::Position(vec![0.12])), Err(Refusal::Busy));
    // quiet: it ends where it was led
    cell.apply(Op::Samples(100));
    assert_eq!(cell.outcomes, [CommitId(1)]);
    assert!((cell.q - 0.12).abs() < 1e-6, "{}", cell.q);
    assert_eq!(cell.mode, ControlMode::Position);
}

/// A board without position-direct takes velocities only; a commit's own speeds are numbers above zero.
#[test]
fn set_points_that_the_board_cannot_take_are_refused() {
    use super::check::{check_setpoints, check_speeds};
    use crate::joint_retreat::tests::rules;
    let values = |q| Setpoints { motors: vec![0], values: Values::Position(vec![q]) };
    assert_eq!(check_setpoints(&values(0.1), &rules(true)), Ok(()));
    assert_eq!(check_setpoints(&values(0.1), &rules(false)).map_err(|e| e.code()), Err("malformed"));
    let velocity = Setpoints { motors: vec![0], values: Values::Velocity(vec![0.1]) };
    assert_eq!(check_setpoints(&velocity, &rules(false)), Ok(()));
    let target = Target { motors: vec![0], q: vec![0.1], speed: 1.0 };
    let with = |speeds| Commit { agent: "a".into(), target: target.clone(), speeds: Some(speeds) };
    assert_eq!(check_speeds(&with(vec![0.1]), &rules(true)), Ok(()));
    for speeds in [vec![], vec![0.1, 0.1], vec![0.0], vec![-0.1], vec![f64::INFINITY], vec![f64::NAN]] {
        let refused = check_speeds(&with(speeds.clone()), &rules(true)).map_err(|e| e.code());
        assert_eq!(refused, Err("malformed"), "{speeds:?}");
    }
}

#[test]
fn a_stream_is_refused_while_the_robot_holds_and_gives_way_to_a_move() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Stream(1.0, 20));
    let before = cell.q;
    assert!(before > 0.3, "{before}");
    // a move in mid-stream joins the transaction
    cell.apply(Op::Commit(0.1, true));
    cell.apply(Op::Samples(200));
    assert_eq!((cell.commits, cell.outcomes.len()), (1, 1));
    assert!((cell.q - 0.1).abs() < 1e-6, "{}", cell.q);
    cell.apply(Op::Wall(Some(cell.q)));
    cell.apply(Op::Samples(30));
    assert_eq!(cell.supervise.status(), Status::Holding(Hold::InContact));
    let refused = cell.stream(true, Values::Velocity(vec![0.1]));
    assert_eq!(refused, Err(Refusal::Holding { reason: Hold::InContact }));
}

/// A program that ignores the robot's state streams on during the retreat, and after: it hits the wall once.
#[test]
fn a_stream_into_a_wall_that_never_pauses_runs_into_it_once() {
    let mut cell = Cell::new();
    cell.apply(Op::Samples(30));
    cell.apply(Op::Wall(Some(0.6)));
    // 25 seconds
    (0..5).for_each(|_| cell.apply(Op::Stream(0.3, 250)));
    assert_eq!((cell.outcomes.len(), cell.outcome), (1, Some(Outcome::RolledBack)));
    assert_eq!(cell.refused, 1, "one line for the whole burst");
    assert_eq!(cell.stream(true, Values::Velocity(vec![-0.3])), Err(Refusal::Pushing));
    cell.apply(Op::Samples(40));
    assert_eq!(cell.stream(true, Values::Velocity(vec![-0.3])), Err(Refusal::Pushing), "0.4 s are no silence");
    cell.apply(Op::Samples(51));
    assert_eq!(cell.stream(true, Values::Velocity(vec![-0.3])), Ok(CommitId(2)));
}

#[test]
fn under_forces_the_target_is_reached_at_once_or_in_velocities() {
    for kind in [Kind::Fields, Kind::NoReflex, Kind::Velocities] {
        let mut cell = Cell::of(kind);
        cell.apply(Op::Samples(30));
        cell.apply(Op::Commit(1.0, true));
        cell.apply(Op::Samples(100));
        assert_eq!(cell.supervise.status(), Status::Moving, "{kind:?}");
        // another target in mid-motion joins; set-points of any agent have to wait
        cell.apply(Op::Commit(-0.5, true));
        assert_eq!(cell.stream(true, Values::Velocity(vec![0.1])).map_err(|e| e.code()), Err("not_ready"));
        assert_eq!(cell.stream(false, Values::Velocity(vec![0.1])), Err(Refusal::Busy));
        cell.heal();
        assert_eq!((cell.commits, cell.outcomes.len(), cell.supervise.status()), (1, 1, Status::Rest), "{kind:?}");
        assert!((cell.q + 0.5).abs() <= cell.rules.tolerance, "{kind:?}: {}", cell.q);
        assert_eq!(cell.mode, ControlMode::Position, "{kind:?}");
    }
}

#[test]
fn a_target_at_the_limit_is_reached_in_velocities() {
    for limit in [-3.0, 3.0] {
        let mut cell = Cell::of(Kind::Velocities);
        cell.apply(Op::Samples(30));
        cell.apply(Op::Commit(limit, true));
        cell.heal();
        assert_eq!(cell.outcome, Some(Outcome::Committed), "{limit}: at {}", cell.q);
    }
}

/// A wall in the way: forces alone come to rest before it, and the motion is rolled back as one that missed its target.
#[test]
fn where_forces_balance_elsewhere_the_motion_is_rolled_back() {
    for kind in [Kind::Fields, Kind::NoReflex] {
        let mut cell = Cell::of(kind);
        cell.apply(Op::Samples(30));
        cell.apply(Op::Wall(Some(0.6)));
        cell.apply(Op::Commit(1.0, true));
        let mut nearest: f64 = 1.0;
        for _ in 0..60 {
            cell.apply(Op::Samples(10));
            nearest = nearest.min(0.6 - cell.q);
        }
        cell.heal();
        assert!(nearest > 0.06 && nearest < 0.3, "{kind:?}: it came as near as {nearest}");
        assert_eq!((cell.outcomes.len(), cell.supervise.status()), (1, Status::Rest), "{kind:?}");
        assert!(cell.q.abs() < 0.01, "{kind:?}: rolled back to where it began, not {}", cell.q);
    }
}

/// Contacts stop a robot with a reflex; without one it moves through them.
#[test]
fn without_a_reflex_contacts_stop_nothing() {
    let through = |kind: Kind| {
        let mut cell = Cell::of(kind);
        cell.apply(Op::Samples(30));
        cell.apply(Op::Commit(0.4, true));
        cell.apply(Op::Samples(60));
        // no field, but a contact, as long as it is moving
        cell.touching = true;
        cell.heal();
        (cell.q, cell.supervise.status())
    };
    assert!(through(Kind::NoReflex).0 > 0.399);
    assert!(through(Kind::Fields).0 < 0.01);
}

/// A robot that is at its target, and not known to rest for a while, as after a gap in the readings, has not missed
/// it; one that is done elsewhere has, a second later.
#[test]
fn a_reached_target_is_not_missed_while_the_speed_is_unknown() {
    let end = |q: f64| {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        let commit =
            Commit { agent: "a".into(), target: Target { motors: vec![0], q: vec![0.2], speed: 0.5 }, speeds: None };
        cell.on(SuperviseIn::Commit(commit), cell.now);
        let mut status = Vec::new();
        for (k, speed) in (1..=121).map(|k| (k, if k <= 120 { f64::INFINITY } else { 0.0 })) {
            let at = cell.now + Duration::from_millis(10) * k;
            let sample =
                Sample { seq: 100 + u64::from(k), at, q: vec![q].into(), done: vec![true], ..Sample::default() };
            let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
            (pulse.speed, pulse.free) = (speed, true);
            cell.on(SuperviseIn::Pulse(&pulse), at);
            status.push(cell.supervise.status());
        }
        (status[119], status[120])
    };
    assert_eq!(end(0.2), (Status::Moving, Status::Rest));
    assert_eq!(end(0.1).0, Status::Stopping);
}

/// A stop that was lost or ignored is repeated as soon as the readings show no effect.
#[test]
fn a_stop_without_effect_is_repeated() {
    let stops = |brakes: bool| {
        let mut cell = Cell::new();
        cell.apply(Op::Samples(30));
        let out = cell.on(SuperviseIn::Fault("hot".into()), cell.now);
        let mut stop_count = out.iter().filter(|o| is_stop(o)).count();
        for k in 1..=100_u32 {
            let at = cell.now + Duration::from_millis(10) * k;
            let sample =
                Sample { seq: 100 + u64::from(k), at, q: vec![0.0].into(), done: vec![false], ..Sample::default() };
            let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
            pulse.speed = if brakes { 0.5 - 0.005 * f64::from(k) } else { 0.5 };
            stop_count += cell.on(SuperviseIn::Pulse(&pulse), at).iter().filter(|o| is_stop(o)).count();
        }
        stop_count
    };
    assert_eq!(stops(true), 1);
    assert!((4..=5).contains(&stops(false)), "{}", stops(false));
}

fn is_stop(out: &SuperviseOut) -> bool {
    matches!(out, SuperviseOut::Command(_, Writer::Supervise, Command::Stop { motors }) if motors.is_empty())
}

/// I17: a robot whose readings do not show rest is stopped repeatedly, and gets its outcome when it rests.
#[test]
fn the_reflex_reports_nothing_before_the_robot_rests() {
    let mut reflex = Alone::new(Cell::new().rules);
    let read = |k: u64, speed: f64, reflex: &mut Alone| {
        let at = Time::ZERO + Duration::from_millis(10) * k as u32;
        let sample = Sample { seq: k, at, q: vec![0.0].into(), done: vec![true], ..Sample::default() };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        pulse.speed = speed;
        reflex.read(&mut pulse, None, Status::Stopping, at)
    };
    let safe = Some(crate::ledger::SafePose { since: Time::ZERO, q: vec![0.0].into() });
    let motion = Underway::of_one_motor(1, safe);
    let roll_back = ReflexIn::RollBack { token: reflex.gate.close(), motion, again: false };
    reflex.on(roll_back, Time::ZERO);
    let (mut stops, mut given_up) = (0, 0);
    for k in 1..1000 {
        for out in read(k, 0.1, &mut reflex) {
            match out {
                ReflexOut::Command(_, Command::Stop { .. }) => stops += 1,
                ReflexOut::Event(Event::RetreatStopped { .. }) => given_up += 1,
                other => panic!("{other:?} at step {k}, in motion"),
            }
        }
    }
    // each time that the readings have shown no effect for a while
    assert_eq!((stops / 10, given_up), (4, 1), "{stops}");
    let rests: Vec<ReflexOut> = (1000..1100).flat_map(|k| read(k, 0.0, &mut reflex)).collect();
    assert!(
        matches!(
            rests.as_slice(),
            [ReflexOut::Command(..), ReflexOut::ReflexReport(ReflexReport::GaveUp(Hold::RetreatMissed))]
        ),
        "{rests:?}"
    );
}

/// A board that answers more slowly than its stated latency is not moved: everything computed from its latency would
/// be wrong.
#[test]
fn the_filter_does_not_open_while_the_board_answers_too_slowly() {
    let mut cell = Cell::new();
    let mut read = |k: u32, over_ms: u64| {
        let at = Time::ZERO + Duration::from_millis(10) * k;
        let sample = Sample { seq: u64::from(k), at, q: vec![0.0].into(), done: vec![true], ..Sample::default() };
        let mut pulse = crate::pulse::Pulse::new(sample, &Vec::new().into());
        let most = cell.rules.latency + Duration::from_millis(over_ms);
        pulse.answers = Some(AnswerTime { median: most, most, greatest: Duration::from_secs(1) });
        (pulse.speed, pulse.free) = (0.0, true);
        let out = cell.on(SuperviseIn::Pulse(&pulse), at);
        let warned = out.iter().filter(|o| matches!(o, SuperviseOut::Event(Event::Warning { .. }))).count();
        let commit =
            Commit { agent: "a".into(), target: Target { motors: vec![0], q: vec![0.0], speed: 0.5 }, speeds: None };
        let verdict = cell.on(SuperviseIn::Commit(commit), at).into_iter().find_map(|o| match o {
            SuperviseOut::Verdict(verdict) => Some(verdict.map_err(|refusal| refusal.code())),
            _ => None,
        });
        let entered = out.iter().filter(|o| matches!(o, SuperviseOut::Event(Event::State { .. }))).count();
        (cell.supervise.status(), [warned, entered], verdict)
    };
    let slow: Vec<_> = (1..60).map(|k| read(k, 20)).collect();
    assert_eq!(slow.last(), Some(&(Status::Holding(Hold::SlowBoard), [0, 0], Some(Err("holding")))));
    for kind in 0..2 {
        assert_eq!(slow.iter().map(|(_, all, _)| all[kind]).sum::<usize>(), 1, "it is reported once");
    }
    assert_eq!(read(60, 0).0, Status::Moving, "it opens, and the commit is taken");
}
