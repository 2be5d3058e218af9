//! One scene, in one variant.

use super::super::scene::{Areas, CUP_NAME, Moved, ReachScene};
use super::ReachBenchArgs;
use crate::run::{Folder, in_order, run};
use miette::{IntoDiagnostic, Report, miette};
use mobee_agents::{ReachAgent, ReachSettings};
use mobee_compose::Composition;
use mobee_compose::config::Config;
use mobee_contract::{Agent, Context, Role, Time, View, settings};
use mobee_model::{Edit, Scene};
use mobee_runtime::system::{CueTrigger, ScriptStep};
use nalgebra::{Isometry3, Translation3};
use serde::Serialize;
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use tokio::sync::mpsc;

/// Clearance of plans: the reflex's margin and 2 mm, meters.
const CLEARANCE_M: f64 = 0.012;
/// Distance of the hand from its goal, in ground truth, above which it is beside the cup, mm.
const MAX_HAND_ERROR_MM: f64 = 30.0;
/// Time at which things move in a moving scene: the hand is under way by then, seconds.
const MOVE_TIME_S: f64 = 4.0;

/// The variants of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Variant {
    /// The behavior as configured.
    Whole,
    /// Sense, plan, act: the cup is localized once, the path is planned on that basis, and nothing stops the robot.
    NoReflex,
    /// The cup is localized once; the reflex is on.
    OneLook,
}

/// The result of one scene.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Outcome {
    pub seed: u64,
    /// `reached`, `beside` or `touched` something; the agent's cause of a miss, `stopped`, `unfinished` or `failed`.
    pub end: String,
    /// True if the slow search brings the hand there.
    pub solvable: bool,
    pub posts: usize,
    /// Time from the start of the motion until the hand was in front of the cup, seconds.
    pub pre_grasp_s: f64,
    /// Time from the detection of the cup to the start of the motion, seconds.
    pub set_out_s: f64,
    /// Distance between the hand and its goal in front of the true cup, mm.
    pub off_mm: f64,
    /// Error of the agent's final estimate of the cup's position, mm.
    pub believed_off_mm: f64,
    pub rolled_back: u64,
    pub hard_contacts: u64,
}

impl Outcome {
    /// The result with a monitor that stops and rolls back nothing: until it is freed, the robot stays at its first
    /// stop.
    pub fn stopped_for_good(&self) -> Outcome {
        let mut outcome = self.clone();
        if outcome.rolled_back > 0 && outcome.end != "failed" {
            (outcome.end, outcome.pre_grasp_s, outcome.hard_contacts) = ("stopped".to_owned(), 0.0, 0);
        }
        outcome
    }

    pub fn line(&self) -> String {
        let Outcome { seed, end, solvable, posts, pre_grasp_s, set_out_s, off_mm, believed_off_mm, .. } = self;
        let can = if *solvable { "" } else { " (the slow search does not find a way either)" };
        format!(
            "seed {seed}: {end}{can}, {posts} posts, set out after {set_out_s:.2} s, there after {pre_grasp_s:.2} s, off by \
             {off_mm:.1} mm, believed {believed_off_mm:.1} mm off, {} rolled back, {} hard contacts",
            self.rolled_back, self.hard_contacts
        )
    }
}

