//! Locator of objects whose pose a detector has estimated in all six degrees of freedom, with one camera at a
//! given place on the robot.

use super::mount::Mount;
use super::scenery::in_range;
use mobee_contract::*;
use mobee_model::Robot;
use nalgebra::{Isometry3, Matrix3, Matrix3x6, Matrix6, Quaternion, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// Settings of the kind `pose`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseLocatorSettings {
    /// Places of the cameras.
    pub cameras: Vec<CameraPlace>,
    /// Origins of the objects relative to what is detected; default: the detection is at the object's own
    /// origin.
    #[serde(default)]
    pub objects: Vec<ObjectPlace>,
    /// Standard deviation of a camera's position, mm.
    #[serde(default = "place_mm")]
    #[schemars(extend("expert" = true))]
    pub place_mm: f64,
    /// Standard deviation of its viewing direction, deg.
    #[serde(default = "look_deg")]
    #[schemars(extend("expert" = true))]
    pub look_deg: f64,
}

/// Place of a camera on the robot, as for the camera kind `simulated`.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CameraPlace {
    /// Name of the camera, or the end of its name.
    pub name: String,
    /// Marker of the robot's model that the camera is attached to; it looks along the marker's normal.
    pub marker: String,
    /// Position relative to the marker, in the camera frame (x right, y down, z forward), m.
    #[serde(default)]
    pub offset_m: [f64; 3],
    /// Rotation about the camera's own x, y and z axis, deg.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
}

/// Position of an object relative to the tag on it.
#[derive(Clone, Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ObjectPlace {
    /// Name of the object in the world.
    pub object: String,
    /// Origin of the object in the tag frame (x right and y down as printed, z into the tag), m.
    pub origin_m: [f64; 3],
}

fn place_mm() -> f64 {
    2.0
}
fn look_deg() -> f64 {
    0.3
}

/// Locates objects that were detected with their poses.
pub struct PoseLocator {
    robot: Arc<Robot>,
    /// End of a camera's name, and the camera's mount.
    cameras: Vec<(String, Mount)>,
    settings: PoseLocatorSettings,
}

impl PoseLocator {
    /// Creates the locator for a robot.
    ///
    /// # Errors
    /// Invalid settings, and markers that the robot does not have.
    pub fn new(settings: PoseLocatorSettings, robot: Arc<Robot>) -> Result<PoseLocator, KindError> {
        if settings.cameras.is_empty() {
            let help = "say where they are: cameras = [{ name = \"left\", marker = \"l_eye\" }]";
            return Err(KindError::new("cameras", "without a camera nothing is seen", help));
        }
        in_range(("place_mm", settings.place_mm, 0.0, 1000.0))?;
        in_range(("look_deg", settings.look_deg, 0.0, 90.0))?;
        for (k, object) in settings.objects.iter().enumerate() {
            let ranges = object.origin_m.map(|n| ("origin_m", n, -10.0, 10.0));
            KindError::gather(ranges.map(in_range)).map_err(|e| e.under(&format!("objects[{k}]")))?;
        }
        let place = |(k, c): (usize, &CameraPlace)| {
            let numbers = c.offset_m.map(|n| ("offset_m", n, -10.0, 10.0)).into_iter();
            let numbers = numbers.chain(c.rotation_deg.map(|n| ("rotation_deg", n, -360.0, 360.0)));
            KindError::gather(numbers.map(in_range)).map_err(|e| e.under(&format!("cameras[{k}]")))?;
            let mount = Mount::new(&robot, &c.marker, c.offset_m, c.rotation_deg);
            mount.map(|m| (c.name.clone(), m)).map_err(|e| e.under(&format!("cameras[{k}]")))
        };
        let cameras = KindError::gather(settings.cameras.iter().enumerate().map(place))?;
        Ok(PoseLocator { robot, cameras, settings })
    }

    fn place(&self, sighting: &Sighting, frames: &[Isometry3<f64>]) -> Option<Located> {
        let seen = sighting.region.pose.as_ref()?;
        let (_, mount) = self.cameras.iter().find(|(name, _)| sighting.camera.ends_with(name.as_str()))?;
        let camera = mount.at(frames)?;
        let object = &sighting.region.object;
        let origin = self.settings.objects.iter().find(|o| o.object == *object).map_or([0.0; 3], |o| o.origin_m);
        let [w, x, y, z] = seen.rotation;
        let turn = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-6)?;
        let arm = turn * Vector3::from(origin);
        let at = Vector3::from(seen.position) + arm;
        let own =
            Matrix6::from_fn(|i, j| seen.covariance.get(i).and_then(|row| row.get(j)).copied().unwrap_or(f64::NAN));
        // a small rotation of the tag moves the object's origin by rotation x arm
        let mut by = Matrix3x6::zeros();
        by.fixed_columns_mut::<3>(0).copy_from(&Matrix3::identity());
        by.fixed_columns_mut::<3>(3).copy_from(&-arm.cross_matrix());
        let place = self.settings.place_mm * 1e-3;
        let look = self.settings.look_deg.to_radians();
        let cross = at.cross_matrix();
        let in_camera = by * own * by.transpose()
            + Matrix3::identity() * (place * place)
            + cross * cross.transpose() * (look * look);
        let turned = camera.rotation.to_rotation_matrix();
        let covariance = turned.matrix() * in_camera * turned.matrix().transpose();
        let position = camera.rotation * at + camera.translation.vector;
        // a covariance is its own transpose: its columns are its rows
        let covariance: [[f64; 3]; 3] = covariance.into();
        let is_sound = position.iter().chain(covariance.as_flattened()).all(|n| n.is_finite());
        is_sound.then(|| Located { object: object.clone(), position: position.into(), covariance })
    }
}

impl Locator for PoseLocator {
    fn locate(&mut self, seen: &[Sighting], body: &BodyState) -> Vec<Located> {
        if body.q.len() != self.robot.motors.len() {
            return Vec::new();
        }
        let mut frames = Vec::new();
        self.robot.forward(&body.q, &mut frames);
        let mut found: Vec<Located> = seen.iter().filter_map(|s| self.place(s, &frames)).collect();
        // of an object with two tags the more certain estimate is used
        let doubt = |l: &Located| l.covariance.iter().enumerate().filter_map(|(i, row)| row.get(i)).sum::<f64>();
        found.sort_by(|a, b| a.object.cmp(&b.object).then(doubt(a).total_cmp(&doubt(b))));
        found.dedup_by(|later, first| later.object == first.object);
        found
    }
}

inventory::submit! {
    Registered(&Kind::<dyn Locator> {
        name: "pose",
        doc: "Tells where things are that a detector such as `tag` sees in all six degrees of freedom: by one camera, whose place on the \
              robot the settings tell. The robot's base is the world's origin.",
        schema: || schemars::schema_for!(PoseLocatorSettings),
        example: |robot| match robot.markers.first() {
            Some(marker) => Ok(json!({ "cameras": [{ "name": "left", "marker": marker.name }] })),
            None => Err("this robot has no marker that a camera could be at"),
        },
        build: |value: &Value, context| Ok(Box::new(PoseLocator::new(settings(value)?, Arc::clone(&context.robot))?)),
    })
}
