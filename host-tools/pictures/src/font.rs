//! The font of text in PNG, which is part of the program: pictures are the same on machines without fonts.
//!
//! It is DejaVu Sans with Latin, Greek and a few symbols (`assets/README.md`). Of TrueType and OpenType this reads what
//! that file has: characters in segments (`cmap` format 4), outlines (`glyf`), widths (`hmtx`), and kerning by classes
//! (`GPOS` pair adjustment, format 2). Sources: Microsoft, OpenType specification 1.9.

const FILE: &[u8] = include_bytes!("../assets/DejaVuSans.ttf");
/// Components within components of a glyph, at most.
const DEEPEST: u8 = 4;

/// A point of an outline, in units of the font, y up, and whether the outline goes through it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// The place.
    pub at: [f64; 2],
    /// Otherwise it is the control point of a parabola.
    pub is_on: bool,
}

/// Closed outlines.
pub type Contours = Vec<Vec<Node>>;

/// The number of a glyph.
pub type Glyph = u16;

/// The font.
#[derive(Clone, Copy, Debug)]
pub struct Font {
    bytes: &'static [u8],
    cmap: usize,
    glyf: usize,
    loca: usize,
    hmtx: usize,
    /// The subtable of pair adjustment.
    kern: usize,
    has_long_offsets: bool,
    /// Glyphs behind have the width of the last one.
    widths: u16,
    /// Units of an em.
    em: u16,
}

/// The bits of a component of a glyph.
mod component {
    pub const HAS_WORDS: u16 = 0x0001;
    pub const IS_OFFSET: u16 = 0x0002;
    pub const HAS_SCALE: u16 = 0x0008;
    pub const HAS_MORE: u16 = 0x0020;
    pub const HAS_TWO_SCALES: u16 = 0x0040;
    pub const HAS_MATRIX: u16 = 0x0080;
}

/// The bits of a point of a glyph.
mod point {
    pub const IS_ON: u8 = 0x01;
    pub const X_IS_SHORT: u8 = 0x02;
    pub const Y_IS_SHORT: u8 = 0x04;
    pub const IS_REPEATED: u8 = 0x08;
    pub const X_IS_SAME_OR_POSITIVE: u8 = 0x10;
    pub const Y_IS_SAME_OR_POSITIVE: u8 = 0x20;
}

impl Font {
    /// The font of this program.
    pub fn bundled() -> Option<Self> {
        Self::of(FILE)
    }

    fn of(bytes: &'static [u8]) -> Option<Self> {
        let table = |tag: &[u8; 4]| {
            let count = usize::from(u16_at(bytes, 4)?);
            let entry = (0..count).map(|index| 12 + 16 * index).find(|at| bytes.get(*at..at + 4) == Some(tag))?;
            u32_at(bytes, entry + 8)
        };
        let (head, cmap, gpos) = (table(b"head")?, table(b"cmap")?, table(b"GPOS")?);
        let count = usize::from(u16_at(bytes, cmap + 2)?);
        let of_unicode = (0..count).filter_map(|index| u32_at(bytes, cmap + 4 + 8 * index + 4));
        let segments = of_unicode.map(|offset| cmap + offset).find(|at| u16_at(bytes, *at) == Some(4))?;
        // The font has one lookup, with one subtable.
        let lookups = gpos + usize::from(u16_at(bytes, gpos + 8)?);
        let lookup = lookups + usize::from(u16_at(bytes, lookups + 2)?);
        Some(Self {
            bytes,
            cmap: segments,
            glyf: table(b"glyf")?,
            loca: table(b"loca")?,
            hmtx: table(b"hmtx")?,
            kern: lookup + usize::from(u16_at(bytes, lookup + 6)?),
            has_long_offsets: u16_at(bytes, head + 50)? == 1,
            widths: u16_at(bytes, table(b"hhea")? + 34)?,
            em: u16_at(bytes, head + 18)?,
        })
    }

    /// Units of an em.
    pub fn em(&self) -> f64 {
        f64::from(self.em.max(1))
    }

    fn u16(&self, at: usize) -> Option<u16> {
        u16_at(self.bytes, at)
    }

    fn i16(&self, at: usize) -> Option<i16> {
        self.u16(at).map(u16::cast_signed)
    }

