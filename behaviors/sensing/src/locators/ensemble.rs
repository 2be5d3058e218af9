//! The kind `ensemble`: stronger variants of the paper's networks. Their inputs include the
//! disparity of the two eyes, the triangulated position by nominal kinematics, and the joint
//! positions at the time of the exposure. Each of several networks is trained without one fifth of
//! the positions, at which its error is measured.

use super::beginning::{Beginning, Untaught};
use super::folds::{Fold, folds};
use super::honest::{common, fused, widening};
use super::model::HeadModel;
use super::noise::{Rests, find_rests, origins};
use super::view::{Estimate, KnownView, StereoView};
use nalgebra::{Matrix3, Vector3};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Number of hidden units.
const HIDDEN: usize = 20;
/// Number of passes over all views.
const EPOCHS: usize = 200;
/// Initial learning rate; it decreases linearly to 0.
const RATE: f64 = 0.003;
/// Limit of the Huber loss, in standard deviations of the positions: errors beyond it, such as
/// wrong detections, count linearly.
const HUBER_LIMIT: f64 = 0.3;
/// Weight decay per step, relative to the learning rate.
const WEIGHT_DECAY: f64 = 0.01;
/// Lag of the image behind the encoder reading, as a share of the distance to the joint's rest
/// position; estimated by calibrated heads.
const IMAGE_LAG: f64 = 0.56;
/// Number of inputs.
const INPUTS: usize = 20;

/// Several networks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ensemble {
    /// Nominal model of the head, in the frame of the positions.
    pub model: HeadModel,
    /// Rest positions of each joint in the training data, rad; empty: the joint has none.
    pub rests: Vec<Vec<f64>>,
    /// Mean and standard deviation of each input.
    pub inputs: Vec<(f64, f64)>,
    /// Mean and standard deviation of each coordinate of the positions, m.
    pub places: Vec<(f64, f64)>,
    /// The networks: weights of the hidden units, then of the outputs, each with its bias at the
    /// end.
    pub members: Vec<Vec<f64>>,
    /// Covariance of the errors at held-out positions, m^2.
    pub covariance: Matrix3<f64>,
    /// Factor of the covariance that makes 95 % of held-out positions fall inside their 95 %
    /// regions.
    pub widening: f64,
    /// Covariance of the error that all views of one position share, m^2.
    pub common: Matrix3<f64>,
}

fn features(model: &HeadModel, rests: &Rests, view: &StereoView, center: &Vector3<f64>) -> [f64; INPUTS] {
    let toward = origins(view, rests).first().map_or([0.0; 9], |o| o.toward);
    let joints: [f64; 9] = std::array::from_fn(|j| view.encoders[j] + IMAGE_LAG * toward[j]);
    let p = view.pixels();
    let met = model.look(&joints, &[0.0; 9]).midpoint(&p);
    // Distant points would dominate the scaling of the inputs.
    let met = met.map_or(Vector3::zeros(), |m| (m - center).map(|c| c.clamp(-0.4, 0.4)));
    let size = |axis: usize| {
        let one = |e: usize| view.eyes[e].bounds.map_or(0.0, |b| b[2 + axis].max(2.0).ln());
        0.5 * (one(0) + one(1))
    };
    let mut all = [0.0; INPUTS];
    let pixels_and_point = [p[0] + p[2], p[1] + p[3], p[0] - p[2], p[1] - p[3], size(0), size(1), met.x, met.y, met.z];
    all.iter_mut().zip(pixels_and_point.into_iter().chain(joints)).for_each(|(a, t)| *a = t);
    // Two cues for the distance: the size, and the disparity.
    all[18] = (-size(0)).exp();
    all[19] = 1.0 / (p[0] - p[2]).abs().max(5.0);
    all
}

fn spread(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let n = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / n;
    let square = values.map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (mean, if square > 1e-12 { square.sqrt() } else { 1.0 })
}

/// Activations of a network.
struct Activations {
    hidden: [f64; HIDDEN],
    output: [f64; 3],
}

