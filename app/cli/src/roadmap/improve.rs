//! `mobee roadmap improve`: joins unreachable parts of a map to the rest, grows it where it is sparse, and prunes parts
//! that stay apart.

use super::certified::CertifiedArgs;
use super::robot;
use crate::robot_import::Steps;
use miette::{Report, miette};
use mobee_model::{Robot, Scene};
use mobee_planning::map_file::MapFile;
use mobee_planning::planners::{JointSpace, RrtConnect};
use mobee_planning::roadmap::Roadmap;
use mobee_planning::roadmap::join::JoinSettings;
use std::fmt::Write;

/// Maximum number of poses to add at once: a typing error must not exhaust the memory.
const MAX_GROWN: i64 = 100_000;

/// Arguments of `mobee roadmap improve`.
#[derive(clap::Args, Clone, Debug)]
pub struct ImproveArgs {
    #[command(flatten)]
    of: CertifiedArgs,
    /// Number of pairs of vertices between which a path to each part is planned.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..))]
    pairs: u16,
    /// Maximum number of straight lines that one plan checks.
    #[arg(long, value_name = "N", default_value_t = 5000, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    budget: u64,
    /// Also add this number of free poses where vertices are far apart.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=MAX_GROWN))]
    grow: u32,
    /// Number of nearest vertices to which an added pose is joined.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..=1000))]
    neighbors: u16,
    /// Then remove vertices that can't be reached or left, unless they have a name. Vertices are renumbered.
    #[arg(long)]
    prune: bool,
    /// Seed of all randomness.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Certifies the map, joins, grows and prunes it, and stores it with the obstacles of its edges.
///
/// # Errors
/// If a file can't be read or written, the map is of another robot, or it is empty.
pub fn command(args: &ImproveArgs) -> Result<String, Report> {
    let (scene, mut file) = args.of.load()?;
    if file.vertices.is_empty() {
        return Err(miette!(help = "build one with `mobee roadmap build`", "{} has no poses", args.of.map.display()));
    }
    let bar = Steps::new();
    args.of.certify(&mut file, &scene, &bar)?;
    let settings = ImproveSettings {
        join: JoinSettings { pairs: usize::from(args.pairs), budget: args.budget, seed: args.seed },
        grow: args.grow as usize,
        neighbors: usize::from(args.neighbors),
        prune: args.prune,
    };
    let show = &mut |step, share| bar.show_step(step, share);
    let (mut better, report) = improve(&file, &scene, args.of.clearance(), settings, show)?;
    args.of.certify(&mut better, &scene, &bar)?;
    drop(bar);
    Ok(report + &args.of.save(&better, &scene)?)
}

/// What is done to a map.
#[derive(Clone, Copy, Debug)]
pub struct ImproveSettings {
    /// Bounds on joining its parts.
    pub join: JoinSettings,
    /// Number of poses to add where it is thin.
    pub grow: usize,
    /// Number of vertices that an added pose is joined to.
    pub neighbors: usize,
    /// Remove vertices that can't be reached or left, unless they have a name.
    pub prune: bool,
}

/// Joins, grows and prunes a map that is certified in this scene; returns it without certificates, and a report.
///
/// # Arguments
/// * `scene`: the map's robot, alone, in the world.
/// * `clearance`: of new edges, meters.
/// * `show`: called with the step and the share of it that is done.
///
/// # Errors
/// A map without poses or of another robot, or a scene that can't be compiled.
pub fn improve(
    file: &MapFile,
    scene: &Scene,
    clearance: f64,
    settings: ImproveSettings,
    show: &mut dyn FnMut(&'static str, f64),
) -> Result<(MapFile, String), Report> {
    let ImproveSettings { join, grow, neighbors, prune } = settings;
    let robot = robot(scene)?;
    let Some(rest) = file.vertices.first().map(|v| v.q_rad.clone().into()) else {
        return Err(miette!(help = "build one with `mobee roadmap build`", "the map has no poses"));
    };
    let mut map = over_free_edges(file, robot)?;
    let hand = marker(file, robot, &map);
    let shown = |q: &[f64]| at(scene, hand, q);
    let space = JointSpace::new(scene, 0, &[&rest], map.motors(), &[], clearance);
    let mut space = space.map_err(|e| miette!("{e}"))?;
    show("joins parts", 0.0);
    let joined = map
        .join_islands(&mut space, &RrtConnect::default(), join, &rest, &shown, &mut |share| show("joins parts", share));
    let (before, after) = joined.islands;
    let mut report = format!(
        "parts of the map: {before}, now {after}; joined by {} more vertices and {} edges; {} failed plans, {} lines checked\n",
        joined.vertices, joined.edges, joined.in_vain, joined.evaluations
    );
    if grow > 0 {
        show("grows", 0.0);
        let grown = map.grow(&mut space, (grow, neighbors, join.seed), &rest, &shown);
        let _ = writeln!(report, "poses added where the map was thin: {grown}");
    }
    if prune {
        let pruned = map.pruned();
        let _ = writeln!(report, "left out: {} vertices", map.len() - pruned.map.len());
        map = pruned.map;
    }
    Ok((map.file(robot), report))
}

/// The map, without the edges that are not certified free.
fn over_free_edges(file: &MapFile, robot: &Robot) -> Result<Roadmap, Report> {
    let mut map = Roadmap::of_file(file, robot).map_err(|e| miette!(help = e.help, "{}", e.what))?;
    for edge in &file.edges {
        if let Some(by) = edge.verdict.as_ref().and_then(|v| v.blocked_by()) {
            map.block(edge.from, edge.to, Some(by.to_owned()));
        }
    }
    Ok(map)
}

/// The node of the hand's marker: the map's, or that of the marker which most of the map's motors move.
fn marker(file: &MapFile, robot: &Robot, map: &Roadmap) -> Option<usize> {
    let named = robot.markers.iter().find(|m| Some(&m.name) == file.hand.as_ref());
    let moved = || mobee_planning::group::hand(robot, map.motors()).and_then(|i| robot.markers.get(i));
    named.or_else(moved).map(|m| m.node)
}

/// The hand's position at a configuration, in the world, meters.
fn at(scene: &Scene, hand: Option<usize>, q: &[f64]) -> [f64; 3] {
    let frames = scene.node_transforms(&[q]);
    let frame = hand.and_then(|node| frames.first()?.get(node).copied());
    let p = frame.unwrap_or_else(|| scene.base(0)).translation.vector;
    [p.x, p.y, p.z]
}
