//! The same actors, unchanged, in real time: the safety chain on its own thread.

use crate::common::{Ran, Trial, ball};
use mobee_conformance::beside;
use mobee_contract::{CommandKind, Entry, Event, Outcome, Sink, Status, Time};
use mobee_journal::journal::{Journal, read};
use mobee_model::ObjectClass;
use mobee_runtime::clock::ClockKind;
use mobee_runtime::system::Reason;
use mobee_runtime::tap::{OpenSink, Pictures, SinkSpec};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// A disk that writes nothing before a motion has been rolled back, and whether that came to pass.
#[derive(Default)]
struct Disk {
    rolled_back: Mutex<bool>,
    changed: Condvar,
}

/// The journal on that disk.
struct OnDisk(Box<dyn Sink>, Arc<Disk>);

impl Sink for OnDisk {
    fn write(&mut self, at: Time, entry: &Entry) -> Result<(), String> {
        let waits = self.1.rolled_back.lock().unwrap();
        let limit = Duration::from_secs(60);
        let (seen, _) = self.1.changed.wait_timeout_while(waits, limit, |seen| !*seen).unwrap();
        assert!(*seen, "the robot waits for the disk");
        drop(seen);
        self.0.write(at, entry)
    }
    fn flush(&mut self) -> Result<(), String> {
        self.0.flush()
    }
}

/// Somebody who sees what the robot does.
struct Onlooker(Arc<Disk>);

impl Sink for Onlooker {
    fn write(&mut self, _: Time, entry: &Entry) -> Result<(), String> {
        if let Entry::Event(event) = entry
            && let Event::Outcome { outcome: Outcome::RolledBack, .. } = **event
        {
            *self.0.rolled_back.lock().unwrap() = true;
            self.0.changed.notify_all();
        }
        Ok(())
    }
    fn flush(&mut self) -> Result<(), String> {
        Ok(())
    }
}

#[test]
fn contact_stop_and_the_whole_retreat_wait_for_no_disk() {
    let dir = tempfile::tempdir().unwrap();
    let journal = Journal::create(dir.path(), &serde_json::Value::Null).unwrap();
    let disk = Arc::new(Disk::default());
    let spec = |name: &str, open: OpenSink| {
        let patience = Duration::from_secs(30);
        SinkSpec {
            pictures: Pictures::None,
            name: name.into(),
            essential: false,
            poses: None,
            capacity: 8192,
            patience,
            open: Some(open),
        }
    };
    let (on, by) = (disk.clone(), disk.clone());
    let slow: OpenSink = Arc::new(move || Ok(Box::new(OnDisk(journal.sink(), on.clone()))));
    let quick: OpenSink = Arc::new(move || Ok(Box::new(Onlooker(by.clone()))));
    let sinks = vec![SinkSpec { essential: true, ..spec("journal", slow) }, spec("onlooker", quick)];
    let objects = vec![ball("ball", [0.5, 0.25, 0.2], ObjectClass::Obstacle)];
    let poses = vec![[60.0, 0.0, 0.0], [-5.0, 0.0, 0.0]];
    let ran = Trial { objects, poses, speed: 0.2, clock: ClockKind::Real, sinks, ..Trial::default() }.run();
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    assert!(*disk.rolled_back.lock().unwrap());
    assert_eq!(ran.violations(), [], "{}", ran.lines());
    let written = read(dir.path()).unwrap().map(Result::unwrap).count();
    assert_eq!(written, ran.events().len(), "nothing of it is missing in the journal");
}

/// The threads that wake up between a reading and the stop that it causes, and between two readings.
const WAKINGS: u32 = 2;

/// From each contact that began in motion to the command that stops the robot.
fn stops(ran: &Ran) -> Vec<Duration> {
    let (mut began, mut all) = (None, Vec::new());
    for (at, event) in ran.events() {
        match &*event {
            Event::ContactBegan { during: Status::Moving, .. } => began = began.or(Some(at)),
            Event::Command { kind: CommandKind::Stop, .. } => all.extend(began.take().map(|then| at.since(then))),
            _ => {}
        }
    }
    all
}

#[test]
fn a_motion_into_an_obstacle_is_rolled_back_in_real_time() {
    let objects = vec![ball("ball", [0.5, 0.25, 0.2], ObjectClass::Obstacle)];
    let poses = vec![[60.0, 0.0, 0.0], [-5.0, 0.0, 0.0]];
    let trial = Trial { objects, poses, speed: 0.2, clock: ClockKind::Real, ..Trial::default() };
    let period = Duration::from_secs_f64(trial.period_s);
    let (ran, late) = beside(|| trial.run());
    assert_eq!(ran.end.reason, Reason::Done, "{}", ran.lines());
    assert_eq!(ran.end.counts.commits, 2, "{}", ran.lines());
    assert!(ran.outcomes().contains(&Outcome::RolledBack), "{}", ran.lines());
    let stops = stops(&ran);
    eprintln!("from contact to stop: {stops:?}; bare threads woke up late by up to {:?}", late.most);
    assert!(!stops.is_empty(), "{}", ran.lines());
    for stop in stops {
        assert!(late.apart_from(stop, WAKINGS) < period, "stopped {stop:?} after the contact, {late:?}");
    }
}
