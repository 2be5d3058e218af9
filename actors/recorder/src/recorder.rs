//! The sink itself: entries in, rows and columns out.

use crate::blueprint::{self, Page, Shown};
use crate::body::{Body, entity};
use crate::disk::{Disk, Trouble};
use crate::draw::Drawing;
use crate::front::Front;
use crate::legend;
use crate::objects::Objects;
use crate::palette;
use crate::roadmap::Roadmap;
use crate::shapes::Touch;
use crate::stream::{Stream, Written};
use crate::traces::Traces;
use crate::words;
use mobee_contract::{Entry, Event, Sink, Time};
use mobee_model::{Contact, Robot, Scene, ShapeId};
use nalgebra::Isometry3;
use rerun::external::arrow::array::StringArray;
use rerun::log::ChunkBatcherConfig;
use rerun::sink::SinkFlushError;
use rerun::{
    AnyValues, Points3D, RecordingStream, RecordingStreamBuilder, SeriesLines, StateChange, StateConfiguration,
    TextDocument, TextLog, ViewCoordinates,
};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Frames that are sent as one column per entity.
const FRAMES: usize = 2048;
/// Waiting frames are sent after this much real time, so that a killed run loses no more.
const PATIENCE: Duration = Duration::from_secs(1);
/// How long a flush is waited for. Later ones are no error: whoever is behind may still catch up.
const FLUSH: Duration = Duration::from_secs(1);
/// Bytes that may wait within Rerun for a slow disk or viewer, before its caller has to wait.
const IN_FLIGHT: u64 = 16 << 20;
/// At most so many places of past contacts are kept in view.
const PAST: usize = 300;

/// What a recording is called and where it goes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Settings {
    /// The file to write, usually `recording.rrd` in the run's folder.
    pub path: PathBuf,
    /// The run's name, shown in the viewer.
    pub name: String,
    /// The configuration file's name, kept as a property.
    pub config: String,
    /// The program's version and build, kept as a property.
    pub build: String,
    /// Address of a viewer that is to follow live, such as `127.0.0.1:9876`: it is told instead of the file.
    pub live: Option<String>,
    /// Whether the file gets an index at its end, for which the memory grows as long as it is written (tens of megabytes an
    /// hour). Files without one are read whole.
    pub index: bool,
}

/// A recording could not be begun.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// The file can't be written.
    #[error(
        "the recording {path} can't be begun: {why}; check that the folder exists and can be written, or run with `--no-record`"
    )]
    File {
        /// The file.
        path: String,
        /// Why not.
        why: String,
    },
    /// The viewer's address makes no sense.
    #[error("the viewer {address} can't be connected: {why}; start it with `rerun` and give its address")]
    Live {
        /// The address.
        address: String,
        /// Why not.
        why: String,
    },
}

/// A recording that is being written: one file, into which several recorders can draw side by side.
#[derive(Clone)]
pub struct Recording {
    rec: RecordingStream,
    /// What each recorder shows, in the order in which they began.
    pages: Arc<Mutex<Vec<Page>>>,
    is_live: bool,
    /// Why the file can't be written on.
    trouble: Trouble,
}

impl Recording {
    /// Begins a recording.
    ///
    /// # Errors
    /// [`RecorderError`] if the file or the viewer can't be opened.
    pub fn begin(settings: &Settings) -> Result<Recording, RecorderError> {
        let file = |why: &dyn std::fmt::Display| RecorderError::File {
            path: settings.path.display().to_string(),
            why: why.to_string(),
        };
        // every chunk costs; only somebody who looks on live needs them at once
        let flush_tick = if settings.live.is_some() { ChunkBatcherConfig::DEFAULT.flush_tick } else { PATIENCE };
        let max_bytes_in_flight = IN_FLIGHT;
        let builder = RecordingStreamBuilder::new("mobee")
            .recording_name(settings.name.clone())
            .batcher_config(ChunkBatcherConfig { flush_tick, max_bytes_in_flight, ..ChunkBatcherConfig::DEFAULT });
        let rec = builder.buffered().map_err(|e| file(&e))?;
        let mut trouble = Trouble::default();
        match &settings.live {
            None => {
                let (disk, noted) = Disk::create(&settings.path, settings.index).map_err(|e| file(&e))?;
                trouble = noted;
                rec.set_sink(Box::new(disk));
            }
            Some(address) => {
                let wrong = |e: rerun::external::re_uri::Error| RecorderError::Live {
                    address: address.clone(),
                    why: e.to_string(),
                };
                let uri = format!("rerun+http://{address}/proxy").parse().map_err(wrong)?;
                rec.set_sink(Box::new(rerun::sink::GrpcSink::new(uri)));
            }
        }
        rec.set_log_tick_enabled(false);
        rec.set_log_time_enabled(false);
        let began = property(&rec, "config", &settings.config).and_then(|()| property(&rec, "build", &settings.build));
        began.map_err(|why| file(&why))?;
        Ok(Recording { rec, pages: Arc::default(), is_live: settings.live.is_some(), trouble })
    }

