//! Retreats from the stop to the end.

use super::{CREEP_TIME, is_held};
use crate::Rules;
use crate::joint_retreat::tests::{PERIOD, recorded, rules};
use crate::joint_retreat::{JointRetreat, Participant, RetreatReply};
use crate::ledger::{SafePose, Underway};
use crate::look_ahead::Foreseen;
use crate::pulse::Pulse;
use crate::reflex::tests::Alone;
use crate::reflex::{ReflexIn, ReflexOut, ReflexReport};
use mobee_contract::{Axis, Command, Event, Hold, Sample, Status, Time};
use mobee_model::{Contact, ShapeId};
use std::cell::Cell;
use std::ops::Range;
use std::sync::Arc;

/// Disturbance of the readings during the retreat.
#[derive(Clone, Copy, Default)]
struct Wrong {
    /// The encoders repeat their last values.
    frozen: bool,
    violated: bool,
    /// An object is a millimeter away.
    near: bool,
    /// The robot does not follow its set-points, and its encoders show it.
    stuck: bool,
    /// The robot moves just below the rest speed.
    restless: bool,
    /// The robot counts as resting all the time.
    calm: bool,
    /// The robot would come to half a millimeter of an object that was placed there.
    ahead: bool,
    /// The robot would come to half a millimeter of another robot.
    meets: bool,
    /// Another robot is a millimeter away.
    met: bool,
    /// The other robot was stopped, and is about to retreat.
    stopped: bool,
}

/// Retreats a robot over 90 degrees, which takes 3 s. Returns its reports, each with its reading (every 10 ms), and
/// the reason of an abort.
fn taken_back(wrong: impl Fn(u64, Option<&ReflexReport>) -> Wrong) -> (Vec<(u64, ReflexReport)>, Option<String>) {
    let who = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (4.0, 90.0), (5.0, 90.0)], 0.5);
    let mut reflex = Alone::new(rules(true));
    let (mut q, mut reports, mut why) = (90_f64.to_radians(), Vec::new(), None);
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
        let sample = Sample { seq: k, at, q: vec![q].into(), done: vec![true], ..Sample::default() };
        let pair = (ShapeId::Robot { robot: 0, node: 0, shape: 0 }, ShapeId::Object { object: 0, shape: 0 });
        let near = Contact { pair, distance: 0.001, points: Default::default() };
        let robot = Contact { pair: (pair.0, ShapeId::Robot { robot: 1, node: 0, shape: 0 }), ..near };
        let contacts = wrong.near.then_some(near).into_iter().chain(wrong.met.then_some(robot));
        let mut pulse = Pulse::new(sample, &contacts.collect());
        if wrong.stopped {
            reflex.joint_retreat.announce(1, at);
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
        if wrong.meets {
            let contact = Contact { distance: 0.0005, ..robot };
            pulse.foreseen = vec![Foreseen { contact, edited: 0 }].into();
        }
        reflex.read(&mut pulse, None, Status::Stopping, at)
    };
    read(0, &mut reflex, None, goal);
    let safe = Some(SafePose { since: who.past[who.start].at, q: who.safe.clone() });
    let motion = Underway::of_one_motor(1, safe);
    let roll_back = ReflexIn::RollBack { token: reflex.gate.close(), motion, again: false };
    reflex.on(roll_back, Time::from_secs(5.0));
    for k in 1..1500 {
        let mut out = read(k, &mut reflex, reports.last().map(|(_, word)| word), goal);
        while let Some(i) = out.iter().position(|o| matches!(o, ReflexOut::Bring(_))) {
            out.remove(i);
            let at = Time::from_secs(5.0) + PERIOD * k as u32;
            reflex.joint_retreat.enroll(who.clone(), at);
            out.extend(reflex.on(ReflexIn::Brought(Ok(())), at));
        }
        for out in out {
            match out {
                ReflexOut::Command(_, Command::Direct { q, .. }) => goal = q[0],
                ReflexOut::ReflexReport(word) => reports.push((k, word)),
                ReflexOut::Event(Event::RetreatStopped { what, .. }) => why = why.or(Some(what)),
                _ => {}
            }
        }
    }
    (reports, why)
}