    /// The glyph of a character; the first one, a box, where the font has none.
    pub fn glyph(&self, character: char) -> Glyph {
        u16::try_from(u32::from(character)).ok().and_then(|code| self.mapped(code)).unwrap_or(0)
    }

    fn mapped(&self, code: u16) -> Option<Glyph> {
        let length = usize::from(self.u16(self.cmap + 6)?);
        let [ends, starts, deltas, offsets] = [14, 16 + length, 16 + 2 * length, 16 + 3 * length];
        let mut segments = (0..length).step_by(2);
        let segment = segments.find(|at| self.u16(self.cmap + ends + at).is_some_and(|end| code <= end))?;
        let start = self.u16(self.cmap + starts + segment).filter(|start| *start <= code)?;
        let delta = self.u16(self.cmap + deltas + segment)?;
        let place = self.cmap + offsets + segment;
        match self.u16(place)? {
            0 => Some(code.wrapping_add(delta)),
            offset => {
                let glyph = self.u16(place + usize::from(offset) + 2 * usize::from(code - start))?;
                Some(if glyph == 0 { 0 } else { glyph.wrapping_add(delta) })
            }
        }
    }

    /// The width of a glyph, units.
    pub fn width(&self, glyph: Glyph) -> f64 {
        let at = self.hmtx + 4 * usize::from(glyph.min(self.widths.saturating_sub(1)));
        f64::from(self.u16(at).unwrap_or(0))
    }

    /// How much more, or less, there is between two glyphs than their widths, units.
    pub fn kerning(&self, first: Glyph, second: Glyph) -> f64 {
        f64::from(self.adjustment(first, second).unwrap_or(0))
    }

    fn adjustment(&self, first: Glyph, second: Glyph) -> Option<i16> {
        let offset = |at: usize| Some(self.kern + usize::from(self.u16(self.kern + at)?));
        // Values have a width alone.
        if [self.u16(self.kern)?, self.u16(self.kern + 4)?, self.u16(self.kern + 6)?] != [2, 4, 0] {
            return None;
        }
        self.listed(offset(2)?, first)?;
        let (row, column) = (self.class(offset(8)?, first), self.class(offset(10)?, second));
        let columns = usize::from(self.u16(self.kern + 14)?);
        self.i16(self.kern + 16 + 2 * (usize::from(row) * columns + usize::from(column)))
    }

    /// Whether a coverage table has a glyph.
    fn listed(&self, table: usize, glyph: Glyph) -> Option<()> {
        let count = usize::from(self.u16(table + 2)?);
        let found = match self.u16(table)? {
            1 => (0..count).any(|index| self.u16(table + 4 + 2 * index) == Some(glyph)),
            _ => self.range(table + 4, count, glyph).is_some(),
        };
        found.then_some(())
    }

    /// The class of a glyph in a table of classes; 0 where it is in none.
    fn class(&self, table: usize, glyph: Glyph) -> u16 {
        let class = match self.u16(table) {
            Some(1) => self.u16(table + 2).zip(self.u16(table + 4)).and_then(|(first, count)| {
                let index = glyph.checked_sub(first).filter(|index| *index < count)?;
                self.u16(table + 6 + 2 * usize::from(index))
            }),
            Some(_) => self.u16(table + 2).and_then(|count| self.range(table + 4, usize::from(count), glyph)),
            None => None,
        };
        class.unwrap_or(0)
    }

    /// The value of the range that has a glyph: ranges have a first glyph, a last glyph and a value.
    fn range(&self, at: usize, count: usize, glyph: Glyph) -> Option<u16> {
        let mut ranges = (0..count).map(|index| at + 6 * index);
        let found = ranges.find(|range| self.u16(range + 2).is_some_and(|last| glyph <= last))?;
        self.u16(found).filter(|first| *first <= glyph)?;
        self.u16(found + 4)
    }

    /// The outlines of a glyph.
    pub fn contours(&self, glyph: Glyph) -> Contours {
        if glyph == 0 { self.missing() } else { self.outline(glyph, DEEPEST).unwrap_or_default() }
    }

