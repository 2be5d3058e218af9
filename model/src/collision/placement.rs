//! Shapes put in their places for one pose, and the tests of one pair.

use crate::distance::{Core, closed_segments_squared, distance_within};
use crate::scene::{Contact, Solid};
use nalgebra::{Isometry3, Point3, Vector3};

/// All solids of a scene at one pose.
#[derive(Clone, Debug, Default)]
pub(crate) struct Placement {
    /// `world_from_frame`.
    pub frames: Vec<Isometry3<f64>>,
    /// Per solid: centre, and half the axis of the capsule that holds it.
    pub spots: Vec<(Point3<f64>, Vector3<f64>)>,
}

impl Placement {
    /// Places the solids by the frames that are there.
    pub fn solids(&mut self, solids: &[Solid]) {
        let frames = &self.frames;
        self.spots.clear();
        self.spots.extend(solids.iter().map(|s| spot(frames, s)));
    }

    /// Makes room for the solids, to be placed one by one.
    pub fn solids_unplaced(&mut self, solids: &[Solid]) {
        self.spots = vec![(Point3::origin(), Vector3::zeros()); solids.len()];
    }

    /// Places one solid.
    pub fn solid(&mut self, solids: &[Solid], i: u32) {
        self.spots[i as usize] = spot(&self.frames, &solids[i as usize]);
    }
}

fn spot(frames: &[Isometry3<f64>], solid: &Solid) -> (Point3<f64>, Vector3<f64>) {
    let frame = &frames[solid.frame];
    (frame * Point3::from(solid.pose.translation.vector), frame.rotation * solid.axis)
}

/// A distance that is at most the signed distance of the pair; stops refining once it is above `enough`.
pub(crate) fn bound(solids: &[Solid], placement: &Placement, i: u32, j: u32, enough: f64) -> f64 {
    let (i, j) = (i as usize, j as usize);
    let (a, b) = (&solids[i].form, &solids[j].form);
    let (pa, pb) = (&placement.spots[i], &placement.spots[j]);
    let between = (pa.0 - pb.0).norm();
    let mut best = between - a.ball - b.ball;
    if best > enough {
        return best;
    }
    let pose = |k: usize| placement.frames[solids[k].frame] * solids[k].pose;
    if let Core::Box { half } = a.core {
        best = best.max(outside(&half, &pose(i), &pb.0) - b.ball);
    }
    if let Core::Box { half } = b.core {
        best = best.max(outside(&half, &pose(j), &pa.0) - a.ball);
    }
    if best > enough {
        return best;
    }
    best.max(closed_segments_squared(pa, pb).sqrt() - a.outer.1 - b.outer.1)
}

/// How far a point is outside a box; inside, which says nothing about depth, minus infinity.
fn outside(half: &Vector3<f64>, world_from_box: &Isometry3<f64>, point: &Point3<f64>) -> f64 {
    let p = world_from_box.inverse_transform_point(point).coords.abs() - half;
    let distance = p.sup(&Vector3::zeros()).norm();
    if distance > 0.0 { distance } else { f64::NEG_INFINITY }
}

/// The pair's contact if its signed distance is at most `cap`.
pub(crate) fn exact(solids: &[Solid], placement: &Placement, i: u32, j: u32, cap: f64) -> Option<Contact> {
    if bound(solids, placement, i, j, cap) > cap {
        return None;
    }
    measure(solids, placement, i, j, cap)
}

/// As [`exact`], when the bound is known to be no help.
pub(crate) fn measure(solids: &[Solid], placement: &Placement, i: u32, j: u32, cap: f64) -> Option<Contact> {
    let (a, b) = (&solids[i as usize], &solids[j as usize]);
    let (pa, pb) = (placement.frames[a.frame] * a.pose, placement.frames[b.frame] * b.pose);
    let near = distance_within(&a.form, &pa, &b.form, &pb, cap)?;
    Some(Contact { pair: (a.id, b.id), distance: near.distance, points: near.points })
}

/// Whether the pair's signed distance is at most `clearance`; quicker than measuring it.
pub(crate) fn touches(solids: &[Solid], placement: &Placement, i: u32, j: u32, clearance: f64) -> bool {
    if bound(solids, placement, i, j, clearance) > clearance {
        return false;
    }
    let (a, b) = (&solids[i as usize].form, &solids[j as usize].form);
    if a.is_capsule() && b.is_capsule() {
        return true;
    }
    let (pa, pb) = (&placement.spots[i as usize], &placement.spots[j as usize]);
    let (inner_a, inner_b) = ((pa.0, pa.1 * a.inner.0), (pb.0, pb.1 * b.inner.0));
    if closed_segments_squared(&inner_a, &inner_b).sqrt() - a.inner.1 - b.inner.1 <= clearance {
        return true;
    }
    measure(solids, placement, i, j, clearance).is_some()
}
