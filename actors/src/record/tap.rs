//! Taps: everything that happens is told to the journal and the recorder, which stand in nobody's way.
//!
//! ```text
//! any actor ──event──> [ bounded queue ] ──> thread of the journal   (essential: nothing is lost unnoticed)
//!                  └─> [ bounded queue ] ──> thread of the recorder  (poses thinned, dropped if it can't follow)
//! ```
//!
//! In virtual time a full queue is waited for, so that nothing is dropped and two runs stay equal. In real time nobody
//! waits: poses are dropped first, oldest first, then events, and counted. An event that an essential sink lost is a fault
//! that lasts: see [`Taps::failed`]. A viewer may come later ([`Taps::attach`]): it is first told how everything is now.

mod kept;
mod pipe;
mod watch;
pub use kept::Kept;
pub use pipe::SinkReport;
pub use watch::TapActor;

use crate::runtime::clock::ClockKind;
use crate::runtime::stream::StreamCounters;
use crate::runtime::supervision::Emit;
use mobee_contract::{Entry, Event, Pose, SeenPicture, Sink, Time};
use mobee_model::{Contact, Scene};
use pipe::Pipe;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Opens a sink, at the start and after a failure. An essential one continues where it failed.
pub type OpenSink = Arc<dyn Fn() -> Result<Box<dyn Sink>, String> + Send + Sync>;

/// Which pictures a sink wants.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pictures {
    /// None.
    None,
    /// A few per second of each camera, to look at. Only of a sink that wants poses.
    Few,
    /// All of these cameras, by their names in the run, to keep: by a virtual clock none is dropped.
    All(Arc<[String]>),
}

/// A sink and how it is served.
#[derive(Clone)]
pub struct SinkSpec {
    /// Its name: `journal`, `recorder`.
    pub name: String,
    /// Whether the run must not go on without it.
    pub essential: bool,
    /// Whether it wants poses and scenes, and how far apart: at most one pose per robot in each such span, and one whenever
    /// contact begins or ends. Zero wants every pose.
    pub poses: Option<Duration>,
    /// Which pictures it wants.
    pub pictures: Pictures,
    /// Greatest number of entries that wait for it.
    pub capacity: usize,
    /// How long it may take for one entry at the end of the run, before it is left behind.
    pub patience: Duration,
    /// Opens it; none if nobody is there yet, see [`Taps::attach`].
    pub open: Option<OpenSink>,
}

/// The handle that everybody tells. Cheap to clone.
#[derive(Clone)]
pub struct Taps(Arc<Inner>);

struct Inner {
    pipes: Vec<Pipe>,
    /// Told in place, without a thread.
    memory: Option<Arc<Mutex<dyn Sink>>>,
}

/// What was told to [`Taps::collect`].
#[derive(Clone, Debug, Default)]
pub struct Collected(Arc<Mutex<Vec<(Time, Entry)>>>);

impl Collected {
    /// Everything so far.
    pub fn entries(&self) -> Vec<(Time, Entry)> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The events so far.
    pub fn events(&self) -> Vec<(Time, Arc<Event>)> {
        let event = |(at, entry)| if let Entry::Event(event) = entry { Some((at, event)) } else { None };
        self.entries().into_iter().filter_map(event).collect()
    }
}

impl Sink for Collected {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push((at, entry.clone()));
        Ok(())
    }

    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

impl Taps {
    /// Tells nobody.
    pub fn none() -> Taps {
        Taps(Arc::new(Inner { pipes: Vec::new(), memory: None }))
    }

    /// Keeps everything in memory, at once and without threads: for tests.
    pub fn collect() -> (Taps, Collected) {
        let memory = Collected::default();
        (Taps::in_place(Arc::new(Mutex::new(memory.clone()))), memory)
    }

    /// Tells a sink at once and without a thread: for simulations. It must be quick, and can't fail.
    pub fn in_place(sink: Arc<Mutex<dyn Sink>>) -> Taps {
        Taps(Arc::new(Inner { pipes: Vec::new(), memory: Some(sink) }))
    }

    /// Opens all sinks and starts a thread for each.
    ///
    /// # Errors
    /// If a sink can't be opened, in its words.
    pub fn spawn(clock: ClockKind, specs: Vec<SinkSpec>) -> Result<Taps, String> {
        let pipes = specs.into_iter().map(|spec| Pipe::spawn(clock, spec)).collect::<Result<_, _>>()?;
        Ok(Taps(Arc::new(Inner { pipes, memory: None })))
    }