    /// The frame in place of a character that the font has not; the font's own glyph for that is empty.
    fn missing(&self) -> Contours {
        let (width, em) = (self.width(0), self.em());
        let rectangle = |inset: f64| {
            let (left, right, low, high) = (0.06 * em + inset, width - 0.06 * em - inset, inset, 0.73 * em - inset);
            [[left, low], [left, high], [right, high], [right, low]].map(|at| Node { at, is_on: true }).to_vec()
        };
        let mut hole = rectangle(0.06 * em);
        hole.reverse();
        vec![rectangle(0.0), hole]
    }

    fn outline(&self, glyph: Glyph, deepest: u8) -> Option<Contours> {
        let index = usize::from(glyph);
        let offset = |index: usize| {
            if self.has_long_offsets {
                u32_at(self.bytes, self.loca + 4 * index)
            } else {
                self.u16(self.loca + 2 * index).map(|half| 2 * usize::from(half))
            }
        };
        let (start, end) = (offset(index)?, offset(index + 1)?);
        if start == end {
            return Some(Contours::new());
        }
        let at = self.glyf + start;
        match self.i16(at)? {
            count if count >= 0 => self.simple(at + 10, count as usize),
            _ => self.composite(at + 10, deepest.checked_sub(1)?),
        }
    }

    /// A glyph of outlines: their last points, then the points' bits, their x and their y.
    fn simple(&self, at: usize, count: usize) -> Option<Contours> {
        let ends: Vec<usize> =
            (0..count).map(|index| self.u16(at + 2 * index).map(usize::from)).collect::<Option<_>>()?;
        let points = ends.last().map_or(0, |last| last + 1);
        let instructions = usize::from(self.u16(at + 2 * count)?);
        let mut cursor = at + 2 * count + 2 + instructions;
        let mut bits = Vec::with_capacity(points);
        while bits.len() < points {
            let found = *self.bytes.get(cursor)?;
            cursor += 1;
            let mut repeats = 1;
            if found & point::IS_REPEATED != 0 {
                repeats += usize::from(*self.bytes.get(cursor)?);
                cursor += 1;
            }
            bits.extend(std::iter::repeat_n(found, repeats.min(points - bits.len())));
        }
        let xs = self.coordinates(&bits, &mut cursor, point::X_IS_SHORT, point::X_IS_SAME_OR_POSITIVE)?;
        let ys = self.coordinates(&bits, &mut cursor, point::Y_IS_SHORT, point::Y_IS_SAME_OR_POSITIVE)?;
        let nodes = xs.into_iter().zip(ys).zip(&bits);
        let nodes: Vec<Node> =
            nodes.map(|((x, y), bits)| Node { at: [x, y], is_on: bits & point::IS_ON != 0 }).collect();
        let starts = std::iter::once(0).chain(ends.iter().map(|end| end + 1));
        starts.zip(&ends).map(|(start, end)| nodes.get(start..=*end).map(<[Node]>::to_vec)).collect()
    }

    /// The x or the y of points: each is a difference from the one before.
    fn coordinates(&self, bits: &[u8], cursor: &mut usize, short: u8, same: u8) -> Option<Vec<f64>> {
        let mut value = 0.0;
        let of_point = |bits: &u8| {
            if bits & short != 0 {
                let size = f64::from(*self.bytes.get(*cursor)?);
                *cursor += 1;
                value += if bits & same != 0 { size } else { -size };
            } else if bits & same == 0 {
                value += f64::from(self.i16(*cursor)?);
                *cursor += 2;
            }
            Some(value)
        };
        bits.iter().map(of_point).collect()
    }

