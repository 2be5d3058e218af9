//! Which place is searched next: growth from the first pose outward, cell by cell.
//!
//! A state machine: [`Growth::next`] says what to look for, [`Growth::tell`] takes what became of it. Equal tales lead to
//! equal wishes, so whoever writes down the trials can go on where they end.

use super::TableMapPlan;
use super::cells::{Cell, CellNumber, Cells};
use super::pose_search::FoundPose;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// So often a cell is searched, the second time from another neighbor's pose and wider.
const TRIES: u8 = 2;
/// So often the first pose is looked for.
const FIRST_TRIES: u8 = 20;

/// What to look for.
#[derive(Clone, Debug, PartialEq)]
pub struct Wish {
    /// The cell of the table; `None` for the first pose, which may be anywhere.
    pub cell: Option<u32>,
    /// How often that was tried before.
    pub attempt: u8,
    /// Where to begin: positions of the plan's motors, rad of encoder.
    pub start: Vec<f64>,
}

/// A search, and what became of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// As in the wish.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<u32>,
    /// As in the wish.
    pub attempt: u8,
    /// Poses that were judged.
    pub evaluations: u32,
    /// Positions of the plan's motors, if a pose was found, rad of encoder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q: Option<Vec<f64>>,
}

/// A map that grows.
#[derive(Clone, Debug)]
pub struct Growth {
    cells: Cells,
    found: Vec<FoundPose>,
    /// Cells beside a vertex that have none: those tried least first, then the nearest to the first pose.
    open: BTreeSet<(u8, u64, CellNumber)>,
    first_tries: u8,
    home: Vec<f64>,
    most: usize,
    evaluations: u64,
    trials: u64,
}

impl Growth {
    /// Nothing yet; `home` is the whole robot's home.
    pub fn new(plan: &TableMapPlan, home: &[f64]) -> Growth {
        Growth {
            cells: Cells::new(plan.table, plan.spacing),
            found: Vec::new(),
            open: BTreeSet::new(),
            first_tries: 0,
            home: plan.motors.iter().filter_map(|m| home.get(*m).copied()).collect(),
            most: plan.vertices,
            evaluations: 0,
            trials: 0,
        }
    }

    /// What to look for next; `None` once there are as many poses as asked for, or no place is left.
    pub fn next(&self) -> Option<Wish> {
        if self.found.len() >= self.most {
            return None;
        }
        if self.found.is_empty() {
            let attempt = self.first_tries;
            return (attempt < FIRST_TRIES).then(|| Wish { cell: None, attempt, start: self.home.clone() });
        }
        let (attempt, _, cell) = *self.open.first()?;
        Some(Wish { cell: Some(cell), attempt, start: self.start(cell, attempt) })
    }

    /// Takes what became of the search that [`Growth::next`] asks for now: a pose as it was accepted, or none.
    pub fn tell(&mut self, evaluations: u32, found: Option<FoundPose>) {
        let Some(wish) = self.next() else { return };
        self.evaluations += u64::from(evaluations);
        self.trials += 1;
        let place = found.as_ref().map(|f| [f.at[0], f.at[1]]);
        let cell = wish.cell.or_else(|| place.and_then(|p| self.cells.at(p)));
        match (found, place, cell) {
            (Some(found), Some(place), Some(cell)) => {
                self.open.retain(|(_, _, c)| *c != cell);
                self.cells.take(cell, place);
                self.found.push(found);
                let around: Vec<_> = self.cells.around(cell).collect();
                around.into_iter().for_each(|c| self.reopen(c));
            }
            _ => match wish.cell {
                None => self.first_tries += 1,
                Some(cell) => {
                    self.open.pop_first();
                    self.cells.missed(cell);
                    self.reopen(cell);
                }
            },
        }
    }

    /// Puts a cell among those to search, unless it has a vertex or was tried enough.
    fn reopen(&mut self, cell: CellNumber) {
        if let Cell::Empty(tries) = self.cells.state(cell)
            && tries < TRIES
        {
            self.open.insert((tries, self.distance(cell), cell));
        }
    }

    /// How far a cell is from the first pose, in squares of a tenth of the spacing.
    fn distance(&self, cell: CellNumber) -> u64 {
        let [x, y] = self.cells.middle(cell);
        let first = self.found.first().map_or([0.0; 3], |f| f.at);
        let squares = ((x - first[0]).powi(2) + (y - first[1]).powi(2)) / (0.1 * self.cells.spacing()).powi(2);
        squares.round() as u64
    }

    /// The pose of one of the cell's neighbors, another one for each attempt.
    fn start(&self, cell: CellNumber, attempt: u8) -> Vec<f64> {
        let near: Vec<u32> = self.cells.vertices_around(cell).collect();
        let vertex = near.get(usize::from(attempt) % near.len().max(1)).and_then(|v| self.found.get(*v as usize));
        vertex.map_or_else(|| self.home.clone(), |v| v.q.clone())
    }

    /// The poses found so far, in that order.
    pub fn found(&self) -> &[FoundPose] {
        &self.found
    }

    /// How many were asked for.
    pub fn most(&self) -> usize {
        self.most
    }

    /// Poses that were judged so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Searches made so far.
    pub fn trials(&self) -> u64 {
        self.trials
    }

    /// Cells of the table.
    pub fn places(&self) -> usize {
        self.cells.len()
    }

    /// Cells that were searched and stayed empty.
    pub fn searched_in_vain(&self) -> Vec<u32> {
        self.cells.empty().filter(|c| !matches!(self.cells.state(*c), Cell::Empty(0))).collect()
    }

    /// Cells that no search came to.
    pub fn untried(&self) -> Vec<u32> {
        self.cells.empty().filter(|c| matches!(self.cells.state(*c), Cell::Empty(0))).collect()
    }

    /// The middle of a cell, on the plane, meters.
    pub fn middle(&self, cell: u32) -> [f64; 2] {
        self.cells.middle(cell)
    }

    pub(super) fn cells(&self) -> &Cells {
        &self.cells
    }
}
