//! What learning starts from: a head by its drawings, and in which frame places are told.

use super::head::HeadKind;
use super::lens::Lens;
use super::model::HeadModel;
use super::parameters::{OFFSETS, PlaceFrame};
use super::rigid::rigid;
use super::view::KnownView;
use nalgebra::{Matrix3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Views from which the frame is found, at most.
const LOOKED_AT: usize = 200;

/// Why there is nothing to learn from.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Untaught(pub String);

/// What to start from.
#[derive(Clone, Copy, Debug)]
pub struct Beginning {
    /// The chain.
    pub head: HeadKind,
    /// The cameras, left and right.
    pub lenses: [Lens; 2],
    /// The frame of the places, if it is known; else it is found.
    pub frame: Option<PlaceFrame>,
    /// The seed of all randomness.
    pub seed: u64,
}

impl Beginning {
    /// A recorded head of the first generation.
    pub fn recorded(seed: u64) -> Beginning {
        Beginning { head: HeadKind::V1, lenses: Lens::icub(), frame: None, seed }
    }

    /// A model by the drawings, in the frame of the places by which what it says of the views is nearest to them; with it, by how much
    /// the eyes squint: that is off most on real heads, and with it every distance.
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
