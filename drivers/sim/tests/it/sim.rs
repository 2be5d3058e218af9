//! The simulated robot as hardware: settings, faults, determinism, and outliving its drivers.

use mobee_contract::{
    Axis, Command, Context, ControlMode, Driver, DriverFault, Hardware, KindError, Move, Sample, Target, Time, kinds,
};
use mobee_sim::{Fault, SimHardware, SimSettings};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn context() -> Context {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/robots/katana.xml");
    Context { robot: Arc::new(mobee_model::load_robot(file).unwrap().value), seed: 5 }
}

fn small(settings: &SimSettings) -> SimHardware {
    let axis = |name: &str| Axis {
        name: name.into(),
        min: -1.0,
        max: 1.0,
        max_speed: 1.7,
        max_acceleration: 3.5,
        ..Default::default()
    };
    SimHardware::with_axes(vec![axis("a"), axis("b")], &[0.0, 0.2], settings, 3)
}

fn to(q: [f64; 2]) -> Command {
    Command::Move(Move {
        motors: vec![0, 1],
        q: q.to_vec(),
        relative: false,
        speed: Some(vec![0.5; 2]),
        acceleration: None,
    })
}

/// Fetches readings for so many seconds, renewing the lease.
fn run(driver: &mut dyn Driver, now: &mut Time, seconds: f64) -> Vec<Result<Sample, DriverFault>> {
    let end = *now + Duration::from_secs_f64(seconds);
    let mut all = Vec::new();
    while *now < end {
        *now = driver.next_sample(*now).max(*now + Duration::from_micros(10));
        driver.lease(*now, *now + Duration::from_millis(60));
        all.extend(driver.sample(*now).transpose());
    }
    all
}

fn positions(samples: Vec<Result<Sample, DriverFault>>) -> Vec<Vec<f64>> {
    samples.into_iter().map(|s| s.unwrap().q.to_vec()).collect()
}

#[test]
fn the_kind_builds_from_an_empty_table() {
    let kind = kinds::<dyn Hardware>().into_iter().find(|k| k.name == "sim").unwrap();
    let context = context();
    let mut driver = (kind.build)(&json!({}), &context).unwrap().connect().unwrap();
    let sample = driver.sample(Time::ZERO).unwrap().unwrap();
    for (motor, q) in context.robot.motors.iter().zip(sample.q.iter()) {
        assert!((motor.home - q).abs() < 0.05f64.to_radians(), "{} starts at home", motor.name);
    }
    let schema = serde_json::to_value((kind.schema)()).unwrap();
    let settings = schema["properties"].as_object().unwrap();
    assert!(settings.values().all(|s| s["description"].is_string()), "every setting has its doc");
}

#[test]
fn what_a_lift_is_refused_is_told_in_millimeters() {
    let text = "<ZeroPositionKinematicTree robotName=\"lift\"><bodypart name=\"p\"><motor name=\"lift\" minPos=\"0\" maxPos=\"350\">\
                <joint z=\"1\" type=\"prismatic\" minPos=\"0\" maxPos=\"0.35\"><link x=\"0.3\" radius=\"0.02\"/></joint></motor></bodypart>\
                </ZeroPositionKinematicTree>";
    let robot = Arc::new(mobee_model::parse_robot("lift.xml", text).unwrap().value);
    let hardware = SimHardware::build(&json!({}), &Context { robot, seed: 5 }).unwrap();
    let mut driver = hardware.connect().unwrap();
    driver.lease(Time::ZERO, Time::ZERO + Duration::from_millis(60));
    let q = vec![900_f64.to_radians()];
    let to = Move { motors: vec![0], q, relative: false, speed: None, acceleration: None };
    let refused = driver.command(Time::ZERO, &Command::Move(to)).unwrap_err();
    let told = "motor lift: 900.000 mm is outside its limits 0.000 to 350.000 mm";
    assert_eq!(refused, DriverFault::Refused(told.into()));
}

