#[allow(dead_code, reason = "the tests of the filter use the rest")]
#[path = "../../../filter/src/filter/tests/bench.rs"]
mod bench;
mod round_trip;
mod slides;

use super::words as reply;
use super::*;
use bench::Bench;
use mobee_contract::{CommitId, Hold, MotionEnd, Status, Values};
use mobee_filter::filter::{BoardClient, FilterDecision, closed};
use proptest::prelude::*;
use std::ops::{Deref, DerefMut};

/// The filter on its bench, with the YARP protocol.
struct Programs {
    bench: Bench,
    /// Requests that reached the board.
    asked: Vec<Bottle>,
    answers: Stamp,
}

impl Deref for Programs {
    type Target = Bench;
    fn deref(&self) -> &Bench {
        &self.bench
    }
}

impl DerefMut for Programs {
    fn deref_mut(&mut self) -> &mut Bench {
        &mut self.bench
    }
}

impl Programs {
    fn new() -> Programs {
        Programs { bench: Bench::new(), asked: vec![], answers: Stamp::default() }
    }

    /// Joint 0 is revolute, joint 1 prismatic.
    fn sliding() -> Programs {
        let bench = Bench::of([JointMotion::Turn, JointMotion::Slide, JointMotion::Turn]);
        Programs { bench, ..Programs::new() }
    }

    /// Executes a request on a connection to a simulated robot as the service does.
    fn rpc(&mut self, connection: u64, request: &Bottle) -> Bottle {
        let client = BoardClient { part: 0, connection, from: "/me/rpc:o", listens: true };
        let asked = parse(request, &units(self.core.board(0)));
        let step = self.seen(|core, seen| core.request(&client, &asked, seen));
        let FilterDecision::Question(question) = &step else { return super::reply(self.act(&client, &step)) };
        self.asked.push(request.clone());
        match self.seen(|core, seen| core.knows_better(&client, question, seen)) {
            Ok(known) => {
                self.answers = self.answers.next(self.now.secs());
                answer(self.core.board(0), &known, request, self.answers)
            }
            Err(reply) => super::reply(reply),
        }
    }

    /// Corrected answer of a board with its own protocol; `None` if the answer is passed on unchanged.
    fn pass(&mut self, request: &str, answer: &str) -> Option<String> {
        let client = BoardClient { part: 0, connection: 1, from: "/me/rpc:o", listens: true };
        let asked = parse(&bottle(request), &units(self.core.board(0)));
        let BoardRequest::Question(question) = asked else { panic!("no question: {request}") };
        let known = self.seen(|core, seen| core.knows_better(&client, &question, seen)).unwrap();
        corrected(&known, &bottle(answer)).map(|reply| reply.to_string())
    }

    fn say(&mut self, connection: u64, text: &str) -> String {
        self.rpc(connection, &bottle(text)).to_string()
    }

    fn step(&mut self, text: &str) -> FilterDecision {
        let client = BoardClient { part: 0, connection: 99, from: "anon", listens: true };
        let asked = parse(&bottle(text), &units(self.core.board(0)));
        self.seen(|core, seen| core.request(&client, &asked, seen))
    }

    fn stream(&mut self, connection: u64, head: &str, body: &[f64]) -> Option<FilterDecision> {
        let asked = streamed(&bottle(head), body, &units(self.core.board(0)));
        self.bench.stream(connection, &asked)
    }
}

/// Units of revolute joints.
fn turning(axes: usize) -> Units {
    Units::new(vec![JointKind::Revolute; axes])
}

fn bottle(text: &str) -> Bottle {
    Bottle::parse(text, Default::default()).unwrap()
}

#[test]
fn a_move_is_a_commit_at_the_clients_own_speed() {
    let mut b = Programs::new();
    assert_eq!(b.say(1, "[set] [vel] 1 20.0"), "[ok]");
    let FilterDecision::Commit(commit) = b.step("[set] [posg] 2 (0 1) (10.0 -90.0)") else { panic!("no commit") };
    assert_eq!(&*commit.agent, "toy/filter");
    assert_eq!(commit.target.motors, [0, 1]);
    assert!((commit.target.q[0].to_degrees() - 10.0).abs() < 1e-9);
    assert!((commit.speeds.unwrap()[1].to_degrees() - 20.0).abs() < 1e-9);
    let FilterDecision::Commit(commit) = b.step("set rel 1 -5") else { panic!("no commit") };
    assert!((commit.target.q[0] - (0.2 - 5.0_f64.to_radians())).abs() < 1e-12, "relative to where the joint is");
}

