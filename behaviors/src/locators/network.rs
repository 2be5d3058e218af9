//! The kind `network`: the paper's learned locator, as published. One network for each axis, ten logistic units between inputs and a
//! linear output, plain back-propagation, one view at a time.

use super::beginning::Untaught;
use super::folds::{Fold, folds};
use super::honest::{common, fused, widening};
use super::view::{Estimate, KnownView, StereoView};
use nalgebra::{Matrix3, Vector3};
use rand::seq::SliceRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Units between inputs and output.
const HIDDEN: usize = 10;
/// Of back-propagation: its rate, its momentum, and how often all views are shown.
const RATE: f64 = 0.35;
const MOMENTUM: f64 = 0.1;
const EPOCHS: usize = 500;
/// Limits between which pixels are scaled to -1 to 1.
const PIXELS: [(f64, f64); 2] = [(0.0, 640.0), (0.0, 480.0)];
/// The same for joints, degrees: torso pitch, roll and yaw, neck pitch, roll and yaw, eyes' tilt, version and vergence.
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
/// The same for places, mm.
const PLACE_MM: [(f64, f64); 3] = [(100.0, 600.0), (-550.0, 300.0), (-300.0, 200.0)];

/// The published locator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedNetwork {
    /// Whether it is told the boxes beside their middles.
    pub has_boxes: bool,
    /// One network for each axis.
    pub axes: Vec<AxisNetwork>,
    /// The covariance of its errors at places that were left out, square meters, widened so that 95 % of them are inside the region of
    /// 95 %.
    pub covariance: Matrix3<f64>,
    /// What all views of one place have in common in how they are off, square meters.
    pub common: Matrix3<f64>,
}

/// A network for one axis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisNetwork {
    /// The weights of each hidden unit: one for each input, and the bias.
    pub hidden: Vec<Vec<f64>>,
    /// The weights of the output: one for each hidden unit, and the bias.
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

    fn ask(&self, inputs: &[f64], units: &mut Vec<f64>) -> f64 {
        let sum = |weights: &[f64], values: &[f64]| {
            let bias = weights.last().copied().unwrap_or_default();
            weights.iter().zip(values).map(|(w, v)| w * v).sum::<f64>() + bias
        };
        units.clear();
        units.extend(self.hidden.iter().map(|h| 1.0 / (1.0 + (-sum(h, inputs)).exp())));
        sum(&self.output, units)
    }

    /// Back-propagation, one lesson at a time in a new order each epoch.
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
                let error = target - self.ask(inputs, &mut units);
                for (k, unit) in units.iter().enumerate() {
                    let back = error * self.output[k] * unit * (1.0 - unit);
                    let (weights, steps) = (&mut self.hidden[k], &mut before.hidden[k]);
                    for ((w, s), v) in weights.iter_mut().zip(steps).zip(inputs.iter().chain([&1.0])) {
                        *s = RATE * back * v + MOMENTUM * *s;
                        *w += *s;
                    }
                }
                for ((w, s), v) in self.output.iter_mut().zip(&mut before.output).zip(units.iter().chain([&1.0])) {
                    *s = RATE * error * v + MOMENTUM * *s;
                    *w += *s;
                }
            }
            tell();
        }
    }
}

impl PublishedNetwork {
    /// Learns from views of known places; `tell` hears how far it is.
    ///
    /// # Errors
    /// Too few views or places, or views with which learning does not converge.
    pub fn train(known: &[KnownView], seed: u64, tell: &mut dyn FnMut(f64)) -> Result<PublishedNetwork, Untaught> {
        let folds = folds(known, seed)?;
        let (steps, mut done) = ((3 * EPOCHS * (folds.len() + 1)) as f64, 0.0);
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

    /// Whether it has all its numbers, and these can be.
    pub(super) fn is_whole(&self) -> bool {
        let inputs = if self.has_boxes { 21 } else { 13 };
        let axes = self.axes.len() == 3 && self.axes.iter().all(|a| a.is_whole(inputs));
        axes && self.covariance.cholesky().is_some() && self.common.iter().all(|n| n.is_finite())
    }

    /// Where what was seen is.
    pub fn locate(&self, view: &StereoView) -> Option<Estimate> {
        let (inputs, mut units) = (inputs(view, self.has_boxes), Vec::new());
        let mut axis = |(network, (low, high)): (&AxisNetwork, (f64, f64))| {
            low + (network.ask(&inputs, &mut units) + 1.0) * 0.5 * (high - low)
        };
        let mm: Vec<f64> = self.axes.iter().zip(PLACE_MM).map(&mut axis).collect();
        let place = Vector3::from_iterator(mm.iter().map(|v| v / 1e3).chain([0.0; 3]).take(3));
        Some(Estimate { place, covariance: self.covariance })
    }
}
