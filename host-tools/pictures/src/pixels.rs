//! A drawing as pixels, and these as a PNG file (W3C, Portable Network Graphics).

use std::ops::Range;

use anyhow::{Context, Result, ensure};

use super::coverage::{Coverage, Outline, Place};
use super::drawing::{Colour, Drawing, FINE, IMAGE_OPACITY, Paint, Placed, Point, Shape};
use super::font::Font;
use super::image::Image;
use super::{outline, text};

/// Pixels of PNG for one of the drawing.
const SCALE: f64 = 1.5;
/// Pixels of PNG for a unit of the drawing.
const A_UNIT: f64 = SCALE / FINE as f64;
/// The greatest number of pixels: 0.5 GiB in memory with their coverage.
const MOST_PIXELS: usize = 1 << 26;

/// The bytes of a PNG file.
///
/// # Errors
/// The picture is too large.
pub fn png(drawing: &Drawing) -> Result<Vec<u8>> {
    let size = drawing.size.map(|side| (f64::from(side) * SCALE).round() as usize);
    let [width, height] = size;
    let is_small = width.checked_mul(height).is_some_and(|count| count <= MOST_PIXELS);
    ensure!(is_small, "a picture of {width} × {height} pixels is too large for PNG: write it as .svg");
    let canvas = Canvas::of(drawing, size)?;
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width as u32, height as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let encoded = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(canvas.pixels.as_flattened())?;
        writer.finish()
    });
    encoded.context("cannot encode the picture")?;
    Ok(file)
}

/// White paper, and what is drawn on it.
struct Canvas {
    size: [usize; 2],
    /// Red, green and blue, row by row.
    pixels: Vec<[u8; 3]>,
    coverage: Coverage,
}

impl Canvas {
    fn of(drawing: &Drawing, size: [usize; 2]) -> Result<Self> {
        let font = Font::bundled().context("the font of this program is damaged")?;
        let pixels = vec![Colour::WHITE.rgb; size[0] * size[1]];
        let mut canvas = Self { size, pixels, coverage: Coverage::new(size) };
        drawing.images.iter().for_each(|placed| canvas.image(placed));
        drawing.shapes.iter().for_each(|shape| canvas.shape(&font, shape));
        Ok(canvas)
    }

    fn shape(&mut self, font: &Font, shape: &Shape) {
        let width = |line: u32| f64::from(line) * A_UNIT;
        match shape {
            Shape::Rectangle([[x0, y0], [x1, y1]], paint) => {
                let corners = [[*x0, *y0], [*x1, *y0], [*x1, *y1], [*x0, *y1]].map(place);
                match paint {
                    Paint::Fill(colour) => self.area(corners, *colour),
                    Paint::Border(line) => {
                        let [a, b, c, d] = corners;
                        // Once more along the first side, so that its corner is pointed as well.
                        let half = [0.5 * (a[0] + b[0]), a[1]];
                        let through = [half, b, c, d, a, half];
                        self.fill(&outline::line(&through, width(line.width)), line.colour);
                    }
                }
            }
            Shape::Straight(ends, line) => {
                self.fill(&outline::line(&ends.map(place), width(line.width)), line.colour);
            }
            Shape::Path(points, line) => {
                let points: Vec<Place> = points.iter().copied().map(place).collect();
                self.fill(&outline::line(&points, width(line.width)), line.colour);
            }
            Shape::Polygon(corners, colour) => self.area(corners.iter().copied().map(place), *colour),
            Shape::Circle(middle, radius, paint) => {
                let (middle, radius) = (place(*middle), width(*radius));
                let (ring, colour) = match paint {
                    Paint::Fill(colour) => (None, *colour),
                    Paint::Border(line) => (Some(width(line.width)), line.colour),
                };
                self.fill(&outline::circle(middle, radius, ring), colour);
            }
            Shape::Text(line, at, look) => {
                self.fill(&text::outline(font, line, place(*at), look, A_UNIT), look.colour);
            }
        }
    }

