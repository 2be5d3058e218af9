//! The kind `triangulate`: triangulation of the two eyes' rays by nominal kinematics, refined to
//! the maximum likelihood.

use super::beginning::{Beginning, Untaught};
use super::fit::{Lesson, off, scatter};
use super::honest::{common, fused, widening};
use super::model::{HeadModel, invert};
use super::noise::{Noise, ReadingOrigin};
use super::posterior::best_place;
use super::view::{Estimate, KnownView, StereoView};
use super::workspace::Expected;
use nalgebra::{Matrix3, Matrix4};
use serde::{Deserialize, Serialize};

/// Standard deviation of the prior about the triangulated point, m: the rays may contain next to no
/// information on the distance.
const PRIOR_SIGMA_M: f64 = 2.0;
/// Standard deviation of the pixels without training views, pixels.
const DEFAULT_SIGMA_PX: f64 = 2.0;

/// A locator that is trained only for the frame of the positions and its own noise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Triangulated {
    /// Kinematic model of the head.
    pub model: HeadModel,
    /// Noise of the pixels about its predictions.
    pub noise: Noise,
    /// Factor of the covariance that makes 95 % of the positions fall inside their 95 % regions.
    pub widening: f64,
    /// Covariance of the error that all views of one position share, m^2.
    pub common: Matrix3<f64>,
}

impl Triangulated {
    /// Trains a locator with nominal kinematics in the frame of the positions of these views;
    /// without views, in the frame of `from`.
    ///
    /// # Errors
    /// Views from which the frame can't be estimated.
    pub fn train(known: &[KnownView], from: &Beginning) -> Result<Triangulated, Untaught> {
        let model = from.model(known)?;
        let noise = Noise { resting: Matrix4::identity() * DEFAULT_SIGMA_PX.powi(2), clipped: [0.0; 2] };
        let mut learned = Triangulated { model, noise, widening: 1.0, common: Matrix3::zeros() };
        let rest = ReadingOrigin { toward: [0.0; 9], ln_share: 0.0 };
        let offs: Vec<_> =
            known.iter().filter_map(|known| off(&learned.model, &Lesson { known, origin: rest })).collect();
        if !offs.is_empty() {
            learned.noise.resting = scatter(&offs);
        }
        let square = |k: &KnownView| learned.locate(&k.view).map(|e| e.distance(&k.place));
        learned.widening = widening(known.iter().filter_map(square).collect());
        learned.common = common(&fused(known, &|view| learned.locate(view)));
        Ok(learned)
    }

    /// Returns whether all numbers are present and valid.
    pub(super) fn is_whole(&self) -> bool {
        self.model.is_whole()
            && self.noise.is_sound()
            && self.widening.is_finite()
            && self.widening > 0.0
            && self.common.iter().all(|n| n.is_finite())
    }

    /// Estimates the position of an object from one view; `None` if the rays do not meet in front
    /// of the eyes.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        let looking = self.model.look(&view.encoders, &[0.0; 9]);
        let start = looking.midpoint(&view.pixels())?;
        let weak = Expected::normal(start, Matrix3::identity() * PRIOR_SIGMA_M.powi(2), 1.0)?;
        let (information, _) = invert(&self.noise.resting)?;
        let best = best_place(&looking, &view.pixels(), &information, &weak, start)?;
        let covariance = (best.information + weak.information).try_inverse()? * self.widening;
        Some(Estimate { place: best.place, covariance })
    }
}
