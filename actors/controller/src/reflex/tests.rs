//! Escapes, and retreats from the stop to the end.

use crate::gate::Gate;
use crate::joint_retreat::JointRetreat;
use crate::joint_retreat::tests::{PERIOD, recorded, rules};
use crate::ledger::{Motion, Open, SafePose, TransactionState, Underway};
use crate::look_ahead::Foreseen;
use crate::pulse::Pulse;
use crate::reflex::{ReflexCore, ReflexIn, ReflexOut, ReflexReport};
use crate::{Rules, Shared};
use mobee_contract::{Cause, Command, CommitId, Event, Hold, Sample, Status, Time};
use mobee_model::{Contact, Pair, ShapeId};
use std::sync::Arc;
use std::time::Duration;

/// A reflex alone: its test says what is under way.
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

    /// One step.
    pub fn on(&mut self, input: ReflexIn, now: Time) -> Vec<ReflexOut> {
        let Alone { rules, gate, book, joint_retreat, reflex } = self;
        let names = |_: Pair| ("arm".to_string(), "post".to_string());
        reflex.on(input, now, &Shared { rules, gate, book, joint_retreat }, &names)
    }

    /// A reading while this is under way.
    pub fn read(&mut self, pulse: &mut Pulse, motion: Option<&Underway>, status: Status, now: Time) -> Vec<ReflexOut> {
        self.book.status = status;
        self.book.open = motion.map(|Underway { id, safe, named, places }| {
            self.book.places = places.clone();
            let (target, named, safe) = (pulse.sample.q.clone(), named.clone(), safe.clone());
            let (agent, motion) = ("a".into(), Motion::Move { due: now });
            Open { id: *id, agent, target, named, safe, since: now, motion, cause: None, retreated: false }
        });
        self.on(ReflexIn::Pulse(pulse), now)
    }
}

/// In how many milliseconds an escape is stopped, if a constraint is violated by so many degrees on its way.
fn stopped(by: impl Fn(u64) -> Option<f64>) -> Option<u64> {
    one_of_them_stopped(|_| 1, by)
}

/// The same of more escapes, one after the other.
fn one_of_them_stopped(which: impl Fn(u64) -> u64, by: impl Fn(u64) -> Option<f64>) -> Option<u64> {
    let mut reflex = Alone::new(rules(true));
    let motion = |id| Underway { id: CommitId(id), safe: None, named: vec![0].into(), places: vec![None].into() };
    let read = |reflex: &mut Alone, ms: u64, status: Status, motion: Option<&Underway>| {
        let at = Time::from_secs(5.0) + Duration::from_millis(ms);
        let sample = Sample { seq: ms, at, q: vec![0.0].into(), done: vec![false] };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        (pulse.violated, pulse.depth) = (by(ms).map(|_| (0, 0)), by(ms).unwrap_or(0.0));
        let out = reflex.read(&mut pulse, motion, status, at);
        out.iter().any(|o| matches!(o, ReflexOut::Closed { .. }))
    };
    read(&mut reflex, 0, Status::Rest, None);
    reflex.gate.open(reflex.gate.token()).unwrap();
    (1..300).map(|k| 10 * k).find(|ms| read(&mut reflex, *ms, Status::Escaping, Some(&motion(which(*ms)))))
}

/// An escape may violate a constraint as deeply as it did when it set out, and to the noise of encoders; one that set out violating
/// none may violate none.
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

