//! A learned locator in a run: it remembers what the other eye has seen just before, and what it has found of each object.

use super::file::{LocatorFile, ReadyLocator};
use super::head::JointAngles;
use super::lens::Lens;
use super::standing::Standing;
use super::tracker::Tracker;
use super::view::{Glimpse, StereoView};
use mobee_contract::{BodyState, Intrinsics, Located, Locator, Region, Sighting, Time};
use nalgebra::{Matrix3, Vector2};
use std::collections::BTreeMap;
use std::time::Duration;

/// What both eyes saw, if that was so near in time: a frame and a half of cameras with 30 frames a second.
const TOGETHER: Duration = Duration::from_millis(50);

/// Which camera is which eye.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EyeNames {
    /// The left camera's name; none: the one that ends in `left`.
    pub left: Option<String>,
    /// The right camera's name; none: the one that ends in `right`.
    pub right: Option<String>,
}

impl EyeNames {
    /// 0 for the left eye, 1 for the right one, `None` for any other camera.
    fn eye(&self, camera: &str) -> Option<usize> {
        let is = |name: &Option<String>, end: &str| match name {
            // in a run each camera's name is that of its sensor and its own
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

/// Tells where things are that two eyes see.
pub struct LearnedLocator {
    ready: ReadyLocator,
    /// Where the nine joints are in the robot's pose.
    joints: [usize; 9],
    eyes: EyeNames,
    /// Whether views of what rests are put together.
    tracks: bool,
    /// What each eye saw last of each object, not yet paired.
    waiting: BTreeMap<String, [Option<(Time, Glimpse)>; 2]>,
    trackers: BTreeMap<String, Tracker>,
    stands: Option<Standing>,
}

/// What the border cuts off may be as large as what is seen of it: by so much a place is not known, m.
const CUT_OFF: f64 = 0.1;
impl LearnedLocator {
    /// One as the file says, for a robot whose pose has the joints at these places.
    pub fn new(file: &LocatorFile, joints: [usize; 9], eyes: EyeNames, tracks: bool) -> LearnedLocator {
        let ready = file.ready();
        let (waiting, trackers) = (BTreeMap::new(), BTreeMap::new());
        LearnedLocator { ready, joints, eyes, tracks, waiting, trackers, stands: None }
    }

    /// The same, of objects that stand on something level.
    pub fn standing(mut self, stands: Option<Standing>) -> LearnedLocator {
        self.stands = stands;
        self
    }

    fn place(&mut self, object: &str, view: &StereoView) -> Option<Located> {
        let mut found = self.ready.locate(view)?;
        if let Some(standing) = &self.stands {
            let eyes = self.ready.between_eyes(&view.encoders);
            found = standing.place(&found, eyes)?;
        }
        // who has learned from views that the border cut off knows what they are worth
        let is_unsure = view.is_clipped() && !matches!(self.ready, ReadyLocator::Calibrated(_));
        if is_unsure {
            found.covariance += Matrix3::identity() * CUT_OFF.powi(2);
        } else if self.tracks {
            let common = self.ready.common();
            let tracker = self.trackers.entry(object.to_owned()).or_insert_with(|| Tracker::new(common));
            tracker.see(found);
            found = tracker.place()?;
        }
        let row = |i: usize| [0, 1, 2].map(|j| found.covariance[(i, j)]);
        Some(Located { object: object.to_owned(), position: found.place.into(), covariance: [row(0), row(1), row(2)] })
    }
}

/// What the camera that the file knows would have seen: another size or another lens makes other pixels of the same direction.
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
    let (first, last) = (there([left, top])?, there([right, bottom])?);
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
        // of each object the one that the detector is surest of
        let mut surest: BTreeMap<&str, (&Sighting, usize)> = BTreeMap::new();
        for sighting in seen {
            let Some(eye) = self.eyes.eye(&sighting.camera) else { continue };
            let other = surest.entry(&sighting.region.object).or_insert((sighting, eye));
            if sighting.region.confidence > other.0.region.confidence {
                *other = (sighting, eye);
            }
        }
        let mut found = Vec::new();
        for (object, (sighting, eye)) in surest {
            let Some(glimpse) = glimpse(&sighting.region, sighting.intrinsics, &lenses[eye]) else { continue };
            let waiting = self.waiting.entry(object.to_owned()).or_default();
            waiting[eye] = Some((sighting.at, glimpse));
            let [Some((left_at, left)), Some((right_at, right))] = *waiting else { continue };
            if left_at.since(right_at).max(right_at.since(left_at)) > TOGETHER {
                continue;
            }
            *waiting = [None, None];
            let view = StereoView { eyes: [left, right], encoders, is_timed: true };
            found.extend(self.place(object, &view));
        }
        found
    }

    fn takes(&self) -> Duration {
        Duration::from_micros(100)
    }
}
