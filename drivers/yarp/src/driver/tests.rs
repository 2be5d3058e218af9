//! Orders of a driver to its boards, times of its readings, and state of two boards. Runs in virtual time,
//! without a network.

use super::super::YarpDriverSettings;
use super::super::cell::describe;
use super::super::layout::Patch;
use super::*;

use mobee_contract::{Axis, Move};
use mobee_model::JointMotion;
use mobee_yarp::board::{AxisFacts, JointKind, RemoteState, mode};
use mobee_yarp::{JointData, JointField};

const FIVE: [&str; 5] = ["pitch", "roll", "alone", "yaw", "elbow"];

/// Two boards of two joints each, and between them a motor without a board.
fn layout() -> Arc<Layout> {
    let patch =
        |part: &str, motors| Patch { part: part.into(), port: format!("/{part}"), motors, units: Default::default() };
    let names = FIVE.map(String::from).into();
    Arc::new(Layout {
        patches: vec![patch("arm", 0..2), patch("trunk", 3..5)],
        home: vec![0.0; 5],
        names,
        limits: vec![(-1.0, 1.0); 5],
        speeds: Vec::new(),
        motions: Vec::new(),
    })
}

fn settings() -> YarpDriverSettings {
    YarpDriverSettings { max_speed_deg_per_s: 50.0, ..YarpDriverSettings::of([("arm", "/arm"), ("trunk", "/trunk")]) }
}

/// Facts of joints with these limits, deg, and greatest speeds, deg/s.
fn facts(joints: &[((f64, f64), Option<f64>)]) -> Arc<[AxisFacts]> {
    let fact = |(limits, max_speed): &((f64, f64), Option<f64>)| AxisFacts {
        name: "JOINT0".into(),
        kind: JointKind::Revolute,
        limits: Some(*limits),
        max_speed: *max_speed,
    };
    joints.iter().map(fact).collect()
}

struct Rig {
    driver: YarpDriver,
    cell: Arc<SharedBoards>,
    /// Queued orders of each board.
    orders: Vec<mpsc::Receiver<Order>>,
    lease: watch::Receiver<Option<Instant>>,
}

/// Both boards are available and were read once.
fn rig() -> Rig {
    rig_of(settings().moves)
}

fn rig_of(moves: Moves) -> Rig {
    let (layout, wide) = (layout(), facts(&[((-40.0, 40.0), None), ((-90.0, 90.0), Some(20.0))]));
    let cell = Arc::new(SharedBoards::new(&layout));
    cell.take();
    let mut inner = cell.lock();
    for (i, known) in inner.boards.iter_mut().enumerate() {
        (known.trouble, known.brake, known.reached, known.facts) = (None, None, true, Some(wide.clone()));
        (known.fresh, known.read_at, known.q) = (true, 0.1 * i as f64, vec![i as f64, 10.0]);
        known.modes = vec![super::super::cell::word(ControlMode::Position); 2];
    }
    inner.board = describe(&layout, &inner.boards, &settings()).unwrap();
    inner.join(&layout);
    let board = inner.board.clone().unwrap();
    drop(inner);
    let (senders, orders) = (0..2).map(|_| mpsc::channel(4)).unzip();
    let (lease, leases) = watch::channel(None);
    let reach = Reach { layout, cell: cell.clone(), orders: senders, halt: Fan::new(Arc::default()), lease };
    Rig { driver: YarpDriver::new(reach, board, moves), cell, orders, lease: leases }
}

impl Rig {
    /// Commands a motor to move to 0.2 rad.
    fn moves(&mut self, now: Time, motor: usize) -> Result<(), DriverFault> {
        let to = Move { motors: vec![motor], q: vec![0.2], relative: false, speed: None, acceleration: None };
        self.driver.command(now, &Command::Move(to))
    }

    /// Sends new states of both boards and returns the next sample.
    fn read(&mut self, now: Time) -> Sample {
        let layout = layout();
        let mut inner = self.cell.lock();
        inner.boards.iter_mut().for_each(|known| known.fresh = true);
        inner.join(&layout);
        drop(inner);
        self.driver.sample(now).unwrap().unwrap()
    }

