//! Causes of a closing, escapes, and the contacts from which an agent may learn. Retreats: `retreating/tests.rs`.

use crate::gate::Gate;
use crate::joint_retreat::JointRetreat;
use crate::joint_retreat::tests::{PERIOD, rules};
use crate::ledger::{Motion, Open, SafePose, TransactionState, Underway};
use crate::look_ahead::Foreseen;
use crate::pulse::Pulse;
use crate::reflex::{ReflexCore, ReflexIn, ReflexOut};
use crate::{Rules, Shared};
use mobee_contract::{Cause, Event, Hold, Sample, Status, Time};
use mobee_model::{Contact, Pair, ShapeId};
use std::sync::Arc;
use std::time::Duration;

/// A reflex alone; the test provides the motion in progress.
pub(crate) struct Alone {
    rules: Arc<Rules>,
    pub gate: Gate,
    book: TransactionState,
    pub joint_retreat: JointRetreat,
    pub reflex: ReflexCore,
}

impl Alone {
    pub fn new(rules: Arc<Rules>) -> Alone {
        let (gate, mut book, joint_retreat) = (Gate::default(), TransactionState::new(1), JointRetreat::default());
        let shared = Shared { rules: &rules, gate: &gate, book: &mut book, joint_retreat: &joint_retreat };
        let reflex = ReflexCore::new(0, &shared);
        Alone { rules, gate, book, joint_retreat, reflex }
    }

    /// Performs a step.
    pub fn on(&mut self, input: ReflexIn, now: Time) -> Vec<ReflexOut> {
        let Alone { rules, gate, book, joint_retreat, reflex } = self;
        let names = |_: Pair| ("arm".to_string(), "post".to_string());
        reflex.on(input, now, &Shared { rules, gate, book, joint_retreat }, &names)
    }

    /// A reading during this motion.
    pub fn read(&mut self, pulse: &mut Pulse, motion: Option<&Underway>, status: Status, now: Time) -> Vec<ReflexOut> {
        self.book.status = status;
        self.book.open = motion.map(|Underway { id, safe, named, places, extent, .. }| {
            self.book.places = places.clone();
            let (target, named, safe) = (pulse.sample.q.clone(), named.clone(), safe.clone());
            let (agent, motion) = ("a".into(), Motion::Move { due: now });
            Open {
                id: *id,
                agent,
                target,
                named,
                safe,
                since: now,
                motion,
                cause: None,
                retreated: false,
                extent: *extent,
            }
        });
        self.on(ReflexIn::Pulse(pulse), now)
    }
}

/// Time, ms, in which an escape is stopped if a constraint is violated by this many degrees on its way.
fn stopped(by: impl Fn(u64) -> Option<f64>) -> Option<u64> {
    one_of_them_stopped(|_| 1, by)
}

/// The same for several escapes, one after the other.
fn one_of_them_stopped(which: impl Fn(u64) -> u64, by: impl Fn(u64) -> Option<f64>) -> Option<u64> {
    let mut reflex = Alone::new(rules(true));
    let motion = |id| Underway::of_one_motor(id, None);
    let read = |reflex: &mut Alone, ms: u64, status: Status, motion: Option<&Underway>| {
        let at = Time::from_secs(5.0) + Duration::from_millis(ms);
        let sample = Sample { seq: ms, at, q: vec![0.0].into(), done: vec![false], ..Sample::default() };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        (pulse.violated, pulse.depth) = (by(ms).map(|_| (0, 0)), by(ms).unwrap_or(0.0));
        let out = reflex.read(&mut pulse, motion, status, at);
        out.iter().any(|o| matches!(o, ReflexOut::Closed { .. }))
    };
    read(&mut reflex, 0, Status::Rest, None);
    reflex.gate.open(reflex.gate.token()).unwrap();
    (1..300).map(|k| 10 * k).find(|ms| read(&mut reflex, *ms, Status::Escaping, Some(&motion(which(*ms)))))
}

