//! Views of places left out: whole places, never single views, for whoever knows a place knows all its views.

use super::beginning::Untaught;
use super::view::KnownView;
use super::workspace::distinct;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

/// How many parts the places are cut into, at most.
const FOLDS: usize = 5;
/// What is needed at least: views and places.
const LEAST: (usize, usize) = (20, 4);

/// Views to learn from, and views of other places to be judged by.
#[derive(Clone, Debug, PartialEq)]
pub struct Fold {
    /// To learn from.
    pub train: Vec<KnownView>,
    /// Held out.
    pub test: Vec<KnownView>,
}

/// Cuts views into parts by their places; for each, what is learned from and what is held out.
///
/// # Errors
/// Fewer than 20 views or 4 places.
pub fn folds(known: &[KnownView], seed: u64) -> Result<Vec<Fold>, Untaught> {
    let mut places = distinct(known.iter().map(|k| k.place));
    if known.len() < LEAST.0 || places.len() < LEAST.1 {
        return Err(Untaught(format!(
            "{} views of {} places are too few: at least {} of {} are needed",
            known.len(),
            places.len(),
            LEAST.0,
            LEAST.1
        )));
    }
    places.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    let n = FOLDS.min(places.len());
    let part = |i: usize| {
        let is_out = |k: &&KnownView| places.iter().skip(i).step_by(n).any(|p| (p - k.place).norm() < 1e-6);
        let (test, train): (Vec<&KnownView>, Vec<&KnownView>) = known.iter().partition(is_out);
        Fold { train: train.into_iter().copied().collect(), test: test.into_iter().copied().collect() }
    };
    Ok((0..n).map(part).collect())
}
