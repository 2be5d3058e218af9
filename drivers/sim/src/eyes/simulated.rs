//! The camera kind `simulated`: a camera on a simulated robot.

use super::eye::SimulatedEye;
use super::settings::SimulatedCameraSettings;
use mobee_contract::{Camera, CameraContext, CameraMount, Frame, Kind, KindError, Registered, Time, Truth, settings};
use nalgebra::Isometry3;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;

/// A camera that renders the ground truth.
pub struct SimulatedCamera {
    eye: SimulatedEye,
    period: Duration,
    truth: Arc<dyn Fn() -> Option<Truth> + Send + Sync>,
    /// Pose of the camera at the last image, and the time of that image.
    before: Option<(Isometry3<f64>, Time)>,
}

impl SimulatedCamera {
    /// Creates a camera on the context's robot.
    ///
    /// # Errors
    /// Settings that can't be used.
    pub fn new(settings: &SimulatedCameraSettings, context: &CameraContext) -> Result<SimulatedCamera, KindError> {
        let eye = SimulatedEye::new(settings, &context.robot, context.index, context.seed)?;
        Ok(SimulatedCamera { eye, period: settings.period(), truth: Arc::clone(&context.truth), before: None })
    }
}

impl Camera for SimulatedCamera {
    fn period(&self) -> Duration {
        self.period
    }

    fn frame(&mut self, now: Time) -> Result<Option<Frame>, String> {
        let Some(truth) = (self.truth)() else { return Ok(None) };
        let (frame, at) = self.eye.frame(&truth, self.before, now)?;
        self.before = Some((at, now));
        Ok(Some(frame))
    }

    fn is_simulated(&self) -> bool {
        true
    }

    fn mount(&self) -> Option<CameraMount> {
        Some(self.eye.mount())
    }
}

fn build(value: &Value, context: &CameraContext) -> Result<Box<dyn Camera>, KindError> {
    let settings: SimulatedCameraSettings = settings(value)?;
    Ok(Box::new(SimulatedCamera::new(&settings, context)?))
}

inventory::submit! {
    Registered(&Kind::<dyn Camera> {
        name: "simulated",
        doc: "A camera that a simulated robot carries. It sees robots and objects where they are in truth (not ghosts), in a room with \
              textures, a lamp, shadows, and things that resemble what is looked for; with lens distortion, motion blur, vignetting, a white \
              that drifts, and noise. Its own seed draws the noise; the scenery's draws the rest, so that several cameras see the same.",
        schema: || schemars::schema_for!(SimulatedCameraSettings),
        example: |robot| match robot.markers.first() {
            Some(marker) => Ok(json!({ "marker": marker.name })),
            None => Err("this robot has no marker that a camera could be at"),
        },
        build,
    })
}
