//! The camera kind `folder`: images of a folder, one after the other, as if a camera took them.

use super::lens_settings::LensSettings;
use super::scenery::in_range;
use mobee_contract::picture::{self, PictureFault};
use mobee_contract::{
    Camera, CameraContext, Frame, Intrinsics, Kind, KindError, Registered, SkippedPictures, Time, settings,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Duration;

/// A folder of images as a camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FolderCameraSettings {
    /// Folder of the images: its `.jpg`, `.jpeg` and `.png` files (except for masks, `_mask.png`) in the
    /// order of their names, all of one size.
    #[schemars(extend("format" = "path"))]
    pub path: PathBuf,
    /// Images per second.
    #[serde(default = "fps")]
    pub fps: f64,
    /// True if it starts again after the last image; otherwise it ends.
    #[serde(default)]
    pub repeat: bool,
    /// Projection of the camera that took them.
    #[serde(default)]
    pub lens: LensSettings,
}

fn fps() -> f64 {
    10.0
}

/// A camera that returns the images of a folder.
pub struct FolderCamera {
    files: Vec<PathBuf>,
    lens: Intrinsics,
    period: Duration,
    repeats: bool,
    /// Time of the first request, and the number of the next image.
    begun: Option<(Time, u64)>,
    skipped: Option<SkippedPictures>,
}

impl FolderCamera {
    /// Creates the camera of a folder whose images are all of one size. Each image is decoded when it is due.
    ///
    /// # Errors
    /// Invalid settings, a folder without images, a file that is not an image, or one of another size.
    pub fn new(settings: &FolderCameraSettings) -> Result<FolderCamera, KindError> {
        in_range(("fps", settings.fps, 0.01, 1000.0))?;
        let wrong = |e: PictureFault| KindError::new("path", e.to_string(), e.help);
        let files = picture::list_paths(&settings.path).map_err(wrong)?;
        let mut first = None;
        for file in &files {
            let found = picture::size(file).map_err(wrong)?;
            let size = *first.get_or_insert(found);
            if found != size {
                let ([w, h], [fw, fh]) = (found, size);
                let what = format!("this picture is {w}x{h} pixels, but those before it are {fw}x{fh}");
                return Err(wrong(PictureFault::new(file, what, "give a folder of pictures of one size")));
            }
        }
        let lens = settings.lens.intrinsics(first.unwrap_or_default()).map_err(|e| e.under("lens"))?;
        let period = Duration::try_from_secs_f64(1.0 / settings.fps).unwrap_or(Duration::from_millis(100));
        Ok(FolderCamera { files, lens, period, repeats: settings.repeat, begun: None, skipped: None })
    }
}

impl Camera for FolderCamera {
    fn period(&self) -> Duration {
        self.period
    }

    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        let (begun, next) = *self.begun.get_or_insert((now, 0));
        // a late request gets the newest image
        let due = (now.since(begun).as_nanos() / self.period.as_nanos().max(1)) as u64;
        if due < next {
            return Ok(None);
        }
        self.begun = Some((begun, due + 1));
        let count = self.files.len() as u64;
        let number = if self.repeats { due % count.max(1) } else { due };
        let Some(file) = usize::try_from(number).ok().and_then(|n| self.files.get(n)) else { return Ok(None) };
        let [width, height] = self.lens.size;
        let read = picture::read(file).and_then(|picture| match picture.dimensions() == (width, height) {
            true => Ok(picture),
            false => Err(PictureFault::new(file, "it is of another size than when the run began", "")),
        });
        let picture = match read {
            Ok(picture) => picture,
            Err(fault) => {
                SkippedPictures::add(&mut self.skipped, fault.to_string());
                return Ok(None);
            }
        };
        let exposed = begun + Duration::from_nanos(self.period.as_nanos() as u64 * due);
        Ok(Some(Frame { exposed, intrinsics: self.lens, pixels: picture.into_raw().into() }))
    }

    fn skipped(&mut self) -> Option<SkippedPictures> {
        self.skipped.take()
    }
}

fn build(value: &Value, _: &CameraContext) -> Result<Box<dyn Camera>, KindError> {
    let settings: FolderCameraSettings = settings(value)?;
    Ok(Box::new(FolderCamera::new(&settings)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Camera> {
        name: "folder",
        doc: "The pictures of a folder in the order of their names, as if a camera took them now: recorded ones, to try detectors on. \
              Who asks too rarely misses some.",
        schema: || schemars::schema_for!(FolderCameraSettings),
        example: |_| Ok(json!({ "path": "pictures", "fps": 10.0 })),
        build,
    })
}
