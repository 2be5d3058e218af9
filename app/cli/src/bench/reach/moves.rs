//! Measures the delay by the wall clock from an update of the object in the model to the amended motion that leads
//! there.

use super::super::scene::CUP_NAME;
use super::ReachBenchArgs;
use crate::run::{Folder, run};
use miette::{IntoDiagnostic, Report, miette};
use mobee_compose::config::Config;
use mobee_contract::{Event, Note, Time};
use mobee_journal::journal;
use mobee_model::Edit;
use mobee_runtime::system::{CueTrigger, ScriptStep};
use nalgebra::{Isometry3, Translation3};
use serde_json::{Value, json};
use std::time::Duration;
use tokio::sync::mpsc;

/// Distance by which the object moves to either side, meters.
const SIDE_M: f64 = 0.025;
/// Interval between two moves of the object, seconds.
const MOVE_INTERVAL_S: f64 = 1.0;
/// Share of the maximum speeds, so low that a reach takes long.
const REACH_SPEED: f64 = 0.04;
/// Duration of a reach at that speed, seconds.
const REACH_S: f64 = 45.0;
/// Number of moves of the object during a reach.
const MOVES_PER_REACH: f64 = 15.0;
/// Maximum delay of an answer to a move, seconds.
const MAX_DELAY_S: f64 = 0.9;

/// Moves the object repeatedly, until `count` moves were followed or twice the expected time is over.
///
/// # Errors
/// Complaints about the behavior, or about the run's folder.
pub(super) fn measure(args: &ReachBenchArgs, count: u64) -> Result<Value, Report> {
    if !(1..=10_000).contains(&count) {
        return Err(miette!(help = "give a number from 1 to 10000, such as 100", "{count} moves can't be measured"));
    }
    let secs = 10.0 + 2.0 * REACH_S * (count as f64 / MOVES_PER_REACH).ceil();
    let (config, _) = Config::load(&args.file, &args.set).map_err(Report::new)?;
    let robot = config.robot.first().map_or("", |r| r.name.as_str());
    let own = [
        format!("for_s={secs}"),
        "clock=\"real\"".to_owned(),
        "sensor=[]".to_owned(),
        "script=[]".to_owned(),
        format!("robot.{robot}.agent.repeat=0"),
        format!("robot.{robot}.agent.speed={REACH_SPEED}"),
    ];
    let own: Vec<String> = own.into_iter().chain(args.set.iter().cloned()).collect();
    let mut composition = mobee_compose::read(&args.file, &own).map_err(Report::new)?;
    let (_, cup) = composition.scene.object(CUP_NAME).ok_or_else(|| miette!("the world has no `{CUP_NAME}`"))?;
    let pose = cup.pose;
    let step = |i: u64| {
        let side = if i.is_multiple_of(2) { SIDE_M } else { -SIDE_M };
        let pose = Isometry3::from_parts(Translation3::new(0.0, side, 0.0) * pose.translation, pose.rotation);
        let at = Time::from_secs(2.0 + MOVE_INTERVAL_S * i as f64);
        ScriptStep { when: CueTrigger::At(at), edit: Edit::Move { name: CUP_NAME.to_owned(), pose } }
    };
    composition.script = (0..(secs / MOVE_INTERVAL_S) as u64).map(step).collect();
    let scratch = tempfile::tempdir().into_diagnostic()?;
    let path = args.keep.as_ref().map_or_else(|| scratch.path().join("run"), |keep| keep.join("moves"));
    let folder = Folder::create("bench", Some(&path)).into_diagnostic()?;
    let (_controls, receiver) = mpsc::channel(1);
    let done = run(composition, &folder, receiver, |_| ())?;
    let (mut delays, rolled_back) = answers(&folder)?;
    delays.truncate(count as usize);
    delays.sort_by(f64::total_cmp);
    let at = |share: f64| delays.get((delays.len().saturating_sub(1) as f64 * share).round() as usize).copied();
    Ok(json!({
        "moves_followed": delays.len(),
        "in_motion_after_ms": { "median": at(0.5), "p95": at(0.95), "most": at(1.0) },
        "taken_back_first": rolled_back,
        "within_100_ms": delays.iter().filter(|ms| **ms < 100.0).count(),
        "hard_contacts": done.end.counts.hard_contacts,
        "late_periods": done.end.counts.late.periods,
    }))
}

/// Delays from each move of the object to the amended motion, ms; and the number of motions that were rolled back
/// first.
fn answers(folder: &Folder) -> Result<(Vec<f64>, u64), Report> {
    let mut moved: Option<Time> = None;
    let mut delays = Vec::new();
    let mut rolled_back = 0;
    let mut follows = false;
    for line in journal::read(folder.path()).map_err(|e| miette!("{e}"))? {
        let line = line.map_err(|e| miette!("{e}"))?;
        let after = |since: Time| line.at.since(since);
        match &line.event {
            Event::World { object, .. } if object == CUP_NAME => (moved, follows) = (Some(line.at), false),
            Event::Note { note: Note::Log { text }, .. } if text.contains("has moved") => follows = true,
            Event::Amended { .. } => {
                let since = moved.take().filter(|since| after(*since) < Duration::from_secs_f64(MAX_DELAY_S));
                delays.extend(since.map(|since| after(since).as_secs_f64() * 1e3));
            }
            Event::Commit { .. } if follows => {
                rolled_back += u64::from(moved.take().is_some());
                follows = false;
            }
            _ => {}
        }
    }
    Ok((delays, rolled_back))
}
