//! `mobee bench plan`: planning problems from files, each planned, simplified and, if asked for, judged by brute force.
//!
//! ```text
//! FILE.json ──> problems ──┐
//! robots/   ──> arm ───────┴──> scene compiled ──> planned ──> simplified ──> table
//! ```

mod arm;
mod problems;
mod trial;

use crate::plan::PlannerArgs;
use crate::robot_import::Steps;
use miette::{IntoDiagnostic, Report, miette};
use mobee_contract::suggestion;
use mobee_planning::planners::Planner;
use problems::{InputFault, Problem, read_problems};
use serde_json::{Map, Value, json};
use std::fmt::Write;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use trial::{Trial, TrialSettings};

/// The arguments of `mobee bench plan`.
#[derive(Clone, Debug, clap::Args)]
pub struct PlanBenchArgs {
    /// Files of problems (format `mbm 1`: docs/planning.md), with the robot's URDF and SRDF in robots/ beside each.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Only this scene (repeatable).
    #[arg(long = "scene", value_name = "NAME")]
    scenes: Vec<String>,
    /// Only every N-th problem of a scene.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..))]
    every: u16,
    #[command(flatten)]
    planner: PlannerArgs,
    /// Processor time for one plan.
    #[arg(long, value_name = "SECONDS", default_value_t = 3.0, value_parser = seconds)]
    time: f64,
    /// Nearer than this is not free.
    #[arg(long, value_name = "MM", default_value_t = 0.0, value_parser = crate::robot_import::millimeters(0.0, 1000.0))]
    clearance_mm: f64,
    /// The seed of every plan.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Times are the least of this number of runs.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    /// Problems that are planned at once, each by a thread; default: one per processor. Times are processor times.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Judge each path by brute force, too, at steps of this many radians (or meters of a sliding joint), such as 0.000244.
    #[arg(long, value_name = "RAD", value_parser = check_step)]
    check: Option<f64>,
    /// Print JSON: the table, and each problem.
    #[arg(long)]
    json: bool,
}

/// The most lines that a simplification may judge.
const SIMPLIFY_LINES: u64 = 5000;

fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|s| (1e-3..=3600.0).contains(s));
    seconds.ok_or_else(|| "give a number of seconds from 0.001 to 3600".to_owned())
}

fn check_step(text: &str) -> Result<f64, String> {
    let step = text.parse().ok().filter(|s| (1e-6..=1.0).contains(s));
    step.ok_or_else(|| "give a step from 0.000001 to 1 rad".to_owned())
}

fn complaint(fault: InputFault) -> Report {
    miette!(help = fault.help, "{}", fault.text)
}

/// Measures.
///
/// # Errors
/// Complaints about files, with place and remedy.
pub(super) fn command(args: &PlanBenchArgs) -> Result<ExitCode, Report> {
    let settings = TrialSettings {
        clearance: args.clearance_mm / 1e3,
        seed: args.seed,
        limit_s: args.time,
        simplify_lines: SIMPLIFY_LINES,
        check_step: args.check,
        rounds: args.rounds,
    };
    // Before any file is read: wrong arguments need no work.
    args.planner.planner()?;
    let mut refuted = 0;
    let mut all = Map::new();
    for path in &args.files {
        let (notes, trials) = run_file(path, args, &settings)?;
        refuted += trials.iter().filter(|t| t.refuted == Some(true)).count();
        if args.json {
            let totals = totals(&trials);
            all.insert(path.display().to_string(), json!({ "notes": notes, "totals": totals, "problems": trials }));
        } else {
            crate::terminal::out(&table(path, &notes, &trials));
        }
    }
    if args.json {
        crate::terminal::out(&(serde_json::to_string_pretty(&all).into_diagnostic()? + "\n"));
    }
    if refuted > 0 {
        return Err(miette!(
            help = "please report it, with the problem and the seed",
            "{refuted} paths were refuted by brute force"
        ));
    }
    Ok(ExitCode::SUCCESS)
}

/// Runs the problems of a file that are asked for; returns the notes about its robot as well.
fn run_file(path: &Path, args: &PlanBenchArgs, settings: &TrialSettings) -> Result<(Vec<String>, Vec<Trial>), Report> {
    let file = read_problems(path).map_err(complaint)?;
    let known: Vec<&str> = file.scenes.keys().map(String::as_str).collect();
    if let Some(unknown) = args.scenes.iter().find(|s| !known.contains(&s.as_str())) {
        let help = suggestion(unknown, "scene", &known);
        return Err(miette!(help = help, "{} has no scene `{unknown}`", path.display()));
    }
    let arm = arm::load_arm(path, &file).map_err(complaint)?;
    let alone = trial::compile_arm(&arm, settings).map_err(complaint)?;
    let wanted = file.scenes.iter().filter(|(scene, _)| args.scenes.is_empty() || args.scenes.contains(scene));
    let chosen: Vec<(&str, &Problem)> = wanted
        .flat_map(|(scene, problems)| problems.iter().step_by(usize::from(args.every)).map(|p| (scene.as_str(), p)))
        .collect();
    if chosen.is_empty() {
        return Err(miette!(help = "give a file with problems", "{} has no problem to plan", path.display()));
    }
    let planners = (0..threads(args).min(chosen.len())).map(|_| args.planner.planner());
    let planners: Vec<Box<dyn Planner + Send>> = planners.collect::<Result<_, _>>()?;
    let trials = run_all(planners, &chosen, |planner, (scene, problem)| {
        trial::run((&arm, &alone), planner, scene, problem, settings)
    });
    Ok((arm.notes, trials.map_err(complaint)?))
}

