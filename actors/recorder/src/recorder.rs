//! The sink: receives entries, writes rows and columns.

use crate::blueprint::{Page, open_plot};
use crate::body::{entities, entity};
use crate::eyes::Eye;
use crate::front::Front;
use crate::objects::{Objects, show_unknown};
use crate::palette;
use crate::recording::{RecorderError, Recording, SEND_INTERVAL, Settings};
use crate::shadow::DrawnRobot;
use crate::shapes::touched;
use crate::stream::{EntityStream, Written};
use crate::words;
use mobee_contract::{Entry, Event, Pose, SeenPicture, Sink, Time};
use mobee_model::{Contact, Labels, Scene};
use rerun::{Points3D, StateChange, TextLog};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Number of frames that are sent as one column per entity.
const FRAMES: usize = 2048;
/// Most places of past contacts that remain visible.
const MAX_PAST_CONTACTS: usize = 300;

/// Writes a run as a Rerun recording: a [`Sink`] behind a tap.
///
/// Configurations are buffered and sent as whole columns; a joint at rest costs nothing. Everything is written
/// at the run's time (timeline `sim_time`). Buffered data is written when the recorder is dropped.
pub struct Recorder {
    recording: Recording,
    stream: EntityStream,
    robots: Vec<DrawnRobot>,
    /// Cameras with at least one image.
    eyes: Vec<Eye>,
    objects: Objects,
    front: Option<Front>,
    scene: Option<Arc<Scene>>,
    /// Labels of shapes in the log.
    labels: Labels,
    /// Places where contacts began, newest last.
    past: Vec<[f32; 3]>,
    now: Time,
    frames: usize,
    /// Index of the joint plot that the layout opens.
    plot: usize,
    flushed: Instant,
}

impl Recorder {
    /// Starts a recording with one recorder.
    ///
    /// # Errors
    /// [`RecorderError`] if the file or the viewer can't be opened.
    pub fn new(settings: &Settings) -> Result<Recorder, RecorderError> {
        let path = settings.path.display().to_string();
        Recording::begin(settings)?.recorder("").map_err(|why| RecorderError::File { path, why })
    }

    /// Waits until a viewer has received all data that was sent so far.
    ///
    /// # Errors
    /// If it has not within this time, as a message.
    pub fn reach(&self, within: Duration) -> Written {
        self.recording.reach(within)
    }

    /// Creates a recorder that draws into an existing recording through this stream.
    pub(crate) fn on(recording: Recording, stream: EntityStream) -> Recorder {
        Recorder {
            recording,
            stream,
            robots: Vec::new(),
            eyes: Vec::new(),
            objects: Objects::default(),
            front: None,
            scene: None,
            labels: Labels::default(),
            past: Vec::new(),
            now: Time::ZERO,
            frames: 0,
            plot: 0,
            flushed: wall(),
        }
    }

    fn scene(&mut self, scene: &Arc<Scene>) -> Written {
        for (i, robot) in scene.robots().iter().enumerate().skip(self.robots.len()) {
            let named = self.recording.named(robot);
            self.robots.push(DrawnRobot::new(&self.stream, robot, &scene.base(i), i, named)?);
        }
        if self.front.is_none() {
            self.front = Some(Front::of(scene));
            self.lay_out()?;
            show_unknown(&self.stream, &self.recording.unknown)?;
        }
        self.objects.update(&self.stream, scene)?;
        if self.scene.is_none() {
            self.labels = Labels::new(scene.robots());
        }
        self.scene = Some(Arc::clone(scene));
        self.paint()
    }

