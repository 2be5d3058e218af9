//! Messages of a hand to its board, for a board that refuses, answers late, does not answer, reports wrongly,
//! or is lost.

mod orders;
mod references;
mod rig;

use super::super::cell::{SharedBoards, Trouble};
use super::super::found::{Finding, Owed, Restored};
use super::*;
use mobee_yarp::board::mode;
use rig::{Received, Rig, Trick, group, moves, stop, to_20};
use std::sync::Mutex;
use tokio::time::sleep;

/// The first message on a connection is a stop, earlier orders are dropped, and the board is available once it
/// has reported its settings.
#[tokio::test(start_paused = true)]
async fn a_connection_begins_with_a_stop_and_nothing_of_before_is_resumed() {
    let rig = Rig::new();
    rig.after(50).await;
    assert!(!rig.known(|known| known.reached) && rig.received().is_empty(), "there is no connection yet");
    rig.board.with(0, |axis| axis.mode = mode::VELOCITY);
    *rig.board.tells_modes.lock().unwrap() = false;
    rig.order(to_20());
    rig.board.link.send_replace(LinkState::Up(1));
    rig.after(200).await;
    let received: Vec<Received> = rig.received().into_iter().map(|(_, received)| received).collect();
    assert_eq!(received[..2], [Received::Hushed, Received::Request(Ask::Set(stop()))]);
    assert!(received[2..].iter().all(|word| matches!(word, Received::Request(Ask::Get(_)))), "{received:?}");
    assert_eq!((rig.trouble(), rig.known(|known| known.reached), rig.done()), (None, true, vec![true; 2]));
    assert_eq!(rig.known(|known| known.modes.clone()), [mode::VELOCITY, mode::POSITION], "they were asked for");
    assert!(rig.known(|known| known.brake.take()).is_some_and(|why| why.contains("no stop was answered yet")));
    // a streamed velocity ends with the connection, too
    rig.order(Do::Velocity { joints: vec![0], speed: vec![4.0] });
    rig.after(20).await;
    rig.received();
    rig.board.link.send_replace(LinkState::Up(2));
    rig.after(90).await;
    let word = |(_, received): &(u64, Received)| {
        *received != Received::Hushed && !matches!(received, Received::Request(Ask::Get(_)))
    };
    let words: Vec<Received> = rig.received().into_iter().filter(word).map(|(_, received)| received).collect();
    assert_eq!(words, [Received::Request(Ask::Set(stop()))]);
    assert!(rig.known(|known| known.brake.is_some()), "the line for stops may have broken with the other one");
}

/// A board that was reached counts as ours while it is lost, but not after another program has taken our port
/// names.
#[tokio::test(start_paused = true)]
async fn a_board_that_another_program_drives_is_not_ours() {
    let rig = Rig::up().await;
    let is = |link: LinkState| {
        rig.board.link.send_replace(link);
        async {
            rig.after(20).await;
            (rig.known(|known| known.reached), rig.trouble())
        }
    };
    let lost = Trouble::Lost("/arm: gone".into());
    assert_eq!(is(LinkState::Down("gone".into())).await, (true, Some(lost.clone())));
    let taken = Trouble::Forbidden("/arm: by another".into());
    assert_eq!(is(LinkState::Taken("by another".into())).await, (false, Some(taken)));
    assert_eq!(is(LinkState::Down("gone".into())).await, (false, Some(lost)));
    rig.received();
    rig.order(to_20());
    rig.known(|known| known.gauge.commanded(0, 0.0, 90.0, 10.0));
    rig.known(|known| known.gauge.outran(0, 4.0));
    rig.after(500).await;
    assert_eq!(rig.received(), [], "nothing is said where nobody is");
    rig.board.link.send_replace(LinkState::Up(2));
    rig.after(200).await;
    assert_eq!((rig.trouble(), rig.done()), (None, vec![true, true]), "nothing was carried out, and it is over");
}

/// A board that does not confirm the first stop is not used, and is stopped again every 0.1 s until it
/// confirms.
#[tokio::test(start_paused = true)]
async fn a_board_that_does_not_stop_is_not_used() {
    for (trick, stops) in [(Trick::Refuses, 3), (Trick::Breaks, 1)] {
        let rig = Rig::new();
        rig.after(500).await;
        let breaks = matches!(trick, Trick::Breaks);
        rig.board.plays(move |_, ask| {
            let trick = if breaks { Trick::Breaks } else { Trick::Refuses };
            (*ask == Ask::Set(stop())).then_some(trick)
        });
        rig.board.link.send_replace(LinkState::Up(1));
        rig.after(1000).await;
        let why = rig.trouble();
        assert!(matches!(&why, Some(Trouble::Lost(why)) if why.contains("does not stop")), "{why:?}");
        let received = rig.received();
        assert!(
            received
                .iter()
                .all(|(_, word)| matches!(word, Received::Hushed | Received::Request(Ask::Set(Set::Stop(_)))))
        );
        let begun: Vec<u64> =
            received.iter().filter(|(_, word)| *word == Received::Hushed).map(|(ms, _)| *ms).collect();
        assert!((8..=10).contains(&begun.len()) && received.len() == (1 + stops) * begun.len(), "{received:?}");
        assert!(begun.windows(2).all(|pair| (100..=120).contains(&(pair[1] - pair[0]))), "{begun:?}");
        rig.order(to_20());
        rig.after(5).await;
        rig.board.plays(|_, _| None);
        rig.after(200).await;
        assert_eq!((rig.trouble(), rig.commands().last()), (None, Some(&stop())), "the order is not carried out later");
    }
}