fn evaluate(weights: &[f64], inputs: &[f64; INPUTS]) -> Activations {
    let sum =
        |row: &[f64], values: &[f64]| row.iter().zip(values.iter().chain([&1.0])).map(|(w, v)| w * v).sum::<f64>();
    let (first, second) = weights.split_at(HIDDEN * (INPUTS + 1));
    let mut hidden = [0.0; HIDDEN];
    let mut output = [0.0; 3];
    hidden.iter_mut().zip(first.chunks_exact(INPUTS + 1)).for_each(|(h, row)| *h = sum(row, inputs).tanh());
    output.iter_mut().zip(second.chunks_exact(HIDDEN + 1)).for_each(|(o, row)| *o = sum(row, &hidden));
    Activations { hidden, output }
}

const WEIGHTS: usize = HIDDEN * (INPUTS + 1) + 3 * (HIDDEN + 1);

fn learn(lessons: &[([f64; INPUTS], [f64; 3])], rng: &mut ChaCha8Rng, epoch: &mut dyn FnMut()) -> Vec<f64> {
    let mut weights: Vec<f64> = (0..WEIGHTS).map(|_| rng.random_range(-0.3..0.3)).collect();
    let mut mean = vec![0.0; WEIGHTS];
    let mut square = vec![0.0; WEIGHTS];
    let mut gradient = vec![0.0; WEIGHTS];
    let mut order: Vec<usize> = (0..lessons.len()).collect();
    let batch = 8;
    let mut steps = 0;
    for e in 0..EPOCHS {
        order.shuffle(rng);
        let rate = RATE * (1.0 - e as f64 / EPOCHS as f64);
        for part in order.chunks(batch) {
            gradient.fill(0.0);
            part.iter().filter_map(|i| lessons.get(*i)).for_each(|l| back(&weights, l, &mut gradient));
            steps += 1;
            let unbias = [1.0 - 0.9_f64.powi(steps), 1.0 - 0.999_f64.powi(steps)];
            for (((w, g), m), s) in weights.iter_mut().zip(&gradient).zip(&mut mean).zip(&mut square) {
                let g = g / part.len() as f64;
                *m = 0.9 * *m + 0.1 * g;
                *s = 0.999 * *s + 0.001 * g * g;
                *w -= rate * (*m / unbias[0] / ((*s / unbias[1]).sqrt() + 1e-8) + WEIGHT_DECAY * *w);
            }
        }
        epoch();
    }
    weights
}

/// Adds the gradient of the loss of one sample.
fn back(weights: &[f64], (inputs, target): &([f64; INPUTS], [f64; 3]), gradient: &mut [f64]) {
    let active = evaluate(weights, inputs);
    let error: [f64; 3] = std::array::from_fn(|i| active.output[i] - target[i]);
    let size = error.iter().map(|e| e * e).sum::<f64>().sqrt();
    let error = error.map(|e| e * (HUBER_LIMIT / size.max(HUBER_LIMIT)));
    let from = HIDDEN * (INPUTS + 1);
    let mut of_hidden = [0.0; HIDDEN];
    for (i, e) in error.into_iter().enumerate() {
        let at = from + i * (HIDDEN + 1);
        for (k, h) in active.hidden.iter().chain([&1.0]).enumerate() {
            gradient[at + k] += e * h;
        }
        of_hidden.iter_mut().zip(&weights[at..]).for_each(|(o, w)| *o += e * w);
    }
    for (k, (of, h)) in of_hidden.into_iter().zip(active.hidden).enumerate() {
        let of = of * (1.0 - h * h);
        for (g, v) in gradient[k * (INPUTS + 1)..].iter_mut().zip(inputs.iter().chain([&1.0])) {
            *g += of * v;
        }
    }
}

