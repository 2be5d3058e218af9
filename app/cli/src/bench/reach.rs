//! `mobee bench reach`: a reach in each of many random scenes, in virtual time, with the cause of every failure.
//!
//! ```text
//! seed ──> cup, posts, cameras with errors ──> run of the behavior, repeat = 1 ──> reached, or the cause; seconds, mm, rollbacks
//!                     ├──> a slow exhaustive search: is it reachable at all?
//!                     └──> alternatives: no reflex, cup localized once, a stop without retreat
//! ```

mod moves;
mod totals;
mod trial;

use super::scene::Area;
use miette::{IntoDiagnostic, Report, miette};
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::process::ExitCode;
use trial::{Outcome, Variant};

/// The arguments of `mobee bench reach`.
#[derive(Clone, Debug, clap::Args)]
pub struct ReachBenchArgs {
    /// The behavior: its first robot's agent reaches, and its world has a `cup`, obstacles that stay, and others, which are left out.
    #[arg(long, default_value = "configs/behaviors/reach.toml")]
    file: PathBuf,
    /// Area of the cup's middle on the table: minimum and maximum x, minimum and maximum y, meters.
    #[arg(long, value_name = "X,X,Y,Y", default_value = "-0.48,-0.26,-0.10,0.26", value_parser = area, allow_hyphen_values = true)]
    cup_m: Area,
    /// Area of the posts.
    #[arg(long, value_name = "X,X,Y,Y", default_value = "-0.60,-0.20,-0.25,0.45", value_parser = area, allow_hyphen_values = true)]
    posts_m: Area,
    /// Number of scenes, a seed for each.
    #[arg(long, default_value_t = 500)]
    seeds: u64,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Maximum rotation error of the cameras about each axis, degrees.
    #[arg(long, default_value_t = 1.0)]
    offset_deg: f64,
    /// Simulated seconds for one reach.
    #[arg(long, default_value_t = 60.0)]
    secs: f64,
    /// During the reach, move the cup, and a post beside it.
    #[arg(long)]
    moving: bool,
    /// Also run each scene in three variants: without the reflex, with the cup localized once, and with a stop that is
    /// not rolled back.
    #[arg(long)]
    alternatives: bool,
    /// Instead of scenes: move the cup this often while the hand is under way, and measure the delay of the hand by the
    /// wall clock.
    #[arg(long, conflicts_with_all = ["alternatives", "moving"])]
    moves: Option<u64>,
    /// Store each scene's run in a folder of this folder.
    #[arg(long)]
    keep: Option<PathBuf>,
    /// Override a setting: --set robot.icub.agent.validation=optimistic
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

fn area(text: &str) -> Result<Area, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x0, x1, y0, y1]) if x0 <= x1 && y0 <= y1 && [x0, x1, y0, y1].iter().all(|n| n.abs() <= 10.0) => {
            Ok([[x0, x1], [y0, y1]])
        }
        _ => {
            Err("give least and greatest x, then least and greatest y, in meters, such as 0.3,0.6,-0.2,0.2".to_owned())
        }
    }
}

/// Runs the benchmark.
///
/// # Errors
/// Complaints about the arguments or the behavior.
pub(super) fn command(args: &ReachBenchArgs) -> Result<ExitCode, Report> {
    if !(0.0..=10.0).contains(&args.offset_deg) || !(1.0..=1e4).contains(&args.secs) {
        return Err(miette!(
            help = "give --offset-deg from 0 to 10, and --secs from 1 to 10000",
            "{} degrees and {} seconds can't be measured",
            args.offset_deg,
            args.secs
        ));
    }
    if args.seeds == 0 {
        return Err(miette!(help = "give at least --seeds 1", "no scenes have no figures"));
    }
    if let Some(count) = args.moves {
        let figures = moves::measure(args, count)?;
        print(args, &figures, &figures)?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut all: Vec<(&str, Outcome)> = Vec::new();
    for seed in args.first..args.first.saturating_add(args.seeds) {
        let whole = trial::run_one(args, seed, Variant::Whole)?;
        let mut others = Vec::new();
        if args.alternatives {
            others.push(("stop_only", whole.stopped_for_good()));
            others.push(("no_reflex", trial::run_one(args, seed, Variant::NoReflex)?));
            others.push(("one_look", trial::run_one(args, seed, Variant::OneLook)?));
        }
        for (way, outcome) in [("mobee", whole)].into_iter().chain(others) {
            if !args.json {
                let way = if args.alternatives { format!("{way}, ") } else { String::new() };
                eprintln!("{way}{}", outcome.line());
            }
            all.push((way, outcome));
        }
    }
    let of = |way: &str| -> Vec<&Outcome> { all.iter().filter(|(w, _)| *w == way).map(|(_, o)| o).collect() };
    let figures = if args.alternatives {
        let rows =
            ["mobee", "stop_only", "no_reflex", "one_look"].map(|way| (way.to_owned(), totals::totals(&of(way))));
        Value::Object(rows.into_iter().collect::<Map<String, Value>>())
    } else {
        totals::totals(&of("mobee"))
    };
    let scenes: Vec<Value> = all.iter().map(|(way, o)| json!({ "way": way, "outcome": o })).collect();
    print(args, &figures, &json!({ "totals": figures, "scenes": scenes }))?;
    Ok(ExitCode::SUCCESS)
}

/// Prints a table, or everything as JSON.
fn print(args: &ReachBenchArgs, table: &Value, all: &Value) -> Result<(), Report> {
    if args.json {
        crate::terminal::out(&(serde_json::to_string_pretty(all).into_diagnostic()? + "\n"));
        return Ok(());
    }
    let mut text = String::new();
    for (name, value) in table.as_object().into_iter().flatten() {
        text += &format!("{name:22} {value}\n");
    }
    crate::terminal::out(&text);
    Ok(())
}