    /// A glyph of other glyphs, as a letter and its accent.
    fn composite(&self, mut at: usize, deepest: u8) -> Option<Contours> {
        let mut contours = Contours::new();
        loop {
            let (bits, glyph) = (self.u16(at)?, self.u16(at + 2)?);
            at += 4;
            let has_offset = bits & component::IS_OFFSET != 0;
            let [dx, dy] = if bits & component::HAS_WORDS != 0 {
                at += 4;
                [self.i16(at - 4)?, self.i16(at - 2)?]
            } else {
                at += 2;
                [*self.bytes.get(at - 2)?, *self.bytes.get(at - 1)?].map(|byte| i16::from(byte.cast_signed()))
            };
            // Numbers of matrices have 14 bits behind the point.
            let fraction = |at: usize| self.i16(at).map(|number| f64::from(number) / 16384.0);
            let (length, [xx, xy, yx, yy]) = if bits & component::HAS_SCALE != 0 {
                (2, [fraction(at)?, 0.0, 0.0, fraction(at)?])
            } else if bits & component::HAS_TWO_SCALES != 0 {
                (4, [fraction(at)?, 0.0, 0.0, fraction(at + 2)?])
            } else if bits & component::HAS_MATRIX != 0 {
                (8, [fraction(at)?, fraction(at + 2)?, fraction(at + 4)?, fraction(at + 6)?])
            } else {
                (0, [1.0, 0.0, 0.0, 1.0])
            };
            at += length;
            let [dx, dy] = if has_offset { [dx, dy].map(f64::from) } else { [0.0; 2] };
            let moved =
                |Node { at: [x, y], is_on }: Node| Node { at: [xx * x + yx * y + dx, xy * x + yy * y + dy], is_on };
            let part = self.outline(glyph, deepest)?;
            contours.extend(part.into_iter().map(|contour| contour.into_iter().map(moved).collect()));
            if bits & component::HAS_MORE == 0 {
                return Some(contours);
            }
        }
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().copied().map(u16::from_be_bytes)
}

fn u32_at(bytes: &[u8], at: usize) -> Option<usize> {
    bytes.get(at..)?.first_chunk().copied().map(u32::from_be_bytes).and_then(|value| value.try_into().ok())
}

#[cfg(test)]
mod tests {
    use super::{FILE, Font};

    /// The least and the greatest x and y of a character's outlines.
    fn bounds(character: char) -> [f64; 4] {
        let font = Font::bundled().expect("a font");
        let contours = font.contours(font.glyph(character));
        contours.iter().flatten().fold([1e9, 1e9, -1e9, -1e9], |[x0, y0, x1, y1], node| {
            let [x, y] = node.at;
            [x0.min(x), y0.min(y), x1.max(x), y1.max(y)]
        })
    }

    #[test]
    fn outlines_widths_and_kerning_are_those_of_the_font() {
        let font = Font::bundled().expect("a font");
        // From the tables of the file, read by another program: `hmtx`, the boxes in `glyf`, and `GPOS`.
        assert_eq!(['A', 'é', ' ', '1'].map(|c| font.width(font.glyph(c))), [1401.0, 1260.0, 651.0, 1303.0]);
        assert_eq!(bounds('A'), [16.0, 0.0, 1384.0, 1493.0]);
        assert_eq!(bounds('é'), [113.0, -29.0, 1151.0, 1638.0]);
        assert_eq!(bounds('Ő'), [115.0, -29.0, 1497.0, 1899.0]);
        let pair = |first: char, second: char| font.kerning(font.glyph(first), font.glyph(second));
        assert_eq!([pair('A', 'V'), pair('T', 'o'), pair('P', '.'), pair('1', '1')], [-131.0, -348.0, -319.0, 0.0]);
        // What the font has not is a box.
        assert_eq!(['日', '🙂', '\u{fffd}'].map(|c| font.glyph(c)), [0; 3]);
        assert_eq!(font.contours(0).len(), 2);
    }

    #[test]
    fn every_glyph_can_be_read_and_a_damaged_font_is_no_panic() {
        let font = Font::bundled().expect("a font");
        // 539 glyphs (`maxp`), of which 3 begin where the next one does (`loca`).
        let empty = (0..539).filter(|glyph| font.outline(*glyph, super::DEEPEST).expect("an outline").is_empty());
        assert_eq!(empty.count(), 3);
        for length in (0..FILE.len()).step_by(1999) {
            let Some(font) = Font::of(&FILE[..length]) else { continue };
            for glyph in 0..600 {
                font.contours(glyph);
                font.kerning(glyph, glyph / 2);
            }
        }
        // One byte of a hundred is another one.
        for seed in 0..4_u32 {
            let other = |(at, byte): (usize, &u8)| {
                let hash = (at as u32 ^ seed.wrapping_mul(0x9e37_79b9)).wrapping_mul(0x85eb_ca6b);
                if hash >> 16 < 655 && at > 300 { hash as u8 } else { *byte }
            };
            let bytes: Vec<u8> = FILE.iter().enumerate().map(other).collect();
            let Some(font) = Font::of(bytes.leak()) else { continue };
            (0..600).for_each(|glyph| drop(font.contours(glyph)));
        }
    }
}