/// An escape may violate a constraint as deeply as when it set out, and by encoder noise; an escape that set out
/// without a violation may violate none.
#[test]
fn an_escape_violates_nothing_more_deeply() {
    assert_eq!(stopped(|_| None), None);
    assert_eq!(stopped(|_| Some(3.0)), None, "it may be long on its way out");
    assert_eq!(stopped(|ms| (ms >= 100).then_some(0.0)), Some(100), "it was free");
    assert_eq!(stopped(|ms| (ms % 20 > 0).then_some(0.05)), None, "noise at the bound");
    assert_eq!(stopped(|ms| Some(if ms < 100 { 3.0 } else { 3.09 })), None);
    assert_eq!(stopped(|ms| Some(if ms < 100 { 3.0 } else { 3.11 })), Some(100));
    assert_eq!(stopped(|ms| Some(1e-3 * ms as f64)), Some(120), "however slowly it goes on");
    let two = |ms| 1 + u64::from(ms >= 100);
    let deep = |ms| if ms < 100 { Some(3.0) } else { (ms >= 200).then_some(1.0) };
    assert_eq!(one_of_them_stopped(two, deep), Some(200), "the second was free as it set out");
}

/// Contacts for an agent: the present ones; else those of the last motion.
#[test]
fn an_agent_learns_from_what_touched_the_robot() {
    let mut reflex = Alone::new(rules(true));
    reflex.gate.open(reflex.gate.token()).unwrap();
    let motion = Underway::of_one_motor(1, None);
    let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
    let mut read = |ms: u64, mm: Option<f64>| {
        let at = Time::from_secs(5.0) + Duration::from_millis(ms);
        let near = mm.map(|mm| Contact { pair, distance: mm * 1e-3, points: Default::default() });
        let sample = Sample { seq: ms, at, q: vec![0.0].into(), done: vec![false], ..Sample::default() };
        let mut pulse = Pulse::new(sample, &near.into_iter().collect::<Vec<_>>().into());
        reflex.read(&mut pulse, Some(&motion), Status::Moving, at);
        let mm = |c: &Contact| (c.distance * 1e3).round() as i32;
        (reflex.reflex.seen().iter().map(mm).collect::<Vec<_>>(), reflex.reflex.present().len())
    };
    assert_eq!(read(0, None), (vec![], 0));
    assert_eq!(read(10, Some(9.0)), (vec![9], 1));
    assert_eq!(read(20, Some(7.0)), (vec![7], 1), "as near as it is now");
    assert_eq!(read(30, None), (vec![9], 0), "as it began");
}

/// An agent learns from the contacts of a motion until the next motion.
#[test]
fn the_contacts_for_an_agent_are_those_of_the_last_motion() {
    let mut reflex = Alone::new(rules(true));
    let mut read = |k: u64, commit: u64, object: Option<u32>| {
        let at = Time::from_secs(5.0) + PERIOD * k as u32;
        let sample = Sample { seq: k, at, q: vec![0.0].into(), done: vec![false], ..Sample::default() };
        let pair = |object| (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object, shape: 0 });
        let near = object.map(|o| Contact { pair: pair(o), distance: 0.001, points: Default::default() });
        let mut pulse = Pulse::new(sample, &near.into_iter().collect());
        let motion = Underway::of_one_motor(commit, None);
        reflex.read(&mut pulse, Some(&motion), Status::Moving, at);
        reflex.reflex.seen().iter().map(|c| c.pair.1).collect::<Vec<_>>()
    };
    let object = |object: u32| vec![ShapeId::Object { object, shape: 0 }];
    assert!(read(1, 1, None).is_empty());
    assert_eq!(read(2, 1, Some(7)), object(7));
    assert_eq!((3..200).map(|k| read(k, 1, None)).last(), Some(object(7)));
    assert_eq!((200..400).map(|k| read(k, 2, None)).last(), Some(vec![]), "another motion, which met nothing");
    assert_eq!(read(400, 2, Some(8)), object(8));
    assert_eq!((401..600).map(|k| read(k, 2, None)).last(), Some(object(8)));
}

/// A violated constraint closes the filter, whether anything moves or not.
#[test]
fn a_constraint_that_is_violated_at_rest_closes_the_filter() {
    let mut reflex = Alone::new(rules(true));
    reflex.gate.open(reflex.gate.token()).unwrap();
    let mut closed = |k: u64, violated: bool| {
        let sample = Sample {
            seq: k,
            at: Time::ZERO + PERIOD * k as u32,
            q: vec![0.0].into(),
            done: vec![true],
            ..Sample::default()
        };
        let (at, mut pulse) = (sample.at, Pulse::new(sample, &Vec::new().into()));
        (pulse.speed, pulse.violated) = (0.0, violated.then_some((0, 0)));
        let out = reflex.read(&mut pulse, None, Status::Rest, at);
        (out.iter().any(|o| matches!(o, ReflexOut::Closed { .. })), reflex.gate.is_open())
    };
    assert_eq!(closed(1, false), (false, true));
    assert_eq!(closed(2, true), (true, false));
}