    /// Puts a sink in the place of the one of this name, or where nobody was yet. It is told how everything is now, and then
    /// what comes; `open` opens it anew after a failure. Nobody waits for the one that was there.
    ///
    /// # Errors
    /// If there is no such place, or no thread for it.
    pub fn attach(&self, name: &str, sink: Box<dyn Sink>, open: OpenSink) -> Result<(), String> {
        let pipe = self.0.pipes.iter().find(|p| p.name() == name);
        pipe.ok_or_else(|| format!("this run has no place for a {name}"))?.attach(sink, open)
    }

    /// Processor time that each sink has taken so far.
    pub fn busy(&self) -> impl Iterator<Item = (String, Duration)> {
        self.0.pipes.iter().map(|pipe| (pipe.name().to_owned(), pipe.busy()))
    }

    /// The names of the sinks.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.pipes.iter().map(Pipe::name)
    }

    /// Tells events, as a function.
    pub fn emitter(&self) -> Emit {
        let taps = self.clone();
        Arc::new(move |at, event| taps.event(at, event))
    }

    /// Tells an event.
    pub fn event(&self, at: Time, event: Event) {
        self.tell(at, &Entry::Event(Arc::new(event)));
    }

    /// Tells a robot's pose and present contacts to those who want poses.
    pub fn pose(&self, at: Time, robot: usize, q: &Pose, contacts: &Arc<[Contact]>) {
        for pipe in &self.0.pipes {
            pipe.push_pose(at, robot, q, contacts);
        }
        if self.0.memory.is_some() {
            self.remember(at, &Entry::Pose { robot, q: q.clone(), contacts: contacts.clone() });
        }
    }

    /// Tells what a camera saw to those who want pictures, with what its detector found in it.
    pub fn picture(&self, at: Time, camera: &str, seen: &Arc<SeenPicture>) {
        for pipe in &self.0.pipes {
            pipe.push_picture(at, camera, seen);
        }
    }

    /// Tells the scene, at the start and whenever it was edited.
    pub fn scene(&self, at: Time, scene: &Arc<Scene>) {
        self.tell(at, &Entry::Scene(scene.clone()));
    }

    fn tell(&self, at: Time, entry: &Entry) {
        for pipe in &self.0.pipes {
            pipe.push(at, entry);
        }
        self.remember(at, entry);
    }

    fn remember(&self, at: Time, entry: &Entry) {
        if let Some(memory) = &self.0.memory {
            let _ = memory.lock().unwrap_or_else(PoisonError::into_inner).write(at, entry);
        }
    }

    /// What went to each sink so far.
    pub fn counters(&self) -> impl Iterator<Item = (String, StreamCounters)> {
        self.0.pipes.iter().map(|pipe| (format!("tap>{}", pipe.name()), pipe.counters()))
    }

    /// Why an essential sink does not keep up the record, if so: the filters are to be closed, since no motion may go
    /// unrecorded.
    pub fn failed(&self) -> Option<String> {
        self.0.pipes.iter().find_map(Pipe::broken)
    }

    /// Says the last event, closes all sinks, waits for their threads, and reports. What is told later is not heard.
    ///
    /// The other sinks end before the essential ones, so that the journal has their counters, if anything was dropped.
    pub fn finish(&self, at: Time, last: Event) -> Vec<SinkReport> {
        let last = Entry::Event(Arc::new(last));
        self.remember(at, &last);
        let (essential, others): (Vec<&Pipe>, Vec<&Pipe>) = self.0.pipes.iter().partition(|p| p.is_essential());
        let mut reports = Vec::new();
        for pipe in others {
            pipe.push(at, &last);
            let report = pipe.finish();
            if report.dropped > 0 || report.error.is_some() {
                let link = Entry::Event(Arc::new(report.link()));
                essential.iter().for_each(|p| p.push(at, &link));
            }
            reports.push(report);
        }
        for pipe in essential {
            pipe.push(at, &last);
            reports.push(pipe.finish());
        }
        reports
    }
}

impl fmt::Debug for Taps {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.0.pipes.iter().map(Pipe::name).collect::<Vec<_>>();
        write!(f, "Taps({names:?})")
    }
}