    /// Orders queued for the first board.
    fn queued(&mut self) -> Vec<Do> {
        std::iter::from_fn(|| self.orders[0].try_recv().ok()).map(|order| order.what).collect()
    }
}

#[tokio::test(start_paused = true)]
async fn a_lease_ends_by_either_clock() {
    let go = |rig: &mut Rig, now: f64| {
        let command = Command::Velocity { motors: vec![0], speed: vec![0.1] };
        rig.driver.command(Time::from_secs(now), &command).is_ok()
    };
    let mut rig = rig();
    assert!(!go(&mut rig, 1.0), "there is none");
    rig.driver.lease(Time::from_secs(1.0), Time::from_secs(1.5));
    assert!(go(&mut rig, 1.4) && !go(&mut rig, 1.5), "by the run's time");
    tokio::time::sleep(Duration::from_millis(600)).await;
    assert!(!go(&mut rig, 1.4), "by the time of the watch");
    rig.driver.lease(Time::from_secs(1.4), Time::from_secs(1.9));
    assert!(go(&mut rig, 1.4));
    rig.driver.lease(Time::from_secs(1.4), Time::from_secs(1.4));
    assert!(!go(&mut rig, 1.4), "it was given up");
    assert_eq!(*rig.lease.borrow(), None, "and there is nothing left to watch");
    rig.driver.lease(Time::from_secs(1.4), Time::from_secs(1.9));
    tokio::time::advance(Duration::from_millis(500)).await;
    assert!(!go(&mut rig, 1.4), "it ends on the dot");
}

/// Boards that are lost, belong to another program, can't be stopped or have a fault are neither commanded nor
/// read.
#[tokio::test(start_paused = true)]
async fn a_robot_in_trouble_is_not_used() {
    use super::super::cell::BoardFacts;
    type Spoil = fn(&mut BoardFacts);
    let spoils: [(Spoil, DriverFault); 4] = [
        (|known| known.trouble = Some(Trouble::Lost("gone".into())), DriverFault::Lost),
        (|known| known.brake = Some("no line".into()), DriverFault::Lost),
        (|known| known.trouble = Some(Trouble::Forbidden("taken".into())), DriverFault::Hardware("taken".into())),
        (
            |known| known.modes[0] = mode::HARDWARE_FAULT,
            DriverFault::Hardware("motor yaw (joint 0 of /trunk) has a hardware fault".into()),
        ),
    ];
    for (spoil, fault) in spoils {
        let mut rig = rig();
        let now = Time::from_secs(1.0);
        rig.driver.lease(now, now + Duration::from_secs(1));
        assert_eq!(rig.moves(now, 0), Ok(()));
        rig.queued();
        spoil(&mut rig.cell.lock().boards[1]);
        assert_eq!(rig.moves(now, 0), Err(fault.clone()));
        assert_eq!(rig.driver.command(now, &Command::Stop { motors: vec![] }), Err(fault.clone()));
        assert_eq!(rig.driver.sample(now), Err(fault));
        assert!(rig.queued().is_empty());
    }
}

/// A motion expects the mode that it needs, for its own motors only, from the command on.
#[tokio::test(start_paused = true)]
async fn a_motion_expects_its_mode() {
    let mut rig = rig();
    let now = Time::from_secs(1.0);
    rig.driver.lease(now, now + Duration::from_secs(1));
    rig.cell.lock().expected = vec![ControlMode::PositionDirect; 5];
    rig.moves(now, 1).unwrap();
    rig.driver.command(now, &Command::Velocity { motors: vec![3], speed: vec![0.1] }).unwrap();
    let inner = rig.cell.lock();
    let other = ControlMode::PositionDirect;
    assert_eq!(inner.expected, [other, ControlMode::Position, other, ControlMode::Velocity, other]);
    assert_eq!(inner.switching, [None, Some(1), None, Some(1), None]);
}