/// Stops have priority: earlier orders that move joints are dropped, all others are executed.
#[tokio::test(start_paused = true)]
async fn orders_of_before_a_stop_move_nothing() {
    let rig = Rig::up().await;
    rig.order(to_20());
    rig.order(Do::Mode { joints: vec![1], mode: ControlMode::Velocity });
    rig.halts();
    rig.after(50).await;
    assert_eq!(rig.commands(), [stop(), Set::Mode(group(&[1]), vec![mode::VELOCITY])]);
    rig.order_in(0, Do::Velocity { joints: vec![1], speed: vec![4.0] });
    rig.after(50).await;
    assert_eq!((rig.streamed(), rig.done()), (vec![], vec![false; 2]), "the encoders have to show that it rests");
    rig.after(150).await;
    assert_eq!(rig.done(), [true, true]);
    rig.order(Do::Velocity { joints: vec![1], speed: vec![4.0] });
    rig.after(10).await;
    let sent = rig.streamed();
    let all = sent.iter().all(|sent| *sent == Streamed::Velocity(group(&[1]), vec![4.0]));
    assert!(all && !sent.is_empty(), "what is ordered after it is done: {sent:?}");
    rig.halts();
    rig.after(200).await;
    let received = rig.received();
    assert_eq!(
        received[..2].iter().map(|(_, word)| word).collect::<Vec<_>>(),
        [&Received::Hushed, &Received::Request(Ask::Set(stop()))]
    );
    assert!(!received.iter().any(|(_, word)| matches!(word, Received::Streamed(_))), "{received:?}");
}

/// A stop during the execution of an order ends the order at its next step.
#[tokio::test(start_paused = true)]
async fn a_stop_ends_what_is_under_way() {
    // during the wait for a mode
    let rig = Rig::up().await;
    rig.is_in(ControlMode::Velocity).await;
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Mode(..))).then(|| Trick::Says(reply::ok())));
    rig.order(to_20());
    rig.after(50).await;
    rig.halts();
    rig.after(20).await;
    rig.board.with(1, |axis| axis.mode = mode::POSITION);
    rig.after(100).await;
    assert_eq!(rig.commands(), [Set::Mode(group(&[1]), vec![mode::POSITION]), stop()]);
    // during the wait for the answer to a reference
    let rig = Rig::up().await;
    let late = Duration::from_millis(50);
    rig.board.plays(move |_, ask| matches!(ask, Ask::Set(Set::Speed(..))).then_some(Trick::Late(late)));
    rig.order(to_20());
    rig.after(20).await;
    rig.halts();
    rig.after(100).await;
    let commands = rig.commands();
    assert_eq!(commands[..2], [Set::Speed(group(&[1]), vec![10.0]), stop()]);
    assert!(!commands.contains(&moves()), "{commands:?}");
    // a change of modes is not ended by a stop
    let rig = Rig::up().await;
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Mode(..))).then(|| Trick::Says(reply::ok())));
    rig.order(Do::Mode { joints: vec![1], mode: ControlMode::Velocity });
    rig.after(20).await;
    rig.halts();
    rig.after(20).await;
    let switching = |rig: &Rig| rig.cell.lock().switching[2].is_some();
    assert_eq!((rig.commands().last(), switching(&rig)), (Some(&stop()), true));
    rig.board.with(1, |axis| axis.mode = mode::VELOCITY);
    rig.after(20).await;
    assert!(!switching(&rig));
}

/// An order that began on one connection is not continued on another one.
#[tokio::test(start_paused = true)]
async fn an_order_ends_with_its_connection() {
    for next in [LinkState::Up(2), LinkState::Down("gone".into())] {
        let rig = Rig::up().await;
        rig.is_in(ControlMode::Velocity).await;
        let link = next.clone();
        rig.board.plays(move |board, ask| {
            if let Ask::Set(Set::Mode(..)) = ask {
                board.link.send_replace(link.clone());
            }
            None
        });
        rig.order(to_20());
        rig.after(200).await;
        let commands = rig.commands();
        assert_eq!(commands[0], Set::Mode(group(&[1]), vec![mode::POSITION]));
        let next_word = matches!(next, LinkState::Up(_)).then(stop);
        assert_eq!(commands.get(1), next_word.as_ref(), "{next:?}");
        assert!(
            !commands.contains(&moves()) && !commands.contains(&Set::Speed(group(&[1]), vec![10.0])),
            "{commands:?}"
        );
    }
}

