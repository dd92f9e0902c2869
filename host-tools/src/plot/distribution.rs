//! The distribution of errors alone, with a legend.

use anyhow::Result;

use super::style::pixels;
use super::{Track, cdf, drawing, legend};

/// Draws the errors of the tracks; their positions are not shown.
///
/// # Errors
/// The drawing library fails.
pub fn distribution(tracks: &[Track]) -> Result<String> {
    drawing((920, 460), |area| {
        let (left, right) = area.split_horizontally(pixels(640));
        cdf::draw(&left, tracks)?;
        legend::methods(&right, tracks.iter().map(|track| track.method.as_str()))?;
        Ok(())
    })
}
