//! Colours, sizes and strokes that all panels of a picture share.

pub use super::drawing::FINE;
use super::drawing::{Across, Area, Colour, Down, Font, Line, Point};

/// The colour of everything that is drawn with a font.
pub const INK: Colour = Colour::of(40, 40, 40);
/// The colour of axes.
pub const AXIS: Colour = Colour::of(130, 130, 130);
/// The colour of the lines behind a chart.
pub const GRID: Colour = Colour::of(232, 232, 232);

// The colours of Okabe and Ito, which are also distinct for the colour-blind. Orange and sky blue are darker, so that
// thin lines have a contrast of 3:1 on white.
const GREY: Colour = Colour::of(120, 120, 120);
const ORANGE: Colour = Colour::of(190, 130, 0);
const VERMILION: Colour = Colour::of(213, 94, 0);
const GREEN: Colour = Colour::of(0, 158, 115);
const PURPLE: Colour = Colour::of(204, 121, 167);
const BLUE: Colour = Colour::of(0, 114, 178);
const SKY: Colour = Colour::of(50, 150, 205);

/// The colours of series, in the order of their use.
pub const PALETTE: [Colour; 7] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY];

/// Size of text, pixels.
const TEXT: u32 = 13;
/// Size of a panel's title, pixels.
const TITLE: u32 = 16;

/// Converts pixels of the shown picture to pixels of the drawn one.
pub fn pixels(shown: u32) -> u32 {
    shown * FINE
}

/// The same for fractions of a pixel, such as radii and widths of lines.
pub fn stroke(shown: f64) -> u32 {
    (shown * f64::from(FINE)).round() as u32
}

/// Text of the usual size.
pub const fn text(across: Across, down: Down) -> Font {
    Font { size: TEXT * FINE, colour: INK, anchor: (across, down), is_upright: false }
}

/// The title of a panel.
pub const fn title(across: Across, down: Down) -> Font {
    Font { size: TITLE * FINE, ..text(across, down) }
}

/// The label of a vertical axis.
pub const fn upright(across: Across, down: Down) -> Font {
    Font { is_upright: true, ..text(across, down) }
}

/// Text from outside, without characters that would break a drawing.
pub fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}

/// The dash pattern of a method's line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dash {
    /// A solid line.
    Solid,
    /// Dashes.
    Dashed,
    /// Dots.
    Dotted,
}

/// The mark of a position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// A filled circle.
    Dot,
    /// An empty circle.
    Ring,
    /// A cross.
    Cross,
}

/// The pen of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pen {
    /// Its colour.
    pub color: Colour,
    /// Its line.
    pub dash: Dash,
    /// The line's width, pixels.
    pub width: f64,
    /// Its positions.
    pub mark: Mark,
}

/// The pen of a method: one colour a family, one dash pattern a variant.
pub fn pen(method: &str) -> Pen {
    let (color, dash) = own(method).unwrap_or((SKY, Dash::Solid));
    Pen { color, dash, width: if method == "robust" { 2.5 } else { 1.6 }, mark: Mark::Dot }
}

/// Whether a method has a pen of its own.
pub fn known(method: &str) -> bool {
    own(method).is_some()
}

fn own(method: &str) -> Option<(Colour, Dash)> {
    Some(match method {
        "bounding-box" => (GREY, Dash::Solid),
        "lls" => (ORANGE, Dash::Solid),
        "nls" => (VERMILION, Dash::Solid),
        "nls-ccv" => (VERMILION, Dash::Dotted),
        "b-wls" => (GREEN, Dash::Solid),
        "b-wls-c" => (GREEN, Dash::Dashed),
        "b-wls-r" => (GREEN, Dash::Dotted),
        "bb-nls" => (PURPLE, Dash::Solid),
        "bb-nls-c" => (PURPLE, Dash::Dashed),
        "bb-nls-r" => (PURPLE, Dash::Dotted),
        "robust" => (BLUE, Dash::Solid),
        "by anchors" => (BLUE, Dash::Solid),
        "by beacons" => (VERMILION, Dash::Solid),
        // The benchmarks of tracks.
        "no mitigation" | "IEKF, no ignore" => (GREY, Dash::Solid),
        "EKF without detection" => (ORANGE, Dash::Dashed),
        "EKF" | "IEKF, ignore NLOS" => (VERMILION, Dash::Solid),
        "IEKF, ignore NLOS, mitigate" => (VERMILION, Dash::Dashed),
        "NLS, ignore NLOS" => (GREEN, Dash::Solid),
        "NLS, ignore NLOS, min. 4" => (GREEN, Dash::Dashed),
        "engine, no ignore" => (BLUE, Dash::Dashed),
        "calibrated" | "engine, weigh" => (BLUE, Dash::Solid),
        _ => return pair(method),
    })
}

/// Benchmarks whose names have two parts: the algorithm, and what it uses.
fn pair(method: &str) -> Option<(Colour, Dash)> {
    let (who, what) = method.rsplit_once(", ")?;
    let color = match who {
        "fusion, 64 hypotheses" | "RSSI 5 dB" => BLUE,
        "fusion, 24 hypotheses" | "RSSI 10 dB" => GREEN,
        "engine" | "ToF 100 µs" => VERMILION,
        _ => return None,
    };
    let dash = match what {
        "both" | "fingerprinting" => Dash::Solid,
        "UWB" | "multilateration" => Dash::Dashed,
        "BLE" | "nonlinear in the room" => Dash::Dotted,
        _ => return None,
    };
    Some((color, dash))
}

impl Pen {
    /// Draws the line through points.
    pub fn line(self, area: Area, points: impl IntoIterator<Item = Point>) {
        let line = self.color.line(stroke(self.width));
        match self.dash {
            Dash::Solid => area.path(points, line),
            Dash::Dashed => area.dashed_path(points, [7, 4].map(pixels), line),
            Dash::Dotted => area.dashed_path(points, [2, 3].map(pixels), line),
        }
    }

    /// Draws the mark of a position.
    pub fn mark(self, area: Area, at: Point, radius: f64) {
        let (radius, line): (_, Line) = (stroke(radius), self.color.line(stroke(1.0)));
        match self.mark {
            Mark::Dot => area.circle(at, radius, self.color.faded(0.75).fill()),
            Mark::Ring => area.circle(at, radius, line),
            Mark::Cross => area.cross(at, radius, line),
        }
    }
}

/// A colour of the same hue for the truth of a series.
pub fn darker(color: Colour) -> Colour {
    Colour { rgb: color.rgb.map(|part| (f64::from(part) * 0.55) as u8), ..color }
}

/// A number with as few digits as are exact to a thousandth.
pub fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The contrast of a colour on white, by WCAG 2.2.
    fn contrast(Colour { rgb: [red, green, blue], .. }: Colour) -> f64 {
        let linear = |part: u8| {
            let share = f64::from(part) / 255.0;
            if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
        };
        1.05 / (0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue) + 0.05)
    }

    #[test]
    fn every_colour_has_a_contrast_of_three_to_one_on_white() {
        // The two ends of the scale: black 21, white 1.
        assert_eq!((contrast(Colour::of(0, 0, 0)), contrast(Colour::WHITE)), (21.0, 1.0));
        for color in PALETTE {
            assert!(contrast(color) >= 3.0, "{color:?}: {}", contrast(color));
        }
    }
}