/// What an agent may learn from: what touches the robot now, as it does now; else what touched it during the last motion.
#[test]
fn an_agent_learns_from_what_touched_the_robot() {
    let mut reflex = Alone::new(rules(true));
    reflex.gate.open(reflex.gate.token()).unwrap();
    let motion = Underway { id: CommitId(1), safe: None, named: vec![0].into(), places: vec![None].into() };
    let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
    let mut read = |ms: u64, mm: Option<f64>| {
        let at = Time::from_secs(5.0) + Duration::from_millis(ms);
        let near = mm.map(|mm| Contact { pair, distance: mm * 1e-3, points: Default::default() });
        let sample = Sample { seq: ms, at, q: vec![0.0].into(), done: vec![false] };
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

/// What is wrong with a reading during the retreat.
#[derive(Clone, Copy, Default)]
struct Wrong {
    /// The encoders tell what they told before.
    frozen: bool,
    violated: bool,
    /// Something is a millimeter away.
    near: bool,
    /// It does not go where it is sent, and its encoders tell.
    stuck: bool,
    /// It moves as fast as counts as rest just no more.
    restless: bool,
    /// It counts as being at rest all the time.
    calm: bool,
    /// It would come to half a millimeter of something that was put there.
    ahead: bool,
    /// Another robot is a millimeter away.
    met: bool,
    /// The other robot was stopped, and is about to be taken back.
    stopped: bool,
}

/// A robot is taken back over 90 degrees, which takes 3 s: what is told of it, each with its reading (every 10 ms), and why it was stopped.
fn taken_back(wrong: impl Fn(u64, Option<&ReflexReport>) -> Wrong) -> (Vec<(u64, ReflexReport)>, Option<String>) {
    let who = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (4.0, 90.0), (5.0, 90.0)], 0.5);
    let mut reflex = Alone::new(rules(true));
    let (mut q, mut told, mut why) = (90_f64.to_radians(), Vec::new(), None);
    let (mut goal, mut unchanged) = (q, Time::ZERO);
    let mut read = |k: u64, reflex: &mut Alone, last: Option<&ReflexReport>, goal: f64| {
        let (at, wrong) = (Time::from_secs(5.0) + PERIOD * k as u32, wrong(k, last));
        let moves = goal != q && !wrong.frozen && !wrong.stuck;
        if moves {
            q = goal;
        }
        if moves || wrong.stuck {
            unchanged = at;
        }
        let sample = Sample { seq: k, at, q: vec![q].into(), done: vec![true] };
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let near = Contact { pair, distance: 0.001, points: Default::default() };
        let robot = Contact { pair: (pair.0, ShapeId::Robot { robot: 1, node: 0, shape: 0 }), ..near };
        let contacts = wrong.near.then_some(near).into_iter().chain(wrong.met.then_some(robot));
        let mut pulse = Pulse::new(sample, &contacts.collect());
        if wrong.stopped {
            reflex.joint_retreat.coming(1, at);
        } else {
            reflex.joint_retreat.leave(1);
        }
        let speed = if wrong.restless { rules(true).rest_speed } else { 0.0 };
        (pulse.speed, pulse.unchanged) = (if moves && !wrong.calm { 0.5 } else { speed }, unchanged);
        pulse.violated = wrong.violated.then_some((0, 0));
        if wrong.ahead {
            let contact = Contact { distance: 0.0005, ..near };
            pulse.foreseen = vec![Foreseen { contact, edited: 1 }].into();
        }
        reflex.read(&mut pulse, None, Status::Stopping, at)
    };
    read(0, &mut reflex, None, goal);
    let safe = Some(SafePose { since: who.past[who.start].at, q: who.safe.clone() });
    let motion = Underway { id: CommitId(1), safe, named: vec![0].into(), places: vec![None].into() };
    let roll_back = ReflexIn::RollBack { token: reflex.gate.close(), motion, again: false };
    reflex.on(roll_back, Time::from_secs(5.0));
    for k in 1..1500 {
        let mut out = read(k, &mut reflex, told.last().map(|(_, word)| word), goal);
        while let Some(i) = out.iter().position(|o| matches!(o, ReflexOut::Bring(_))) {
            out.remove(i);
            let at = Time::from_secs(5.0) + PERIOD * k as u32;
            reflex.joint_retreat.enroll(who.clone(), at);
            out.extend(reflex.on(ReflexIn::Brought(Ok(())), at));
        }
        for out in out {
            match out {
                ReflexOut::Command(_, Command::Direct { q, .. }) => goal = q[0],
                ReflexOut::ReflexReport(word) => told.push((k, word)),
                ReflexOut::Event(Event::RetreatStopped { what, .. }) => why = why.or(Some(what)),
                _ => {}
            }
        }
    }
    (told, why)
}

#[test]
fn a_retreat_is_told_from_its_stop_to_its_end() {
    let (told, why) = taken_back(|_, _| Wrong::default());
    let words: Vec<&ReflexReport> = told.iter().map(|(_, word)| word).collect();
    assert_eq!((words, why), (vec![&ReflexReport::Retreating, &ReflexReport::Settling, &ReflexReport::Back], None));
    // it may set out once the stop surely shows, and takes as long as the way there
    assert_eq!(told[0].0, 2);
    assert!((295..320).contains(&(told[1].0 - told[0].0)), "{told:?}");
    // as long as its last set-point may take to show, it may still be on its way, however calm it looks
    let (told, _) = taken_back(|_, _| Wrong { calm: true, ..Wrong::default() });
    let last = rules(true).reaction().as_millis() as u64 / PERIOD.as_millis() as u64;
    assert!((last..=last + 1).contains(&(told[2].0 - told[1].0)), "{told:?}");
}

