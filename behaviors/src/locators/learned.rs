//! A learned locator in a run: it remembers what the other eye has seen just before, and what it has found of each object.

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

/// What an eye saw that may be one object, the surest first, and when.
type Look = (Time, Vec<Glimpse>);

/// Tells where things are that two eyes see.
pub struct LearnedLocator {
    ready: ReadyLocator,
    /// Where the nine joints are in the robot's pose.
    joints: [usize; 9],
    eyes: EyeNames,
    /// Whether views of what rests are put together.
    tracks: bool,
    /// What each eye saw last that may be each object, the surest first, not yet paired.
    waiting: BTreeMap<String, [Option<Look>; 2]>,
    trackers: BTreeMap<String, Tracker>,
    stands: Option<Standing>,
}

/// Things in one picture that may be one object: so many are looked at, the surest.
const CANDIDATES: usize = 4;
/// Of what one eye sees so much less than the other, something hides the rest from it.
const LESS: f64 = 0.5;
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

    /// Where something is that stands, as one eye alone tells it that sees all of it: the other does not see it, or not all of it.
    fn by_one(&self, object: &str, eye: usize, view: &StereoView) -> Option<Sight> {
        let (ray, glimpse) = (self.ready.rays(view)?[eye], view.eyes[eye]);
        let estimate = self.stands?.on_ray(&ray).filter(|_| !glimpse.is_clipped)?;
        let size = size(&glimpse, &ray, &estimate)?;
        let is_whole = self.trackers.get(object)?.is_as_large(size);
        is_whole.then_some(Sight { estimate, size: Some(size) })
    }

    /// Where things are that both eyes saw at once, and that may each be this object; if there are none, those that one eye saw.
    fn place(&mut self, object: &str, views: &[StereoView], lone: &[(usize, StereoView)]) -> Vec<Located> {
        let (mut whole, mut cut_off) = (Vec::new(), Vec::new());
        for view in views {
            if let Some(sight) = view.sees_less(LESS).and_then(|less| self.by_one(object, 1 - less, view)) {
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
            // who has learned from views that the border cut off knows what they are worth
            if view.is_clipped() && !matches!(self.ready, ReadyLocator::Calibrated(_)) {
                found.covariance += Matrix3::identity() * CUT_OFF.powi(2);
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
        let told = |found: &Estimate| {
            let row = |i: usize| [0, 1, 2].map(|j| found.covariance[(i, j)]);
            Located { object: object.to_owned(), position: found.place.into(), covariance: [row(0), row(1), row(2)] }
        };
        whole.iter().chain(&cut_off).map(told).collect()
    }
}

/// How much an eye sees of something: the area of its box times the square of the distance.
fn size(glimpse: &Glimpse, (eye, _): &Ray, found: &Estimate) -> Option<f64> {
    Some(glimpse.area()? * (found.place - eye).norm_squared())
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
        // one camera's, of one instant
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
            look.truncate(CANDIDATES);
            let look: Vec<Glimpse> = look.into_iter().map(|(_, glimpse)| glimpse).collect();
            let waiting = self.waiting.entry(object.to_owned()).or_default();
            let before = waiting[eye].replace((at, look.clone()));
            let together = |a: &Time, b: &Time| a.since(*b).max(b.since(*a)) <= TOGETHER;
            let (views, lone) = match &*waiting {
                [Some((left_at, left)), Some((right_at, right))] if together(left_at, right_at) => {
                    let pairs = pairs(&self.ready, &encoders, self.stands.as_ref(), [left, right]);
                    *waiting = [None, None];
                    pairs
                }
                // the other eye did not see it since this one saw it the last time
                _ if before.is_some() => (Vec::new(), look.into_iter().map(|glimpse| (eye, glimpse)).collect()),
                _ => continue,
            };
            // only this eye's half of the view is looked at
            let alone = |(eye, glimpse)| (eye, StereoView { eyes: [glimpse; 2], encoders, is_timed: true });
            let lone: Vec<_> = lone.into_iter().map(alone).collect();
            found.extend(self.place(object, &views, &lone));
        }
        found
    }

    fn takes(&self) -> Duration {
        Duration::from_micros(100)
    }
}
