//! Detectors: those that learn from pictures with masks where in a frame is the one object that they know; printed tags ([`tag`]); and
//! networks of others ([`onnx`]).
//!
//! ```text
//! NAME.jpg, NAME_mask.png ──read_folder──> LabeledPicture ──train──> DetectorFile (JSON) ──> LearnedDetector: Frame ──> regions
//!
//! picture ──shrunk──> color likelihood ──(cgp: + features ──> network; + channels ──> program)──> smoothed ──> threshold, opening,
//!                                                                            connected components ──> mask, Blob
//! ```
//!
//! The kind `color` knows how likely each color is the object's. The kind `cgp` adds what a small network makes of the
//! surroundings of each pixel, and an evolved image program ([`cgp`]) that sees both beside the colors.
//!
//! A single object is looked for, and nothing about *where* in a picture it was is learned: later frames show it elsewhere.

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