/// Runs one scene.
///
/// # Errors
/// Complaints about the behavior.
pub(super) fn run_one(args: &ReachBenchArgs, seed: u64, way: Variant) -> Result<Outcome, Report> {
    let composed = |set: &[String]| mobee_compose::read(&args.file, set).map_err(Report::new);
    let Composition { scene, config, .. } = composed(&args.set)?;
    let bare = bare(&scene)?;
    let cameras = simulated(&config);
    let areas = Areas { cup: args.cup_m, posts: args.posts_m };
    let drawn = ReachScene::new(seed, (cameras.len(), args.offset_deg), args.moving, &areas, &bare)?;
    let mut composition = composed(&overrides(args, seed, &drawn, (&config, cameras.as_slice()), way))?;
    let agent = composition.config.robot.first().and_then(|r| r.agent.clone()).unwrap_or_default();
    composition.scene = with_posts(&bare, &drawn)?;
    composition.script.extend(drawn.moved.iter().flat_map(steps));
    let solvable = is_solvable(&args.file, &agent, &drawn)?;
    let done = finish(args, seed, composition)?;
    let figures = &done.1;
    let figure = |name: &str| figures.iter().find(|(n, _)| n == name).map_or(0.0, |(_, n)| *n);
    let pre = agent["pre_grasp_mm"].as_array().cloned().unwrap_or_default();
    let pre = [0, 1, 2].map(|i| pre.get(i).and_then(Value::as_f64).unwrap_or(0.0));
    let cup = drawn.cup_at_last().map(|x| x * 1e3);
    let off = |what: &str, plus: [f64; 3]| {
        let axis = |(i, axis): (usize, &str)| {
            let should = cup.get(i).copied().unwrap_or(0.0) + plus.get(i).copied().unwrap_or(0.0);
            (figure(&format!("{what}_{axis}_mm")) - should).powi(2)
        };
        ["x", "y", "z"].into_iter().enumerate().map(axis).sum::<f64>().sqrt()
    };
    let was_there = figure("pre_grasp_s") > 0.0;
    let off_mm = if was_there { off("hand", pre) } else { 0.0 };
    let counts = &done.0.end.counts;
    let missed = figures.iter().find(|(name, n)| name.starts_with("missed_") && *n > 0.0);
    let end = match missed {
        _ if !in_order(&done.0.end) => "failed",
        _ if counts.hard_contacts > 0 => "touched",
        _ if figures.is_empty() => "unfinished",
        Some((cause, _)) => cause,
        None if figure("reached") < 1.0 => "unfinished",
        None if off_mm > MAX_HAND_ERROR_MM => "beside",
        None => "reached",
    };
    Ok(Outcome {
        seed,
        end: end.to_owned(),
        solvable,
        posts: drawn.posts.len(),
        pre_grasp_s: figure("pre_grasp_s"),
        set_out_s: figure("set_out_s"),
        off_mm,
        believed_off_mm: if figures.is_empty() { 0.0 } else { off("object", [0.0; 3]) },
        rolled_back: counts.rolled_back,
        hard_contacts: counts.hard_contacts,
    })
}

type Figures = Vec<(String, f64)>;

/// Runs a composition to its end; returns the agent's figures, empty if it did not finish.
fn finish(args: &ReachBenchArgs, seed: u64, composition: Composition) -> Result<(crate::run::Done, Figures), Report> {
    let scratch = tempfile::tempdir().into_diagnostic()?;
    let path = args.keep.as_ref().map_or_else(|| scratch.path().join("run"), |keep| keep.join(format!("seed-{seed}")));
    let folder = Folder::create("bench", Some(&path)).into_diagnostic()?;
    let robot = composition.robots.first().map(|r| r.name.clone()).unwrap_or_default();
    let (_controls, receiver) = mpsc::channel(1);
    let done = run(composition, &folder, receiver, |_| ())?;
    let figures = done.end.counts.done.get(&robot).map(|summary| summary.figures.clone()).unwrap_or_default();
    Ok((done, figures))
}

/// The world without the objects that are drawn: removes all removable ones but the cup.
fn bare(scene: &Scene) -> Result<Scene, Report> {
    let loose = scene.objects().filter(|(_, o)| !o.persistent && o.name != CUP_NAME);
    let names: Vec<String> = loose.map(|(_, o)| o.name.clone()).collect();
    let remove = |scene: Scene, name: String| scene.edit(&Edit::Remove { name }).map_err(|e| miette!("{e}"));
    names.into_iter().try_fold(scene.clone(), remove)
}

/// The world of the model at the start: the posts are added, the cup is where its file has it.
fn with_posts(bare: &Scene, drawn: &ReachScene) -> Result<Scene, Report> {
    let add =
        |scene: Scene, post: &mobee_model::Object| scene.edit(&Edit::Add(post.clone())).map_err(|e| miette!("{e}"));
    drawn.posts.iter().try_fold(bare.clone(), add)
}

