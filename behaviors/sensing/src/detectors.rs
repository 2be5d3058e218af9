//! Detectors: those trained on images with masks, each of which finds one object; printed tags
//! ([`tag`]); and imported networks ([`onnx`]).
//!
//! ```text
//! NAME.jpg, NAME_mask.png ──read_folder──> LabeledPicture ──train──> DetectorFile (JSON) ──> LearnedDetector: Frame ──> regions
//!
//! image ──shrunk──> color likelihood ──(cgp: + features ──> network; + channels ──> program)──> smoothed ──> threshold, opening,
//!                                                                          connected components ──> mask, Blob
//! ```
//!
//! The kind `color` uses the likelihood of each color. The kind `cgp` adds the output of a small
//! network on the surroundings of each pixel, and an evolved image program ([`cgp`]). Its
//! inputs are the color channels and both of these.
//!
//! Each detector finds a single object. No position in the image is ever a feature: in later frames
//! the object is elsewhere.

pub mod cgp;
pub mod color;
pub mod features;
pub mod file;
pub mod kinds;
mod mask_file;
pub mod onnx;
pub mod picture;
pub mod pixels;
pub mod plane;
pub mod regions;
pub mod score;
pub mod tag;
pub mod train;

#[cfg(test)]
mod tests;
