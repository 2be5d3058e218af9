//! What leaves a line: motor positions over time, and the trails of markers in space.

use crate::body::entity;
use crate::palette;
use crate::shapes::vec3;
use crate::stream::{Stream, Written, in_words};
use mobee_contract::Time;
use mobee_model::{NodeKind, Robot};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rerun::{LineStrips3D, Scalars, SeriesLines};

/// A motor is plotted again when it changed by more than this, rad (0.05 degrees).
const STEP: f64 = 0.05 * std::f64::consts::PI / 180.0;
/// A resting part is plotted again after this time, ns.
const AT_LEAST: i64 = 1_000_000_000;
/// A trail goes on when its marker moved by more than this, metres.
const TRAIL_STEP: f32 = 0.001;
/// At most so many trails of one robot.
const MOST_TRAILS: usize = 8;

/// A robot's plots and trails with what waits to be sent.
pub(crate) struct Traces {
    parts: Vec<Plot>,
    trails: Vec<Trail>,
    kinematics: Chain,
}

/// The plot of a part: one line per motor, degrees.
struct Plot {
    path: String,
    motors: std::ops::Range<usize>,
    times: Vec<i64>,
    /// Row by row, one value per motor.
    degrees: Vec<f64>,
    written: Option<(i64, Vec<f64>)>,
    /// The newest pose that was not worth writing; written when motion goes on, else the line would slope.
    held: Option<(i64, Vec<f64>)>,
}

struct Trail {
    path: String,
    node: usize,
    last: Option<[f32; 3]>,
    times: Vec<i64>,
    pieces: Vec<[[f32; 3]; 2]>,
}

impl Traces {
    /// Names the lines.
    ///
    /// # Errors
    /// In words.
    pub(crate) fn new(stream: &Stream, robot: &Robot, base: &Isometry3<f64>) -> Result<Traces, String> {
        let name = entity(&robot.name);
        let mut parts = Vec::new();
        for part in robot.parts.iter().filter(|p| !p.motors.is_empty()) {
            let path = format!("joints/{name}/{}", entity(&part.name));
            let names: Vec<_> =
                part.motors.clone().filter_map(|m| robot.motors.get(m)).map(|m| m.name.clone()).collect();
            stream.log_static(&path, &SeriesLines::new().with_names(names))?;
            let motors = part.motors.clone();
            parts.push(Plot { path, motors, times: vec![], degrees: vec![], written: None, held: None });
        }
        let mut trails = Vec::new();
        for (i, m) in trail_markers(robot).into_iter().enumerate() {
            let Some(marker) = robot.markers.get(m) else { continue };
            let path = format!("trails/{name}/{}", entity(&marker.name));
            let look = LineStrips3D::update_fields().with_colors([palette::trail(i)]).with_radii([0.003]);
            stream.log_static(&format!("world/{path}"), &look)?;
            let path = format!("world/{path}");
            trails.push(Trail { path, node: marker.node, last: None, times: vec![], pieces: vec![] });
        }
        let kinematics = Chain::to(robot, base, trails.iter().map(|t| t.node));
        Ok(Traces { parts, trails, kinematics })
    }

    /// The parts that are plotted, as parts of entity paths.
    pub(crate) fn parts(&self) -> Vec<String> {
        self.parts.iter().filter_map(|p| p.path.rsplit('/').next()).map(str::to_owned).collect()
    }

    /// The entities of the trails.
    pub(crate) fn trails(&self) -> Vec<String> {
        self.trails.iter().map(|t| t.path.clone()).collect()
    }

    /// Takes note of a pose.
    pub(crate) fn pose(&mut self, at: Time, robot: &Robot, q: &[f64]) {
        let at = at.0 as i64;
        for plot in &mut self.parts {
            if let Some(q) = q.get(plot.motors.clone()) {
                plot.pose(at, q);
            }
        }
        self.kinematics.turn(robot, q);
        for trail in &mut self.trails {
            if let Some(here) = self.kinematics.place(trail.node) {
                trail.place(at, here);
            }
        }
    }