    /// Shows a camera image with its detections. The first image of a camera adds a view to the layout.
    fn picture(&mut self, camera: &str, seen: &SeenPicture) -> Written {
        if !self.eyes.iter().any(|eye| eye.is(camera)) {
            let mut eye = Eye::new(&self.stream, camera, seen.mount.as_ref())?;
            for (i, shadow) in self.robots.iter().enumerate() {
                if let (Some(scene), Some(q)) = (&self.scene, &shadow.pose) {
                    eye.carry(&self.stream, scene, i, q)?;
                }
            }
            self.eyes.push(eye);
            self.lay_out()?;
        }
        let eye = self.eyes.iter_mut().find(|eye| eye.is(camera));
        eye.map_or(Ok(()), |eye| eye.show(&self.stream, seen))
    }

    fn pose(&mut self, at: Time, robot: usize, q: &Pose, contacts: &[Contact]) -> Written {
        if let Some(scene) = &self.scene {
            self.eyes.iter_mut().try_for_each(|eye| eye.carry(&self.stream, scene, robot, q))?;
        }
        let Some(shadow) = self.robots.get_mut(robot) else { return Ok(()) };
        shadow.pose = Some(q.clone());
        shadow.body.pose(at, &shadow.robot, q);
        let begins = shadow.traces.pose(at, &shadow.robot, q);
        self.frames += 1;
        if shadow.contacts.as_slice() != contacts {
            shadow.contacts = contacts.to_vec();
            self.paint()?;
        }
        if begins && self.open_plot() != self.plot {
            self.lay_out()?;
        }
        if self.frames >= FRAMES { self.send() } else { Ok(()) }
    }

    /// Sends the buffered columns.
    fn send(&mut self) -> Written {
        self.frames = 0;
        self.flushed = wall();
        for shadow in &mut self.robots {
            shadow.body.flush(&self.stream)?;
            shadow.traces.flush(&self.stream)?;
        }
        Ok(())
    }

    /// Colors the shapes in contact, and marks the places.
    fn paint(&mut self) -> Written {
        let contacts: Vec<&Contact> = self.robots.iter().flat_map(|r| &r.contacts).collect();
        let touched = touched(contacts.iter().copied());
        let places: Vec<_> = contacts.into_iter().map(middle).collect();
        for shadow in &mut self.robots {
            shadow.body.shapes.paint(&self.stream, &touched)?;
        }
        for shapes in self.objects.shapes() {
            shapes.paint(&self.stream, &touched)?;
        }
        let marks = Points3D::new(places).with_colors([palette::NEAR]).with_radii([0.012]);
        self.stream.log("world/contacts/now", &marks)
    }

