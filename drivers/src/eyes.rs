//! Cameras: simulated ones.
//!
//! ```text
//! truth (scene, poses) ──> solids in the eye's frame ──look──> depth, owner ──light──> colors ──film──> Frame
//!                                     └──────────────look──> shadows of the lamp ──┘
//! ```

mod distractors;
mod eye;
mod film;
mod lens;
mod light;
mod mount;
mod picture;
mod room;
mod scenery;
mod settings;
mod shadow;
mod sight;
mod simulated;
mod solid;
mod surface;
mod texture;

pub use distractors::DistractorSettings;
pub use eye::{Eye, Owner, Shot};
pub use lens::{project, unproject};
pub use scenery::ScenerySettings;
pub use settings::SimulatedCameraSettings;
pub use simulated::SimulatedCamera;
