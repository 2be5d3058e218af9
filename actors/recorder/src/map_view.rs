//! A roadmap as a recording, as in the paper's figure 7: the map grows vertex by vertex, and its edges follow,
//! each group in its own color.

use crate::blueprint::send_map;
use crate::body::{Appearance, RobotEntities, entity};
use crate::front::Front;
use crate::objects::Objects;
use crate::palette;
use crate::recording::{Recording, Settings};
use crate::stream::{EntityStream, Written};
use mobee_contract::Time;
use mobee_model::Scene;
use rerun::{LineStrips3D, Points3D, TextDocument};
use std::fmt::Write;
use std::time::Duration;

/// Longest time for the disk to write the rest.
const WRITE_TIMEOUT: Duration = Duration::from_secs(60);
/// Number of steps in which the map grows, and the duration of its growth, s.
const GROWTH: (usize, f64) = (60, 12.0);
/// Number of parts in which the edges follow the vertices that they join.
const PARTS: usize = 10;
/// Most vertices of a map that are all labeled, with their numbers if they have no names.
const LABELED: usize = 50;
/// Legend of the recording.
const LEGEND: &str = "Each point is a pose of the map: the place of the hand at it. Lines join the hand's places at the \
                      two ends of an edge; what the hand does between them is not drawn.";

/// Edges with a common appearance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MapLines {
    /// Name of the group, such as `blocked by table`.
    pub name: String,
    /// True if an object blocks them.
    pub blocked: bool,
    /// Numbers of the two vertices of each edge.
    pub edges: Vec<(u32, u32)>,
}

/// Content of the recording.
#[derive(Clone, Copy, Debug)]
pub struct MapView<'a> {
    /// The robot, the first of the scene, and the objects around it.
    pub scene: &'a Scene,
    /// Position of the hand at each vertex, meters.
    pub vertices: &'a [[f64; 3]],
    /// Configuration of the whole robot at each vertex, rad of encoder.
    pub poses: &'a [&'a [f64]],
    /// Name of each vertex that has one.
    pub names: &'a [Option<&'a str>],
    /// The edges, in the order in which they are drawn, the last ones on top.
    pub lines: &'a [MapLines],
}

/// Writes the recording.
///
/// # Errors
/// As a message, if the file can't be written.
pub fn view_map(settings: &Settings, view: &MapView<'_>) -> Result<(), String> {
    let recording = Recording::begin(settings).map_err(|e| e.to_string())?;
    let stream = recording.stream(String::new(), LEGEND)?;
    let mut front = Front::of(view.scene);
    if let Some((low, high)) = extent(view.vertices) {
        front.include(low, high);
    }
    send_map(&stream.rec, &front)?;
    stream.at(Time::ZERO);
    Objects::default().update(&stream, view.scene)?;
    if let Some(robot) = view.scene.robots().first() {
        let mut body = RobotEntities::new(&stream, robot, &view.scene.base(0), 0, &Appearance::RUN)?;
        body.pose(Time::ZERO, robot, &robot.home());
        for (at, count) in steps(view.vertices.len()) {
            if let Some(q) = view.poses.get(count.saturating_sub(1)) {
                body.pose(at, robot, q);
            }
        }
        body.flush(&stream)?;
    }
    grow(&stream, view)?;
    lines(&stream, view)?;
    recording.reach(WRITE_TIMEOUT)?;
    recording.check()
}

/// Lowest and highest corner of the box around the vertices.
fn extent(vertices: &[[f64; 3]]) -> Option<([f32; 3], [f32; 3])> {
    let all = vertices.iter().filter(|v| v.iter().all(|x| x.is_finite())).map(|v| v.map(|x| x as f32));
    let pick = |f: fn(f32, f32) -> f32, a: [f32; 3], b: [f32; 3]| std::array::from_fn(|i| f(a[i], b[i]));
    let box_of = all.map(|v| (v, v));
    box_of.reduce(|(low, high), (a, b)| (pick(f32::min, low, a), pick(f32::max, high, b)))
}

/// Time and number of vertices of each step.
fn steps(vertices: usize) -> impl Iterator<Item = (Time, usize)> {
    let (steps, secs) = GROWTH;
    (1..=steps).map(move |i| (Time::from_secs(secs * i as f64 / steps as f64), vertices * i / steps))
}

fn grow(stream: &EntityStream, view: &MapView<'_>) -> Written {
    let points: Vec<[f32; 3]> = view.vertices.iter().map(|v| v.map(|x| x as f32)).collect();
    for (at, count) in steps(points.len()) {
        stream.at(at);
        let shown = points.iter().take(count).copied();
        stream.log("world/map/poses", &Points3D::new(shown).with_colors([palette::VERTEX]).with_radii([0.0025]))?;
    }
    // Vertices with names, or all of a small map: thousands of numbers would hide everything.
    let label = |id: usize| match view.names.get(id).copied().flatten() {
        Some(name) => Some(name.to_owned()),
        None => (points.len() <= LABELED).then(|| id.to_string()),
    };
    let labeled: Vec<_> = points.iter().enumerate().filter_map(|(id, at)| Some((*at, label(id)?))).collect();
    if !labeled.is_empty() {
        let (places, labels): (Vec<_>, Vec<_>) = labeled.into_iter().unzip();
        let names = Points3D::new(places).with_labels(labels).with_show_labels(true);
        stream.log("world/map/names", &names.with_colors([palette::VERTEX]).with_radii([0.004]))?;
    }
    Ok(())
}

fn lines(stream: &EntityStream, view: &MapView<'_>) -> Written {
    let mut words = String::from("| edges | |\n|---|---|\n");
    let mut blocked = 0;
    let at = |id: u32| view.vertices.get(id as usize).map(|v| v.map(|x| x as f32));
    // Part of the map's growth in which both ends exist.
    let part = |(a, b): &(u32, u32)| PARTS * (*a).max(*b) as usize / view.vertices.len().max(1);
    for group in view.lines {
        let color = if group.blocked { palette::blocker(blocked) } else { palette::UNBLOCKED };
        blocked += usize::from(group.blocked);
        for i in 0..PARTS {
            let ends = group.edges.iter().filter(|e| part(e) == i).filter_map(|(a, b)| Some([at(*a)?, at(*b)?]));
            let strips = LineStrips3D::new(ends).with_colors([color]).with_radii([0.0007]);
            stream.at(Time::from_secs(GROWTH.1 * (i + 1) as f64 / PARTS as f64));
            stream.log(&format!("world/map/{}/{i}", entity(&group.name)), &strips)?;
        }
        let _ = writeln!(words, "| {} | {} |", group.name, group.edges.len());
    }
    stream.log_static("edges", &TextDocument::from_markdown(words))
}
