//! A confusion matrix: one row a true class, one column an answer. Each cell has its count, and is as dark as its
//! share of the row.

use super::drawing::{Across, Area, Colour, Down, Drawing, Font, Point};
use super::style::{GRID, INK, pixels, printable, stroke, text, title};

const CELL: u32 = 76;
const LEFT: u32 = 150;
const TOP: u32 = 110;
const MARGIN: u32 = 24;

/// Draws how often each class was answered for each true class; the last column of `counts` is no answer.
pub fn confusion(method: &str, classes: &[String], counts: &[Vec<usize>]) -> Drawing {
    let (rows, columns) = (classes.len() as u32, classes.len() as u32 + 1);
    Drawing::new([LEFT + columns * CELL + MARGIN, TOP + rows * CELL + MARGIN], |area| {
        let half = (pixels(CELL) / 2) as i32;
        for (row, counts) in (0..).zip(counts) {
            let sum = counts.iter().sum::<usize>().max(1) as f64;
            for (column, count) in (0..).zip(counts) {
                let share = *count as f64 / sum;
                let corners = [corner(row, column), corner(row + 1, column + 1)];
                area.rectangle(corners, shade(share).fill());
                area.rectangle(corners, GRID.line(stroke(1.0)));
                let colour = if share > 0.5 { Colour::WHITE } else { INK };
                if *count > 0 {
                    let font = Font { colour, ..text(Across::Middle, Down::Middle) };
                    area.text(count.to_string(), corners[0].map(|c| c + half), font);
                }
            }
        }
        labels(area, method, classes, half);
    })
}

/// The upper left corner of a cell.
fn corner(row: u32, column: u32) -> Point {
    [pixels(LEFT + column * CELL) as i32, pixels(TOP + row * CELL) as i32]
}

fn labels(area: Area, method: &str, classes: &[String], half: i32) {
    let gap = pixels(8) as i32;
    let heading = format!("{method}: rows are in, columns are answered");
    area.text(heading, [MARGIN, 26].map(|side| pixels(side) as i32), title(Across::Left, Down::Middle));
    for (index, class) in (0..).zip(classes) {
        let [x, y] = corner(index, 0);
        area.text(printable(class), [x - gap, y + half], text(Across::Right, Down::Middle));
    }
    // Long names of neighbouring columns are printed at two heights.
    for (index, class) in (0..).zip(classes.iter().map(String::as_str).chain(["no answer"])) {
        let [x, y] = corner(0, index);
        let up = if index % 2 == 0 { 2 * gap } else { 5 * gap };
        area.text(printable(class), [x + half, y - up], text(Across::Middle, Down::Middle));
    }
}

/// White for none, blue for all.
fn shade(share: f64) -> Colour {
    let mix = |full: f64| (255.0 + share.clamp(0.0, 1.0) * (full - 255.0)) as u8;
    Colour::of(mix(0.0), mix(90.0), mix(160.0))
}
