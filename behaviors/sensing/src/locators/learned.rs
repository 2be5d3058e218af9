//! A trained locator in a run. It stores the last detections of each eye, to pair them with those
//! of the other, and a track of each object.

use super::file::{LocatorFile, ReadyLocator};
use super::head::JointAngles;
use super::lens::Lens;
use super::pairing::{Ray, pairs};
use super::standing::Standing;
use super::tracker::{Sight, Tracker};
use super::view::{Estimate, Glimpse, StereoView};
use mobee_contract::{BodyState, Intrinsics, Located, Locator, Region, Sighting, Time};
use nalgebra::{Matrix3, Vector2};
use std::collections::BTreeMap;
use std::time::Duration;

/// Maximum time between two exposures that form a pair: a frame and a half at 30 frames per second.
const MAX_PAIR_INTERVAL: Duration = Duration::from_millis(50);

/// Assignment of cameras to eyes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EyeNames {
    /// Name of the left camera; `None`: the camera with a name that ends in `left`.
    pub left: Option<String>,
    /// Name of the right camera; `None`: the camera with a name that ends in `right`.
    pub right: Option<String>,
}

impl EyeNames {
    /// Returns 0 for the left eye, 1 for the right eye, and `None` for any other camera.
    fn eye(&self, camera: &str) -> Option<usize> {
        let is = |name: &Option<String>, end: &str| match name {
            // In a run, the name of a camera is prefixed with that of its sensor.
            Some(name) => camera == name || camera.rsplit_once('/').is_some_and(|(_, own)| own == name),
            None => camera.ends_with(end),
        };
        if is(&self.left, "left") {
            Some(0)
        } else if is(&self.right, "right") {
            Some(1)
        } else {
            None
        }
    }
}

/// Time of an exposure and the detections of one object in it, by decreasing confidence.
type ExposedGlimpses = (Time, Vec<Glimpse>);

/// Locates objects that two eyes detect.
pub struct LearnedLocator {
    ready: ReadyLocator,
    /// Indices of the nine joints in the robot's configuration.
    joints: [usize; 9],
    eyes: EyeNames,
    /// Combine the views of objects that rest.
    tracks: bool,
    /// Last detections of each object by each eye that have not been paired yet.
    waiting: BTreeMap<String, [Option<ExposedGlimpses>; 2]>,
    trackers: BTreeMap<String, Tracker>,
    stands: Option<Standing>,
}

/// Maximum number of detections of one object in one image, those of the highest confidence.
const MAX_CANDIDATES: usize = 4;
/// Ratio of the areas that both eyes detect below which the object is assumed to be partly hidden
/// from one eye.
const HIDDEN_AREA_RATIO: f64 = 0.5;
/// Standard deviation, m, added to a position if the image border clips the object: the hidden part
/// may be as large as the visible one.
const CLIPPED_SIGMA_M: f64 = 0.1;

impl LearnedLocator {
    /// Creates a locator from its file, for a robot with its joints at these indices.
    pub fn new(file: &LocatorFile, joints: [usize; 9], eyes: EyeNames, tracks: bool) -> LearnedLocator {
        let ready = file.ready();
        let waiting = BTreeMap::new();
        let trackers = BTreeMap::new();
        LearnedLocator { ready, joints, eyes, tracks, waiting, trackers, stands: None }
    }

    /// Sets the support plane of the objects.
    pub fn standing(mut self, stands: Option<Standing>) -> LearnedLocator {
        self.stands = stands;
        self
    }

    /// Locates an object on the support plane from the one eye that sees it completely, if the
    /// other eye does not.
    fn by_one(&self, object: &str, eye: usize, view: &StereoView) -> Option<Sight> {
        let ray = self.ready.rays(view)?[eye];
        let glimpse = view.eyes[eye];
        let estimate = self.stands?.on_ray(&ray).filter(|_| !glimpse.is_clipped)?;
        let size = size(&glimpse, &ray, &estimate)?;
        let is_whole = self.trackers.get(object)?.is_as_large(size);
        is_whole.then_some(Sight { estimate, size: Some(size) })
    }

