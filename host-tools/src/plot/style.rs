//! Colours, sizes and strokes that all panels of a picture share.

use plotters::element::{DashedPathElement, DynElement, IntoDynElement};
use plotters::prelude::*;
use plotters::style::FontTransform;
use plotters::style::text_anchor::Pos;

/// Pictures are drawn larger by this factor, and shown at their right size, because `plotters` rounds to whole
/// pixels.
pub const FINE: u32 = 8;

/// The colour of everything that is drawn with a font.
pub const INK: RGBColor = RGBColor(40, 40, 40);
/// The colour of axes.
pub const AXIS: RGBColor = RGBColor(130, 130, 130);
/// The colour of the lines behind a chart.
pub const GRID: RGBColor = RGBColor(232, 232, 232);

// The colours of Okabe and Ito, which are also distinct for the colour-blind. Orange and sky blue are darker, so that
// thin lines have a contrast of 3:1 on white.
const GREY: RGBColor = RGBColor(120, 120, 120);
const ORANGE: RGBColor = RGBColor(190, 130, 0);
const VERMILION: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const PURPLE: RGBColor = RGBColor(204, 121, 167);
const BLUE: RGBColor = RGBColor(0, 114, 178);
const SKY: RGBColor = RGBColor(50, 150, 205);

/// The colours of series, in the order of their use.
pub const PALETTE: [RGBColor; 7] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY];

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
pub fn text(anchor: Pos) -> TextStyle<'static> {
    sized(TEXT, anchor)
}

/// The title of a panel.
pub fn title(anchor: Pos) -> TextStyle<'static> {
    sized(TITLE, anchor)
}

/// The label of a vertical axis.
pub fn upright(anchor: Pos) -> TextStyle<'static> {
    text(anchor).transform(FontTransform::Rotate270)
}

fn sized(size: u32, anchor: Pos) -> TextStyle<'static> {
    // The SVG backend divides font sizes by 1.24.
    TextStyle::from(("sans-serif", 1.24 * f64::from(pixels(size))).into_font()).color(&INK).pos(anchor)
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
    pub color: RGBColor,
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

fn own(method: &str) -> Option<(RGBColor, Dash)> {
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
fn pair(method: &str) -> Option<(RGBColor, Dash)> {
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
    /// The line through points.
    pub fn line<'a, C: Clone + 'static>(self, points: Vec<C>) -> DynElement<'static, SVGBackend<'a>, C> {
        let stroke = self.stroke();
        match self.dash {
            Dash::Solid => PathElement::new(points, stroke).into_dyn(),
            Dash::Dashed => DashedPathElement::new(points, pixels(7), pixels(4), stroke).into_dyn(),
            Dash::Dotted => DashedPathElement::new(points, pixels(2), pixels(3), stroke).into_dyn(),
        }
    }

    fn stroke(self) -> ShapeStyle {
        self.color.stroke_width(stroke(self.width))
    }

    /// The marks of points.
    pub fn marks<'a, C: Clone + 'static>(
        self,
        points: impl Iterator<Item = C>,
        radius: f64,
    ) -> Vec<DynElement<'static, SVGBackend<'a>, C>> {
        let (radius, filled) = (stroke(radius), self.color.mix(0.75).filled());
        let mark = |at: C| match self.mark {
            Mark::Dot => Circle::new(at, radius, filled).into_dyn(),
            Mark::Ring => Circle::new(at, radius, self.color.stroke_width(stroke(1.0))).into_dyn(),
            Mark::Cross => Cross::new(at, radius, self.color.stroke_width(stroke(1.0))).into_dyn(),
        };
        points.map(mark).collect()
    }
}

/// A colour of the same hue for the truth of a series.
pub fn darker(color: RGBColor) -> RGBColor {
    let RGBColor(red, green, blue) = color;
    let half = |part: u8| (f64::from(part) * 0.55) as u8;
    RGBColor(half(red), half(green), half(blue))
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
    fn contrast(RGBColor(red, green, blue): RGBColor) -> f64 {
        let linear = |part: u8| {
            let share = f64::from(part) / 255.0;
            if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
        };
        1.05 / (0.2126 * linear(red) + 0.7152 * linear(green) + 0.0722 * linear(blue) + 0.05)
    }

    #[test]
    fn every_colour_has_a_contrast_of_three_to_one_on_white() {
        // The two ends of the scale: black 21, white 1.
        assert_eq!((contrast(BLACK), contrast(WHITE)), (21.0, 1.0));
        for color in PALETTE {
            assert!(contrast(color) >= 3.0, "{color:?}: {}", contrast(color));
        }
    }

    use baliza_research::fusion::bench as fusion;
    use baliza_research::linde;

    #[test]
    fn the_curves_of_a_benchmark_are_distinct() {
        let fused = fusion::Algorithm::ALL.into_iter().flat_map(|algorithm| {
            fusion::Inputs::ALL.map(|heard| format!("{}, {}", algorithm.as_str(), heard.as_str()))
        });
        let found = linde::ROWS.into_iter().map(|(parameter, algorithm, _)| linde::name(parameter, algorithm));
        for names in [fused.collect::<Vec<_>>(), found.collect()] {
            let pens: Vec<Pen> = names.iter().map(|name| pen(name)).collect();
            for (index, pen) in pens.iter().enumerate() {
                assert!(!pens[..index].contains(pen), "{}", names[index]);
            }
        }
    }
}
