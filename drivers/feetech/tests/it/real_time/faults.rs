//! Every fault of a bus has a name and a remedy, stops the arm, and ends once its cause has.

use crate::arm::Arm;
use mobee_contract::{Command, Driver, DriverFault, Hardware, Move, Sample};
use std::time::Duration;

/// No fault is reported later than this.
const NOTICED: Duration = Duration::from_secs(4);

fn connected(arm: &Arm) -> Box<dyn Driver> {
    let mut driver = arm.connect();
    arm.until_done(driver.as_mut());
    driver
}

/// After a fault the arm moves again.
fn moves_again(arm: &Arm, driver: &mut dyn Driver) {
    let newest = arm.until(driver, Duration::from_secs(5), |read| read.ok().flatten()).expect("a reading");
    let to = newest.q[4] + 0.05;
    let go = Move { motors: vec![4], q: vec![to], relative: false, speed: Some(vec![0.5]), acceleration: None };
    let done = arm.until(driver, Duration::from_secs(5), |read| read.ok().flatten().filter(|s: &Sample| s.done[4]));
    assert!(done.is_some());
    driver.command(arm.now(), &Command::Move(go)).expect("a move");
    let last = arm.until_done(driver).pop().expect("a reading");
    assert!((last.q[4] - to).abs() < 0.01, "{} instead of {to}", last.q[4]);
}

#[test]
fn a_dead_servo_is_named() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    arm.terminal.with(|world| world.servo(3).unwrap().answers = false);
    let fault = arm.fault(driver.as_mut(), NOTICED);
    assert!(fault.contains("elbow_flex (id 3) does not answer, 5 others do"), "{fault}");
    let refused = driver.command(arm.now(), &Command::Velocity { motors: vec![0], speed: vec![0.1] });
    assert!(matches!(refused, Err(DriverFault::Hardware(_))), "{refused:?}");
    arm.terminal.with(|world| world.servo(3).unwrap().answers = true);
    println!("dead servo: readings {:?} after it answers", arm.recovered(driver.as_mut()));
    moves_again(&arm, driver.as_mut());
}

#[test]
fn a_bus_without_power_is_named() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    arm.terminal.with(|world| world.servos().for_each(|s| s.answers = false));
    let fault = arm.fault(driver.as_mut(), NOTICED);
    assert!(fault.contains("no servo answers") && fault.contains("power supply"), "{fault}");
    arm.terminal.with(|world| {
        world.servos().for_each(|s| {
            s.brown_out();
            s.answers = true;
        });
    });
    println!("no power: readings {:?} after it is back", arm.recovered(driver.as_mut()));
    moves_again(&arm, driver.as_mut());
}

/// Pulled and plugged in again: the port is opened anew, the servos are identified, and the arm holds.
#[test]
fn an_unplugged_cable_is_named_and_can_be_plugged_in_again() {
    let mut arm = Arm::new();
    let mut driver = connected(&arm);
    arm.terminal.unplug();
    let fault = arm.fault(driver.as_mut(), NOTICED);
    assert!(fault.contains("serial port") && fault.contains("plug"), "{fault}");
    arm.terminal.plug_in().unwrap();
    println!("unplugged: readings {:?} after it is plugged in", arm.recovered(driver.as_mut()));
    moves_again(&arm, driver.as_mut());
}

/// A servo that resets has no torque: it is named, gets torque again where it is, and does not jump.
#[test]
fn a_brown_out_is_named_and_the_servo_gets_torque_where_it_is() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    arm.terminal.with(|world| {
        let servo = world.servo(2).unwrap();
        servo.brown_out();
        servo.place(2000.0);
    });
    let fault = arm.fault(driver.as_mut(), NOTICED);
    assert!(fault.contains("shoulder_lift (id 2) has lost its torque"), "{fault}");
    println!("brown-out: readings {:?} after it", arm.recovered(driver.as_mut()));
    let (torque, position) = arm.terminal.with(|world| {
        let servo = world.servo(2).unwrap();
        (servo.has_torque(), servo.position())
    });
    assert!(torque && (position - 2000.0).abs() < 2.0, "torque {torque} at {position}");
    moves_again(&arm, driver.as_mut());
}

