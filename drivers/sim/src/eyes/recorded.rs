//! The camera kind `recorded`, which replays the frames of a camera in an earlier run.

use super::frames::{FrameReader, KeptFrame};
use super::mount::Mount;
use mobee_contract::{
    Camera, CameraContext, CameraMount, Frame, Kind, KindError, Registered, SkippedPictures, Time, settings,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Duration;

/// Slowest and fastest rate of requests, as periods.
const SLOWEST: Duration = Duration::from_secs(1);
const FASTEST: Duration = Duration::from_millis(1);

/// A camera of a run that recorded its frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RecordedCameraSettings {
    /// Folder of the run, relative to the configuration file. Its sensor had `keep_frames = true`.
    #[schemars(extend("format" = "path"))]
    pub run: PathBuf,
    /// Name of the camera in that run: `SENSOR/CAMERA`.
    pub camera: String,
    /// True if it starts again after the last frame; otherwise it ends.
    #[serde(default)]
    pub repeat: bool,
    /// Marker of the robot's model that the camera is attached to, looking along its normal. Used by the
    /// recording only; locators ignore it.
    #[serde(default)]
    pub marker: Option<String>,
}

/// A camera that replays the frames of another one, each at its exposure time relative to the start of the
/// run.
pub struct RecordedCamera {
    reader: FrameReader,
    /// First frame that is not due yet.
    next: Option<KeptFrame>,
    repeats: bool,
    mount: Option<CameraMount>,
    /// Delay relative to the run: zero until the first repetition.
    later: Duration,
    /// Number of damaged places of the file that were logged.
    logged: usize,
    /// Last two exposure times.
    last: [Time; 2],
    /// Time until the next frame.
    wait: Duration,
    skipped: Option<SkippedPictures>,
}

impl RecordedCamera {
    /// Creates the camera of a recorded run. Each frame is decoded when it is due.
    ///
    /// # Errors
    /// A folder without frames, a camera that is not among them, or a file whose first frame is damaged.
    pub fn new(settings: &RecordedCameraSettings) -> Result<RecordedCamera, KindError> {
        let mut reader = FrameReader::open(&settings.run, &settings.camera)?;
        let wrong = |what| KindError::new("run", what, "give a run that kept frames of this camera");
        let first = reader.next_frame().map_err(wrong)?;
        let first = first.ok_or_else(|| wrong(format!("{} saw nothing in that run", settings.camera)))?;
        reader.frame(&first).map_err(wrong)?;
        let mut camera = RecordedCamera {
            reader,
            next: Some(first),
            repeats: settings.repeat,
            mount: None,
            later: Duration::ZERO,
            logged: 0,
            last: [Time::ZERO; 2],
            wait: Duration::ZERO,
            skipped: None,
        };
        camera.wait = camera.wait_from(Time::ZERO);
        Ok(camera)
    }

    /// Next frame that is due.
    fn due(&mut self, now: Time) -> Result<Option<KeptFrame>, String> {
        let Some(next) = self.next.filter(|next| next.exposed + self.later <= now) else { return Ok(None) };
        let given = next.later(self.later);
        self.last = [self.last[1], next.exposed];
        self.next = self.read_on()?;
        if self.next.is_none() && self.repeats {
            self.begin_anew(now)?;
        }
        Ok(Some(given))
    }

    /// Next frame of the file. Damage before it is logged.
    fn read_on(&mut self) -> Result<Option<KeptFrame>, String> {
        let next = self.reader.next_frame()?;
        let damage = self.reader.damage();
        damage.get(self.logged..).unwrap_or_default().iter().for_each(|what| tracing::warn!("{what}"));
        self.logged = self.logged.max(damage.len());
        Ok(next)
    }

    /// Restarts at the first frame, after the interval between the last two frames, or after a second if
    /// there was only one.
    fn begin_anew(&mut self, now: Time) -> Result<(), String> {
        let [before, last] = self.last;
        let interval = Some(last.since(before)).filter(|interval| !interval.is_zero()).unwrap_or(SLOWEST);
        let length = last.since(Time::ZERO) + interval.max(FASTEST);
        // skips the repetitions that a late request has missed
        let missed = now.since(Time::ZERO).saturating_sub(self.later).as_nanos() / length.as_nanos().max(1);
        self.later = self.later.saturating_add(length.saturating_mul(u32::try_from(missed.max(1)).unwrap_or(u32::MAX)));
        self.reader.rewind();
        self.next = self.read_on()?;
        Ok(())
    }

    fn wait_from(&self, now: Time) -> Duration {
        self.next.map_or(SLOWEST, |next| (next.exposed + self.later).since(now)).clamp(FASTEST, SLOWEST)
    }
}

impl Camera for RecordedCamera {
    fn period(&self) -> Duration {
        self.wait
    }

    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        let mut newest = None;
        // a late request gets the newest frame
        loop {
            match self.due(now) {
                Ok(Some(frame)) => newest = Some(frame),
                Ok(None) => break,
                Err(why) => {
                    // frames behind an unreadable head can't be found
                    SkippedPictures::add(&mut self.skipped, why);
                    self.next = None;
                    break;
                }
            }
        }
        self.wait = self.wait_from(now);
        let Some(newest) = newest else { return Ok(None) };
        match self.reader.frame(&newest) {
            Ok(frame) => Ok(Some(frame)),
            Err(why) => {
                SkippedPictures::add(&mut self.skipped, why);
                Ok(None)
            }
        }
    }

    fn skipped(&mut self) -> Option<SkippedPictures> {
        self.skipped.take()
    }

    fn mount(&self) -> Option<CameraMount> {
        self.mount.clone()
    }
}

fn build(value: &Value, context: &CameraContext) -> Result<Box<dyn Camera>, KindError> {
    let settings: RecordedCameraSettings = settings(value)?;
    let mount = settings.marker.as_ref().map(|marker| Mount::new(&context.robot, marker, [0.0; 3], [0.0; 3]));
    let mount = mount.transpose()?.map(|mount| mount.to_contract(context.index));
    Ok(Box::new(RecordedCamera { mount, ..RecordedCamera::new(&settings)? }))
}

inventory::submit! {
    Registered(&Kind::<dyn Camera> {
        name: "recorded",
        doc: "What a camera saw in a run that kept its frames (`keep_frames = true`), each frame as long after the beginning as it was exposed then. \
              With the robot as the driver `replay` plays it, another detector or locator looks at the same again. Who asks too rarely misses some.",
        schema: || schemars::schema_for!(RecordedCameraSettings),
        example: |_| Ok(json!({ "run": "runs/look", "camera": "eyes/left" })),
        build,
    })
}