    /// Sends what waits.
    pub(crate) fn flush(&mut self, stream: &Stream) -> Written {
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

impl Plot {
    fn pose(&mut self, at: i64, q: &[f64]) {
        let moved = |last: &[f64]| last.iter().zip(q).any(|(a, b)| (a - b).abs() > STEP);
        match &self.written {
            Some((then, last)) if !moved(last) && at - then < AT_LEAST => self.held = Some((at, q.to_vec())),
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

/// The markers whose trails are shown: those whose file entry asks for a tracer, else hands and tools, else all.
pub(crate) fn trail_markers(robot: &Robot) -> Vec<usize> {
    let pick = |f: &dyn Fn(&mobee_model::Marker) -> bool| -> Vec<usize> {
        robot.markers.iter().enumerate().filter(|(_, m)| f(m)).map(|(i, _)| i).take(MOST_TRAILS).collect()
    };
    let hands = |name: &str| ["hand", "palm", "tool", "gripper"].iter().any(|word| name.contains(word));
    let traced = pick(&|m| m.tracer > 0);
    let traced = if traced.is_empty() { pick(&|m| hands(&m.name.to_lowercase())) } else { traced };
    if traced.is_empty() { pick(&|_| true) } else { traced }
}

/// Forward kinematics of a few nodes only.
pub(crate) struct Chain {
    /// The nodes asked for and all that carry them, in order.
    nodes: Vec<usize>,
    /// `world_from_node`, by node.
    frames: Vec<Isometry3<f64>>,
}

impl Chain {
    /// A chain that reaches these nodes; `base` is `world_from_robot`.
    pub(crate) fn to(robot: &Robot, base: &Isometry3<f64>, ends: impl Iterator<Item = usize>) -> Chain {
        let mut needed = vec![false; robot.nodes.len()];
        for end in ends {
            let mut next = Some(end);
            while let Some((n, node)) = next.and_then(|n| Some((n, robot.nodes.get(n)?))) {
                if let Some(slot) = needed.get_mut(n) {
                    *slot = true;
                }
                next = node.parent;
            }
        }
        let nodes = needed.iter().enumerate().filter(|(_, x)| **x).map(|(n, _)| n).collect();
        Chain { nodes, frames: vec![*base; robot.nodes.len()] }
    }

    /// Computes the frames at a pose.
    pub(crate) fn turn(&mut self, robot: &Robot, q: &[f64]) {
        for n in &self.nodes {
            let parent = robot.nodes.get(*n).and_then(|node| node.parent);
            let frame = parent.and_then(|p| Some(self.frames.get(p)? * motion(robot, p, q)?));
            if let (Some(slot), Some(frame)) = (self.frames.get_mut(*n), frame) {
                *slot = frame;
            }
        }
    }

    /// `world_from_node`.
    pub(crate) fn frame(&self, node: usize) -> Option<&Isometry3<f64>> {
        self.frames.get(node)
    }

    /// Where a node is, metres.
    pub(crate) fn place(&self, node: usize) -> Option<[f32; 3]> {
        self.frames.get(node).map(|f| vec3(&f.translation.vector))
    }
}

/// A node's own motion: what its children's frame is in its own.
fn motion(robot: &Robot, node: usize, q: &[f64]) -> Option<Isometry3<f64>> {
    Some(match &robot.nodes.get(node)?.kind {
        NodeKind::Link { offset } => Translation3::from(*offset).into(),
        NodeKind::Joint { axis, motor, min, max, .. } => {
            let m = robot.motors.get(*motor)?;
            let share = if m.max > m.min { (q.get(*motor)? - m.min) / (m.max - m.min) } else { 0.0 };
            let turn = UnitQuaternion::from_axis_angle(axis, min + share * (max - min));
            Isometry3::from_parts(Translation3::identity(), turn)
        }
    })
}