/// A second program that writes goals is noticed, though each of its goals lasts for one period only.
#[test]
fn another_program_on_the_bus_is_named() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    let mut fault = None;
    for i in 0..40 {
        // at every phase of the driver's cycle: its own goals replace others within the cycle
        arm.pause(Duration::from_millis(i % 10));
        arm.terminal.with(|world| {
            // goal 2100, as another program's sync write sets it
            world.servo(4).unwrap().write(42, &[0x34, 0x08]);
        });
        fault = arm.until(driver.as_mut(), Duration::from_millis(15), |read| match read {
            Err(DriverFault::Hardware(what)) => Some(what),
            _ => None,
        });
        if fault.is_some() {
            break;
        }
    }
    let fault = fault.unwrap_or_else(|| arm.fault(driver.as_mut(), NOTICED));
    assert!(fault.contains("another program writes"), "{fault}");
    println!("second program: readings {:?} after it ended", arm.recovered(driver.as_mut()));
    moves_again(&arm, driver.as_mut());
}

/// Error bits are named per motor, and each ends with its cause.
#[test]
fn error_bits_are_named() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    for (bit, text) in [(0x04, "gripper (id 6) is too hot"), (0x01, "gripper (id 6) has a voltage out of its range")] {
        arm.terminal.with(|world| world.servo(6).unwrap().alarm = bit);
        let fault = arm.fault(driver.as_mut(), NOTICED);
        assert!(fault.contains(text), "{fault}");
        arm.terminal.with(|world| world.servo(6).unwrap().alarm = 0);
        arm.recovered(driver.as_mut());
    }
    moves_again(&arm, driver.as_mut());
}

/// A servo that something has overloaded for two seconds has lowered its torque: it is relieved where it is.
#[test]
fn an_overload_is_named_and_relieved() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    // a load that bends the joint by 130 counts: 87 % of its torque
    arm.terminal.with(|world| world.servo(1).unwrap().sag = 130.0);
    let fault = arm.fault(driver.as_mut(), Duration::from_secs(8));
    assert!(fault.contains("shoulder_pan (id 1) is overloaded"), "{fault}");
    arm.terminal.with(|world| world.servo(1).unwrap().sag = 0.0);
    println!("overload: readings {:?} after it", arm.recovered(driver.as_mut()));
    moves_again(&arm, driver.as_mut());
}

/// Damaged, lost and late answers cost readings, are never taken for others, and fault nothing while enough come.
#[test]
fn damaged_lost_and_late_answers_are_never_taken_for_others() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    // each servo elsewhere, so that a mixed-up answer shows
    for (i, damage) in ["damaged", "lost", "late", "chatter"].into_iter().enumerate() {
        arm.terminal.with(|world| match i {
            0 => world.damaged = 0.02,
            1 => (world.damaged, world.lost) = (0.0, 0.02),
            2 => (world.lost, world.late) = (0.0, Duration::from_millis(3)),
            _ => (world.late, world.chatter) = (Duration::ZERO, vec![0xFF, 0xFF, 9, 3, 0, 7]),
        });
        let mut samples = 0;
        arm.until(driver.as_mut(), Duration::from_secs(2), |read| {
            let sample = read.unwrap_or_else(|e| panic!("{damage}: {e}"));
            if let Some(sample) = sample {
                samples += 1;
                let off = |(m, q): (usize, &f64)| (q - if m == 5 { 40f64.to_radians() } else { 0.0 }).abs();
                let worst = sample.q.iter().enumerate().map(off).fold(0.0, f64::max);
                assert!(worst < 0.002, "{damage}: {:?}", sample.q);
            }
            None::<()>
        });
        println!("{damage}: {samples} readings in 2 s");
        assert!(samples > 50, "{damage}: only {samples} readings");
    }
    arm.terminal.with(|world| world.chatter = Vec::new());
    assert!(driver.news().is_some_and(|news| news.contains("no answer")), "chatter is reported");
}

