//! Several views of one object, put together: as long as it rests, each makes its place surer; when it has moved, a new place begins.

use super::view::{Estimate, INSIDE_95};
use nalgebra::{Matrix3, Vector3};
use std::collections::VecDeque;

/// The degrees of freedom of Student's distribution, by which single views that are far off lose their weight.
const NU: f64 = 4.0;
/// Views that are kept of a resting object: the newest.
const KEPT: usize = 64;
/// So many views in a row at another place mean that it is there.
const MOVED: usize = 3;
/// A thing that goes on from its place by less than this is not told from how views scatter, m.
const STEP: f64 = 0.01;
/// Of what is seen to this share of the usual size the rest is hidden; so many views tell the usual size.
const HIDDEN: f64 = 0.75;
const ENOUGH: usize = 8;
/// What is seen to less than this share of its usual size is something else, unless nothing else is seen so many times in a row.
const PART: f64 = 0.2;
const ALONE: usize = 256;
/// What one eye alone sees counts if it is as large as usual within these shares.
const LIKE: (f64, f64) = (0.6, 1.5);
/// A thing whose place is known no better than this, m, may be of any size: that goes with the square of how far it is.
const VAGUE: f64 = 0.1;
/// Places that are kept.
const TRACKS: usize = 4;

/// The place that views of a resting object agree on; `None` if there are none. What they are off in common (`common`, square meters)
/// does not get less with more views.
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
        let (mut sum, mut right) = (Matrix3::zeros(), Vector3::zeros());
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

/// Follows one object, and whatever else is taken for it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tracker {
    /// The places where it was seen, that which was seen last at the end.
    tracks: Vec<Track>,
    /// How often in a row there was nothing but what is too small.
    small: usize,
    common: Matrix3<f64>,
}

/// What was seen at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// Where.
    pub estimate: Estimate,
    /// How much of it was seen, in any unit that is the same for all views, such as pixels times the square of the distance; `None`: not
    /// known.
    pub size: Option<f64>,
}

/// A place where something was seen.
#[derive(Clone, Debug, Default, PartialEq)]
struct Track {
    /// The newest views of what rests there.
    views: Vec<Estimate>,
    /// How much of it was seen lately.
    sizes: VecDeque<f64>,
    /// How often in a row something was seen there when anything was, and whether that was so just now.
    times: usize,
    is_seen: bool,
}

impl Track {
    fn see(&mut self, sight: &Sight) {
        (self.times, self.is_seen) = (self.times + 1, true);
        let is_hidden = self.is_hidden(sight.size);
        if self.sizes.len() == KEPT {
            self.sizes.pop_front();
        }
        self.sizes.extend(sight.size.filter(|_| sight.estimate.covariance.trace().sqrt() < VAGUE));
        if is_hidden {
            return;
        }
        if self.views.len() == KEPT {
            self.views.remove(0);
        }
        self.views.push(sight.estimate);
        self.forget_the_past();
    }

    /// Whether its place counts: enough views are of it, or it was told.
    fn is_established(&self) -> bool {
        self.views.len() >= MOVED || self.times >= MOVED
    }

    /// Whether much less of it is seen than lately: something is before it, and the middle of what is seen is not its own.
    fn is_hidden(&self, size: Option<f64>) -> bool {
        size.zip(self.usual()).is_some_and(|(size, usual)| size < HIDDEN * usual)
    }

    /// How much of it is seen usually, if that is known.
    fn usual(&self) -> Option<f64> {
        let mut sizes: Vec<f64> = self.sizes.iter().copied().collect();
        sizes.sort_by(f64::total_cmp);
        sizes.get(sizes.len() / 2).copied().filter(|_| sizes.len() >= ENOUGH)
    }

    /// If the newest views are near each other and beside all those before, it has moved a little: what was before does not count any
    /// more. Regions of 95 % are much wider than that, as they hold what all views have in common, too.
    fn forget_the_past(&mut self) {
        let before = self.views.len().saturating_sub(MOVED);
        let (past, now) = self.views.split_at(before);
        let middle = |views: &[Estimate]| views.iter().map(|v| v.place).sum::<Vector3<f64>>() / views.len() as f64;
        let place = middle(now);
        let spread = now.iter().map(|v| (v.place - place).norm()).fold(0.0, f64::max);
        let aside = |past: Estimate| (past.place - place).norm() > STEP + 3.0 * spread;
        if past.len() >= MOVED && fuse(past, &Matrix3::zeros()).is_some_and(aside) {
            self.views.drain(..before);
        }
    }
}

impl Tracker {
    /// One that has seen nothing.
    pub fn new(common: Matrix3<f64>) -> Tracker {
        Tracker { common, ..Tracker::default() }
    }

    /// How much is seen of it usually, if that is known.
    fn usual(&self) -> Option<f64> {
        self.tracks.iter().rev().find_map(Track::usual)
    }

    /// Whether as much is seen of something as usually is of the object. Where one eye alone sees it this must be so: anything that looks
    /// like it and stands elsewhere, such as the robot's own hand before the eyes, would be too large or too small.
    pub fn is_as_large(&self, size: f64) -> bool {
        self.usual().is_some_and(|usual| (LIKE.0 * usual..=LIKE.1 * usual).contains(&size))
    }

    /// Views of all that looks like it, at one instant. Answers where these things are, in their order: each with the views of what
    /// rests there before. A place that is new is told once something was seen there so many times in a row (`MOVED`), the first at once.
    pub fn see(&mut self, sights: &[Sight]) -> Vec<Estimate> {
        self.tracks.iter_mut().for_each(|track| track.is_seen = false);
        let mut told = Vec::new();
        let usual = self.usual();
        let is_small = |sight: &&Sight| sight.size.zip(usual).is_some_and(|(size, usual)| size < PART * usual);
        // where nothing is seen, nothing speaks against it
        if !sights.is_empty() {
            let only_small = sights.iter().all(|sight| is_small(&sight));
            self.small = if only_small { self.small + 1 } else { 0 };
        }
        let is_alone = self.small > ALONE;
        for sight in sights.iter().filter(|sight| is_alone || !is_small(sight)) {
            let far = |track: &Track| {
                let place = fuse(&track.views, &self.common)?;
                let sum = Estimate { covariance: place.covariance + sight.estimate.covariance, ..place };
                Some(sum.distance(&sight.estimate.place)).filter(|far| *far <= INSIDE_95)
            };
            let near = self.tracks.iter().enumerate().filter(|(_, t)| !t.is_seen);
            // regions of few views are wide: what may be the established one is no other
            let near = near.filter_map(|(i, t)| Some((i, !t.is_established(), far(t)?)));
            let near = near.min_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)));
            let mut track = match near {
                Some((i, ..)) => self.tracks.remove(i),
                None if self.tracks.is_empty() => Track { times: MOVED, ..Track::default() },
                None => Track::default(),
            };
            track.see(sight);
            if track.times >= MOVED {
                told.extend(fuse(&track.views, &self.common));
            }
            self.tracks.push(track);
        }
        // where it was before it must be seen anew as often; what was seen elsewhere fewer times, and is not seen now, was nothing
        if self.tracks.iter().any(|t| t.is_seen && t.times >= MOVED) {
            self.tracks.iter_mut().filter(|t| !t.is_seen).for_each(|t| t.times = 0);
        }
        self.tracks.retain(|t| t.is_seen || t.is_established());
        if self.tracks.len() > TRACKS {
            self.tracks.drain(..self.tracks.len() - TRACKS);
        }
        told
    }
}
