//! Execution of each order, and detection of its end.

use super::*;

/// A refusal of the stiffness, mode or speed ends the move, because it would differ from the one ordered.
#[tokio::test(start_paused = true)]
async fn a_move_is_not_made_where_the_board_refuses_what_comes_before_it() {
    type Which = fn(&Ask) -> bool;
    let refused: [(&str, Which); 3] = [
        ("stiffness", |ask| matches!(ask, Ask::Set(Set::Interaction(..)))),
        ("mode", |ask| matches!(ask, Ask::Set(Set::Mode(..)))),
        ("speed", |ask| matches!(ask, Ask::Set(Set::Speed(..)))),
    ];
    for (what, which) in refused {
        let rig = Rig::up().await;
        rig.board.with(1, |axis| axis.interaction = mode::COMPLIANT);
        rig.is_in(ControlMode::Velocity).await;
        // the refused setting may still change a moment later, by another program
        rig.board.plays(move |board, ask| {
            which(ask).then(|| {
                board.with(1, |axis| (axis.interaction, axis.mode) = (mode::STIFF, mode::POSITION));
                Trick::Refuses
            })
        });
        rig.order(to_20());
        rig.after(100).await;
        let commands = rig.commands();
        assert!(which(&Ask::Set(commands.last().unwrap().clone())), "{what} was refused: {commands:?}");
        rig.after(2500).await;
        assert!(!rig.commands().contains(&moves()), "{what} was refused");
        assert_eq!(rig.done(), [true, true], "nothing is under way");
    }
}

/// A refused move is not repeated, and its end is not awaited.
#[tokio::test(start_paused = true)]
async fn a_move_that_is_refused_is_over() {
    let rig = Rig::up().await;
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Move { .. })).then_some(Trick::Refuses));
    rig.order(to_20());
    rig.after(50).await;
    assert_eq!(rig.commands(), [Set::Speed(group(&[1]), vec![10.0]), moves()]);
    rig.after(300).await;
    assert_eq!(rig.done(), [true, true]);
}

/// Compliant joints, and no others, are made stiff before they move to positions; joints with velocity commands
/// may be compliant.
#[tokio::test(start_paused = true)]
async fn joints_that_give_way_are_made_stiff_before_they_are_sent_somewhere() {
    let rig = Rig::up().await;
    rig.board.with(0, |axis| axis.interaction = mode::COMPLIANT);
    rig.is_in(ControlMode::Position).await;
    rig.order(to_20());
    rig.after(50).await;
    assert_eq!(rig.commands(), [Set::Speed(group(&[1]), vec![10.0]), moves()], "it is stiff");
    rig.order(Do::Mode { joints: vec![0, 1], mode: ControlMode::Velocity });
    rig.after(50).await;
    assert_eq!(rig.commands(), [Set::Mode(group(&[0, 1]), vec![mode::VELOCITY; 2])]);
    // the joint becomes stiff some time after the answer
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Interaction(..))).then(|| Trick::Says(reply::ok())));
    rig.order(Do::Mode { joints: vec![0, 1], mode: ControlMode::PositionDirect });
    rig.after(200).await;
    assert_eq!(rig.commands(), [Set::Interaction(group(&[0]), vec![mode::STIFF])]);
    rig.board.with(0, |axis| axis.interaction = mode::STIFF);
    rig.after(20).await;
    assert_eq!(rig.commands(), [Set::Mode(group(&[0, 1]), vec![mode::DIRECT; 2])]);
}

/// Only joints in other modes are switched, and no move is sent before the board has reported the new mode.
#[tokio::test(start_paused = true)]
async fn a_move_waits_for_the_mode_to_be_reported() {
    let rig = Rig::up().await;
    rig.board.with(0, |axis| axis.mode = mode::VELOCITY);
    rig.is_in(ControlMode::Position).await;
    rig.board.with(0, |axis| axis.mode = mode::VELOCITY);
    rig.after(20).await;
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Mode(..))).then(|| Trick::Says(reply::ok())));
    let both = Do::Move { joints: vec![1, 0], to: vec![20.0, 9.0], speed: None, acceleration: None };
    rig.order(both);
    rig.after(300).await;
    assert_eq!(rig.commands(), [Set::Mode(group(&[0]), vec![mode::POSITION])]);
    rig.board.with(0, |axis| axis.mode = mode::POSITION);
    rig.after(20).await;
    let go = Set::Move { joints: group(&[1, 0]), values: vec![20.0, 9.0], relative: false };
    assert_eq!(rig.commands(), [go]);
}

