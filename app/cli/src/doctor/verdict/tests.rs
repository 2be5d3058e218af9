use super::*;
use crate::doctor::Grade;
use mobee_contract::Axis;
use serde_json::{Value, json};

fn robot(driver: Value, controller: Value) -> RobotConfig {
    let mut all = json!({ "name": "arm", "model": "arm.xml", "driver": driver, "controller": { "period_ms": 20, "history": 100 } });
    let more = controller.as_object().unwrap().clone();
    all["controller"].as_object_mut().unwrap().extend(more);
    serde_json::from_value(all).unwrap()
}

fn yarp() -> Value {
    json!({ "kind": "yarp", "parts": [{ "part": "arm", "port": "/arm" }] })
}

fn axis() -> Axis {
    Axis { name: "elbow".into(), max_speed: 1.0, ..Axis::default() }
}

/// A board that does as it should.
fn good() -> Figures {
    Figures {
        sags: vec![0.01; 8],
        speeds: vec![1.1; 8],
        lag: Some((0.03, 2.5)),
        done: vec![(-0.1, 0.01); 8],
        stop: Some(StopFigures { speed: 10.0, on: 0.4, took: Some(0.1), drift: 0.0, end: StopEnd::Stays }),
        ..Figures::default()
    }
}

fn paces(fair: bool, own_acceleration: bool) -> Vec<Paces> {
    vec![Paces { board: "/arm".into(), seen: vec![1.2; 12], fair, own_acceleration }]
}

fn judged(figures: &Figures, axis: &Axis, paces: &[Paces], robot: &RobotConfig) -> (Vec<Grade>, String, String) {
    let (found, settings) = verdict(&Measured { figures, axis, paces, robot, folder: Path::new("run"), coarse: None });
    let text = found.iter().map(ToString::to_string).collect::<Vec<String>>().join("\n");
    (found.iter().map(|f| f.grade).collect(), text, settings.toml())
}

/// The lines of the settings without comments.
fn keys(settings: &str) -> Vec<&str> {
    settings.lines().filter(|line| !line.starts_with('#')).map(|l| l.split('#').next().unwrap().trim()).collect()
}

#[test]
fn a_board_that_does_as_it_should_needs_no_setting() {
    let robot = robot(yarp(), json!({ "stall_deg": 1.0 }));
    let (grades, text, settings) = judged(&good(), &axis(), &paces(true, false), &robot);
    assert_eq!(settings, "");
    assert!(grades.iter().all(|grade| *grade == Grade::Ok), "{text}");
    for words in [
        "30 ms behind",
        "stays there",
        "honors reference speeds",
        "once elbow has arrived",
        "accelerations that it is sent",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

/// Only what the file lacks, and what is read back without an error.
#[test]
fn what_a_board_needs_is_written_as_the_file_would_have_it() {
    let figures = Figures { count: 360.0 / 4096.0, sags: vec![1.3, -0.4], torque: Some((4.0, 1.1)), ..good() };
    let torques = Axis { contact_effort: Axis::UNRATED, ..axis() };
    let lacking = robot(yarp(), json!({}));
    let (_, text, settings) = judged(&figures, &torques, &paces(false, true), &lacking);
    let expected = [
        "resolution_deg = 0.0879",
        "hold_error_deg = 3.0",
        "moves = \"set-points\"",
        "contact_nm = 2.5",
        "stall_deg = 3.0",
    ];
    assert_eq!(keys(&settings), expected, "{text}");
    let [mut driver, mut controller] = [toml::Table::new(), toml::Table::new()];
    for (i, line) in settings.lines().filter(|line| !line.starts_with('#')).enumerate() {
        let table = if i < 3 { &mut driver } else { &mut controller };
        table.extend(line.parse::<toml::Table>().unwrap());
    }
    let mut with = yarp();
    with.as_object_mut().unwrap().extend(serde_json::to_value(driver).unwrap().as_object().unwrap().clone());
    let with = robot(with, serde_json::to_value(controller).unwrap());
    let knows = Axis { resolution: 0.0879_f64.to_radians(), hold_error: 3.0_f64.to_radians(), ..torques };
    let (_, text, settings) = judged(&figures, &knows, &paces(false, true), &with);
    assert_eq!(settings, "", "{text}");
}

/// An encoder that rests on one count shows none at the connection, and keeps the whole robot from resting when it no longer does.
#[test]
fn another_motor_may_be_the_one_that_does_not_rest() {
    let figures = good();
    let axis = axis();
    let robot = robot(yarp(), json!({ "stall_deg": 2.0 }));
    let coarse = Some(("wrist".to_owned(), 0.0879));
    let (found, settings) = verdict(&Measured {
        figures: &figures,
        axis: &axis,
        paces: &[],
        robot: &robot,
        folder: Path::new("run"),
        coarse,
    });
    assert!(
        found[0].grade == Grade::Warn && found[0].remedy.contains("wrist counts in steps of 0.0879"),
        "{}",
        found[0]
    );
    assert_eq!(keys(&settings.toml()), ["resolution_deg = 0.0879"]);
}

/// A simulation's driver has other keys of these names, which describe the arm that it simulates.
#[test]
fn a_simulation_gets_no_settings_of_a_driver() {
    let figures = Figures { count: 0.0879, sags: vec![1.3], speeds: vec![4.0], ..good() };
    let (grades, text, settings) = judged(&figures, &axis(), &[], &robot(json!({ "kind": "sim" }), json!({})));
    assert_eq!(keys(&settings), ["stall_deg = 3.0"]);
    assert!(grades.contains(&Grade::Bad) && text.contains("does not honor"), "{text}");
}

/// Where the driver has timed too few stretches, the moves themselves tell; but not those that are made of set-points.
#[test]
fn speeds_are_judged_by_the_moves_where_the_driver_counted_too_few() {
    let few = [Paces { board: "/arm".into(), seen: vec![1.2; 3], fair: true, own_acceleration: false }];
    let (_, text, _) = judged(&good(), &axis(), &few, &robot(yarp(), json!({})));
    assert!(text.contains("in 8 stretches: its board honors reference speeds"), "{text}");
    let mut streamed = yarp();
    streamed["moves"] = "set-points".into();
    let (_, text, _) = judged(&good(), &axis(), &few, &robot(streamed, json!({})));
    assert!(text.contains("could not be measured"), "{text}");
}

#[test]
fn a_stop_that_does_not_hold_is_bad() {
    let stop = |end, took| Some(StopFigures { speed: 10.0, on: 6.0, took, drift: -2.0, end });
    for (end, words) in [(StopEnd::RunsOn, "ran on to its target"), (StopEnd::Sinks, "moves on by -2.00 deg")] {
        let figures = Figures { stop: stop(end, Some(0.6)), ..good() };
        let (grades, text, _) = judged(&figures, &axis(), &paces(true, false), &robot(yarp(), json!({})));
        assert!(grades.contains(&Grade::Bad) && text.contains(words), "{text}");
    }
}

#[test]
fn what_was_not_measured_is_named() {
    let (grades, text, settings) = judged(&Figures::default(), &axis(), &[], &robot(yarp(), json!({})));
    assert_eq!(settings, "", "nothing follows from nothing");
    assert!(grades.iter().skip(1).all(|grade| *grade != Grade::Ok), "{text}");
    assert_eq!(text.matches("measured").count(), 5, "{text}");
}
