//! Lines over time and in space: plots of motor positions, and trails of markers.

use crate::body::entity;
use crate::palette;
use crate::shapes::vec3;
use crate::stream::{EntityStream, Written, in_words};
use mobee_contract::Time;
use mobee_model::{Marker, Motor, Robot};
use nalgebra::Isometry3;
use rerun::{LineStrips3D, Scalars, SeriesLines};

/// Change of a motor's position after which it is plotted again, rad (0.05 degrees).
const STEP: f64 = 0.05 * std::f64::consts::PI / 180.0;
/// Distance of a motor from its first position beyond which its part counts as moving, rad (one degree).
const BEGINS: f64 = 20.0 * STEP;
/// Longest interval between the plotted points of a resting part, ns.
const MAX_INTERVAL_NS: i64 = 1_000_000_000;
/// Distance after which a trail continues, meters.
const TRAIL_STEP: f32 = 0.001;

/// Plots and trails of a robot with the data that is still to be sent.
pub(crate) struct Traces {
    parts: Vec<PartPlot>,
    trails: Vec<Trail>,
    /// `world_from_robot`.
    base: Isometry3<f64>,
    /// `world_from_node` of every node, as a reused buffer.
    frames: Vec<Isometry3<f64>>,
}

/// The plot of a part: one line per motor, degrees.
struct PartPlot {
    path: String,
    /// Index into the robot's parts.
    part: usize,
    motors: std::ops::Range<usize>,
    times: Vec<i64>,
    /// Row by row, one value per motor, degrees.
    degrees: Vec<f64>,
    written: Option<(i64, Vec<f64>)>,
    /// The newest skipped configuration; written when motion resumes, because the line would slope otherwise.
    held: Option<(i64, Vec<f64>)>,
    /// The first configuration.
    first: Option<Vec<f64>>,
    /// True if the part has left it.
    moves: bool,
}

struct Trail {
    path: String,
    /// Index into the robot's parts.
    part: usize,
    node: usize,
    last: Option<[f32; 3]>,
    times: Vec<i64>,
    pieces: Vec<[[f32; 3]; 2]>,
}

impl Traces {
    /// Writes the names of the lines.
    ///
    /// # Errors
    /// If Rerun refuses the data, as a message.
    pub(crate) fn new(stream: &EntityStream, robot: &Robot, base: &Isometry3<f64>) -> Result<Traces, String> {
        let name = entity(&robot.name);
        let mut parts = Vec::new();
        for (i, part) in robot.parts.iter().enumerate().filter(|(_, p)| !p.motors.is_empty()) {
            let path = format!("joints/{name}/{}", entity(&part.name));
            let motors = part.motors.clone().filter_map(|m| robot.motors.get(m));
            let name_of = |m: &Motor| if m.motion.is_turn() { m.name.clone() } else { format!("{} (mm)", m.name) };
            let names: Vec<_> = motors.map(name_of).collect();
            let colors = (0..names.len()).map(palette::series);
            stream.log_static(&path, &SeriesLines::new().with_names(names).with_colors(colors))?;
            let motors = part.motors.clone();
            parts.push(PartPlot {
                path,
                part: i,
                motors,
                times: vec![],
                degrees: vec![],
                written: None,
                held: None,
                first: None,
                moves: false,
            });
        }
        let mut trails = Vec::new();
        for (i, marker) in trail_markers(robot).into_iter().enumerate() {
            let path = format!("world/trails/{name}/{}", entity(&marker.name));
            let look = LineStrips3D::update_fields().with_colors([palette::trail(i)]).with_radii([0.003]);
            stream.log_static(&path, &look)?;
            trails.push(Trail {
                path,
                part: marker.part,
                node: marker.node,
                last: None,
                times: vec![],
                pieces: vec![],
            });
        }
        Ok(Traces { parts, trails, base: *base, frames: Vec::new() })
    }

    /// Plotted parts, those with a trail first: names as parts of entity paths, and whether the part has moved.
    pub(crate) fn parts(&self) -> Vec<(String, bool)> {
        let mut parts: Vec<_> = self.parts.iter().collect();
        parts.sort_by_key(|p| self.trails.iter().all(|t| t.part != p.part));
        let name = |p: &PartPlot| p.path.rsplit('/').next().map(|name| (name.to_owned(), p.moves));
        parts.into_iter().filter_map(name).collect()
    }