#[test]
fn reads_pass_and_what_could_harm_does_not() {
    let mut b = Programs::new();
    assert_eq!(b.step("[get] [encs]"), FilterDecision::Question(Question::Other));
    assert_eq!(b.step("get axes"), FilterDecision::Question(Question::Other));
    assert_eq!(b.step("[get] [pid] [pids] [pos]"), FilterDecision::Question(Question::Other));
    assert_eq!(b.step("[get] [dons]"), FilterDecision::Question(Question::Done(vec![0, 1])));
    let fail = FilterDecision::Reply(BoardReply::Refused);
    for text in [
        "[get] [bogu]",
        "[set] [pos] 0 95.0",
        "[set] [pos] 0 nan",
        "[set] [pos] 2 0.0",
        "[set] [poss] (1.0)",
        "[set] [vmo] 0 1.0",
        "[set] [llim] 0 -500 500",
        "[set] [ere] 0",
        "[set] [icmd] [cmod] 0 [torq]",
        "[set] [icmd] [cmod] 0 [idl]",
        "[set] [intm] [mode] 0 [comp]",
        "[set] [torq] [ref] 0 1.5",
        "[set] [pid] [pid] [pos] 0 (1 2 3)",
        "[set] [adi] 0",
        "[set] [vel] 0 inf",
        "[cald] 0",
        "[calj] 0 1 2 3 4",
        "[park] 1",
        "set get",
    ] {
        assert_eq!(b.step(text), fail, "{text}");
    }
    assert_eq!(b.step("[help]"), FilterDecision::Reply(BoardReply::Malformed));
    assert_eq!(b.step(""), FilterDecision::Reply(BoardReply::Malformed));
}

#[test]
fn references_are_kept_and_never_reach_the_board() {
    let mut b = Programs::new();
    for text in [
        "[set] [vel] 0 200.0",
        "[set] [vels] (200.0 200.0)",
        "[set] [velg] 2 (0 1) (200.0 -200.0)",
        "set vels (200 200)",
        "[set] [acc] 0 9000.0",
        "[set] [accs] (9000.0 9000.0)",
        "[set] [accg] 1 (1) (9000.0)",
    ] {
        assert_eq!(b.say(1, text), "[ok]", "{text}");
        assert_eq!(b.asked, [], "{text} went to the board");
    }
    assert!(b.say(1, "[get] [vels]").starts_with("[is] [vels] (200.0 200.0)"), "shown as a board would");
    let FilterDecision::Commit(commit) = b.step("[set] [pos] 0 10.0") else { panic!("no commit") };
    assert!((commit.speeds.unwrap()[0].to_degrees() - 50.0).abs() < 1e-9, "moves keep to the greatest speed");
    assert_eq!(b.say(1, "[set] [vels] (200.0)"), "[fail]", "a list too short");
    // other settings that would change the motion of the board
    for text in
        ["[set] [vlim] 0 0 900", "[set] [llim] 0 -900 900", "[set] [pid] [plim] [pos] 0 9", "[set] [ivar] x (1)"]
    {
        assert_eq!(b.say(1, text), "[fail]", "{text}");
    }
}

#[test]
fn while_closed_every_rpc_fails() {
    let mut b = Programs::new();
    for status in
        [Status::Stopping, Status::Retreating, Status::Settling, Status::Starting, Status::Holding(Hold::Stale)]
    {
        b.status = status;
        for text in ["[get] [prot]", "[get] [encs]", "[get] [don] 0", "[set] [stos]", "[set] [pos] 0 1.0", "[help]", ""]
        {
            assert_eq!(b.say(1, text), "[fail]", "{status:?} {text}");
        }
    }
    b.status = Status::Holding(Hold::InContact);
    assert_eq!(b.say(1, "[set] [pos] 0 1.0"), "[ok]", "an escape");
}

#[test]
fn a_slow_poller_learns_of_the_rollback() {
    let mut b = Programs::new();
    assert_eq!(b.say(1, "[set] [pos] 0 10.0"), "[ok]");
    assert!(b.say(1, "[get] [don] 0").starts_with("[is] [don] 0"), "its outcome is open");
    b.end(MotionEnd::Failed);
    assert!(b.say(2, "[get] [don] 0").starts_with("[is] [don] 1"), "another connection has nothing to learn");
    assert_eq!(b.say(1, "[get] [don] 0"), "[fail]");
    assert!(b.say(1, "[get] [don] 0").starts_with("[is] [don] 1"));
    // a client that polled in time has been informed already
    b.say(1, "[set] [pos] 0 10.0");
    b.status = Status::Retreating;
    assert_eq!(b.say(1, "[get] [don] 0"), "[fail]");
    b.end(MotionEnd::Failed);
    assert!(b.say(1, "[get] [don] 0").starts_with("[is] [don] 1"));
    // a motion that reached its target needs no report
    b.say(1, "[set] [pos] 0 10.0");
    b.end(MotionEnd::Reached);
    assert!(b.say(1, "[get] [dons]").starts_with("[is] [dons] 1"));
}

