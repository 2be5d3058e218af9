//! `mobee run --resume`: continues a run that ended, or whose process died.
//!
//! The state of the run is in its journal, which is continued in the same file. An open transaction gets its outcome
//! before anything moves, from the measured configuration. If the robot is at neither end of the motion, it holds
//! (`after_crash`) until `recover` is requested; it then retreats along the path in the pose ring.

mod evidence;

use super::{CtlAt, Extras, Folder, Output, conduct, disk_space, resource_limits};
use crate::inspect::journal_error;
use miette::Report;
use mobee_compose::config::{Config, ConfigError, Source};
use mobee_compose::{Composition, compose_again};
use mobee_journal::journal::{Journal, JournalLine};
use mobee_journal::{files, ring, track};
use mobee_model::Robot;
use mobee_runtime::system::{Past, RobotSetup};
use mobee_sim::SIM;
use std::path::Path;
use std::process::ExitCode;
use tokio::sync::mpsc;

/// Resumes the run in this folder, with overrides.
///
/// # Errors
/// Complaints about the folder, its journal or the configuration, before anything moves.
pub fn command(dir: &Path, set: &[String], output: Output, ctl: CtlAt) -> Result<ExitCode, Report> {
    let folder = Folder::of_run(dir)?;
    let (_, stored) = Config::load_resolved(&dir.join("config.json"))?;
    let ended = evidence::summary_hash(dir)?;
    let mut damage: Vec<String> = files::changed(dir);
    damage.iter_mut().for_each(|what| what.push_str("; the run goes on with what can be read"));
    let mut reaches = ended.is_none();
    let mut past = Past::default();
    let lines = |line: &JournalLine| {
        reaches |= ended.as_ref() == Some(&line.hash);
        past.on(line);
    };
    let journal = Journal::resume(dir, lines).map_err(journal_error)?;
    evidence::check_config(dir, &past, &stored.value)?;
    if let Some(hash) = ended.filter(|_| !reaches) {
        return Err(evidence::cut_off(dir, &hash).into());
    }
    let mut source = Source::resolved(&stored.path, past.config.take().unwrap_or(stored.value));
    for assignment in set {
        source.set(assignment)?;
    }
    disk_space::check(Some(dir))?;
    let composition = compose_again(Config::from_source(&source)?, &source)?;
    for (r, model) in composition.config.robot.iter().zip(composition.scene.robots()) {
        let file = ring::file(dir, &r.name);
        let help = "the run goes on without what it recorded of its retreat";
        let poses = ring::read(&file).map_err(|e| ConfigError::plain(e, help))?;
        past.recorded(&r.name, evidence::of_robot(&file, model, poses)?);
        let mut measured = track::read(&track::file(dir, &r.name)).map_err(|e| ConfigError::plain(e, help))?;
        past.read_until(measured.iter_mut().flatten().map(|reading| reading.reported).max());
        for gap in measured.iter().flat_map(|readings| readings.gaps()).filter(|gap| gap.until.is_some()) {
            let ((from, to), file) = (gap.bytes, track::file(dir, &r.name));
            damage.push(format!(
                "{} is damaged from byte {from} to {to}; the measured poses after it are kept",
                file.display()
            ));
        }
    }
    let mut composition = place_simulated(composition, source, &past)?;
    let (scene, missing) = past.world(composition.scene);
    composition.scene = scene;
    resource_limits::check(&composition.config, ctl)?;
    for w in &composition.warnings {
        eprintln!("warning: {w}");
    }
    for name in missing {
        eprintln!(
            "warning: the object {name} was created during the run, and no file records its shape: create it again"
        );
    }
    let extras = Extras { past: Some((journal, past)), damage, ..Extras::default() };
    conduct(composition, &folder, extras, output, ctl, mpsc::channel(16))
}

/// Places simulated robots at their last recorded configurations. Real robots are where they are.
fn place_simulated(composition: Composition, mut source: Source, past: &Past) -> Result<Composition, Report> {
    let mut moved = false;
    for (i, (setup, model)) in composition.robots.iter().zip(composition.scene.robots()).enumerate() {
        let RobotSetup { name, .. } = setup;
        let is_simulated = composition.config.robot.get(i).is_some_and(|r| r.driver_kind() == SIM);
        if is_simulated && let Some(q) = past.robot(name).q {
            for (motor, deg) in degrees(model, &q) {
                source.set(&format!("robot.{i}.driver.start_deg.{motor}={deg:?}"))?;
            }
            moved = true;
        }
    }
    if moved { Ok(compose_again(Config::from_source(&source)?, &source)?) } else { Ok(composition) }
}

/// A configuration as settings: motor names and degrees, clamped to the limits, which encoder noise may exceed.
fn degrees(model: &Robot, q: &[f64]) -> Vec<(String, f64)> {
    let motors = model.motors.iter().zip(q);
    motors.map(|(m, q)| (m.name.clone(), q.clamp(m.min, m.max).to_degrees())).collect()
}
