//! Cameras: simulated ones, folders of images, and frames recorded in a run.
//!
//! ```text
//! truth (scene, poses) ──> solids in the camera frame ──look──> depth, owner ──light──> colors ──film──> Frame
//!                                     └────────────────look──> shadows of the lamp ──┘
//! ```

mod by_pose;
mod distractors;
mod eye;
mod film;
mod folder;
mod frames;
mod lens;
mod lens_settings;
mod light;
mod mount;
mod picture;
mod recorded;
mod room;
mod scenery;
mod settings;
mod shadow;
mod sight;
mod simulated;
mod solid;
mod sticker;
mod surface;
mod texture;

pub use by_pose::{CameraPlace, ObjectPlace, PoseLocator, PoseLocatorSettings};
pub use distractors::DistractorSettings;
pub use eye::{Owner, Shot, SimulatedEye};
pub use folder::{FolderCamera, FolderCameraSettings};
pub use frames::{FrameReader, KeptFrame, KeptFrames};
pub use lens::{project, unproject};
pub use lens_settings::{LensSettings, size};
pub use mount::Mount;
pub use recorded::{RecordedCamera, RecordedCameraSettings};
pub use scenery::{ScenerySettings, in_range};
pub use settings::SimulatedCameraSettings;
pub use simulated::SimulatedCamera;
pub use sticker::{BoxSide, StickerSettings};
