//! Shared state: availability of the robot, bounds on the offset between the clocks, and wake-ups.

use super::super::layout::Patch;
use super::*;
use mobee_yarp::Dialect;

/// Two boards with one motor each.
fn layout() -> Layout {
    let patch =
        |part: &str, motors| Patch { part: part.into(), port: format!("/{part}"), motors, units: Default::default() };
    Layout {
        patches: vec![patch("arm", 0..1), patch("leg", 1..2)],
        home: vec![0.0; 2],
        names: vec!["elbow".into(), "knee".into()],
        limits: vec![(-1.0, 1.0); 2],
        speeds: Vec::new(),
        motions: Vec::new(),
    }
}

/// Both boards are available and have been read.
fn ready() -> SharedBoards {
    let cell = SharedBoards::new(&layout());
    cell.take();
    let mut inner = cell.lock();
    inner.boards.iter_mut().for_each(|known| (known.trouble, known.brake) = (None, None));
    inner.board = Some(Board { axes: vec![], period: Duration::ZERO, latency: Duration::ZERO, position_direct: true });
    inner.boards.iter_mut().for_each(|known| known.fresh = true);
    inner.join(&layout());
    drop(inner);
    cell
}

#[test]
fn a_robot_is_ready_once_all_of_it_is() {
    type Spoil = fn(&mut BoardsState);
    let spoils: [(&str, Spoil); 5] = [
        ("its board is not known", |inner| inner.board = None),
        ("it was never read", |inner| inner.joined = None),
        ("a board is lost", |inner| inner.boards[1].trouble = Some(Trouble::Lost("gone".into()))),
        ("a board can't be stopped", |inner| inner.boards[0].brake = Some("no line".into())),
        ("it does not fit", |inner| inner.misfit = Some(Trouble::Forbidden("axes".into()))),
    ];
    assert!(ready().lock().is_ready());
    for (why, spoil) in spoils {
        let cell = ready();
        spoil(&mut cell.lock());
        assert!(!cell.lock().is_ready(), "{why}");
    }
}

/// Permanent trouble is reported before temporary trouble; a missing stop connection comes last.
#[test]
fn the_worst_trouble_is_reported() {
    let cell = ready();
    let mut inner = cell.lock();
    assert_eq!(inner.trouble(), None);
    let (lost, forbidden) = (|why: &str| Trouble::Lost(why.into()), |why: &str| Trouble::Forbidden(why.into()));
    inner.boards[0].brake = Some("brake".into());
    assert_eq!(inner.trouble(), Some(lost("brake")));
    inner.boards[0].trouble = Some(lost("gone"));
    assert_eq!(inner.trouble(), Some(lost("gone")));
    inner.boards[1].trouble = Some(forbidden("taken"));
    assert_eq!(inner.trouble(), Some(forbidden("taken")));
    inner.misfit = Some(forbidden("axes"));
    assert_eq!(inner.trouble(), Some(forbidden("axes")));
}

/// No sample is made while a board is in trouble, however new its state is.
#[test]
fn a_reading_is_of_boards_that_can_be_used() {
    let cell = ready();
    let mut inner = cell.lock();
    inner.unread = false;
    let mut joins = |trouble: Option<Trouble>| {
        inner.boards.iter_mut().for_each(|known| known.fresh = true);
        inner.boards[1].trouble = trouble;
        inner.join(&layout());
        std::mem::take(&mut inner.unread)
    };
    assert!(!joins(Some(Trouble::Lost("gone".into()))));
    assert!(joins(None));
}

/// A waiting thread is woken when the robot is ready; if the robot is ready already, there is no wait.
#[test]
fn a_waiting_thread_is_woken() {
    let (cell, patience) = (ready(), Duration::from_secs(20));
    assert!(cell.wait(patience).is_ready());
    let mut inner = cell.lock();
    inner.boards[0].brake = Some("no line".into());
    std::thread::scope(|scope| {
        scope.spawn(|| {
            // not before the other thread waits and releases the lock
            cell.lock().boards[0].brake = None;
            cell.ring();
        });
        let (inner, waited) = cell.changed.wait_timeout(inner, patience).unwrap();
        assert!(inner.is_ready() && !waited.timed_out());
    });
    cell.lock().boards[0].brake = Some("no line".into());
    assert!(!cell.wait(Duration::ZERO).is_ready(), "its patience is over");
}

/// The stamp of an answer bounds the offset between our clock and the board's; invalid stamps are ignored.
#[test]
fn only_a_time_is_taken_for_a_stamp() {
    let ahead = |words: &str| {
        let cell = ready();
        let known = &mut cell.lock().boards[0];
        known.answered(2.0, 2.25, &Bottle::parse(words, Dialect::V3).unwrap());
        assert_eq!(known.answers.summary(2.25).unwrap().greatest, Duration::from_millis(250));
        known.ahead
    };
    assert_eq!(ahead("[is] [axes] 2 [tsta] 7 1.5 [ok]"), Some(0.75));
    for nothing in
        ["[ok]", "[is] [axes] 2 [tsta] 7 0.0 [ok]", "[is] [axes] 2 [tsta] 7 -1.5 [ok]", "[is] [axes] 2 7 1.5 [ok]"]
    {
        assert_eq!(ahead(nothing), None, "{nothing}");
    }
    let stamp = |time: f64| {
        let mut answer = Bottle::parse("[is] [axes] 2 [tsta] 7 1.5 [ok]", Dialect::V3).unwrap();
        answer.0[5] = mobee_yarp::Value::Float64(time);
        stamp_of(&answer)
    };
    assert_eq!([1.5, 0.0, -1.5, f64::INFINITY, f64::NAN].map(stamp), [Some(1.5), None, None, None, None]);
}

/// Findings of an earlier process are restored on those boards of which they contain every motor.
#[test]
fn findings_of_before_are_owed_where_they_are_complete() {
    let layout = layout();
    let found = |motor: usize| Finding { speed: Some(3.0), ..Finding::default() }.to_contract(motor);
    let cell = ready();
    let mut inner = cell.lock();
    inner.inherit(&layout, &[found(1)]);
    let known: Vec<bool> = inner.boards.iter().map(|known| known.owed.is_known()).collect();
    assert_eq!(known, [false, true]);
    assert!(inner.boards[1].owed.is_any());
}

#[test]
fn modes_are_what_boards_report() {
    let cell = ready();
    let mut inner = cell.lock();
    for mode in [ControlMode::Position, ControlMode::PositionDirect, ControlMode::Velocity, ControlMode::Idle] {
        (inner.boards[0].modes, inner.boards[1].modes) = (vec![word(mode)], vec![mode::TORQUE]);
        assert_eq!(inner.modes(&layout()), [mode, ControlMode::Idle], "what we know no name for is none of ours");
    }
}
