//! Accuracy of a locator: its errors at known positions.

use super::file::ReadyLocator;
use super::honest::places_of;
use super::view::{Estimate, INSIDE_95, KnownView};
use nalgebra::Vector3;
use serde::Serialize;

/// Errors over views, or over positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// Number of queries.
    pub n: usize,
    /// Number of queries with a result.
    pub located: usize,
    /// Median error, mm.
    pub median_mm: f64,
    /// Mean error, mm.
    pub mean_mm: f64,
    /// 95th percentile of the errors, mm.
    pub p95_mm: f64,
    /// Share of true positions inside the estimated 95 % region.
    pub inside_95: f64,
}

/// Errors of single views, and of all views of each place together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LocatorScore {
    /// Errors of single views.
    pub single: Errors,
    /// Errors of all views of each position together.
    pub fused: Errors,
}

impl Errors {
    fn of(answers: &[(Option<Estimate>, Vector3<f64>)]) -> Errors {
        let located = answers.iter().filter_map(|(answer, truth)| Some((answer.as_ref()?, truth)));
        let mut off: Vec<f64> = located.clone().map(|(e, t)| 1e3 * (e.place - t).norm()).collect();
        off.sort_by(f64::total_cmp);
        let count = off.len() as f64;
        // Linear interpolation between the two nearest.
        let quantile = |share: f64| {
            let at = share * (count - 1.0).max(0.0);
            let value = |i: f64| off.get(i as usize).copied().unwrap_or_default();
            value(at.floor()) + at.fract() * (value(at.ceil()) - value(at.floor()))
        };
        let inside = located.filter(|(e, t)| e.distance(t) <= INSIDE_95).count() as f64;
        Errors {
            n: answers.len(),
            located: off.len(),
            median_mm: quantile(0.5),
            mean_mm: off.iter().sum::<f64>() / count.max(1.0),
            p95_mm: quantile(0.95),
            inside_95: inside / count.max(1.0),
        }
    }
}

/// Estimates, and the true positions.
#[derive(Clone, Debug, Default)]
pub struct PlaceAnswers {
    single: Vec<(Option<Estimate>, Vector3<f64>)>,
    fused: Vec<(Option<Estimate>, Vector3<f64>)>,
}

impl PlaceAnswers {
    /// Locates these views, one by one and all of each position together.
    pub fn ask(&mut self, locator: &ReadyLocator, known: &[KnownView]) {
        self.single.extend(known.iter().map(|k| (locator.locate(&k.view), k.place)));
        self.fused.extend(places_of(known).into_iter().map(|(place, views)| (locator.fuse(&views), place)));
    }

    /// Returns the accuracy.
    pub fn score(&self) -> LocatorScore {
        LocatorScore { single: Errors::of(&self.single), fused: Errors::of(&self.fused) }
    }
}

/// Evaluates a locator on views of known positions.
pub fn judge(locator: &ReadyLocator, known: &[KnownView]) -> LocatorScore {
    let mut answers = PlaceAnswers::default();
    answers.ask(locator, known);
    answers.score()
}
