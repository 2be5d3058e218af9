//! Simultaneous detections of both eyes, with the robots' configurations.

use super::Scene;
use super::bodies::{MeasuredConfiguration, TrackInterpolator};
use mobee_compose::Composition;
use mobee_contract::{Region, Time};
use mobee_sensing::locators::head::{HeadKind, JointAngles};
use mobee_sensing::locators::learned::glimpse;
use mobee_sensing::locators::lens::Lens;
use mobee_sensing::locators::model::HeadModel;
use mobee_sensing::locators::parameters::PlaceFrame;
use mobee_sensing::locators::view::{Glimpse, KnownView, StereoView};
use nalgebra::{Matrix3, Point3, Vector3, Vector4};
use std::fmt;
use std::time::Duration;

/// Maximum difference of exposure times of one view.
const MAX_SKEW: Duration = Duration::from_millis(5);

/// A view that may become a row.
pub(super) struct RawRow {
    /// The view, and the object's position in the world.
    pub known: KnownView,
    /// Exposure times of the images of the left and the right eye.
    pub exposed: [Time; 2],
    /// Deviation of the detections from the nominal kinematics, pixels; `None` if the object would be behind the eyes.
    pub off: Option<Vector4<f64>>,
}

/// Counts of views that were dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    /// At least one eye detected nothing.
    pub unseen: u64,
    /// Clipped by the image's border.
    pub clipped: u64,
    /// A robot moved.
    pub moving: u64,
    /// No readings of a robot at that time.
    pub unknown: u64,
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Dropped { unseen, clipped, moving, unknown } = self;
        write!(f, "{unseen} not seen by both eyes, {clipped} cut off by a border, {moving} while a robot moved, ")?;
        write!(f, "{unknown} without a reading of both robots")
    }
}

/// The views so far.
pub(super) struct Rows<'a> {
    c: &'a Composition,
    scene: &'a Scene,
    looks: TrackInterpolator,
    holds: TrackInterpolator,
    /// Maximum speeds at which the looking and the holding robot count as at rest, rad/s.
    still: [f64; 2],
    head: HeadModel,
    /// The latest detection of each eye, until the other one's image of that time arrives.
    waiting: [Option<(Time, Option<Glimpse>)>; 2],
    raw: Vec<RawRow>,
    dropped: Dropped,
}

impl<'a> Rows<'a> {
    pub fn new(
        c: &'a Composition,
        scene: &'a Scene,
        [looks, holds]: [TrackInterpolator; 2],
        still: [f64; 2],
    ) -> Rows<'a> {
        let own = PlaceFrame { rotation: Matrix3::identity(), origin: Vector3::zeros() };
        let head = HeadModel::nominal(HeadKind::V2, Lens::icub(), own);
        let raw = Vec::new();
        let dropped = Dropped::default();
        Rows { c, scene, looks, holds, still, head, waiting: [None, None], raw, dropped }
    }

    /// Processes the detections of an eye's image.
    pub fn see(&mut self, eye: usize, exposed: Time, regions: &[Region]) {
        let surest = regions.iter().max_by(|a, b| a.confidence.total_cmp(&b.confidence));
        let lens = &Lens::icub();
        let (Some(own), Some(lens)) = (self.scene.lenses.get(eye), lens.get(eye)) else { return };
        let seen = surest.and_then(|region| glimpse(region, *own, lens));
        if let Some(slot) = self.waiting.get_mut(eye) {
            *slot = Some((exposed, seen));
        }
        let [Some((l, left)), Some((r, right))] = self.waiting else { return };
        if l.since(r).max(r.since(l)) > MAX_SKEW {
            return;
        }
        self.waiting = [None, None];
        let (Some(left), Some(right)) = (left, right) else {
            self.dropped.unseen += 1;
            return;
        };
        if left.is_clipped || right.is_clipped {
            self.dropped.clipped += 1;
            return;
        }
        let (Some(looks), Some(holds)) = (self.looks.at(exposed), self.holds.at(exposed)) else {
            self.dropped.unknown += 1;
            return;
        };
        if looks.speed > self.still[0] || holds.speed > self.still[1] {
            self.dropped.moving += 1;
            return;
        }
        self.add([left, right], [l, r], &looks, &holds);
    }

    fn add(
        &mut self,
        eyes: [Glimpse; 2],
        exposed: [Time; 2],
        looks: &MeasuredConfiguration,
        holds: &MeasuredConfiguration,
    ) {
        let Scene { joints, marker, .. } = *self.scene;
        let robots = self.c.scene.robots();
        let at = robots.get(self.scene.holds).map(|r| r.markers_at(&holds.q));
        let Some(own) = at.and_then(|markers| markers.get(marker).map(|m| m.position())) else { return };
        let world = self.c.scene.base(self.scene.holds) * Point3::from(own.coords);
        let mut encoders: JointAngles = [0.0; 9];
        for (to, motor) in encoders.iter_mut().zip(joints) {
            *to = looks.q.get(motor).copied().unwrap_or_default();
        }
        let view = StereoView { eyes, encoders, is_timed: true };
        let root = self.c.scene.base(self.scene.looks).inverse() * world;
        let off = self.head.pixels(&encoders, &root.coords).map(|there| view.pixels() - there);
        self.raw.push(RawRow { known: KnownView { view, place: world.coords }, exposed, off });
    }

    /// The rows, and the counts of dropped views.
    pub fn finish(self) -> (Vec<RawRow>, Dropped) {
        (self.raw, self.dropped)
    }
}
