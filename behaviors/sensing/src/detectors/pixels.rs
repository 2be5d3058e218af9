//! A small network that maps the features of a pixel to the likelihood that it belongs to the
//! object: two hidden layers, trained by Adam (Kingma 2015) on as many pixels of the object as of
//! the background.

use super::features::FEATURES;
use super::picture::Mask;
use super::plane::Plane;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Numbers of inputs, hidden units, and outputs.
const LAYERS: [usize; 4] = [FEATURES, 24, 12, 1];
/// Number of pixels of the object, and of the background, drawn from each image.
const SAMPLES_PER_CLASS: usize = 1500;
/// Number of passes over the samples.
const EPOCHS: usize = 8;
/// Number of samples per step.
const BATCH: usize = 64;
/// Standard deviation of the noise added to features in training, in their standard deviations:
/// light and surroundings change.
const FEATURE_NOISE: f32 = 0.2;
/// Maximum distance of a feature from its mean, in standard deviations; farther ones are clamped.
const MAX_DEVIATION: f32 = 4.0;
/// Number of pixels evaluated together.
const PIXELS_AT_ONCE: usize = 128;

/// The network, and the scaling of its inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelNetwork {
    mean: Vec<f32>,
    scale: Vec<f32>,
    /// Per layer: for each unit its weights, then its bias.
    weights: Vec<Vec<f32>>,
}

impl PixelNetwork {
    /// Trains a network on features and masks of the same size; `None` without a pixel of the
    /// object, or of the background.
    pub fn learn(pictures: &[(&[Plane], &Mask)], rng: &mut ChaCha8Rng) -> Option<PixelNetwork> {
        let mut samples: Vec<([f32; FEATURES], f32)> = Vec::new();
        for (features, mask) in pictures {
            for wanted in [true, false] {
                let pixels: Vec<usize> = (0..mask.data.len()).filter(|i| mask.data[*i] == wanted).collect();
                for _ in 0..SAMPLES_PER_CLASS * usize::from(!pixels.is_empty()) {
                    let i = pixels[rng.random_range(0..pixels.len())];
                    samples.push((std::array::from_fn(|f| features[f].data[i]), f32::from(u8::from(wanted))));
                }
            }
        }
        let objects = samples.iter().filter(|s| s.1 > 0.5).count();
        if objects == 0 || objects == samples.len() {
            return None;
        }
        let n = samples.len() as f32;
        let mut network = PixelNetwork { mean: vec![], scale: vec![], weights: vec![] };
        for f in 0..FEATURES {
            let mean = samples.iter().map(|s| s.0[f]).sum::<f32>() / n;
            let variance = samples.iter().map(|s| (s.0[f] - mean).powi(2)).sum::<f32>() / n;
            network.mean.push(mean);
            network.scale.push(1.0 / variance.sqrt().max(1e-3));
        }
        for (sample, _) in &mut samples {
            for (f, v) in sample.iter_mut().enumerate() {
                *v = network.scaled(f, *v);
            }
        }
        for layer in LAYERS.windows(2) {
            let wide = (6.0 / (layer[0] + layer[1]) as f32).sqrt();
            let mut weights = Vec::new();
            for _ in 0..layer[1] {
                weights.extend((0..layer[0]).map(|_| rng.random_range(-wide..wide)));
                weights.push(0.0);
            }
            network.weights.push(weights);
        }
        Adam::new(&network).descend(&mut network, &samples, rng);
        Some(network)
    }

    fn scaled(&self, f: usize, v: f32) -> f32 {
        ((v - self.mean[f]) * self.scale[f]).clamp(-MAX_DEVIATION, MAX_DEVIATION)
    }

    /// Evaluates the log-odds that a pixel belongs to the object, as 128 + 20 ln(odds), 0 to 255.
    pub fn look(&self, features: &[Plane]) -> Plane {
        let first = &features[0];
        let mut out = Vec::with_capacity(first.data.len());
        for begin in (0..first.data.len()).step_by(PIXELS_AT_ONCE) {
            let n = PIXELS_AT_ONCE.min(first.data.len() - begin);
            let mut layer: Vec<[f32; PIXELS_AT_ONCE]> = vec![[0.0; PIXELS_AT_ONCE]; FEATURES];
            for (f, to) in layer.iter_mut().enumerate() {
                let from = &features[f].data[begin..begin + n];
                to.iter_mut().zip(from).for_each(|(to, v)| *to = self.scaled(f, *v));
            }
            for (l, weights) in self.weights.iter().enumerate() {
                let is_last = l + 1 == self.weights.len();
                let unit = |unit: &[f32]| {
                    let mut sum = [unit[unit.len() - 1]; PIXELS_AT_ONCE];
                    for (w, input) in unit.iter().zip(&layer) {
                        sum.iter_mut().zip(input).for_each(|(s, v)| *s += w * v);
                    }
                    if !is_last {
                        sum.iter_mut().for_each(|s| *s = s.max(0.1 * *s));
                    }
                    sum
                };
                layer = weights.chunks_exact(LAYERS[l] + 1).map(unit).collect();
            }
            out.extend(layer[0][..n].iter().map(|v| (128.0 + 20.0 * v).clamp(0.0, 255.0)));
        }
        first.like(out)
    }