#[test]
fn joints_without_a_motion_are_done() {
    let mut b = Programs::new();
    b.say(1, "[set] [pos] 0 10.0");
    assert!(b.say(1, "[get] [don] 1").starts_with("[is] [don] 1"));
    assert!(b.say(1, "[get] [dons]").starts_with("[is] [dons] 0"));
}

#[test]
fn a_stop_is_no_failure() {
    let mut b = Programs::new();
    assert_eq!(b.say(1, "[set] [sto] 0"), "[ok]");
    assert_eq!(b.stopped, 0, "nothing moves");
    b.say(1, "[set] [pos] 0 10.0");
    b.say(1, "[set] [pos] 1 10.0");
    let FilterDecision::Commit(commit) = b.step("[set] [sto] 0") else { panic!("joint 1 goes on") };
    assert_eq!((commit.target.motors, commit.target.q), (vec![0], vec![0.1]));
    assert_eq!(b.say(1, "[set] [stos]"), "[ok]");
    assert_eq!(b.stopped, 1);
    b.end(MotionEnd::Failed);
    assert!(b.say(1, "[get] [dons]").starts_with("[is] [dons] 1"));
}

#[test]
fn a_failed_stream_is_ignored_until_its_client_is_informed_or_was_silent() {
    let mut b = Programs::new();
    assert!(b.stream(7, "[vmos]", &[1.0, 1.0]).is_some());
    assert!(b.say(1, "[get] [axes]").starts_with("[is]"));
    assert!(b.stream(7, "[dpo] 1", &[5.0]).is_some());
    b.end(MotionEnd::Failed);
    b.now = b.now + std::time::Duration::from_millis(20);
    assert_eq!(b.stream(7, "[vmos]", &[1.0, 1.0]), None);
    assert_eq!(b.say(1, "[get] [axes]"), "[fail]", "the client's RPC connection learns");
    assert!(b.stream(7, "[vmos]", &[1.0, 1.0]).is_some());
    b.end(MotionEnd::Failed);
    assert_eq!(b.stream(7, "[vmos]", &[1.0, 1.0]), None);
    b.now = b.now + std::time::Duration::from_secs(1);
    assert!(b.stream(7, "[vmos]", &[1.0, 1.0]).is_some(), "after a silence");
    assert_eq!(b.stream(7, "[vmos]", &[1.0]), None, "too short");
    assert_eq!(b.stream(7, "[dpos]", &[1.0, 91.0]), None, "beyond a limit");
    assert_eq!(b.stream(7, "[dtqs]", &[1.0, 1.0]), None, "torque");
    b.status = Status::Stopping;
    assert_eq!(b.stream(7, "[vmos]", &[1.0, 1.0]), None, "closed");
}

#[test]
fn a_stream_that_continues_while_the_filter_is_closed_is_ignored_when_it_opens() {
    let mut b = Programs::new();
    assert!(b.stream(7, "[vmos]", &[1.0, 1.0]).is_some());
    b.end(MotionEnd::Failed);
    let heard = |b: &mut Programs, status: Status, n: u32| {
        b.status = status;
        (0..n).any(|_| {
            b.now = b.now + std::time::Duration::from_millis(20);
            b.stream(7, "[vmos]", &[1.0, 1.0]).is_some()
        })
    };
    assert!(!heard(&mut b, Status::Retreating, 100));
    assert!(!heard(&mut b, Status::Rest, 100), "it never paused");
    b.now = b.now + std::time::Duration::from_millis(500);
    assert!(heard(&mut b, Status::Rest, 1));
}

/// A gaze controller never pauses, and a contact of an arm does not concern it.
#[test]
fn a_stream_that_had_no_part_in_a_contact_goes_on_as_the_filter_opens() {
    let mut b = Programs::new();
    let mut heard = |blamed: &[usize]| {
        b.status = Status::Rest;
        b.now = b.now + std::time::Duration::from_secs(1);
        assert!(b.stream(7, "[vmos]", &[1.0, 1.0]).is_some());
        b.end(MotionEnd::Failed);
        (b.blamed, b.status) = (Some(blamed.iter().copied().collect()), Status::Retreating);
        b.now = b.now + std::time::Duration::from_millis(20);
        assert!(b.stream(7, "[vmos]", &[1.0, 1.0]).is_none(), "closed");
        b.status = Status::Rest;
        b.now = b.now + std::time::Duration::from_millis(20);
        b.stream(7, "[vmos]", &[1.0, 1.0]).is_some()
    };
    assert!(heard(&[2]));
    assert!(!heard(&[1, 2]), "it pushed, too");
    assert!(heard(&[]));
}

