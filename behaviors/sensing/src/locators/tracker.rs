//! Fusion of several views of one object: while it rests, each view reduces the uncertainty; after
//! it has moved, a new track starts.

use super::view::{Estimate, INSIDE_95};
use nalgebra::{Matrix3, Vector3};
use std::collections::VecDeque;

/// Degrees of freedom of Student's t-distribution, which reduces the weight of outliers.
const NU: f64 = 4.0;
/// Maximum number of stored views of a resting object, the newest.
const MAX_VIEWS: usize = 64;
/// Number of views in a row at another position that mean that the object has moved there.
const MIN_OBSERVATIONS: usize = 3;
/// Minimum displacement that is distinguished from the noise of the views, m.
const MIN_STEP_M: f64 = 0.01;
/// Share of the usual size below which the object counts as partly hidden.
const HIDDEN_SHARE: f64 = 0.75;
/// Minimum number of views that determine the usual size.
const MIN_SIZES: usize = 8;
/// Share of the usual size below which a view counts as another object, unless only such views
/// occur.
const OTHER_SHARE: f64 = 0.2;
/// Number of observations in a row with only such views after which they count as the object.
const MAX_SMALL: usize = 256;
/// Range of sizes, as shares of the usual one, in which the view of a single eye counts.
const SIZE_RANGE: (f64, f64) = (0.6, 1.5);
/// Standard deviation of a position, m, above which the size of an object is not used: the size is
/// proportional to the squared distance.
const MAX_SIZE_SIGMA_M: f64 = 0.1;
/// Maximum number of tracks.
const MAX_TRACKS: usize = 4;

/// Estimates the position of a resting object from several views; `None` without views. The error
/// that all views share (`common`, m^2) is not reduced by more views.
pub fn fuse(views: &[Estimate], common: &Matrix3<f64>) -> Option<Estimate> {
    let weights: Vec<_> = views.iter().map(|v| v.covariance.try_inverse()).collect::<Option<_>>()?;
    let middle = |axis: usize| {
        let mut all: Vec<f64> = views.iter().map(|v| v.place[axis]).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied()
    };
    let mut place = Vector3::new(middle(0)?, middle(1)?, middle(2)?);
    let mut information = Matrix3::zeros();
    for _ in 0..20 {
        let mut sum = Matrix3::zeros();
        let mut right = Vector3::zeros();
        for (view, of) in views.iter().zip(&weights) {
            let off = view.place - place;
            let weight = (NU + 3.0) / (NU + off.dot(&(of * off)));
            sum += of * weight;
            right += of * view.place * weight;
        }
        place = sum.cholesky()?.solve(&right);
        information = sum;
    }
    Some(Estimate { place, covariance: information.try_inverse()? + common })
}

/// Tracks one object, and other things detected as the same object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracker {
    /// Tracks, the most recently updated at the end.
    tracks: Vec<Track>,
    /// Number of observations in a row in which all views were too small.
    small: usize,
    common: Matrix3<f64>,
}

/// A view of an object at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Estimated position.
    pub estimate: Estimate,
    /// Visible size of the object, in any unit common to all views, such as pixels times the
    /// squared distance; `None`: unknown.
    pub size: Option<f64>,
}

/// A position at which something was detected.
#[derive(Clone, Debug, Default, PartialEq)]
struct Track {
    /// Newest views at this position.
    views: Vec<Estimate>,
    /// Recent visible sizes.
    sizes: VecDeque<f64>,
    /// Number of observations in a row, of those with any detection, with one at this position.
    times: usize,
    /// The last observation has a detection at this position.
    is_seen: bool,
}

impl Track {
    fn see(&mut self, sight: &Sight) {
        self.times += 1;
        self.is_seen = true;
        let is_hidden = self.is_hidden(sight.size);
        if self.sizes.len() == MAX_VIEWS {
            self.sizes.pop_front();
        }
        self.sizes.extend(sight.size.filter(|_| sight.estimate.covariance.trace().sqrt() < MAX_SIZE_SIGMA_M));
        if is_hidden {
            return;
        }
        if self.views.len() == MAX_VIEWS {
            self.views.remove(0);
        }
        self.views.push(sight.estimate);
        self.forget_the_past();
    }

    /// Returns whether the track counts: it has enough views, or has been reported.
    fn is_established(&self) -> bool {
        self.views.len() >= MIN_OBSERVATIONS || self.times >= MIN_OBSERVATIONS
    }

    /// Returns whether much less of the object is visible than usual: it is partly hidden, and the
    /// center of the visible part is not its own.
    fn is_hidden(&self, size: Option<f64>) -> bool {
        size.zip(self.usual()).is_some_and(|(size, usual)| size < HIDDEN_SHARE * usual)
    }

