//! F24: faults of the cameras and locators of a run, and a check of the model's objects under them (I33).

use super::faults::FaultAction;
use super::plan::Planned;
use mobee_contract::{
    Admission, BodyState, Detector, Event, Frame, Located, Locator, Region, SeenMask, Sighting, Time,
};
use mobee_journal::names::{CAMERA, DETECTOR, LOCATOR};
use mobee_runtime::system::{CameraSetup, PartMaker, SensorSetup, TruthCell};
use nalgebra::Vector3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Maximum distance of an object in the model from its true place, meters, in addition to the gate's jump: the greatest
/// error of a run without faults, in which the object appears at an image's border.
const MAX_ERROR_M: f64 = 0.05;
/// Time for which the model may have a moved object at its former place.
const MAX_LAG: Duration = Duration::from_secs(2);

/// A fault of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorFault {
    /// Its detectors detect nothing.
    Blind,
    /// They detect every object a second time, at an offset to the right and down.
    Twice {
        /// The offset, pixels.
        off: [f64; 2],
    },
    /// They detect objects at random places, and none at the true ones.
    Elsewhere,
    /// They return numbers that are not finite or absurd.
    Nonsense,
    /// Its locator adds a random error to each position. A constant error could not be distinguished from a true
    /// position.
    Far {
        /// Maximum error along each axis, meters.
        by: f64,
    },
}

impl fmt::Display for SensorFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            SensorFault::Blind => f.write_str("it sees nothing"),
            SensorFault::Twice { off: [x, y] } => write!(f, "it sees everything twice, {x:.0} by {y:.0} pixels away"),
            SensorFault::Elsewhere => f.write_str("it sees things anywhere"),
            SensorFault::Nonsense => f.write_str("it returns invalid numbers"),
            SensorFault::Far { by } => write!(f, "its locator is off by up to {by:.2} m"),
        }
    }
}

/// The faults of one sensor, each with its time.
#[derive(Clone)]
struct SensorFaults {
    seed: u64,
    faults: Arc<[(Time, Time, SensorFault)]>,
}

impl SensorFaults {
    fn at(&self, at: Time) -> Option<SensorFault> {
        self.faults.iter().find(|(from, to, _)| (*from..*to).contains(&at)).map(|(.., fault)| *fault)
    }
}

/// The names of a sensor's actors in the run.
pub fn actors(sensor: &SensorSetup) -> Vec<String> {
    let parts = |camera: &CameraSetup| [CAMERA, DETECTOR].map(|part| format!("{}/{}/{part}", sensor.name, camera.name));
    let locator = sensor.locator.iter().map(|_| format!("{}/{LOCATOR}", sensor.name));
    sensor.cameras.iter().flat_map(parts).chain(locator).collect()
}

/// Wraps the detectors and locators of the sensors that have planned faults.
pub fn install_faults(sensors: &mut [SensorSetup], planned: &[Planned], seed: u64) {
    for (i, sensor) in sensors.iter_mut().enumerate() {
        let own = planned.iter().filter_map(|Planned { at, what }| match what {
            FaultAction::Sight { sensor, fault, lasts } if *sensor == i => Some((*at, *at + *lasts, *fault)),
            _ => None,
        });
        let faults: Arc<[_]> = own.collect();
        if faults.is_empty() {
            continue;
        }
        let wrong = SensorFaults { seed, faults };
        for camera in &mut sensor.cameras {
            let inner = camera.detector.clone();
            let wrong = wrong.clone();
            let maker: PartMaker<dyn Detector> =
                Arc::new(move || Ok(Box::new(FaultyPart { inner: inner()?, wrong: wrong.clone() })));
            camera.detector = maker;
        }
        if let Some(locator) = &mut sensor.locator {
            let inner = locator.locator.clone();
            let wrong = wrong.clone();
            let maker: PartMaker<dyn Locator> =
                Arc::new(move || Ok(Box::new(FaultyPart { inner: inner()?, wrong: wrong.clone() })));
            locator.locator = maker;
        }
    }
}

/// A detector or locator with temporary faults.
struct FaultyPart<T: ?Sized> {
    inner: Box<T>,
    wrong: SensorFaults,
}

