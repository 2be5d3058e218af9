//! The camera `my_arm_camera`: pictures of your own device. Here they are drawn.

use mobee_contract::{Camera, CameraContext, Frame, Intrinsics, Kind, KindError, Registered, Time, settings};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Value, json};
use std::time::Duration;

/// Width and height, pixels.
const SIZE_PX: [u32; 2] = [160, 120];
/// Focal length, pixels.
const FOCAL_PX: f64 = 150.0;

/// Its settings in the behavior file.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Frames per second, 1 to 100.
    pub fps: f64,
}

impl Default for CameraSettings {
    fn default() -> CameraSettings {
        CameraSettings { fps: 10.0 }
    }
}

/// A camera that draws a gray ramp.
pub struct RampCamera {
    period: Duration,
    next: Option<Time>,
}

impl Camera for RampCamera {
    fn period(&self) -> Duration {
        self.period
    }

    // Does not wait: a device that blocks is read by a thread of its own, and this returns the newest frame of that thread.
    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        if self.next.is_some_and(|next| now < next) {
            return Ok(None);
        }
        self.next = Some(now + self.period);
        let [width, height] = SIZE_PX;
        let row = (0..width).flat_map(|x| [(x * 255 / width) as u8; 3]);
        let pixels: Vec<u8> = (0..height).flat_map(|_| row.clone()).collect();
        let center = SIZE_PX.map(|n| f64::from(n) / 2.0);
        let intrinsics = Intrinsics { size: SIZE_PX, focal: [FOCAL_PX; 2], center, distortion: [0.0; 4] };
        Ok(Some(Frame { exposed: now, intrinsics, pixels: pixels.into() }))
    }
}

fn build(value: &Value, _context: &CameraContext) -> Result<Box<dyn Camera>, KindError> {
    let s: CameraSettings = settings(value)?;
    if !(1.0..=100.0).contains(&s.fps) {
        return Err(KindError::new("fps", format!("{} frames per second are not possible", s.fps), "give 1 to 100"));
    }
    Ok(Box::new(RampCamera { period: Duration::from_secs_f64(1.0 / s.fps), next: None }))
}

inventory::submit! {
    Registered(&Kind::<dyn Camera> {
        name: "my_arm_camera",
        doc: "Draws a gray ramp.",
        schema: || schemars::schema_for!(CameraSettings),
        example: |_| Ok(json!({ "fps": 10.0 })),
        build,
    })
}