    fn area(&mut self, corners: impl IntoIterator<Item = Place>, colour: Colour) {
        let mut outline = Outline::default();
        outline.add(corners);
        self.fill(&outline, colour);
    }

    fn fill(&mut self, outline: &Outline, colour: Colour) {
        let Self { size, pixels, coverage } = self;
        coverage.of(outline, |column, row, share| {
            if let Some(pixel) = pixels.get_mut(row * size[0] + column) {
                mix(pixel, colour.rgb, share * colour.opacity as f32);
            }
        });
    }

    /// Draws an image into its window. A pixel of the picture has the mean of the image around its middle, weighted by
    /// a tent as wide as two pixels of the coarser of both.
    fn image(&mut self, placed: &Placed) {
        let Placed { image, window, at, size } = placed;
        let [from, to] = window.map(place);
        let taps = |axis: usize| -> Vec<(usize, Taps)> {
            let shown = from[axis].round().max(0.0) as usize..(to[axis].round().max(0.0) as usize).min(self.size[axis]);
            let (count, side) = (image.size()[axis], size[axis] * A_UNIT);
            let a_pixel = count as f64 / side;
            let along = |pixel: usize| (pixel as f64 + 0.5 - from[axis] - at[axis] * A_UNIT) * a_pixel;
            let inside = shown.map(|pixel| (pixel, along(pixel)));
            inside
                .filter(|(_, along)| (0.0..count as f64).contains(along))
                .map(|(pixel, along)| (pixel, Taps::around(along, a_pixel, count)))
                .collect()
        };
        let columns = taps(0);
        for (row, down) in taps(1) {
            for (column, across) in &columns {
                let [red, green, blue, opacity] = mean(image, across, &down);
                if let Some(pixel) = self.pixels.get_mut(row * self.size[0] + column) {
                    mix(pixel, [red, green, blue].map(|part| part.round() as u8), opacity * IMAGE_OPACITY as f32);
                }
            }
        }
    }
}

/// A point of a drawing in pixels.
fn place(at: Point) -> Place {
    at.map(|c| f64::from(c) * A_UNIT)
}

/// Covers a share of a pixel with a colour.
fn mix(pixel: &mut [u8; 3], colour: [u8; 3], share: f32) {
    for (part, colour) in pixel.iter_mut().zip(colour) {
        let under = f32::from(*part);
        *part = (under + share * (f32::from(colour) - under)).round() as u8;
    }
}

/// The pixels of an image along one axis that a pixel of the picture shows, and their weights.
struct Taps {
    pixels: Range<usize>,
    middle: f64,
    reach: f64,
}

impl Taps {
    /// Around a place of an image of `count` pixels, of which the picture's pixel has `a_pixel`.
    fn around(middle: f64, a_pixel: f64, count: usize) -> Self {
        let reach = a_pixel.max(1.0);
        let first = (middle - reach - 0.5).ceil().max(0.0) as usize;
        let last = (middle + reach - 0.5).floor().max(0.0) as usize;
        Self { pixels: first.min(count - 1)..(last + 1).clamp(1, count), middle, reach }
    }

    fn weights(&self) -> impl Iterator<Item = (usize, f32)> {
        let weight = |pixel: usize| 1.0 - (pixel as f64 + 0.5 - self.middle).abs() / self.reach;
        self.pixels.clone().map(move |pixel| (pixel, weight(pixel).max(1e-6) as f32))
    }
}

