//! Settings of a camera's projection.

use super::scenery::in_range;
use mobee_contract::{Intrinsics, KindError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Focal length of the iCub simulator per pixel of height: 1 / (2 tan 25 deg).
const FOCAL: f64 = 1.072_253_5;

/// Default size of images, pixels: the most common one of the iCub's cameras.
pub fn size() -> [u32; 2] {
    [320, 240]
}

/// Projection of a camera: a pinhole with lens distortion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LensSettings {
    /// Focal lengths across and down, pixels; default: 50 degrees from top to bottom, as in the iCub
    /// simulator.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal: Option<[f64; 2]>,
    /// Position of the optical axis in the image, pixels from its upper left corner; default: the center.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center: Option<[f64; 2]>,
    /// Distortion of the lens: k1, k2, p1, p2 as in OpenCV.
    pub distortion: [f64; 4],
}

impl LensSettings {
    /// Intrinsics for images of this size.
    ///
    /// # Errors
    /// Invalid settings, with the valid ranges.
    pub fn intrinsics(&self, size: [u32; 2]) -> Result<Intrinsics, KindError> {
        let [width, height] = size.map(f64::from);
        let focal = self.focal.unwrap_or([FOCAL * height; 2]);
        let center = self.center.unwrap_or([width / 2.0, height / 2.0]);
        let ([fx, fy], [cx, cy], [k1, k2, p1, p2]) = (focal, center, self.distortion);
        let ranges = [
            ("focal[0]", fx, 1.0, 1e5),
            ("focal[1]", fy, 1.0, 1e5),
            ("center[0]", cx, -width, 2.0 * width),
            ("center[1]", cy, -height, 2.0 * height),
            ("distortion[0]", k1, -10.0, 10.0),
            ("distortion[1]", k2, -10.0, 10.0),
            ("distortion[2]", p1, -1.0, 1.0),
            ("distortion[3]", p2, -1.0, 1.0),
        ];
        KindError::gather(ranges.map(in_range))?;
        Ok(Intrinsics { size, focal, center, distortion: self.distortion })
    }
}
