//! A robot model as a recording, in which its correctness can be judged within a minute.
//!
//! ```text
//! Robot ──────> shapes, transparent ──┐
//! LinkSurface ──> meshes ─────────────┼──> recording.rrd: home, then motor after motor through its range
//! Watch ──────> near pairs, in red ───┘
//! ```

mod meshes;
mod sweep;
mod words;

use crate::blueprint::send_model;
use crate::body::{Appearance, RobotEntities, entity};
use crate::front::Front;
use crate::palette;
use crate::recording::{Recording, Settings};
use crate::shadow::lane;
use crate::shapes::{touched, vec3};
use crate::stream::{EntityStream, Written};
use mobee_contract::Time;
use mobee_import::LinkSurface;
use mobee_model::{Contact, NodeKind, Robot, Scene, Watch};
use nalgebra::{Isometry3, Vector3};
use rerun::{Arrows3D, FillMode, LineStrips3D, Points3D, Scalars, SeriesLines, StateChange, TextDocument};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;
use sweep::{AT_HOME, MotorSweep, in_units, sweeps};

/// Longest time for the disk to write the rest.
const WRITE_TIMEOUT: Duration = Duration::from_secs(60);

/// Length of an axis in the view, as a share of the distance from the viewpoint to the robot.
const ARROW: f64 = 0.4;

/// Content of the recording.
#[derive(Clone, Copy, Debug)]
pub struct ModelView<'a> {
    /// The robot.
    pub robot: &'a Arc<Robot>,
    /// Collision meshes of the links in its URDF; may be empty.
    pub meshes: &'a [LinkSurface],
    /// Distance below which a pair is shown in red, meters.
    pub margin: f64,
}

/// Two links that get closer than the margin.
#[derive(Clone, Debug, PartialEq)]
pub struct NearLinks {
    /// Names of the links.
    pub links: (String, String),
    /// Least distance, meters; negative if they overlap.
    pub distance: f64,
    /// The motor that moves at that distance, as an index into the robot's motors, and its position, rad of
    /// encoder; `None` at home.
    pub motor: Option<(usize, f64)>,
}

impl NearLinks {
    /// Formats the pair, such as `base - wrist: 3.2 mm (elbow at 120.0°)`.
    pub fn in_words(&self, robot: &Robot) -> String {
        let (a, b) = &self.links;
        let place = match self.motor.and_then(|(m, q)| Some((robot.motors.get(m)?, q))) {
            Some((motor, q)) => format!("{} at {}", motor.name, in_units(motor, q)),
            None => "at home".to_owned(),
        };
        format!("{a} - {b}: {} ({place})", words::distance(self.distance))
    }
}

/// Result of the sweep through all motors' ranges.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenModel {
    /// Length of the recording, s.
    pub secs: f64,
    /// Pairs of links that get near, the deepest first, each once at home and once for each motor.
    pub near: Vec<NearLinks>,
}

/// Writes the recording.
///
/// # Errors
/// As a message, if the file can't be written, a link with meshes is not in the robot, or the robot makes no
/// scene.
pub fn view_model(settings: &Settings, view: &ModelView<'_>) -> Result<SeenModel, String> {
    let scene = Scene::new(vec![(Arc::clone(view.robot), Isometry3::identity())], Vec::new());
    let scene = Arc::new(scene.map_err(|e| e.to_string())?);
    let links = meshes::nodes(view.robot, view.meshes).map_err(|link| format!("link `{link}` is not in the robot"))?;
    let recording = Recording::begin(settings).map_err(|e| e.to_string())?;
    let stream = recording.stream(String::new(), words::LEGEND)?;
    let front = Front::of_motion(&scene, poses(view.robot));
    send_model(&stream.rec, &front)?;
    stream.at(Time::ZERO);
    let color = |robot: &Robot, node: usize| {
        palette::part(robot.nodes.iter().take(node).filter(|n| !n.solids.is_empty()).count())
    };
    let fill = if links.is_empty() { FillMode::Solid } else { FillMode::TransparentFillMajorWireframe };
    let look =
        Appearance { fill, color: &color, hulls: true, carrying: &links.iter().map(|(node, _)| *node).collect() };
    let body = RobotEntities::new(&stream, view.robot, &Isometry3::identity(), 0, &look)?;
    meshes::write(&stream, &body, &links)?;
    let watch = Watch::new(scene, view.margin);
    let mut show =
        Show { stream, robot: view.robot, body, watch, arrow: ARROW * front.distance(), found: BTreeMap::new() };
    let seen = show.all(view.margin)?;
    recording.reach(WRITE_TIMEOUT)?;
    recording.check()?;
    Ok(seen)
}

