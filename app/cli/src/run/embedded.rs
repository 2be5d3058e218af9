//! Runs for a program that embeds this library: without terminal and signals.

use super::{CtlAt, Done, Extras, Folder, Recording, attach_ctl, disk_space, resource_limits, run_with};
use crate::ctl::StopConnections;
use miette::Report;
use mobee_compose::Composition;
use mobee_compose::config::ClockMode;
use mobee_runtime::system::Control;
use mobee_runtime::tap::{OpenSink, Pictures, SinkSpec};
use std::path::Path;
use std::sync::Arc;
use tokio::sync::mpsc;

/// Capacity of a sink that must receive each event at once: its thread wakes when half of it is full, and otherwise collects for 20 ms.
const PROMPT_CAPACITY: usize = 2;

/// A sink for the events of an embedded run in virtual time, on a thread of its own. It receives each event at once, and the run waits for it.
pub fn event_sink(name: &str, open: OpenSink) -> SinkSpec {
    SinkSpec {
        pictures: Pictures::None,
        name: name.into(),
        essential: false,
        poses: None,
        capacity: PROMPT_CAPACITY,
        patience: super::WRITE_TIMEOUT,
        open: Some(open),
    }
}

/// Runs a composition as `mobee run` does, into `out` or a new folder below `runs/`. By a real clock `mobee ctl` reaches it in its folder.
///
/// # Errors
/// If there is too little room, the folder, the journal or the recording can't be opened, or the system can't be started.
pub fn embedded(
    mut composition: Composition,
    out: Option<&Path>,
    sinks: Vec<SinkSpec>,
    (controls, receiver): (mpsc::Sender<Control>, mpsc::Receiver<Control>),
) -> Result<(Folder, Done), Report> {
    disk_space::check(out)?;
    let live = composition.config.clock == ClockMode::Real;
    resource_limits::check(&composition.config, if live { CtlAt::Folder } else { CtlAt::Off })?;
    let folder = Folder::create(&composition.config.name, out)?;
    let recording = Arc::new(Recording::new(composition.config.record.enabled));
    let mut extras = Extras { sinks, ..Extras::default() };
    let stop_connections = StopConnections::default();
    if live {
        attach_ctl(&mut composition, &mut extras, &folder, None, (controls, &recording, &stop_connections));
    }
    extras.recording = Some(recording);
    let done = run_with(composition, &folder, extras, receiver, |_| ())?;
    stop_connections.close();
    Ok((folder, done))
}
