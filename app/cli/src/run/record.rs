//! State behind `mobee ctl record`: the switch of the recording, and viewers that connect during the run.

use super::sinks::VIEWER;
use mobee_recorder::{Recorder, Settings};
use mobee_runtime::tap::{OpenSink, Taps};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

/// Time within which a viewer must answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(3);

/// The recorder's switch and the access to a viewer.
pub(crate) struct Recording {
    /// True while the recorder writes.
    pub(super) on: Arc<AtomicBool>,
    /// True if the run has a recorder.
    makes_file: bool,
    /// The run's taps, and the settings of a viewer's recorder; set once the run has started.
    viewer: OnceLock<(Taps, Settings)>,
}

impl Recording {
    pub(super) fn new(makes_file: bool) -> Recording {
        Recording { on: Arc::new(AtomicBool::new(true)), makes_file, viewer: OnceLock::new() }
    }

    /// Allows viewers from now on.
    pub(super) fn open(&self, taps: Taps, settings: Settings) {
        let _ = self.viewer.set((taps, settings));
    }

    /// Switches the recording on or off. Does not affect a viewer.
    ///
    /// # Errors
    /// If the run has no recorder.
    pub(crate) fn switch(&self, on: bool) -> Result<(), String> {
        if !self.makes_file {
            return Err("this run makes no recording; start it without --no-record".into());
        }
        self.on.store(on, Ordering::SeqCst);
        Ok(())
    }

    /// Connects a viewer in place of the present one. Waits up to [`ANSWER_TIMEOUT`] for its answer.
    ///
    /// # Errors
    /// If nothing listens at the address, or it is not a viewer.
    pub(crate) fn connect(&self, address: SocketAddr) -> Result<(), String> {
        let (taps, settings) = self.viewer.get().ok_or("the run is about to start; try again")?;
        let help = format!("start one with `rerun --port {}`, or give the address of one", address.port());
        TcpStream::connect_timeout(&address, ANSWER_TIMEOUT)
            .map_err(|e| format!("there is no viewer at {address}: {e}; {help}"))?;
        let settings = Settings { live: Some(address.to_string()), ..settings.clone() };
        let open = move || Recorder::new(&settings).map_err(|e| e.to_string());
        let viewer = open()?;
        viewer.reach(ANSWER_TIMEOUT).map_err(|e| format!("the program at {address} is not a viewer: {e}; {help}"))?;
        let again: OpenSink = Arc::new(move || Ok(Box::new(open()?)));
        taps.attach(VIEWER, Box::new(viewer), again)
    }
}