/// Number of threads.
fn threads(args: &PlanBenchArgs) -> usize {
    args.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from)
}

/// Runs problems, each on the next thread that is free; results are in the order of the problems, and do not depend on
/// the threads.
fn run_all<P: Sync>(
    planners: Vec<Box<dyn Planner + Send>>,
    problems: &[P],
    run: impl Fn(&dyn Planner, &P) -> Result<Trial, InputFault> + Sync,
) -> Result<Vec<Trial>, InputFault> {
    let bar = Steps::new();
    bar.step("plans");
    let next = AtomicUsize::new(0);
    let work = &|planner: Box<dyn Planner + Send>| {
        let mut done = Vec::new();
        loop {
            let i = next.fetch_add(1, Ordering::Relaxed);
            let Some(problem) = problems.get(i) else { return done };
            bar.show(i as f64 / problems.len() as f64);
            done.push((i, run(planner.as_ref(), problem)));
        }
    };
    let mut all: Vec<(usize, Result<Trial, InputFault>)> = std::thread::scope(|scope| {
        let workers: Vec<_> = planners.into_iter().map(|planner| scope.spawn(move || work(planner))).collect();
        workers.into_iter().flat_map(|worker| worker.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    all.sort_by_key(|(i, _)| *i);
    all.into_iter().map(|(_, trial)| trial).collect()
}

/// What a row of the table shows: a name, and a number of a problem that was solved.
type Figure = (&'static str, fn(&Trial) -> f64);

const FIGURES: [Figure; 6] = [
    ("scene_ms", |t| t.compile_ms),
    ("plan_ms", |t| t.plan_ms),
    ("simplify_ms", |t| t.simplify_ms),
    ("lines", |t| t.lines as f64),
    ("cost", |t| t.cost),
    ("simplified_cost", |t| t.simplified_cost),
];

/// Median, mean, 95 % and most of some numbers.
fn statistics(mut numbers: Vec<f64>) -> Option<[f64; 4]> {
    numbers.sort_by(f64::total_cmp);
    let last = numbers.len().checked_sub(1)?;
    let at = |share: f64| numbers.get((share * last as f64).round() as usize).copied().unwrap_or(f64::NAN);
    let mean = numbers.iter().sum::<f64>() / numbers.len() as f64;
    Some([at(0.5), mean, at(0.95), at(1.0)])
}

fn totals(trials: &[Trial]) -> Value {
    let solved: Vec<&Trial> = trials.iter().filter(|t| t.solved).collect();
    let mut totals = json!({
        "problems": trials.len(),
        "valid": trials.iter().filter(|t| t.valid).count(),
        "solved": solved.len(),
        "refuted": trials.iter().filter(|t| t.refuted == Some(true)).count(),
    });
    for (name, figure) in FIGURES {
        if let Some([median, mean, most_95, most]) = statistics(solved.iter().map(|t| figure(t)).collect()) {
            totals[name] = json!({ "median": median, "mean": mean, "p95": most_95, "most": most });
        }
    }
    totals
}

fn table(path: &Path, notes: &[String], trials: &[Trial]) -> String {
    let solved: Vec<&Trial> = trials.iter().filter(|t| t.solved).collect();
    let count = |is: fn(&&Trial) -> bool| trials.iter().filter(is).count();
    let mut text = format!("{}\n", path.display());
    notes.iter().for_each(|note| text += &format!("  note: {note}\n"));
    let valid = count(|t| t.valid);
    let _ = writeln!(text, "  solved {} of {valid} valid of {} problems", solved.len(), trials.len());
    let otherwise = count(|t| t.valid != t.valid_in_file);
    if otherwise > 0 {
        let _ = writeln!(text, "  {otherwise} are valid here and not by the file, or the other way round");
    }
    if trials.iter().any(|t| t.refuted.is_some()) {
        let _ = writeln!(text, "  refuted by brute force: {}", count(|t| t.refuted == Some(true)));
    }
    let _ = writeln!(text, "  {:16} {:>10} {:>10} {:>10} {:>10}", "", "median", "mean", "95 %", "most");
    for (name, figure) in FIGURES {
        if let Some(row) = statistics(solved.iter().map(|t| figure(t)).collect()) {
            let [a, b, c, d] = row.map(|x| format!("{x:.3}"));
            let _ = writeln!(text, "  {name:16} {a:>10} {b:>10} {c:>10} {d:>10}");
        }
    }
    let mut scenes: Vec<&str> = trials.iter().map(|t| t.scene.as_str()).collect();
    scenes.dedup();
    for scene in scenes {
        let of: Vec<f64> = solved.iter().filter(|t| t.scene == scene).map(|t| t.plan_ms).collect();
        let valid = trials.iter().filter(|t| t.scene == scene && t.valid).count();
        let solved = of.len();
        let times = statistics(of).map_or(String::new(), |[median, _, p95, most]| {
            format!(", plan_ms: median {median:.3}, 95 % {p95:.3}, most {most:.3}")
        });
        let _ = writeln!(text, "  {scene}: solved {solved} of {valid}{times}");
    }
    for trial in trials.iter().filter(|t| t.valid && !t.solved) {
        let why = trial.unsolved.as_deref().unwrap_or("");
        let _ = writeln!(text, "  {} {}: {why}", trial.scene, trial.index);
    }
    text
}