    /// Returns whether all numbers are present and finite.
    pub fn is_whole(&self) -> bool {
        let lengths: Vec<usize> = self.weights.iter().map(Vec::len).collect();
        let expected: Vec<usize> = LAYERS.windows(2).map(|l| (l[0] + 1) * l[1]).collect();
        let mut numbers = self.weights.iter().flatten().chain(&self.mean).chain(&self.scale);
        lengths == expected
            && self.mean.len() == FEATURES
            && self.scale.len() == FEATURES
            && numbers.all(|v| v.is_finite())
    }
}

/// State of the optimizer: running means of the gradients and of their squares.
struct Adam {
    slope: Vec<Vec<f32>>,
    mean: Vec<Vec<f32>>,
    square: Vec<Vec<f32>>,
}

impl Adam {
    fn new(network: &PixelNetwork) -> Adam {
        let zeros: Vec<Vec<f32>> = network.weights.iter().map(|w| vec![0.0; w.len()]).collect();
        Adam { slope: zeros.clone(), mean: zeros.clone(), square: zeros }
    }

    fn descend(&mut self, network: &mut PixelNetwork, samples: &[([f32; FEATURES], f32)], rng: &mut ChaCha8Rng) {
        let steps = EPOCHS * samples.len() / BATCH;
        // Noise is drawn once and read at random offsets, which is cheaper than drawing it for each
        // sample.
        let mut noise = ChaCha8Rng::seed_from_u64(rng.random());
        let noise: Vec<f32> = (0..4096 + FEATURES)
            .map(|_| FEATURE_NOISE * (0..4).map(|_| noise.random_range(-0.866f32..0.866)).sum::<f32>())
            .collect();
        for step in 0..steps {
            for _ in 0..BATCH {
                let (sample, wanted) = &samples[rng.random_range(0..samples.len())];
                let at = rng.random_range(0..4096usize);
                let input: Vec<f32> = sample.iter().zip(&noise[at..]).map(|(v, n)| v + n).collect();
                self.learn(network, input, *wanted);
            }
            let rate = 0.003 * (1.0 - step as f32 / steps as f32).max(0.02);
            let warm1 = 1.0 - 0.9f32.powi(step as i32 + 1);
            let warm2 = 1.0 - 0.999f32.powi(step as i32 + 1);
            for (l, weights) in network.weights.iter_mut().enumerate() {
                let state = self.slope[l].iter_mut().zip(&mut self.mean[l]).zip(&mut self.square[l]);
                for (w, ((slope, mean), square)) in weights.iter_mut().zip(state) {
                    let g = *slope / BATCH as f32 + 1e-4 * *w;
                    *slope = 0.0;
                    *mean = 0.9 * *mean + 0.1 * g;
                    *square = 0.999 * *square + 0.001 * g * g;
                    *w -= rate * (*mean / warm1) / ((*square / warm2).sqrt() + 1e-8);
                }
            }
        }
    }

    /// Adds the gradient of one sample's cross entropy.
    fn learn(&mut self, network: &PixelNetwork, input: Vec<f32>, wanted: f32) {
        let mut values = vec![input];
        for (l, weights) in network.weights.iter().enumerate() {
            let from = &values[l];
            let is_last = l + 1 == network.weights.len();
            let unit = |unit: &[f32]| {
                let sum = unit[unit.len() - 1] + unit.iter().zip(from).map(|(w, v)| w * v).sum::<f32>();
                if is_last { sum } else { sum.max(0.1 * sum) }
            };
            values.push(weights.chunks_exact(from.len() + 1).map(unit).collect());
        }
        let odds = values[network.weights.len()][0];
        let mut wrong = vec![1.0 / (1.0 + (-odds).exp()) - wanted];
        for l in (0..network.weights.len()).rev() {
            let from = &values[l];
            let mut before = vec![0.0; from.len()];
            let units =
                network.weights[l].chunks_exact(from.len() + 1).zip(self.slope[l].chunks_exact_mut(from.len() + 1));
            for ((weights, slopes), wrong) in units.zip(&wrong) {
                for (((slope, w), v), b) in slopes.iter_mut().zip(weights).zip(from).zip(&mut before) {
                    *slope += wrong * v;
                    *b += wrong * w;
                }
                slopes[from.len()] += wrong;
            }
            if l > 0 {
                before.iter_mut().zip(from).for_each(|(b, v)| *b *= if *v > 0.0 { 1.0 } else { 0.1 });
            }
            wrong = before;
        }
    }
}
