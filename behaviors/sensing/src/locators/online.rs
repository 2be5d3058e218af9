//! A calibration that monitors itself on a sequence of views of known positions: if the offset of
//! an encoder jumps, it identifies the joint and corrects the offset.
//!
//! For the newest 10, 20 and 40 views and each joint, the offset of that joint alone is fitted
//! robustly. A jump is accepted if it raises the likelihood of these views by a large factor, and
//! by more than for any other joint.

use super::calibrated::Calibrated;
use super::fit::{Lesson, fit};
use super::head::JOINTS;
use super::noise::ReadingOrigin;
use super::parameters::{OFFSETS, priors};
use super::view::KnownView;
use nalgebra::{DMatrix, Matrix4, Vector4};
use std::collections::VecDeque;

/// Maximum number of stored views.
const MAX_VIEWS: usize = 60;
/// Numbers of the newest views that are tested.
const WINDOWS: [usize; 3] = [10, 20, 40];
/// Minimum increase of the log-likelihood for a jump.
const MIN_GAIN: f64 = 15.0;
/// Minimum difference of that to the next likely joint, except for the largest window.
const MIN_GAIN_MARGIN: f64 = 5.0;
/// Degrees of freedom of Student's t-distribution.
const NU: f64 = 4.0;

/// A jump of an encoder's offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Index of the joint in [`JOINTS`].
    pub joint: usize,
    /// Decrease of the reading, rad.
    pub by: f64,
}

impl Jump {
    /// Name of the joint.
    pub fn name(&self) -> &'static str {
        JOINTS.get(self.joint).copied().unwrap_or_default()
    }
}

/// A calibration that corrects jumps of encoder offsets.
#[derive(Clone, Debug)]
pub struct OnlineCalibration {
    learned: Calibrated,
    recent: VecDeque<KnownView>,
}

impl OnlineCalibration {
    /// Creates it from a trained locator.
    pub fn new(learned: Calibrated) -> OnlineCalibration {
        OnlineCalibration { learned, recent: VecDeque::new() }
    }

    /// The current calibration.
    pub fn learned(&self) -> &Calibrated {
        &self.learned
    }

    /// Adds a view of a known position. If the recent views show that an encoder has jumped,
    /// corrects the calibration and returns the jump.
    pub fn see(&mut self, known: KnownView) -> Option<Jump> {
        if self.recent.len() == MAX_VIEWS {
            self.recent.pop_front();
        }
        self.recent.push_back(known);
        let information = self.learned.noise.resting.try_inverse()?;
        // Newest first.
        let seen: Vec<_> = self.recent.iter().rev().filter_map(|k| self.misfit(k)).collect();
        let best = WINDOWS.into_iter().filter_map(|n| {
            let seen = seen.get(..n)?;
            let mut joints: Vec<_> = (0..9).map(|joint| (joint, jump(seen, joint, &information))).collect();
            joints.sort_by(|a, b| b.1.1.total_cmp(&a.1.1));
            let ((joint, (by, gain)), (_, (_, second))) = (*joints.first()?, *joints.get(1)?);
            // In the largest window, the most likely joint is accepted without a margin.
            let is_accepted = gain > MIN_GAIN && (gain - second > MIN_GAIN_MARGIN || Some(&n) == WINDOWS.last());
            is_accepted.then_some((n, joint, by, gain))
        });
        let (n, joint, by, _) = best.max_by(|a, b| a.3.total_cmp(&b.3))?;
        // Views from before the jump would bias the fit.
        self.recent.drain(..self.recent.len().saturating_sub(n));
        self.learned.model.theta[OFFSETS + joint] += by;
        self.refine(joint);
        Some(Jump { joint, by })
    }

    /// Returns the residual of a view and its derivatives with respect to the joints.
    fn misfit(&self, known: &KnownView) -> Option<(Vector4<f64>, [Vector4<f64>; 9])> {
        let looking = self.learned.model.look(&known.view.encoders, &[0.0; 9]);
        let off = known.view.pixels() - looking.see(&known.place)?.pixels;
        let by = looking.by_joint(&known.place)?;
        Some((off, std::array::from_fn(|j| by.column(j).into())))
    }

    /// Refits all parameters to the newest views, each close to its current value; the joint that
    /// jumped may move freely.
    fn refine(&mut self, joint: usize) {
        let has_rests = self.learned.rests.iter().any(|r| !r.is_empty());
        let mut near = priors(has_rests, self.learned.model.warp.is_some());
        for (prior, theta) in near.iter_mut().zip(&self.learned.model.theta) {
            (prior.middle, prior.deviation) = (*theta, 0.02 * prior.deviation);
        }
        near[OFFSETS + joint].deviation = 0.05;
        let origin = ReadingOrigin { toward: [0.0; 9], ln_share: 0.0 };
        let recent: Vec<KnownView> = self.recent.iter().copied().collect();
        let lessons: Vec<_> = recent.iter().map(|known| Lesson { known, origin }).collect();
        let _: DMatrix<f64> = fit(&mut self.learned.model, &lessons, &self.learned.noise, &near);
    }
}

fn strange(off: &Vector4<f64>, information: &Matrix4<f64>) -> f64 {
    0.5 * (NU + 4.0) * (off.dot(&(information * off)) / NU).ln_1p()
}

/// Returns the offset of this joint that maximizes the likelihood of these views, rad, and the
/// increase of the log-likelihood.
fn jump(seen: &[(Vector4<f64>, [Vector4<f64>; 9])], joint: usize, information: &Matrix4<f64>) -> (f64, f64) {
    let mut by = 0.0;
    for _ in 0..6 {
        let mut sum = 0.0;
        let mut curvature = 1.0;
        for (off, moves) in seen {
            let left = off - moves[joint] * by;
            let weight = (NU + 4.0) / (NU + left.dot(&(information * left)));
            let white = information * moves[joint] * weight;
            sum += white.dot(&left);
            curvature += white.dot(&moves[joint]);
        }
        by += sum / curvature;
    }
    let gain = |(off, moves): &(Vector4<f64>, [Vector4<f64>; 9])| {
        strange(off, information) - strange(&(off - moves[joint] * by), information)
    };
    (by, seen.iter().map(gain).sum())
}
