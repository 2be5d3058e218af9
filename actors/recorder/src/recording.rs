//! A recording that is being written: one file or one viewer, and the shared state of the recorders that draw
//! into it.

use crate::blueprint::{self, Page};
use crate::body::entity;
use crate::disk::{Disk, DiskTrouble};
use crate::legend;
use crate::recorder::Recorder;
use crate::roadmap::DrawnPose;
use crate::stream::{EntityStream, Written};
use mobee_model::{Object, Robot};
use rerun::external::arrow::array::StringArray;
use rerun::log::ChunkBatcherConfig;
use rerun::sink::SinkFlushError;
use rerun::{AnyValues, RecordingStream, RecordingStreamBuilder, TextDocument, ViewCoordinates};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Real time after which buffered frames are sent, so that a killed run loses no more.
pub(crate) const SEND_INTERVAL: Duration = Duration::from_secs(1);
/// Longest wait for a flush. A timeout is not an error: a slow viewer may still catch up.
const FLUSH_TIMEOUT: Duration = Duration::from_secs(1);
/// Bytes that Rerun may buffer for a slow disk or viewer before its caller must wait.
const MAX_BYTES_IN_FLIGHT: u64 = 16 << 20;

/// Name and destination of a recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Settings {
    /// Path of the file, usually `recording.rrd` in the run's folder.
    pub path: PathBuf,
    /// Name of the run, shown in the viewer.
    pub name: String,
    /// Name of the configuration file, stored as a property.
    pub config: String,
    /// Version and build of the program, stored as a property.
    pub build: String,
    /// Address of a live viewer, such as `127.0.0.1:9876`: it receives the data instead of the file.
    pub live: Option<String>,
    /// True if the file gets an index at its end. The index takes memory while the file is written (tens of
    /// megabytes per hour). Files without one are read completely.
    pub index: bool,
    /// Names of poses: a vertex of a roadmap at one of them is labeled with it.
    pub names: Vec<PoseName>,
    /// Objects that only the simulated world has, and no scene; shown in a color of their own.
    pub unknown: Vec<Object>,
}

/// A named pose of a robot.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PoseName {
    /// Name of the robot in the run.
    pub robot: String,
    /// Name of the pose.
    pub name: String,
    /// Positions of motors, degrees (millimeters for prismatic joints); the others are at home.
    pub q_deg: BTreeMap<String, f64>,
}

/// Error at the start of a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// The file can't be written.
    #[error(
        "the recording {path} can't be begun: {why}; check that the folder exists and can be written, or run with `--no-record`"
    )]
    File {
        /// Path of the file.
        path: String,
        /// Reason.
        why: String,
    },
    /// The viewer's address is invalid.
    #[error("the viewer {address} can't be connected: {why}; start it with `rerun` and give its address")]
    Live {
        /// Address of the viewer.
        address: String,
        /// Reason.
        why: String,
    },
}

/// A recording that is being written: one file, into which several recorders can draw side by side.
#[derive(Clone)]
pub struct Recording {
    rec: RecordingStream,
    /// Pages of the recorders, in the order in which they started.
    pages: Arc<Mutex<Vec<Page>>>,
    is_live: bool,
    names: Arc<[PoseName]>,
    /// Objects that no scene has.
    pub(crate) unknown: Arc<[Object]>,
    /// Error that ended the writing of the file.
    trouble: DiskTrouble,
}