/// The moves during a reach as steps of the script: the cup in the ground truth only, the post in the model, too.
fn steps(moved: &Moved) -> Vec<ScriptStep> {
    let step = |edit: Edit| ScriptStep { when: CueTrigger::At(Time::from_secs(MOVE_TIME_S)), edit };
    let [x, y, z] = moved.cup;
    let pose = Isometry3::from_parts(Translation3::new(x, y, z), moved.upright);
    let cup = step(Edit::Move { name: CUP_NAME.to_owned(), pose });
    let post = moved.post.clone().map(|(name, pose)| step(Edit::Move { name, pose }));
    [Some(cup), post].into_iter().flatten().collect()
}

/// The simulated cameras of a behavior: keys of their tables, and rotations, deg.
fn simulated(config: &Config) -> Vec<(String, [f64; 3])> {
    let eyes = config.sensor.iter().flat_map(|sensor| {
        sensor.eye.iter().map(move |eye| (format!("sensor.{}.eye.{}.camera", sensor.name, eye.name), &eye.camera))
    });
    let turned = |camera: &Value| [0, 1, 2].map(|i| camera["rotation_deg"][i].as_f64().unwrap_or(0.0));
    eyes.filter(|(_, camera)| camera["kind"] == "simulated").map(|(at, camera)| (at, turned(camera))).collect()
}

/// The scene and one reach, as settings.
fn overrides(
    args: &ReachBenchArgs,
    seed: u64,
    drawn: &ReachScene,
    (config, cameras): (&Config, &[(String, [f64; 3])]),
    way: Variant,
) -> Vec<String> {
    let [x, y, z] = drawn.cup;
    let robot = config.robot.first();
    let name = robot.map_or("", |r| r.name.as_str());
    let mut own = vec![
        format!("script=[{{when={{at_s=0.1}},edit={{object=\"{CUP_NAME}\",position_m=[{x},{y},{z}]}}}}]"),
        format!("for_s={}", args.secs),
        format!("seed={seed}"),
        "clock=\"virtual\"".to_owned(),
        "record.enabled=false".to_owned(),
        format!("robot.{name}.agent.repeat=1"),
    ];
    for ((at, is), by) in cameras.iter().zip(&drawn.turned) {
        let turned: Vec<f64> = is.iter().zip(by).map(|(is, by)| is + by).collect();
        own.extend([format!("{at}.rotation_deg={turned:?}"), format!("{at}.scenery.seed={seed}")]);
    }
    if way != Variant::Whole {
        own.push(format!("robot.{name}.agent.follow=false"));
    }
    if let Some(robot) = robot.filter(|_| way == Variant::NoReflex) {
        let period = robot.controller.period_ms;
        let history = robot.controller.history;
        let plain = format!("{{kind=\"rollback\",reflex=false,period_ms={period},history={history}}}");
        own.push(format!("robot.{name}.controller={plain}"));
    }
    own.into_iter().chain(args.set.iter().cloned()).collect()
}

/// True if a slow search brings the hand to the cup's final true position.
fn is_solvable(file: &Path, agent: &Value, drawn: &ReachScene) -> Result<bool, Report> {
    let mut agent = agent.clone();
    let kind = agent.as_object_mut().and_then(|table| table.remove("kind"));
    let kind = kind.as_ref().and_then(Value::as_str).unwrap_or_default();
    for (_, map) in mobee_compose::config::maps(<dyn Agent>::NAME, kind, &mut agent) {
        let Some(name) = map.as_str() else { continue };
        let path = file.parent().unwrap_or(Path::new("")).join(name);
        *map = mobee_compose::maps::for_agent(&path, None).map_err(Report::new)?;
    }
    let robot = mobee_compose::maps::robot(&drawn.truth)?.clone();
    let agent: ReachSettings = settings(&agent).into_diagnostic()?;
    let mut reach = ReachAgent::new(agent, &Context { robot, seed: 1 }).into_diagnostic()?;
    let view = View {
        at: Time::ZERO,
        robot: 0,
        axes: Arc::new([]),
        poses: drawn.truth.home(),
        scene: Arc::new(drawn.truth.clone()),
        contacts: Arc::new([]),
        clearance: CLEARANCE_M,
        seen: Arc::new([]),
    };
    Ok(reach.can_reach(drawn.cup_at_last(), &view))
}
