//! What `mobee ctl record` acts on while a run goes on: the switch of the recording, and viewers that come later.

use super::sinks::VIEWER;
use mobee_actors::record::tap::{OpenSink, Taps};
use mobee_recorder::{Recorder, Settings};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// How long a viewer may take for an answer.
const PATIENCE: Duration = Duration::from_secs(3);

/// How a run is recorded and looked at.
pub(crate) struct Recording {
    /// Whether the recorder writes.
    pub(super) on: Arc<AtomicBool>,
    /// Whether there is a recorder.
    makes_file: bool,
    /// What the run tells, and how a viewer is told; there once it has started.
    viewer: OnceLock<(Taps, Settings)>,
}

impl Recording {
    pub(super) fn new(makes_file: bool) -> Recording {
        Recording { on: Arc::new(AtomicBool::new(true)), makes_file, viewer: OnceLock::new() }
    }

    /// From now on viewers can come.
    pub(super) fn open(&self, taps: Taps, settings: Settings) {
        let _ = self.viewer.set((taps, settings));
    }

    /// Switches the recording on or off; a viewer goes on.
    ///
    /// # Errors
    /// If there is none.
    pub(crate) fn switch(&self, on: bool) -> Result<(), String> {
        if !self.makes_file {
            return Err("this run makes no recording; start it without --no-record".into());
        }
        self.on.store(on, Ordering::SeqCst);
        Ok(())
    }

    /// Lets a viewer follow from now on, in place of the one that did. Waits for its answer for a while.
    ///
    /// # Errors
    /// If nobody is there, or it is no viewer.
    pub(crate) fn connect(&self, address: SocketAddr) -> Result<(), String> {
        let (taps, settings) = self.viewer.get().ok_or("the run is about to start; try again")?;
        let help = format!("start one with `rerun --port {}`, or give the address of one", address.port());
        TcpStream::connect_timeout(&address, PATIENCE)
            .map_err(|e| format!("there is no viewer at {address}: {e}; {help}"))?;
        let settings = Settings { live: Some(address.to_string()), ..settings.clone() };
        let open = move || Recorder::new(&settings).map_err(|e| e.to_string());
        let viewer = open()?;
        viewer.reach(PATIENCE).map_err(|e| format!("the program at {address} is not a viewer: {e}; {help}"))?;
        let again: OpenSink = Arc::new(move || Ok(Box::new(open()?)));
        taps.attach(VIEWER, Box::new(viewer), again)
    }
}