    /// Returns the usual visible size, if it is known.
    fn usual(&self) -> Option<f64> {
        let mut sizes: Vec<f64> = self.sizes.iter().copied().collect();
        sizes.sort_by(f64::total_cmp);
        sizes.get(sizes.len() / 2).copied().filter(|_| sizes.len() >= MIN_SIZES)
    }

    /// Drops the older views if the object has moved slightly: the newest views are close to each
    /// other and apart from all older ones. The 95 % regions are too wide for this test, because
    /// they include the error that all views share.
    fn forget_the_past(&mut self) {
        let before = self.views.len().saturating_sub(MIN_OBSERVATIONS);
        let (past, now) = self.views.split_at(before);
        let middle = |views: &[Estimate]| views.iter().map(|v| v.place).sum::<Vector3<f64>>() / views.len() as f64;
        let place = middle(now);
        let spread = now.iter().map(|v| (v.place - place).norm()).fold(0.0, f64::max);
        let aside = |past: Estimate| (past.place - place).norm() > MIN_STEP_M + 3.0 * spread;
        if past.len() >= MIN_OBSERVATIONS && fuse(past, &Matrix3::zeros()).is_some_and(aside) {
            self.views.drain(..before);
        }
    }
}

impl Tracker {
    /// Creates a tracker without tracks.
    pub fn new(common: Matrix3<f64>) -> Tracker {
        Tracker { common, ..Tracker::default() }
    }

    /// Returns the usual visible size, if it is known.
    fn usual(&self) -> Option<f64> {
        self.tracks.iter().rev().find_map(Track::usual)
    }

    /// Returns whether a visible size is like the usual one. Views of a single eye must satisfy
    /// this: a similar thing elsewhere, such as the robot's own hand in front of the eyes, appears
    /// too large or too small.
    pub fn is_as_large(&self, size: f64) -> bool {
        self.usual().is_some_and(|usual| (SIZE_RANGE.0 * usual..=SIZE_RANGE.1 * usual).contains(&size))
    }

    /// Adds the views of one instant. Returns the positions of the detected things in the order of
    /// their views, each estimated from the views of its track. A new position is reported after
    /// `MIN_OBSERVATIONS` observations in a row, the first one at once.
    pub fn see(&mut self, sights: &[Sight]) -> Vec<Estimate> {
        self.tracks.iter_mut().for_each(|track| track.is_seen = false);
        let mut reported = Vec::new();
        let usual = self.usual();
        let is_small = |sight: &&Sight| sight.size.zip(usual).is_some_and(|(size, usual)| size < OTHER_SHARE * usual);
        // An empty observation does not reset the count.
        if !sights.is_empty() {
            let only_small = sights.iter().all(|sight| is_small(&sight));
            self.small = if only_small { self.small + 1 } else { 0 };
        }
        let is_alone = self.small > MAX_SMALL;
        for sight in sights.iter().filter(|sight| is_alone || !is_small(sight)) {
            let far = |track: &Track| {
                let place = fuse(&track.views, &self.common)?;
                let sum = Estimate { covariance: place.covariance + sight.estimate.covariance, ..place };
                Some(sum.distance(&sight.estimate.place)).filter(|far| *far <= INSIDE_95)
            };
            let near = self.tracks.iter().enumerate().filter(|(_, t)| !t.is_seen);
            // Regions of few views are wide, so an established track has priority.
            let near = near.filter_map(|(i, t)| Some((i, !t.is_established(), far(t)?)));
            let near = near.min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)));
            let mut track = match near {
                Some((i, ..)) => self.tracks.remove(i),
                None if self.tracks.is_empty() => Track { times: MIN_OBSERVATIONS, ..Track::default() },
                None => Track::default(),
            };
            track.see(sight);
            if track.times >= MIN_OBSERVATIONS {
                reported.extend(fuse(&track.views, &self.common));
            }
            self.tracks.push(track);
        }
        // The other tracks must be confirmed by the full number of observations again. Unconfirmed
        // tracks without a detection now are dropped.
        if self.tracks.iter().any(|t| t.is_seen && t.times >= MIN_OBSERVATIONS) {
            self.tracks.iter_mut().filter(|t| !t.is_seen).for_each(|t| t.times = 0);
        }
        self.tracks.retain(|t| t.is_seen || t.is_established());
        if self.tracks.len() > MAX_TRACKS {
            self.tracks.drain(..self.tracks.len() - MAX_TRACKS);
        }
        reported
    }
}