#[test]
fn a_retreat_behind_frozen_encoders_is_given_up() {
    let (told, why) = taken_back(|k, _| Wrong { frozen: (100..130).contains(&k), ..Wrong::default() });
    assert_eq!((told.last().map(|(_, word)| word), why), (Some(&ReflexReport::Back), None), "0.3 s are not long");
    let (told, why) = taken_back(|k, _| Wrong { frozen: k >= 100, ..Wrong::default() });
    let (k, word) = told.last().unwrap();
    assert_eq!(
        (word, why.as_deref()),
        (&ReflexReport::GaveUp(Hold::Stale), Some("the encoders do not follow the set-points"))
    );
    assert!((150..156).contains(k), "after half a second: {told:?}");
}

#[test]
fn a_retreat_stops_at_what_is_new_in_it() {
    let blocked = Some(&ReflexReport::GaveUp(Hold::RetreatBlocked));
    let at = |from: u64| move |k: u64, _: Option<&ReflexReport>| Wrong { violated: k >= from, ..Wrong::default() };
    let (told, why) = taken_back(at(100));
    assert_eq!((told.last().map(|(_, w)| w), why.as_deref()), (blocked, Some("a constraint would be violated")));
    assert!(told.last().is_some_and(|(k, _)| *k < 110), "at once: {told:?}");
    let (told, why) = taken_back(at(0));
    assert_eq!((told.last().map(|(_, w)| w), why), (Some(&ReflexReport::Back), None), "it was violated from the start");
    let (told, why) = taken_back(|k, _| Wrong { ahead: k >= 100, ..Wrong::default() });
    assert_eq!((told.last().map(|(_, w)| w), why.as_deref()), (blocked, Some("arm and post are at 0.5 mm")));
    // where it settles, too
    let settling = |what: fn(bool) -> Wrong| {
        let (told, why) = taken_back(move |_, last| what(last == Some(&ReflexReport::Settling)));
        (told.last().map(|(_, w)| w.clone()), why)
    };
    let violated = settling(|there| Wrong { violated: there, ..Wrong::default() });
    assert_eq!((violated.0.as_ref(), violated.1.as_deref()), (blocked, Some("a constraint would be violated")));
    let near = settling(|there| Wrong { near: there, ..Wrong::default() });
    assert_eq!((near.0.as_ref(), near.1.as_deref()), (blocked, Some("arm and post are at 1.0 mm")));
}

/// A robot that came into the way, and is taken back itself, is waited for, so often; one that is not is given a moment to stop.
#[test]
fn a_retreat_waits_for_a_robot_that_makes_room() {
    let ends = |wrong: &dyn Fn(u64) -> (bool, bool)| {
        let (told, why) = taken_back(|k, _| {
            let (met, stopped) = wrong(k);
            Wrong { met, stopped, ..Wrong::default() }
        });
        (told, why.unwrap_or_default())
    };
    let (told, why) = ends(&|k| ((100..200).contains(&k), (101..250).contains(&k)));
    let words: Vec<&ReflexReport> = told.iter().map(|(_, word)| word).collect();
    assert_eq!(
        (words, why),
        (vec![&ReflexReport::Retreating, &ReflexReport::Settling, &ReflexReport::Back], String::new())
    );
    assert!((460..480).contains(&(told[1].0 - told[0].0)), "until it is gone, gently, and back: {told:?}");
    let given_up = |(told, why): (Vec<(u64, ReflexReport)>, String)| {
        assert_eq!(
            (&told.last().unwrap().1, &*why),
            (&ReflexReport::GaveUp(Hold::RetreatBlocked), "arm and post are at 1.0 mm")
        );
        told.last().unwrap().0
    };
    let alone = given_up(ends(&|k| (k >= 100, false)));
    assert!((1100..1106).contains(&alone), "it stays: {alone}");
    let stays = given_up(ends(&|k| (k >= 100, (100..300).contains(&k))));
    assert!((1299..1306).contains(&stays), "it gave up: {stays}");
    let again = |k: u64| k >= 100 && k % 20 < 10;
    let often = given_up(ends(&|k| (again(k), again(k))));
    assert!((200..206).contains(&often), "the sixth time: {often}");
}

/// What does not come to rest is not taken back, and nothing is said of it before it rests.
#[test]
fn a_retreat_waits_for_rest_three_seconds() {
    let rests = |from: u64| taken_back(move |k, _| Wrong { restless: k < from, ..Wrong::default() });
    let (told, why) = rests(299);
    assert_eq!(
        (told.first(), told.last().map(|(_, w)| w), why),
        (Some(&(299, ReflexReport::Retreating)), Some(&ReflexReport::Back), None)
    );
    let (told, why) = rests(900);
    assert_eq!(told, [(900, ReflexReport::GaveUp(Hold::RetreatMissed))]);
    assert_eq!(why.as_deref(), Some("the robot did not come to rest in time"));
}

