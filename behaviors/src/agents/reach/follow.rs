//! The object is elsewhere than when the hand set out: in mid-motion, or a little when the hand is above it.

use super::look::{Gaze, PAUSE};
use super::{ReachAgent, choice, look};
use mobee_contract::{Intent, Time, View};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The object is seen again and again while the hand goes: if in the end it is so far from where it was when the hand set out, meters, the
/// hand is brought over it once more, so often at most.
const REFINE: f64 = 0.004;
const REFINED: u32 = 2;
/// What is seen so far from where the object was, meters, while the eyes are off that place may be something else; so often in one reach
/// that is looked into.
const DOUBTFUL: f64 = 0.15;
const CHECKS: u32 = 3;

/// Whether the object is still where it was, though it seems to be elsewhere, is being looked into: part of the agent's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Check {
    /// The eyes are to be turned there.
    Turn,
    /// They are turned there, and at rest since then, if they are.
    Watch(Option<Time>),
}

impl ReachAgent {
    /// Whether the object is not any more where it was when the hand set out.
    pub(super) fn has_moved(&self, view: &View) -> Option<Vector3<f64>> {
        self.is_elsewhere(self.settings.moved_mm * 1e-3, view)
    }

    /// Where the object is by now, if that is so far from where it was when the hand set out, meters.
    pub(super) fn is_elsewhere(&self, far: f64, view: &View) -> Option<Vector3<f64>> {
        let now = look::middle(&self.settings.object, view).filter(|_| self.settings.follow)?;
        let then = Vector3::from(self.mind.place.as_ref()?.object);
        ((now - then).norm() > far).then_some(now)
    }

    /// The torso carries the eyes along: is the object seen elsewhere only because they are off the place where it was? Begins to look into
    /// that, if so.
    pub(super) fn doubts(&mut self, view: &View) -> bool {
        let place = self.mind.place.as_ref().map(|place| place.object);
        let gaze = self.ready.as_ref().and_then(|ready| ready.gaze.as_ref());
        let (Some(place), Some(gaze)) = (place, gaze) else { return false };
        let is_off = || !gaze.faces(&self.settings.object, place.into(), view);
        if self.mind.checks >= CHECKS || self.is_elsewhere(DOUBTFUL, view).is_none() || !is_off() {
            return false;
        }
        self.mind.checks += 1;
        self.mind.check = Some(Check::Turn);
        self.walker.log(format!("{} seems to be elsewhere: the eyes turn to where it was", self.settings.object));
        true
    }

    /// What is to be done to look into it; `None`: nothing, or it was done. Where the eyes can't be turned to the place from here the hand
    /// goes home, from where they can.
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
                    return Some(Intent::Wait(PAUSE));
                }
                self.mind.check = None;
                let is_off = !gaze.faces(&self.settings.object, place, view);
                if is_off && self.is_elsewhere(DOUBTFUL, view).is_some() {
                    self.look_anew();
                }
                None
            }
        }
    }

    /// Before the hand goes down: brings it over where the object is known to be by now, if that is a little beside.
    pub(super) fn refine(&mut self, view: &View) -> bool {
        let Some(object) = self.is_elsewhere(REFINE, view).filter(|_| self.mind.refined < REFINED) else {
            return false;
        };
        self.mind.refined += 1;
        let pre = self.set_out(object, &choice::VERTICES, view).ok();
        pre.inspect(|pre| self.walker.goto(*pre)).is_some()
    }

    /// The object moved while the hand goes there: postures are chosen anew, begun from so many vertices. Answers their vertex.
    pub(super) fn follow(&mut self, vertices: &[usize], view: &View) -> Option<u32> {
        let object = self.has_moved(view)?;
        let pre = self.set_out(object, vertices, view).ok()?;
        self.mind.counts.replanned += 1;
        self.walker.log(format!("{} has moved: the hand goes where it is now", self.settings.object));
        Some(pre)
    }

    /// Whether the object is not any more where the hand goes, wherever it is: its sensor has not seen it for long, though all eyes look at
    /// that place, and nothing known is between.
    pub(super) fn is_gone(&self, view: &View) -> bool {
        let (Some(seen), Some(place)) = (view.seen(&self.settings.object), &self.mind.place) else { return false };
        let gaze = self.ready.as_ref().and_then(|ready| ready.gaze.as_ref());
        let faces = |gaze: &Gaze| gaze.faces(&self.settings.object, place.object.into(), view);
        self.settings.follow && seen.is_stale && gaze.is_some_and(faces)
    }

    /// The object is not where the hand goes, and no posture was found for where it is: the hand, which may hide it, goes home,
    /// and it is looked for anew. The hand never goes down to where the object is known not to be.
    pub(super) fn look_anew(&mut self) {
        self.walker.log(format!("{} is not where it was: it is looked for anew", self.settings.object));
        self.mind.place = None;
        self.go_home();
    }
}