impl Detector for FaultyPart<dyn Detector> {
    fn detect(&mut self, frame: &Frame) -> Vec<Region> {
        let mut seen = self.inner.detect(frame);
        let mut rng = ChaCha8Rng::seed_from_u64(self.wrong.seed ^ frame.exposed.0);
        match self.wrong.at(frame.exposed) {
            Some(SensorFault::Blind) => seen.clear(),
            Some(SensorFault::Twice { off: [x, y] }) => {
                let again = |region: &Region| {
                    let mut region = region.clone();
                    region.center = [region.center[0] + x, region.center[1] + y];
                    let [left, top, right, bottom] = region.bounds;
                    region.bounds = [left + x, top + y, right + x, bottom + y];
                    region
                };
                let mut twice: Vec<Region> = seen.iter().map(again).collect();
                // either of the two may come first
                let at = if rng.random() { 0 } else { seen.len() };
                seen.splice(at..at, twice.drain(..));
            }
            Some(SensorFault::Elsewhere) => {
                let [width, height] = frame.intrinsics.size.map(f64::from);
                for region in &mut seen {
                    let center = [rng.random_range(0.0..width), rng.random_range(0.0..height)];
                    let half = rng.random_range(1.0..20.0);
                    let [x, y] = center;
                    (region.center, region.bounds) = (center, [x - half, y - half, x + half, y + half]);
                    region.confidence = rng.random_range(0.0..1.0);
                    region.is_clipped = rng.random();
                }
            }
            Some(SensorFault::Nonsense) => {
                let none = [f64::NAN, f64::INFINITY, -1e300][rng.random_range(0..3)];
                for region in &mut seen {
                    match rng.random_range(0..4) {
                        0 => region.center[0] = none,
                        1 => region.bounds[2] = none,
                        2 => region.confidence = none,
                        _ => region.area = none,
                    }
                }
            }
            Some(SensorFault::Far { .. }) | None => {}
        }
        seen
    }

    fn takes(&self) -> Duration {
        self.inner.takes()
    }

    fn mask(&self) -> Option<SeenMask> {
        self.inner.mask()
    }
}

impl Locator for FaultyPart<dyn Locator> {
    fn locate(&mut self, seen: &[Sighting], body: &BodyState) -> Vec<Located> {
        let mut found = self.inner.locate(seen, body);
        if let Some(SensorFault::Far { by }) = self.wrong.at(body.at) {
            let mut rng = ChaCha8Rng::seed_from_u64(self.wrong.seed ^ body.at.0);
            for located in &mut found {
                located.position.iter_mut().for_each(|x| *x += rng.random_range(-by..=by));
            }
        }
        found
    }

    fn takes(&self) -> Duration {
        self.inner.takes()
    }
}

/// A sensor whose gate updates the model.
struct GatedSensor {
    name: String,
    /// The jump that its gate accepts at once, meters.
    jump: f64,
    /// Times during which it detects everything twice.
    twice: Vec<(Time, Time)>,
}

/// Compares the positions of objects that sensors report with the true ones.
pub struct ObjectChecker {
    truth: Arc<TruthCell>,
    sensors: Vec<GatedSensor>,
    /// The true positions of each object, each from a time to a time.
    places: BTreeMap<String, Vec<(Vector3<f64>, Time, Time)>>,
}

impl ObjectChecker {
    /// A comparison for a run with this ground truth, these sensors and these faults.
    pub fn new(truth: Arc<TruthCell>, sensors: &[SensorSetup], planned: &[Planned]) -> ObjectChecker {
        let of = |(i, sensor): (usize, &SensorSetup)| {
            let twice = planned.iter().filter_map(|Planned { at, what }| match what {
                FaultAction::Sight { sensor, fault: SensorFault::Twice { .. }, lasts } if *sensor == i => {
                    Some((*at, *at + *lasts))
                }
                _ => None,
            });
            let gate = sensor.locator.as_ref().and_then(|locator| locator.gate.as_ref());
            gate.map(|gate| GatedSensor { name: sensor.name.clone(), jump: gate.jump, twice: twice.collect() })
        };
        ObjectChecker { truth, sensors: sensors.iter().enumerate().filter_map(of).collect(), places: BTreeMap::new() }
    }

    /// Processes an event; returns a violation of I33.
    pub fn event(&mut self, at: Time, event: &Event) -> Option<String> {
        let Event::Located { sensor, exposed, objects, admissions } = event else { return None };
        let GatedSensor { jump, twice, .. } = self.sensors.iter().find(|judged| judged.name == *sensor)?;
        let truth = self.truth.now()?;
        let mut broken = None;
        for (object, admission) in objects.iter().zip(admissions) {
            let Some((_, is)) = truth.scene.object(&object.object) else { continue };
            let is = is.pose.translation.vector + is.pose.rotation * is.middle();
            let places = self.places.entry(object.object.clone()).or_default();
            match places.last_mut().filter(|(place, ..)| (place - is).norm() < 1e-6) {
                Some((_, _, until)) => *until = at,
                None => places.push((is, at, at)),
            }
            places.retain(|(_, _, until)| exposed.since(*until) <= MAX_LAG);
            let off = |(place, ..): &(Vector3<f64>, Time, Time)| (place - Vector3::from(object.position)).norm();
            let nearest = places.iter().map(off).fold(f64::INFINITY, f64::min);
            // two detections that appear at once are indistinguishable
            let since = places.last().map_or(at, |(_, since, _)| *since);
            let is_double = twice.iter().any(|(from, to)| (*from..*to + MAX_LAG).contains(exposed) && since >= *from);
            if *admission == Admission::Moved && nearest > jump + MAX_ERROR_M && !is_double {
                let name = &object.object;
                let mm = nearest * 1e3;
                broken.get_or_insert(format!("{name} is moved to {mm:.0} mm from where it was, at {at}"));
            }
        }
        broken
    }
}
