//! Sensing, pure: detectors, which find an object in an image, and locators, which compute its position from the
//! detections of one or more cameras.
//!
//! Kinds: the [`detectors`] `color` and `cgp`, which are trained on images, `tag` and `onnx`; the [`locators`]
//! `triangulate`, `network`, `ensemble`, `calibrated`. A program must name this crate (`use mobee_sensing as _;`), or
//! the linker drops the registrations.
//!
//! Units: radians, meters, pixels, seconds; degrees and millimeters only in settings and recorded tables, named `_deg`
//! and `_mm`.

pub mod detectors;
pub mod learned_file;
pub mod locators;
