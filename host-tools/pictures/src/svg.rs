//! A drawing as SVG text (W3C, Scalable Vector Graphics 1.1).

use std::fmt::Write as _;

use super::drawing::{Across, Colour, Down, Drawing, FINE, Font, IMAGE_OPACITY, Line, Paint, Placed, Point, Shape};

/// The document.
pub fn text(drawing: &Drawing) -> String {
    let [width, height] = drawing.size;
    let [wide, high] = drawing.size.map(|side| u64::from(FINE) * u64::from(side));
    let mut svg = format!(
        "<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {wide} {high}\" \
         xmlns=\"http://www.w3.org/2000/svg\">\n<rect x=\"0\" y=\"0\" width=\"{wide}\" height=\"{high}\" {}/>\n",
        paint(&Colour::WHITE.fill())
    );
    // Nothing fails that writes to a text.
    drawing.images.iter().for_each(|placed| svg.push_str(&image(placed)));
    drawing.shapes.iter().for_each(|shape| svg.push_str(&element(shape)));
    svg.push_str("</svg>\n");
    svg
}

fn element(shape: &Shape) -> String {
    match shape {
        Shape::Rectangle([[x0, y0], [x1, y1]], how) => {
            let (width, height) = (x1.saturating_sub(*x0), y1.saturating_sub(*y0));
            format!("<rect x=\"{x0}\" y=\"{y0}\" width=\"{width}\" height=\"{height}\" {}/>\n", paint(how))
        }
        Shape::Straight([[x1, y1], [x2, y2]], how) => {
            format!("<line {} x1=\"{x1}\" y1=\"{y1}\" x2=\"{x2}\" y2=\"{y2}\"/>\n", line(how))
        }
        Shape::Path(through, how) => {
            format!("<polyline fill=\"none\" {} points=\"{}\"/>\n", line(how), points(through))
        }
        Shape::Polygon(corners, colour) => {
            format!("<polygon {} points=\"{}\"/>\n", fill(*colour), points(corners))
        }
        Shape::Circle([x, y], radius, how) => {
            format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"{radius}\" {}/>\n", paint(how))
        }
        Shape::Text(text, at, font) => label(text, *at, font),
    }
}

fn label(text: &str, [x, y]: Point, font: &Font) -> String {
    let (across, down) = font.anchor;
    let across = match across {
        Across::Left => "start",
        Across::Middle => "middle",
        Across::Right => "end",
    };
    let turned = if font.is_upright { format!(" transform=\"rotate(270, {x}, {y})\"") } else { String::new() };
    format!(
        "<text x=\"{x}\" y=\"{y}\" dy=\"{}em\" text-anchor=\"{across}\" font-family=\"sans-serif\" \
         font-size=\"{}\" {}{turned}>\n{}\n</text>\n",
        down.baseline(),
        font.size,
        fill(font.colour),
        escaped(text)
    )
}

impl Down {
    /// How far the baseline of a text is below its point, em.
    pub fn baseline(self) -> f64 {
        match self {
            Self::Top => 0.76,
            Self::Middle => 0.25,
            Self::Bottom => -0.25,
        }
    }
}

fn points(points: &[Point]) -> String {
    points.iter().fold(String::new(), |mut text, [x, y]| {
        let _ = write!(text, "{x},{y} ");
        text
    })
}

fn paint(paint: &Paint) -> String {
    match paint {
        Paint::Fill(colour) => fill(*colour),
        Paint::Border(border) => format!("fill=\"none\" {}", line(border)),
    }
}

fn fill(Colour { rgb: [red, green, blue], opacity }: Colour) -> String {
    format!("opacity=\"{opacity}\" fill=\"#{red:02X}{green:02X}{blue:02X}\"")
}

fn line(Line { colour: Colour { rgb: [red, green, blue], opacity }, width }: &Line) -> String {
    format!("opacity=\"{opacity}\" stroke=\"#{red:02X}{green:02X}{blue:02X}\" stroke-width=\"{width}\"")
}

fn escaped(text: &str) -> String {
    text.chars().fold(String::with_capacity(text.len()), |mut safe, c| {
        match c {
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '&' => safe.push_str("&amp;"),
            '"' => safe.push_str("&quot;"),
            '\'' => safe.push_str("&apos;"),
            other => safe.push(other),
        }
        safe
    })
}

/// The image in a document of its own, which cuts it.
fn image(Placed { image, window: [[left, top], [right, bottom]], at: [x, y], size: [wide, high] }: &Placed) -> String {
    format!(
        "<svg x=\"{left}\" y=\"{top}\" width=\"{}\" height=\"{}\" overflow=\"hidden\"><image x=\"{x:.1}\" \
         y=\"{y:.1}\" width=\"{wide:.1}\" height=\"{high:.1}\" preserveAspectRatio=\"none\" \
         opacity=\"{IMAGE_OPACITY}\" href=\"{}\"/></svg>\n",
        right - left,
        bottom - top,
        image.url()
    )
}
