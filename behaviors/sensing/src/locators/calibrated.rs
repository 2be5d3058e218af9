//! The kind `calibrated`: a kinematic model that estimates its own errors from views of known
//! positions.

use super::beginning::{Beginning, Untaught};
use super::fit::{Lesson, fit, inner_scatter, off, scatter};
use super::folds::{Fold, folds};
use super::honest::{common, places_of, widening};
use super::lens::Lens;
use super::model::HeadModel;
use super::noise::{Noise, Rests, find_rests, origins};
use super::parameters::{OFFSETS, Warp, priors};
use super::posterior::{Shares, locate};
use super::together::locate_together;
use super::tracker::fuse;

use super::view::{Estimate, KnownView, StereoView};
use super::workspace::{Expected, Workspace, distinct};
use nalgebra::{Matrix3, Matrix4, Vector3};
use serde::{Deserialize, Serialize};

/// Number of successive fits, each with the noise estimated by the previous one.
const FIT_ROUNDS: usize = 3;
/// Maximum ratio of the median residual at held-out positions with a warp to that without, for the
/// warp to be used.
const MAX_WARP_RATIO: f64 = 0.97;

/// A calibrated locator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibrated {
    /// Kinematic model of the head.
    pub model: HeadModel,
    /// Rest positions of each joint in the training data, rad; empty: the joint has none.
    pub rests: Vec<Vec<f64>>,
    /// Noise of the pixels.
    pub noise: Noise,
    /// Frequencies of gross errors.
    pub shares: Shares,
    /// Prior distribution of object positions.
    pub workspace: Workspace,
    /// Factor of the covariance that makes 95 % of held-out positions fall inside their 95 %
    /// regions.
    pub widening: f64,
    /// Covariance of the error that all views of one position share, m^2.
    pub common: Matrix3<f64>,
}

impl Calibrated {
    /// Trains on views of known positions. A warp of the positions is used if it reduces the error
    /// at held-out positions. `tell` is called with the completed share.
    ///
    /// # Errors
    /// Fewer than 20 views or 4 places.
    pub fn train(known: &[KnownView], from: &Beginning, tell: &mut dyn FnMut(f64)) -> Result<Calibrated, Untaught> {
        let folds = folds(known, from.seed)?;
        let steps = (2 * folds.len() + 1) as f64;
        let mut done = 0.0;
        let mut held_out = |has_warp: bool| -> Result<Vec<(Calibrated, Vec<KnownView>)>, Untaught> {
            let fold = |Fold { train, test }: &Fold| {
                let learned = Calibrated::learn(train, from, has_warp)?;
                done += 1.0;
                tell(done / steps);
                Ok((learned, test.clone()))
            };
            folds.iter().map(fold).collect()
        };
        let rigid = held_out(false)?;
        let warped = held_out(true)?;
        let has_warp = middle_misfit(&warped) < MAX_WARP_RATIO * middle_misfit(&rigid);
        let judges = if has_warp { warped } else { rigid };
        let mut learned = Calibrated::learn(known, from, has_warp)?;
        learned.widen(&judges);
        tell(1.0);
        Ok(learned)
    }

    /// Trains on all of these views without holding any out.
    pub fn learn(known: &[KnownView], from: &Beginning, has_warp: bool) -> Result<Calibrated, Untaught> {
        let rests = find_rests(known.iter().map(|k| &k.view));
        let has_rests = rests.iter().any(|r| !r.is_empty());
        let mut model = from.model(known)?;
        let squint = model.theta[OFFSETS + 8];
        model.warp = has_warp.then(|| warp(known));
        let priors = priors(has_rests, has_warp);
        model.theta = priors.iter().map(|p| p.middle).collect();
        model.theta[OFFSETS + 8] = squint;
        let lesson = |known| lesson(known, &rests);
        let lessons: Vec<_> = known.iter().filter(|k| !k.view.is_clipped()).filter_map(lesson).collect();
        let together = Matrix4::from_fn(|i, j| if i % 2 == j % 2 { 400.0 } else { 0.0 });
        let mut noise = Noise { resting: together + Matrix4::identity() * 16.0, clipped: [0.0; 2] };
        for _ in 0..FIT_ROUNDS {
            fit(&mut model, &lessons, &noise, &priors);
            noise.resting = scatter(&offs_at_rest(&model, &lessons));
        }
        noise.resting = inner_scatter(&offs_at_rest(&model, &lessons)) * 1.1;
        let clipped: Vec<_> = known.iter().filter(|k| k.view.is_clipped()).filter_map(lesson).collect();
        noise.clipped = clipped_scatter(&model, &clipped, &noise);
        let workspace = Workspace::new(known.iter().map(|k| k.place));
        let shares = Shares { astray: 0.04, one_eye: 0.02, both_eyes: 0.02 };
        Ok(Calibrated { model, rests, noise, shares, workspace, widening: 1.0, common: Matrix3::zeros() })
    }

