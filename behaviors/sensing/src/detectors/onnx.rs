//! An imported network, in a file in ONNX format. Its output is a class for each pixel, or boxes
//! around objects.
//!
//! ```text
//! frame ──stretched, scaled──> input ──network──> mask: one likelihood for each class ──cut──┐
//!                                             └─> boxes: place, score, class ──the best ones──┴──> regions
//! ```
//! In the program, each network runs in its own process (`process.rs`).

mod boxes;
mod kind;
mod mask;
mod network;
mod process;
mod settings;

pub use boxes::BoxOutput;
pub use kind::OnnxDetector;
pub use mask::MaskOutput;
pub use process::{serve, use_process};
pub use settings::*;
