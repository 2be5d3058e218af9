//! `mobee roadmap view`: a map as a recording, as in the paper's figure 7.

use super::{PlaceArgs, load_for, may_write, robot};
use crate::view::{self, recording_settings};
use miette::{IntoDiagnostic, Report, WrapErr, miette};
use mobee_planning::map_file::MapFile;
use mobee_recorder::{MapLines, MapView, view_map};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Arguments of `mobee roadmap view`.
#[derive(clap::Args, Clone, Debug)]
pub struct ViewMapArgs {
    /// The map.
    map: PathBuf,
    #[command(flatten)]
    place: PlaceArgs,
    /// Write the recording into this file, and open no viewer.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace the recording if it exists.
    #[arg(long, requires = "out")]
    force: bool,
}

/// Writes the recording, and opens it unless a file for it was named.
///
/// # Errors
/// If a file can't be read or written, the map is of another robot, or there is no viewer.
pub fn command(args: &ViewMapArgs) -> Result<String, Report> {
    let scene = args.place.scene()?;
    let map = load_for(&args.map, robot(&scene)?)?;
    let out = match &args.out {
        Some(out) => {
            may_write(out, args.force)?;
            out.clone()
        }
        None => {
            let dir = tempfile::Builder::new().prefix("mobee-").tempdir().into_diagnostic();
            let dir = dir.wrap_err("can't make a folder for the recording; name a file for it with --out FILE")?;
            dir.keep().join("roadmap.rrd")
        }
    };
    let settings = recording_settings(&out, &map.robot, &args.map);
    let vertices: Vec<[f64; 3]> = map.vertices.iter().map(|v| v.at_m).collect();
    let poses: Vec<&[f64]> = map.vertices.iter().map(|v| v.q_rad.as_slice()).collect();
    let lines = lines(&map);
    let names: Vec<Option<&str>> = map.vertices.iter().map(|v| v.name.as_deref()).collect();
    let view = MapView { scene: &scene, vertices: &vertices, poses: &poses, names: &names, lines: &lines };
    view_map(&settings, &view).map_err(|why| miette!("{}: {why}", args.map.display()))?;
    Ok(match args.out {
        Some(_) => format!("now: mobee view {}\n", crate::terminal::shell_word(&out)),
        None => format!("{}\n", view::open(&out)?),
    })
}

/// Undirected edges by obstacle, free ones first. A line is blocked if one of its directions is.
fn lines(map: &MapFile) -> Vec<MapLines> {
    let mut worst: BTreeMap<(u32, u32), Option<&str>> = BTreeMap::new();
    for e in &map.edges {
        let by = e.verdict.as_ref().and_then(|v| v.blocked_by());
        let slot = worst.entry((e.from.min(e.to), e.from.max(e.to))).or_default();
        *slot = slot.or(by);
    }
    let mut groups: BTreeMap<Option<&str>, Vec<(u32, u32)>> = BTreeMap::new();
    for (line, by) in worst {
        groups.entry(by).or_default().push(line);
    }
    let free = if map.certified.is_some() { "free" } else { "not certified" };
    let group = |(by, edges): (Option<&str>, Vec<(u32, u32)>)| MapLines {
        name: match by {
            None => free.to_owned(),
            Some("uncertified") => "uncertified: counts as blocked".to_owned(),
            Some(by) => format!("blocked by {by}"),
        },
        blocked: by.is_some(),
        edges,
    };
    groups.into_iter().map(group).collect()
}
