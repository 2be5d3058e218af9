//! `mobee roadmap path`: a plan on a map.

use super::{load_for, robot, scene};
use crate::config::ConfigError;
use crate::terminal;
use miette::Report;
use mobee_behaviors::map_file::{MapFile, StoredVerdict};
use mobee_behaviors::roadmap::Roadmap;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// From where to where.
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
}

/// Plans, and prints the path.
///
/// # Errors
/// If a file can't be read, the map is of another robot, or there is no such vertex.
pub fn command(args: &PathArgs) -> Result<ExitCode, Report> {
    let scene = scene(&args.robot, None)?;
    let robot = robot(&scene)?;
    let mut file = load_for(&args.map, robot)?;
    let only_free = file.certified.is_some() && !args.optimistic;
    if only_free {
        file.edges.retain(|e| e.verdict == Some(StoredVerdict::Free));
    }
    let map = Roadmap::of_file(&file, robot).map_err(|e| ConfigError::plain(e.what, e.help))?;
    let (from, to) = (vertex(&map, &args.from)?, vertex(&map, &args.to)?);
    let Some(path) = map.plan(from, to) else {
        let edges = if only_free { "edges that are certified free" } else { "edges that were not removed" };
        terminal::out(&format!("no path leads from {} to {} over {edges}\n", args.from, args.to));
        return Ok(ExitCode::FAILURE);
    };
    terminal::out(&text(&file, &path));
    Ok(ExitCode::SUCCESS)
}

fn vertex(map: &Roadmap, name: &str) -> Result<u32, ConfigError> {
    let what = || format!("there is no vertex {name:?}");
    let help = || format!("give a name, or a number below {}", map.len());
    map.find(name).ok_or_else(|| ConfigError::plain(what(), help()))
}

/// The path, a vertex on a line.
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
        let (a, b) = (at(leg[0]), at(leg[1]));
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    let hand: f64 = legs.clone().map(far).sum();
    let _ = writeln!(out, "{} edges; the hand goes {:.2} m from vertex to vertex", legs.count(), hand);
    out
}
