//! Sensors as a configuration names them: each part built once to see that it can be, and again whenever its actor starts.

use super::{by_the_wall, derive_seed, kind, localize, must_exist, placed};
use crate::config::{
    ClockMode, Complaints, Config, PathSetting, SensorConfig, Source, WorldGateConfig, paths, suggestion,
};
use mobee_actors::system::{CameraSetup, LocatorSetup, PartMaker, SensorSetup, TruthCell, WorldGateSettings};
use mobee_contract::{Camera, CameraContext, Context, Detector, Kind, Locator, Role, check_object_name};
use mobee_model::Scene;
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tempfile::NamedTempFile;

/// The longest file that a detector or locator may be, bytes.
const LONGEST: u64 = 256 << 20;

/// All sensors; those that can't be are told.
pub(super) fn all(
    config: &Config,
    source: &Source,
    scene: &Scene,
    truth: &Arc<TruthCell>,
    wrong: &mut Complaints,
) -> Vec<SensorSetup> {
    let sensors = config.sensor.iter().enumerate();
    sensors.filter_map(|(i, sensor)| Sensing { config, source, scene, truth, i, sensor }.setup(wrong)).collect()
}

/// One camera that somebody serves or looks through outside of a run.
///
/// # Errors
/// Complaints about its table, which stands at `at`.
pub(crate) fn camera(
    source: &Source,
    at: &str,
    table: &Value,
    context: &CameraContext,
) -> Result<Box<dyn Camera>, Complaints> {
    let (kind, mut settings) = kind::<dyn Camera>(source, at, table)?;
    let _sent = localize(source, at, kind, &mut settings)?;
    (kind.build)(&settings, context).map_err(|e| placed(source, at, e))
}

/// One sensor, and what it is built from.
struct Sensing<'a> {
    config: &'a Config,
    source: &'a Source,
    scene: &'a Scene,
    truth: &'a Arc<TruthCell>,
    i: usize,
    sensor: &'a SensorConfig,
}

impl Sensing<'_> {
    fn setup(&self, wrong: &mut Complaints) -> Option<SensorSetup> {
        let Sensing { config, source, scene, i, sensor, .. } = self;
        // told by the checks of numbers and names
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
                // who swaps a detector sends no pictures, and none are opened for others
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
                    wrong.push(by_the_wall(source, &at("camera"), "camera"));
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
            // what is out of range was told
            stale: Duration::try_from_secs_f64(gate.stale_s).unwrap_or(Duration::MAX),
        }
    }

    /// A part of some kind: what makes it, and the first that was made.
    fn part<R>(&self, at: &str, table: &Value, context: R::Context) -> Result<(PartMaker<R>, Box<R>), Complaints>
    where
        R: Role<Built = Box<R>> + ?Sized,
        R::Context: Send + Sync,
    {
        let (kind, mut settings) = kind::<R>(self.source, at, table)?;
        let copies = self.copies(at, kind, &mut settings)?;
        let build = kind.build;
        let first = build(&settings, &context).map_err(|e| placed(self.source, at, e))?;
        // a part that is restarted is what it was, whatever has become of its files
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

    /// Copies of the files that a part is made from, each with the place of its setting. The settings then have the whole paths of the
    /// originals, or of the copies where the files were sent. Folders are not copied.
    fn copies<R: Role + ?Sized>(
        &self,
        at: &str,
        kind: &Kind<R>,
        settings: &mut Value,
    ) -> Result<Vec<(String, NamedTempFile)>, Complaints> {
        let mut copies = Vec::new();
        for PathSetting { place, path: file, is_folder } in paths(R::NAME, kind.name, settings) {
            let path = Config::beside(self.source, Path::new(file.as_str()));
            *file = path.to_string_lossy().into_owned();
            let key = format!("{at}.{place}");
            let io = |e: std::io::Error| {
                self.source.error(&key, format!("no copy can be made of it: {e}"), "make room on the disk")
            };
            // cameras report a missing file in their own words
            let is_missing = R::NAME == <dyn Camera>::NAME && !self.source.was_sent() && !path.is_file();
            if is_folder || path.is_dir() || is_missing {
                continue;
            }
            let sent = self.source.bytes_sent(&key, &path).transpose()?;
            if sent.is_none() {
                must_exist(self.source, &key, &path, "file of `mobee detector train` or `mobee locator train`")?;
            }
            let mut copy = NamedTempFile::new().map_err(io)?;
            match sent {
                Some(bytes) => {
                    std::io::Write::write_all(&mut copy, bytes).map_err(io)?;
                    *file = copy.path().to_string_lossy().into_owned();
                }
                None => {
                    let mut original = mobee_model::file::open(&path).map_err(io)?;
                    let size = original.metadata().map_err(io)?.len();
                    if size > LONGEST {
                        let what = format!("{} has {size} bytes, more than {LONGEST}", path.display());
                        return Err(self.source.error(&key, what, "give a smaller file").into());
                    }
                    std::io::copy(&mut original, copy.as_file_mut()).map_err(io)?;
                }
            }
            copies.push((place, copy));
        }
        Ok(copies)
    }
}