/// A board whose states don't contain modes is queried, at every fourth check.
#[tokio::test(start_paused = true)]
async fn modes_are_queried_if_states_do_not_contain_them() {
    let rig = Rig::up().await;
    *rig.board.tells_modes.lock().unwrap() = false;
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Mode(..))).then(|| Trick::Says(reply::ok())));
    rig.order(Do::Mode { joints: vec![1], mode: ControlMode::PositionDirect });
    rig.after(300).await;
    let queries =
        rig.received().into_iter().filter(|(_, word)| *word == Received::Request(Ask::Get(Get::Modes(Joints::All))));
    assert!((10..=15).contains(&queries.count()));
    let switching = |rig: &Rig| rig.cell.lock().switching[2].is_some();
    assert!(switching(&rig));
    rig.board.with(1, |axis| axis.mode = mode::DIRECT);
    rig.after(40).await;
    assert!(!switching(&rig));
    assert_eq!(rig.known(|known| known.modes.clone()), [mode::POSITION, mode::DIRECT]);
}

/// A missing mode is awaited for two seconds; then all orders that wait for it fail.
#[tokio::test(start_paused = true)]
async fn a_mode_that_does_not_come_is_given_up() {
    let rig = Rig::up().await;
    rig.board.plays(|_, ask| matches!(ask, Ask::Set(Set::Mode(..))).then(|| Trick::Says(reply::ok())));
    let switching = |rig: &Rig| rig.cell.lock().switching.clone();
    rig.order(Do::Mode { joints: vec![1], mode: ControlMode::Velocity });
    rig.cell.lock().switching[1] = Some(99);
    rig.after(1900).await;
    assert_eq!(switching(&rig), [None, Some(99), Some(1)]);
    rig.after(700).await;
    assert_eq!(switching(&rig), [None, Some(99), None], "of the motor that the order was about, and of no other");
}

/// Setpoints are sent only to joints that report the mode for setpoints.
#[tokio::test(start_paused = true)]
async fn set_points_need_their_mode() {
    let rig = Rig::up().await;
    let there = || Do::Direct { joints: vec![0], to: vec![3.0] };
    rig.order(there());
    rig.after(20).await;
    assert_eq!(rig.streamed(), []);
    rig.board.with(0, |axis| axis.mode = mode::DIRECT);
    rig.after(20).await;
    rig.order(there());
    rig.after(20).await;
    assert_eq!(rig.streamed(), [Streamed::Direct(group(&[0]), vec![3.0])]);
    // limited by the board's greatest speed
    let fast = |rig: &Rig, speed: f64| rig.known(|known| known.pace.exceeded(&[speed, 0.0], 10.0)).is_some();
    assert!(!fast(&rig, 104.0) && fast(&rig, 106.0));
}

/// A joint that exceeds its commanded speed is detected, for every kind of command.
#[tokio::test(start_paused = true)]
async fn a_commanded_speed_is_monitored() {
    let fast = |rig: &Rig, speed: f64| rig.known(|known| known.pace.exceeded(&[0.0, speed], 10.0)).is_some();
    let rig = Rig::up().await;
    assert!(!fast(&rig, 1e6), "it was told nothing");
    rig.order(to_20());
    rig.after(20).await;
    assert!(!fast(&rig, 24.0) && fast(&rig, 26.0), "10 deg/s, eased in and out, and noise");
    rig.order(Do::Velocity { joints: vec![1], speed: vec![4.0] });
    rig.after(20).await;
    assert!(!fast(&rig, 104.0) && fast(&rig, 106.0), "whatever it was told, no more than its greatest speed");
}