    /// Locates the candidates of an object that both eyes detected at the same time; without any,
    /// those that one eye detected.
    fn place(&mut self, object: &str, views: &[StereoView], lone: &[(usize, StereoView)]) -> Vec<Located> {
        let mut whole = Vec::new();
        let mut cut_off = Vec::new();
        for view in views {
            if let Some(sight) = view.sees_less(HIDDEN_AREA_RATIO).and_then(|less| self.by_one(object, 1 - less, view))
            {
                whole.push(sight);
                continue;
            }
            let rays = self.ready.rays(view);
            let found = self.ready.locate(view).and_then(|found| match &self.stands {
                Some(standing) => standing.place(&found, rays),
                None => Some(found),
            });
            let Some(mut found) = found else { continue };
            let sizes = rays.map(|rays| [0, 1].map(|e| size(&view.eyes[e], &rays[e], &found)));
            let size = sizes.and_then(|[left, right]| Some(f64::min(left?, right?)));
            // The kind `calibrated` is trained on clipped views and includes their error.
            if view.is_clipped() && !matches!(self.ready, ReadyLocator::Calibrated(_)) {
                found.covariance += Matrix3::identity() * CLIPPED_SIGMA_M.powi(2);
                cut_off.push(found);
            } else {
                whole.push(Sight { estimate: found, size });
            }
        }
        if whole.is_empty() {
            whole.extend(lone.iter().filter_map(|(eye, view)| self.by_one(object, *eye, view)));
            if whole.is_empty() && views.is_empty() {
                return Vec::new();
            }
        }
        let whole = if self.tracks {
            let common = self.ready.common();
            self.trackers.entry(object.to_owned()).or_insert_with(|| Tracker::new(common)).see(&whole)
        } else {
            whole.iter().map(|sight| sight.estimate).collect()
        };
        let located = |found: &Estimate| {
            let row = |i: usize| [0, 1, 2].map(|j| found.covariance[(i, j)]);
            Located { object: object.to_owned(), position: found.place.into(), covariance: [row(0), row(1), row(2)] }
        };
        whole.iter().chain(&cut_off).map(located).collect()
    }
}

/// Returns the apparent size of an object: the area of its bounding box times the squared distance.
fn size(glimpse: &Glimpse, (eye, _): &Ray, found: &Estimate) -> Option<f64> {
    Some(glimpse.area()? * (found.place - eye).norm_squared())
}

/// Converts a region to the pixels of the camera in the locator's file, which may have another size
/// or lens.
pub fn glimpse(region: &Region, intrinsics: Intrinsics, lens: &Lens) -> Option<Glimpse> {
    let own = Lens::from(intrinsics);
    if !own.is_sound() {
        return None;
    }
    let there = |pixel: [f64; 2]| {
        let pixel = lens.project(&own.ray(&Vector2::from(pixel)))?.0;
        pixel.iter().all(|p| p.is_finite()).then_some(pixel)
    };
    let [left, top, right, bottom] = region.bounds;
    let first = there([left, top])?;
    let last = there([right, bottom])?;
    let bounds = Some([first.x, first.y, last.x - first.x, last.y - first.y]);
    Some(Glimpse { center: there(region.center)?.into(), bounds, is_clipped: region.is_clipped })
}

impl Locator for LearnedLocator {
    fn locate(&mut self, seen: &[Sighting], body: &BodyState) -> Vec<Located> {
        let lenses = self.ready.lenses();
        let mut encoders: JointAngles = [0.0; 9];
        for (value, motor) in encoders.iter_mut().zip(self.joints) {
            let Some(q) = body.q.get(motor) else { return Vec::new() };
            *value = *q;
        }
        // The detections of one camera at one instant.
        let Some((eye, at)) = seen.first().and_then(|s| Some((self.eyes.eye(&s.camera)?, s.at))) else {
            return Vec::new();
        };
        let mut looks: BTreeMap<&str, Vec<(f64, Glimpse)>> = BTreeMap::new();
        for Sighting { region, intrinsics, .. } in seen {
            if region.confidence.is_finite()
                && let Some(glimpse) = glimpse(region, *intrinsics, &lenses[eye])
            {
                looks.entry(&region.object).or_default().push((region.confidence, glimpse));
            }
        }
        let mut found = Vec::new();
        for (object, mut look) in looks {
            look.sort_by(|a, b| b.0.total_cmp(&a.0));
            look.truncate(MAX_CANDIDATES);
            let look: Vec<Glimpse> = look.into_iter().map(|(_, glimpse)| glimpse).collect();
            let waiting = self.waiting.entry(object.to_owned()).or_default();
            let before = waiting[eye].replace((at, look.clone()));
            let together = |a: &Time, b: &Time| a.since(*b).max(b.since(*a)) <= MAX_PAIR_INTERVAL;
            let (views, lone) = match &*waiting {
                [Some((left_at, left)), Some((right_at, right))] if together(left_at, right_at) => {
                    let pairs = pairs(&self.ready, &encoders, self.stands.as_ref(), [left, right]);
                    *waiting = [None, None];
                    pairs
                }
                // The other eye has not detected it since this eye's previous detection.
                _ if before.is_some() => (Vec::new(), look.into_iter().map(|glimpse| (eye, glimpse)).collect()),
                _ => continue,
            };
            // Only this eye's half of the view is used.
            let one_eyed = |(eye, glimpse)| (eye, StereoView { eyes: [glimpse; 2], encoders, is_timed: true });
            let lone: Vec<_> = lone.into_iter().map(one_eyed).collect();
            found.extend(self.place(object, &views, &lone));
        }
        found
    }

    fn takes(&self) -> Duration {
        Duration::from_micros(100)
    }
}
