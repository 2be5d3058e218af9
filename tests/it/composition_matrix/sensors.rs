//! Every registered detector behind every registered camera, with every locator, on every robot: starts, runs, finds what is there to be
//! found, and the robot that carries it holds the invariants. Where a part can't be on a robot, it says so before anything moves.

use super::{Cell, in_turn, judge, robots};
use crate::common::pictures::{self, Shown};
use crate::common::{answer, text};
use crate::locator_files::table;
use mobee_contract::{Agent, AnyKind, Camera, Detector, Entry, Event, Locator, SeenPicture, Time, kinds};
use mobee_journal::journal;
use mobee_model::{Robot, load_robot};
use mobee_sim::eyes::{FolderCamera, FolderCameraSettings, KeptFrames, LensSettings};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const SECONDS: f64 = 2.0;
/// What the examples of all detectors call what they find.
const OBJECT: &str = "cup";

/// What the examples of kinds name, made: by role, kind and setting.
struct Made(BTreeMap<(&'static str, &'static str), PathBuf>);

impl Made {
    /// Everything is learned from pictures of a square and a tag before two eyes.
    fn new(folder: &Path) -> Made {
        let at = |name: &str| folder.join(name);
        let (lessons, views) = (at("lessons"), at("views.csv"));
        pictures::draw(&lessons, 0..8, 0, Shown::Square);
        // what both eyes see is a little less than half a meter before them
        pictures::draw(&at("pictures/left"), 0..8, 20, Shown::Square);
        pictures::draw(&at("pictures/right"), 0..8, -20, Shown::Square);
        pictures::network(&at("onnx"));
        for kind in ["color", "cgp"] {
            let (images, out) = (text(&lessons).to_owned(), at(kind));
            let minutes: &[&str] = if kind == "cgp" { &["--minutes", "0"] } else { &[] };
            let train = ["detector", "train", "--images", &images, "--out", text(&out), "--kind", kind];
            answer(&[&train[..], minutes].concat());
        }
        table(&views, 0.0);
        for kind in ["triangulate", "network", "ensemble", "calibrated"] {
            answer(&["locator", "train", "--data", text(&views), "--out", text(&at(kind)), "--kind", kind]);
        }
        let of = |role, names: &[&'static str]| names.iter().map(|n| ((role, *n), at(n))).collect::<Vec<_>>();
        let files = [
            of("detector", &["color", "cgp", "onnx"]),
            of("locator", &["triangulate", "network", "ensemble", "calibrated"]),
            vec![(("camera", "folder"), at("pictures")), (("camera", "recorded"), at("run"))],
        ];
        keep(&at("run"), &at("pictures"));
        Made(files.into_iter().flatten().collect())
    }

    /// An example with its kind, and what it names in its place; `eye` is a folder below what cameras name.
    fn filled(&self, kind: &dyn AnyKind, mut example: Value, eye: &str) -> Value {
        example["kind"] = kind.name().into();
        if example.get("run").is_some() {
            example["camera"] = format!("eyes/{eye}").into();
        }
        for (key, below) in [("file", ""), ("path", eye), ("run", "")] {
            let Some(named) = example.get_mut(key) else { continue };
            let made = self.0.get(&(kind.role(), kind.name()));
            let made =
                made.unwrap_or_else(|| panic!("{} {}: nothing is made for its `{key}` here", kind.role(), kind.name()));
            *named = if below.is_empty() { text(made).into() } else { text(&made.join(below)).into() };
        }
        example
    }
}

/// What a run keeps of two eyes that saw the pictures in these folders, four in a second.
fn keep(run: &Path, pictures: &Path) {
    std::fs::create_dir_all(run).expect("a folder");
    for eye in ["left", "right"] {
        let camera = format!("eyes/{eye}");
        let mut sink = KeptFrames::open(run, std::slice::from_ref(&camera)).expect("a file").sink();
        let settings =
            FolderCameraSettings { path: pictures.join(eye), fps: 4.0, repeat: false, lens: LensSettings::default() };
        let mut folder = FolderCamera::new(&settings).expect("pictures");
        for n in 1..=8 {
            let frame = folder.frame(Time(n * 250_000_000)).expect("a picture").expect("a new one");
            let seen = SeenPicture { frame, regions: Vec::new().into(), mask: None, mount: None };
            let entry = Entry::Picture { camera: camera.as_str().into(), seen: Arc::new(seen) };
            sink.write(Time::ZERO, &entry).expect("written");
        }
    }
}

/// What a cell should come to.
#[derive(Clone)]
struct Expected {
    detector: &'static str,
    locator: Option<&'static str>,
    /// Whether the pictures show what the detector finds.
    is_shown: bool,
    /// Whether the robot can have the locator.
    fits: bool,
}

impl Expected {
    /// Whether places are told: a pose only by who sees poses.
    fn is_located(&self) -> bool {
        self.is_shown && self.locator.is_some_and(|l| l != "pose" || self.detector == "tag")
    }
}

fn cells(robots: &[PathBuf], made: &Made) -> (Vec<Cell>, Vec<Expected>) {
    let (mut cells, mut all) = (Vec::new(), Vec::new());
    let agent = kinds::<dyn Agent>().into_iter().find(|a| a.name == "scripted").expect("an agent");
    for path in robots {
        let robot = load_robot(path).expect("a robot").value;
        let mut planner = (agent.example)(&robot).expect("an agent's settings for any robot");
        planner["kind"] = agent.name.into();
        let mut locators: Vec<(Option<&'static str>, Value)> = vec![(None, Value::Null)];
        for kind in kinds::<dyn Locator>() {
            match (kind.example)(&robot) {
                Ok(example) => locators.push((Some(kind.name), made.filled(kind, example, ""))),
                Err(why) => println!("left out: locator {} on {}: {why}", kind.name, robot.name),
            }
        }
        // a camera of the world outside has no pictures by a virtual clock
        for camera in kinds::<dyn Camera>().into_iter().filter(|c| c.name != "yarp") {
            let mut example = match (camera.example)(&robot) {
                Ok(example) => example,
                Err(why) => {
                    println!("left out: camera {} on {}: {why}", camera.name, robot.name);
                    continue;
                }
            };
            if camera.name == "simulated" {
                example["fps"] = 2.0.into();
            }
            for detector in kinds::<dyn Detector>() {
                let finds = made.filled(detector, (detector.example)(&robot).expect("settings"), "");
                for (locator, places) in &locators {
                    let fits = locator.is_none_or(|l| l == "pose") || has_head(&robot);
                    let (is_shown, detector) = (camera.name != "simulated", detector.name);
                    let expected = Expected { detector, locator: *locator, is_shown, fits };
                    // that a locator is refused does not depend on what is before it
                    if !fits
                        && all.iter().zip(&cells).any(|(e, c): (&Expected, &Cell)| {
                            e.locator == *locator && c.config["robot"][0]["model"] == json!(path)
                        })
                    {
                        continue;
                    }
                    let eye = |name: &str| json!({ "name": name, "camera": made.filled(camera, example.clone(), name), "detector": finds });
                    let mut sensor = json!({ "name": "eyes", "eye": [eye("left"), eye("right")] });
                    if locator.is_some() {
                        sensor["locator"] = places.clone();
                    }
                    cells.push(Cell {
                        title: format!(
                            "{detector} behind {} on {}, {}",
                            camera.name,
                            robot.name,
                            locator.unwrap_or("no locator")
                        ),
                        config: json!({
                            "for_s": SECONDS, "record": { "enabled": false },
                            "robot": [{
                                "name": "robot", "model": path, "driver": { "kind": "sim", "profile": "ideal" }, "agent": planner,
                                "controller": { "period_ms": 20, "history": 6000 },
                            }],
                            "sensor": [sensor],
                        }),
                    });
                    all.push(expected);
                }
            }
        }
    }
    (cells, all)
}

/// Whether the robot has the head that locators learn.
fn has_head(robot: &Robot) -> bool {
    mobee_sensing::locators::head::JOINTS.iter().all(|name| robot.motor_index(name).is_some())
}

/// Whether what a cell came to is what it should.
fn look(cell: &Cell, expected: &Expected) -> Result<(), String> {
    let ran = match (judge(cell), expected.fits) {
        (Err(why), false) => {
            // frames and line breaks stand between the words
            let told: Vec<&str> = why.split_whitespace().filter(|w| *w != "│").collect();
            let told = told.join(" ");
            let is_told = ["locator", "has no motor", "help:"].iter().all(|w| told.contains(w));
            return if is_told { Ok(()) } else { Err(told) };
        }
        (Ok(_), false) => return Err("it ran, though the robot has no such head".into()),
        (ran, true) => ran?,
    };
    let (mut looked, mut found) = ([0u32; 2], [0u32; 2]);
    let mut located = 0u32;
    for line in journal::read(&ran.folder()).map_err(|e| e.to_string())? {
        match line.map_err(|e| e.to_string())?.event {
            Event::Sighted { camera, regions, .. } => {
                let eye = usize::from(camera == "eyes/right");
                looked[eye] += 1;
                found[eye] += u32::from(regions.iter().any(|r| r.object == OBJECT));
            }
            Event::Located { .. } => located += 1,
            _ => {}
        }
    }
    let told = format!("of {looked:?} pictures {found:?} showed it, {located} times it was placed");
    let is_right = looked.iter().all(|n| *n > 0)
        && (!expected.is_shown || found.iter().all(|n| *n > 0))
        && (!expected.is_shown || (located > 0) == expected.is_located());
    if is_right { Ok(()) } else { Err(told) }
}

#[test]
fn every_sensor_starts_runs_and_finds_what_is_there() {
    let scratch = tempfile::tempdir().expect("a folder");
    let made = Made::new(scratch.path());
    let (cells, expected) = cells(&robots(scratch.path()), &made);
    let of = |cell: &Cell| cells.iter().position(|c| std::ptr::eq(c, cell)).expect("one of them");
    let (right, wrong) = in_turn(&cells, |cell| look(cell, &expected[of(cell)]));
    println!(
        "{} compositions, {} of them refused as they should",
        cells.len(),
        expected.iter().filter(|e| !e.fits).count()
    );
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), cells.len(), wrong.join("\n"));
    assert_eq!(right.len(), cells.len());
    // each kind has told what it is there for
    let ran = || expected.iter().filter(|e| e.fits && e.is_shown);
    let found: BTreeSet<&str> = ran().map(|e| e.detector).collect();
    let placed: BTreeSet<&str> = ran().filter(|e| e.is_located()).filter_map(|e| e.locator).collect();
    assert_eq!(found, kinds::<dyn Detector>().iter().map(|k| k.name).collect());
    assert_eq!(placed, kinds::<dyn Locator>().iter().map(|k| k.name).collect());
}
