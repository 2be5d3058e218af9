//! Grid cells of the table, with the edge length of the distance between poses.

use super::TableArea;

/// Number of a cell: columns along x, rows along y, numbered row by row.
pub(super) type CellNumber = u32;

/// Steps from a cell to its neighbors.
const STEPS: [(i64, i64); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1)];

/// State of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Cell {
    /// No vertex, after this number of searches.
    Empty(u8),
    /// The cell's vertex.
    Taken(u32),
}

/// Cells of a table, with the positions of their vertices.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    table: TableArea,
    spacing: f64,
    columns: u32,
    rows: u32,
    states: Vec<Cell>,
    /// Position of the hand at each vertex, on the plane.
    places: Vec<[f64; 2]>,
}

impl Cells {
    pub(super) fn new(table: TableArea, spacing: f64) -> Cells {
        let along = |[from, to]: [f64; 2]| (((to - from) / spacing + 1e-6).floor() as u32).max(1);
        let columns = along(table.x_m);
        let rows = along(table.y_m);
        let states = vec![Cell::Empty(0); columns as usize * rows as usize];
        Cells { table, spacing, columns, rows, states, places: Vec::new() }
    }

    pub(super) fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.states.len()
    }

    pub(super) fn state(&self, cell: CellNumber) -> Cell {
        self.states.get(cell as usize).copied().unwrap_or(Cell::Empty(u8::MAX))
    }

    /// Records a search of a cell without a result.
    pub(super) fn missed(&mut self, cell: CellNumber) {
        if let Some(Cell::Empty(tries)) = self.states.get_mut(cell as usize) {
            *tries = tries.saturating_add(1);
        }
    }

    /// Assigns the next vertex to a cell.
    pub(super) fn take(&mut self, cell: CellNumber, place: [f64; 2]) {
        if let Some(state) = self.states.get_mut(cell as usize) {
            *state = Cell::Taken(self.places.len() as u32);
            self.places.push(place);
        }
    }

    /// Returns the cell that contains a position.
    pub(super) fn at(&self, [x, y]: [f64; 2]) -> Option<CellNumber> {
        let index = |v: f64, [from, _]: [f64; 2], count: u32| {
            let i = ((v - from) / self.spacing).floor();
            (i >= 0.0 && i < f64::from(count)).then_some(i as u32)
        };
        let column = index(x, self.table.x_m, self.columns)?;
        let row = index(y, self.table.y_m, self.rows)?;
        Some(row * self.columns + column)
    }

    /// Returns the center of a cell.
    pub(super) fn middle(&self, cell: CellNumber) -> [f64; 2] {
        let column = cell % self.columns;
        let row = cell / self.columns;
        let middle = |[from, _]: [f64; 2], i: u32| from + (f64::from(i) + 0.5) * self.spacing;
        [middle(self.table.x_m, column), middle(self.table.y_m, row)]
    }

    /// Returns the neighbors of a cell: those with a common side before those with a common corner.
    pub(super) fn around(&self, cell: CellNumber) -> impl Iterator<Item = CellNumber> {
        STEPS.into_iter().filter_map(move |step| self.step(cell, step))
    }

    fn step(&self, cell: CellNumber, (right, up): (i64, i64)) -> Option<CellNumber> {
        let column = i64::from(cell % self.columns) + right;
        let row = i64::from(cell / self.columns) + up;
        let inside = (0..i64::from(self.columns)).contains(&column) && (0..i64::from(self.rows)).contains(&row);
        inside.then(|| (row * i64::from(self.columns) + column) as u32)
    }

    /// Returns the vertices of a cell's neighbors.
    pub(super) fn vertices_around(&self, cell: CellNumber) -> impl Iterator<Item = u32> {
        self.around(cell).filter_map(|c| match self.state(c) {
            Cell::Taken(vertex) => Some(vertex),
            Cell::Empty(_) => None,
        })
    }

    /// Returns the distance of the nearest vertex from a position, at most `cap` meters, which may
    /// be up to two steps.
    pub(super) fn nearest(&self, place: [f64; 2], cap: f64) -> f64 {
        let Some(cell) = self.at(place) else { return cap };
        let mut nearest = cap * cap;
        for up in -2..=2 {
            for right in -2..=2 {
                let Some(Cell::Taken(vertex)) = self.step(cell, (right, up)).map(|c| self.state(c)) else { continue };
                if let Some([x, y]) = self.places.get(vertex as usize) {
                    nearest = nearest.min((x - place[0]).powi(2) + (y - place[1]).powi(2));
                }
            }
        }
        nearest.sqrt()
    }

    /// Returns all cells without a vertex.
    pub(super) fn empty(&self) -> impl Iterator<Item = CellNumber> {
        (0..self.states.len() as u32).filter(|c| matches!(self.state(*c), Cell::Empty(_)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cells() -> Cells {
        Cells::new(TableArea { height_m: 0.0, x_m: [-0.2, 0.1], y_m: [0.0, 0.5] }, 0.01)
    }

    #[test]
    fn a_table_of_30_by_50_cm_has_30_by_50_cells_of_a_centimeter() {
        let cells = cells();
        assert_eq!((cells.columns, cells.rows, cells.len()), (30, 50, 1500));
        assert!((0..1500).all(|c| cells.at(cells.middle(c)) == Some(c)));
        assert_eq!((cells.around(0).count(), cells.around(31).count(), cells.around(1499).count()), (3, 8, 3));
    }

    proptest! {
        #[test]
        fn the_nearest_vertex_is_the_one_that_a_plain_search_finds(
            places in prop::collection::vec((-0.19_f64..0.09, 0.01_f64..0.49), 1..60),
            (x, y) in (-0.19_f64..0.09, 0.01_f64..0.49),
        ) {
            let mut cells = cells();
            for (x, y) in places {
                let cell = cells.at([x, y]).unwrap();
                if let Cell::Empty(_) = cells.state(cell) {
                    cells.take(cell, [x, y]);
                }
            }
            let cap = 0.02;
            let plain = cells.places.iter().map(|[a, b]| (a - x).hypot(b - y)).fold(cap, f64::min);
            prop_assert!((cells.nearest([x, y], cap) - plain).abs() < 1e-12);
        }
    }
}