impl Ensemble {
    /// Trains on views of known positions; `tell` is called with the completed share.
    ///
    /// # Errors
    /// Too few views or positions.
    pub fn train(known: &[KnownView], from: &Beginning, tell: &mut dyn FnMut(f64)) -> Result<Ensemble, Untaught> {
        let folds = folds(known, from.seed)?;
        let model = from.model(known)?;
        let rests = find_rests(known.iter().map(|k| &k.view));
        let places: Vec<_> = (0..3).map(|i| spread(known.iter().map(move |k| k.place[i]))).collect();
        let mut all = Ensemble {
            model,
            rests,
            inputs: vec![(0.0, 1.0); INPUTS],
            places,
            members: Vec::new(),
            covariance: Matrix3::identity(),
            widening: 1.0,
            common: Matrix3::zeros(),
        };
        let raw: Vec<_> = known.iter().map(|k| all.scaled(&k.view)).collect();
        all.inputs = (0..INPUTS).map(|i| spread(raw.iter().map(move |r| r[i]))).collect();
        let steps = (EPOCHS * folds.len()) as f64;
        let mut done = 0.0;
        let mut rng = ChaCha8Rng::seed_from_u64(from.seed);
        let mut errors = Vec::new();
        for Fold { train, test } in &folds {
            let lesson = |k: &KnownView| {
                let place = std::array::from_fn(|i| (k.place[i] - all.places[i].0) / all.places[i].1);
                (all.scaled(&k.view), place)
            };
            let lessons: Vec<_> = train.iter().map(lesson).collect();
            let member = learn(&lessons, &mut rng, &mut || {
                done += 1.0;
                tell(done / steps);
            });
            errors.extend(test.iter().map(|k| all.place(&member, &k.view) - k.place));
            all.members.push(member);
        }
        all.covariance = errors.iter().map(|e| e * e.transpose()).sum::<Matrix3<f64>>() / errors.len() as f64;
        let region = Estimate { place: Vector3::zeros(), covariance: all.covariance };
        all.widening = widening(errors.iter().map(|e| region.distance(e)).collect());
        let covariance = all.covariance * all.widening;
        let together = |(member, fold): (&Vec<f64>, &Fold)| {
            fused(&fold.test, &|view| Some(Estimate { place: all.place(member, view), covariance }))
        };
        let fused: Vec<_> = all.members.iter().zip(&folds).flat_map(together).collect();
        all.common = common(&fused);
        Ok(all)
    }

    fn scaled(&self, view: &StereoView) -> [f64; INPUTS] {
        let center = Vector3::from_iterator(self.places.iter().map(|p| p.0));
        let mut all = features(&self.model, &self.rests, view, &center);
        all.iter_mut().zip(&self.inputs).for_each(|(a, (mean, deviation))| *a = (*a - mean) / deviation);
        all
    }

    fn place(&self, member: &[f64], view: &StereoView) -> Vector3<f64> {
        let active = evaluate(member, &self.scaled(view));
        Vector3::from_iterator(
            active.output.iter().zip(&self.places).map(|(o, (mean, deviation))| mean + o * deviation),
        )
    }

    /// Returns whether all numbers are present and valid.
    pub(super) fn is_whole(&self) -> bool {
        let lists = self.inputs.len() == INPUTS && self.places.len() == 3 && self.rests.len() == 9;
        let scales = self.inputs.iter().chain(&self.places).all(|(m, d)| m.is_finite() && d.is_finite() && *d > 0.0);
        let finite = self.members.iter().chain(&self.rests).flatten().all(|w| w.is_finite());
        let members = !self.members.is_empty() && self.members.iter().all(|m| m.len() == WEIGHTS);
        let size = self.widening.is_finite()
            && self.widening > 0.0
            && self.common.iter().all(|n| n.is_finite())
            && self.covariance.cholesky().is_some();
        lists && scales && finite && members && size && self.model.is_whole()
    }

    /// Estimates a position as the mean of the networks' outputs. The covariance is that at
    /// held-out positions plus that of the outputs.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        let n = self.members.len() as f64;
        let places: Vec<_> = self.members.iter().map(|m| self.place(m, view)).collect();
        let place = places.iter().sum::<Vector3<f64>>() / n;
        let differ = places.iter().map(|t| (t - place) * (t - place).transpose()).sum::<Matrix3<f64>>() / n;
        Some(Estimate { place, covariance: (self.covariance + differ) * self.widening })
    }
}
