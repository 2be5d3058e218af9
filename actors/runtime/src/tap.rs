//! Taps: the journal and the recorder receive everything that happens, without delaying the actors.
//!
//! ```text
//! any actor ──event──> [ bounded queue ] ──> thread of the journal   (essential: nothing is lost unnoticed)
//!                  └─> [ bounded queue ] ──> thread of the recorder  (poses thinned, dropped if it can't follow)
//! ```
//!
//! In virtual time a full queue blocks its producer, so that nothing is dropped and two runs are equal. In real
//! time no producer waits: poses are dropped first, oldest first, then events, and both are counted. An event
//! that an essential sink lost is a lasting fault: see [`Taps::failed`]. A viewer may be attached later
//! ([`Taps::attach`]): it first receives the present state.

mod kept;
mod pipe;
mod watch;
pub use kept::Kept;
pub use pipe::SinkReport;
pub use watch::TapActor;

use crate::clock::ClockKind;
use crate::stream::StreamCounters;
use crate::supervision::Emit;
use mobee_contract::{Entry, Event, Pose, SeenPicture, Sink, Time};
use mobee_model::{Contact, Scene};
use pipe::Pipe;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Opens a sink, at the start and after a failure. An essential sink continues where it failed.
pub type OpenSink = Arc<dyn Fn() -> Result<Box<dyn Sink>, String> + Send + Sync>;

/// Camera images that a sink receives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pictures {
    /// None.
    None,
    /// A few per second from each camera, for display. Only for a sink that receives poses.
    Few,
    /// All of these cameras, by their names in the run, for storage: in virtual time none is dropped.
    All(Arc<[String]>),
}

/// A sink and its settings.
#[derive(Clone)]
pub struct SinkSpec {
    /// Its name: `journal`, `recorder`.
    pub name: String,
    /// True if the run must not continue without it.
    pub essential: bool,
    /// Interval of poses, if the sink receives poses and scenes: at most one pose per robot in each interval,
    /// plus one whenever contact begins or ends. Zero selects every pose.
    pub poses: Option<Duration>,
    /// Camera images that it receives.
    pub pictures: Pictures,
    /// Greatest number of queued entries.
    pub capacity: usize,
    /// Longest time for one entry at the end of the run, after which the sink is abandoned.
    pub patience: Duration,
    /// Opens it; `None` if it is attached later, see [`Taps::attach`].
    pub open: Option<OpenSink>,
}

/// Handle by which all actors report. Cheap to clone.
#[derive(Clone)]
pub struct Taps(Arc<TapPipes>);

struct TapPipes {
    pipes: Vec<Pipe>,
    /// Sink that is called in place, without a thread.
    memory: Option<Arc<Mutex<dyn Sink>>>,
}

/// Entries that were reported to [`Taps::collect`].
#[derive(Clone, Debug, Default)]
pub struct Collected(Arc<Mutex<Vec<(Time, Entry)>>>);

impl Collected {
    /// All entries so far.
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
    /// Creates taps without sinks.
    pub fn none() -> Taps {
        Taps(Arc::new(TapPipes { pipes: Vec::new(), memory: None }))
    }

    /// Creates taps that store everything in memory, immediately and without threads: for tests.
    pub fn collect() -> (Taps, Collected) {
        let memory = Collected::default();
        (Taps::in_place(Arc::new(Mutex::new(memory.clone()))), memory)
    }

    /// Creates taps with a sink that is called immediately and without a thread: for simulations. The sink must
    /// be fast, and must not fail.
    pub fn in_place(sink: Arc<Mutex<dyn Sink>>) -> Taps {
        Taps(Arc::new(TapPipes { pipes: Vec::new(), memory: Some(sink) }))
    }

    /// Opens all sinks and starts a thread for each.
    ///
    /// # Errors
    /// If a sink can't be opened, with its message.
    pub fn spawn(clock: ClockKind, specs: Vec<SinkSpec>) -> Result<Taps, String> {
        let pipes = specs.into_iter().map(|spec| Pipe::spawn(clock, spec)).collect::<Result<_, _>>()?;
        Ok(Taps(Arc::new(TapPipes { pipes, memory: None })))
    }

    /// Replaces the sink of this name, or fills the open place. The new sink first receives the present state,
    /// and then what follows; `open` reopens it after a failure. The previous one is not waited for.
    ///
    /// # Errors
    /// If the run has no such place, or no thread can be started.
    pub fn attach(&self, name: &str, sink: Box<dyn Sink>, open: OpenSink) -> Result<(), String> {
        let pipe = self.0.pipes.iter().find(|p| p.name() == name);
        pipe.ok_or_else(|| format!("this run has no place for a {name}"))?.attach(sink, open)
    }

    /// Processor time that each sink has taken so far.
    pub fn busy(&self) -> impl Iterator<Item = (String, Duration)> {
        self.0.pipes.iter().map(|pipe| (pipe.name().to_owned(), pipe.busy()))
    }

    /// Names of the sinks.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.pipes.iter().map(Pipe::name)
    }

    /// Returns a function that reports events.
    pub fn emitter(&self) -> Emit {
        let taps = self.clone();
        Arc::new(move |at, event| taps.event(at, event))
    }

    /// Reports an event.
    pub fn event(&self, at: Time, event: Event) {
        self.report(at, &Entry::Event(Arc::new(event)));
    }

    /// Reports a robot's pose and present contacts to the sinks that receive poses.
    pub fn pose(&self, at: Time, robot: usize, q: &Pose, contacts: &Arc<[Contact]>) {
        for pipe in &self.0.pipes {
            pipe.push_pose(at, robot, q, contacts);
        }
        if self.0.memory.is_some() {
            self.remember(at, &Entry::Pose { robot, q: q.clone(), contacts: contacts.clone() });
        }
    }

    /// Reports a camera image, with the detections in it, to the sinks that receive images.
    pub fn picture(&self, at: Time, camera: &str, seen: &Arc<SeenPicture>) {
        for pipe in &self.0.pipes {
            pipe.push_picture(at, camera, seen);
        }
    }

    /// Reports the scene, at the start and after each edit.
    pub fn scene(&self, at: Time, scene: &Arc<Scene>) {
        self.report(at, &Entry::Scene(scene.clone()));
    }

    fn report(&self, at: Time, entry: &Entry) {
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

    /// Counters of each sink so far.
    pub fn counters(&self) -> impl Iterator<Item = (String, StreamCounters)> {
        self.0.pipes.iter().map(|pipe| (format!("tap>{}", pipe.name()), pipe.counters()))
    }

    /// Reason for which an essential sink does not maintain the record, if so: the filters must close, because
    /// no motion may go unrecorded.
    pub fn failed(&self) -> Option<String> {
        self.0.pipes.iter().find_map(Pipe::broken)
    }

    /// Reports the last event, closes all sinks, waits for their threads, and returns a report per sink. Later
    /// entries are ignored.
    ///
    /// The other sinks end before the essential ones, so that the journal records their counters if anything
    /// was dropped.
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
