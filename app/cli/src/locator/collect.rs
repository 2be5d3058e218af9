//! `mobee locator collect`: extracts from a run the views of an object that a robot held, as training data for
//! locators.
//!
//! ```text
//! journal: detections of both eyes ─────┐
//! track of the looking robot: its joints ┼──> row, if both robots rested and no detection was clipped ──> check ──> table
//! track of the holding robot: its marker ┘
//! ```
//! A running run can be read, too: the table then has the views so far.

mod bodies;
mod pictures;
mod report;
mod rows;

use crate::inspect::journal_error;
use crate::roadmap::may_write;
use bodies::TrackInterpolator;
use miette::Report;
use mobee_compose::config::{Config, ConfigError, SensorConfig, Source};
use mobee_compose::maps::save_text;
use mobee_compose::{Composition, compose};
use mobee_contract::{Event, Intrinsics, Outcome, Time, suggestion};
use mobee_journal::journal;
use mobee_sensing::locators::head::JOINTS;
use mobee_sensing::locators::rows::table;
use mobee_sim::eyes::SimulatedCameraSettings;
use report::{Collected, ViewCheck};
use rows::Rows;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Arguments of `mobee locator collect`.
#[derive(clap::Args, Clone, Debug)]
pub struct CollectArgs {
    /// The folder of a run, ended or not.
    run: PathBuf,
    /// The table to write.
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
    /// Also write the images of the rows, NUMBER_CAMERA.png, into this folder, new or empty; the run's sensor must have
    /// stored its frames.
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    #[command(flatten)]
    selection: ViewSelection,
    /// Replace the table if it exists.
    #[arg(long)]
    force: bool,
}

/// Selection of views.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct ViewSelection {
    /// The marker at the center of the held object, of another robot than the one that looks.
    #[arg(long, value_name = "NAME", default_value = "block")]
    marker: String,
    /// The sensor, if there are several: two cameras on an iCub's head, the left one first.
    #[arg(long, value_name = "NAME")]
    pub(super) sensor: Option<String>,
    /// The behavior of the run, for a folder without config.json, such as one of `mobee torture`.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Maximum speed of any motor of the looking robot for a valid image, deg/s.
    #[arg(long, value_name = "DEG_S", default_value_t = 3.0, value_parser = positive)]
    still: f64,
    /// The same for the holding robot, which must not creep. One encoder step of 0.01 degrees in 20 ms is 0.5 deg/s.
    #[arg(long, value_name = "DEG_S", default_value_t = 0.6, value_parser = positive)]
    held: f64,
    /// Maximum deviation of a row from the nominal kinematics, after subtraction of the median, in pixels of 640x480;
    /// others are dropped as gross errors.
    #[arg(long, value_name = "PIXELS", default_value_t = 60.0, value_parser = positive)]
    gross: f64,
    /// Maximum number of rows per place, spread over the run; 0: all.
    #[arg(long, value_name = "N", default_value_t = 60)]
    per_place: usize,
    /// Minimum number of rows per place; places with fewer are dropped.
    #[arg(long, value_name = "N", default_value_t = 2)]
    least: usize,
}

pub(super) fn positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|n| n.is_finite() && *n > 0.0);
    number.ok_or_else(|| "give a number above 0".into())
}

/// The cameras and robots of a run.
pub(super) struct Scene {
    /// The sensor's cameras by their names in the journal, left and right.
    cameras: [String; 2],
    lenses: [Intrinsics; 2],
    /// Index of the looking robot.
    looks: usize,
    /// Index of the holding robot.
    holds: usize,
    /// Indices of the nine joints in the looking robot's configuration.
    joints: [usize; 9],
    /// Index of the marker of the holding robot.
    marker: usize,
}

/// Reads a run, writes the table, and reports its contents and the dropped views.
///
/// # Errors
/// As for [`collected`]; if the table can't be written.
pub fn command(args: &CollectArgs) -> Result<String, Report> {
    may_write(&args.out, args.force)?;
    if let Some(dir) = &args.images {
        pictures::may_fill(dir)?;
    }
    let Collection { table, text, cameras, exposed } = collected(&args.run, &args.selection)?;
    let images = args.images.as_ref().map(|dir| pictures::write(&args.run, dir, &cameras, &exposed)).transpose()?;
    save_text(&args.out, &table)?;
    Ok(format!("{}: {text}{}", args.out.display(), images.unwrap_or_default()))
}

/// The views collected from a run.
pub(super) struct Collection {
    /// The table.
    pub table: String,
    /// The report of its contents and of the dropped views.
    pub text: String,
    /// The cameras, left and right, by their names in the run.
    cameras: [String; 2],
    /// Exposure times of each row's images, left and right.
    exposed: Vec<[Time; 2]>,
}

