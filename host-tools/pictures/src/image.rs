//! Images of floor plans: PNG and JPEG files.

use std::io::Cursor;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use thiserror::Error;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// The greatest number of pixels: 256 MiB in memory.
const MOST_PIXELS: usize = 1 << 26;

/// An image, which SVG contains as it is, and PNG pixel by pixel.
#[derive(Clone, PartialEq)]
pub struct Image {
    kind: Kind,
    file: Vec<u8>,
    size: [usize; 2],
    /// Red, green, blue and opacity of each pixel, row by row.
    pixels: Vec<[u8; 4]>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Png,
    Jpeg,
}

/// Why a file is no image.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ImageError {
    /// It is of another kind.
    #[error("it is neither a PNG nor a JPEG image")]
    Unknown,
    /// It ends too early, or is not what the format has.
    #[error("the image is damaged: {0}")]
    Damaged(String),
    /// There would be no memory for it.
    #[error("the image has {0} × {1} pixels: up to {MOST_PIXELS} can be drawn; make it smaller")]
    TooLarge(usize, usize),
}

impl Image {
    /// Reads a file's content.
    ///
    /// # Errors
    /// It is no image, or a large one.
    pub fn read(file: Vec<u8>) -> Result<Self, ImageError> {
        let kind = match file.as_slice() {
            [0x89, b'P', b'N', b'G', ..] => Kind::Png,
            [0xff, 0xd8, 0xff, ..] => Kind::Jpeg,
            _ => return Err(ImageError::Unknown),
        };
        let (size, pixels) = match kind {
            Kind::Png => png_pixels(&file)?,
            Kind::Jpeg => jpeg_pixels(&file)?,
        };
        Ok(Self { kind, file, size, pixels })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// The pixel of a column and a row.
    pub fn pixel(&self, column: usize, row: usize) -> Option<[u8; 4]> {
        self.pixels.get(row * self.size[0] + column).copied()
    }

    /// The file as a `data:` URL.
    pub fn url(&self) -> String {
        let kind = match self.kind {
            Kind::Png => "png",
            Kind::Jpeg => "jpeg",
        };
        format!("data:image/{kind};base64,{}", STANDARD.encode(&self.file))
    }
}

impl std::fmt::Debug for Image {
    fn fmt(&self, to: &mut std::fmt::Formatter) -> std::fmt::Result {
        write!(to, "{:?} of {:?} pixels", self.kind, self.size)
    }
}

fn checked(size: [usize; 2]) -> Result<usize, ImageError> {
    let [width, height] = size;
    width.checked_mul(height).filter(|count| *count <= MOST_PIXELS).ok_or(ImageError::TooLarge(width, height))
}

fn damaged(error: impl ToString) -> ImageError {
    ImageError::Damaged(error.to_string())
}

fn png_pixels(file: &[u8]) -> Result<([usize; 2], Vec<[u8; 4]>), ImageError> {
    let mut decoder = png::Decoder::new(Cursor::new(file));
    decoder.set_transformations(png::Transformations::normalize_to_color8() | png::Transformations::ALPHA);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = reader.info().size();
    let size = [width as usize, height as usize];
    let count = checked(size)?;
    let length = reader.output_buffer_size().ok_or(ImageError::TooLarge(size[0], size[1]))?;
    let mut bytes = vec![0; length];
    let frame = reader.next_frame(&mut bytes).map_err(damaged)?;
    let pixels = match frame.color_type {
        png::ColorType::Rgba => bytes.as_chunks().0.to_vec(),
        png::ColorType::GrayscaleAlpha => {
            bytes.as_chunks().0.iter().map(|[grey, opacity]| [*grey, *grey, *grey, *opacity]).collect()
        }
        png::ColorType::Rgb => {
            bytes.as_chunks().0.iter().map(|[red, green, blue]| [*red, *green, *blue, 255]).collect()
        }
        png::ColorType::Grayscale => bytes.iter().map(|grey| [*grey, *grey, *grey, 255]).collect(),
        png::ColorType::Indexed => return Err(damaged("it has a palette without colours")),
    };
    complete(size, count, pixels)
}

fn jpeg_pixels(file: &[u8]) -> Result<([usize; 2], Vec<[u8; 4]>), ImageError> {
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGBA);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
    decoder.decode_headers().map_err(|error| damaged(format!("{error:?}")))?;
    let info = decoder.info().ok_or_else(|| damaged("it has no size"))?;
    let size = [usize::from(info.width), usize::from(info.height)];
    let count = checked(size)?;
    if decoder.output_colorspace() != Some(ColorSpace::RGBA) {
        return Err(damaged("its colours are not known"));
    }
    let bytes = decoder.decode().map_err(|error| damaged(format!("{error:?}")))?;
    complete(size, count, bytes.as_chunks().0.to_vec())
}

fn complete(size: [usize; 2], count: usize, pixels: Vec<[u8; 4]>) -> Result<([usize; 2], Vec<[u8; 4]>), ImageError> {
    if pixels.len() == count { Ok((size, pixels)) } else { Err(damaged("pixels are missing")) }
}

#[cfg(test)]
mod tests {
    use super::{Image, ImageError};

    /// A grey JPEG of 8 × 8 pixels (ITU-T T.81): its mean is 100 below 128, and nothing else is in it. The quantum of
    /// the mean is 8 of 8 × 8 sums, that is 1; category 7 has the code 0, -100 the bits 0011011, and the end the code 0.
    fn grey() -> Vec<u8> {
        let table = |class: u8, symbol: u8| [&[0xff, 0xc4, 0, 20, class, 1][..], &[0; 15], &[symbol]].concat();
        [
            &[0xff, 0xd8, 0xff, 0xdb, 0, 67, 0, 8][..],
            &[1; 63],
            &[0xff, 0xc0, 0, 11, 8, 0, 8, 0, 8, 1, 1, 0x11, 0],
            &table(0x00, 7),
            &table(0x10, 0),
            &[0xff, 0xda, 0, 8, 1, 1, 0, 0, 63, 0],
            &[0b0001_1011, 0b0111_1111, 0xff, 0xd9],
        ]
        .concat()
    }

    #[test]
    fn a_jpeg_is_read_and_a_damaged_one_is_an_error_or_another_image() {
        let image = Image::read(grey()).expect("an image");
        assert_eq!(
            (image.size(), image.pixel(0, 0), image.pixel(7, 7)),
            ([8, 8], Some([28, 28, 28, 255]), Some([28, 28, 28, 255]))
        );
        assert!(image.url().starts_with("data:image/jpeg;base64,/9j/"));
        for length in 0..80 {
            let wrong = Image::read(grey()[..length].to_vec());
            assert!(matches!(wrong, Err(ImageError::Unknown | ImageError::Damaged(_))), "{length}: {wrong:?}");
        }
        for at in 3..grey().len() {
            for bits in [0x01, 0x80, 0xff] {
                let mut wrong = grey();
                wrong[at] ^= bits;
                let _ = Image::read(wrong);
            }
        }
    }
}
