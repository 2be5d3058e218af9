//! `mobee roadmap build`: the map of a table, pose by pose.

use super::part::Part;
use super::{info, map, may_write, robot, save, scene};
use crate::robot_import::Steps;
use miette::{Report, miette};
use mobee_compose::maps::{complaints, inputs};
use mobee_model::{Labels, Robot};
use mobee_planning::map_file::{robot_digest, world_digest};
use mobee_planning::table_map::{Growth, PoseSearch, PoseWish, TableMapPlan};
use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// Limits of an audit: number of cells, starts per cell, samples.
const AUDIT: (usize, usize, usize) = (100, 8, 3200);

/// Arguments of `mobee roadmap build`.
#[derive(clap::Args, Clone, Debug)]
pub struct BuildArgs {
    /// Settings, such as configs/roadmaps/table.toml
    settings: PathBuf,
    /// The map to write. An unfinished build is in FILE.part.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Override a setting: --set vertices=500
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Replace the map if it exists.
    #[arg(long)]
    force: bool,
    /// Search a hundred of the empty places again, much longer, to estimate the share that can be reached.
    #[arg(long)]
    audit: bool,
    /// Stop after this many searches, as an interrupt would.
    #[arg(long, value_name = "N", hide = true)]
    stop_after: Option<u64>,
}

/// Builds the map and reports its quality.
///
/// # Errors
/// If the settings are wrong, the unfinished build is of other settings, or a file can't be written.
#[expect(clippy::disallowed_methods, reason = "how long a build takes is told in real time")]
pub fn command(args: &BuildArgs) -> Result<String, Report> {
    may_write(&args.out, args.force)?;
    let (settings, source) = super::read_settings(&args.settings, &args.set)?;
    let scene = scene(&settings.robot, settings.world.as_deref())?;
    let robot = robot(&scene)?;
    let plan = Arc::new(settings.plan(robot).map_err(|e| complaints(&source, e))?);
    let from = format!("{plan:?}");
    let (mut part, trials) = Part::open(&args.out, &inputs(&from, &robot_digest(robot), &world_digest(&scene)))?;
    let mut search = PoseSearch::new(&scene, Arc::clone(&plan)).map_err(|e| miette!("{e}"))?;
    let mut growth = Growth::new(&plan, &robot.home());
    for (i, trial) in trials.iter().enumerate() {
        let wish = growth.next().filter(|w| (w.cell, w.attempt) == (trial.cell, trial.attempt));
        let wish = wish.ok_or_else(|| part.damaged(i, "no such search was due"))?;
        let found = trial.q.as_ref().map(|q| search.accept(&growth, &wish, q));
        let found = found.map(|f| f.ok_or_else(|| part.damaged(i, "this pose is not acceptable"))).transpose()?;
        growth.tell(trial.evaluations, found);
    }
    let bar = Steps::new();
    bar.step("finds poses");
    let began = Instant::now();
    while let Some(wish) = growth.next() {
        if args.stop_after.is_some_and(|most| growth.trials() >= most) {
            return Ok(format!("stopped after {} searches; the same command goes on\n", growth.trials()));
        }
        let trial = search.search(&growth, &wish);
        part.note(&trial)?;
        let found = trial.q.as_ref().and_then(|q| search.accept(&growth, &wish, q));
        growth.tell(trial.evaluations, found);
        bar.show(growth.found().len() as f64 / growth.most().max(1) as f64);
    }
    if growth.found().is_empty() {
        part.remove()?;
        return Err(miette!(
            help = "check height, offset, hand and palm: `mobee model view` shows the robot",
            "no pose over the table was found, in {} searches from home",
            growth.trials()
        ));
    }
    let found_in = began.elapsed().as_secs_f64();
    bar.step("joins neighbors");
    let map = map(&growth, &plan, robot, world_digest(&scene));
    save(&args.out, &map)?;
    part.remove()?;
    let mut report = format!("{}: ", args.out.display()) + &info::text(&map, Some(&Labels::new(scene.robots())));
    let _ = writeln!(
        report,
        "{} searches of {} judged poses, {found_in:.1} s; {} cells of the table stayed empty beside the map",
        growth.trials(),
        growth.evaluations(),
        growth.searched_in_vain().len()
    );
    if args.audit {
        bar.step("searches empty places again");
        report += &audit(&growth, &plan, robot, &mut search, &bar);
    }
    Ok(report)
}

/// Estimates the share of reachable places that have a pose, by a longer search.
fn audit(growth: &Growth, plan: &TableMapPlan, robot: &Robot, search: &mut PoseSearch, bar: &Steps) -> String {
    let (most, starts, budget) = AUDIT;
    // without vertices, so that no pose is too close to another one
    let empty = Growth::new(plan, &robot.home());
    let vain = growth.searched_in_vain();
    let sampled: Vec<u32> = vain.iter().copied().step_by(vain.len().div_ceil(most).max(1)).collect();
    let mut reached = 0;
    for (i, cell) in sampled.iter().enumerate() {
        bar.show(i as f64 / sampled.len() as f64);
        let [x, y] = growth.middle(*cell);
        let mut near: Vec<_> = growth.found().iter().collect();
        near.sort_by(|a, b| {
            let far = |at: [f64; 3]| (at[0] - x).hypot(at[1] - y);
            far(a.at).total_cmp(&far(b.at))
        });
        let wish = |q: &[f64]| PoseWish { cell: Some(*cell), attempt: 0, start: q.to_vec() };
        reached +=
            usize::from(near.iter().step_by(7).take(starts).any(|v| search.reaches(&empty, &wish(&v.q), budget)));
    }
    let share = reached as f64 / sampled.len().max(1) as f64;
    let have = growth.found().len() as f64;
    format!(
        "audit: of {} empty places searched again, {reached} can be reached: the map has {:.1} % of the reachable places\n",
        sampled.len(),
        100.0 * have / (have + share * vain.len() as f64).max(1.0)
    )
}
