//! The check of what was collected: gross errors, balance of the places, coverage of workspace and picture.

use super::rows::{Dropped, RawRow};
use mobee_behaviors::locators::view::KnownView;
use mobee_contract::Time;
use nalgebra::{Vector3, Vector4};
use std::collections::BTreeSet;
use std::fmt::Write;

/// Rows that are nearer to each other than this are of one place: what held it was sent to one pose, meters.
const ONE_PLACE: f64 = 0.002;
/// Fewer rows than this at a place are too few to be balanced by, and said.
const FEW: usize = 5;
/// The edge of a cell of the workspace, meters.
const CELL: f64 = 0.1;
/// Cells of the left picture across and down, and the picture's size, pixels.
const CELLS: [f64; 2] = [4.0, 3.0];
const PICTURE: [f64; 2] = [640.0, 480.0];

/// What the run had.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Collected {
    /// Its length so far, s.
    pub secs: f64,
    /// Pictures that a detector looked at.
    pub pictures: u64,
    /// Motions that were taken back.
    pub rolled_back: u64,
}

/// What is good of it.
pub(super) struct Check {
    /// The rows, in the order of their places and then of time.
    pub known: Vec<KnownView>,
    /// When the two pictures of each row were exposed.
    pub exposed: Vec<[Time; 2]>,
    /// Each place, how many rows it had, and how many are kept.
    places: Vec<(Vector3<f64>, usize, usize)>,
    gross: usize,
    /// Rows of places that had too few.
    sparse: usize,
    /// What most rows are off by from the drawings, pixels.
    usual: Vector4<f64>,
    /// How far measured positions of one place are apart at most, m.
    spread: f64,
}

impl Check {
    /// Leaves out rows that are off by more than `gross` pixels, puts rows of one place together, leaves out places of fewer than `least`,
    /// and keeps `per_place` rows of each.
    pub fn new(raw: Vec<RawRow>, gross: f64, (least, per_place): (usize, usize)) -> Check {
        let usual = median(&raw);
        let n = raw.len();
        let fits = |row: &RawRow| row.off.is_some_and(|off| (off - usual).amax() <= gross);
        let good: Vec<RawRow> = raw.into_iter().filter(fits).collect();
        let gross = n - good.len();
        let mut groups: Vec<Vec<RawRow>> = Vec::new();
        for row in good {
            let place = row.known.place;
            let is_here = |g: &&mut Vec<RawRow>| g.first().is_some_and(|k| (k.known.place - place).norm() < ONE_PLACE);
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
            let kept = group.iter().step_by(step.max(1));
            places.push((place, group.len(), kept.len()));
            // whole places are held out, so the rows of one place must agree on where it is
            known.extend(kept.clone().map(|row| KnownView { place, ..row.known }));
            exposed.extend(kept.map(|row| row.exposed));
        }
        Check { known, exposed, places, gross, sparse, usual, spread }
    }

    /// In words.
    pub fn text(&self, run: &Collected, dropped: &Dropped) -> String {
        let mut said = String::new();
        let _ = writeln!(
            said,
            "run         {:.0} s, {} pictures, {} motions taken back",
            run.secs, run.pictures, run.rolled_back
        );
        let _ = writeln!(
            said,
            "left out    {dropped}, {} gross errors, {} of places seen too seldom",
            self.gross, self.sparse
        );
        let mut counts: Vec<usize> = self.places.iter().map(|(_, had, _)| *had).collect();
        counts.sort_unstable();
        let at = |share: usize| counts.get((counts.len().saturating_sub(1)) * share / 2).copied().unwrap_or_default();
        let _ = writeln!(
            said,
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
        let cells: BTreeSet<[i64; 3]> = all().map(|p| [0, 1, 2].map(|i| (p[i] / CELL).floor() as i64)).collect();
        let eyes = self.known.iter().map(|k| k.view.eyes[0].center);
        let seen: BTreeSet<[i64; 2]> =
            eyes.map(|c| [0, 1].map(|i| (c[i] / PICTURE[i] * CELLS[i]).clamp(0.0, CELLS[i] - 1.0) as i64)).collect();
        let _ = writeln!(
            said,
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
            said,
            "drawings    most rows are off by {:.1} and {:.1} (left), {:.1} and {:.1} pixels (right)",
            u[0], u[1], u[2], u[3]
        );
        for (n, (place, had, kept)) in self.places.iter().enumerate() {
            let few = if *had < FEW { "  (few)" } else { "" };
            let [x, y, z] = [0, 1, 2].map(|i| 1e3 * place[i]);
            let _ = writeln!(said, "place {:<5} {x:7.1} {y:7.1} {z:7.1} mm  {kept} of {had} rows{few}", n + 1);
        }
        said
    }
}

/// What half of the rows are off by less, and half by more, each of the four pixels by itself.
fn median(raw: &[RawRow]) -> Vector4<f64> {
    let mut usual = Vector4::zeros();
    for (i, value) in usual.iter_mut().enumerate() {
        let mut all: Vec<f64> = raw.iter().filter_map(|row| row.off.map(|off| off[i])).collect();
        all.sort_by(f64::total_cmp);
        *value = all.get(all.len() / 2).copied().unwrap_or_default();
    }
    usual
}
