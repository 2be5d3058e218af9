//! Sensors of a configuration: each part is built once as a check, and again whenever its actor starts.

use super::{derive_seed, kind, localize, must_exist, needs_real_clock, placed};
use crate::config::{
    ClockMode, Complaints, Config, ConfigError, PathSetting, SensorConfig, Source, WorldGateConfig, paths, suggestion,
};
use mobee_contract::{Camera, CameraContext, Context, Detector, Kind, Locator, Role, check_object_name};
use mobee_model::Scene;
use mobee_runtime::system::{CameraSetup, LocatorSetup, PartMaker, SensorSetup, TruthCell, WorldGateSettings};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::NamedTempFile;

/// Maximum size of a file of a detector or locator, bytes.
const MAX_PART_FILE_BYTES: u64 = 256 << 20;

/// All sensors; reports those that can't be built.
pub(super) fn all(
    config: &Config,
    source: &Source,
    scene: &Scene,
    truth: &Arc<TruthCell>,
    wrong: &mut Complaints,
) -> Vec<SensorSetup> {
    let sensors = config.sensor.iter().enumerate();
    sensors.filter_map(|(i, sensor)| SensorBuilder { config, source, scene, truth, i, sensor }.setup(wrong)).collect()
}

/// Builds one camera that is served or viewed outside of a run.
///
/// # Errors
/// Complaints about its table at `at`.
pub fn camera(
    source: &Source,
    at: &str,
    table: &Value,
    context: &CameraContext,
) -> Result<Box<dyn Camera>, Complaints> {
    let (kind, mut settings) = kind::<dyn Camera>(source, at, table)?;
    let _sent = localize(source, at, kind, &mut settings)?;
    (kind.build)(&settings, context).map_err(|e| placed(source, at, e))
}

/// One sensor and the inputs to build it.
struct SensorBuilder<'a> {
    config: &'a Config,
    source: &'a Source,
    scene: &'a Scene,
    truth: &'a Arc<TruthCell>,
    i: usize,
    sensor: &'a SensorConfig,
}