/// Who does not follow is given three seconds, on the way and at its end.
#[test]
fn a_retreat_that_is_not_followed_is_missed() {
    let missed = Some(&ReflexReport::GaveUp(Hold::RetreatMissed));
    let (told, why) = taken_back(|k, _| Wrong { stuck: k > 0, ..Wrong::default() });
    assert_eq!(told.last().map(|(_, w)| w), missed, "{told:?}");
    assert_eq!(why.as_deref(), Some("the robot does not follow the set-points"));
    // at rest beside its end, or restless there: it has three seconds from when it is to be there
    let ends = |from: u64, wrong: Wrong| {
        taken_back(
            move |k, last| if last == Some(&ReflexReport::Settling) && k < from { wrong } else { Wrong::default() },
        )
    };
    let restless = Wrong { restless: true, ..Wrong::default() };
    assert_eq!(ends(500, restless).0.last(), Some(&(500, ReflexReport::Back)));
    let (told, why) = ends(900, restless);
    assert_eq!((told.last().map(|(_, w)| w), why.as_deref()), (missed, Some("the safe pose was not reached in time")));
}

/// What a motion met is what its agent may learn from, until the next motion.
#[test]
fn what_an_agent_may_learn_from_is_of_the_last_motion() {
    let mut reflex = Alone::new(rules(true));
    let mut read = |k: u64, commit: u64, object: Option<u32>| {
        let at = Time::from_secs(5.0) + PERIOD * k as u32;
        let sample = Sample { seq: k, at, q: vec![0.0].into(), done: vec![false] };
        let pair = |object| (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object, shape: 0 });
        let near = object.map(|o| Contact { pair: pair(o), distance: 0.001, points: Default::default() });
        let mut pulse = Pulse::new(sample, &near.into_iter().collect());
        let motion = Underway { id: CommitId(commit), safe: None, named: vec![0].into(), places: vec![None].into() };
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

/// Who went along is lost: the robot stops, and asks for a way of its own.
#[test]
fn who_is_left_alone_tries_again_by_itself() {
    let turns = [(0.0, 0.0), (1.0, 0.0), (4.0, 40.0), (5.0, 40.0)];
    let [first, second] = [0, 1].map(|robot| recorded(robot, true, &turns, 0.5));
    let (mut reflex, start) = (Alone::new(rules(true)), Time::from_secs(5.0));
    let safe = Some(SafePose { since: first.past[first.start].at, q: first.safe.clone() });
    let motion = Underway { id: CommitId(1), safe, named: vec![0].into(), places: vec![None].into() };
    reflex.joint_retreat.enroll(second, start);
    let token = reflex.gate.close();
    reflex.on(ReflexIn::RollBack { token, motion, again: false }, start);
    let (mut q, mut asked) = (40_f64.to_radians(), Vec::new());
    for k in 1..200 {
        let at = start + PERIOD * k;
        let sample = Sample { seq: u64::from(k), at, q: vec![q].into(), done: vec![true] };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        pulse.speed = 0.0;
        let mut out = reflex.read(&mut pulse, None, Status::Stopping, at);
        while let Some(i) = out.iter().position(|o| matches!(o, ReflexOut::Bring(_))) {
            let ReflexOut::Bring(bring) = out.remove(i) else { continue };
            asked.push((k, bring.again));
            reflex.joint_retreat.enroll(crate::joint_retreat::Participant { again: bring.again, ..first.clone() }, at);
            out.extend(reflex.on(ReflexIn::Brought(Ok(())), at));
        }
        for out in out {
            if let ReflexOut::Command(_, Command::Direct { q: to, .. }) = out {
                q = to[0];
            }
        }
    }
    assert!(matches!(asked[..], [(2, false), (100..=110, true)]), "{asked:?}");
}

/// A constraint that is violated closes the filter, whether anything moves or not.
#[test]
fn a_constraint_that_is_violated_at_rest_closes_the_filter() {
    let mut reflex = Alone::new(rules(true));
    reflex.gate.open(reflex.gate.token()).unwrap();
    let mut closed = |k: u64, violated: bool| {
        let sample = Sample { seq: k, at: Time::ZERO + PERIOD * k as u32, q: vec![0.0].into(), done: vec![true] };
        let (at, mut pulse) = (sample.at, Pulse::new(sample, &Vec::new().into()));
        (pulse.speed, pulse.violated) = (0.0, violated.then_some((0, 0)));
        let out = reflex.read(&mut pulse, None, Status::Rest, at);
        (out.iter().any(|o| matches!(o, ReflexOut::Closed { .. })), reflex.gate.is_open())
    };
    assert_eq!(closed(1, false), (false, true));
    assert_eq!(closed(2, true), (true, false));
}

/// The distances of a reading are told as contacts of this robot; distance zero as one that it drove into, unless it rested.
#[test]
fn what_touches_is_told_with_the_robot_that_it_touches() {
    for (status, driven) in [(Status::Moving, true), (Status::Rest, false), (Status::Holding(Hold::Stale), false)] {
        let mut reflex = Alone::new(rules(true));
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let near = Contact { pair, distance: -0.001, points: Default::default() };
        let sample = Sample { seq: 1, at: Time::from_secs(5.0), q: vec![0.0].into(), done: vec![false] };
        let (at, mut pulse) = (sample.at, Pulse::new(sample, &vec![near].into()));
        let out = reflex.read(&mut pulse, None, status, at);
        let began = |o: &ReflexOut| matches!(o, ReflexOut::Event(Event::ContactBegan { robot, .. }) if robot == "arm");
        let hard = |o: &ReflexOut| matches!(o, ReflexOut::Event(Event::HardContact { robot, .. }) if robot == "arm");
        assert_eq!((out.iter().any(began), out.iter().any(hard)), (true, driven), "{status:?}: {out:?}");
    }
}

/// What supervise does not call an escape is none, and what has a safe pose is none either: a contact closes at once.
#[test]
fn only_an_escape_may_be_in_contact() {
    let closes = |status: Status, safe: Option<f64>| {
        let mut reflex = Alone::new(rules(true));
        reflex.gate.open(reflex.gate.token()).unwrap();
        let safe = safe.map(|q: f64| SafePose { since: Time::ZERO, q: vec![q].into() });
        let motion = Underway { id: CommitId(1), safe, named: vec![0].into(), places: vec![None].into() };
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let near = Contact { pair, distance: 0.005, points: Default::default() };
        let sample = Sample { seq: 1, at: Time::from_secs(5.0), q: vec![0.0].into(), done: vec![false] };
        let (at, mut pulse) = (sample.at, Pulse::new(sample, &vec![near].into()));
        reflex.read(&mut pulse, Some(&motion), status, at);
        !reflex.gate.is_open()
    };
    assert!(!closes(Status::Escaping, None), "it sets out in contact");
    assert!(closes(Status::Moving, None) && closes(Status::Escaping, Some(0.0)) && closes(Status::Moving, Some(0.0)));
}

/// What is foreseen stops a motion, and is what its agent learns from. A robot at rest goes nowhere, and an escape goes where its own rule
/// lets it.
#[test]
fn what_is_foreseen_stops_a_motion() {
    let closes = |status: Status, safe: Option<f64>, moves: bool| {
        let mut reflex = Alone::new(rules(true));
        reflex.gate.open(reflex.gate.token()).unwrap();
        let safe = safe.map(|q: f64| SafePose { since: Time::ZERO, q: vec![q].into() });
        let motion = Underway { id: CommitId(1), safe, named: vec![0].into(), places: vec![None].into() };
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let sample = Sample { seq: 1, at: Time::from_secs(5.0), q: vec![0.0].into(), done: vec![false] };
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

/// A robot that becomes slower all the time, and does not come to rest, is stopped again every three seconds.
#[test]
fn who_does_not_come_to_rest_is_stopped_again() {
    let (mut reflex, begun) = (Alone::new(rules(true)), Time::from_secs(5.0));
    let motion = Underway { id: CommitId(1), safe: None, named: vec![0].into(), places: vec![None].into() };
    let token = reflex.gate.close();
    reflex.on(ReflexIn::RollBack { token, motion, again: false }, begun);
    let stops = (1..650).filter(|k| {
        let at = begun + PERIOD * *k;
        let sample = Sample { seq: u64::from(*k), at, q: vec![0.0].into(), done: vec![false] };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        pulse.speed = 0.994_f64.powi(*k as i32).max(2.0 * rules(true).rest_speed);
        let out = reflex.read(&mut pulse, None, Status::Stopping, at);
        out.iter().any(|o| matches!(o, ReflexOut::Command(_, Command::Stop { .. })))
    });
    assert_eq!(stops.collect::<Vec<_>>(), [300, 600]);
}
