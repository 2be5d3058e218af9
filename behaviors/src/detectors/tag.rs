//! Tags that a printer makes: squares that tell who they are, and by their corners where they are before the camera, in all six degrees
//! of freedom. Found by a port of the reference detector (Olson, "AprilTag: A robust and flexible visual fiducial system", 2011).
//!
//! ```text
//! frame ──gray──> quads, codes ──id──> object; corners ──lens──> pose and covariance ──> Region
//! ```

mod family;
mod kind;
mod pose;
mod read;
mod seek;

pub use family::TagFamilyName;
pub use kind::{TagDetector, TagDetectorSettings, TagSettings};
pub use pose::pose_of_square;
pub use seek::{SeenTag, TagSeeker};
