//! Lines of text as outlines.

use super::coverage::{Outline, Place};
use super::drawing::{Across, Font as Look};
use super::font::{Font, Node};

/// Pieces of a parabola.
const PIECES: u32 = 5;

/// Letters with a mark behind them, and the letters with that mark: the font has no marks alone (canonical
/// compositions of Unicode among the font's characters).
const COMPOSED: [(char, &str, &str); 13] = [
    ('\u{300}', "AEIOUaeiou", "ÀÈÌÒÙàèìòù"),
    ('\u{301}', "AEIOUYaeiouyCcLlNnRrSsZzΑΕΗΙΟΥΩαεηιουω", "ÁÉÍÓÚÝáéíóúýĆćĹĺŃńŔŕŚśŹźΆΈΉΊΌΎΏάέήίόύώ"),
    ('\u{302}', "AEIOUaeiouCcGgHhJjSsWwYy", "ÂÊÎÔÛâêîôûĈĉĜĝĤĥĴĵŜŝŴŵŶŷ"),
    ('\u{303}', "ANOanoIiUu", "ÃÑÕãñõĨĩŨũ"),
    ('\u{304}', "AaEeIiOoUu", "ĀāĒēĪīŌōŪū"),
    ('\u{306}', "AaEeGgIiOoUu", "ĂăĔĕĞğĬĭŎŏŬŭ"),
    ('\u{307}', "CcEeGgIZz", "ĊċĖėĠġİŻż"),
    ('\u{308}', "AEIOUaeiouyYΙΥιυ", "ÄËÏÖÜäëïöüÿŸΪΫϊϋ"),
    ('\u{30a}', "AaUu", "ÅåŮů"),
    ('\u{30b}', "OoUu", "ŐőŰű"),
    ('\u{30c}', "CcDdEeLlNnRrSsTtZz", "ČčĎďĚěĽľŇňŘřŠšŤťŽž"),
    ('\u{327}', "CcGgKkLlNnRrSsTt", "ÇçĢģĶķĻļŅņŖŗŞşŢţ"),
    ('\u{328}', "AaEeIiUu", "ĄąĘęĮįŲų"),
];

/// The characters to be drawn: as in SVG, spaces at the ends are left out and others become one; a letter and its mark
/// become one character, and what has no shape is left out.
fn drawn(text: &str) -> Vec<char> {
    let mut drawn: Vec<char> = Vec::new();
    for character in text.trim_matches([' ', '\n', '\t']).chars() {
        let last = drawn.last().copied();
        match character {
            ' ' | '\n' | '\t' if last == Some(' ') => {}
            ' ' | '\n' | '\t' => drawn.push(' '),
            '\u{ad}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{2064}' | '\u{feff}' => {}
            '\u{fe00}'..='\u{fe0f}' => {}
            mark => match last.and_then(|letter| composed(letter, mark)) {
                Some(both) => {
                    drawn.pop();
                    drawn.push(both);
                }
                None => drawn.push(mark),
            },
        }
    }
    drawn
}

fn composed(letter: char, mark: char) -> Option<char> {
    let (_, letters, both) = COMPOSED.iter().find(|(of, ..)| *of == mark)?;
    letters.chars().position(|other| other == letter).and_then(|at| both.chars().nth(at))
}

/// The outlines of a text at a place, with this many pixels a unit of the drawing.
pub fn outline(font: &Font, text: &str, [x, y]: Place, look: &Look, scale: f64) -> Outline {
    let em = f64::from(look.size) * scale;
    let a_unit = em / font.em();
    let mut glyphs = Vec::new();
    let (mut pen, mut before) = (0.0, None);
    for glyph in drawn(text).into_iter().map(|character| font.glyph(character)) {
        pen += before.map_or(0.0, |before| font.kerning(before, glyph));
        glyphs.push((glyph, pen));
        pen += font.width(glyph);
        before = Some(glyph);
    }
    let (across, down) = look.anchor;
    let left = match across {
        Across::Left => 0.0,
        Across::Middle => -0.5 * pen,
        Across::Right => -pen,
    };
    let below = em * down.baseline();
    let place = |[right, up]: Place, pen: f64| {
        let [right, down] = [a_unit * (left + pen + right), below - a_unit * up];
        if look.is_upright { [x + down, y - right] } else { [x + right, y + down] }
    };
    let mut outline = Outline::default();
    for (glyph, pen) in glyphs {
        for contour in font.contours(glyph) {
            outline.add(flattened(&contour).into_iter().map(|at| place(at, pen)));
        }
    }
    outline
}