    fn event(&mut self, event: &Event) -> Written {
        let vertex = |robot: &str, id: u32| {
            let shadow = self.robots.iter().find(|r| r.robot.name == robot);
            shadow.map_or_else(|| id.to_string(), |r| r.roadmap.label(id))
        };
        if let Some((source, level, text)) = words::line(event, &vertex) {
            let line = TextLog::new(self.labels.read(&text).into_owned()).with_level(level.word());
            self.stream.log(&format!("log/{}", entities(source)), &line)?;
        }
        match event {
            Event::Started { seed, clock, .. } => {
                self.recording.property("seed", &seed.to_string())?;
                self.recording.property("clock", clock)?;
            }
            Event::State { robot, status } => {
                let lane = StateChange::single(status.word());
                self.stream.log(&format!("state/{}/filter", entity(robot)), &lane)?;
            }
            Event::Commit { robot, .. } => {
                self.stream.log(&format!("state/{}/transaction", entity(robot)), &StateChange::single("open"))?;
            }
            Event::Outcome { robot, outcome, .. } => {
                let lane = StateChange::single(palette::outcome(*outcome));
                self.stream.log(&format!("state/{}/transaction", entity(robot)), &lane)?;
                if *outcome == mobee_contract::Outcome::RolledBack
                    && let Some(shadow) = self.robots.iter_mut().find(|r| r.robot.name == *robot)
                {
                    shadow.rollbacks += 1;
                    let count = rerun::Scalars::single(f64::from(shadow.rollbacks));
                    self.stream.log(&format!("progress/{}/rollbacks", shadow.name), &count)?;
                }
            }
            Event::ContactBegan { robot, contact, .. } => {
                if let Some(shadow) = self.robots.iter_mut().find(|r| r.robot.name == *robot)
                    && !shadow.contacts.iter().any(|c| c.pair == contact.pair)
                {
                    shadow.contacts.push(*contact);
                    self.paint()?;
                }
                self.past.push(middle(contact));
                self.past.drain(..self.past.len().saturating_sub(MAX_PAST_CONTACTS));
                let marks =
                    Points3D::new(self.past.iter().copied()).with_colors([palette::PAST_CONTACT]).with_radii([0.005]);
                self.stream.log("world/contacts/so_far", &marks)?;
            }
            Event::Note { robot, note } => {
                let right = self.front.map_or([0.0, 1.0, 0.0], |f| f.right);
                if let Some(shadow) = self.robots.iter_mut().find(|r| r.robot.name == *robot) {
                    shadow.roadmap.on(note, right);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Index of the plot that the joints open at.
    fn open_plot(&self) -> usize {
        open_plot(&self.robots.iter().map(DrawnRobot::shown).collect::<Vec<_>>())
    }

    /// Sends the layout: at first, when a map has outgrown its view, which does not follow by itself, and when
    /// the first part moves.
    fn lay_out(&mut self) -> Written {
        let Some(front) = self.front else { return Ok(()) };
        let robots: Vec<_> = self.robots.iter().map(DrawnRobot::shown).collect();
        self.plot = open_plot(&robots);
        let eyes = self.eyes.iter().map(|eye| eye.path.clone()).collect();
        let page = Page { root: self.stream.root.clone(), robots, eyes, front };
        self.recording.lay_out(page)
    }

    /// Draws the roadmaps as of the present time, before it advances: notes of one instant make one drawing.
    fn draw(&mut self, last: bool) -> Written {
        // The first entries for a late viewer have their original times.
        self.stream.at(self.now);
        let mut outgrown = false;
        for shadow in self.robots.iter_mut().filter(|s| s.roadmap.changed.vertices) {
            outgrown |= shadow.outgrown();
            if let (Some(front), Some((low, high))) = (&mut self.front, shadow.roadmap.extent()) {
                outgrown |= front.include(low, high);
            }
        }
        if outgrown {
            self.lay_out()?;
        }
        for shadow in &mut self.robots {
            shadow.drawing.draw(&self.stream, self.now, &mut shadow.roadmap, last)?;
        }
        Ok(())
    }
}

impl Sink for Recorder {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        self.recording.check()?;
        if at > self.now {
            self.draw(false)?;
            self.now = at;
        }
        self.stream.at(at);
        match entry {
            Entry::Event(event) => self.event(event),
            Entry::Pose { robot, q, contacts } => self.pose(at, *robot, q, contacts),
            Entry::Scene(scene) => self.scene(scene),
            Entry::Picture { camera, seen } => self.picture(camera, seen),
        }
    }

    fn flush(&mut self) -> Result<(), String> {
        // Flushes are requested at every pause: columns of one row would cost more than they are worth.
        if self.flushed.elapsed() < SEND_INTERVAL {
            return Ok(());
        }
        self.send()?;
        self.recording.flush()
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // There is no receiver for an error any more.
        let _ = self.draw(true).and_then(|()| self.send());
        let _ = self.recording.flush();
    }
}

/// Midpoint between the two shapes of a contact.
fn middle(contact: &Contact) -> [f32; 3] {
    let [a, b] = contact.points;
    crate::shapes::vec3(&nalgebra::center(&a, &b).coords)
}

/// The wall clock, used only here, to limit the data loss of a killed run; no written data depends on it.
#[expect(clippy::disallowed_methods, reason = "bounds the real time that frames wait; no entry bears it")]
fn wall() -> Instant {
    Instant::now()
}