/// A move made of setpoints ends with its lease and with a stop, even if a new lease has come since.
#[tokio::test(start_paused = true)]
async fn set_points_end_with_the_lease_and_with_a_stop() {
    for stopped in [false, true] {
        let mut rig = rig_of(Moves::SetPoints);
        let at = |ms: u64| Time(1_000_000_000 + ms * 1_000_000);
        rig.driver.lease(at(0), at(500));
        rig.moves(at(0), 0).unwrap();
        assert!(matches!(rig.queued()[..], [Do::Mode { mode: ControlMode::PositionDirect, .. }]));
        for ms in [20, 40] {
            let done = rig.read(at(ms)).done;
            assert!(matches!(rig.queued()[..], [Do::Direct { .. }]));
            assert_eq!(done, [false, true, true, true, true], "the others rest");
        }
        if stopped {
            let reach = rig.driver.reach.clone();
            reach.stop_all(&mut rig.cell.lock());
        } else {
            rig.driver.lease(at(50), at(50));
        }
        rig.read(at(60));
        assert!(!rig.queued().iter().any(Do::moves), "stopped: {stopped}");
    }
}

/// The times of readings increase strictly, whatever the clocks of the boards show, and are never in the
/// future.
#[tokio::test(start_paused = true)]
async fn readings_follow_each_other() {
    let mut rig = rig();
    let now = Time::from_secs(3.0);
    let first = rig.read(now).at;
    assert_eq!(first, now, "its delay is the smallest that was seen");
    tokio::time::advance(Duration::from_millis(20)).await;
    let then = now + Duration::from_millis(20);
    assert_eq!(rig.read(then).at, first + Duration::from_nanos(1), "told to be of the same time");
    rig.cell.lock().boards.iter_mut().for_each(|known| known.read_at += 0.5);
    assert_eq!(rig.read(then).at, then);
}

/// Answer time of the slowest board.
#[tokio::test(start_paused = true)]
async fn the_answer_time_is_that_of_the_slowest_board() {
    let rig = rig();
    assert_eq!(rig.driver.answer_time(), None);
    for (board, took) in [(0, 0.004), (1, 0.03)] {
        rig.cell.lock().boards[board].answers.note(0.0, took);
    }
    assert_eq!(rig.driver.answer_time().map(|answers| answers.most), Some(Duration::from_millis(30)));
}

/// The mode of a commanded motor comes from the command until the mode was set; the board's reports before that
/// do not count. Other motors are not affected.
#[tokio::test(start_paused = true)]
async fn a_mode_counts_from_its_command_on() {
    let mut rig = rig();
    let told = Command::Mode { motors: vec![1, 4], mode: ControlMode::Velocity };
    rig.driver.command(Time::ZERO, &told).unwrap();
    let orders: Vec<Order> = rig.orders.iter_mut().map(|q| q.try_recv().unwrap()).collect();
    let joints =
        |order: &Order| matches!(&order.what, Do::Mode { joints, mode: ControlMode::Velocity } if *joints == [1]);
    assert!(orders.iter().all(joints), "{orders:?}");
    let layout = layout();
    let mut inner = rig.cell.lock();
    let set: Vec<usize> = (0..5).filter(|m| inner.switching[*m].is_some()).collect();
    assert_eq!(set, [1, 4]);
    assert_eq!(
        [1, 4, 3].map(|m| inner.expected[m]),
        [ControlMode::Velocity, ControlMode::Velocity, ControlMode::Position]
    );
    let report = |inner: &mut BoardsState| {
        inner.boards.iter_mut().for_each(|known| known.fresh = true);
        inner.join(&layout);
        [inner.expected[1], inner.expected[4]]
    };
    assert_eq!(report(&mut inner), [ControlMode::Velocity; 2]);
    inner.switched([4].into_iter(), orders[1].ticket);
    assert_eq!(report(&mut inner), [ControlMode::Velocity, ControlMode::Position], "the second board did not do it");
}

