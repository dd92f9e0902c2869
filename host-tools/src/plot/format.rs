//! Pictures as SVG, or rendered to PNG.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use resvg::{tiny_skia, usvg};

use crate::UserError;

/// The font of text in PNG, so that it is the same on every machine, also on those without fonts.
const FONT: &[u8] = include_bytes!("../../assets/DejaVuSans.ttf");
/// The font's own name.
const FAMILY: &str = "DejaVu Sans";
/// Pixels of PNG for one of SVG.
const PNG_SCALE: f32 = 1.5;

/// The format of a picture's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable vector graphics.
    Svg,
    /// Portable network graphics.
    Png,
}

impl Format {
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
    /// The text is not SVG, or so large that there is no memory for its pixels.
    pub fn encode(self, svg: String) -> Result<Vec<u8>> {
        match self {
            Self::Svg => Ok(svg.into_bytes()),
            Self::Png => rasterise(&svg),
        }
    }
}

fn rasterise(svg: &str) -> Result<Vec<u8>> {
    let mut fonts = usvg::fontdb::Database::new();
    fonts.load_font_data(FONT.to_vec());
    fonts.set_sans_serif_family(FAMILY);
    let options = usvg::Options { font_family: FAMILY.to_owned(), fontdb: Arc::new(fonts), ..usvg::Options::default() };
    let tree = usvg::Tree::from_str(svg, &options).context("the drawing is not SVG")?;
    let size = tree.size().to_int_size().scale_by(PNG_SCALE).context("the picture has no size")?;
    let mut pixels = tiny_skia::Pixmap::new(size.width(), size.height()).context("the picture is too large")?;
    resvg::render(&tree, tiny_skia::Transform::from_scale(PNG_SCALE, PNG_SCALE), &mut pixels.as_mut());
    pixels.encode_png().context("cannot encode the picture")
}