    /// A recorder that draws below the entity `name`; below none if that is empty, as it should be for the only one.
    ///
    /// # Errors
    /// In words, if the stream refuses.
    pub fn recorder(&self, name: &str) -> Result<Recorder, String> {
        let root = if name.is_empty() { String::new() } else { format!("{}/", entity(name)) };
        let stream = Stream { rec: self.rec.clone(), root };
        stream.log_static("world", &ViewCoordinates::RIGHT_HAND_Z_UP())?;
        stream.log_static("about", &TextDocument::from_markdown(legend::TEXT))?;
        Ok(Recorder {
            stream,
            pages: Arc::clone(&self.pages),
            robots: Vec::new(),
            objects: Objects::default(),
            front: None,
            scene: None,
            past: Vec::new(),
            now: Time::ZERO,
            frames: 0,
            flushed: wall(),
            is_live: self.is_live,
            trouble: Trouble::clone(&self.trouble),
        })
    }
}

/// Writes a run as a Rerun recording: a [`Sink`], to be put behind a tap.
///
/// Poses are buffered and sent as whole columns; a joint that rests costs nothing. Everything is written at the run's own time
/// (timeline `sim_time`). What waits is written when the recorder is dropped.
pub struct Recorder {
    stream: Stream,
    pages: Arc<Mutex<Vec<Page>>>,
    robots: Vec<Shadow>,
    objects: Objects,
    front: Option<Front>,
    scene: Option<Arc<Scene>>,
    /// Places where contacts began, newest last.
    past: Vec<[f32; 3]>,
    now: Time,
    frames: usize,
    flushed: Instant,
    is_live: bool,
    /// Why the file can't be written on.
    trouble: Trouble,
}

/// What is kept of one robot.
struct Shadow {
    name: String,
    robot: Arc<Robot>,
    body: Body,
    traces: Traces,
    roadmap: Roadmap,
    drawing: Drawing,
    contacts: Vec<Contact>,
    rollbacks: u32,
    /// What the view of its flat roadmap covers.
    bounds: Option<[f32; 4]>,
}

impl Recorder {
    /// Begins a recording with one recorder.
    ///
    /// # Errors
    /// [`RecorderError`] if the file or the viewer can't be opened.
    pub fn new(settings: &Settings) -> Result<Recorder, RecorderError> {
        let path = settings.path.display().to_string();
        Recording::begin(settings)?.recorder("").map_err(|why| RecorderError::File { path, why })
    }

    fn scene(&mut self, scene: &Arc<Scene>) -> Written {
        let front = Front::of(scene);
        for (i, robot) in scene.robots().iter().enumerate().skip(self.robots.len()) {
            self.robots.push(Shadow::new(&self.stream, robot, &scene.base(i), i)?);
        }
        if self.front.is_none() {
            self.front = Some(front);
            self.lay_out()?;
        }
        self.objects.update(&self.stream, scene)?;
        self.scene = Some(Arc::clone(scene));
        self.paint()
    }

    fn pose(&mut self, at: Time, robot: usize, q: &[f64], contacts: &[Contact]) -> Written {
        let Some(shadow) = self.robots.get_mut(robot) else { return Ok(()) };
        shadow.body.pose(at, &shadow.robot, q);
        shadow.traces.pose(at, &shadow.robot, q);
        self.frames += 1;
        if shadow.contacts.as_slice() != contacts {
            shadow.contacts = contacts.to_vec();
            self.paint()?;
        }
        if self.frames >= FRAMES { self.send() } else { Ok(()) }
    }

    /// Sends the waiting columns.
    fn send(&mut self) -> Written {
        self.frames = 0;
        self.flushed = wall();
        for shadow in &mut self.robots {
            shadow.body.flush(&self.stream)?;
            shadow.traces.flush(&self.stream)?;
        }
        Ok(())
    }

