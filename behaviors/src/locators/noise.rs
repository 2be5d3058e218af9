//! How far what is seen is off, from one view to the next: pixels of both eyes together, and the pose of a head that moves.

use super::head::JointAngles;
use super::looking::Looking;
use super::model::invert;
use super::view::StereoView;
use nalgebra::{Matrix4, Vector3, Vector4};
use serde::{Deserialize, Serialize};

/// How much the part of a step by which a picture is late scatters, for both eyes together and for each alone: measured on the
/// recorded views of a Katana's block, 0.15 and 0.07.
const LATE: (f64, f64) = (0.15, 0.07);
/// How uncertain torso pitch, roll and yaw are while the head moves, rad.
const SWAY: [f64; 3] = [0.012, 0.007, 0.005];
/// A joint is at rest within this, rad.
const AT_REST: f64 = 0.005;
/// How often a joint that is midway between two rests has come from the farther one.
const FARTHER: f64 = 0.15;

/// Where joints rest in the training data, if they rest at few values, rad: one list for each joint. A reading between two rests was
/// taken after a motion had begun, and the picture before.
pub(super) type Rests = Vec<Vec<f64>>;

/// One explanation of a reading: how far each joint is from where it had rested, and how likely that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Origin {
    pub(super) toward: JointAngles,
    pub(super) ln_share: f64,
}

/// Finds rests: values that at least 7 % of the views share, for joints that are at such values in at least half of all views.
pub(super) fn find_rests<'a>(views: impl Iterator<Item = &'a StereoView> + Clone) -> Rests {
    let all = views.filter(|v| !v.is_timed);
    // the torso's motors do not settle at what they were sent
    let joint = |j: usize| {
        let mut values: Vec<f64> = all.clone().filter_map(|v| v.encoders.get(j).copied()).collect();
        values.sort_by(f64::total_cmp);
        let (mut rests, mut at_rest, mut from) = (Vec::new(), 0, 0);
        while let Some(first) = values.get(from) {
            let cluster: Vec<f64> =
                values.iter().skip(from).copied().take_while(|v| v - first < 2.0 * AT_REST).collect();
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

/// How a reading may have come about, the likeliest first.
pub(super) fn origins(view: &StereoView, rests: &Rests) -> Vec<Origin> {
    let mut nearest = Origin { toward: [0.0; 9], ln_share: 0.0 };
    let mut turns: Vec<(usize, f64)> = Vec::new();
    if view.is_timed {
        return vec![nearest];
    }
    for (j, (rests, read)) in rests.iter().zip(view.encoders).enumerate() {
        let mut away: Vec<f64> = rests.iter().map(|r| r - read).collect();
        away.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        let Some(first) = away.first().filter(|a| a.abs() > AT_REST) else { continue };
        nearest.toward[j] = *first;
        if let Some(second) = away.get(1).filter(|s| s.abs() < 2.0 * first.abs()) {
            turns.push((j, *second));
            nearest.ln_share += (1.0 - FARTHER).ln();
        }
    }
    let turned = |(j, second): (usize, f64)| {
        let mut other = nearest;
        other.toward[j] = second;
        other.ln_share += (FARTHER / (1.0 - FARTHER)).ln();
        other
    };
    std::iter::once(nearest).chain(turns.into_iter().map(turned)).collect()
}

/// How pixels scatter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// The covariance of left u and v, right u and v together, of a head at rest, square pixels.
    pub resting: Matrix4<f64>,
    /// What is added for an eye whose picture's border cuts the object off, square pixels, across and down.
    pub clipped: [f64; 2],
}

impl Noise {
    /// Whether such a scatter can be.
    pub(super) fn is_sound(&self) -> bool {
        self.clipped.iter().all(|c| c.is_finite() && *c >= 0.0) && invert(&self.resting).is_some()
    }

    /// The covariance of the pixels in this view, of something that is about there.
    pub(super) fn of(
        &self,
        view: &StereoView,
        looking: &Looking,
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
        all += moved * moved.transpose() * LATE.0.powi(2);
        for e in 0..2 {
            let one = moved.fixed_rows::<2>(2 * e);
            let own = one * one.transpose() * LATE.1.powi(2);
            let mut block = all.fixed_view_mut::<2, 2>(2 * e, 2 * e);
            block += own;
        }
        for (j, sway) in SWAY.into_iter().enumerate() {
            let by = by_joint.column(j) * sway;
            all += by * by.transpose();
        }
        all
    }
}
