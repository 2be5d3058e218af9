//! Noise of an observation: pixels of both eyes together, and the pose of a moving head.

use super::head::JointAngles;
use super::looking::HeadView;
use super::model::invert;
use super::view::StereoView;
use nalgebra::{Matrix4, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// Standard deviation of the lag, for both eyes together and for each alone, as a share of the
/// joint's step: measured on the recorded views of a Katana's block.
const LAG_SIGMAS: (f64, f64) = (0.15, 0.07);
/// Standard deviation of torso pitch, roll and yaw while the head moves, rad.
const TORSO_SIGMA_RAD: [f64; 3] = [0.012, 0.007, 0.005];
/// Maximum distance of a joint from a rest position to be at rest, rad.
const REST_TOLERANCE_RAD: f64 = 0.005;
/// Probability that a joint between two rest positions came from the farther one.
const FARTHER_REST_SHARE: f64 = 0.15;

/// Rest positions of each joint in the training data, rad; empty if a joint has none. A reading
/// between two rest positions was taken after a motion had begun, and the image before.
pub(super) type Rests = Vec<Vec<f64>>;

/// An explanation of a reading: the distance of each joint from its rest position, and the
/// probability of that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReadingOrigin {
    pub(super) toward: JointAngles,
    pub(super) ln_share: f64,
}

/// Finds rest positions: values shared by at least 7 % of the views, for joints that are at such
/// values in at least half of all views.
pub(super) fn find_rests<'a>(views: impl Iterator<Item = &'a StereoView> + Clone) -> Rests {
    let all = views.filter(|v| !v.is_timed);
    // The torso is excluded: its motors do not settle at their setpoints.
    let joint = |j: usize| {
        let mut values: Vec<f64> = all.clone().filter_map(|v| v.encoders.get(j).copied()).collect();
        values.sort_by(f64::total_cmp);
        let mut rests = Vec::new();
        let mut at_rest = 0;
        let mut from = 0;
        while let Some(first) = values.get(from) {
            let cluster: Vec<f64> =
                values.iter().skip(from).copied().take_while(|v| v - first < 2.0 * REST_TOLERANCE_RAD).collect();
            if cluster.len() as f64 >= 0.07 * values.len() as f64 && cluster.len() > 3 {
                rests.push(cluster.iter().sum::<f64>() / cluster.len() as f64);
                at_rest += cluster.len();
                from += cluster.len();
            } else {
                from += 1;
            }
        }
        if 2 * at_rest >= values.len() && rests.len() > 1 { rests } else { Vec::new() }
    };
    (0..9).map(|j| if (3..8).contains(&j) { joint(j) } else { Vec::new() }).collect()
}

/// Returns the explanations of a reading, the most likely first.
pub(super) fn origins(view: &StereoView, rests: &Rests) -> Vec<ReadingOrigin> {
    let mut nearest = ReadingOrigin { toward: [0.0; 9], ln_share: 0.0 };
    let mut turns: Vec<(usize, f64)> = Vec::new();
    if view.is_timed {
        return vec![nearest];
    }
    for (j, (rests, read)) in rests.iter().zip(view.encoders).enumerate() {
        let mut away: Vec<f64> = rests.iter().map(|r| r - read).collect();
        away.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        let Some(first) = away.first().filter(|a| a.abs() > REST_TOLERANCE_RAD) else { continue };
        nearest.toward[j] = *first;
        if let Some(second) = away.get(1).filter(|s| s.abs() < 2.0 * first.abs()) {
            turns.push((j, *second));
            nearest.ln_share += (1.0 - FARTHER_REST_SHARE).ln();
        }
    }
    let turned = |(j, second): (usize, f64)| {
        let mut other = nearest;
        other.toward[j] = second;
        other.ln_share += (FARTHER_REST_SHARE / (1.0 - FARTHER_REST_SHARE)).ln();
        other
    };
    std::iter::once(nearest).chain(turns.into_iter().map(turned)).collect()
}

/// Noise of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Joint covariance of left u and v, right u and v for a head at rest, square pixels.
    pub resting: Matrix4<f64>,
    /// Variance added for an eye if the border of its image clips the object, square pixels,
    /// horizontally and vertically.
    pub clipped: [f64; 2],
}

impl Noise {
    /// Returns whether the noise is valid.
    pub(super) fn is_sound(&self) -> bool {
        self.clipped.iter().all(|c| c.is_finite() && *c >= 0.0) && invert(&self.resting).is_some()
    }

    /// Returns the covariance of the pixels in this view for an object near `place`.
    pub(super) fn of(
        &self,
        view: &StereoView,
        looking: &HeadView,
        toward: &JointAngles,
        place: &Vector3<f64>,
    ) -> Matrix4<f64> {
        let mut all = self.resting;
        for (e, _) in view.eyes.iter().enumerate().filter(|(_, eye)| eye.is_clipped) {
            all[(2 * e, 2 * e)] += self.clipped[0];
            all[(2 * e + 1, 2 * e + 1)] += self.clipped[1];
        }
        if toward.iter().all(|t| *t == 0.0) {
            return all;
        }
        let Some(by_joint) = looking.by_joint(place) else { return all };
        let moved: Vector4<f64> = by_joint * nalgebra::SVector::<f64, 9>::from(*toward);
        all += moved * moved.transpose() * LAG_SIGMAS.0.powi(2);
        for e in 0..2 {
            let one = moved.fixed_rows::<2>(2 * e);
            let own = one * one.transpose() * LAG_SIGMAS.1.powi(2);
            let mut block = all.fixed_view_mut::<2, 2>(2 * e, 2 * e);
            block += own;
        }
        for (j, sway) in TORSO_SIGMA_RAD.into_iter().enumerate() {
            let by = by_joint.column(j) * sway;
            all += by * by.transpose();
        }
        all
    }
}
