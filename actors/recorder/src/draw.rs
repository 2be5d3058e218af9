//! The roadmap in three drawings: in the world at the hand's positions, flat as in figure 4 of the paper, and
//! as a graph.

use crate::palette;
use crate::roadmap::{DrawnRoadmap, DrawnVertex, RoadmapChanges};
use crate::stream::{EntityStream, Written};
use mobee_contract::{EdgeState, Time};
use rerun::{GraphEdges, GraphNodes, LineStrips2D, LineStrips3D, Points2D, Points3D, Radius, Scalars, SeriesLines};
use std::collections::BTreeMap;
use std::time::Duration;

/// Edge states as layers, the lower ones first, with line widths in the world (meters) and in the flat drawing
/// (its units).
const LAYERS: [(EdgeState, &str, f32, f32); 5] = [
    (EdgeState::Removed, "removed", 0.0008, 1.2),
    (EdgeState::Optimistic, "untried", 0.0006, 0.9),
    (EdgeState::Doubtful, "doubtful", 0.0008, 1.5),
    (EdgeState::Blocked, "blocked", 0.0010, 1.8),
    (EdgeState::Feasible, "feasible", 0.0022, 3.5),
];
/// Most vertices whose numbers are shown in the world.
const LABELED: usize = 30;
/// Number of dashes of a removed edge.
const DASHES: usize = 5;
/// Data rate of a growing drawing, bytes per simulated second; a larger map is drawn less often.
const BYTES_PER_SECOND: f64 = 6000.0;

/// Drawings of one robot's roadmap.
pub(crate) struct Drawing {
    /// Name of the robot as a part of entity paths.
    name: String,
    /// The lines that are shown, by layer.
    shown: BTreeMap<EdgeState, Vec<(u32, u32)>>,
    /// Time before which no edges are drawn.
    not_before: Time,
}

impl Drawing {
    /// Writes the names of the counters of a robot's map.
    ///
    /// # Errors
    /// If Rerun refuses the data, as a message.
    pub(crate) fn new(stream: &EntityStream, name: &str) -> Result<Drawing, String> {
        let lines = SeriesLines::new()
            .with_names(["feasible edges", "untried edges", "removed edges", "vertices"])
            .with_colors([0x35D07FFFu32, 0x8A93A5FF, 0xD8605AFF, 0xE8ECF4FF])
            .with_widths([3.0, 2.0, 2.0, 1.0]);
        stream.log_static(&format!("progress/{name}/map"), &lines)?;
        Ok(Drawing { name: name.to_owned(), shown: BTreeMap::new(), not_before: Time::ZERO })
    }

    /// Draws the changes. Edges of a large map are delayed, unless this is the last drawing.
    pub(crate) fn draw(&mut self, stream: &EntityStream, at: Time, map: &mut DrawnRoadmap, last: bool) -> Written {
        let RoadmapChanges { vertices, edges, plan } = map.changed;
        if vertices {
            self.vertices(stream, map)?;
            map.changed.vertices = false;
        }
        if edges && (last || at >= self.not_before) {
            let bytes = self.edges(stream, map)?;
            self.not_before = at + Duration::from_secs_f64(bytes / BYTES_PER_SECOND);
            map.changed.edges = false;
        }
        if plan {
            self.plan(stream, map)?;
            map.changed.plan = false;
        }
        Ok(())
    }

    fn vertices(&self, stream: &EntityStream, map: &DrawnRoadmap) -> Written {
        let name = &self.name;
        let ids = map.vertices.keys().map(u32::to_string);
        let labels: Vec<_> = map.vertices.keys().map(|id| map.label(*id)).collect();
        let solid: Vec<_> = map.vertices.values().map(|v| v.at).collect();
        let flat: Vec<_> = map.vertices.values().map(|v| v.flat).collect();
        // Labels in the world cover the robot: only names, and the numbers of a small map, are shown.
        let shows = map.has_names() || labels.len() <= LABELED;
        let points = Points3D::new(solid)
            .with_colors([palette::VERTEX])
            .with_radii([0.007])
            .with_labels(labels.clone())
            .with_show_labels(shows);
        stream.log(&format!("world/roadmap/{name}/vertices"), &points)?;
        let points = Points2D::new(flat.clone())
            .with_colors([palette::VERTEX])
            .with_radii([Radius::new_scene_units(9.0)])
            .with_labels(labels.clone())
            .with_show_labels(true)
            .with_draw_order(30.0);
        stream.log(&format!("roadmap/{name}/vertices"), &points)?;
        // A graph view has edges only between nodes of one entity.
        let nodes = GraphNodes::new(ids).with_positions(flat).with_labels(labels);
        stream.log(&format!("graph/{name}/map"), &nodes.with_colors([palette::VERTEX]))
    }

