//! The check of the collected rows: gross errors, balance of the places, coverage of workspace and image.

use super::rows::{Dropped, RawRow};
use mobee_contract::Time;
use mobee_sensing::locators::view::KnownView;
use nalgebra::{Vector3, Vector4};
use std::collections::BTreeSet;
use std::fmt::Write;

/// Maximum distance between rows of one place, meters: the holding robot was sent to one configuration.
const PLACE_RADIUS_M: f64 = 0.002;
/// Number of rows at a place below which the report marks it.
const FEW_ROWS: usize = 5;
/// Edge length of a cell of the workspace, meters.
const CELL_M: f64 = 0.1;
/// Number of cells of the left image across and down.
const CELLS: [f64; 2] = [4.0, 3.0];
/// Size of the image, pixels.
const IMAGE_PX: [f64; 2] = [640.0, 480.0];

/// Counts of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Collected {
    /// Duration so far, s.
    pub secs: f64,
    /// Images that a detector processed.
    pub pictures: u64,
    /// Motions that were rolled back.
    pub rolled_back: u64,
}

/// The checked rows.
pub(super) struct ViewCheck {
    /// The rows, ordered by place and then by time.
    pub known: Vec<KnownView>,
    /// Exposure times of the two images of each row.
    pub exposed: Vec<[Time; 2]>,
    /// Each place with its number of rows, and the number of those in the table.
    places: Vec<(Vector3<f64>, usize, usize)>,
    gross: usize,
    /// Rows of dropped places.
    sparse: usize,
    /// Median deviation of the rows from the nominal kinematics, pixels.
    usual: Vector4<f64>,
    /// Maximum deviation of a measured position from the mean of its place, m.
    spread: f64,
}

impl ViewCheck {
    /// Drops rows that deviate from the median by more than `gross` pixels, groups rows by place, drops places with
    /// fewer than `least` rows, and takes `per_place` rows of each.
    pub fn new(raw: Vec<RawRow>, gross: f64, (least, per_place): (usize, usize)) -> ViewCheck {
        let usual = median(&raw);
        let n = raw.len();
        let fits = |row: &RawRow| row.off.is_some_and(|off| (off - usual).amax() <= gross);
        let good: Vec<RawRow> = raw.into_iter().filter(fits).collect();
        let gross = n - good.len();
        let mut groups: Vec<Vec<RawRow>> = Vec::new();
        for row in good {
            let place = row.known.place;
            let is_here =
                |g: &&mut Vec<RawRow>| g.first().is_some_and(|k| (k.known.place - place).norm() < PLACE_RADIUS_M);
            match groups.iter_mut().find(is_here) {
                Some(group) => group.push(row),
                None => groups.push(vec![row]),
            }
        }
        let sparse = groups.iter().map(Vec::len).filter(|n| *n < least).sum();
        groups.retain(|group| group.len() >= least);
        let mut known = Vec::new();
        let mut exposed = Vec::new();
        let mut places = Vec::new();
        let mut spread = 0.0f64;
        for group in &groups {
            let place = group.iter().map(|row| row.known.place).sum::<Vector3<f64>>() / group.len() as f64;
            spread = group.iter().map(|row| (row.known.place - place).norm()).fold(spread, f64::max);
            let step = if per_place == 0 { 1 } else { group.len().div_ceil(per_place) };
            let selected = group.iter().step_by(step.max(1));
            places.push((place, group.len(), selected.len()));
            // whole places are held out, so the rows of one place must have the same position
            known.extend(selected.clone().map(|row| KnownView { place, ..row.known }));
            exposed.extend(selected.map(|row| row.exposed));
        }
        ViewCheck { known, exposed, places, gross, sparse, usual, spread }
    }

    /// The report as text.
    pub fn text(&self, run: &Collected, dropped: &Dropped) -> String {
        let mut text = String::new();
        let _ = writeln!(
            text,
            "run         {:.0} s, {} pictures, {} motions taken back",
            run.secs, run.pictures, run.rolled_back
        );
        let _ = writeln!(
            text,
            "left out    {dropped}, {} gross errors, {} of places seen too seldom",
            self.gross, self.sparse
        );
        let mut counts: Vec<usize> = self.places.iter().map(|(_, had, _)| *had).collect();
        counts.sort_unstable();
        let at = |share: usize| counts.get((counts.len().saturating_sub(1)) * share / 2).copied().unwrap_or_default();
        let _ = writeln!(
            text,
            "balance     {} places; rows that a place has: least {}, median {}, most {}; positions of one place within {:.2} mm",
            self.places.len(),
            at(0),
            at(1),
            at(2),
            2e3 * self.spread
        );
        let all = || self.places.iter().map(|(place, ..)| place);
        let range = |axis: usize| {
            let values = || all().map(move |p| 1e3 * p[axis]);
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
        };
        let [x, y, z] = [0, 1, 2].map(range);
        let cells: BTreeSet<[i64; 3]> = all().map(|p| [0, 1, 2].map(|i| (p[i] / CELL_M).floor() as i64)).collect();
        let eyes = self.known.iter().map(|k| k.view.eyes[0].center);
        let seen: BTreeSet<[i64; 2]> =
            eyes.map(|c| [0, 1].map(|i| (c[i] / IMAGE_PX[i] * CELLS[i]).clamp(0.0, CELLS[i] - 1.0) as i64)).collect();
        let _ = writeln!(
            text,
            "coverage    x {:.0} to {:.0}, y {:.0} to {:.0}, z {:.0} to {:.0} mm: {} cells of 100 mm; {} of {:.0} parts of the left picture",
            x.0,
            x.1,
            y.0,
            y.1,
            z.0,
            z.1,
            cells.len(),
            seen.len(),
            CELLS[0] * CELLS[1]
        );
        let u = self.usual;
        let _ = writeln!(
            text,
            "drawings    most rows are off by {:.1} and {:.1} (left), {:.1} and {:.1} pixels (right)",
            u[0], u[1], u[2], u[3]
        );
        for (n, (place, had, selected)) in self.places.iter().enumerate() {
            let few = if *had < FEW_ROWS { "  (few)" } else { "" };
            let [x, y, z] = [0, 1, 2].map(|i| 1e3 * place[i]);
            let _ = writeln!(text, "place {:<5} {x:7.1} {y:7.1} {z:7.1} mm  {selected} of {had} rows{few}", n + 1);
        }
        text
    }
}

/// Median deviation of the rows, separately for each of the four pixel coordinates.
fn median(raw: &[RawRow]) -> Vector4<f64> {
    let mut usual = Vector4::zeros();
    for (i, value) in usual.iter_mut().enumerate() {
        let mut all: Vec<f64> = raw.iter().filter_map(|row| row.off.map(|off| off[i])).collect();
        all.sort_by(f64::total_cmp);
        *value = all.get(all.len() / 2).copied().unwrap_or_default();
    }
    usual
}
