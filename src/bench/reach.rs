//! `mobee bench reach`: a reach in each of many random scenes, in virtual time, and every failure by its cause.
//!
//! ```text
//! seed ──> cup, posts, cameras that are off ──> run of the behavior, repeat = 1 ──> reached, or why not; seconds, mm, rollbacks
//!                     └──> a slow exhaustive search: can it be reached at all?
//! ```

use super::scene::{CUP_NAME, ReachScene};
use crate::compose;
use crate::run::{Folder, in_order, run};
use miette::{IntoDiagnostic, Report, miette};
use mobee_behaviors::agents::{ReachAgent, ReachSettings};
use mobee_contract::{Context, Time, View, settings};
use mobee_model::{Edit, Scene};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use tokio::sync::mpsc;

/// What a plan keeps from everything: the reflex's margin and 2 mm, meters.
const CLEARANCE: f64 = 0.012;

/// The arguments of `mobee bench reach`.
#[derive(Clone, Debug, clap::Args)]
pub struct ReachBenchArgs {
    /// The behavior: its first robot's agent reaches, and its world has a `cup`, obstacles that stay, and others, which are left out.
    #[arg(long, default_value = "configs/behaviors/reach.toml")]
    file: PathBuf,
    /// Number of scenes, a seed for each.
    #[arg(long, default_value_t = 500)]
    seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// How far the cameras are turned at most from where they are thought to be, about each axis, degrees.
    #[arg(long, default_value_t = 1.0)]
    offset_deg: f64,
    /// Simulated seconds for one reach.
    #[arg(long, default_value_t = 60.0)]
    secs: f64,
    /// Override a setting: --set robot.icub.agent.validation=optimistic
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What came of one scene.
#[derive(Clone, Debug, Serialize)]
struct Outcome {
    seed: u64,
    /// `reached`, the agent's cause of a miss, `unfinished` or `failed`.
    end: String,
    /// Whether the slow search brings the hand there.
    solvable: bool,
    posts: usize,
    /// From when the hand set out to when it was before the cup, and from when the cup was seen to then, seconds.
    pre_grasp_s: f64,
    set_out_s: f64,
    /// Between the hand and where it should be before the cup as it is in truth, mm.
    off_mm: f64,
    rolled_back: u64,
    hard_contacts: u64,
}

/// Measures.
///
/// # Errors
/// Complaints about arguments or behavior.
pub(super) fn command(args: &ReachBenchArgs) -> Result<ExitCode, Report> {
    if !(0.0..=10.0).contains(&args.offset_deg) || !(1.0..=1e4).contains(&args.secs) {
        return Err(miette!(
            help = "give --offset-deg from 0 to 10, and --secs from 1 to 10000",
            "{} degrees and {} seconds can't be measured",
            args.offset_deg,
            args.secs
        ));
    }
    let mut all = Vec::new();
    for seed in args.first..args.first.saturating_add(args.seeds) {
        let outcome = one(args, seed)?;
        if !args.json {
            eprintln!("{}", line(&outcome));
        }
        all.push(outcome);
    }
    let told = totals(&all);
    if args.json {
        let all = json!({ "totals": told, "scenes": all });
        crate::terminal::out(&(serde_json::to_string_pretty(&all).into_diagnostic()? + "\n"));
    } else {
        crate::terminal::out(&table(&told));
    }
    Ok(ExitCode::SUCCESS)
}

/// One scene.
fn one(args: &ReachBenchArgs, seed: u64) -> Result<Outcome, Report> {
    let composed = |set: &[String]| compose::read(&args.file, set).map_err(Report::new);
    let bare = bare(&composed(&args.set)?.scene)?;
    let drawn = ReachScene::new(seed, args.offset_deg, &bare)?;
    let mut composition = composed(&overrides(args, seed, &drawn))?;
    let agent = composition.config.robot.first().and_then(|r| r.agent.clone()).unwrap_or_default();
    composition.scene = with_posts(&bare, &drawn)?;
    let solvable = is_solvable(&args.file, &agent, &drawn)?;
    let scratch = tempfile::tempdir().into_diagnostic()?;
    let folder = Folder::create("bench", Some(&scratch.path().join("run"))).into_diagnostic()?;
    let robot = composition.robots.first().map(|r| r.name.clone()).unwrap_or_default();
    let (_controls, receiver) = mpsc::channel(1);
    let done = run(composition, &folder, receiver, |_| ())?;
    let figures = done.end.counts.done.get(&robot).map(|told| told.figures.clone()).unwrap_or_default();
    let figure = |name: &str| figures.iter().find(|(n, _)| n == name).map_or(0.0, |(_, n)| *n);
    let missed = figures.iter().find(|(name, n)| name.starts_with("missed_") && *n > 0.0);
    let missed = missed.map(|(name, _)| name.as_str());
    let end = match missed {
        _ if !in_order(&done.end) => "failed",
        _ if figures.is_empty() => "unfinished",
        Some(cause) => cause,
        None => "reached",
    };
    let pre = agent["pre_grasp_mm"].as_array().cloned().unwrap_or_default();
    let off = |(i, name): (usize, &str)| {
        let should = drawn.cup.get(i).copied().unwrap_or(0.0) * 1e3 + pre.get(i).and_then(Value::as_f64).unwrap_or(0.0);
        (figure(name) - should).powi(2)
    };
    let off: f64 = ["hand_x_mm", "hand_y_mm", "hand_z_mm"].into_iter().enumerate().map(off).sum();
    let counts = &done.end.counts;
    Ok(Outcome {
        seed,
        end: end.to_owned(),
        solvable,
        posts: drawn.posts.len(),
        pre_grasp_s: figure("pre_grasp_s"),
        set_out_s: figure("set_out_s"),
        off_mm: if figure("pre_grasp_s") > 0.0 { off.sqrt() } else { 0.0 },
        rolled_back: counts.rolled_back,
        hard_contacts: counts.hard_contacts,
    })
}

/// The world without what is drawn anew: all that may be removed but the cup.
fn bare(scene: &Scene) -> Result<Scene, Report> {
    let loose = scene.objects().filter(|(_, o)| !o.persistent && o.name != CUP_NAME);
    let names: Vec<String> = loose.map(|(_, o)| o.name.clone()).collect();
    let remove = |scene: Scene, name: String| scene.edit(&Edit::Remove { name }).map_err(|e| miette!("{e}"));
    names.into_iter().try_fold(scene.clone(), remove)
}

/// The world as the model begins with it: the cup where its file has it.
fn with_posts(bare: &Scene, drawn: &ReachScene) -> Result<Scene, Report> {
    let add =
        |scene: Scene, post: &mobee_model::Object| scene.edit(&Edit::Add(post.clone())).map_err(|e| miette!("{e}"));
    drawn.posts.iter().try_fold(bare.clone(), add)
}

/// The scene and one reach as settings.
fn overrides(args: &ReachBenchArgs, seed: u64, drawn: &ReachScene) -> Vec<String> {
    let [x, y, z] = drawn.cup;
    let [left, right] = drawn.turned;
    let own = [
        format!("script=[{{when={{at_s=0.1}},edit={{object=\"{CUP_NAME}\",position_m=[{x},{y},{z}]}}}}]"),
        format!("sensor.eyes.eye.left.camera.rotation_deg={left:?}"),
        format!("sensor.eyes.eye.right.camera.rotation_deg={right:?}"),
        format!("for_s={}", args.secs),
        format!("seed={seed}"),
        "clock=\"virtual\"".to_owned(),
        "record.enabled=false".to_owned(),
        "robot.icub.agent.repeat=1".to_owned(),
    ];
    own.into_iter().chain(args.set.iter().cloned()).collect()
}

/// Whether a slow search brings the hand to where the cup is in truth.
fn is_solvable(file: &Path, agent: &Value, drawn: &ReachScene) -> Result<bool, Report> {
    let mut agent = agent.clone();
    if let Some(table) = agent.as_object_mut() {
        table.remove("kind");
    }
    if let Some(map) = agent["map"].as_str() {
        let path = file.parent().unwrap_or(Path::new("")).join(map);
        agent["map"] = crate::roadmap::for_agent(&path, None).map_err(Report::new)?;
    }
    let robot = crate::roadmap::robot(&drawn.truth)?.clone();
    let agent: ReachSettings = settings(&agent).into_diagnostic()?;
    let mut reach = ReachAgent::new(agent, &Context { robot, seed: 1 }).into_diagnostic()?;
    let view = View {
        at: Time::ZERO,
        robot: 0,
        axes: Arc::new([]),
        poses: drawn.truth.home(),
        scene: Arc::new(drawn.truth.clone()),
        contacts: Arc::new([]),
        clearance: CLEARANCE,
        seen: Arc::new([]),
    };
    Ok(reach.can_reach(drawn.cup, &view))
}

fn line(o: &Outcome) -> String {
    let Outcome { seed, end, solvable, posts, pre_grasp_s, set_out_s, off_mm, rolled_back, hard_contacts } = o;
    let can = if *solvable { "" } else { " (the slow search does not find a way either)" };
    format!(
        "seed {seed}: {end}{can}, {posts} posts, set out after {set_out_s:.2} s, there after {pre_grasp_s:.2} s, off by \
         {off_mm:.1} mm, {rolled_back} rolled back, {hard_contacts} hard contacts"
    )
}

/// What is said of all scenes.
fn totals(all: &[Outcome]) -> Value {
    let mut ends: BTreeMap<&str, [u64; 2]> = BTreeMap::new();
    for o in all {
        let [solvable, others] = ends.entry(&o.end).or_default();
        *if o.solvable { solvable } else { others } += 1;
    }
    let solvable = all.iter().filter(|o| o.solvable);
    let count = solvable.clone().count();
    let reached = solvable.filter(|o| o.end == "reached").count();
    let quantiles = |of: fn(&Outcome) -> f64| {
        let mut values: Vec<f64> = all.iter().filter(|o| o.end == "reached").map(of).collect();
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get((values.len().saturating_sub(1) as f64 * share).round() as usize).copied();
        json!({ "median": at(0.5), "p95": at(0.95), "most": at(1.0) })
    };
    json!({
        "scenes": all.len(),
        "solvable": count,
        "reached_of_solvable": if count > 0 { reached as f64 / count as f64 } else { 0.0 },
        "ends": ends.iter().map(|(end, [a, b])| (*end, json!({ "solvable": a, "others": b }))).collect::<BTreeMap<_, _>>(),
        "set_out_s": quantiles(|o| o.set_out_s),
        "pre_grasp_s": quantiles(|o| o.pre_grasp_s),
        "off_mm": quantiles(|o| o.off_mm),
        "rolled_back": all.iter().map(|o| o.rolled_back).sum::<u64>(),
        "hard_contacts": all.iter().map(|o| o.hard_contacts).sum::<u64>(),
    })
}

fn table(told: &Value) -> String {
    let mut text = String::new();
    for (name, value) in told.as_object().into_iter().flatten() {
        text += &format!("{name:22} {value}\n");
    }
    text
}
