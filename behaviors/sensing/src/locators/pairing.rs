//! Matching of the left eye's detections with the right eye's.

use super::file::ReadyLocator;
use super::head::JointAngles;
use super::standing::Standing;
use super::view::{Glimpse, StereoView};
use nalgebra::Vector3;

/// Maximum angle between the rays of two eyes that detect the same object, rad: cameras may be a
/// degree or two off. It bounds the angle at which the rays pass each other, and for objects on a
/// support plane the angle between each ray and the point where the other one meets the plane.
const MAX_ANGLE_RAD: f64 = 0.1;

/// A ray: its origin, m, and a direction of length 1, in the frame of the positions.
pub(super) type Ray = (Vector3<f64>, Vector3<f64>);

/// Pairs detections of the left and the right eye that may be the same object, by decreasing
/// confidence, and returns the unpaired ones with their eye. Each detection is in at most one pair:
/// the one in which the eyes agree best. A locator without kinematics pairs the first detections of
/// both eyes.
pub(super) fn pairs(
    ready: &ReadyLocator,
    encoders: &JointAngles,
    stands: Option<&Standing>,
    [left, right]: [&[Glimpse]; 2],
) -> (Vec<StereoView>, Vec<(usize, Glimpse)>) {
    let view = |l: &Glimpse, r: &Glimpse| StereoView { eyes: [*l, *r], encoders: *encoders, is_timed: true };
    let mut all = Vec::new();
    for (i, l) in left.iter().enumerate() {
        for (k, r) in right.iter().enumerate() {
            let view = view(l, r);
            let misfit = match ready.rays(&view) {
                Some(rays) => misfit(&rays, stands),
                None => (i + k == 0).then_some(0.0),
            };
            all.extend(misfit.map(|misfit| (misfit, i, k, view)));
        }
    }
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken: Vec<(usize, usize, StereoView)> = Vec::new();
    for (_, i, k, view) in all {
        if taken.iter().all(|(a, b, _)| *a != i && *b != k) {
            taken.push((i, k, view));
        }
    }
    taken.sort_by_key(|(i, k, _)| i + k);
    let lone = |eye: usize, glimpses: &[Glimpse]| {
        let in_pair = |at: usize| taken.iter().any(|(i, k, _)| at == if eye == 0 { *i } else { *k });
        let lone = glimpses.iter().enumerate().filter(|(at, _)| !in_pair(*at));
        lone.map(|(_, glimpse)| (eye, *glimpse)).collect::<Vec<_>>()
    };
    let lone = [lone(0, left), lone(1, right)].concat();
    (taken.into_iter().map(|(.., view)| view).collect(), lone)
}

/// Returns the misfit of two rays to one object, at most 1; `None`: they belong to two objects.
fn misfit(rays: &[Ray; 2], stands: Option<&Standing>) -> Option<f64> {
    let beside = stands.and_then(|standing| standing.beside(rays)).unwrap_or(0.0);
    let misfit = f64::max(askew(rays)?, beside) / MAX_ANGLE_RAD;
    (misfit <= 1.0).then_some(misfit)
}

/// Returns the angle at which two rays pass each other, seen from their origins, rad; `None` if
/// they do not approach each other in front of the eyes.
fn askew([(a, u), (b, v)]: &[Ray; 2]) -> Option<f64> {
    let normal = u.cross(v);
    let square = normal.norm_squared();
    let between = b - a;
    // Distance along the first ray to the point of closest approach.
    let far = between.cross(v).dot(&normal) / square.max(1e-12);
    (far > 0.0).then(|| (between.dot(&normal) / square.sqrt().max(1e-6)).abs() / far)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn toward(from: [f64; 3], to: [f64; 3]) -> Ray {
        let (from, to) = (Vector3::from(from), Vector3::from(to));
        (from, (to - from).normalize())
    }

    const EYES: [[f64; 3]; 2] = [[0.0, 0.034, 0.3], [0.0, -0.034, 0.3]];

    #[test]
    fn rays_to_one_thing_agree_and_rays_to_two_things_do_not() {
        let table = Standing { z_m: -0.1, sd_mm: 5.0, behind_mm: 0.0 };
        let both = |left: [f64; 3], right: [f64; 3]| [toward(EYES[0], left), toward(EYES[1], right)];
        let cup = [0.35, 0.05, -0.1];
        assert!(misfit(&both(cup, cup), Some(&table)).is_some_and(|m| m < 1e-6));
        // Each camera off by a degree, to opposite sides.
        let off = [[0.35, 0.059, -0.1], [0.36, 0.041, -0.1]];
        assert!(misfit(&both(off[0], off[1]), Some(&table)).is_some_and(|m| m < 0.6));
        let other = [0.35, 0.13, -0.1];
        assert_eq!(misfit(&both(cup, other), Some(&table)), None, "beside it");
        assert_eq!(misfit(&both(cup, [0.2, 0.05, -0.1]), None), None, "nearer to the robot: rays pass each other");
        assert_eq!(askew(&both([0.35, 1.0, -0.1], [0.35, -1.0, -0.1])), None, "rays that part");
    }
}
