//! A calibration that watches itself: views of known places come one after the other, and when an encoder's offset has jumped, it
//! names the joint and follows.
//!
//! For the newest 10, 20 and 40 views and each joint, the offset is fitted alone, robustly; a jump is believed if that makes these
//! views likelier by far, and more so than for any other joint.

use super::calibrated::Calibrated;
use super::fit::{Lesson, fit};
use super::head::JOINTS;
use super::noise::Origin;
use super::parameters::{OFFSETS, priors};
use super::view::KnownView;
use nalgebra::{DMatrix, Matrix4, Vector4};
use std::collections::VecDeque;

/// Views that are kept.
const KEPT: usize = 60;
/// Of these, the newest so many are looked at.
const WINDOWS: [usize; 3] = [10, 20, 40];
/// By how much the logarithm of their likelihood has to rise.
const BELIEVED: f64 = 15.0;
/// And by how much more than for the next likely joint, unless there are views enough.
const APART: f64 = 5.0;
/// The degrees of freedom of Student's distribution.
const NU: f64 = 4.0;

/// A jump of an encoder's offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jump {
    /// Which joint, by its place in [`JOINTS`].
    pub joint: usize,
    /// By how much it reads less than before, rad.
    pub by: f64,
}

impl Jump {
    /// The joint's name.
    pub fn name(&self) -> &'static str {
        JOINTS.get(self.joint).copied().unwrap_or_default()
    }
}

/// A calibration that follows jumps.
#[derive(Clone, Debug)]
pub struct OnlineCalibration {
    learned: Calibrated,
    recent: VecDeque<KnownView>,
}

impl OnlineCalibration {
    /// One that begins with what was learned.
    pub fn new(learned: Calibrated) -> OnlineCalibration {
        OnlineCalibration { learned, recent: VecDeque::new() }
    }

    /// What is believed now.
    pub fn learned(&self) -> &Calibrated {
        &self.learned
    }

    /// One more view of a known place. If it shows, with those before, that an encoder has jumped, the calibration follows, and says
    /// which.
    pub fn see(&mut self, known: KnownView) -> Option<Jump> {
        if self.recent.len() == KEPT {
            self.recent.pop_front();
        }
        self.recent.push_back(known);
        let information = self.learned.noise.resting.try_inverse()?;
        // newest first
        let seen: Vec<_> = self.recent.iter().rev().filter_map(|k| self.misfit(k)).collect();
        let best = WINDOWS.into_iter().filter_map(|n| {
            let seen = seen.get(..n)?;
            let mut joints: Vec<_> = (0..9).map(|joint| (joint, jump(seen, joint, &information))).collect();
            joints.sort_by(|a, b| b.1.1.total_cmp(&a.1.1));
            let ((joint, (by, gain)), (_, (_, second))) = (*joints.first()?, *joints.get(1)?);
            // with the most views that there are, the likeliest it is
            let is_told = gain > BELIEVED && (gain - second > APART || Some(&n) == WINDOWS.last());
            is_told.then_some((n, joint, by, gain))
        });
        let (n, joint, by, _) = best.max_by(|a, b| a.3.total_cmp(&b.3))?;
        // what is older than the jump would only mislead
        self.recent.drain(..self.recent.len().saturating_sub(n));
        self.learned.model.theta[OFFSETS + joint] += by;
        self.refine(joint);
        Some(Jump { joint, by })
    }

    /// What was seen less what the model says, and how that moves with the joints.
    fn misfit(&self, known: &KnownView) -> Option<(Vector4<f64>, [Vector4<f64>; 9])> {
        let looking = self.learned.model.look(&known.view.encoders, &[0.0; 9]);
        let off = known.view.pixels() - looking.see(&known.place)?.pixels;
        let by = looking.by_joint(&known.place)?;
        Some((off, std::array::from_fn(|j| by.column(j).into())))
    }

    /// Fits all parameters anew to the newest views, each held near what was learned; the joint that jumped may move freely.
    fn refine(&mut self, joint: usize) {
        let has_rests = self.learned.rests.iter().any(|r| !r.is_empty());
        let mut near = priors(has_rests, self.learned.model.warp.is_some());
        for (prior, theta) in near.iter_mut().zip(&self.learned.model.theta) {
            (prior.middle, prior.deviation) = (*theta, 0.02 * prior.deviation);
        }
        near[OFFSETS + joint].deviation = 0.05;
        let origin = Origin { toward: [0.0; 9], ln_share: 0.0 };
        let recent: Vec<KnownView> = self.recent.iter().copied().collect();
        let lessons: Vec<_> = recent.iter().map(|known| Lesson { known, origin }).collect();
        let _: DMatrix<f64> = fit(&mut self.learned.model, &lessons, &self.learned.noise, &near);
    }
}

fn strange(off: &Vector4<f64>, information: &Matrix4<f64>) -> f64 {
    0.5 * (NU + 4.0) * (off.dot(&(information * off)) / NU).ln_1p()
}

/// The offset of this joint that makes these views likeliest, rad, and by how much the logarithm of their likelihood rises.
fn jump(seen: &[(Vector4<f64>, [Vector4<f64>; 9])], joint: usize, information: &Matrix4<f64>) -> (f64, f64) {
    let mut by = 0.0;
    for _ in 0..6 {
        let (mut sum, mut curvature) = (0.0, 1.0);
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
