//! Square cells over an area.

use recording::UserError;

/// Largest number of cells: smaller cells cannot be seen in a picture.
const MOST_CELLS: usize = 40_000;

/// Square cells over a rectangle, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// The corner with the least coordinates, metres.
    pub least_m: [f64; 2],
    /// The side of a cell, metres.
    pub cell_m: f64,
    /// Cells along x.
    pub columns: usize,
    /// Cells along y.
    pub rows: usize,
}

impl Grid {
    /// Cells over a rectangle given by two corners; the last ones may reach beyond it.
    ///
    /// # Errors
    /// There are too many cells; the error names `flag`, which set the size.
    pub fn over(flag: &'static str, [least_m, greatest_m]: [[f64; 2]; 2], cell_m: f64) -> Result<Self, UserError> {
        let along = |axis: usize| ((greatest_m[axis] - least_m[axis]) / cell_m).ceil().max(1.0);
        let (columns, rows) = (along(0), along(1));
        if columns * rows > MOST_CELLS as f64 {
            let what = format!("{columns} by {rows} cells of {cell_m} m are too many: {MOST_CELLS} at most");
            return Err(UserError::flag(flag, what));
        }
        Ok(Self { least_m, cell_m, columns: columns as usize, rows: rows as usize })
    }

    /// The rectangle around points, with a margin on all sides, metres; `None` without points.
    pub fn about(points_m: impl Iterator<Item = [f64; 2]>, margin_m: f64) -> Option<[[f64; 2]; 2]> {
        let boxes = points_m.map(|at| [at, at]);
        let both = boxes.reduce(|a, b| {
            [[a[0][0].min(b[0][0]), a[0][1].min(b[0][1])], [a[1][0].max(b[1][0]), a[1][1].max(b[1][1])]]
        });
        both.map(|[least, greatest]| [least.map(|c| c - margin_m), greatest.map(|c| c + margin_m)])
    }

    /// The centres of the cells, metres.
    pub fn middles(&self) -> impl Iterator<Item = [f64; 2]> {
        let Self { least_m: [x, y], cell_m, columns, rows } = *self;
        let along = move |from: f64, index: usize| from + cell_m * (index as f64 + 0.5);
        (0..rows).flat_map(move |row| (0..columns).map(move |column| [along(x, column), along(y, row)]))
    }

    /// The opposite corners, metres.
    pub fn corners_m(&self) -> [[f64; 2]; 2] {
        let [x, y] = self.least_m;
        [[x, y], [x + self.cell_m * self.columns as f64, y + self.cell_m * self.rows as f64]]
    }
}

#[cfg(test)]
mod tests {
    use super::Grid;

    #[test]
    fn cells_cover_the_rectangle_row_by_row() {
        let corners = Grid::about([[1.0, 5.0], [3.0, 4.0]].into_iter(), 0.5).expect("points");
        assert_eq!(corners, [[0.5, 3.5], [3.5, 5.5]]);
        let grid = Grid::over("--cell-m", corners, 2.0).expect("few");
        assert_eq!((grid.columns, grid.rows), (2, 1));
        assert_eq!(grid.middles().collect::<Vec<_>>(), [[1.5, 4.5], [3.5, 4.5]]);
        assert!(Grid::over("--cell-m", corners, 0.001).is_err());
    }
}