#[test]
fn settings_that_make_no_sense_are_refused_with_their_path() {
    let context = context();
    let motor = &context.robot.motors[0];
    let outside = motor.max.to_degrees() + 5.0;
    let refused = |settings: Value| -> KindError { SimHardware::build(&settings, &context).unwrap_err() };
    let cases = [
        (json!({"rate_hz": 0}), "rate_hz"),
        (json!({"rate_hz": "fast"}), "rate_hz"),
        (json!({"max_speed_deg_per_s": -3}), "max_speed_deg_per_s"),
        (json!({"max_acceleration_deg_per_s2": 1e300}), "max_acceleration_deg_per_s2"),
        (json!({"latency_ms": -1}), "latency_ms"),
        (json!({"jitter_ms": 6}), "jitter_ms"),
        (json!({"noise_deg": 100}), "noise_deg"),
        (json!({"profile": "wild"}), "profile"),
        (json!({"move_profile": "wild"}), "move_profile"),
        (json!({"profile": "so101", "servo": {"torque_nm": []}}), "servo.torque_nm"),
        (json!({"profile": "ideal", "servo": {"lead": 0.5}}), "servo"),
        (json!({"start_deg": {"nose": 1}}), "start_deg.nose"),
        (json!({"start_deg": {motor.name.clone(): outside}}), &format!("start_deg.{}", motor.name)),
    ];
    for (settings, path) in cases {
        let e = refused(settings.clone());
        assert_eq!(e.path, path, "{settings}: {e}");
        assert!(!e.help.is_empty());
    }
    assert!(refused(json!({"latency": 3})).what.contains("latency_ms"));
    let nan = SimSettings { noise_deg: Some(f64::NAN), ..SimSettings::ideal() };
    assert_eq!(nan.validate().unwrap_err().path, "noise_deg");
}

#[test]
fn readings_at_rest_are_within_a_tenth_of_a_degree_and_unbiased() {
    let hardware = small(&SimSettings::ideal());
    let mut driver = hardware.connect().unwrap();
    let mut now = Time::ZERO;
    let all = positions(run(driver.as_mut(), &mut now, 100.0));
    assert!(all.len() > 9_900);
    let off: Vec<f64> = all.iter().map(|q| (q[1] - 0.2).to_degrees()).collect();
    let worst = off.iter().fold(0.0, |w: f64, o| w.max(o.abs()));
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    let spread = (off.iter().map(|o| (o - mean).powi(2)).sum::<f64>() / off.len() as f64).sqrt();
    assert!(worst < 0.03, "{worst}");
    assert!(mean.abs() < 0.001, "{mean}");
    // noise of 0.005 deg and steps of 0.01 deg (0.0029) together
    assert!((0.004..0.008).contains(&spread), "{spread}");
}

#[test]
fn the_same_seed_and_calls_give_the_same_readings() {
    let once = |seed| {
        let axis =
            Axis { name: "a".into(), min: -1.0, max: 1.0, max_speed: 1.7, max_acceleration: 3.5, ..Default::default() };
        let hardware = SimHardware::with_axes(vec![axis.clone(), axis], &[0.0, 0.2], &SimSettings::ideal(), seed);
        let mut driver = hardware.connect().unwrap();
        let mut now = Time::ZERO;
        run(driver.as_mut(), &mut now, 0.1);
        driver.command(now, &to([0.5, -0.4])).unwrap();
        hardware.faults().plan(Fault::Noise { sigma: 0.01 }, Time::from_secs(1.0), Time::from_secs(2.0));
        run(driver.as_mut(), &mut now, 3.0)
    };
    assert_eq!(once(1), once(1));
    assert_ne!(once(1), once(2));
}

#[test]
fn frozen_encoders_keep_saying_what_they_said() {
    let hardware = small(&SimSettings::ideal().exact());
    let mut driver = hardware.connect().unwrap();
    let mut now = Time::ZERO;
    run(driver.as_mut(), &mut now, 0.1);
    let one = hardware.faults().start(Fault::Frozen { motor: Some(0) });
    driver.command(now, &to([0.5, -0.4])).unwrap();
    let frozen = positions(run(driver.as_mut(), &mut now, 5.0));
    assert!(frozen.iter().all(|q| q[0] == 0.0));
    assert_eq!(frozen.last().unwrap()[1], -0.4);
    hardware.faults().stop(one);
    assert_eq!(positions(run(driver.as_mut(), &mut now, 0.1)).last().unwrap(), &vec![0.5, -0.4]);
}

