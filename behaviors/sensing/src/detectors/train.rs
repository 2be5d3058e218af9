//! Training of a detector on images in temporal order.
//!
//! An image's surroundings resemble those of its temporal neighbors. Everything that is selected
//! (smoothing, threshold, program) is therefore selected by cross-validation: the sequence is cut
//! into contiguous stretches, each evaluated by a model that was trained on the others. The final
//! model is trained on all images.

use super::cgp::{Channels, Evolution, channels};
use super::color::ColorTable;
use super::features::features;
use super::file::{DetectorFile, DetectorKind, Smoothing};
use super::picture::{LabeledPicture, Mask};
use super::pixels::PixelNetwork;
use super::plane::{Plane, brightness};
use super::regions::Cut;
use super::score::{Confusion, Levels};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Number of stretches of the sequence.
const STRETCHES: usize = 4;
/// Maximum width of training images, pixels; larger ones are shrunk.
const MAX_WIDTH_PX: usize = 240;

/// Reason why no detector can be trained.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TrainFault {
    /// Too few images.
    #[error("there are only {0} pictures, too few for training and evaluation")]
    Few(usize),
    /// Masks without information.
    #[error("the masks of some stretch of the pictures are all black or all white")]
    Blank,
}

/// Training images, prepared, with the outputs of models that were not trained on them.
pub struct Lessons {
    shrink: usize,
    object: String,
    seed: u64,
    /// Brightness of each image.
    brightness: Vec<Plane>,
    /// Mask of each image.
    masks: Vec<Mask>,
    /// Color likelihood of each image, by a table of the other stretches.
    colors: Vec<Plane>,
    /// Color table of all images.
    table: ColorTable,
}

impl Lessons {
    /// Prepares images of an object in temporal order.
    ///
    /// # Errors
    /// Too few images, or masks without information.
    pub fn new(pictures: &[LabeledPicture], object: &str, seed: u64) -> Result<Lessons, TrainFault> {
        if pictures.len() < 4 {
            return Err(TrainFault::Few(pictures.len()));
        }
        let shrink = pictures[0].picture.width.div_ceil(MAX_WIDTH_PX).clamp(1, 64);
        let stretches = stretches(pictures.len());
        let mut colors = Vec::new();
        for stretch in &stretches {
            let others = pictures.iter().enumerate().filter(|(i, _)| !stretch.contains(i)).map(|(_, p)| p);
            let table = ColorTable::of(others);
            colors.extend(pictures[stretch.clone()].iter().map(|p| table.look(&p.picture, shrink)));
        }
        let masks: Vec<Mask> = pictures.iter().map(|p| Mask::at_least(&p.mask.plane().shrunk(shrink), 127.5)).collect();
        let has = |wanted: bool| move |m: &Mask| m.data.contains(&wanted);
        if ![true, false].into_iter().all(|w| stretches.iter().all(|s| masks[s.clone()].iter().any(has(w)))) {
            return Err(TrainFault::Blank);
        }
        let brightness = pictures.iter().map(|p| brightness(&p.picture.planes(shrink))).collect();
        let table = ColorTable::of(pictures);
        Ok(Lessons { shrink, object: object.into(), seed, brightness, masks, colors, table })
    }

    /// Returns a detector of the kind `color`, and its cross-validated correlation.
    pub fn color(&self) -> (DetectorFile, f64) {
        let mut file = DetectorFile::new(DetectorKind::Color, &self.object, self.shrink, self.table.clone());
        let mcc = self.finish(&mut file, &self.colors);
        (file, mcc)
    }

    /// Returns the mask of each shrunk image.
    pub fn masks(&self) -> Vec<Mask> {
        self.masks.clone()
    }

    /// Trains the network, and returns it with the program inputs of each image. `progress` is
    /// called with the completed share.
    ///
    /// # Errors
    /// Masks without information.
    pub fn network(
        &self,
        pictures: &[LabeledPicture],
        progress: &mut dyn FnMut(f64),
    ) -> Result<(PixelNetwork, Vec<Channels>), TrainFault> {
        let rgb: Vec<[Plane; 3]> = pictures.iter().map(|p| p.picture.planes(self.shrink)).collect();
        let all: Vec<Vec<Plane>> = rgb.iter().zip(&self.colors).map(|(rgb, c)| features(rgb, c)).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut learn = |without: std::ops::Range<usize>| {
            let kept = (0..all.len()).filter(|i| !without.contains(i));
            let samples: Vec<_> = kept.map(|i| (all[i].as_slice(), &self.masks[i])).collect();
            PixelNetwork::learn(&samples, &mut rng).ok_or(TrainFault::Blank)
        };
        let mut learned: Vec<Channels> = Vec::new();
        let stretches = stretches(all.len());
        for (done, stretch) in stretches.iter().enumerate() {
            progress(done as f64 / (stretches.len() + 1) as f64);
            let network = learn(stretch.clone())?;
            for i in stretch.clone() {
                learned.push(channels(&rgb[i], &self.colors[i], &network.look(&all[i])));
            }
        }
        progress(stretches.len() as f64 / (stretches.len() + 1) as f64);
        let network = learn(0..0)?;
        Ok((network, learned))
    }

    /// Returns a detector of the kind `cgp` with the best program so far, and its cross-validated
    /// correlation.
    pub fn finish_cgp(&self, network: &PixelNetwork, evolution: &Evolution) -> (DetectorFile, f64) {
        let mut file = DetectorFile::new(DetectorKind::Cgp, &self.object, self.shrink, self.table.clone());
        file.network = Some(network.clone());
        file.program = Some(evolution.best().clone());
        let planes: Vec<Plane> = evolution.outputs();
        let mcc = self.finish(&mut file, &planes);
        (file, mcc)
    }

    /// Selects smoothing and cut for the cross-validated outputs of the images.
    fn finish(&self, file: &mut DetectorFile, outputs: &[Plane]) -> f64 {
        let mut best = (f64::MIN, 128.0f32, Vec::new());
        for (radius, at_edges) in
            [(0, false), (1, false), (2, false), (4, false), (6, false), (2, true), (4, true), (8, true)]
        {
            let smoothing = Smoothing { radius, at_edges };
            let planes: Vec<Plane> = outputs.iter().zip(&self.brightness).map(|(p, b)| smoothing.apply(p, b)).collect();
            let mut levels = Levels::default();
            planes.iter().zip(&self.masks).for_each(|(p, m)| levels.add(p, m));
            let (threshold, mcc) = levels.best(false);
            if mcc > best.0 {
                best = (mcc, f32::from(threshold), planes);
                file.smoothing = smoothing;
            }
        }
        let (_, middle, planes) = best;
        let mut most = f64::MIN;
        for keep in [0.0, 0.05, 0.15, 0.4, 1.0] {
            for step in -4..=4i8 {
                for open in [false, true] {
                    let threshold = (middle + 8.0 * f32::from(step)).clamp(1.0, 255.0);
                    let cut = Cut { threshold, open, keep };
                    let mut sum = Confusion::default();
                    planes.iter().zip(&self.masks).for_each(|(p, m)| sum.add(&cut.apply(p).0, m));
                    if sum.mcc() > most {
                        (most, file.cut) = (sum.mcc(), cut);
                    }
                }
            }
        }
        most
    }
}

/// Cuts a sequence of length `n` into contiguous stretches.
fn stretches(n: usize) -> Vec<std::ops::Range<usize>> {
    (0..STRETCHES).map(|s| s * n / STRETCHES..(s + 1) * n / STRETCHES).collect()
}