/// Configurations of the robot: at home, and with each motor at every position of its sweep.
fn poses(robot: &Robot) -> impl Iterator<Item = Vec<f64>> {
    let moved = |(motor, position): (usize, f64)| {
        let mut q = robot.home();
        if let Some(slot) = q.get_mut(motor) {
            *slot = position;
        }
        q
    };
    let all = sweeps(robot).into_iter();
    let all = all.flat_map(|s| s.positions.into_iter().map(move |(_, q)| (s.motor, q)));
    std::iter::once(robot.home()).chain(all.map(moved))
}

/// Two nodes, and the motor that moves.
type Where = ((usize, usize), Option<usize>);

/// The recording that is being written.
struct Show<'a> {
    stream: EntityStream,
    robot: &'a Robot,
    body: RobotEntities,
    watch: Watch,
    /// Length of an axis, meters: visible beside the robot without hiding it.
    arrow: f64,
    /// Least distance of each near pair, and the motor's position there.
    found: BTreeMap<Where, (f64, f64)>,
}

impl Show<'_> {
    fn all(&mut self, margin: f64) -> Result<SeenModel, String> {
        let sweeps = sweeps(self.robot);
        self.lanes(&sweeps)?;
        let left_out = TextDocument::from_markdown(words::left_out(self.robot));
        self.stream.log_static("left_out", &left_out)?;
        self.stream.log("state/motor", &StateChange::single("home"))?;
        self.pose(Time::ZERO, None)?;
        let mut end = Time::from_secs(AT_HOME);
        for MotorSweep { motor, positions } in &sweeps {
            let Some(name) = self.robot.motors.get(*motor).map(|m| entity(&m.name)) else { continue };
            for (i, (at, q)) in positions.iter().enumerate() {
                self.stream.at(*at);
                if i == 0 {
                    self.stream.log("state/motor", &StateChange::single(name.as_str()))?;
                }
                self.pose(*at, Some((*motor, *q)))?;
                end = *at;
            }
        }
        self.body.flush(&self.stream)?;
        let seen = self.seen(end);
        let near = TextDocument::from_markdown(words::near(self.robot, &seen, margin));
        self.stream.log_static("near", &near)?;
        Ok(seen)
    }

    /// Writes the colors and labels of the lanes, and the plot's line.
    fn lanes(&self, sweeps: &[MotorSweep]) -> Written {
        let names = sweeps.iter().filter_map(|s| self.robot.motors.get(s.motor)).map(|m| (entity(&m.name), &m.name));
        let names: Vec<_> = names.collect();
        let named =
            |(i, (value, name)): (usize, &(String, &String))| (value.clone(), (*name).clone(), palette::part(i));
        let states: Vec<_> = names.iter().enumerate().map(named).collect();
        let mut motors = vec![("home", "home", palette::FREE)];
        motors.extend(states.iter().map(|(value, name, color)| (value.as_str(), name.as_str(), *color)));
        lane(&self.stream, "state/motor", &motors)?;
        lane(&self.stream, "state/near", &palette::NEARNESS)?;
        let line = SeriesLines::new().with_names(["degrees or mm"]).with_colors([palette::AXIS]).with_widths([2.0]);
        self.stream.log_static("position", &line)
    }

    /// Writes one configuration: one motor at a position, and all others at home.
    fn pose(&mut self, at: Time, moving: Option<(usize, f64)>) -> Written {
        let mut q = self.robot.home();
        if let Some((motor, position)) = moving
            && let Some(slot) = q.get_mut(motor)
        {
            *slot = position;
        }
        self.body.pose(at, self.robot, &q);
        let contacts = self.watch.update(&[&q]).to_vec();
        self.note(&contacts, moving);
        self.contacts(&contacts)?;
        self.axes(&q, moving)?;
        let now = TextDocument::from_markdown(words::now(self.robot, moving, &contacts));
        self.stream.log("now", &now)?;
        if let Some((_, position)) = moving {
            self.stream.log("position", &Scalars::single(position.to_degrees()))?;
        }
        Ok(())
    }

    fn note(&mut self, contacts: &[Contact], moving: Option<(usize, f64)>) {
        for contact in contacts {
            let Some(pair) = words::nodes(contact) else { continue };
            let place = moving.map_or(0.0, |(_, q)| q);
            let least = self.found.entry((pair, moving.map(|(m, _)| m))).or_insert((contact.distance, place));
            if contact.distance < least.0 {
                *least = (contact.distance, place);
            }
        }
    }

    /// Draws near pairs in red, with a line between the nearest points.
    fn contacts(&mut self, contacts: &[Contact]) -> Written {
        self.body.shapes.paint(&self.stream, &touched(contacts))?;
        let ends = contacts.iter().map(|c| c.points.map(|p| vec3(&p.coords)));
        let lines = LineStrips3D::new(ends.clone()).with_colors([palette::NEAR]).with_radii([0.002]);
        self.stream.log("world/near/lines", &lines)?;
        let points = Points3D::new(ends.flatten()).with_colors([palette::NEAR]).with_radii([0.005]);
        self.stream.log("world/near/points", &points)?;
        let least = contacts.iter().map(|c| c.distance).fold(f64::INFINITY, f64::min);
        let word = palette::nearness(least);
        self.stream.log("state/near", &StateChange::single(word))
    }

    /// Draws the axes of the motor that moves, with its name and position.
    fn axes(&self, q: &[f64], moving: Option<(usize, f64)>) -> Written {
        let mut origins = Vec::new();
        let mut vectors = Vec::new();
        let mut labels = Vec::new();
        let mut frames = Vec::new();
        self.robot.forward(q, &mut frames);
        if let Some((motor, position)) = moving.and_then(|(m, q)| Some((self.robot.motors.get(m)?, q))) {
            for node in &motor.joints {
                let axis = self.robot.nodes.get(*node).and_then(|n| match &n.kind {
                    NodeKind::Joint { axis, .. } => Some(axis.into_inner()),
                    NodeKind::Link { .. } => None,
                });
                let (Some(frame), Some(axis)) = (frames.get(*node), axis) else { continue };
                let label = if labels.is_empty() {
                    format!("{} {}", motor.name, in_units(motor, position))
                } else {
                    String::new()
                };
                let along: Vector3<f64> = frame.rotation * axis * self.arrow;
                origins.push(vec3(&(frame.translation.vector - 0.5 * along)));
                vectors.push(vec3(&along));
                labels.push(label);
            }
        }
        let arrows = Arrows3D::from_vectors(vectors)
            .with_origins(origins)
            .with_labels(labels)
            .with_show_labels(true)
            .with_colors([palette::AXIS])
            .with_radii([(0.012 * self.arrow) as f32]);
        self.stream.log("world/axis", &arrows)
    }

    fn seen(&self, end: Time) -> SeenModel {
        let name = |n| words::link(self.robot, n);
        let near = self.found.iter().map(|(((a, b), motor), (distance, place))| NearLinks {
            links: (name(*a), name(*b)),
            distance: *distance,
            motor: motor.map(|m| (m, *place)),
        });
        let mut near: Vec<NearLinks> = near.collect();
        near.sort_by(|a, b| a.distance.total_cmp(&b.distance));
        SeenModel { secs: end.secs(), near }
    }
}
