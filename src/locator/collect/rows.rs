//! What both eyes saw at once, with the bodies as they were then.

use super::Scene;
use super::bodies::{Body, Posture};
use crate::compose::Composition;
use mobee_behaviors::locators::head::{HeadKind, JointAngles};
use mobee_behaviors::locators::learned::glimpse;
use mobee_behaviors::locators::lens::Lens;
use mobee_behaviors::locators::model::HeadModel;
use mobee_behaviors::locators::parameters::PlaceFrame;
use mobee_behaviors::locators::view::{Glimpse, KnownView, StereoView};
use mobee_contract::{Region, Time};
use nalgebra::{Matrix3, Point3, Vector3, Vector4};
use std::fmt;
use std::time::Duration;

/// Pictures that are farther apart are not of one moment.
const TOGETHER: Duration = Duration::from_millis(5);

/// A view that may become a row.
pub(super) struct RawRow {
    /// What was seen, and where it was in the world.
    pub known: KnownView,
    /// When the pictures of the left and the right eye were exposed.
    pub exposed: [Time; 2],
    /// What the pixels are off by from what the head's drawings say, pixels; `None` where these have it behind the eyes.
    pub off: Option<Vector4<f64>>,
}

/// Why views became no rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    /// Neither eye, or one alone, saw anything.
    pub unseen: u64,
    /// The picture's border cut it off.
    pub clipped: u64,
    /// A robot moved.
    pub moving: u64,
    /// The readings don't tell where a robot was.
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
    looks: Body,
    holds: Body,
    /// The greatest speeds at which who looks and who holds rest, rad/s.
    still: [f64; 2],
    head: HeadModel,
    /// What each eye saw last, until the other one's picture of that moment is there.
    waiting: [Option<(Time, Option<Glimpse>)>; 2],
    raw: Vec<RawRow>,
    dropped: Dropped,
}

impl<'a> Rows<'a> {
    pub fn new(c: &'a Composition, scene: &'a Scene, [looks, holds]: [Body; 2], still: [f64; 2]) -> Rows<'a> {
        let own = PlaceFrame { rotation: Matrix3::identity(), origin: Vector3::zeros() };
        let head = HeadModel::nominal(HeadKind::V2, Lens::icub(), own);
        let raw = Vec::new();
        let dropped = Dropped::default();
        Rows { c, scene, looks, holds, still, head, waiting: [None, None], raw, dropped }
    }

    /// An eye's picture showed this.
    pub fn see(&mut self, eye: usize, exposed: Time, regions: &[Region]) {
        let surest = regions.iter().max_by(|a, b| a.confidence.total_cmp(&b.confidence));
        let lens = &Lens::icub();
        let (Some(own), Some(lens)) = (self.scene.lenses.get(eye), lens.get(eye)) else { return };
        let seen = surest.and_then(|region| glimpse(region, *own, lens));
        if let Some(slot) = self.waiting.get_mut(eye) {
            *slot = Some((exposed, seen));
        }
        let [Some((l, left)), Some((r, right))] = self.waiting else { return };
        if l.since(r).max(r.since(l)) > TOGETHER {
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

    fn add(&mut self, eyes: [Glimpse; 2], exposed: [Time; 2], looks: &Posture, holds: &Posture) {
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

    /// What there is, and why there is not more.
    pub fn finish(self) -> (Vec<RawRow>, Dropped) {
        (self.raw, self.dropped)
    }
}