/// The mean colour, and the mean opacity from 0 to 1.
fn mean(image: &Image, across: &Taps, down: &Taps) -> [f32; 4] {
    let (mut colour, mut opacity, mut whole) = ([0.0_f32; 3], 0.0_f32, 0.0_f32);
    for (row, high) in down.weights() {
        for (column, wide) in across.weights() {
            let Some([red, green, blue, alpha]) = image.pixel(column, row) else { continue };
            let weight = high * wide;
            let seen = weight * f32::from(alpha) / 255.0;
            whole += weight;
            opacity += seen;
            for (sum, part) in colour.iter_mut().zip([red, green, blue]) {
                *sum += seen * f32::from(part);
            }
        }
    }
    let [red, green, blue] = colour.map(|sum| if opacity > 0.0 { sum / opacity } else { 0.0 });
    [red, green, blue, if whole > 0.0 { opacity / whole } else { 0.0 }]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::drawing::{Across, Area, Down, Font as Look, Line};
    use super::super::image::ImageError;
    use super::{Canvas, Colour, Drawing, Image, png};
    use crate::style::text;

    const RED: Colour = Colour::of(200, 0, 0);
    const BLACK: Colour = Colour::of(0, 0, 0);

    /// The pixels of a drawing of 20 × 20 pixels: 30 × 30 in PNG.
    fn pixels(draw: impl FnOnce(Area)) -> impl Fn(usize, usize) -> [u8; 3] {
        let canvas = Canvas::of(&Drawing::new([20, 20], draw), [30, 30]).expect("a canvas");
        move |column, row| canvas.pixels[row * 30 + column]
    }

    /// A PNG file of these pixels.
    fn file(width: u32, kind: png::ColorType, depth: png::BitDepth, palette: &'static [u8], data: &[u8]) -> Vec<u8> {
        let mut file = Vec::new();
        let bits = data.len() * 8 / (kind.samples() * depth as usize);
        let mut encoder = png::Encoder::new(&mut file, width, bits as u32 / width);
        encoder.set_color(kind);
        encoder.set_depth(depth);
        if !palette.is_empty() {
            encoder.set_palette(palette);
        }
        encoder.write_header().and_then(|mut writer| writer.write_image_data(data)).expect("a file");
        file
    }

    #[test]
    fn shapes_cover_what_they_should_in_their_order() {
        // 8 units are 1.5 pixels: from 3 to 12 across, from 6 to 15 down.
        let square = pixels(|area| {
            area.rectangle([[16, 32], [64, 80]], RED.fill());
            area.rectangle([[32, 32], [64, 80]], BLACK.faded(0.5).fill());
        });
        assert_eq!([square(2, 8), square(3, 5), square(3, 6), square(5, 14)], [[255; 3], [255; 3], RED.rgb, RED.rgb]);
        assert_eq!([square(6, 8), square(11, 14), square(12, 14)], [[100, 0, 0], [100, 0, 0], [255; 3]]);
        // A border of 3 pixels around 6 to 12: from 4.5 to 7.5, with pointed corners.
        let framed = pixels(|area| area.rectangle([[32, 32], [64, 64]], Line { colour: BLACK, width: 16 }));
        assert_eq!([framed(8, 8), framed(3, 3), framed(4, 4)], [[255; 3], [255; 3], [191; 3]]);
        assert_eq!([framed(5, 5), framed(6, 9), framed(12, 9)], [[0; 3]; 3]);
        let ring = pixels(|area| area.circle([80, 80], 40, BLACK.line(8)));
        assert_eq!([ring(15, 15), ring(15, 22), ring(15, 25)], [[255; 3], BLACK.rgb, [255; 3]]);
    }

    #[test]
    fn an_image_is_scaled_into_its_window() {
        // Two by two: red, opaque; nothing; blue, half; white.
        let data = [[200, 0, 0, 255], [9, 9, 9, 0], [0, 0, 100, 128], [255; 4]];
        let bytes = file(2, png::ColorType::Rgba, png::BitDepth::Eight, &[], data.as_flattened());
        let image = Arc::new(Image::read(bytes).expect("an image"));
        assert_eq!(image.size(), [2, 2]);
        // Each pixel becomes 12 by 12; the window cuts the right half and begins at pixel 3.
        let shown = pixels(|area| area.inside([16, 16, 64, 16]).put_beneath(image.clone(), [0.0; 2], [128.0; 2]));
        let covered = |colour: u8, share: f64| (255.0 + share * (f64::from(colour) - 255.0)).round() as u8;
        // The window is from 3 to 18. At the middle of the first pixel, at 9, it is pure: opacity 0.6.
        assert_eq!(shown(4, 4), [covered(200, 0.6), covered(0, 0.6), covered(0, 0.6)]);
        let blue = shown(4, 25);
        let expected = [covered(0, 0.301), covered(0, 0.301), covered(100, 0.301)];
        assert!(
            blue.iter().zip(expected).all(|(part, expected)| part.abs_diff(expected) <= 1),
            "{blue:?} {expected:?}"
        );
        assert_eq!([shown(2, 4), shown(18, 25), shown(4, 27)], [[255; 3]; 3]);
        // A large image becomes its mean: 40 by 40 of black and white columns on 3 by 3 pixels.
        let stripes: Vec<u8> = (0..1600).map(|at| if at % 2 == 0 { 0 } else { 255 }).collect();
        let bytes = file(40, png::ColorType::Grayscale, png::BitDepth::Eight, &[], &stripes);
        let image = Arc::new(Image::read(bytes).expect("an image"));
        let shown = pixels(|area| area.put_beneath(image, [16.0, 16.0], [16.0, 16.0]));
        // 0.6 of black's half.
        assert!(shown(4, 4).iter().all(|part| part.abs_diff(179) <= 2), "{:?}", shown(4, 4));
    }

    #[test]
    fn png_of_all_kinds_are_read_and_damaged_ones_are_errors() {
        let first = |bytes: Vec<u8>| Image::read(bytes).expect("an image").pixel(0, 0);
        let deep = file(1, png::ColorType::Rgb, png::BitDepth::Sixteen, &[], &[200, 9, 100, 9, 50, 9]);
        assert_eq!(first(deep), Some([200, 100, 50, 255]));
        let palette = file(4, png::ColorType::Indexed, png::BitDepth::Two, &[1, 2, 3, 4, 5, 6], &[0b0100_0000]);
        assert_eq!(first(palette), Some([4, 5, 6, 255]));
        let grey = file(1, png::ColorType::GrayscaleAlpha, png::BitDepth::Eight, &[], &[7, 8]);
        assert_eq!(first(grey.clone()), Some([7, 7, 7, 8]));
        assert_eq!(Image::read(b"GIF89a".to_vec()), Err(ImageError::Unknown));
        for length in 0..grey.len() {
            // The end of the file alone may be missing.
            assert!(Image::read(grey[..length].to_vec()).is_err() || length >= grey.len() - 16, "{length}");
        }
        for at in 8..grey.len() {
            let mut wrong = grey.clone();
            wrong[at] ^= 0x55;
            let _ = Image::read(wrong);
        }
        // 2³⁰ pixels by 2³⁰ in a file of a few bytes: width and height, and the check of the chunk.
        let mut large = grey;
        large[16..24].copy_from_slice(&[0x40, 0, 0, 0, 0x40, 0, 0, 0]);
        let check = crc(&large[12..29]);
        large[29..33].copy_from_slice(&check.to_be_bytes());
        assert!(matches!(Image::read(large), Err(ImageError::TooLarge(..) | ImageError::Damaged(_))));
    }

    /// The check of a chunk (PNG, annex D).
    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(u32::MAX, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 })
        })
    }

    #[test]
    fn any_text_and_any_place_makes_a_picture() {
        let far = [i32::MAX, i32::MIN];
        let drawing = Drawing::new([50, 50], |area| {
            let look = text(Across::Middle, Down::Middle);
            area.text("x".repeat(2000), [0, 0], look);
            area.text("\u{0}\u{301}\u{202e}日本<&", far, Look { is_upright: true, ..look });
            area.path([far, [0, 0], [i32::MIN, i32::MAX]], RED.line(u32::MAX));
            area.circle(far, u32::MAX, RED.fill());
            area.circle([0, 0], 0, RED.line(0));
            area.polygon([], RED);
            area.rectangle([far, [0, 0]], RED.line(8));
        });
        assert_eq!(png(&drawing).expect("a file")[1..4], *b"PNG");
        let large = png(&Drawing::new([100_000, 100_000], |_| ())).expect_err("too large").to_string();
        assert!(large.contains("150000 × 150000 pixels is too large for PNG: write it as .svg"), "{large}");
    }
}
