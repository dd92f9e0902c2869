//! The values of the flags that say how a recording is read.

use clap::ValueEnum;
use recording::folder::MOST_HEIGHT_SIGMA_M;

use super::numbers::finite;

/// `--time-offset-s`.
#[derive(Clone, Copy, Debug)]
pub enum TimeOffset {
    /// This number.
    Seconds(f64),
    /// It is estimated.
    Auto,
}

impl std::str::FromStr for TimeOffset {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(Self::Auto),
            seconds => finite(seconds).map(Self::Seconds),
        }
    }
}

/// `--dims`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Dims {
    /// The plane.
    #[value(name = "2")]
    Two,
    /// Space.
    #[value(name = "3")]
    Three,
}

/// `--side`.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Side {
    /// Lower than the anchors
    Below,
    /// Higher than the anchors
    Above,
}

/// `--area`: least and greatest x and y.
#[derive(Clone, Copy, Debug)]
pub struct CornersM(pub [[f64; 2]; 2]);

impl CornersM {
    /// Parses the argument of `--area`.
    ///
    /// # Errors
    /// The text is not four numbers, or the least values are not below the greatest ones.
    pub fn parse(text: &str) -> Result<Self, String> {
        let numbers = text.split(',').map(finite).collect::<Result<Vec<_>, _>>()?;
        match numbers[..] {
            [x0, y0, x1, y1] if x0 < x1 && y0 < y1 => Ok(Self([[x0, y0], [x1, y1]])),
            [_, _, _, _] => Err("X0 must be less than X1, and Y0 less than Y1".to_owned()),
            _ => Err("four numbers are expected: X0,Y0,X1,Y1".to_owned()),
        }
    }
}

/// Parses a standard deviation of a height.
///
/// # Errors
/// The text is not a number, or not one that a height can have.
pub fn deviation(text: &str) -> Result<f64, String> {
    let metres = finite(text)?;
    if (0.0..=MOST_HEIGHT_SIGMA_M).contains(&metres) {
        Ok(metres)
    } else {
        Err(format!("it must be from 0 to {MOST_HEIGHT_SIGMA_M}: beyond, use --dims 3"))
    }
}

/// Parses a duration.
///
/// # Errors
/// The text is not a number, or a negative one.
pub fn seconds(text: &str) -> Result<f64, String> {
    let seconds = finite(text)?;
    if seconds >= 0.0 { Ok(seconds) } else { Err("it must not be below 0".to_owned()) }
}
