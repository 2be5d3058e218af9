//! One problem: scene compiled, planned, simplified, and judged by brute force if asked for.

use super::arm::Arm;
use super::problems::{InputFault, Problem};
use mobee_contract::KindError;
use mobee_model::Scene;
use mobee_planning::pair_rules::{pair_rules, rule_error};
use mobee_planning::planners::{JointPath, JointSpace, NoPath, PathEnd, Planner, PlanningProblem, shorten};
use nalgebra::Isometry3;
use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;
use std::ops::ControlFlow;

/// The clock is read once in this number of batches: reading it takes longer than some of them.
const CLOCK_EVERY: u32 = 64;
/// Configurations that brute force judges at once.
const JUDGED_AT_ONCE: usize = 4096;

/// Settings of all trials.
#[derive(Clone, Debug)]
pub(crate) struct TrialSettings {
    /// Meters.
    pub clearance: f64,
    pub seed: u64,
    /// Processor time for one plan, seconds.
    pub limit_s: f64,
    /// The most lines that a simplification may judge.
    pub simplify_lines: u64,
    /// Step of the judge by brute force, rad or meters along a line; none: no judge.
    pub check_step: Option<f64>,
    /// Times are the least of this number of runs.
    pub rounds: u32,
}

/// Result of one problem.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Trial {
    pub scene: String,
    pub index: u32,
    /// True if start and goal are free by this program's engine.
    pub valid: bool,
    /// True if they are free by the file.
    pub valid_in_file: bool,
    pub solved: bool,
    /// The reason, if there is no path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unsolved: Option<String>,
    /// Processor time to make and compile the scene, ms.
    pub compile_ms: f64,
    pub plan_ms: f64,
    pub simplify_ms: f64,
    /// Straight lines judged by the planner.
    pub lines: u64,
    /// Length of the path, rad and m.
    pub cost: f64,
    pub simplified_cost: f64,
    /// True if brute force found a configuration on either path that is not free.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refuted: Option<bool>,
}

/// The robot alone, and its space, compiled.
///
/// # Errors
/// If it can't stand in a scene.
pub(crate) fn compile_arm(arm: &Arm, settings: &TrialSettings) -> Result<(Scene, JointSpace), InputFault> {
    let fault = |e: &dyn std::error::Error| InputFault::new(e, "mend the robot's files");
    let alone = Scene::new(vec![(arm.robot.clone(), Isometry3::identity())], Vec::new()).map_err(|e| fault(&e))?;
    let space =
        JointSpace::new(&alone, 0, &[&arm.pose], &arm.motors, &[], settings.clearance).map_err(|e| fault(&e))?;
    Ok((alone, space))
}