/// A reading is due one period after the last one, with a margin of a tenth; after that it is polled five times
/// per period.
#[tokio::test(start_paused = true)]
async fn readings_are_looked_for_when_they_are_due() {
    let mut rig = rig();
    let period = rig.driver.board().period;
    let now = Time::from_secs(3.0);
    assert_eq!(rig.driver.next_sample(now), now, "one is there");
    let read = rig.driver.sample(now).unwrap().unwrap();
    assert_eq!((read.seq, read.at), (0, now), "the first one tells the offset of the clocks: it was read now");
    assert_eq!(rig.driver.sample(now).unwrap(), None);
    let due = now + period + period / 10;
    assert_eq!(rig.driver.next_sample(now), due);
    assert_eq!(rig.driver.next_sample(due), due + period / 5);
    let late = now + 3 * period;
    assert_eq!(rig.driver.next_sample(late), late + period / 5);
}

/// A sample needs readings of all boards. Its time is that of the oldest one, and lost states are counted.
#[tokio::test(start_paused = true)]
async fn a_reading_is_joined_of_all_boards() {
    let rig = rig();
    let layout = layout();
    let mut inner = rig.cell.lock();
    let joined = inner.joined.clone().unwrap();
    let deg: Vec<f64> = joined.q.iter().map(|q| q.to_degrees().round()).collect();
    assert_eq!((deg, joined.at, joined.seq), (vec![0.0, 10.0, 0.0, 1.0, 10.0], 0.0, 0));
    inner.unread = false;
    inner.boards[0].fresh = true;
    inner.join(&layout);
    assert!(!inner.unread, "the other board said nothing");
    let ticket = inner.boards[1].motions.order(&[1], End::Reported);
    (inner.boards[1].fresh, inner.boards[1].lost.0, inner.boards[0].lost.0, inner.boards[0].read_at) =
        (true, 3, 2, 0.5);
    inner.join(&layout);
    let joined = inner.joined.clone().unwrap();
    assert_eq!(
        (joined.seq, joined.at, ticket),
        (4, 0.1, 1),
        "three were lost at one board, and two of them at the other"
    );
    assert_eq!(joined.done, [true, true, true, true, false]);
    inner.boards.iter_mut().for_each(|known| known.fresh = true);
    inner.join(&layout);
    assert_eq!(inner.joined.as_ref().map(|j| j.seq), Some(5), "they are counted once");
    assert_eq!(inner.fault(&layout), None);
    inner.boards[1].modes[1] = mode::HARDWARE_FAULT;
    assert_eq!(inner.fault(&layout).unwrap(), "motor elbow (joint 1 of /trunk) has a hardware fault");
}

/// Sets the torques that a board's newest state reports.
fn reports(known: &mut super::super::cell::BoardFacts, torque: JointField) {
    let joints = JointData { position: JointField::known(vec![0.0; 2]), torque, ..JointData::default() };
    known.received = Some(Arc::new(RemoteState { seq: 0, stamp: None, arrived: instant(), joints }));
}

/// External torque is the negative of the joint torque. Torques that the board marks invalid, and those that
/// are not finite, are omitted.
#[tokio::test(start_paused = true)]
async fn torques_that_a_board_vouches_for_are_what_pushes_its_motors() {
    let cases = [
        (JointField::known(vec![1.5, -2.0]), vec![0.0, 0.0, 0.0, -1.5, 2.0]),
        (JointField::known(vec![f64::NAN, f64::INFINITY]), vec![0.0; 5]),
        (JointField { values: vec![1.5, -2.0], valid: false }, vec![]),
        (JointField::known(vec![1.5]), vec![]),
        (JointField::known(vec![1.5, 2.0, 3.0]), vec![]),
    ];
    for (torque, expected) in cases {
        let mut rig = rig();
        reports(&mut rig.cell.lock().boards[1], torque.clone());
        assert_eq!(rig.read(Time::from_secs(1.0)).external, expected, "{torque:?}");
    }
}