#[test]
fn encoders_that_freeze_in_motion_tell_the_truth_until_the_motors_have_moved_for_a_while() {
    let hardware = small(&SimSettings::ideal().exact());
    let mut driver = hardware.connect().unwrap();
    let mut now = Time::ZERO;
    let fault = hardware.faults().start(Fault::FrozenInMotion { after: Duration::from_millis(500) });
    run(driver.as_mut(), &mut now, 1.0);
    driver.command(now, &to([0.5, -0.4])).unwrap();
    let told = positions(run(driver.as_mut(), &mut now, 5.0));
    let last = told.last().unwrap();
    assert!(last[0] > 0.01 && last[0] < 0.4, "frozen in mid-motion: {last:?}");
    assert!(told.iter().rev().take(300).all(|q| q == last));
    hardware.faults().stop(fault);
    assert_eq!(positions(run(driver.as_mut(), &mut now, 0.1)).last().unwrap(), &vec![0.5, -0.4]);
}

#[test]
fn a_lost_connection_lets_the_lease_run_out_and_comes_back_without_a_jump() {
    let hardware = small(&SimSettings::ideal().exact());
    let mut driver = hardware.connect().unwrap();
    let mut now = Time::ZERO;
    run(driver.as_mut(), &mut now, 0.1);
    driver.command(now, &to([0.9, -0.8])).unwrap();
    run(driver.as_mut(), &mut now, 1.5);
    let lost = hardware.faults().start(Fault::Lost);
    let dark = run(driver.as_mut(), &mut now, 1.0);
    assert!(!dark.is_empty() && dark.iter().all(|s| *s == Err(DriverFault::Lost)));
    assert_eq!(driver.command(now, &to([0.0, 0.0])), Err(DriverFault::Lost));
    assert!(hardware.connect().is_err());
    assert_eq!(hardware.speeds(now), vec![0.0; 2], "it braked by itself");
    let rest = hardware.positions(now);
    assert!(rest[0] > 0.05 && rest[0] < 0.6);
    hardware.faults().stop(lost);
    let mut driver = hardware.connect().unwrap();
    let back = positions(run(driver.as_mut(), &mut now, 1.0));
    assert!(back.iter().all(|q| *q == rest), "and stays where it stopped");
}

#[test]
fn a_planned_loss_ends_by_itself() {
    let hardware = small(&SimSettings::ideal());
    let mut driver = hardware.connect().unwrap();
    hardware.faults().plan(Fault::Lost, Time::from_secs(1.0), Time::from_secs(2.0));
    let mut now = Time::ZERO;
    let all = run(driver.as_mut(), &mut now, 3.0);
    let (fine, lost): (Vec<_>, Vec<_>) = all.into_iter().partition(Result::is_ok);
    assert!((95..=105).contains(&lost.len()) && (190..=210).contains(&fine.len()), "{} {}", lost.len(), fine.len());
    assert!(hardware.connect().is_ok());
}