impl Recording {
    /// Starts a recording.
    ///
    /// # Errors
    /// [`RecorderError`] if the file or the viewer can't be opened.
    pub fn begin(settings: &Settings) -> Result<Recording, RecorderError> {
        let file = |why: &dyn std::fmt::Display| RecorderError::File {
            path: settings.path.display().to_string(),
            why: why.to_string(),
        };
        // Each chunk has a cost; only a live viewer needs them immediately.
        let flush_tick = if settings.live.is_some() { ChunkBatcherConfig::DEFAULT.flush_tick } else { SEND_INTERVAL };
        let max_bytes_in_flight = MAX_BYTES_IN_FLIGHT;
        let builder = RecordingStreamBuilder::new("mobee")
            .recording_name(settings.name.clone())
            .batcher_config(ChunkBatcherConfig { flush_tick, max_bytes_in_flight, ..ChunkBatcherConfig::DEFAULT });
        let rec = builder.buffered().map_err(|e| file(&e))?;
        let mut trouble = DiskTrouble::default();
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
        let names = settings.names.clone().into();
        let unknown = settings.unknown.clone().into();
        Ok(Recording { rec, pages: Arc::default(), is_live: settings.live.is_some(), names, unknown, trouble })
    }

    /// Creates a recorder that draws below the entity `name`, or at the root if that is empty, as for the only
    /// recorder.
    ///
    /// # Errors
    /// As a message, if the stream refuses.
    pub fn recorder(&self, name: &str) -> Result<Recorder, String> {
        let root = if name.is_empty() { String::new() } else { format!("{}/", entity(name)) };
        Ok(Recorder::on(self.clone(), self.stream(root, legend::TEXT)?))
    }

    /// Creates a stream into the recording, which begins with the world's axes and a legend.
    pub(crate) fn stream(&self, root: String, legend: &str) -> Result<EntityStream, String> {
        let stream = EntityStream { rec: self.rec.clone(), root };
        stream.log_static("world", &ViewCoordinates::RIGHT_HAND_Z_UP())?;
        stream.log_static("about", &TextDocument::from_markdown(legend))?;
        Ok(stream)
    }

    /// Shows the present page of a recorder, beside those of the others.
    pub(crate) fn lay_out(&self, page: Page) -> Written {
        let mut pages = self.pages.lock().unwrap_or_else(PoisonError::into_inner);
        match pages.iter_mut().find(|p| p.root == page.root) {
            Some(known) => *known = page,
            None => pages.push(page),
        }
        blueprint::send(&self.rec, &pages)
    }

    /// The named poses of a robot, and its home. A name with motors that the robot does not have is skipped.
    pub(crate) fn named(&self, robot: &Robot) -> Vec<DrawnPose> {
        let pose = |name: &PoseName| {
            let mut q = robot.home();
            for (motor, deg) in &name.q_deg {
                *q.get_mut(robot.motor_index(motor)?)? = deg.to_radians();
            }
            Some(DrawnPose { name: name.name.clone(), q })
        };
        let given = self.names.iter().filter(|name| name.robot == robot.name).filter_map(pose);
        given.chain([DrawnPose { name: "home".to_owned(), q: robot.home() }]).collect()
    }

    /// Writes a property of the whole recording.
    pub(crate) fn property(&self, name: &'static str, value: &str) -> Written {
        property(&self.rec, name, value)
    }

    /// Error if the file can no longer be written.
    pub(crate) fn check(&self) -> Written {
        self.trouble.get().map_or(Ok(()), |why| Err(unwritable(why)))
    }

    /// Waits until all data that was sent is written.
    pub(crate) fn reach(&self, within: Duration) -> Written {
        self.rec.flush_with_timeout(within).map_err(|e| e.to_string())
    }

    /// Writes the buffered data, for a limited time; a slow viewer may catch up later.
    pub(crate) fn flush(&self) -> Written {
        match self.rec.flush_with_timeout(FLUSH_TIMEOUT) {
            Ok(()) | Err(SinkFlushError::Timeout) => Ok(()),
            Err(e) if self.is_live => Err(format!("the viewer is not reached: {e}")),
            Err(e) => Err(unwritable(&e.to_string())),
        }
    }
}

fn unwritable(why: &str) -> String {
    format!("the recording can't be written: {why}; make room on the disk")
}

fn property(rec: &RecordingStream, name: &'static str, value: &str) -> Written {
    let array = Arc::new(StringArray::from(vec![value]));
    let values = AnyValues::default().with_component_from_data(name, array);
    rec.send_property(name, &values).map_err(|e| crate::stream::in_words(name, &e))
}