    /// Paints what is in contact, and marks where.
    fn paint(&mut self) -> Written {
        let mut touched: BTreeMap<ShapeId, Touch> = BTreeMap::new();
        let mut places = Vec::new();
        for contact in self.robots.iter().flat_map(|r| &r.contacts) {
            let touch = if contact.distance > 0.0 { Touch::Near } else { Touch::Hard };
            for id in [contact.pair.0, contact.pair.1] {
                let worst = touched.entry(id).or_insert(touch);
                *worst = touch.max(*worst);
            }
            places.push(middle(contact));
        }
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
        if let Some((source, level, text)) = words::line(event) {
            let line = TextLog::new(text).with_level(level.word());
            self.stream.log(&format!("log/{}", entity(source)), &line)?;
        }
        match event {
            Event::Started { seed, clock, .. } => {
                property(&self.stream.rec, "seed", &seed.to_string())?;
                property(&self.stream.rec, "clock", clock)?;
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
                let from = self.past.len().saturating_sub(PAST);
                let places = self.past.iter().skip(from).copied();
                let marks = Points3D::new(places).with_colors([palette::PAST_CONTACT]).with_radii([0.005]);
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

    /// Sends the layout; again when a map has outgrown its view, which does not follow by itself.
    fn lay_out(&self) -> Written {
        let Some(front) = self.front else { return Ok(()) };
        let page =
            Page { root: self.stream.root.clone(), robots: self.robots.iter().map(Shadow::shown).collect(), front };
        let mut pages = self.pages.lock().unwrap_or_else(PoisonError::into_inner);
        match pages.iter_mut().find(|p| p.root == page.root) {
            Some(known) => *known = page,
            None => pages.push(page),
        }
        blueprint::send(&self.stream.rec, &pages)
    }

    /// Draws the roadmaps as they were up to now, before time goes on: notes of one instant make one picture.
    fn draw(&mut self, last: bool) -> Written {
        let mut outgrown = false;
        for shadow in self.robots.iter_mut().filter(|s| s.roadmap.changed.vertices) {
            outgrown |= shadow.outgrown();
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

impl Shadow {
    fn new(stream: &Stream, robot: &Arc<Robot>, base: &Isometry3<f64>, index: usize) -> Result<Shadow, String> {
        let name = entity(&robot.name);
        lane(stream, &format!("state/{name}/filter"), &palette::FILTER)?;
        lane(stream, &format!("state/{name}/transaction"), &palette::TRANSACTION)?;
        let rollbacks = SeriesLines::new().with_names(["rollbacks"]).with_colors([palette::NEAR]).with_widths([2.0]);
        stream.log_static(&format!("progress/{name}/rollbacks"), &rollbacks)?;
        Ok(Shadow {
            body: Body::new(stream, robot, base, index as u16)?,
            traces: Traces::new(stream, robot, base)?,
            roadmap: Roadmap::default(),
            drawing: Drawing::new(stream, &name)?,
            contacts: Vec::new(),
            rollbacks: 0,
            bounds: None,
            robot: Arc::clone(robot),
            name,
        })
    }

    fn shown(&self) -> Shown {
        Shown { name: self.name.clone(), parts: self.traces.parts(), trails: self.traces.trails(), bounds: self.bounds }
    }

    /// Whether the roadmap no longer fits its view, which then gets room for some more.
    fn outgrown(&mut self) -> bool {
        let Some([left, top, right, bottom]) = self.roadmap.bounds() else { return false };
        let fits = |[l, t, r, b]: [f32; 4]| l <= left && t <= top && r >= right && b >= bottom;
        if self.bounds.is_some_and(fits) {
            return false;
        }
        let room = if self.bounds.is_some() { 0.2 * (right - left).max(bottom - top) } else { 0.0 };
        self.bounds = Some([left - room, top - room, right + room, bottom + room]);
        true
    }
}

impl Sink for Recorder {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        if let Some(why) = self.trouble.get() {
            return Err(unwritable(why));
        }
        if at > self.now {
            self.draw(false)?;
            self.now = at;
        }
        self.stream.at(at);
        match entry {
            Entry::Event(event) => self.event(event),
            Entry::Pose { robot, q, contacts } => self.pose(at, *robot, q, contacts),
            Entry::Scene(scene) => self.scene(scene),
        }
    }

    fn flush(&mut self) -> Result<(), String> {
        // asked for at every pause: columns of one row would cost more than they are worth
        if self.flushed.elapsed() < PATIENCE {
            return Ok(());
        }
        self.send()?;
        match self.stream.rec.flush_with_timeout(FLUSH) {
            Ok(()) | Err(SinkFlushError::Timeout) => Ok(()),
            Err(e) if self.is_live => Err(format!("the viewer is not reached: {e}")),
            Err(e) => Err(unwritable(&e.to_string())),
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        // nobody is left to be told of an error
        let _ = self.draw(true).and_then(|()| self.send());
        let _ = self.stream.rec.flush_with_timeout(FLUSH);
    }
}

fn unwritable(why: &str) -> String {
    format!("the recording can't be written: {why}; make room on the disk")
}

/// Colors and words of a state lane.
fn lane(stream: &Stream, path: &str, states: &[(&str, &str, palette::Rgba)]) -> Written {
    let look = StateConfiguration::new()
        .with_values(states.iter().map(|s| s.0))
        .with_labels(states.iter().map(|s| s.1))
        .with_colors(states.iter().map(|s| s.2));
    stream.log_static(path, &look)?;
    // an empty state opens the lane
    stream.log(path, &StateChange::new().with_state([""]))
}

fn property(rec: &RecordingStream, name: &'static str, value: &str) -> Written {
    let array = Arc::new(StringArray::from(vec![value]));
    let values = AnyValues::default().with_component_from_data(name, array);
    rec.send_property(name, &values).map_err(|e| crate::stream::in_words(name, &e))
}

/// Half way between the two shapes of a contact.
fn middle(contact: &Contact) -> [f32; 3] {
    let [a, b] = contact.points;
    crate::shapes::vec3(&nalgebra::center(&a, &b).coords)
}

/// The wall clock: only here, to bound what a killed run loses; nothing that is written depends on it.
#[expect(clippy::disallowed_methods, reason = "bounds the real time that frames wait; no entry bears it")]
fn wall() -> Instant {
    Instant::now()
}