    /// Entities of the trails.
    pub(crate) fn trails(&self) -> Vec<String> {
        self.trails.iter().map(|t| t.path.clone()).collect()
    }

    /// Takes a configuration; returns true if a part moves for the first time.
    pub(crate) fn pose(&mut self, at: Time, robot: &Robot, q: &[f64]) -> bool {
        let at = at.0 as i64;
        let mut begins = false;
        for plot in &mut self.parts {
            if let Some(q) = q.get(plot.motors.clone()) {
                plot.pose(at, q);
                begins |= plot.begins(q);
            }
        }
        robot.forward_from(&self.base, q, &mut self.frames);
        for trail in &mut self.trails {
            if let Some(frame) = self.frames.get(trail.node) {
                trail.place(at, vec3(&frame.translation.vector));
            }
        }
        begins
    }

    /// Sends the buffered data.
    pub(crate) fn flush(&mut self, stream: &EntityStream) -> Written {
        for plot in &mut self.parts {
            let times = std::mem::take(&mut plot.times);
            if times.is_empty() {
                continue;
            }
            let values = Scalars::new(std::mem::take(&mut plot.degrees));
            let lengths = std::iter::repeat_n(plot.motors.len(), times.len());
            let columns = values.columns(lengths).map_err(|e| in_words(&plot.path, &e))?;
            stream.columns(&plot.path, &times, columns)?;
        }
        for trail in &mut self.trails {
            let times = std::mem::take(&mut trail.times);
            if times.is_empty() {
                continue;
            }
            let strips = LineStrips3D::update_fields().with_strips(std::mem::take(&mut trail.pieces));
            let columns = strips.columns_of_unit_batches().map_err(|e| in_words(&trail.path, &e))?;
            stream.columns(&trail.path, &times, columns)?;
        }
        Ok(())
    }
}

impl PartPlot {
    /// Returns true if the part leaves its first configuration now.
    fn begins(&mut self, q: &[f64]) -> bool {
        if self.moves {
            return false;
        }
        let first = self.first.get_or_insert_with(|| q.to_vec());
        self.moves = first.iter().zip(q).any(|(a, b)| (a - b).abs() > BEGINS);
        self.moves
    }

    fn pose(&mut self, at: i64, q: &[f64]) {
        let moved = |last: &[f64]| last.iter().zip(q).any(|(a, b)| (a - b).abs() > STEP);
        match &self.written {
            Some((then, last)) if !moved(last) && at - then < MAX_INTERVAL_NS => self.held = Some((at, q.to_vec())),
            Some((_, last)) => {
                let resumes = moved(last);
                if let Some((then, q)) = self.held.take().filter(|_| resumes) {
                    self.push(then, &q);
                }
                self.write(at, q);
            }
            None => self.write(at, q),
        }
    }

    fn write(&mut self, at: i64, q: &[f64]) {
        self.push(at, q);
        self.written = Some((at, q.to_vec()));
        self.held = None;
    }

    fn push(&mut self, at: i64, q: &[f64]) {
        self.times.push(at);
        self.degrees.extend(q.iter().map(|v| v.to_degrees()));
    }
}

impl Trail {
    fn place(&mut self, at: i64, here: [f32; 3]) {
        let Some(last) = self.last else {
            self.last = Some(here);
            return;
        };
        let way: f32 = last.iter().zip(&here).map(|(a, b)| (a - b) * (a - b)).sum();
        if way > TRAIL_STEP * TRAIL_STEP {
            self.times.push(at);
            self.pieces.push([last, here]);
            self.last = Some(here);
        }
    }
}

/// Markers whose trails are shown, at most one per part: hands and tools; otherwise those whose file entry
/// requests a tracer; otherwise all.
pub(crate) fn trail_markers(robot: &Robot) -> Vec<&Marker> {
    let pick = |f: &dyn Fn(&Marker) -> bool| -> Vec<&Marker> {
        let mut picked: Vec<&Marker> = Vec::new();
        for marker in robot.markers.iter().filter(|m| f(m)) {
            if picked.iter().all(|other| other.part != marker.part) {
                picked.push(marker);
            }
        }
        picked
    };
    let hands = |name: &str| ["hand", "palm", "tool", "gripper"].iter().any(|word| name.contains(word));
    let shown = pick(&|m| hands(&m.name.to_lowercase()));
    let shown = if shown.is_empty() { pick(&|m| m.tracer > 0) } else { shown };
    if shown.is_empty() { pick(&|_| true) } else { shown }
}