/// Runs a problem.
///
/// # Arguments
/// * `arm`, `robot_alone`, `space_alone`: the robot, and its scene and space without objects, compiled.
///
/// # Errors
/// If the scene can't be made.
pub(crate) fn run(
    (arm, (robot_alone, space_alone)): (&Arm, &(Scene, JointSpace)),
    planner: &dyn Planner,
    scene: &str,
    problem: &Problem,
    settings: &TrialSettings,
) -> Result<Trial, InputFault> {
    let mut trial =
        Trial { scene: scene.to_owned(), index: problem.index, valid_in_file: problem.valid, ..Trial::default() };
    let fault = |e: &dyn std::error::Error| {
        InputFault::new(format!("{scene}, problem {}: {e}", problem.index), "mend the problem")
    };
    let objects = problem.objects(scene);
    let may_touch: Vec<String> = arm.may_touch.iter().chain(&problem.may_touch).cloned().collect();
    let rules = pair_rules(&may_touch, &arm.pair_clearance_mm).map_err(|e| rule_fault(scene, problem, &e))?;
    let (mut world, mut space) = (None, None);
    trial.compile_ms = least(settings.rounds, || {
        let made = robot_alone.with_objects(objects.clone()).map_err(|e| fault(&e))?;
        let made = made.with_pair_rules(0, &rules).map_err(|e| rule_fault(scene, problem, &rule_error(&e)))?;
        let compiled = space_alone.among(&made, &[&arm.pose]).map_err(|e| fault(&e))?;
        (world, space) = (Some(made), Some(compiled));
        Ok(())
    })?;
    let (Some(world), Some(mut space)) = (world, space) else { return Ok(trial) };
    let asked = PlanningProblem {
        start: space.within(&arm.encoder(&problem.start)),
        goals: vec![space.within(&arm.encoder(&problem.goal))],
        seed: settings.seed,
        budget: u64::MAX,
    };
    let mut found = Err(NoPath::Cancelled);
    trial.plan_ms = least(settings.rounds, || {
        let (begun, mut calls) = (processor_ms(), 0_u32);
        found = planner.plan(&mut space, &asked, &mut |_| {
            calls = calls.wrapping_add(1);
            let late = calls.is_multiple_of(CLOCK_EVERY) && processor_ms() - begun > settings.limit_s * 1e3;
            if late { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        Ok(())
    })?;
    trial.valid = !matches!(&found, Err(NoPath::Malformed(_) | NoPath::Limits { .. } | NoPath::Blocked { .. }));
    match found {
        Ok(path) => {
            trial.solved = true;
            trial.lines = path.evaluations;
            trial.cost = arm.cost(&path.poses);
            let mut short = path.clone();
            trial.simplify_ms = least(settings.rounds, || {
                short = shorten(&mut space, path.clone(), settings.seed, settings.simplify_lines);
                Ok(())
            })?;
            trial.simplified_cost = arm.cost(&short.poses);
            let judge = |step| touches(arm, &mut space, &path, step) || touches(arm, &mut space, &short, step);
            trial.refuted = settings.check_step.map(judge);
        }
        Err(NoPath::Cancelled) => trial.unsolved = Some(format!("no path within {} s", settings.limit_s)),
        Err(why) => {
            let end = match &why {
                NoPath::Blocked { end: PathEnd::Start, .. } | NoPath::Limits { end: PathEnd::Start, .. } => "start: ",
                NoPath::Blocked { .. } | NoPath::Limits { .. } => "goal: ",
                _ => "",
            };
            trial.unsolved = Some(format!("{end}{}", why.text(&world, 0)));
        }
    }
    Ok(trial)
}

/// A rule for pairs that can't be used, with its place.
fn rule_fault(scene: &str, problem: &Problem, error: &KindError) -> InputFault {
    let place = if error.path.is_empty() { String::new() } else { format!("{}: ", error.path) };
    InputFault::new(format!("{scene}, problem {}: {place}{}", problem.index, error.what), &error.help)
}

/// True if any configuration of a path, in steps of this length, is not free.
fn touches(arm: &Arm, space: &mut JointSpace, path: &JointPath, step: f64) -> bool {
    path.edges().any(|(a, b)| {
        let steps = (arm.cost(&[a.to_vec(), b.to_vec()]) / step).ceil().max(1.0) as usize;
        let all: Vec<usize> = (0..=steps).collect();
        all.chunks(JUDGED_AT_ONCE).any(|some| {
            let at = |i: &usize| {
                let share = *i as f64 / steps as f64;
                a.iter().zip(b).map(|(a, b)| a + (b - a) * share).collect::<Vec<f64>>()
            };
            let poses: Vec<Vec<f64>> = some.iter().map(at).collect();
            space.free(poses.iter().map(Vec::as_slice)).contains(&false)
        })
    })
}

/// Processor time of the quickest of some runs, ms.
fn least(rounds: u32, mut run: impl FnMut() -> Result<(), InputFault>) -> Result<f64, InputFault> {
    let mut least = f64::INFINITY;
    for _ in 0..rounds.max(1) {
        let begun = processor_ms();
        run()?;
        least = least.min(processor_ms() - begun);
    }
    Ok(least)
}

/// Processor time of this thread, ms: what others do on the machine counts less.
fn processor_ms() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