/// Collects the table of a run, ended or not, with a report.
///
/// # Errors
/// If the run can't be read, has no such sensor or marker, or has no usable view.
pub(super) fn collected(run: &Path, selection: &ViewSelection) -> Result<Collection, Report> {
    let c = composition(run, selection)?;
    let scene = Scene::find(&c, selection)?;
    let name = |robot: usize| c.config.robot.get(robot).map(|r| r.name.clone()).unwrap_or_default();
    let body = |robot: usize| -> Result<TrackInterpolator, ConfigError> {
        let motors = c.scene.robots().get(robot).map_or(0, |r| r.motors.len());
        TrackInterpolator::open(run, &name(robot), motors)
    };
    let mut rows = Rows::new(
        &c,
        &scene,
        [body(scene.looks)?, body(scene.holds)?],
        [selection.still, selection.held].map(f64::to_radians),
    );
    let mut collected = Collected::default();
    for line in journal::read(run).map_err(journal_error)? {
        let line = match line {
            Ok(line) => line,
            // a running run, or one that crashed
            Err(e) if e.truncated => break,
            Err(e) => return Err(journal_error(e).into()),
        };
        collected.secs = line.at.secs();
        match line.event {
            Event::Sighted { camera, exposed, regions, is_shadow: false, .. } => {
                let Some(eye) = scene.cameras.iter().position(|c| *c == camera) else { continue };
                collected.pictures += 1;
                rows.see(eye, exposed, &regions);
            }
            Event::Outcome { outcome: Outcome::RolledBack, .. } => collected.rolled_back += 1,
            _ => {}
        }
    }
    let (raw, dropped) = rows.finish();
    let check = ViewCheck::new(raw, selection.gross, (selection.least, selection.per_place));
    if check.known.is_empty() {
        let what = format!("{}: nothing that was seen is of use: {dropped}", run.display());
        return Err(ConfigError::plain(what, "let both robots rest for a second or two in sight of each other").into());
    }
    let text = format!("{} rows\n{}", check.known.len(), check.text(&collected, &dropped));
    Ok(Collection { table: table(&check.known), text, cameras: scene.cameras.clone(), exposed: check.exposed })
}

/// The composition of the run.
fn composition(run: &Path, selection: &ViewSelection) -> Result<Composition, Report> {
    if !run.join(journal::FILE).is_file() {
        let what = format!("{} is no run: it has no {}", run.display(), journal::FILE);
        return Err(ConfigError::plain(what, "give the folder of a run").into());
    }
    let (config, source): (Config, Source) = match &selection.config {
        Some(file) => Config::load(file, &[])?,
        None => Config::load_resolved(&run.join("config.json"))?,
    };
    Ok(compose(config, &source)?)
}

impl Scene {
    fn find(c: &Composition, selection: &ViewSelection) -> Result<Scene, ConfigError> {
        let file = c.file.display();
        let named = |s: &&SensorConfig| selection.sensor.as_ref().is_none_or(|name| s.name == *name);
        let names: Vec<&str> = c.config.sensor.iter().map(|s| s.name.as_str()).collect();
        let mut found = c.config.sensor.iter().filter(named);
        let sensor = match (found.next(), found.next()) {
            (Some(one), None) => one,
            (Some(_), Some(_)) => {
                let help = format!("give --sensor; there are: {}", names.join(", "));
                return Err(ConfigError::plain("which sensor's pictures?", help));
            }
            (None, _) => {
                let wanted = selection.sensor.as_deref().unwrap_or_default();
                let help = match names.as_slice() {
                    [] => "run a behavior with a table [[sensor]], such as configs/behaviors/collect.toml".into(),
                    names => suggestion(wanted, "sensor", names),
                };
                return Err(ConfigError::plain(format!("{file}: no sensor looked there"), help));
            }
        };
        let [left, right] = sensor.eye.as_slice() else {
            let what = format!("the sensor {} has {} cameras", sensor.name, sensor.eye.len());
            return Err(ConfigError::plain(what, "locators learn from two: the left eye first, then the right one"));
        };
        let lens = |camera: &Value| -> Result<Intrinsics, ConfigError> {
            let mut settings = camera.clone();
            let kind = settings.as_object_mut().and_then(|table| table.remove("kind"));
            let simulated = kind.filter(|kind| kind == "simulated");
            let settings = simulated.and_then(|_| serde_json::from_value::<SimulatedCameraSettings>(settings).ok());
            settings.and_then(|s| s.intrinsics().ok()).ok_or_else(|| {
                let what = format!("the cameras of the sensor {} are not simulated", sensor.name);
                ConfigError::plain(what, "give a run with cameras of the kind `simulated`: their truth is known")
            })
        };
        let lenses = [lens(&left.camera)?, lens(&right.camera)?];
        let robots = c.scene.robots();
        let looks = sensor.carrier(&c.config).unwrap_or_default();
        let mut joints = [0; 9];
        for (joint, name) in joints.iter_mut().zip(JOINTS) {
            *joint = robots.get(looks).and_then(|r| r.motor_index(name)).ok_or_else(|| {
                let what = format!("the robot that carries the sensor {} has no motor {name}", sensor.name);
                ConfigError::plain(what, "locators learn an iCub's head: give a run in which one looks")
            })?;
        }
        let others = || robots.iter().enumerate().filter(|(i, _)| *i != looks);
        let marked = others().find_map(|(i, r)| Some((i, r.markers.iter().position(|m| m.name == selection.marker)?)));
        let (holds, marker) = marked.ok_or_else(|| {
            let markers: Vec<&str> = others().flat_map(|(_, r)| r.markers.iter().map(|m| m.name.as_str())).collect();
            let what = format!("no other robot of {file} has a marker {}", selection.marker);
            let help = match markers.as_slice() {
                [] => "give a run in which another robot holds what is looked at".into(),
                markers => suggestion(&selection.marker, "marker", markers),
            };
            ConfigError::plain(what, help)
        })?;
        let cameras = [left, right].map(|eye| format!("{}/{}", sensor.name, eye.name));
        Ok(Scene { cameras, lenses, looks, holds, joints, marker })
    }
}
