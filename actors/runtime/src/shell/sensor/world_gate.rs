//! The world gate decides which locator results update the model, and when an object is stale.
//!
//! ```text
//! another object, or not finite ─> Foreign      covariance too large ─> Unsure      outside the workspace ─> Outside
//! within a jump of its last place ─> Agrees, or Moved if the distance is at least the least move
//! farther than a jump from there, or from its last steady place
//!     ─> Waits, until it was seen at the new place a number of times in a row ─> Moved
//! ```
//! A single outlier therefore moves nothing, and neither does a second object of the same appearance while the
//! first is in view.

use mobee_contract::{Admission, Located, Time};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use std::collections::BTreeMap;
use std::time::Duration;

/// Greatest step of a steady object between two frames, as a share of the jump.
const STEADY: f64 = 0.25;
/// Greatest distance between two sightings of the same new place, as a share of the jump.
const SAME_PLACE: f64 = 0.5;

/// Settings of a world gate.
#[derive(Clone, Debug, PartialEq)]
pub struct WorldGateSettings {
    /// Objects that the sensor tracks, by their names in the world.
    pub objects: Vec<String>,
    /// Least and greatest coordinates of a valid place, meters.
    pub workspace: [[f64; 3]; 2],
    /// Greatest distance from the last place at which a new one is accepted at once, meters.
    pub jump: f64,
    /// Number of consecutive sightings at another place that confirm it.
    pub confirmations: u32,
    /// Greatest standard deviation of a place in its least certain direction, meters.
    pub uncertainty: f64,
    /// Least distance from the model's place that moves the object in the model, meters.
    pub least_move: f64,
    /// Time without a sighting after which an object is stale.
    pub stale: Duration,
}

/// The gate of one sensor. It survives the locator's actor.
#[derive(Clone, Debug)]
pub struct WorldGate {
    settings: WorldGateSettings,
    tracks: BTreeMap<String, ObjectTrack>,
}

/// Track of one object.
#[derive(Clone, Debug, Default)]
struct ObjectTrack {
    /// Its last accepted place, meters.
    place: Option<Vector3<f64>>,
    /// Its last steady place, meters: a chain of outliers, each near the one before, can't lead it away.
    anchor: Option<Vector3<f64>>,
    /// The place that was sent to the model, meters.
    in_model: Option<Vector3<f64>>,
    /// Time of the last accepted sighting.
    seen: Time,
    is_stale: bool,
    /// Another place, and the number of consecutive sightings there.
    other: Option<(Vector3<f64>, u32)>,
}

/// State of a tracked object.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptObject {
    /// Name of the object.
    pub object: String,
    /// Its last accepted place, meters.
    pub place: Option<[f64; 3]>,
    /// Time of that sighting.
    pub seen: Time,
    /// True if that is too long ago.
    pub is_stale: bool,
}

impl WorldGate {
    /// Creates a gate without sightings, at the time `now`.
    pub fn new(settings: WorldGateSettings, now: Time) -> WorldGate {
        let fresh = |name: &String| (name.clone(), ObjectTrack { seen: now, ..ObjectTrack::default() });
        let tracks = settings.objects.iter().map(fresh).collect();
        WorldGate { settings, tracks }
    }

    /// Judges the results for one frame: one answer for each, in their order.
    pub fn admit(&mut self, exposed: Time, located: &[Located]) -> Vec<Admission> {
        let mut answers: Vec<Admission> = located.iter().map(|l| self.form(l)).collect();
        for (name, track) in &mut self.tracks {
            // `Other` until one candidate is chosen.
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

    /// Judges one place independently of the object's track: `Other` if it is a candidate.
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

    /// Objects that have become stale by now; each is reported once until it is seen again.
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

    /// State of all its objects.
    pub fn objects(&self) -> Vec<KeptObject> {
        let object = |(name, track): (&String, &ObjectTrack)| KeptObject {
            object: name.clone(),
            place: track.place.map(Into::into),
            seen: track.seen,
            is_stale: track.is_stale,
        };
        self.tracks.iter().map(object).collect()
    }
}

impl ObjectTrack {
    /// Selects the candidate that is, or may be, the object.
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
            return Some((i, self.accept(settings, exposed, at)));
        }
        let there = |to: Vector3<f64>| nearest(to, settings.jump * SAME_PLACE);
        let again = self.other.and_then(|(to, times)| there(to).map(|(i, at, _)| (i, at, times + 1)));
        let (i, at, times) = again.or_else(|| candidates.first().map(|(i, at)| (*i, *at, 1)))?;
        if times < settings.confirmations {
            self.other = Some((at, times));
            return Some((i, Admission::Waits));
        }
        self.other = None;
        self.anchor = Some(at);
        Some((i, self.accept(settings, exposed, at)))
    }

    fn accept(&mut self, settings: &WorldGateSettings, exposed: Time, at: Vector3<f64>) -> Admission {
        self.place = Some(at);
        self.seen = self.seen.max(exposed);
        self.is_stale = false;
        if self.in_model.is_some_and(|place| (place - at).norm() < settings.least_move) {
            return Admission::Agrees;
        }
        self.in_model = Some(at);
        Admission::Moved
    }
}

#[cfg(test)]
mod tests;