impl SensorBuilder<'_> {
    fn setup(&self, wrong: &mut Complaints) -> Option<SensorSetup> {
        let SensorBuilder { config, source, scene, i, sensor, .. } = self;
        // errors are reported by the checks of numbers and names
        let index = sensor.carrier(config)?;
        let robot = scene.robots().get(index)?;
        let seed = |part: &str| derive_seed(config.seed, &format!("{}/{part}", sensor.name));
        let context = |part: &str| Context { robot: robot.clone(), seed: seed(part) };
        let mut cameras = Vec::new();
        let mut is_simulated = false;
        for (k, eye) in sensor.eye.iter().enumerate() {
            let at = |part: &str| format!("sensor[{i}].eye[{k}].{part}");
            let truth = self.truth.clone();
            let seed = seed(&format!("{}/camera", eye.name));
            let truth = Arc::new(move || truth.now());
            let carried = CameraContext { robot: robot.clone(), index, seed, truth };
            let camera = match source.was_sent() {
                // a client that swaps a detector sends no images, and the run opens no files on its behalf
                true => None,
                false => wrong.keep(self.part::<dyn Camera>(&at("camera"), &eye.camera, carried)),
            };
            let detector = context(&format!("{}/detector", eye.name));
            let detector = wrong.keep(self.part::<dyn Detector>(&at("detector"), &eye.detector, detector));
            let Some((detector, first)) = detector else { continue };
            for name in first.objects() {
                if let Err(why) = check_object_name(&name) {
                    let what = format!("the name of an object of this detector {why}");
                    wrong.push(source.error(&at("detector"), what, "give the object's name in the world"));
                }
            }
            drop(first);
            if let Some((_, first)) = &camera {
                is_simulated |= first.is_simulated();
                if config.clock == ClockMode::Virtual && !first.runs_in_virtual_time() {
                    wrong.push(needs_real_clock(source, &at("camera"), "camera"));
                }
            }
            let none: PartMaker<dyn Camera> = Arc::new(|| Err("no camera was built".into()));
            let camera = camera.map_or(none, |(maker, _)| maker);
            cameras.push(CameraSetup { name: eye.name.clone(), camera, detector, max_regions: eye.max_regions });
        }
        let locator = sensor.locator.as_ref().and_then(|table| {
            let at = format!("sensor[{i}].locator");
            let built = wrong.keep(self.part::<dyn Locator>(&at, table, context("locator")));
            let gate = sensor.gate.as_ref().map(|gate| self.gate(gate, wrong));
            built.map(|(locator, _)| LocatorSetup { robot: robot.name.clone(), locator, gate })
        });
        Some(SensorSetup { name: sensor.name.clone(), cameras, is_simulated, locator })
    }

    fn gate(&self, gate: &WorldGateConfig, wrong: &mut Complaints) -> WorldGateSettings {
        let names: Vec<&str> = self.scene.objects().map(|(_, o)| o.name.as_str()).collect();
        for (k, name) in gate.objects.iter().enumerate().filter(|(_, name)| !names.contains(&name.as_str())) {
            let at = format!("sensor[{}].gate.objects[{k}]", self.i);
            let what = format!("there is no object `{name}` in the world");
            wrong.push(self.source.error(&at, what, suggestion(name, "object", &names)));
        }
        WorldGateSettings {
            objects: gate.objects.clone(),
            workspace: gate.workspace_m,
            jump: gate.jump_mm * 1e-3,
            confirmations: gate.confirmations,
            uncertainty: gate.uncertainty_mm * 1e-3,
            least_move: gate.least_move_mm * 1e-3,
            // values out of range are reported elsewhere
            stale: Duration::try_from_secs_f64(gate.stale_s).unwrap_or(Duration::MAX),
        }
    }

    /// Builds a part: returns its maker and the first instance.
    fn part<R>(&self, at: &str, table: &Value, context: R::Context) -> Result<(PartMaker<R>, Box<R>), Complaints>
    where
        R: Role<Built = Box<R>> + ?Sized,
        R::Context: Send + Sync,
    {
        let (kind, mut settings) = kind::<R>(self.source, at, table)?;
        let copies = self.copies(at, kind, &mut settings)?;
        let build = kind.build;
        let first = build(&settings, &context).map_err(|e| placed(self.source, at, e))?;
        // a restarted part must be the same, even if its files have changed
        for PathSetting { place, path: file, .. } in paths(R::NAME, kind.name, &mut settings) {
            if let Some((_, copy)) = copies.iter().find(|(copied, _)| *copied == place) {
                *file = copy.path().to_string_lossy().into();
            }
        }
        let maker = move || {
            let _copies = &copies;
            build(&settings, &context).map_err(|e| e.to_string())
        };
        Ok((Arc::new(maker), first))
    }

    /// Copies of the files that a part is built from, each with the place of its setting. Afterwards the settings have
    /// the full paths of the originals, or of the copies if the files were sent. Folders are not copied.
    fn copies<R: Role + ?Sized>(
        &self,
        at: &str,
        kind: &Kind<R>,
        settings: &mut Value,
    ) -> Result<Vec<(String, NamedTempFile)>, Complaints> {
        let mut copies = localize(self.source, at, kind, settings)?;
        if self.source.was_sent() {
            return Ok(copies);
        }
        for PathSetting { place, path, is_folder, doc } in paths(R::NAME, kind.name, settings) {
            let path = Path::new(path.as_str());
            // cameras report a missing file themselves
            let is_missing = R::NAME == <dyn Camera>::NAME && !path.is_file();
            if is_folder || path.is_dir() || is_missing {
                continue;
            }
            let key = format!("{at}.{place}");
            must_exist(self.source, &key, path, &format!("file ({})", doc.trim_end_matches('.')))?;
            let copy = self.copy(&key, path)?;
            copies.push((place, copy));
        }
        Ok(copies)
    }

    fn copy(&self, key: &str, path: &Path) -> Result<NamedTempFile, ConfigError> {
        let io = |e: std::io::Error| {
            self.source.error(key, format!("no copy can be made of it: {e}"), "make room on the disk")
        };
        let mut copy = NamedTempFile::new().map_err(io)?;
        let mut original = mobee_model::file::open(path).map_err(io)?;
        let size = original.metadata().map_err(io)?.len();
        if size > MAX_PART_FILE_BYTES {
            let what = format!("{} has {size} bytes, more than {MAX_PART_FILE_BYTES}", path.display());
            return Err(self.source.error(key, what, "give a smaller file"));
        }
        std::io::copy(&mut original, copy.as_file_mut()).map_err(io)?;
        Ok(copy)
    }
}
