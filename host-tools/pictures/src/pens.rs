//! Which pen each series of a picture gets: a colour a method, or with several tags a colour a tag.

use super::style::{Dash, Mark, PALETTE, Pen, known, pen};
use super::{Picture, Series};

const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];
const MARKS: [Mark; 3] = [Mark::Dot, Mark::Ring, Mark::Cross];

/// The tags of a picture, in the order in which they first appear.
pub fn tags(picture: &Picture) -> Vec<String> {
    let series = picture.series.iter().map(|series| series.tag.as_str());
    distinct(series.chain(picture.truth.iter().map(|way| way.tag.as_str())))
}

/// The methods of series, in the order in which they first appear.
pub fn methods(series: &[Series]) -> Vec<String> {
    distinct(series.iter().map(|series| series.method.as_str()))
}

fn distinct<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut seen = std::collections::HashSet::new();
    names.filter(|name| seen.insert(*name)).map(str::to_owned).collect()
}

/// A pen for each series.
///
/// Of one tag, a method has its own pen, or else the first of the palette that is free. Of several tags, each tag has
/// a colour, and each method a dash and a mark.
pub fn of(picture: &Picture) -> Vec<Pen> {
    let (tags, methods) = (tags(picture), methods(&picture.series));
    let place = |names: &[String], name: &str| names.iter().position(|other| other == name).unwrap_or(0);
    if tags.len() > 1 {
        let of_series = |series: &Series| {
            let (tag, method) = (place(&tags, &series.tag), place(&methods, &series.method));
            // With one method, the dash distinguishes tags after the palette's end.
            let dash = if methods.len() > 1 { method } else { tag / PALETTE.len() };
            Pen {
                color: PALETTE[tag % PALETTE.len()],
                dash: DASHES[dash % DASHES.len()],
                width: 1.6,
                mark: MARKS[method % MARKS.len()],
            }
        };
        return picture.series.iter().map(of_series).collect();
    }
    let by_method = by_method(&methods);
    let of_series = |series: &Series| by_method[place(&methods, &series.method).min(by_method.len() - 1)];
    picture.series.iter().map(of_series).collect()
}

/// A pen for each method: no two are equal while the palette has others.
fn by_method(methods: &[String]) -> Vec<Pen> {
    let mut taken: Vec<Pen> = methods.iter().filter(|method| known(method)).map(|method| pen(method)).collect();
    let free = |taken: &[Pen]| {
        let mut all = DASHES.into_iter().flat_map(|dash| PALETTE.map(|color| (color, dash)));
        let is_free = |(color, dash): &(_, _)| !taken.iter().any(|pen| (pen.color, pen.dash) == (*color, *dash));
        let (color, dash) = all.find(is_free).unwrap_or((PALETTE[0], Dash::Solid));
        Pen { color, dash, width: 1.6, mark: Mark::Dot }
    };
    let pen_of = |method: &String| {
        if known(method) {
            return pen(method);
        }
        let pen = free(&taken);
        taken.push(pen);
        pen
    };
    methods.iter().map(pen_of).collect()
}

#[cfg(test)]
mod tests {
    use super::{by_method, of};
    use crate::style::{Dash, Mark, PALETTE};
    use crate::{Picture, Series};

    #[test]
    fn methods_without_a_pen_of_their_own_get_different_ones() {
        let names = ["robust", "posterior", "engine", "3nn", "w3nn", "5nn", "w5nn", "gp", "gp-walk"].map(str::to_owned);
        let pens = by_method(&names);
        for (index, pen) in pens.iter().enumerate() {
            let other = pens[..index].iter().any(|other| (other.color, other.dash) == (pen.color, pen.dash));
            assert!(!other, "{}", names[index]);
        }
        // Robust is blue, so the next one is not.
        assert_eq!((pens[0].color, pens[1].color), (PALETTE[0], PALETTE[1]));
    }

    #[test]
    fn a_tag_has_a_colour_and_a_method_a_dash_and_a_mark() {
        let series = |tag: &str, method: &str| Series { tag: tag.into(), method: method.into(), ..Series::default() };
        let series = vec![series("7", "lls"), series("9", "lls"), series("7", "nls"), series("9", "nls")];
        let pens = of(&Picture { series, ..Picture::default() });
        assert_eq!([0, 1, 2, 3].map(|at: usize| pens[at].color), [0, 1, 0, 1].map(|tag: usize| PALETTE[tag]));
        let (first, second) = ((Dash::Solid, Mark::Dot), (Dash::Dashed, Mark::Ring));
        assert_eq!([0, 1, 2, 3].map(|at: usize| (pens[at].dash, pens[at].mark)), [first, first, second, second]);
    }
}
