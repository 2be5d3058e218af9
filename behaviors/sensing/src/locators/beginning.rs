//! Initial model of a training: a head with its nominal kinematics, and the frame of the positions.

use super::head::HeadKind;
use super::lens::Lens;
use super::model::HeadModel;
use super::parameters::{OFFSETS, PlaceFrame};
use super::rigid::rigid;
use super::view::KnownView;
use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Maximum number of views from which the frame is estimated.
const LOOKED_AT: usize = 200;

/// Reason why no locator can be trained.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Untaught(pub String);

/// Configuration of a training.
#[derive(Clone, Copy, Debug)]
pub struct Beginning {
    /// Kinematic chain of the head.
    pub head: HeadKind,
    /// Left and right camera.
    pub lenses: [Lens; 2],
    /// Frame of the positions; `None`: it is estimated.
    pub frame: Option<PlaceFrame>,
    /// Seed of all randomness.
    pub seed: u64,
}

impl Beginning {
    /// Creates the configuration for recordings of a head of the first generation.
    pub fn recorded(seed: u64) -> Beginning {
        Beginning { head: HeadKind::V1, lenses: Lens::icub(), frame: None, seed }
    }

    /// Returns a model with nominal kinematics. If no frame is given, it estimates the frame of the
    /// positions that fits the triangulated views best, and with it the vergence bias: on real
    /// heads that is the largest error, and it affects every distance.
    pub(super) fn model(&self, known: &[KnownView]) -> Result<HeadModel, Untaught> {
        let own = PlaceFrame { rotation: Matrix3::identity(), origin: Vector3::zeros() };
        let mut model = HeadModel::nominal(self.head, self.lenses, self.frame.unwrap_or(own));
        if self.frame.is_some() {
            return Ok(model);
        }
        let seen: Vec<_> = known.iter().filter(|k| !k.view.is_clipped()).collect();
        let seen: Vec<_> = seen.iter().step_by(seen.len().div_ceil(LOOKED_AT).max(1)).collect();
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut squinting = |degrees: i32| {
            model.theta[OFFSETS + 8] = f64::from(degrees).to_radians();
            let pair = |k: &&&KnownView| {
                let looking = model.look(&k.view.encoders, &[0.0; 9]);
                Some((k.place, looking.midpoint(&k.view.pixels())?))
            };
            let pairs: Vec<_> = seen.iter().filter_map(pair).collect();
            let enough = 2 * pairs.len() > seen.len();
            rigid(&pairs, &mut rng).filter(|_| enough).map(|(frame, reach)| (reach, degrees, frame))
        };
        let best = (-16..=16).filter_map(&mut squinting).min_by(|a, b| a.0.total_cmp(&b.0));
        let (_, degrees, frame) = best.ok_or_else(|| {
            Untaught("the rays of the two eyes meet in too few views, or all places are in line".into())
        })?;
        model.theta[OFFSETS + 8] = f64::from(degrees).to_radians();
        model.frame = frame;
        Ok(model)
    }
}