#[test]
fn a_retreat_is_reported_from_its_stop_to_its_end() {
    let (reports, why) = taken_back(|_, _| Wrong::default());
    let words: Vec<&ReflexReport> = reports.iter().map(|(_, word)| word).collect();
    assert_eq!((words, why), (vec![&ReflexReport::Retreating, &ReflexReport::Settling, &ReflexReport::Back], None));
    // it may set out once the stop surely shows, and the retreat takes as long as the way there
    assert_eq!(reports[0].0, 2);
    assert!((295..320).contains(&(reports[1].0 - reports[0].0)), "{reports:?}");
    // within the reaction time of its last set-point it may still be moving, even if the readings are at rest
    let (reports, _) = taken_back(|_, _| Wrong { calm: true, ..Wrong::default() });
    let last = rules(true).reaction().as_millis() as u64 / PERIOD.as_millis() as u64;
    assert!((last..=last + 1).contains(&(reports[2].0 - reports[1].0)), "{reports:?}");
}

#[test]
fn a_retreat_behind_frozen_encoders_is_given_up() {
    let (reports, why) = taken_back(|k, _| Wrong { frozen: (100..130).contains(&k), ..Wrong::default() });
    assert_eq!((reports.last().map(|(_, word)| word), why), (Some(&ReflexReport::Back), None), "0.3 s are not long");
    let (reports, why) = taken_back(|k, _| Wrong { frozen: k >= 100, ..Wrong::default() });
    let (k, word) = reports.last().unwrap();
    assert_eq!(
        (word, why.as_deref()),
        (&ReflexReport::GaveUp(Hold::Stale), Some("the encoders do not follow the set-points"))
    );
    assert!((150..156).contains(k), "after half a second: {reports:?}");
}

#[test]
fn a_retreat_stops_at_what_is_new_in_it() {
    let blocked = Some(&ReflexReport::GaveUp(Hold::RetreatBlocked));
    let at = |from: u64| move |k: u64, _: Option<&ReflexReport>| Wrong { violated: k >= from, ..Wrong::default() };
    let (reports, why) = taken_back(at(100));
    assert_eq!((reports.last().map(|(_, w)| w), why.as_deref()), (blocked, Some("a constraint would be violated")));
    assert!(reports.last().is_some_and(|(k, _)| *k < 110), "at once: {reports:?}");
    let (reports, why) = taken_back(at(0));
    assert_eq!(
        (reports.last().map(|(_, w)| w), why),
        (Some(&ReflexReport::Back), None),
        "it was violated from the start"
    );
    let (reports, why) = taken_back(|k, _| Wrong { ahead: k >= 100, ..Wrong::default() });
    assert_eq!((reports.last().map(|(_, w)| w), why.as_deref()), (blocked, Some("arm and post are at 0.5 mm")));
    // also while it settles
    let settling = |what: fn(bool) -> Wrong| {
        let (reports, why) = taken_back(move |_, last| what(last == Some(&ReflexReport::Settling)));
        (reports.last().map(|(_, w)| w.clone()), why)
    };
    let violated = settling(|there| Wrong { violated: there, ..Wrong::default() });
    assert_eq!((violated.0.as_ref(), violated.1.as_deref()), (blocked, Some("a constraint would be violated")));
    let near = settling(|there| Wrong { near: there, ..Wrong::default() });
    assert_eq!((near.0.as_ref(), near.1.as_deref()), (blocked, Some("arm and post are at 1.0 mm")));
}

