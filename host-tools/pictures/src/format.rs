//! Formats of pictures' files.

use std::path::Path;

use anyhow::Result;

use super::{Drawing, pixels, svg};
use recording::UserError;

/// The format of a picture's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    /// Scalable vector graphics.
    Svg,
    /// Portable network graphics.
    Png,
}

impl PictureFormat {
    /// The format that belongs to the file's name.
    ///
    /// # Errors
    /// The name ends in neither of them.
    pub fn of(flag: &'static str, file: &Path) -> Result<Self, UserError> {
        match file.extension().and_then(|extension| extension.to_str()) {
            Some(extension) if extension.eq_ignore_ascii_case("svg") => Ok(Self::Svg),
            Some(extension) if extension.eq_ignore_ascii_case("png") => Ok(Self::Png),
            Some(_) | None => Err(UserError::flag(flag, format!("{} ends in neither .svg nor .png", file.display()))),
        }
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// The picture is so large that there is no memory for its pixels.
    pub fn encode(self, drawing: &Drawing) -> Result<Vec<u8>> {
        match self {
            Self::Svg => Ok(svg::text(drawing).into_bytes()),
            Self::Png => pixels::png(drawing),
        }
    }
}
