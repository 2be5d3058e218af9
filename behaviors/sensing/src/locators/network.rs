//! The kind `network`: the paper's learned locator, as published. One network for each axis, with
//! ten logistic hidden units and a linear output, trained by plain back-propagation, one view at a
//! time.

use super::beginning::Untaught;
use super::folds::{Fold, folds};
use super::honest::{common, fused, widening};
use super::view::{Estimate, KnownView, StereoView};
use nalgebra::{Matrix3, Vector3};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Number of hidden units.
const HIDDEN: usize = 10;
/// Learning rate of the back-propagation.
const LEARNING_RATE: f64 = 0.35;
/// Momentum of the back-propagation.
const MOMENTUM: f64 = 0.1;
/// Number of passes over all views.
const EPOCHS: usize = 500;
/// Ranges of pixels that are scaled to -1 to 1.
const PIXELS: [(f64, f64); 2] = [(0.0, 640.0), (0.0, 480.0)];
/// The same for joints, degrees: torso pitch, roll and yaw, neck pitch, roll and yaw, eyes' tilt,
/// version and vergence.
const DEGREES: [(f64, f64); 9] = [
    (0.0, 50.0),
    (-15.0, 15.0),
    (-20.0, 20.0),
    (-40.0, 10.0),
    (-10.0, 10.0),
    (-10.0, 10.0),
    (-25.0, 25.0),
    (-25.0, 25.0),
    (-10.0, 10.0),
];
/// The same for positions, mm.
const PLACE_MM: [(f64, f64); 3] = [(100.0, 600.0), (-550.0, 300.0), (-300.0, 200.0)];

/// The published locator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedNetwork {
    /// The inputs include the bounding boxes, not only their centers.
    pub has_boxes: bool,
    /// One network for each axis.
    pub axes: Vec<AxisNetwork>,
    /// Covariance of the errors at held-out positions, m^2, widened so that 95 % of the positions
    /// fall inside their 95 % regions.
    pub covariance: Matrix3<f64>,
    /// Covariance of the error that all views of one position share, m^2.
    pub common: Matrix3<f64>,
}

/// A network for one axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisNetwork {
    /// Weights of each hidden unit: one for each input, then the bias.
    pub hidden: Vec<Vec<f64>>,
    /// Weights of the output: one for each hidden unit, then the bias.
    pub output: Vec<f64>,
}

fn scaled(value: f64, (low, high): (f64, f64)) -> f64 {
    2.0 * (value - low) / (high - low) - 1.0
}

fn inputs(view: &StereoView, has_boxes: bool) -> Vec<f64> {
    let mut all = Vec::with_capacity(21);
    for eye in &view.eyes {
        if has_boxes {
            let bounds = eye.bounds.unwrap_or([eye.center[0], eye.center[1], 0.0, 0.0]);
            all.extend(bounds.iter().zip(PIXELS.iter().cycle()).map(|(b, limits)| scaled(*b, *limits)));
        }
        all.extend(eye.center.iter().zip(PIXELS).map(|(c, limits)| scaled(*c, limits)));
    }
    all.extend(view.encoders.iter().zip(DEGREES).map(|(q, limits)| scaled(q.to_degrees(), limits)));
    all
}

impl AxisNetwork {
    fn new(inputs: usize, rng: &mut ChaCha8Rng) -> AxisNetwork {
        let mut weights = |n: usize| (0..=n).map(|_| rng.random_range(-0.3..0.3)).collect();
        AxisNetwork { hidden: (0..HIDDEN).map(|_| weights(inputs)).collect(), output: weights(HIDDEN) }
    }

    fn is_whole(&self, inputs: usize) -> bool {
        let rows = self.hidden.iter().all(|h| h.len() == inputs + 1) && self.output.len() == self.hidden.len() + 1;
        rows && self.hidden.iter().flatten().chain(&self.output).all(|w| w.is_finite())
    }

    fn evaluate(&self, inputs: &[f64], units: &mut Vec<f64>) -> f64 {
        let sum = |weights: &[f64], values: &[f64]| {
            let bias = weights.last().copied().unwrap_or_default();
            weights.iter().zip(values).map(|(w, v)| w * v).sum::<f64>() + bias
        };
        units.clear();
        units.extend(self.hidden.iter().map(|h| 1.0 / (1.0 + (-sum(h, inputs)).exp())));
        sum(&self.output, units)
    }

