//! What a driver sends to which board, when it looks for readings, and what is known of two boards: in virtual time, without a network.

use super::super::YarpDriverSettings;
use super::super::cell::describe;
use super::super::layout::Patch;
use super::*;

use mobee_yarp::board::{AxisFacts, JointKind, mode};

const FIVE: [&str; 5] = ["pitch", "roll", "alone", "yaw", "elbow"];

/// Two boards of two joints each, and a motor between them that has none.
fn layout() -> Arc<Layout> {
    let patch = |part: &str, motors| Patch { part: part.into(), port: format!("/{part}"), motors };
    let names = FIVE.map(String::from).into();
    Arc::new(Layout {
        patches: vec![patch("arm", 0..2), patch("trunk", 3..5)],
        home: vec![0.0; 5],
        names,
        limits: vec![(-1.0, 1.0); 5],
    })
}

fn settings() -> YarpDriverSettings {
    YarpDriverSettings { max_speed_deg_per_s: 50.0, ..YarpDriverSettings::of([("arm", "/arm"), ("trunk", "/trunk")]) }
}

/// Joints with these limits and greatest speeds, degrees.
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
    /// What was queued for each board.
    orders: Vec<mpsc::Receiver<Order>>,
    _lease: watch::Receiver<Option<Instant>>,
}

/// Both boards are there, and were read once.
fn rig() -> Rig {
    let (layout, wide) = (layout(), facts(&[((-40.0, 40.0), None), ((-90.0, 90.0), Some(20.0))]));
    let cell = Arc::new(SharedBoards::new(&layout));
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
    Rig { driver: YarpDriver::new(reach, board, settings().moves), cell, orders, _lease: leases }
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
}

/// Until a mode was set, the board's reports of the mode before don't count: of the motors that were told, and of no others.
#[tokio::test(start_paused = true)]
async fn a_mode_counts_from_when_it_was_told() {
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
    let report = |inner: &mut Inner| {
        inner.boards.iter_mut().for_each(|known| known.fresh = true);
        inner.join(&layout);
        [inner.expected[1], inner.expected[4]]
    };
    assert_eq!(report(&mut inner), [ControlMode::Velocity; 2]);
    inner.switched([4].into_iter(), orders[1].ticket);
    assert_eq!(report(&mut inner), [ControlMode::Velocity, ControlMode::Position], "the second board did not do it");
}

/// A reading is looked for when it is due: a period after the last, and a tenth more; then five times a period.
#[tokio::test(start_paused = true)]
async fn readings_are_looked_for_when_they_are_due() {
    let mut rig = rig();
    let period = rig.driver.board().period;
    let now = Time::from_secs(3.0);
    assert_eq!(rig.driver.next_sample(now), now, "one is there");
    let read = rig.driver.sample(now).unwrap().unwrap();
    assert_eq!((read.seq, read.at), (0, now), "the first one tells the offset of the clocks: it was read now");
    assert_eq!(rig.driver.sample(now).unwrap(), None);
    assert_eq!(rig.driver.next_sample(now), now + period + period / 10);
    let late = now + 3 * period;
    assert_eq!(rig.driver.next_sample(late), late + period / 5);
}

/// All boards are read before there is a reading: as old as the oldest of them, and counted with those that were lost.
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
    let ticket = inner.boards[1].motions.order(&[1], End::Told);
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

/// The narrower limits and the lower speeds count; what has nothing in common is said.
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