/// A closed outline of straight pieces and parabolas as corners. Between two control points the outline goes through
/// their middle.
fn flattened(nodes: &[Node]) -> Vec<Place> {
    let middle = |one: Place, other: Place| std::array::from_fn(|axis| 0.5 * (one[axis] + other[axis]));
    let (Some(first), Some(last)) = (nodes.first(), nodes.last()) else { return Vec::new() };
    let mut at = match (first.is_on, last.is_on) {
        (true, _) => first.at,
        (false, true) => last.at,
        (false, false) => middle(first.at, last.at),
    };
    let start = at;
    let mut corners = vec![at];
    let mut control: Option<Place> = None;
    let mut to = |at: &mut Place, control: Option<Place>, end: Place| {
        match control {
            None => corners.push(end),
            Some(control) => corners.extend((1..=PIECES).map(|piece| {
                let share = f64::from(piece) / f64::from(PIECES);
                let rest = 1.0 - share;
                std::array::from_fn(|axis| {
                    rest * rest * at[axis] + 2.0 * rest * share * control[axis] + share * share * end[axis]
                })
            })),
        }
        *at = end;
    };
    for node in nodes {
        match (node.is_on, control) {
            (true, before) => {
                to(&mut at, before, node.at);
                control = None;
            }
            (false, None) => control = Some(node.at),
            (false, Some(before)) => {
                to(&mut at, Some(before), middle(before, node.at));
                control = Some(node.at);
            }
        }
    }
    to(&mut at, control, start);
    corners
}

#[cfg(test)]
mod tests {
    use super::super::coverage::Coverage;
    use super::super::drawing::{Down, FINE};
    use super::{Across, COMPOSED, Font, Look, drawn, outline};
    use crate::style::text;

    /// Of a text at column 100 and row 50, with 20 pixels an em: the first and the last column and row with ink.
    fn ink(line: &str, look: Look) -> [usize; 4] {
        let look = Look { size: 20 * FINE, ..look };
        let outline = outline(&Font::bundled().expect("a font"), line, [100.0, 50.0], &look, 1.0 / f64::from(FINE));
        let mut found = [usize::MAX, usize::MAX, 0, 0];
        Coverage::new([200, 100]).of(&outline, |column, row, share| {
            if share > 0.05 {
                let [x0, y0, x1, y1] = found;
                found = [x0.min(column), y0.min(row), x1.max(column), y1.max(row)];
            }
        });
        found
    }

    #[test]
    fn text_is_where_its_anchor_says() {
        // An A is from 16 to 1384 of 1401 units across, and 1493 high; an em has 2048 units, and here 20 pixels: from
        // 0.16 to 13.52 across, of 13.68, and 14.58 up from the baseline, which is 0.25 em below the middle, at row 55.
        assert_eq!(ink("A", text(Across::Left, Down::Middle)), [100, 40, 113, 54]);
        assert_eq!(ink("A", text(Across::Middle, Down::Middle)), [93, 40, 106, 54]);
        assert_eq!(ink("A", text(Across::Right, Down::Middle)), [86, 40, 99, 54]);
        // Baselines at rows 65.2 and 45.
        assert_eq!(ink("A", text(Across::Left, Down::Top)), [100, 50, 113, 65]);
        assert_eq!(ink("A", text(Across::Left, Down::Bottom)), [100, 30, 113, 44]);
        // Upwards, from row 50: across is up, and down is to the right.
        let upright = Look { is_upright: true, ..text(Across::Left, Down::Middle) };
        assert_eq!(ink("A", upright), [90, 36, 104, 49]);
        // V begins 131 units before the end of A (kerning): 13.68 - 1.28 + 0.16 = 12.56, and its 1384 units end at
        // 25.92.
        assert_eq!(ink("AV", text(Across::Left, Down::Middle))[2], 125);
    }

    #[test]
    fn spaces_and_marks_are_as_in_svg() {
        let text = |line: &str| drawn(line).into_iter().collect::<String>();
        assert_eq!(text("  a \t\n b  "), "a b");
        assert_eq!(text("cafe\u{301} n\u{303} α\u{301} c\u{327}"), "café ñ ά ç");
        // A mark that no letter has stays; what has no shape is left out.
        assert_eq!(text("x\u{301}\u{200b}\u{feff}"), "x\u{301}");
        let font = Font::bundled().expect("a font");
        for (mark, letters, both) in COMPOSED {
            assert_eq!(letters.chars().count(), both.chars().count(), "{mark:?}");
            assert!(both.chars().all(|letter| font.glyph(letter) != 0), "{both}");
        }
    }
}