#[test]
fn settings_are_shown_as_the_client_made_them() {
    let mut b = Programs::new();
    b.say(1, "[set] [icmd] [cmod] 0 [vel]");
    b.say(1, "[set] [acc] 1 7.5");
    assert!(b.say(1, "[get] [icmd] [cmds]").starts_with("[is] [cmds] ([vel] [pos])"));
    assert!(b.say(1, "[get] [acc] 1").starts_with("[is] [acc] 7.5"));
    // a board with its own protocol: only the client's settings are replaced in its reply, and only if the
    // board has no fault
    let mut pass = |ask: &str, reply: &str| b.pass(ask, reply);
    assert_eq!(
        pass("[get] [icmd] [cmod] 0", "[is] 0 [pos] [tsta] 1 2.5 [ok]").unwrap(),
        "[is] 0 [vel] [tsta] 1 2.5 [ok]"
    );
    assert_eq!(pass("[get] [icmd] [cmod] 0", "[is] 0 [hwfa] [tsta] 1 2.5 [ok]"), None);
    assert_eq!(pass("[get] [icmd] [cmod] 1", "[is] 1 [posd] [tsta] 1 2.5 [ok]"), None);
    assert_eq!(pass("[get] [encs]", "[is] [encs] (1.0 2.0) [tsta] 1 2.5 [ok]"), None);
    let changed = pass("[get] [accs]", "[is] [accs] (1.0 2.0) [tsta] 1 2.5 [ok]").unwrap();
    assert_eq!(changed, "[is] [accs] (1.0 7.5) [tsta] 1 2.5 [ok]");
}

fn any_request() -> impl Strategy<Value = Bottle> {
    let codes = vec![
        "get", "set", "pos", "poss", "posg", "rel", "vel", "vels", "acc", "don", "dons", "sto", "stos", "vmos", "icmd",
        "cmod", "cmds", "torq", "intm", "mode", "llim", "ere", "enc", "encs", "prot", "axes", "cald", "park", "pid",
        "adi", "torq", "zz",
    ];
    let word = prop::sample::select(codes).prop_map(|w| Value::Vocab(Vocab::new(w)));
    let leaf = prop_oneof![
        6 => word,
        3 => (0..3_i32).prop_map(Value::Int32),
        2 => (-100.0..100.0_f64).prop_map(Value::Float64),
        1 => any::<f64>().prop_map(Value::Float64),
    ];
    let list = prop::collection::vec(leaf.clone(), 0..4).prop_map(|v| Value::List(Bottle(v)));
    prop::collection::vec(prop_oneof![4 => leaf, 1 => list], 0..6).prop_map(Bottle)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    /// For all requests in any order: while the filter is closed, every reply is `[fail]`; a connection whose
    /// motion failed gets exactly one `[fail]` afterwards; only questions on the list reach the board; and no
    /// commit leaves the limits.
    #[test]
    fn the_filter_keeps_its_promises(events in prop::collection::vec((0..8_u8, 1..3_u64, any_request()), 1..60)) {
        let mut b = Programs::new();
        let probe = bottle("[get] [encs]");
        for (event, connection, request) in events {
            match event {
                0 => b.status = Status::Retreating,
                1 if b.status == Status::Moving => {
                    b.end(MotionEnd::Failed);
                    // only the first reply on each connection may be the failure
                    let first = b.rpc(connection, &probe);
                    prop_assert!(first == reply::fail() || first.0.len() > 1);
                    prop_assert!(b.rpc(connection, &probe).0.len() > 1);
                }
                1 => b.end(MotionEnd::Failed),
                2 => b.end(MotionEnd::Reached),
                _ => {
                    let shut = closed(b.status);
                    let before = b.asked.len();
                    let client = BoardClient { part: 0, connection, from: "/me/rpc:o", listens: true };
                    let asked = parse(&request, &turning(2));
                    if !shut && let FilterDecision::Commit(c) = b.seen(|core, seen| core.request(&client, &asked, seen)) {
                        prop_assert!(c.target.q.iter().all(|q| q.to_degrees().abs() <= 90.0 + 1e-9));
                        prop_assert!(c.speeds.unwrap().iter().all(|s| *s > 0.0 && s.to_degrees() <= 50.0 + 1e-9));
                    }
                    let reply = b.rpc(connection, &request);
                    if shut {
                        prop_assert_eq!(&reply, &reply::fail());
                        prop_assert_eq!(b.asked.len(), before);
                    }
                }
            }
        }
        for asked in &b.asked {
            prop_assert!(reads::allowed(asked), "{}", asked);
        }
    }
}