/// The retreat waits for a robot that blocks it and retreats itself, up to the limit; a blocking robot that does not
/// retreat gets a moment to stop.
#[test]
fn a_retreat_waits_for_a_robot_that_makes_room() {
    let ends = |wrong: &dyn Fn(u64) -> (bool, bool)| {
        let (reports, why) = taken_back(|k, _| {
            let (met, stopped) = wrong(k);
            Wrong { met, stopped, ..Wrong::default() }
        });
        (reports, why.unwrap_or_default())
    };
    let (reports, why) = ends(&|k| ((100..200).contains(&k), (101..250).contains(&k)));
    let words: Vec<&ReflexReport> = reports.iter().map(|(_, word)| word).collect();
    assert_eq!(
        (words, why),
        (vec![&ReflexReport::Retreating, &ReflexReport::Settling, &ReflexReport::Back], String::new())
    );
    assert!((460..480).contains(&(reports[1].0 - reports[0].0)), "until it is gone, gently, and back: {reports:?}");
    let given_up = |(reports, why): (Vec<(u64, ReflexReport)>, String)| {
        assert_eq!(
            (&reports.last().unwrap().1, &*why),
            (&ReflexReport::GaveUp(Hold::RetreatBlocked), "arm and post are at 1.0 mm")
        );
        reports.last().unwrap().0
    };
    let alone = given_up(ends(&|k| (k >= 100, false)));
    assert!((1100..1106).contains(&alone), "it stays: {alone}");
    let stays = given_up(ends(&|k| (k >= 100, (100..300).contains(&k))));
    assert!((1299..1306).contains(&stays), "it gave up: {stays}");
    let again = |k: u64| k >= 100 && k % 20 < 10;
    let often = given_up(ends(&|k| (again(k), again(k))));
    assert!((200..206).contains(&often), "the sixth time: {often}");
}

/// The retreat waits for a robot that it would meet before it is close, and approaches a robot that stays there in
/// steps.
#[test]
fn a_retreat_waits_before_it_meets_a_robot() {
    let (reports, why) = taken_back(|k, _| Wrong { meets: (100..200).contains(&k), ..Wrong::default() });
    let words: Vec<&ReflexReport> = reports.iter().map(|(_, word)| word).collect();
    assert_eq!((words, why), (vec![&ReflexReport::Retreating, &ReflexReport::Settling, &ReflexReport::Back], None));
    let took = reports[1].0 - reports[0].0;
    assert!((395..480).contains(&took), "it stood still for a second: {reports:?}");
    let (reports, why) = taken_back(|k, _| Wrong { meets: (100..400).contains(&k) && k % 20 < 10, ..Wrong::default() });
    assert_eq!((reports.last().map(|(_, word)| word), why), (Some(&ReflexReport::Back), None), "in pieces");
}

/// A robot at its end, about to be readmitted, waits for a robot that drives into it, as on the path.
#[test]
fn a_settling_robot_waits_for_one_that_makes_room() {
    let ends = |met: Range<u64>, stopped: Range<u64>| {
        let settles = Cell::new(None);
        let (reports, why) = taken_back(|k, last| {
            if settles.get().is_none() && last == Some(&ReflexReport::Settling) {
                settles.set(Some(k));
            }
            let since = |range: &Range<u64>| settles.get().is_some_and(|from| range.contains(&(k - from)));
            Wrong { met: since(&met), stopped: since(&stopped), ..Wrong::default() }
        });
        let (at, end) = reports.last().cloned().unwrap();
        (at - settles.get().unwrap(), end, why)
    };
    let (free, ..) = ends(0..0, 0..0);
    let (after, end, why) = ends(0..100, 1..150);
    assert_eq!((end, why), (ReflexReport::Back, None));
    assert!((150..150 + free + 10).contains(&after), "once it is gone: {after}");
    let (after, end, why) = ends(0..5000, 0..0);
    assert_eq!((end, why.as_deref()), (ReflexReport::GaveUp(Hold::RetreatBlocked), Some("arm and post are at 1.0 mm")));
    assert!((1000..1010).contains(&after), "it stays: {after}");
}

/// A robot that does not come to rest does not retreat, and nothing is reported before it rests.
#[test]
fn a_retreat_waits_for_rest_three_seconds() {
    let rests = |from: u64| taken_back(move |k, _| Wrong { restless: k < from, ..Wrong::default() });
    let (reports, why) = rests(299);
    assert_eq!(
        (reports.first(), reports.last().map(|(_, w)| w), why),
        (Some(&(299, ReflexReport::Retreating)), Some(&ReflexReport::Back), None)
    );
    let (reports, why) = rests(900);
    assert_eq!(reports, [(900, ReflexReport::GaveUp(Hold::RetreatMissed))]);
    assert_eq!(why.as_deref(), Some("the robot did not come to rest in time"));
}