    /// Draws the layers that changed, and returns their size in bytes.
    fn edges(&mut self, stream: &EntityStream, map: &DrawnRoadmap) -> Result<f64, String> {
        let name = &self.name;
        let mut layers: BTreeMap<EdgeState, Vec<(u32, u32)>> = BTreeMap::new();
        for (line, state) in map.lines() {
            layers.entry(state).or_default().push(line);
        }
        let mut bytes = 0.0;
        for (order, (state, word, width, flat_width)) in LAYERS.into_iter().enumerate() {
            let lines = layers.remove(&state).unwrap_or_default();
            if self.shown.get(&state).is_some_and(|shown| *shown == lines) {
                continue;
            }
            let ends: Vec<_> = lines.iter().filter_map(|(a, b)| Some((end(map, *a)?, end(map, *b)?))).collect();
            let pieces = if state == EdgeState::Removed { DASHES } else { 1 };
            bytes += (ends.len() * pieces * 40) as f64;
            let solid = ends.iter().flat_map(|(a, b)| dashes(a.at, b.at, pieces));
            let strips = LineStrips3D::new(solid).with_colors([palette::edge(state)]).with_radii([width]);
            stream.log(&format!("world/roadmap/{name}/{word}"), &strips)?;
            let flat = ends.iter().flat_map(|(a, b)| dashes(a.flat, b.flat, pieces));
            let strips = LineStrips2D::new(flat)
                .with_colors([palette::edge(state)])
                .with_radii([Radius::new_scene_units(flat_width)])
                .with_draw_order(order as f32);
            stream.log(&format!("roadmap/{name}/{word}"), &strips)?;
            if state == EdgeState::Feasible {
                let pairs = lines.iter().map(|(a, b)| (a.to_string(), b.to_string()));
                stream.log(&format!("graph/{name}/map"), &GraphEdges::new(pairs))?;
            }
            self.shown.insert(state, lines);
        }
        let counts = [EdgeState::Feasible, EdgeState::Optimistic, EdgeState::Removed].map(|s| map.count(s) as f64);
        let untried = counts[1] + map.count(EdgeState::Doubtful) as f64;
        let counts = [counts[0], untried, counts[2], map.vertices.len() as f64];
        stream.log(&format!("progress/{name}/map"), &Scalars::new(counts))?;
        Ok(bytes)
    }

    fn plan(&self, stream: &EntityStream, map: &DrawnRoadmap) -> Written {
        let name = &self.name;
        let stops: Vec<_> = map.plan.iter().filter_map(|v| end(map, *v)).collect();
        let solid: Vec<_> = stops.iter().map(|v| v.at).collect();
        let flat: Vec<_> = stops.iter().map(|v| v.flat).collect();
        let goal = stops.last();
        let strips = LineStrips3D::new([solid]).with_colors([palette::PLAN]).with_radii([0.0035]);
        stream.log(&format!("world/roadmap/{name}/plan"), &strips)?;
        let goals = Points3D::new(goal.map(|v| v.at)).with_colors([palette::PLAN]).with_radii([0.012]);
        stream.log(&format!("world/roadmap/{name}/goal"), &goals)?;
        let strips = LineStrips2D::new([flat])
            .with_colors([palette::PLAN])
            .with_radii([Radius::new_scene_units(6.0)])
            .with_draw_order(20.0);
        stream.log(&format!("roadmap/{name}/plan"), &strips)?;
        let goals = Points2D::new(goal.map(|v| v.flat))
            .with_colors([palette::PLAN])
            .with_radii([Radius::new_scene_units(15.0)])
            .with_draw_order(25.0);
        stream.log(&format!("roadmap/{name}/goal"), &goals)
    }
}

fn end(map: &DrawnRoadmap, vertex: u32) -> Option<DrawnVertex> {
    map.vertices.get(&vertex).copied()
}

/// A line as a number of dashes with gaps of equal length.
fn dashes<const N: usize>(a: [f32; N], b: [f32; N], pieces: usize) -> impl Iterator<Item = [[f32; N]; 2]> {
    let parts = (2 * pieces - 1) as f32;
    let at = move |share: f32| {
        let mut p = a;
        for (p, b) in p.iter_mut().zip(b) {
            *p += share * (b - *p);
        }
        p
    };
    (0..pieces).map(move |i| [at(2.0 * i as f32 / parts), at((2.0 * i as f32 + 1.0) / parts)])
}