/// A joint beyond a limit (an elbow that sags to -0.4 deg) does not block the motion of its part.
#[test]
fn a_joint_beyond_its_limit_may_stay_and_comes_back() {
    let stands = |q: f64| {
        let mut b = Programs::new();
        b.q = vec![q.to_radians(), 0.2, 0.3];
        let (at, q) = (b.now, b.q.clone());
        b.core.sense(at, &q, Status::Rest);
        b
    };
    let motors = |step: FilterDecision| match step {
        FilterDecision::Commit(commit) => {
            let to = commit.target.motors.iter().zip(&commit.target.q);
            to.map(|(m, q)| format!("{m}:{:.1}", q.to_degrees())).collect::<Vec<_>>().join(" ")
        }
        FilterDecision::Reply(answer) => super::reply(answer).to_string(),
        other => panic!("{other:?}"),
    };
    for (at, asked, becomes) in [
        // a target equal to its position is accepted, and only the other joint moves
        (90.4, "[set] [poss] (90.4 10.0)", "1:10.0"),
        (90.4, "[set] [poss] (90.2 10.0)", "1:10.0"),
        (-90.4, "[set] [pos] 0 -90.4", "[ok]"),
        (90.4, "[set] [rel] 0 0.0", "[ok]"),
        // a target beyond the same limit means the limit
        (90.4, "[set] [pos] 0 95.0", "0:90.0"),
        (-90.4, "[set] [posg] 2 (0 1) (-120.0 0.0)", "0:-90.0 1:0.0"),
        (90.4, "[set] [pos] 0 89.0", "0:89.0"),
        // and a joint within its limits, or beyond the other limit, is not sent there
        (89.9, "[set] [pos] 0 90.4", "[fail]"),
        (90.4, "[set] [pos] 0 -90.4", "[fail]"),
    ] {
        assert_eq!(motors(stands(at).step(asked)), becomes, "{asked} at {at}");
    }
    let mut b = stands(90.4);
    let Some(FilterDecision::Stream(setpoints)) = b.stream(2, "[dpos]", &[90.4, 11.0]) else { panic!("no stream") };
    assert_eq!(setpoints.motors, [1]);
    assert_eq!(stands(90.4).stream(2, "[dpo] 0", &[90.4]), None, "there is nothing to do");
    let Some(FilterDecision::Stream(setpoints)) = stands(90.4).stream(2, "[dpo] 0", &[91.5]) else {
        panic!("no stream")
    };
    let Values::Position(q) = setpoints.values else { panic!("no positions") };
    assert!((q[0].to_degrees() - 90.0).abs() < 1e-9);
}

/// A client whose joints have arrived is done, even while gaze control streams.
#[test]
fn a_client_whose_joints_have_arrived_waits_for_no_other() {
    let mut b = Programs::new();
    assert_eq!(b.say(1, "[set] [pos] 0 20.0"), "[ok]");
    assert!(b.say(1, "[get] [don] 0").starts_with("[is] [don] 0"));
    let gaze = BoardClient { part: 1, connection: 2, from: "/gaze/command:o", listens: false };
    let step =
        b.seen(|core, seen| core.streamed(&gaze, &streamed(&bottle("[vmos]"), &[5.0], &turning(1)), seen)).unwrap();
    let verdict = Ok(CommitId(b.next));
    b.seen(|core, seen| core.accepted(&gaze, &step, &verdict, seen));
    assert!(b.say(1, "[get] [don] 0").starts_with("[is] [don] 0"), "not there yet");
    b.q[0] = 20.1_f64.to_radians();
    assert!(b.say(1, "[get] [don] 0").starts_with("[is] [don] 1"), "there, though gaze goes on");
    assert!(b.say(3, "[get] [don] 0").starts_with("[is] [don] 1"), "whoever asks");
    // it is still one transaction: a contact of the other client reverts both
    b.end(MotionEnd::Failed);
    assert_eq!(b.say(1, "[get] [don] 0"), "[fail]");
    // alone, the motion is not done before its outcome is known
    assert_eq!(b.say(1, "[set] [pos] 0 10.0"), "[ok]");
    b.q[0] = 10.0_f64.to_radians();
    assert!(b.say(1, "[get] [don] 0").starts_with("[is] [don] 0"));
}
