//! Plausibility of sizes and positions: implausible ones indicate a file in millimeters, or one that was scaled twice.

use super::document::{UrdfCollision, UrdfGeometry};
use super::grouped::Grouped;
use mobee_model::Mesh;
use mobee_text::{FileError, SourceText};
use nalgebra::Vector3;

/// Length of a shape, or distance of an origin, above which a warning is given, meters.
pub(super) const DOUBTED_LENGTH_M: f64 = 10.0;
/// Length of a shape below which a warning is given, meters.
const MIN_LENGTH_M: f64 = 0.005;
/// Ratio of a mesh's scales above which a warning is given.
const MAX_SCALE_RATIO: f64 = 100.0;

/// Findings about the shapes of all links.
#[derive(Debug, Default)]
pub(super) struct Sizes {
    /// Shapes that are too long.
    long: Grouped,
    /// Shapes that are too short.
    short: Grouped,
    /// Meshes that are scaled unevenly.
    uneven: Grouped,
}

impl Sizes {
    /// Checks a primitive shape.
    pub fn shape(&mut self, link: &str, collision: &UrdfCollision) {
        let longest = match &collision.geometry {
            UrdfGeometry::Box { size } => size.max(),
            UrdfGeometry::Sphere { radius } => 2.0 * radius,
            UrdfGeometry::Cylinder { radius, length } => length.max(2.0 * radius),
            UrdfGeometry::Capsule { radius, length } => length + 2.0 * radius,
            UrdfGeometry::Mesh { .. } => return,
        };
        self.judge(collision, longest, &format!("link `{link}`: a {}", collision.geometry.name()));
    }

    /// Checks a mesh; `scale` is the URDF's.
    pub fn mesh(&mut self, link: &str, collision: &UrdfCollision, (file, mesh): (&str, &Mesh), scale: &Vector3<f64>) {
        let far = |f: fn(f64, f64) -> f64, start: f64, i: usize| mesh.vertices.iter().map(|v| v[i]).fold(start, f);
        let size = |i| (far(f64::max, f64::NEG_INFINITY, i) - far(f64::min, f64::INFINITY, i)) * scale[i].abs();
        let longest = size(0).max(size(1)).max(size(2));
        self.judge(collision, longest, &format!("link `{link}`: the mesh {file}"));
        if scale.amax() > MAX_SCALE_RATIO * scale.amin() {
            self.uneven.add(&collision.at, format!("link `{link}` ({} {} {})", scale.x, scale.y, scale.z));
        }
    }

    fn judge(&mut self, collision: &UrdfCollision, longest: f64, what: &str) {
        if longest > DOUBTED_LENGTH_M {
            self.long.add(&collision.at, format!("{what} is {longest:.0} m long"));
        } else if longest < MIN_LENGTH_M {
            self.short.add(&collision.at, format!("{what} is {} mm long", short(longest * 1e3)));
        }
    }

    /// Adds warnings about all findings.
    pub fn warn(self, source: &SourceText, warnings: &mut Vec<FileError>) {
        let help =
            "lengths are in meters; if a mesh is in millimeters, write scale=\"0.001 0.001 0.001\" into its <mesh>";
        self.long.warn(source, "written in millimeters, perhaps", help, warnings);
        let help = "lengths are in meters: check sizes, and the scale of a <mesh>";
        self.short.warn(source, "too small to be a part of a robot, perhaps scaled twice", help, warnings);
        let help = "give a mesh the same scale along x, y and z";
        self.uneven.warn(source, "scaled by very different factors along the axes", help, warnings);
    }
}

/// Rounds a length to three significant digits.
fn short(mm: f64) -> f64 {
    format!("{mm:.2e}").parse().unwrap_or(mm)
}