/// Velocities are repeated while they are refreshed, and sent once as zero when they expire. A joint with a
/// velocity counts as moving, whatever its encoder shows.
#[tokio::test(start_paused = true)]
async fn velocities_are_repeated_while_they_are_refreshed() {
    let rig = Rig::up().await;
    rig.is_in(ControlMode::Velocity).await;
    rig.order(Do::Velocity { joints: vec![0, 1], speed: vec![4.0, 0.0] });
    rig.after(200).await;
    let sent = |(ms, received)| if let Received::Streamed(sent) = received { Some((ms, sent)) } else { None };
    let velocities: Vec<(u64, Streamed)> = rig.received().into_iter().filter_map(sent).collect();
    let all = |v: f64| Streamed::Velocity(group(&[0, 1]), vec![v, 0.0]);
    let (last, before) = velocities.split_last().unwrap();
    assert!(last.1 == all(0.0) && before.iter().all(|(_, sent)| *sent == all(4.0)), "{velocities:?}");
    assert!(velocities.windows(2).all(|pair| pair[1].0 - pair[0].0 <= 41), "{velocities:?}");
    let holds = last.0 - velocities[0].0;
    assert!((100..=145).contains(&holds), "it holds for a tenth of a second: {holds} ms");
    rig.order(Do::Velocity { joints: vec![0, 1], speed: vec![4.0, 0.0] });
    rig.after(150).await;
    assert_eq!(rig.done(), [false, true]);
    rig.after(110).await;
    assert_eq!(rig.done(), [true, true]);
}

/// The end of a move is the one that the board reports. If the board can't report it, the encoders are used.
#[tokio::test(start_paused = true)]
async fn a_move_ends_when_the_board_reports_it() {
    let rig = Rig::up().await;
    rig.order(to_20());
    rig.after(300).await;
    assert_eq!(rig.done(), [true, false], "it rests, and is not there yet");
    // an invalid answer and a missing answer are both ignored
    for nothing in [true, false] {
        rig.board.with(1, |axis| axis.done = true);
        rig.board.plays(move |_, ask| {
            let trick = if nothing { Trick::Breaks } else { Trick::Says(reply::ok()) };
            matches!(ask, Ask::Get(Get::Done(_))).then_some(trick)
        });
        rig.after(300).await;
        assert_eq!(rig.done(), [true, false]);
    }
    rig.board.plays(|_, _| None);
    rig.after(40).await;
    assert_eq!(rig.done(), [true, true]);
    rig.received();
    // a board that can't report the end is not queried again
    rig.board.plays(|_, ask| matches!(ask, Ask::Get(Get::Done(_))).then_some(Trick::Refuses));
    let queries = |rig: &Rig| {
        rig.received().iter().filter(|(_, w)| matches!(w, Received::Request(Ask::Get(Get::Done(_))))).count()
    };
    rig.order(to_20());
    rig.after(40).await;
    assert_eq!((queries(&rig), rig.done()), (1, vec![true, false]));
    rig.after(200).await;
    assert_eq!((queries(&rig), rig.done()), (0, vec![true, true]));
}

/// A stop of single joints is an order like any other.
#[tokio::test(start_paused = true)]
async fn single_joints_are_stopped_on_the_line_of_orders() {
    let rig = Rig::up().await;
    rig.order(to_20());
    rig.order(Do::Velocity { joints: vec![0], speed: vec![4.0] });
    rig.after(20).await;
    rig.received();
    rig.order(Do::Stop { joints: vec![0] });
    rig.after(100).await;
    assert_eq!(rig.done(), [false, false], "until it has been seen to rest");
    let received = rig.received();
    let sent = received.iter().filter(|(_, word)| matches!(word, Received::Streamed(_))).count();
    assert!(received.iter().any(|(_, word)| *word == Received::Request(Ask::Set(Set::Stop(group(&[0]))))) && sent == 0);
    rig.after(100).await;
    assert_eq!(rig.done(), [true, false]);
}
