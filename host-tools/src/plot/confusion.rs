//! A confusion matrix: one row a true class, one column an answer. Each cell has its count, and is as dark as its
//! share of the row.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::style::{GRID, INK, pixels, printable, stroke, text, title};
use super::{Area, drawing};

const CELL: u32 = 76;
const LEFT: u32 = 150;
const TOP: u32 = 110;
const MARGIN: u32 = 24;

/// Draws how often each class was answered for each true class; the last column of `counts` is no answer.
///
/// # Errors
/// The drawing library fails.
pub fn confusion(method: &str, classes: &[String], counts: &[Vec<usize>]) -> Result<String> {
    let (rows, columns) = (classes.len() as u32, classes.len() as u32 + 1);
    drawing((LEFT + columns * CELL + MARGIN, TOP + rows * CELL + MARGIN), |area| {
        let corner = |row: u32, column: u32| (pixels(LEFT + column * CELL) as i32, pixels(TOP + row * CELL) as i32);
        let half = (pixels(CELL) / 2) as i32;
        for (row, counts) in (0..).zip(counts) {
            let sum = counts.iter().sum::<usize>().max(1) as f64;
            for (column, count) in (0..).zip(counts) {
                let share = *count as f64 / sum;
                let (at, end) = (corner(row, column), corner(row + 1, column + 1));
                area.draw(&Rectangle::new([at, end], shade(share).filled()))?;
                area.draw(&Rectangle::new([at, end], GRID.stroke_width(stroke(1.0))))?;
                let ink = if share > 0.5 { WHITE } else { INK };
                if *count > 0 {
                    let style = text(Pos::new(HPos::Center, VPos::Center)).color(&ink);
                    area.draw_text(&count.to_string(), &style, (at.0 + half, at.1 + half))?;
                }
            }
        }
        labels(area, method, classes, corner, half)
    })
}

fn labels(
    area: &Area,
    method: &str,
    classes: &[String],
    corner: impl Fn(u32, u32) -> (i32, i32),
    half: i32,
) -> Result<()> {
    let gap = pixels(8) as i32;
    let middle = Pos::new(HPos::Center, VPos::Center);
    let heading = format!("{method}: rows are in, columns are answered");
    area.draw_text(&heading, &title(Pos::new(HPos::Left, VPos::Center)), (pixels(MARGIN) as i32, pixels(26) as i32))?;
    for (index, class) in (0..).zip(classes) {
        let (_, y) = corner(index, 0);
        area.draw_text(
            &printable(class),
            &text(Pos::new(HPos::Right, VPos::Center)),
            (corner(0, 0).0 - gap, y + half),
        )?;
    }
    // Long names of neighbouring columns are printed at two heights.
    for (index, class) in (0..).zip(classes.iter().map(String::as_str).chain(["no answer"])) {
        let (x, y) = corner(0, index);
        let up = if index % 2 == 0 { 2 * gap } else { 5 * gap };
        area.draw_text(&printable(class), &text(middle), (x + half, y - up))?;
    }
    Ok(())
}

/// White for none, blue for all.
fn shade(share: f64) -> RGBColor {
    let mix = |full: f64| (255.0 + share.clamp(0.0, 1.0) * (full - 255.0)) as u8;
    RGBColor(mix(0.0), mix(90.0), mix(160.0))
}