    /// Returns whether all numbers are present and valid.
    pub(super) fn is_whole(&self) -> bool {
        let numbers = self.rests.iter().flatten().chain(&self.common).all(|n| n.is_finite());
        let parts = self.model.is_whole() && self.noise.is_sound() && self.shares.is_sound();
        let size = self.rests.len() == 9 && self.widening.is_finite() && self.widening > 0.0;
        parts && numbers && size && self.workspace.is_sound()
    }

    /// Returns the locator with its precomputed values.
    pub fn ready(&self) -> Ready {
        Ready { learned: self.clone(), expected: self.workspace.parts() }
    }

    /// Estimates at held-out positions by how much the covariances are too small, for single views
    /// and for all views of a position.
    fn widen(&mut self, judges: &[(Calibrated, Vec<KnownView>)]) {
        let mut squares = Vec::new();
        let mut fused = Vec::new();
        for (judge, test) in judges {
            let ready = judge.ready();
            squares.extend(test.iter().filter_map(|k| ready.locate(&k.view).map(|e| e.distance(&k.place))));
            fused.extend(places_of(test).into_iter().filter_map(|(place, views)| Some((ready.fuse(&views)?, place))));
        }
        self.widening = widening(squares);
        self.common = common(&fused);
    }
}

/// A calibrated locator with precomputed values.
#[derive(Clone, Debug)]
pub struct Ready {
    learned: Calibrated,
    expected: Vec<Expected>,
}

impl Ready {
    /// Kinematic model of the head.
    pub(super) fn model(&self) -> &HeadModel {
        &self.learned.model
    }

    /// Estimates the position of an object from one view.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        let of = &self.learned;
        let mut found = locate(&of.model, view, &origins(view, &of.rests), (&of.noise, &of.shares), &self.expected)?;
        found.covariance *= of.widening;
        Some(found)
    }

    /// Returns the covariance of the error that all views of one position share, m^2.
    pub fn common(&self) -> Matrix3<f64> {
        self.learned.common
    }

    /// Returns the left and right camera before the fit.
    pub fn lenses(&self) -> [Lens; 2] {
        self.learned.model.lenses
    }

    /// Estimates the position of an object that rested while all these views were taken.
    pub fn fuse(&self, views: &[StereoView]) -> Option<Estimate> {
        let of = &self.learned;
        let each: Vec<Estimate> = views.iter().filter_map(|v| self.locate(v)).collect();
        let guess = fuse(&each, &Matrix3::zeros())?.place;
        let views: Vec<_> = views.iter().map(|v| (*v, origins(v, &of.rests))).collect();
        let mut found = locate_together(&of.model, &views, (&of.noise, &of.shares), &self.expected, guess)?;
        found.covariance += of.common;
        Some(found)
    }
}

/// Pairs a view with its most likely explanation.
fn lesson<'a>(known: &'a KnownView, rests: &Rests) -> Option<Lesson<'a>> {
    origins(&known.view, rests).first().map(|o| Lesson { known, origin: *o })
}

fn warp(known: &[KnownView]) -> Warp {
    let places = distinct(known.iter().map(|k| k.place));
    let n = places.len().max(1) as f64;
    let center = places.iter().sum::<Vector3<f64>>() / n;
    let square = places.iter().map(|p| (p - center).component_mul(&(p - center))).sum::<Vector3<f64>>() / n;
    Warp { center, spread: square.map(|s| s.sqrt().max(0.02)) }
}

fn offs_at_rest(model: &HeadModel, lessons: &[Lesson]) -> Vec<nalgebra::Vector4<f64>> {
    let resting = lessons.iter().filter(|l| l.origin.toward.iter().all(|t| *t == 0.0));
    resting.filter_map(|l| off(model, l)).collect()
}

/// Returns the variance that clipping by the image border adds to the pixels, square pixels,
/// horizontally and vertically: estimated from the median residual, assuming a normal distribution.
fn clipped_scatter(model: &HeadModel, lessons: &[Lesson], noise: &Noise) -> [f64; 2] {
    let mut misfits = [Vec::new(), Vec::new()];
    for lesson in lessons {
        let Some(off) = off(model, lesson) else { continue };
        for (e, _) in lesson.known.view.eyes.iter().enumerate().filter(|(_, eye)| eye.is_clipped) {
            misfits[0].push(off[2 * e].abs());
            misfits[1].push(off[2 * e + 1].abs());
        }
    }
    [0, 1].map(|axis| {
        let all = &mut misfits[axis];
        all.sort_by(f64::total_cmp);
        let middle = all.get(all.len() / 2).map_or(0.0, |m| (1.48 * m).powi(2));
        (middle - noise.resting[(axis, axis)]).max(0.0)
    })
}

/// Returns the median residual at held-out positions, pixels.
fn middle_misfit(judges: &[(Calibrated, Vec<KnownView>)]) -> f64 {
    let mut all = Vec::new();
    for (judge, test) in judges {
        let lesson = |known| lesson(known, &judge.rests);
        let seen = test.iter().filter(|k| !k.view.is_clipped()).filter_map(lesson);
        all.extend(seen.filter_map(|l| off(&judge.model, &l)).map(|o| o.norm()));
    }
    all.sort_by(f64::total_cmp);
    all.get(all.len() / 2).copied().unwrap_or(f64::INFINITY)
}
