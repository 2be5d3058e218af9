//! Settings of the rendered images: `configs/cameras/*.toml`.

use mobee_compose::config::{Complaints, ConfigError, Source};
use mobee_model::Robot;
use mobee_sim::eyes::{ScenerySettings, SimulatedCameraSettings};
use schemars::JsonSchema;
use serde::Deserialize;
use std::path::Path;

/// Cameras, scenery, and the random parts of a scene.
#[derive(Clone, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DrawSettings {
    /// The cameras, as the kind `simulated` takes them; default: one at each marker whose name ends in `eye`.
    pub camera: Vec<SimulatedCameraSettings>,
    /// The scenery of all cameras; its seed is drawn for each picture.
    pub scenery: ScenerySettings,
    /// Motors, or parts, with random positions within their limits; default: those that move the first camera. All
    /// others are at home.
    pub motors: Vec<String>,
    /// Area of the object: minimum and maximum x, minimum and maximum y in the world, m; default: its position in the
    /// world's file.
    pub area_m: Option<[f64; 4]>,
}

impl DrawSettings {
    /// Loads a file, or the defaults for a robot.
    ///
    /// # Errors
    /// All errors, each with its place.
    pub fn load(path: Option<&Path>, robot: &Robot) -> Result<(DrawSettings, Option<Source>), Complaints> {
        let (mut settings, source): (DrawSettings, _) = match path {
            None => (DrawSettings::default(), None),
            Some(path) => {
                let (mut settings, source) =
                    mobee_compose::maps::read_table::<DrawSettings>(path, &[], "docs/cameras.md")?;
                let folder = path.parent().unwrap_or(Path::new(""));
                let pictures = settings.scenery.pictures.take();
                settings.scenery.pictures = pictures.map(|p| folder.join(source.relocated("scenery.pictures", &p)));
                (settings, Some(source))
            }
        };
        if settings.camera.is_empty() {
            let eyes = robot.markers.iter().filter(|m| m.name.ends_with("eye"));
            settings.camera = eyes.map(|m| SimulatedCameraSettings::at(&m.name)).collect();
        }
        let mut wrong = Complaints::default();
        if settings.camera.is_empty() {
            let what = format!("robot {} has no marker whose name ends in `eye`", robot.name);
            wrong.push(ConfigError::plain(what, "name cameras with their markers: [[camera]] in --settings FILE"));
        }
        for (k, camera) in settings.camera.iter().enumerate() {
            if let Some(source) = source.as_ref().filter(|_| camera.scenery != ScenerySettings::default()) {
                let help = "all cameras see one: give [scenery] beside [[camera]]";
                wrong.push(source.error(&format!("camera[{k}].scenery"), "this camera has a scenery of its own", help));
            }
        }
        wrong.none_or((settings, source))
    }
}
