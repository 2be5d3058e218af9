//! Rendered views of an object by two eyes, as a table of training data for locators.

use mobee_contract::Region;
use mobee_model::Robot;
use mobee_sensing::detectors::plane::Plane;
use mobee_sensing::detectors::regions::Cut;
use mobee_sensing::locators::head::JOINTS;
use mobee_sensing::locators::learned::glimpse;
use mobee_sensing::locators::lens::Lens;
use mobee_sensing::locators::view::{Glimpse, KnownView, StereoView};
use mobee_sim::eyes::{Owner, Shot};
use nalgebra::Point3;

/// The cut of a perfect detector.
const FAULTLESS: Cut = Cut { threshold: 128.0, open: false, keep: 0.0 };

/// The views so far, and the indices of the head's joints.
pub(super) struct Views {
    joints: [usize; 9],
    /// The views.
    pub(super) known: Vec<KnownView>,
}

impl Views {
    /// For a robot with an iCub's head and two eyes, the left one first; `None` for others.
    pub(super) fn new(robot: &Robot, eyes: usize) -> Option<Views> {
        let mut joints = [0; 9];
        for (joint, name) in joints.iter_mut().zip(JOINTS) {
            *joint = robot.motor_index(name)?;
        }
        (eyes == 2).then(|| Views { joints, known: Vec::new() })
    }

    /// Adds a view of an object that both eyes see completely; a clipped one would only show the image's border.
    pub(super) fn add(&mut self, q: &[f64], shots: &[Shot], object: u32, place: &Point3<f64>) {
        let [left, right] = shots else { return };
        let [first, second] = &Lens::icub();
        let (Some(left), Some(right)) = (seen(left, first, object), seen(right, second, object)) else { return };
        let mut encoders = [0.0; 9];
        for (to, motor) in encoders.iter_mut().zip(self.joints) {
            *to = q.get(motor).copied().unwrap_or_default();
        }
        let view = StereoView { eyes: [left, right], encoders, is_timed: false };
        self.known.push(KnownView { view, place: place.coords });
    }
}

/// The heaviest region that a perfect detector would report of an object, unless the border clips it.
fn seen(shot: &Shot, lens: &Lens, object: u32) -> Option<Glimpse> {
    let [width, height] = shot.frame.intrinsics.size.map(|n| n as usize);
    let is_object = |owner: &Owner| if *owner == Owner::Object(object) { 255.0 } else { 0.0 };
    let data = shot.owner.iter().map(is_object).collect();
    let (_, blobs) = FAULTLESS.apply(&Plane { width, height, data });
    let region: Region = blobs.kept.first()?.region("");
    glimpse(&region, shot.frame.intrinsics, lens).filter(|_| !region.is_clipped)
}
