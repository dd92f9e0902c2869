//! The distribution of errors alone, with a key: how many positions err less than so much.

use anyhow::Result;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::style::{pen, pixels, text};
use super::{Track, cdf, drawing};

const LINE: u32 = 24;
const TOP: u32 = 52;

/// Draws the errors of the tracks; their positions are not shown.
///
/// # Errors
/// The drawing library's.
pub fn distribution(tracks: &[Track]) -> Result<String> {
    drawing((920, 460), |area| {
        let (left, right) = area.split_horizontally(pixels(640));
        cdf::draw(&left, tracks)?;
        let style = text(Pos::new(HPos::Left, VPos::Center));
        let mut y = pixels(TOP) as i32;
        for track in tracks {
            let ends = vec![(pixels(4) as i32, y), (pixels(36) as i32, y)];
            right.draw(&pen(&track.method).line::<(i32, i32)>(ends))?;
            right.draw_text(&track.method, &style, (pixels(48) as i32, y))?;
            y += pixels(LINE) as i32;
        }
        Ok(())
    })
}
