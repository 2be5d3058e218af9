//! `mobee roadmap path`: a plan on a map.

use super::trajectory::{Speeds, Trajectory};
use super::{load_for, may_write, robot, save_text, scene};
use crate::terminal;
use miette::Report;
use mobee_compose::config::ConfigError;
use mobee_planning::map_file::{MapFile, StoredVerdict};
use mobee_planning::roadmap::Roadmap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Arguments of `mobee roadmap path`.
#[derive(clap::Args, Clone, Debug)]
pub struct PathArgs {
    /// The map.
    map: PathBuf,
    /// Name or number of the first vertex.
    from: String,
    /// Name or number of the last one.
    to: String,
    /// Robot XML: the one that the map was made for.
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// Plan over edges that were not certified free, too, as the paper does.
    #[arg(long)]
    optimistic: bool,
    /// Also write joint values with times as a table; `-`: standard output. The header names each motor with its unit.
    #[arg(long, value_name = "FILE|-")]
    csv: Option<PathBuf>,
    /// Also write them as JSON; `-`: standard output.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
    /// Share of each motor's maximum speed. Between two vertices the motors move at constant speed and arrive together.
    #[arg(long, value_name = "SHARE", default_value_t = 0.1, value_parser = share)]
    speed: f64,
    /// Maximum speed of motors whose robot file states none, deg/s or mm/s.
    #[arg(long, value_name = "DEG_PER_S", default_value_t = 100.0, value_parser = positive)]
    max_speed: f64,
    /// Write joint values at this interval, seconds, and at the end, instead of at each vertex.
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    every: Option<f64>,
    /// Replace the written files if they exist.
    #[arg(long)]
    force: bool,
}

/// A share of the maximum speed.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| "give a number".to_owned())?;
    if share > 0.0 && share <= 1.0 {
        Ok(share)
    } else {
        Err("give a share above 0 and up to 1, such as 0.1".to_owned())
    }
}

/// A number above zero.
pub(crate) fn positive(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "give a number".to_owned())?;
    if (1e-6..=1e6).contains(&number) { Ok(number) } else { Err("give a number from 0.000001 to 1000000".to_owned()) }
}

/// Plans, and prints the path.
///
/// # Errors
/// If a file can't be read or written, the map is of another robot, or there is no such vertex.
pub fn command(args: &PathArgs) -> Result<ExitCode, Report> {
    let files = [&args.csv, &args.json].map(|file| file.as_deref().filter(|file| *file != Path::new("-")));
    let to_terminal = [&args.csv, &args.json].iter().filter(|file| file.as_deref() == Some(Path::new("-"))).count();
    if to_terminal > 1 || (files[0].is_some() && files[0] == files[1]) {
        let what = "a table and JSON can't be written to one place";
        return Err(ConfigError::plain(what.to_owned(), "name a file for one of --csv and --json").into());
    }
    if args.every.is_some() && args.csv.is_none() && args.json.is_none() {
        let what = "--every says how often joint values are written, and nothing writes them";
        return Err(ConfigError::plain(what.to_owned(), "add --csv FILE or --json FILE").into());
    }
    for file in files.into_iter().flatten() {
        may_write(file, args.force)?;
    }
    let scene = scene(&args.robot, None)?;
    let robot = robot(&scene)?;
    let mut file = load_for(&args.map, robot)?;
    let only_free = file.certified.is_some() && !args.optimistic;
    if only_free {
        file.edges.retain(|e| e.verdict == Some(StoredVerdict::Free));
    }
    let map = Roadmap::of_file(&file, robot).map_err(|e| ConfigError::plain(e.what, e.help))?;
    let from = vertex(&map, &args.from)?;
    let to = vertex(&map, &args.to)?;
    let Some(path) = map.plan(from, to) else {
        let edges = if only_free { "edges that are certified free" } else { "edges that were not removed" };
        let name = |id: u32| called(&map, id);
        // if standard output receives data, nothing else may go there
        let text = format!("no path leads from {} to {} over {edges}", name(from), name(to));
        if to_terminal > 0 {
            eprintln!("{text}")
        } else {
            println!("{text}")
        }
        return Ok(ExitCode::FAILURE);
    };
    let speeds = Speeds { share: args.speed, unstated_deg_per_s: args.max_speed };
    let mut trajectory = Trajectory::new(&map, &path, robot, speeds);
    if to_terminal == 0 {
        let time = format!("{:.2} s at {} of the maximum speeds\n", trajectory.duration_s(), args.speed);
        terminal::out(&(text(&file, &path) + &time));
    }
    if let Some(every) = args.every {
        trajectory = trajectory.sampled(every)?;
    }
    for (file, table) in [(&args.csv, trajectory.csv()), (&args.json, trajectory.json())] {
        match file.as_deref() {
            Some(file) if file == Path::new("-") => terminal::out(&table),
            Some(file) => save_text(file, &table)?,
            None => {}
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// A vertex by its name, or by its number if it has none.
fn called(map: &Roadmap, id: u32) -> String {
    map.vertex(id).and_then(|v| v.name.clone()).unwrap_or_else(|| id.to_string())
}

fn vertex(map: &Roadmap, name: &str) -> Result<u32, ConfigError> {
    let what = || format!("there is no vertex {name:?}");
    let help = || format!("give a name, or a number below {}", map.len());
    map.find(name).ok_or_else(|| ConfigError::plain(what(), help()))
}

/// The path, one vertex per line.
fn text(file: &MapFile, path: &[u32]) -> String {
    let mut out = String::new();
    for id in path {
        let Some(v) = file.vertices.get(*id as usize) else { continue };
        let [x, y, z] = v.at_m;
        let name = v.name.as_ref().map_or(String::new(), |n| format!(" {n}"));
        let _ = writeln!(out, "{id}{name}  hand at {x:.3} {y:.3} {z:.3}");
    }
    let legs = path.windows(2);
    let at = |id: u32| file.vertices.get(id as usize).map_or([0.0; 3], |v| v.at_m);
    let far = |leg: &[u32]| {
        let a = at(leg[0]);
        let b = at(leg[1]);
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let hand: f64 = legs.clone().map(far).sum();
    let _ = writeln!(out, "{} edges; the hand goes {:.2} m from vertex to vertex", legs.count(), hand);
    out
}