    /// Trains by back-propagation, one sample at a time in a new order in each epoch. `tell` is
    /// called after each epoch.
    fn learn(&mut self, lessons: &[(Vec<f64>, f64)], rng: &mut ChaCha8Rng, tell: &mut dyn FnMut()) {
        let mut order: Vec<usize> = (0..lessons.len()).collect();
        let mut before = AxisNetwork {
            hidden: self.hidden.iter().map(|h| vec![0.0; h.len()]).collect(),
            output: vec![0.0; self.output.len()],
        };
        let mut units = Vec::new();
        for _ in 0..EPOCHS {
            order.shuffle(rng);
            for (inputs, target) in order.iter().filter_map(|i| lessons.get(*i)) {
                let error = target - self.evaluate(inputs, &mut units);
                for (k, unit) in units.iter().enumerate() {
                    let back = error * self.output[k] * unit * (1.0 - unit);
                    let weights = &mut self.hidden[k];
                    let steps = &mut before.hidden[k];
                    for ((w, s), v) in weights.iter_mut().zip(steps).zip(inputs.iter().chain([&1.0])) {
                        *s = LEARNING_RATE * back * v + MOMENTUM * *s;
                        *w += *s;
                    }
                }
                for ((w, s), v) in self.output.iter_mut().zip(&mut before.output).zip(units.iter().chain([&1.0])) {
                    *s = LEARNING_RATE * error * v + MOMENTUM * *s;
                    *w += *s;
                }
            }
            tell();
        }
    }
}

impl PublishedNetwork {
    /// Trains on views of known positions; `tell` is called with the completed share.
    ///
    /// # Errors
    /// Too few views or positions, or a training that does not converge.
    pub fn train(known: &[KnownView], seed: u64, tell: &mut dyn FnMut(f64)) -> Result<PublishedNetwork, Untaught> {
        let folds = folds(known, seed)?;
        let steps = (3 * EPOCHS * (folds.len() + 1)) as f64;
        let mut done = 0.0;
        let mut epoch = || {
            done += 1.0;
            tell(done / steps);
        };
        let mut judges = Vec::new();
        for Fold { train, test } in &folds {
            let judge = PublishedNetwork::learn(train, seed, &mut epoch);
            judges.push((judge, test));
        }
        let mut learned = PublishedNetwork::learn(known, seed, &mut epoch);
        let off = |(judge, test): &(PublishedNetwork, &Vec<KnownView>)| {
            let off = |k: &KnownView| judge.locate(&k.view).map(|e| e.place - k.place);
            test.iter().filter_map(off).collect::<Vec<_>>()
        };
        let errors: Vec<_> = judges.iter().flat_map(off).collect();
        learned.covariance = errors.iter().map(|e| e * e.transpose()).sum::<Matrix3<f64>>() / errors.len() as f64;
        let region = Estimate { place: Vector3::zeros(), covariance: learned.covariance };
        learned.covariance *= widening(errors.iter().map(|e| region.distance(e)).collect());
        let covariance = learned.covariance;
        let together = |(judge, test): (PublishedNetwork, &Vec<KnownView>)| {
            fused(test, &|view| judge.locate(view).map(|e| Estimate { covariance, ..e }))
        };
        learned.common = common(&judges.into_iter().flat_map(together).collect::<Vec<_>>());
        if learned.is_whole() {
            Ok(learned)
        } else {
            Err(Untaught("learning did not converge: places or joints are far outside of the published limits".into()))
        }
    }

    fn learn(known: &[KnownView], seed: u64, epoch: &mut dyn FnMut()) -> PublishedNetwork {
        let has_boxes = known.iter().all(|k| k.view.eyes.iter().all(|e| e.bounds.is_some()));
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut axis = |a: usize| {
            let lesson = |k: &KnownView| (inputs(&k.view, has_boxes), scaled(1e3 * k.place[a], PLACE_MM[a]));
            let lessons: Vec<_> = known.iter().map(lesson).collect();
            let mut network = AxisNetwork::new(lessons.first().map_or(0, |l| l.0.len()), &mut rng);
            network.learn(&lessons, &mut rng, epoch);
            network
        };
        PublishedNetwork {
            has_boxes,
            axes: (0..3).map(&mut axis).collect(),
            covariance: Matrix3::identity(),
            common: Matrix3::zeros(),
        }
    }

    /// Returns whether all numbers are present and valid.
    pub(super) fn is_whole(&self) -> bool {
        let inputs = if self.has_boxes { 21 } else { 13 };
        let axes = self.axes.len() == 3 && self.axes.iter().all(|a| a.is_whole(inputs));
        axes && self.covariance.cholesky().is_some() && self.common.iter().all(|n| n.is_finite())
    }

    /// Estimates the position of an object from one view.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        let inputs = inputs(view, self.has_boxes);
        let mut units = Vec::new();
        let mut axis = |(network, (low, high)): (&AxisNetwork, (f64, f64))| {
            low + (network.evaluate(&inputs, &mut units) + 1.0) * 0.5 * (high - low)
        };
        let mm: Vec<f64> = self.axes.iter().zip(PLACE_MM).map(&mut axis).collect();
        let place = Vector3::from_iterator(mm.iter().map(|v| v / 1e3).chain([0.0; 3]).take(3));
        Some(Estimate { place, covariance: self.covariance })
    }
}
