//! Settings of a simulated camera.

use super::film::FilmSettings;
use super::lens_settings::{LensSettings, size};
use super::scenery::{ScenerySettings, in_range};
use mobee_contract::{Intrinsics, KindError};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A camera on a simulated robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimulatedCameraSettings {
    /// Marker of the robot's model that the camera is attached to; it looks along the marker's normal.
    pub marker: String,
    /// Position relative to the marker, in the camera frame (x right, y down, z forward), m.
    #[serde(default)]
    pub offset_m: [f64; 3],
    /// Rotation about the camera's own x, y and z axis, deg.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    /// Width and height of its images, pixels.
    #[serde(default = "size")]
    pub size: [u32; 2],
    /// Projection of the camera.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub lens: LensSettings,
    /// Images per second.
    #[serde(default = "fps")]
    pub fps: f64,
    /// Exposure time, ms, which determines the motion blur.
    #[serde(default = "exposure_ms")]
    #[schemars(extend("expert" = true))]
    pub exposure_ms: f64,
    /// Standard deviation of the noise of each color of each pixel, of 255.
    #[serde(default = "noise")]
    #[schemars(extend("expert" = true))]
    pub noise: f64,
    /// Loss of light in the corners relative to the center, 0 to 1.
    #[serde(default = "vignetting")]
    pub vignetting: f64,
    /// Drift of red and blue within a minute, as a share of their strength.
    #[serde(default = "white_drift")]
    pub white_drift: f64,
    /// True if the lens is slightly defocused: each pixel is blurred with its neighbors.
    #[serde(default = "soft")]
    pub soft: bool,
    /// Surroundings of robots and objects.
    #[serde(default)]
    #[schemars(extend("expert" = true))]
    pub scenery: ScenerySettings,
}

fn fps() -> f64 {
    30.0
}
fn exposure_ms() -> f64 {
    10.0
}
fn noise() -> f64 {
    3.0
}
fn vignetting() -> f64 {
    0.25
}
fn white_drift() -> f64 {
    0.03
}
fn soft() -> bool {
    true
}

/// Greatest width and height of images, pixels.
const MAX_SIDE_PX: u32 = 4096;

impl SimulatedCameraSettings {
    /// Settings of a camera at this marker, with default values.
    pub fn at(marker: &str) -> SimulatedCameraSettings {
        SimulatedCameraSettings {
            marker: marker.into(),
            offset_m: [0.0; 3],
            rotation_deg: [0.0; 3],
            size: size(),
            lens: LensSettings::default(),
            fps: fps(),
            exposure_ms: exposure_ms(),
            noise: noise(),
            vignetting: vignetting(),
            white_drift: white_drift(),
            soft: soft(),
            scenery: ScenerySettings::default(),
        }
    }

    /// Same settings as an ideal camera: without noise, blur, vignetting and drift.
    pub fn ideal(self) -> SimulatedCameraSettings {
        SimulatedCameraSettings { exposure_ms: 0.0, noise: 0.0, vignetting: 0.0, white_drift: 0.0, soft: false, ..self }
    }

    /// Checks every setting.
    ///
    /// # Errors
    /// Invalid settings, with the valid ranges.
    pub fn validate(&self) -> Result<(), KindError> {
        let ([width, height], [ox, oy, oz], [rx, ry, rz]) = (self.size, self.offset_m, self.rotation_deg);
        let longest = f64::from(MAX_SIDE_PX);
        let ranges = [
            ("offset_m[0]", ox, -10.0, 10.0),
            ("offset_m[1]", oy, -10.0, 10.0),
            ("offset_m[2]", oz, -10.0, 10.0),
            ("rotation_deg[0]", rx, -360.0, 360.0),
            ("rotation_deg[1]", ry, -360.0, 360.0),
            ("rotation_deg[2]", rz, -360.0, 360.0),
            ("size[0]", f64::from(width), 8.0, longest),
            ("size[1]", f64::from(height), 8.0, longest),
            ("fps", self.fps, 0.01, 1000.0),
            ("exposure_ms", self.exposure_ms, 0.0, 1000.0),
            ("noise", self.noise, 0.0, 100.0),
            ("vignetting", self.vignetting, 0.0, 1.0),
            ("white_drift", self.white_drift, 0.0, 0.5),
        ];
        let mut checks: Vec<Result<(), KindError>> = ranges.into_iter().map(in_range).collect();
        checks.push(self.intrinsics().map(drop));
        checks.push(self.scenery.validate().map_err(|e| e.under("scenery")));
        KindError::gather(checks)?;
        Ok(())
    }

    /// Intrinsics of the camera.
    ///
    /// # Errors
    /// Invalid settings of the lens.
    pub fn intrinsics(&self) -> Result<Intrinsics, KindError> {
        self.lens.intrinsics(self.size).map_err(|e| e.under("lens"))
    }

    /// Time between two images.
    pub fn period(&self) -> Duration {
        Duration::try_from_secs_f64(1.0 / self.fps).unwrap_or(Duration::from_millis(33))
    }

    /// Settings of optics and sensor.
    pub(super) fn film(&self) -> FilmSettings {
        FilmSettings {
            noise: self.noise as f32,
            vignetting: self.vignetting as f32,
            drift: self.white_drift as f32,
            soft: self.soft,
        }
    }
}
