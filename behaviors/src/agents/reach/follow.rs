//! The object is elsewhere than when the hand set out: in mid-motion, or a little when the hand is above it.

use super::look::Gaze;
use super::{ReachAgent, choice, look};
use mobee_contract::View;
use nalgebra::Vector3;

/// The object is seen again and again while the hand goes: if in the end it is so far from where it was when the hand set out, meters, the
/// hand is brought over it once more, so often at most.
const REFINE: f64 = 0.004;
const REFINED: u32 = 2;

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
