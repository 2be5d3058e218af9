//! Reaction to an object that has moved since the hand set out: during the motion, or slightly when
//! the hand is above it.

use super::look::{Gaze, POLL_INTERVAL};
use super::{ReachAgent, choice, look};
use mobee_contract::{Intent, Time, View};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Displacement of the object since the hand set out, meters, beyond which the pre-grasp is
/// corrected before the hand goes down.
const CORRECTION_M: f64 = 0.004;
/// Maximum number of these corrections in one reach.
const MAX_CORRECTIONS: u32 = 2;
/// Displacement of a detection from the object's last position, meters, beyond which it may be
/// another object if the eyes do not face that position.
const DOUBTFUL_M: f64 = 0.15;
/// Maximum number of checks of such detections in one reach.
const MAX_CHECKS: u32 = 3;

/// A check whether the object is still where it was, although it was detected elsewhere: part of
/// the agent's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Check {
    /// The eyes are about to be turned to its last position.
    Turn,
    /// The eyes are turned there; the time is that at which they came to rest.
    Watch(Option<Time>),
}

impl ReachAgent {
    /// Returns the object's position if it has moved since the hand set out, world frame, meters.
    pub(super) fn has_moved(&self, view: &View) -> Option<Vector3<f64>> {
        self.is_elsewhere(self.settings.moved_mm * 1e-3, view)
    }

    /// Returns the object's position if it is more than `far` from where it was when the hand set
    /// out, meters.
    pub(super) fn is_elsewhere(&self, far: f64, view: &View) -> Option<Vector3<f64>> {
        let now = look::middle(&self.settings.object, view).filter(|_| self.settings.follow)?;
        let then = Vector3::from(self.mind.place.as_ref()?.object);
        ((now - then).norm() > far).then_some(now)
    }

    /// Starts a check if the object is detected far from its last position while the eyes do not
    /// face that position: the torso moves the eyes along. Returns whether a check was started.
    pub(super) fn doubts(&mut self, view: &View) -> bool {
        let place = self.mind.place.as_ref().map(|place| place.object);
        let gaze = self.ready.as_ref().and_then(|ready| ready.gaze.as_ref());
        let (Some(place), Some(gaze)) = (place, gaze) else { return false };
        let is_off = || !gaze.faces(&self.settings.object, place.into(), view);
        if self.mind.checks >= MAX_CHECKS || self.is_elsewhere(DOUBTFUL_M, view).is_none() || !is_off() {
            return false;
        }
        self.mind.checks += 1;
        self.mind.check = Some(Check::Turn);
        self.walker.log(format!("{} seems to be elsewhere: the eyes turn to where it was", self.settings.object));
        true
    }

    /// Returns the next step of the check; `None`: no step is left. If the eyes
    /// can't face the position from here, the hand goes home, from where they can.
    pub(super) fn check(&mut self, view: &View) -> Option<Intent> {
        let gaze = self.ready.as_ref().and_then(|ready| ready.gaze.as_ref())?;
        let place = self.mind.place.as_ref().map(|place| Vector3::from(place.object))?;
        match self.mind.check.as_mut()? {
            Check::Turn => {
                self.mind.check = Some(Check::Watch(None));
                self.mind.eyes_turn = true;
                Some(gaze.look_at(place, view))
            }
            Check::Watch(rested) => {
                let waited = view.at.since(*rested.get_or_insert(view.at));
                if waited < gaze.dwell() {
                    return Some(Intent::Wait(POLL_INTERVAL));
                }
                self.mind.check = None;
                let is_off = !gaze.faces(&self.settings.object, place, view);
                if is_off && self.is_elsewhere(DOUBTFUL_M, view).is_some() {
                    self.look_anew();
                }
                None
            }
        }
    }

    /// Before the hand goes down: corrects the pre-grasp if the object's estimate has changed
    /// slightly. Returns whether it did.
    pub(super) fn refine(&mut self, view: &View) -> bool {
        let Some(object) = self.is_elsewhere(CORRECTION_M, view).filter(|_| self.mind.refined < MAX_CORRECTIONS) else {
            return false;
        };
        self.mind.refined += 1;
        let pre = self.set_out(object, &choice::BATCHES_AT_REST, view).ok();
        pre.inspect(|pre| self.walker.goto(*pre)).is_some()
    }

    /// Chooses new postures for an object that has moved while the hand approaches. Returns the
    /// vertex of the pre-grasp posture.
    pub(super) fn follow(&mut self, vertices: &[usize], view: &View) -> Option<u32> {
        let object = self.has_moved(view)?;
        let pre = self.set_out(object, vertices, view).ok()?;
        self.mind.counts.replanned += 1;
        self.walker.log(format!("{} has moved: the hand goes where it is now", self.settings.object));
        Some(pre)
    }

    /// Returns whether the object is no longer at the hand's target: its sensor has not detected it
    /// for long, although all eyes face the target and no known body is in between.
    pub(super) fn is_gone(&self, view: &View) -> bool {
        let (Some(seen), Some(place)) = (view.seen(&self.settings.object), &self.mind.place) else { return false };
        let gaze = self.ready.as_ref().and_then(|ready| ready.gaze.as_ref());
        let faces = |gaze: &Gaze| gaze.faces(&self.settings.object, place.object.into(), view);
        self.settings.follow && seen.is_stale && gaze.is_some_and(faces)
    }

    /// Sends the hand, which may occlude the object, home, and restarts the search. Called if the
    /// object is not at the hand's target and no posture was found for its new position. The hand
    /// never goes down to a position that the object is known to have left.
    pub(super) fn look_anew(&mut self) {
        self.walker.log(format!("{} is not where it was: searching for it again", self.settings.object));
        self.mind.place = None;
        self.go_home();
    }
}
