//! The world gate: which of the places that a locator tells become the object's place in the model, and when an object is stale.
//!
//! ```text
//! not its object, or no numbers ─> Foreign      less sure than demanded ─> Unsure      outside the workspace ─> Outside
//! near where it was last ─> Agrees, or Moved if that is farther than the least move
//! farther than a jump from there, or from where it was steady
//!     ─> Waits, until it was seen there so many times in a row, and not where it was before ─> Moved
//! ```
//! One outlier therefore moves nothing, and neither does a second thing of the same looks while the first is in view.

use mobee_contract::{Admission, Located, Time};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use std::collections::BTreeMap;
use std::time::Duration;

/// An object is steady that goes on from one frame to the next by no more than this share of a jump; what is seen somewhere else is there
/// again within this share.
const STEADY: f64 = 0.25;
const AGAIN: f64 = 0.5;

/// What a world gate goes by.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldGateSettings {
    /// The objects that the sensor keeps where it sees them, by their names in the world.
    pub objects: Vec<String>,
    /// The least and the greatest coordinates that a place may have, meters.
    pub workspace: [[f64; 3]; 2],
    /// How far an object may be from where it was last to be believed at once, meters.
    pub jump: f64,
    /// How often in a row an object must be seen at another place to be believed there.
    pub confirmations: u32,
    /// The greatest standard deviation of a place, in its least certain direction, meters.
    pub uncertainty: f64,
    /// An object that is less far than this from where the model has it stays, meters.
    pub least_move: f64,
    /// An object that was not seen for so long is stale.
    pub stale: Duration,
}

/// The gate of one sensor. Outlives the locator's actor.
#[derive(Clone, Debug)]
pub struct WorldGate {
    settings: WorldGateSettings,
    tracks: BTreeMap<String, Track>,
}

/// What is known of one object.
#[derive(Clone, Debug, Default)]
struct Track {
    /// Where it was seen last, as far as that was believed.
    place: Option<Vector3<f64>>,
    /// The last place where it was steady: outliers, of which each is near enough to the one before, don't lead it away.
    anchor: Option<Vector3<f64>>,
    /// Where the model was told that it is.
    told: Option<Vector3<f64>>,
    /// When it was last seen where it is.
    seen: Time,
    is_stale: bool,
    /// Another place, and how often in a row it was seen there.
    other: Option<(Vector3<f64>, u32)>,
}

/// How an object is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptObject {
    /// Its name.
    pub object: String,
    /// Where it was seen last and believed, meters.
    pub place: Option<[f64; 3]>,
    /// When that was.
    pub seen: Time,
    /// Whether that is too long ago.
    pub is_stale: bool,
}

impl WorldGate {
    /// A gate that has seen nothing yet, at the time `now`.
    pub fn new(settings: WorldGateSettings, now: Time) -> WorldGate {
        let fresh = |name: &String| (name.clone(), Track { seen: now, ..Track::default() });
        let tracks = settings.objects.iter().map(fresh).collect();
        WorldGate { settings, tracks }
    }

    /// Judges what was located in one frame: one answer for each, in their order.
    pub fn admit(&mut self, exposed: Time, located: &[Located]) -> Vec<Admission> {
        let mut answers: Vec<Admission> = located.iter().map(|l| self.form(l)).collect();
        for (name, track) in &mut self.tracks {
            // `Other` until one is chosen
            let open = |(i, l): (usize, &Located)| {
                let is_open = answers.get(i) == Some(&Admission::Other) && l.object == *name;
                is_open.then(|| (i, Vector3::from(l.position)))
            };
            let candidates: Vec<(usize, Vector3<f64>)> = located.iter().enumerate().filter_map(open).collect();
            if let Some((i, answer)) = track.choose(&self.settings, exposed, &candidates)
                && let Some(slot) = answers.get_mut(i)
            {
                *slot = answer;
            }
        }
        answers
    }

    /// What can be said of one place without knowing where the object was: `Other` if it is a candidate.
    fn form(&self, located: &Located) -> Admission {
        let Located { object, position, covariance } = located;
        if !self.tracks.contains_key(object) || !located.is_finite() {
            return Admission::Foreign;
        }
        let covariance = Matrix3::from(*covariance);
        let variance = SymmetricEigen::new((covariance + covariance.transpose()) * 0.5).eigenvalues.max();
        if variance > self.settings.uncertainty.powi(2) {
            return Admission::Unsure;
        }
        let [least, greatest] = &self.settings.workspace;
        let is_inside = position.iter().zip(least.iter().zip(greatest)).all(|(x, (a, b))| (a..=b).contains(&x));
        if is_inside { Admission::Other } else { Admission::Outside }
    }

    /// The objects that have become stale by now, each told once until it is seen again.
    pub fn stale(&mut self, now: Time) -> Vec<String> {
        let after = self.settings.stale;
        let mut gone = Vec::new();
        for (name, track) in &mut self.tracks {
            if !track.is_stale && now.since(track.seen) > after {
                track.is_stale = true;
                gone.push(name.clone());
            }
        }
        gone
    }

    /// How all its objects are.
    pub fn kept(&self) -> Vec<KeptObject> {
        let kept = |(name, track): (&String, &Track)| KeptObject {
            object: name.clone(),
            place: track.place.map(Into::into),
            seen: track.seen,
            is_stale: track.is_stale,
        };
        self.tracks.iter().map(kept).collect()
    }
}

impl Track {
    /// Takes the candidate that the object is, or may be.
    fn choose(
        &mut self,
        settings: &WorldGateSettings,
        exposed: Time,
        candidates: &[(usize, Vector3<f64>)],
    ) -> Option<(usize, Admission)> {
        let nearest = |to: Vector3<f64>, within: f64| {
            let near = candidates.iter().map(|(i, at)| (*i, *at, (at - to).norm()));
            near.filter(|(.., d)| *d <= within).min_by(|a, b| a.2.total_cmp(&b.2))
        };
        let is_anchored = |(_, at, _): &(usize, Vector3<f64>, f64)| {
            self.anchor.is_none_or(|anchor| (anchor - at).norm() <= settings.jump)
        };
        if let Some((i, at, far)) = self.place.and_then(|place| nearest(place, settings.jump)).filter(is_anchored) {
            self.other = None;
            if far <= settings.jump * STEADY {
                self.anchor = Some(at);
            }
            return Some((i, self.believe(settings, exposed, at)));
        }
        let there = |to: Vector3<f64>| nearest(to, settings.jump * AGAIN);
        let again = self.other.and_then(|(to, times)| there(to).map(|(i, at, _)| (i, at, times + 1)));
        let (i, at, times) = again.or_else(|| candidates.first().map(|(i, at)| (*i, *at, 1)))?;
        if times < settings.confirmations {
            self.other = Some((at, times));
            return Some((i, Admission::Waits));
        }
        (self.other, self.anchor) = (None, Some(at));
        Some((i, self.believe(settings, exposed, at)))
    }

    fn believe(&mut self, settings: &WorldGateSettings, exposed: Time, at: Vector3<f64>) -> Admission {
        self.place = Some(at);
        self.seen = self.seen.max(exposed);
        self.is_stale = false;
        if self.told.is_some_and(|told| (told - at).norm() < settings.least_move) {
            return Admission::Agrees;
        }
        self.told = Some(at);
        Admission::Moved
    }
}

#[cfg(test)]
mod tests;
