//! References are set and read back before each move.

use super::*;
use mobee_yarp::{Bottle, Dialect};

const READS: Get = Get::Values(mobee_yarp::board::Quantity::ReferenceSpeed, Joints::All);

fn both(acceleration: f64) -> Do {
    Do::Move { joints: vec![1], to: vec![20.0], speed: Some(vec![10.0]), acceleration: Some(vec![acceleration]) }
}

/// A move requires that the board has the commanded references or lower ones, to a hundredth and without regard
/// to sign. Greater ones are set twice more; then the fault names the cause.
#[tokio::test(start_paused = true)]
async fn no_move_is_made_at_greater_references_than_commanded() {
    let all = [(10.0, true), (10.05, true), (10.15, false), (10.9, false), (-10.0, true), (-11.0, false), (3.0, true)];
    for (read, is_made) in all {
        let rig = Rig::up().await;
        rig.board.plays(move |board, ask| {
            matches!(ask, Ask::Set(Set::Speed(..))).then(|| {
                board.with(1, |axis| axis.ref_speed = read);
                Trick::Says(reply::ok())
            })
        });
        rig.order(both(40.0));
        rig.after(50).await;
        let commands = rig.commands();
        assert_eq!(commands.contains(&moves()), is_made, "{read} of 10: {commands:?}");
        let speed = Set::Speed(group(&[1]), vec![10.0]);
        assert_eq!(commands.iter().filter(|set| **set == speed).count(), if is_made { 1 } else { 3 }, "{read} of 10");
        let alarm = rig.known(|known| known.alarm.take());
        assert_eq!(
            alarm
                .map(|fault| fault.to_string())
                .is_some_and(|why| why.contains("/arm") && why.contains("end that program")),
            !is_made
        );
    }
}

/// The same for accelerations, if the board has any.
#[tokio::test(start_paused = true)]
async fn no_move_is_made_at_greater_accelerations_than_commanded() {
    for (read, is_made) in [(40.0, true), (60.0, false)] {
        let rig = Rig::up().await;
        rig.board.plays(move |board, ask| {
            matches!(ask, Ask::Set(Set::Acceleration(..))).then(|| {
                board.with(1, |axis| axis.ref_acc = read);
                Trick::Says(reply::ok())
            })
        });
        rig.order(both(40.0));
        rig.after(50).await;
        assert_eq!(rig.commands().contains(&moves()), is_made, "{read} of 40");
    }
    let rig = Rig::up().await;
    rig.board.with(1, |axis| axis.ref_acc = 500.0);
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Acceleration(..))).then_some(Trick::Refuses));
    rig.order(both(40.0));
    rig.after(50).await;
    assert!(rig.commands().contains(&moves()), "it has none to set");
}

/// A board that accepts accelerations but retains those found is not a conflict with another program: the move
/// is made, the operator gets a message, and accelerations are no longer sent.
#[tokio::test(start_paused = true)]
async fn a_board_with_fixed_accelerations_still_moves() {
    let rig = Rig::owing().await;
    let found = rig.known(|known| known.owed.findings()[1].acceleration);
    assert!(found.is_some_and(|found| found > 5.0), "{found:?}");
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Acceleration(..))).then(|| Trick::Says(reply::ok())));
    rig.order(both(5.0));
    rig.after(50).await;
    let sent = |commands: &[Set]| commands.iter().filter(|set| matches!(set, Set::Acceleration(..))).count();
    let commands = rig.commands();
    assert!(commands.contains(&moves()), "{commands:?}");
    assert_eq!((sent(&commands), rig.known(|known| known.alarm.take())), (3, None));
    rig.order(both(5.0));
    rig.after(50).await;
    assert_eq!(sent(&rig.commands()), 0, "it is known by now");
}

/// A board that does not report its references is trusted; a board that does not answer is not.
#[tokio::test(start_paused = true)]
async fn no_move_is_made_before_references_were_read_back() {
    let two = Bottle::parse("[is] [velg] (70.0 80.0) [tsta] 1 2.5 [ok]", Dialect::V3).unwrap();
    for (trick, is_made) in [(Some(Trick::Refuses), true), (Some(Trick::Says(two)), true), (Some(Trick::Breaks), false)]
    {
        let (rig, mut trick) = (Rig::up().await, trick);
        rig.board.plays(move |_, ask| if let Ask::Get(Get::Values(..)) = ask { trick.take() } else { None });
        rig.order(to_20());
        rig.after(50).await;
        assert_eq!(rig.commands().contains(&moves()), is_made);
    }
}

/// References are sent as ordered, except for zero, which some boards interpret as no limit.
#[tokio::test(start_paused = true)]
async fn a_reference_of_nothing_is_a_small_one() {
    let rig = Rig::up().await;
    rig.order(Do::Reference { joints: vec![0, 1], speed: vec![0.0, 7.0], acceleration: vec![9.0, 0.0] });
    rig.after(20).await;
    let (speed, acceleration) = (vec![SLOWEST, 7.0], vec![9.0, SLOWEST]);
    let commands = rig.commands();
    assert_eq!(commands[..2], [Set::Speed(group(&[0, 1]), speed), Set::Acceleration(group(&[0, 1]), acceleration)]);
}

/// The first moves are timed, and a measurement counts once the reference was read back. There is no query
/// before the first measurement.
#[tokio::test(start_paused = true)]
async fn what_was_timed_is_confirmed() {
    let rig = Rig::up().await;
    let queries = |rig: &Rig| {
        rig.received().iter().filter(|(_, word)| *word == Received::Request(Ask::Get(READS.clone()))).count()
    };
    for _ in 0..3 {
        rig.board.with(1, |axis| axis.q = 0.0);
        rig.after(50).await;
        rig.order(to_20());
        rig.after(50).await;
        assert_eq!(queries(&rig), 0, "nothing was timed yet");
        rig.known(|known| known.gauge.outran(1, 4.0));
        rig.after(30).await;
        assert_eq!(queries(&rig), 1);
    }
    assert!(rig.known(|known| known.gauge.is_unfair()), "three times four times too fast");
    assert!(rig.cell.lock().news.take().is_some_and(|news| news.contains("/arm moved at 4.0 to 4.0 times")));
}