/// A robot that does not follow gets three seconds, on the path and at its end.
#[test]
fn a_retreat_that_is_not_followed_is_missed() {
    let missed = Some(&ReflexReport::GaveUp(Hold::RetreatMissed));
    let (reports, why) = taken_back(|k, _| Wrong { stuck: k > 0, ..Wrong::default() });
    assert_eq!(reports.last().map(|(_, w)| w), missed, "{reports:?}");
    assert_eq!(why.as_deref(), Some("the robot does not follow the set-points"));
    // at rest beside its end, or restless there: three seconds from its expected arrival
    let ends = |from: u64, wrong: Wrong| {
        taken_back(
            move |k, last| if last == Some(&ReflexReport::Settling) && k < from { wrong } else { Wrong::default() },
        )
    };
    let restless = Wrong { restless: true, ..Wrong::default() };
    assert_eq!(ends(500, restless).0.last(), Some(&(500, ReflexReport::Back)));
    let (reports, why) = ends(900, restless);
    assert_eq!(
        (reports.last().map(|(_, w)| w), why.as_deref()),
        (missed, Some("the safe pose was not reached in time"))
    );
}

/// Retreats a robot with these contacts in all readings over 40 degrees, while the other one does this. Returns the
/// readings at which it hands over its recording, each with whether that is for a retry.
/// brings what it recorded, and whether that is for another try.
fn requests(
    reflex: &mut Alone,
    who: &Participant,
    contacts: &[Contact],
    other: impl Fn(&JointRetreat, Time),
) -> Vec<(u32, bool)> {
    let start = Time::from_secs(5.0);
    let safe = Some(SafePose { since: who.past[who.start].at, q: who.safe.clone() });
    let motion = Underway::of_one_motor(1, safe);
    let (mut q, mut requests) = (40_f64.to_radians(), Vec::new());
    for k in 0..500 {
        let at = start + PERIOD * k;
        let sample = Sample { seq: u64::from(k), at, q: vec![q].into(), done: vec![true], ..Sample::default() };
        let mut pulse = Pulse::new(sample, &contacts.into());
        pulse.speed = 0.0;
        other(&reflex.joint_retreat, at);
        let mut out = reflex.read(&mut pulse, None, Status::Stopping, at);
        if k == 0 {
            let token = reflex.gate.close();
            out = reflex.on(ReflexIn::RollBack { token, motion: motion.clone(), again: false }, at);
        }
        while let Some(i) = out.iter().position(|o| matches!(o, ReflexOut::Bring(_))) {
            let ReflexOut::Bring(bring) = out.remove(i) else { continue };
            requests.push((k, bring.again));
            reflex.joint_retreat.enroll(Participant { again: bring.again, ..who.clone() }, at);
            out.extend(reflex.on(ReflexIn::Brought(Ok(())), at));
        }
        for out in out {
            if let ReflexOut::Command(_, Command::Direct { q: to, .. }) = out {
                q = to[0];
            }
        }
    }
    requests
}

/// The same robot twice; both are to retreat.
fn two() -> [Participant; 2] {
    [0, 1].map(|robot| recorded(robot, true, &[(0.0, 0.0), (1.0, 0.0), (4.0, 40.0), (5.0, 40.0)], 0.5))
}

/// A robot of the group is lost: this one stops, and requests a path of its own.
#[test]
fn a_robot_left_by_its_group_retries_alone() {
    let ([first, second], mut reflex) = (two(), Alone::new(rules(true)));
    reflex.joint_retreat.enroll(second, Time::from_secs(5.0));
    let requests = requests(&mut reflex, &first, &[], |_, _| ());
    assert!(matches!(requests[..], [(2, false), (100..=110, true)]), "{requests:?}");
}

/// A robot waits on its path for this one, which has touched it all the time, and is back: it is not readmitted, but
/// both request other paths.
#[test]
fn a_blocking_robot_that_is_back_requests_another_path() {
    for waits in [false, true] {
        let ([first, second], mut reflex) = (two(), Alone::new(rules(true)));
        let of = |robot| ShapeId::Robot { robot, node: 0, shape: 0 };
        let contact = Contact { pair: (of(0), of(1)), distance: 0.005, points: Default::default() };
        let begun = Time::from_secs(4.0);
        reflex.joint_retreat.enroll(second, begun);
        assert!((0..20).any(|k| matches!(reflex.joint_retreat.request(1, begun + PERIOD * k), RetreatReply::Go(_))));
        // while it waits, other groups may move
        reflex.joint_retreat.set_waiting(1, Some((if waits { 0 } else { 2 }, begun)));
        // a sign of life of the other one
        let other = |joint_retreat: &JointRetreat, now: Time| {
            let _ = joint_retreat.step(1, 0.0, now);
        };
        let requests = requests(&mut reflex, &first, &[contact], other);
        let replan = requests.get(1).copied();
        assert_eq!(replan.is_some_and(|(k, again)| (300..350).contains(&k) && !again), waits, "{requests:?}");
        assert_eq!(reflex.joint_retreat.must_replan(1, Time::from_secs(10.0)), waits);
    }
}

