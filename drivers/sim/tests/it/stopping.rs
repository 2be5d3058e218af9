//! The reaction and braking path of the shipped iCub.

use mobee_contract::{Command, Context, Hardware, Move, Time};
use mobee_sim::{SimHardware, SimSettings, stopping_path};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn icub() -> Arc<mobee_model::Robot> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/icub.xml");
    Arc::new(mobee_model::load_robot(file).unwrap().value)
}

#[test]
fn the_path_is_reaction_and_braking_times_reach() {
    let robot = icub();
    let hardware = SimHardware::new(&SimSettings::ideal(), &Context { robot: robot.clone(), seed: 1 }).unwrap();
    let board = hardware.connect().unwrap().board().clone();
    let path = |share| stopping_path(&robot, &board, Duration::from_millis(20), share);
    let slow = path(0.1);
    // at 10 deg/s: 50 ms of reaction and 50 ms of braking at half the speed, 0.75 deg, at most about a meter away
    let reach = robot.reach()[slow.single.0];
    assert!((slow.single.1 - reach * 0.75f64.to_radians()).abs() < 1e-12);
    assert!(slow.single.1 <= slow.chain_typical + 1e-12 && slow.chain_typical <= slow.chain_bound);
    assert!(slow.warning(slow.single.1 + 1e-6, &robot).is_none());
    let warning = slow.warning(0.5 * slow.single.1, &robot).unwrap();
    assert!(warning.contains(&robot.motors[slow.single.0].name), "{warning}");
    assert!(path(1.0).single.1 > 10.0 * slow.single.1);
    assert_eq!(path(f64::NAN), path(1.0));
    eprintln!("stopping path at 10 %: {slow:?}\nat full speed: {:?}", path(1.0));
}

#[test]
fn no_motor_needs_longer_to_stop_than_is_foreseen() {
    let robot = icub();
    let settings = SimSettings::ideal().exact();
    let hardware = SimHardware::new(&settings, &Context { robot: robot.clone(), seed: 1 }).unwrap();
    let mut driver = hardware.connect().unwrap();
    let axes = driver.board().axes.clone();
    driver.lease(Time::ZERO, Time::from_secs(100.0));
    let all: Vec<usize> = (0..axes.len()).collect();
    let far = axes.iter().zip(&robot.motors).map(|(a, m)| if a.max - m.home > m.home - a.min { a.max } else { a.min });
    let speed = 0.1;
    let go = Move {
        motors: all.clone(),
        q: far.collect(),
        relative: false,
        speed: Some(axes.iter().map(|a| speed * a.max_speed).collect()),
        acceleration: None,
    };
    driver.command(Time::ZERO, &Command::Move(go)).unwrap();
    for ms in [300, 700, 1500] {
        let mut copy = hardware.positions(Time(ms * 1_000_000));
        let told = Time(ms * 1_000_000);
        if ms == 1500 {
            driver.command(told, &Command::Stop { motors: vec![] }).unwrap();
            let rest = hardware.positions(told + Duration::from_secs(1));
            for ((a, before), after) in axes.iter().zip(copy.drain(..)).zip(rest) {
                let v = speed * a.max_speed;
                assert!((after - before).abs() <= v * 0.02 + v * v / (2.0 * a.max_acceleration) + 1e-12, "{}", a.name);
            }
        }
    }
}