#[test]
fn silence_slowness_lies_and_reported_faults_are_what_they_say() {
    let hardware = small(&SimSettings::ideal().exact());
    let faults = hardware.faults();
    let mut driver = hardware.connect().unwrap();
    let mut now = Time::ZERO;
    run(driver.as_mut(), &mut now, 0.1);
    faults.start(Fault::Silent);
    assert!(run(driver.as_mut(), &mut now, 0.5).is_empty());
    faults.clear();

    faults.start(Fault::Slow { extra: Duration::from_millis(500) });
    driver.command(now, &to([0.5, 0.5])).unwrap();
    run(driver.as_mut(), &mut now, 0.4);
    assert_eq!(hardware.positions(now), vec![0.0, 0.2]);
    run(driver.as_mut(), &mut now, 3.0);
    assert_eq!(hardware.positions(now), vec![0.5, 0.5]);
    faults.clear();

    faults.start(Fault::Offset { motor: 1, by: 0.1 });
    assert_eq!(positions(run(driver.as_mut(), &mut now, 0.1)).last().unwrap(), &vec![0.5, 0.6]);
    faults.clear();

    driver.command(now, &to([-0.5, 0.5])).unwrap();
    run(driver.as_mut(), &mut now, 0.3);
    faults.start(Fault::Hardware { report: "motor a is too hot".into() });
    let all = run(driver.as_mut(), &mut now, 2.0);
    let hot = DriverFault::Hardware("motor a is too hot".into());
    assert!(all.iter().all(|s| s.as_ref() == Err(&hot)));
    assert_eq!(driver.command(now, &to([0.0, 0.0])), Err(hot));
    assert_eq!(hardware.speeds(now), vec![0.0; 2]);
    assert!(hardware.positions(now)[0] > -0.5);
}

#[test]
fn a_run_of_ninety_minutes_is_read_out() {
    let axis = |i: usize| Axis {
        name: format!("m{i}"),
        min: -1.0,
        max: 1.0,
        max_speed: 1.7,
        max_acceleration: 3.5,
        ..Default::default()
    };
    let hardware = SimHardware::with_axes((0..41).map(axis).collect(), &[0.0; 41], &SimSettings::ideal(), 3);
    let mut driver = hardware.connect().unwrap();
    let (mut now, mut count) = (Time::ZERO, 0u32);
    while now < Time::from_secs(5400.0) {
        now = driver.next_sample(now).max(now + Duration::from_micros(1));
        driver.lease(now, now + Duration::from_millis(60));
        count += u32::from(driver.sample(now).unwrap().is_some());
    }
    assert!((539_000..=540_100).contains(&count), "{count}");
}

#[test]
fn a_recorded_motion_streamed_backwards_keeps_to_its_path() {
    let axes: Vec<Axis> = ["a", "b"]
        .map(|name| Axis {
            name: name.into(),
            min: -1.0,
            max: 1.5,
            max_speed: 1.7,
            max_acceleration: 3.5,
            ..Default::default()
        })
        .to_vec();
    // at full speed the recording uses the whole acceleration, and its noise asks for more than the motors have
    for share in [0.1, 0.5, 0.8] {
        let hardware = SimHardware::with_axes(axes.clone(), &[-0.5, 0.9], &SimSettings::ideal(), 3);
        let mut driver = hardware.connect().unwrap();
        let mut now = Time::ZERO;
        run(driver.as_mut(), &mut now, 0.05);
        let (from, to) = ([-0.5, 0.9], [0.9, 0.2]);
        let target = Target { motors: vec![0, 1], q: to.to_vec(), speed: share };
        driver.command(now, &Command::Move(target.in_step(&from, &axes))).unwrap();
        let recorded = positions(run(driver.as_mut(), &mut now, 25.0));
        assert_eq!(hardware.positions(now), to);
        driver.command(now, &Command::Mode { motors: vec![0, 1], mode: ControlMode::PositionDirect }).unwrap();
        run(driver.as_mut(), &mut now, 0.1);
        let mut worst = 0.0f64;
        let rests = |q: &&Vec<f64>| (q[0] - to[0]).abs() < 1e-3;
        for q in recorded.iter().rev().skip_while(rests) {
            driver.command(now, &Command::Direct { motors: vec![0, 1], q: q.clone() }).unwrap();
            run(driver.as_mut(), &mut now, 0.009);
            // how far the second motor is off the straight line, given where the first is
            let real = hardware.positions(now);
            let line = from[1] + (real[0] - from[0]) / (to[0] - from[0]) * (to[1] - from[1]);
            worst = worst.max((real[1] - line).abs().to_degrees());
        }
        run(driver.as_mut(), &mut now, 1.0);
        let home = hardware.positions(now);
        assert!((home[0] - from[0]).abs().max((home[1] - from[1]).abs()).to_degrees() < 0.05, "{home:?}");
        assert!(worst < 0.1, "at {share} of the greatest speed it strays by {worst} deg");
    }
}
