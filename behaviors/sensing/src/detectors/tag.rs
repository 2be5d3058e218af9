//! Printed tags: squares that encode their number. The corners determine the pose of a tag in the
//! camera frame in all six degrees of freedom. Tags are found by a port of the reference detector
//! (Olson, "AprilTag: A robust and flexible visual fiducial system", 2011).
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