/// The force guard uses the motors whose boards report torques, with thresholds from the settings only.
#[tokio::test(start_paused = true)]
async fn what_a_torque_means_is_for_the_settings_to_state() {
    let rig = rig();
    let mut inner = rig.cell.lock();
    reports(&mut inner.boards[1], JointField::known(vec![0.5, 0.5]));
    let board = describe(&layout(), &inner.boards, &settings()).unwrap().unwrap();
    let stated: Vec<f64> = board.axes.iter().map(|axis| axis.contact_effort).collect();
    assert_eq!(stated, [0.0, 0.0, 0.0, Axis::UNRATED, Axis::UNRATED]);
}

/// No board reports how far a push moves its joints, so the settings state it; prismatic joints do not give way.
#[tokio::test(start_paused = true)]
async fn joints_give_way_as_the_settings_state() {
    let rig = rig();
    let inner = rig.cell.lock();
    let stated = |deflection_deg: f64, kind: JointMotion| {
        let motions = vec![JointMotion::Turn, JointMotion::Turn, JointMotion::Turn, JointMotion::Turn, kind];
        let layout = Layout { motions, ..Layout::clone(&layout()) };
        let settings = YarpDriverSettings { deflection_deg, ..settings() };
        let board = describe(&layout, &inner.boards, &settings).unwrap().unwrap();
        board.axes.iter().map(|axis| axis.deflection.to_degrees().round()).collect::<Vec<f64>>()
    };
    // the motor in the middle has no board
    assert_eq!(stated(3.0, JointMotion::Turn), [3.0, 3.0, 0.0, 3.0, 3.0]);
    assert_eq!(stated(3.0, JointMotion::Slide), [3.0, 3.0, 0.0, 3.0, 0.0]);
    assert_eq!(stated(0.0, JointMotion::Turn), [0.0; 5]);
    assert!(YarpDriverSettings { deflection_deg: -1.0, ..settings() }.validate().is_err());
}

/// The narrower limits and the lower speeds apply; limits without a common range are an error.
#[tokio::test(start_paused = true)]
async fn boards_are_described_by_what_both_sides_know() {
    let rig = rig();
    let layout = layout();
    let near = |a: f64, deg: f64| (a - deg.to_radians()).abs() < 1e-12;
    let axes = &rig.driver.board().axes;
    assert_eq!(axes.iter().map(|a| a.name.as_str()).collect::<Vec<_>>(), FIVE);
    assert!(near(axes[3].min, -40.0) && near(axes[3].max, 40.0) && near(axes[3].max_speed, 50.0), "{:?}", axes[3]);
    assert!(axes[4].min == -1.0 && axes[4].max == 1.0 && near(axes[4].max_speed, 20.0), "{:?}", axes[4]);
    let close = |all: Vec<f64>, degrees: &[f64]| {
        assert_eq!(all.len(), degrees.len());
        all.iter().zip(degrees).all(|(a, b)| (a - b).abs() < 1e-9)
    };
    assert!(close(rig.cell.greatest(&layout, 1, &[1, 0]), &[20.0, 50.0]));
    let limits = rig.cell.limits(&layout, 1).into_iter().flat_map(|(min, max)| [min, max]).collect();
    assert!(close(limits, &[-40.0, 40.0, -1_f64.to_degrees(), 1_f64.to_degrees()]));

    let mut inner = rig.cell.lock();
    let mut described = |of: Option<Arc<[AxisFacts]>>| {
        inner.boards[1].facts = of;
        describe(&layout, &inner.boards, &settings()).map(|board| board.is_some())
    };
    assert_eq!(described(None), Ok(false));
    let one = ((-40.0, 40.0), None);
    assert_eq!(described(Some(facts(&[one, one, one]))), Ok(true), "more axes than the model has motors");
    let few = described(Some(facts(&[one]))).unwrap_err();
    assert!(few.contains("/trunk has 1 axes") && few.contains("2 motors"), "{few}");
    let apart = described(Some(facts(&[one, ((70.0, 90.0), None)]))).unwrap_err();
    assert!(apart.contains("limits of elbow at /trunk"), "{apart}");
}
