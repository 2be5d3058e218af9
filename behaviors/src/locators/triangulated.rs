//! The kind `triangulate`: where the rays of the two eyes pass each other, by what the drawings say of the head, made most likely.

use super::beginning::{Beginning, Untaught};
use super::fit::{Lesson, off, scatter};
use super::honest::{common, fused, widening};
use super::model::{HeadModel, invert};
use super::noise::{Noise, Origin};
use super::posterior::best_place;
use super::view::{Estimate, KnownView, StereoView};
use super::workspace::Expected;
use nalgebra::{Matrix3, Matrix4};
use serde::{Deserialize, Serialize};

/// Beyond this many meters from where the rays pass each other, a place is hardly believed: what they say of the distance may be next
/// to nothing.
const FAR_M: f64 = 2.0;
/// How pixels scatter if no views tell, pixels.
const PIXELS: f64 = 2.0;

/// A locator that learns nothing but in which frame places are told, and how far it is off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Triangulated {
    /// The head.
    pub model: HeadModel,
    /// How pixels scatter about what it says.
    pub noise: Noise,
    /// By what the covariance has to be multiplied so that 95 % of the places are inside the regions of 95 %.
    pub widening: f64,
    /// What all views of one place have in common in how they are off, square meters.
    pub common: Matrix3<f64>,
}

impl Triangulated {
    /// One by these drawings, in the frame of the places of these views; with none, in the head's own frame.
    ///
    /// # Errors
    /// Views from which no frame can be found.
    pub fn train(known: &[KnownView], from: &Beginning) -> Result<Triangulated, Untaught> {
        let model = from.model(known)?;
        let noise = Noise { resting: Matrix4::identity() * PIXELS.powi(2), clipped: [0.0; 2] };
        let mut learned = Triangulated { model, noise, widening: 1.0, common: Matrix3::zeros() };
        let rest = Origin { toward: [0.0; 9], ln_share: 0.0 };
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

    /// Whether it has all its numbers, and these can be.
    pub(super) fn is_whole(&self) -> bool {
        self.model.is_whole()
            && self.noise.is_sound()
            && self.widening.is_finite()
            && self.widening > 0.0
            && self.common.iter().all(|n| n.is_finite())
    }

    /// Where what was seen is; `None` if the rays do not meet before the eyes.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        let looking = self.model.look(&view.encoders, &[0.0; 9]);
        let start = looking.midpoint(&view.pixels())?;
        let weak = Expected::normal(start, Matrix3::identity() * FAR_M.powi(2), 1.0)?;
        let (information, _) = invert(&self.noise.resting)?;
        let best = best_place(&looking, &view.pixels(), &information, &weak, start)?;
        let covariance = (best.information + weak.information).try_inverse()? * self.widening;
        Some(Estimate { place: best.place, covariance })
    }
}
