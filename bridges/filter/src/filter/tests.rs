#[allow(dead_code, reason = "the tests of bridges use the rest")]
mod bench;

use super::*;
use bench::Bench;
use mobee_contract::Values;
use proptest::prelude::*;

fn go(joints: &[usize], values: &[f64]) -> BoardRequest {
    BoardRequest::Move { joints: joints.to_vec(), values: values.to_vec(), relative: false }
}

fn client(connection: u64) -> BoardClient<'static> {
    BoardClient { part: 0, connection, from: "/me/rpc:o", listens: true }
}

#[test]
fn a_move_is_a_commit_at_the_references_that_the_client_has_set() {
    let mut b = Bench::new();
    let slow = BoardRequest::Speed { joints: vec![1], values: vec![-20.0] };
    assert_eq!(b.ask(1, &slow), Err(BoardReply::Accepted));
    assert_eq!((b.core.board(0)[1].ref_speed, b.core.board(0)[1].set.speed), (20.0, true), "the amount");
    let step = b.seen(|core, seen| core.request(&client(1), &go(&[1, 0], &[-90.0, 10.0]), seen));
    let FilterDecision::Commit(commit) = step else { panic!("no commit: {step:?}") };
    assert_eq!(commit.target.motors, [1, 0]);
    assert!((commit.speeds.unwrap()[0].to_degrees() - 20.0).abs() < 1e-9);
    let speeds = BoardRequest::Question(Question::Speeds(vec![0, 1]));
    assert_eq!(b.ask(1, &speeds), Ok(KnownBetter::References(vec![None, Some((20.0, Default::default()))])));
    let mode = BoardRequest::Mode { joints: vec![0], modes: vec![ClientMode::Velocity] };
    assert_eq!(b.ask(1, &mode), Err(BoardReply::Accepted));
    let modes = BoardRequest::Question(Question::Modes(vec![1, 0]));
    assert_eq!(b.ask(1, &modes), Ok(KnownBetter::Modes(vec![None, Some(ClientMode::Velocity)])));
}

#[test]
fn what_does_not_fit_the_board_is_refused() {
    let mut b = Bench::new();
    for request in [
        go(&[2], &[0.0]),
        go(&[0, 0], &[0.0, 1.0]),
        go(&[0, 1], &[0.0]),
        go(&[0], &[f64::NAN]),
        go(&[0], &[91.0]),
        // the third motor belongs to another part
        BoardRequest::Stop(vec![2]),
        BoardRequest::Speed { joints: vec![0], values: vec![f64::INFINITY] },
        BoardRequest::Mode { joints: vec![0, 1], modes: vec![ClientMode::Mixed] },
        BoardRequest::Unknown,
    ] {
        assert_eq!(b.ask(1, &request), Err(BoardReply::Refused), "{request:?}");
        assert_eq!(b.stream(2, &request), None, "{request:?}");
    }
    assert_eq!(b.ask(1, &BoardRequest::Incomplete), Err(BoardReply::Malformed));
    assert_eq!(b.ask(1, &BoardRequest::BeStiff), Err(BoardReply::Accepted));
}

#[test]
fn a_stream_takes_motions_only_and_a_question_learns_of_what_is_open() {
    let mut b = Bench::new();
    let velocity = BoardRequest::Velocity { joints: vec![0], values: vec![500.0] };
    let Some(FilterDecision::Stream(setpoints)) = b.stream(7, &velocity) else { panic!("no stream") };
    let Values::Velocity(values) = setpoints.values else { panic!("no velocities") };
    assert!((values[0].to_degrees() - 50.0).abs() < 1e-9, "no faster than the motor can");
    assert_eq!(b.stream(7, &BoardRequest::Stop(vec![0])), None);
    let done = |joints: &[usize]| BoardRequest::Question(Question::Done(joints.to_vec()));
    assert_eq!(b.ask(1, &done(&[0, 1])), Ok(KnownBetter::NotDone));
    assert_eq!(b.ask(1, &done(&[1])), Ok(KnownBetter::Nothing));
    b.status = Status::Retreating;
    assert_eq!(b.ask(1, &done(&[1])), Err(BoardReply::Refused));
    assert_eq!(b.ask(1, &BoardRequest::Incomplete), Err(BoardReply::Refused), "closed is closed");
}

fn any_request() -> impl Strategy<Value = BoardRequest> {
    let joints = || prop::collection::vec(0..4_usize, 0..4);
    let values = || prop::collection::vec(prop_oneof![4 => -100.0..100.0_f64, 1 => any::<f64>()], 0..4);
    let mode = prop::sample::select(vec![ClientMode::Position, ClientMode::Velocity, ClientMode::Mixed]);
    prop_oneof![
        (joints(), values(), any::<bool>()).prop_map(|(joints, values, relative)| BoardRequest::Move {
            joints,
            values,
            relative
        }),
        (joints(), values()).prop_map(|(joints, values)| BoardRequest::Velocity { joints, values }),
        (joints(), values()).prop_map(|(joints, values)| BoardRequest::Direct { joints, values }),
        (joints(), values()).prop_map(|(joints, values)| BoardRequest::Speed { joints, values }),
        (joints(), values()).prop_map(|(joints, values)| BoardRequest::Acceleration { joints, values }),
        (joints(), prop::collection::vec(mode, 0..4)).prop_map(|(joints, modes)| BoardRequest::Mode { joints, modes }),
        joints().prop_map(BoardRequest::Stop),
        joints().prop_map(|joints| BoardRequest::Question(Question::Done(joints))),
        joints().prop_map(|joints| BoardRequest::Question(Question::Modes(joints))),
        Just(BoardRequest::Unknown),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    /// For all requests: no motion names a motor of another part, leaves the limits, or exceeds the greatest
    /// speed.
    #[test]
    fn no_motion_leaves_its_part_or_its_limits(requests in prop::collection::vec((any_request(), any::<bool>()), 1..40)) {
        let mut b = Bench::new();
        for (request, streams) in requests {
            let step = b.seen(|core, seen| match streams {
                true => core.streamed(&client(2), &request, seen),
                false => Some(core.request(&client(1), &request, seen)),
            });
            match step {
                Some(FilterDecision::Commit(c)) => {
                    prop_assert!(c.target.motors.iter().all(|m| *m < 2));
                    prop_assert!(c.target.q.iter().all(|q| q.to_degrees().abs() <= 90.0 + 1e-9));
                    prop_assert!(c.speeds.unwrap().iter().all(|s| *s > 0.0 && s.to_degrees() <= 50.0 + 1e-9));
                }
                Some(FilterDecision::Stream(s)) => {
                    prop_assert!(s.motors.iter().all(|m| *m < 2));
                    let most = if matches!(s.values, Values::Velocity(_)) { 50.0 } else { 90.0 };
                    let (Values::Position(values) | Values::Velocity(values)) = s.values;
                    prop_assert!(values.iter().all(|v| v.to_degrees().abs() <= most + 1e-9));
                }
                _ => {}
            }
        }
    }
}