/// A robot that slows down all the time, and does not come to rest, is stopped again every three seconds.
#[test]
fn a_robot_that_does_not_come_to_rest_is_stopped_again() {
    let (mut reflex, begun) = (Alone::new(rules(true)), Time::from_secs(5.0));
    let motion = Underway::of_one_motor(1, None);
    let token = reflex.gate.close();
    reflex.on(ReflexIn::RollBack { token, motion, again: false }, begun);
    let stops = (1..650).filter(|k| {
        let at = begun + PERIOD * *k;
        let sample = Sample { seq: u64::from(*k), at, q: vec![0.0].into(), done: vec![false], ..Sample::default() };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        pulse.speed = 0.994_f64.powi(*k as i32).max(2.0 * rules(true).rest_speed);
        let out = reflex.read(&mut pulse, None, Status::Stopping, at);
        out.iter().any(|o| matches!(o, ReflexOut::Command(_, Command::Stop { .. })))
    });
    assert_eq!(stops.collect::<Vec<_>>(), [300, 600]);
}

/// A pressing arm creeps along the obstacle: its retreat begins from this low speed. An arm that does not deflect
/// must rest.
#[test]
fn an_arm_that_creeps_while_something_holds_it_counts_as_stopped() {
    let held = |deflection: f64, speed: f64, ms: u64| {
        let of = rules(true);
        let axes = of.axes.iter().map(|axis| Axis { deflection, ..axis.clone() }).collect();
        let rules = Rules { axes, ..(*of).clone() };
        let sample = Sample { at: Time(ms * 1_000_000), ..Sample::default() };
        let mut pulse = Pulse::new(sample, &Vec::new().into());
        pulse.speed = speed;
        is_held(&pulse, Time::ZERO, &rules)
    };
    let late = (rules(true).reaction() + CREEP_TIME).as_millis() as u64;
    assert!(held(0.1, 0.05, late));
    assert!(!held(0.1, 0.05, late - 10), "it may still brake");
    assert!(!held(0.1, 0.2, late), "that is no creeping");
    assert!(!held(0.0, 0.05, late));
}

/// An arm that pushes gets set-points at its configuration from the very next readings; any other arm brakes to rest
/// before its retreat.
#[test]
fn an_arm_that_pushes_something_unknown_is_taken_off_it_at_once() {
    let begins = |deflection: f64, pressed: bool| {
        let of = rules(true);
        let axes = of.axes.iter().map(|axis| Axis { deflection, ..axis.clone() }).collect();
        let mut reflex = Alone::new(Arc::new(Rules { axes, ..(*of).clone() }));
        let who = recorded(0, true, &[(0.0, 0.0), (1.0, 0.0), (4.0, 40.0), (5.0, 40.0)], 0.5);
        let safe = Some(SafePose { since: who.past[who.start].at, q: who.safe.clone() });
        let motion = Underway { pressed, ..Underway::of_one_motor(1, safe) };
        let (token, begun) = (reflex.gate.close(), Time::from_secs(5.0));
        reflex.on(ReflexIn::RollBack { token, motion, again: false }, begun);
        (1..100).find(|k| {
            let at = begun + PERIOD * *k;
            let sample = Sample { seq: u64::from(*k), at, q: vec![0.7].into(), done: vec![false], ..Sample::default() };
            let mut pulse = Pulse::new(sample, &Vec::new().into());
            pulse.speed = 0.99_f64.powi(*k as i32);
            let out = reflex.read(&mut pulse, None, Status::Stopping, at);
            out.iter().any(|o| matches!(o, ReflexOut::Bring(_)))
        })
    };
    assert_eq!(begins(0.1, true), Some(1));
    assert_eq!([begins(0.1, false), begins(0.0, true)], [None; 2], "still in motion");
}