/// Once another process drives the robot, no message is sent any more, not even a stop.
#[tokio::test(start_paused = true)]
async fn a_released_board_gets_no_more_messages() {
    let rig = Rig::owing().await;
    let late = Duration::from_millis(50);
    rig.board.plays(move |_, ask| matches!(ask, Ask::Get(Get::Done(_))).then_some(Trick::Late(late)));
    rig.order(to_20());
    rig.after(200).await;
    rig.received();
    // while the answer to a query is in transit and settings have to be restored
    rig.known(|known| known.owed.changes(Restored::Speed, &[0]));
    rig.cell.let_go();
    rig.after(100).await;
    rig.halts();
    rig.after(300).await;
    rig.end.send_replace(true);
    rig.after(300).await;
    assert_eq!(rig.received(), []);
}

/// Its last messages are a stop and then the settings to restore.
#[tokio::test(start_paused = true)]
async fn a_hand_that_ends_stops_its_board() {
    let rig = Rig::owing().await;
    rig.order(to_20());
    rig.after(20).await;
    rig.received();
    rig.end.send_replace(true);
    rig.after(1500).await;
    assert_eq!(rig.commands(), [stop(), Set::Speed(group(&[1]), vec![5.0])]);
    rig.after(500).await;
    assert_eq!(rig.received(), []);
}

/// The answer time of a board is always up to date: an idle board is queried every 0.1 s.
#[tokio::test(start_paused = true)]
async fn an_idle_board_is_queried() {
    let rig = Rig::up().await;
    rig.after(1000).await;
    let received = rig.received();
    let all = received.iter().all(|(_, word)| *word == Received::Request(Ask::Get(Get::Axes)));
    assert!(all && (8..=10).contains(&received.len()), "{received:?}");
    let took = rig.known(|known| known.answers.summary(1.2)).unwrap().greatest;
    assert_eq!(took, Duration::from_millis(1));
    let ahead = rig.known(|known| known.ahead).unwrap();
    assert!((ahead + 5.0 - 0.001).abs() < 1e-6, "its clock is five seconds ahead: {ahead}");
}

/// A setting to restore that the board refuses is sent three times; one without an answer, until there is one.
#[tokio::test(start_paused = true)]
async fn a_board_is_given_back_what_it_takes() {
    let before = Set::Speed(group(&[1]), vec![5.0]);
    for (is_answered, times) in [(true, 3), (false, 6)] {
        let rig = Rig::owing().await;
        let mut broken = 5;
        rig.board.plays(move |_, ask| match ask {
            Ask::Set(Set::Speed(_, speed)) if *speed == [5.0] && is_answered => Some(Trick::Refuses),
            Ask::Set(Set::Speed(_, speed)) if *speed == [5.0] && broken > 0 => {
                broken -= 1;
                Some(Trick::Breaks)
            }
            _ => None,
        });
        rig.order(Do::Reference { joints: vec![1], speed: vec![7.0], acceleration: vec![50.0] });
        rig.after(1000).await;
        let count = rig.commands().iter().filter(|set| **set == before).count();
        assert_eq!((count, rig.known(|known| known.owed.is_any())), (times, false), "answered: {is_answered}");
    }
}

/// The expected mode of a motor is the one that is about to be restored, of this motor and no other.
#[tokio::test(start_paused = true)]
async fn a_mode_that_is_given_back_is_expected() {
    let rig = Rig::owing().await;
    rig.known(|known| {
        let found = |mode| Finding { mode: Some(mode), speed: Some(5.0), ..Finding::default() };
        (known.owed, known.modes) = (Owed::new(2), vec![mode::POSITION; 2]);
        known.owed.find(vec![found(mode::POSITION), found(mode::VELOCITY)]);
        known.owed.changes(Restored::Speed, &[0]);
    });
    let expected = |rig: &Rig| {
        let inner = rig.cell.lock();
        (inner.expected.clone(), inner.switching.iter().map(Option::is_some).collect::<Vec<bool>>())
    };
    use ControlMode::{Position, Velocity};
    rig.after(100).await;
    assert_eq!(expected(&rig), (vec![Position; 3], vec![false; 3]), "a speed is no mode");
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Mode(..))).then(|| Trick::Says(reply::ok())));
    rig.known(|known| known.owed.changes(Restored::Mode, &[1]));
    rig.after(100).await;
    assert_eq!(expected(&rig), (vec![Position, Position, Velocity], vec![false, false, true]));
    rig.board.with(1, |axis| axis.mode = mode::VELOCITY);
    rig.after(50).await;
    assert_eq!(expected(&rig).1, [false; 3], "from now on what the board reports counts");
    assert_eq!(rig.commands(), [Set::Speed(group(&[0]), vec![5.0]), Set::Mode(group(&[1]), vec![mode::VELOCITY])]);
}
