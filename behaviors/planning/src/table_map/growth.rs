//! Order of the searches: growth from the first pose outward, cell by cell.
//!
//! A state machine: [`Growth::next`] returns the next search, [`Growth::tell`] takes its result.
//! Equal results lead to equal searches, so a build can be resumed from its recorded trials.

use super::TableMapPlan;
use super::cells::{Cell, CellNumber, Cells};
use super::pose_search::FoundPose;
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Number of searches for a cell, the second from another neighbor's pose and wider.
const MAX_TRIES: u8 = 2;
/// Number of searches for the first pose.
const MAX_FIRST_TRIES: u8 = 20;

/// A search to be made.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseWish {
    /// The cell of the table; `None` for the first pose, which may be anywhere.
    pub cell: Option<u32>,
    /// Number of previous searches for it.
    pub attempt: u8,
    /// Start of the search: positions of the plan's motors, rad at the encoder.
    pub start: Vec<f64>,
}

/// A search and its result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Trial {
    /// Cell of the search.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<u32>,
    /// Attempt of the search.
    pub attempt: u8,
    /// Number of poses evaluated.
    pub evaluations: u32,
    /// Positions of the plan's motors if a pose was found, rad at the encoder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q: Option<Vec<f64>>,
}

/// State of a growing map.
#[derive(Clone, Debug)]
pub struct Growth {
    cells: Cells,
    found: Vec<FoundPose>,
    /// Cells next to a vertex that have none: those with the fewest searches first, then the
    /// nearest to the first pose.
    open: BTreeSet<(u8, u64, CellNumber)>,
    first_tries: u8,
    home: Vec<f64>,
    most: usize,
    evaluations: u64,
    trials: u64,
}

impl Growth {
    /// Creates an empty map; `home`: home configuration of the whole robot.
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

    /// Returns the next search; `None` once there are enough poses, or no cell is left.
    pub fn next(&self) -> Option<PoseWish> {
        if self.found.len() >= self.most {
            return None;
        }
        if self.found.is_empty() {
            let attempt = self.first_tries;
            return (attempt < MAX_FIRST_TRIES).then(|| PoseWish { cell: None, attempt, start: self.home.clone() });
        }
        let (attempt, _, cell) = *self.open.first()?;
        Some(PoseWish { cell: Some(cell), attempt, start: self.start(cell, attempt) })
    }

    /// Records the result of the search that [`Growth::next`] returns now: an accepted pose, or
    /// none.
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

    /// Adds a cell to those to be searched, unless it has a vertex or no attempts are left.
    fn reopen(&mut self, cell: CellNumber) {
        if let Cell::Empty(tries) = self.cells.state(cell)
            && tries < MAX_TRIES
        {
            self.open.insert((tries, self.distance(cell), cell));
        }
    }

    /// Returns the squared distance of a cell from the first pose, in units of a tenth of the
    /// spacing.
    fn distance(&self, cell: CellNumber) -> u64 {
        let [x, y] = self.cells.middle(cell);
        let first = self.found.first().map_or([0.0; 3], |f| f.at);
        let squares = ((x - first[0]).powi(2) + (y - first[1]).powi(2)) / (0.1 * self.cells.spacing()).powi(2);
        squares.round() as u64
    }

    /// Returns the pose of one of the cell's neighbors, another one for each attempt.
    fn start(&self, cell: CellNumber, attempt: u8) -> Vec<f64> {
        let near: Vec<u32> = self.cells.vertices_around(cell).collect();
        let vertex = near.get(usize::from(attempt) % near.len().max(1)).and_then(|v| self.found.get(*v as usize));
        vertex.map_or_else(|| self.home.clone(), |v| v.q.clone())
    }

    /// Poses found so far, in order.
    pub fn found(&self) -> &[FoundPose] {
        &self.found
    }

    /// Maximum number of poses.
    pub fn most(&self) -> usize {
        self.most
    }

    /// Number of poses evaluated so far.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Number of searches made so far.
    pub fn trials(&self) -> u64 {
        self.trials
    }

    /// Number of cells of the table.
    pub fn places(&self) -> usize {
        self.cells.len()
    }

    /// Returns the cells that were searched without success.
    pub fn searched_in_vain(&self) -> Vec<u32> {
        self.cells.empty().filter(|c| !matches!(self.cells.state(*c), Cell::Empty(0))).collect()
    }

    /// Returns the cells that were never searched.
    pub fn untried(&self) -> Vec<u32> {
        self.cells.empty().filter(|c| matches!(self.cells.state(*c), Cell::Empty(0))).collect()
    }

    /// Returns the center of a cell, on the plane, meters.
    pub fn middle(&self, cell: u32) -> [f64; 2] {
        self.cells.middle(cell)
    }

    pub(super) fn cells(&self) -> &Cells {
        &self.cells
    }
}
