//! Cross-validation folds by whole positions, never by single views: a model trained on one view of
//! a position fits all its views.

use super::beginning::Untaught;
use super::view::KnownView;
use super::workspace::distinct;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// Maximum number of folds.
const MAX_FOLDS: usize = 5;
/// Minimum number of views.
const MIN_VIEWS: usize = 20;
/// Minimum number of positions.
const MIN_PLACES: usize = 4;

/// Views to train on, and views of other positions to evaluate.
#[derive(Clone, Debug, PartialEq)]
pub struct Fold {
    /// Training views.
    pub train: Vec<KnownView>,
    /// Held-out views.
    pub test: Vec<KnownView>,
}

/// Splits views into folds by their positions.
///
/// # Errors
/// Fewer than 20 views or 4 places.
pub fn folds(known: &[KnownView], seed: u64) -> Result<Vec<Fold>, Untaught> {
    let mut places = distinct(known.iter().map(|k| k.place));
    if known.len() < MIN_VIEWS || places.len() < MIN_PLACES {
        return Err(Untaught(format!(
            "{} views of {} places are too few: at least {} of {} are needed",
            known.len(),
            places.len(),
            MIN_VIEWS,
            MIN_PLACES
        )));
    }
    places.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let n = MAX_FOLDS.min(places.len());
    let part = |i: usize| {
        let is_out = |k: &&KnownView| places.iter().skip(i).step_by(n).any(|p| (p - k.place).norm() < 1e-6);
        let (test, train): (Vec<&KnownView>, Vec<&KnownView>) = known.iter().partition(is_out);
        Fold { train: train.into_iter().copied().collect(), test: test.into_iter().copied().collect() }
    };
    Ok((0..n).map(part).collect())
}
