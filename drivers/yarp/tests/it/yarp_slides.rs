//! Motors that slide, over real sockets: the model counts millimeters, the boards meters, and nothing is off by a thousand.

use crate::net::{Net, Rig, sliding};
use mobee_contract::{Command, ControlMode, Driver, DriverFault, Hardware, Move, Sample};
use mobee_driver_yarp::YarpHardware;
use mobee_model::JointMotion;
use std::time::Duration;

/// The model's rad in encoder units: mm where it slides, deg where it turns.
fn units(q: &[f64]) -> Vec<f64> {
    q.iter().map(|q| q.to_degrees()).collect()
}

fn radians(q: &[f64]) -> Vec<f64> {
    q.iter().map(|q| q.to_radians()).collect()
}

fn near(a: &[f64], b: &[f64], tolerance: f64) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < tolerance)
}

fn rests_at(s: &Sample, q: &[f64]) -> bool {
    near(&units(&s.q), q, 0.2) && s.done.iter().all(|done| *done)
}

/// Gives a command with every reading until the rail, as its board has it, has passed a place, m.
fn until_past(rig: &Rig, driver: &mut Box<dyn Driver>, place: f64, command: impl Fn(f64) -> Command) {
    rig.wait("the rail to get there", |now| {
        let at = rig.net.truth()[0];
        driver.lease(now, now + Duration::from_millis(500));
        if driver.sample(now).unwrap().is_some() {
            driver.command(now, &command(at)).unwrap();
        }
        (at > place).then_some(())
    });
}

#[test]
fn a_rail_is_driven_in_millimeters_and_its_board_moves_in_meters() {
    let (robot, settings) = sliding();
    let rig = Rig::on(Net::of(robot, settings));
    let mut driver = rig.hardware.connect().unwrap();
    let axes = driver.board().axes.clone();
    assert!(near(&units(&[axes[0].min, axes[0].max, axes[0].max_speed]), &[-400.0, 600.0, 100.0], 1e-6), "{axes:?}");
    assert!(near(&units(&[axes[2].min, axes[2].max]), &[0.0, 40.0], 1e-6), "{axes:?}");
    rig.reading(&mut driver, "home", |s| rests_at(s, &[0.0, 0.0, 20.0]));

    // a move of the board's own
    let (q, speed) = (radians(&[60.0, -12.0, 30.0]), Some(radians(&[90.0, 30.0, 20.0])));
    let to = Move { motors: vec![0, 1, 2], q, relative: false, speed, acceleration: None };
    driver.command(rig.now(), &Command::Move(to)).unwrap();
    rig.reading(&mut driver, "the target", |s| rests_at(s, &[60.0, -12.0, 30.0]));
    let there = rig.net.truth();
    assert!(
        (there[0] - 0.06).abs() < 2e-4 && (there[1] + 12.0).abs() < 0.2 && (there[2] - 0.03).abs() < 2e-4,
        "{there:?}"
    );

    // velocities, through command:i
    let velocity = |v: f64| Command::Velocity { motors: vec![0], speed: vec![v.to_radians()] };
    until_past(&rig, &mut driver, 0.08, |_| velocity(40.0));
    driver.command(rig.now(), &velocity(0.0)).unwrap();
    rig.reading(&mut driver, "rest", |s| s.done.iter().all(|done| *done));
    let at = rig.net.truth()[0];
    assert!((0.08..0.12).contains(&at), "it stopped where it was told to: {at}");

    // set-points, through command:i
    driver.command(rig.now(), &Command::Mode { motors: vec![0], mode: ControlMode::PositionDirect }).unwrap();
    rig.reading(&mut driver, "the mode for set-points", |_| {
        rig.net.boards[0].joint_settings()[0].mode == mobee_yarp::board::mode::DIRECT
    });
    let direct = |mm: f64| Command::Direct { motors: vec![0], q: vec![mm.to_radians()] };
    until_past(&rig, &mut driver, 0.14, |at| direct(at * 1000.0 + 2.0));
    let at = rig.net.truth()[0];
    assert!((0.14..0.16).contains(&at), "two millimeters ahead at a time: {at}");

    // what was found is given back in the board's own unit
    let found = rig.net.boards[0].joint_settings();
    driver.command(rig.now(), &Command::Stop { motors: vec![] }).unwrap();
    drop(driver);
    assert!(found[0].speed < 1.0, "m/s: {found:?}");
}

/// What slides in the model must slide on the board, and what turns must turn: else every number would be another's.
#[test]
fn a_board_of_the_other_kind_is_refused_by_name() {
    let refusal = |motor: usize, motion: JointMotion| {
        let (robot, settings) = sliding();
        let mut other = robot.clone();
        other.motors[motor].motion = motion;
        let net = Net::of(robot, settings.clone());
        let hardware = YarpHardware::on(&net.network(), &settings, &other).unwrap();
        match hardware.connect() {
            Err(DriverFault::Refused(why) | DriverFault::Hardware(why)) => why,
            other => panic!("not refused: {:?}", other.err()),
        }
    };
    let why = refusal(0, JointMotion::Turn);
    for word in ["joint 0 of /two/arm slides", "motor rail of the model turns", "correct the type"] {
        assert!(why.contains(word), "{why}");
    }
    let why = refusal(1, JointMotion::Slide);
    assert!(why.contains("joint 1 of /two/arm turns") && why.contains("motor turn of the model slides"), "{why}");
}