/// The distances of a reading are reported as contacts of this robot; distance zero as caused by it, unless it
/// rested.
#[test]
fn a_contact_is_reported_with_its_robot() {
    for (status, driven) in [(Status::Moving, true), (Status::Rest, false), (Status::Holding(Hold::Stale), false)] {
        let mut reflex = Alone::new(rules(true));
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let near = Contact { pair, distance: -0.001, points: Default::default() };
        let sample =
            Sample { seq: 1, at: Time::from_secs(5.0), q: vec![0.0].into(), done: vec![false], ..Sample::default() };
        let (at, mut pulse) = (sample.at, Pulse::new(sample, &vec![near].into()));
        let out = reflex.read(&mut pulse, None, status, at);
        let began = |o: &ReflexOut| matches!(o, ReflexOut::Event(Event::ContactBegan { robot, .. }) if robot == "arm");
        let hard = |o: &ReflexOut| matches!(o, ReflexOut::Event(Event::HardContact { robot, .. }) if robot == "arm");
        assert_eq!((out.iter().any(began), out.iter().any(hard)), (true, driven), "{status:?}: {out:?}");
    }
}

/// A motion that Supervise does not call an escape, or that has a safe pose, is none: a contact closes at once.
#[test]
fn only_an_escape_may_be_in_contact() {
    let closes = |status: Status, safe: Option<f64>| {
        let mut reflex = Alone::new(rules(true));
        reflex.gate.open(reflex.gate.token()).unwrap();
        let safe = safe.map(|q: f64| SafePose { since: Time::ZERO, q: vec![q].into() });
        let motion = Underway::of_one_motor(1, safe);
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let near = Contact { pair, distance: 0.005, points: Default::default() };
        let sample =
            Sample { seq: 1, at: Time::from_secs(5.0), q: vec![0.0].into(), done: vec![false], ..Sample::default() };
        let (at, mut pulse) = (sample.at, Pulse::new(sample, &vec![near].into()));
        reflex.read(&mut pulse, Some(&motion), status, at);
        !reflex.gate.is_open()
    };
    assert!(!closes(Status::Escaping, None), "it sets out in contact");
    assert!(closes(Status::Moving, None) && closes(Status::Escaping, Some(0.0)) && closes(Status::Moving, Some(0.0)));
}

/// A foreseen contact stops a motion, and its agent learns from it. It does not affect a robot at rest, or an escape,
/// which has its own rule.
#[test]
fn a_foreseen_contact_stops_a_motion() {
    let closes = |status: Status, safe: Option<f64>, moves: bool| {
        let mut reflex = Alone::new(rules(true));
        reflex.gate.open(reflex.gate.token()).unwrap();
        let safe = safe.map(|q: f64| SafePose { since: Time::ZERO, q: vec![q].into() });
        let motion = Underway::of_one_motor(1, safe);
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let sample =
            Sample { seq: 1, at: Time::from_secs(5.0), q: vec![0.0].into(), done: vec![false], ..Sample::default() };
        let (at, mut pulse) = (sample.at, Pulse::new(sample, &Vec::new().into()));
        let contact = Contact { pair, distance: 0.004, points: Default::default() };
        pulse.foreseen = vec![Foreseen { contact, edited: 0 }].into();
        let out = reflex.read(&mut pulse, moves.then_some(&motion), status, at);
        let foreseen = out.iter().any(|o| matches!(o, ReflexOut::Closed { cause: Cause::Foreseen(_), .. }));
        assert_eq!(reflex.reflex.seen().len(), usize::from(foreseen));
        foreseen && !reflex.gate.is_open()
    };
    assert!(closes(Status::Moving, Some(0.0), true));
    assert!(!closes(Status::Rest, None, false) && !closes(Status::Escaping, None, true));
}
