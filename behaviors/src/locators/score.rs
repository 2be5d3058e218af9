//! How good a locator is: its errors at places that are known.

use super::file::ReadyLocator;
use super::honest::places_of;
use super::view::{Estimate, INSIDE_95, KnownView};
use nalgebra::Vector3;
use serde::Serialize;

/// Errors over views, or over places.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    /// How many were asked for.
    pub n: usize,
    /// How many of these were answered.
    pub located: usize,
    /// The median distance from the truth, mm.
    pub median_mm: f64,
    /// The mean one, mm.
    pub mean_mm: f64,
    /// That which 95 % do not exceed, mm.
    pub p95_mm: f64,
    /// The share of true places inside the stated region of 95 %.
    pub inside_95: f64,
}

/// Errors of single views, and of all views of each place together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LocatorScore {
    /// Of one view.
    pub single: Errors,
    /// Of all views of each place together.
    pub fused: Errors,
}

impl Errors {
    fn of(answers: &[(Option<Estimate>, Vector3<f64>)]) -> Errors {
        let located = answers.iter().filter_map(|(answer, truth)| Some((answer.as_ref()?, truth)));
        let mut off: Vec<f64> = located.clone().map(|(e, t)| 1e3 * (e.place - t).norm()).collect();
        off.sort_by(f64::total_cmp);
        let count = off.len() as f64;
        // between the two nearest, as usual
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

/// What was answered, and the truth.
#[derive(Clone, Debug, Default)]
pub struct PlaceAnswers {
    single: Vec<(Option<Estimate>, Vector3<f64>)>,
    fused: Vec<(Option<Estimate>, Vector3<f64>)>,
}

impl PlaceAnswers {
    /// Asks a locator for these views, one by one and all of each place together.
    pub fn ask(&mut self, locator: &ReadyLocator, known: &[KnownView]) {
        self.single.extend(known.iter().map(|k| (locator.locate(&k.view), k.place)));
        self.fused.extend(places_of(known).into_iter().map(|(place, views)| (locator.fuse(&views), place)));
    }

    /// How good they are.
    pub fn score(&self) -> LocatorScore {
        LocatorScore { single: Errors::of(&self.single), fused: Errors::of(&self.fused) }
    }
}

/// Judges a locator by views of known places.
pub fn judge(locator: &ReadyLocator, known: &[KnownView]) -> LocatorScore {
    let mut answers = PlaceAnswers::default();
    answers.ask(locator, known);
    answers.score()
}