/// Answers later than the deadline: no reading, and none that belongs to another request.
#[test]
fn answers_after_the_deadline_are_discarded() {
    let arm = Arm::with(|settings| mobee_feetech::FeetechSettings { timeout_ms: 5.0, ..settings });
    let mut driver = connected(&arm);
    arm.terminal.with(|world| world.late = Duration::from_millis(12));
    let fault = arm.fault(driver.as_mut(), NOTICED);
    assert!(fault.contains("disturbed") || fault.contains("no servo answers"), "{fault}");
    arm.terminal.with(|world| world.late = Duration::ZERO);
    arm.recovered(driver.as_mut());
    moves_again(&arm, driver.as_mut());
}

/// What a servo stores is checked before it gets torque.
#[test]
fn a_servo_that_does_not_fit_the_settings_gets_no_torque() {
    let cases: [(usize, u16, &str); 3] =
        [(3, 0x0c04, "not an STS3215"), (33, 3, "operating mode 3"), (11, 2000, "allows counts 0 to 2000")];
    for (register, value, text) in cases {
        let arm = Arm::with(|settings| mobee_feetech::FeetechSettings { connect_s: 0.4, ..settings });
        arm.terminal.with(|world| world.servo(2).unwrap().store(register, value));
        let refused = arm.hardware.connect().err().expect("a refusal").to_string();
        assert!(refused.contains("(id 2)") && refused.contains(text), "{refused}");
        assert!(!arm.terminal.with(|world| world.servos().any(|s| s.has_torque())));
    }
    let arm = Arm::with(|settings| mobee_feetech::FeetechSettings { connect_s: 0.4, ..settings });
    arm.terminal.with(|world| world.servo(2).unwrap().place(1200.0));
    let refused = arm.hardware.connect().err().expect("a refusal").to_string();
    assert!(refused.contains("outside its limits"), "{refused}");
    assert!(!arm.terminal.with(|world| world.servos().any(|s| s.has_torque())));
}

/// A look writes nothing; the end of a run holds, and releases the torque only where the settings allow it.
#[test]
fn torque_is_given_by_connecting_and_released_only_at_the_rest_configuration() {
    let torque = |arm: &Arm| arm.terminal.with(|world| world.servos().filter(|s| s.has_torque()).count());
    for (rest, left) in [(None, 6), (Some(0.0), 0), (Some(30.0), 6)] {
        let mut arm = Arm::with(|mut settings| {
            if let Some(rest) = rest {
                settings.release_torque = true;
                settings.rest_deg = vec![rest, rest, rest, rest, rest, 40.0 + rest];
            }
            settings
        });
        let look = arm.hardware.look().expect("a look").expect("readings");
        assert_eq!(torque(&arm), 0);
        drop(look);
        drop(connected(&arm));
        assert_eq!(torque(&arm), 6);
        let robot = crate::arm::robot();
        let port = arm.terminal.port().to_owned();
        let other = mobee_feetech::FeetechHardware::new(&crate::arm::settings(&port, &robot), &robot).unwrap();
        drop(std::mem::replace(&mut arm.hardware, other));
        // the last packet is on its way to the servos, which do not answer it
        let read = (0..200).any(|_| {
            torque(&arm) == left || {
                arm.pause(Duration::from_millis(5));
                false
            }
        });
        assert!(read, "rest {rest:?}: {} servos have torque", torque(&arm));
    }
}

/// One program at a time: a second one that opens the port is refused, with the remedy.
#[test]
fn a_second_driver_of_the_same_port_is_refused() {
    let arm = Arm::new();
    let mut driver = connected(&arm);
    let robot = crate::arm::robot();
    let mut settings = crate::arm::settings(arm.terminal.port(), &robot);
    settings.connect_s = 0.5;
    let second = mobee_feetech::FeetechHardware::new(&settings, &robot).unwrap();
    let refused = second.connect().err().expect("a refusal").to_string();
    println!("{refused}");
    assert!(refused.contains("end the other program"), "{refused}");
    drop(second);
    moves_again(&arm, driver.as_mut());
}
