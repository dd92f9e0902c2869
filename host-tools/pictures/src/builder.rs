//! Makes a picture of positions that come one at a time, of any method and tag.

use std::collections::HashMap;

use super::{Dot, Picture, Series, Way};

/// A key that sorts tags: numbers as numbers, before names.
fn in_order(tag: &str) -> (u64, String) {
    (tag.parse().unwrap_or(u64::MAX), tag.to_owned())
}

/// A picture in the making.
#[derive(Debug, Default)]
pub struct PictureBuilder {
    picture: Picture,
    /// The index of each series, by method and tag.
    series: HashMap<String, HashMap<String, usize>>,
    /// The index of each tag's truth.
    ways: HashMap<String, usize>,
}

impl PictureBuilder {
    /// Begins with a picture that has neither positions nor truth.
    pub fn new(picture: Picture) -> Self {
        Self { picture, ..Self::default() }
    }

    /// Adds a result of a method for a tag, in the order of time: the position, `None` where there was none, and its
    /// distance from the truth, metres. The tag's name is empty where there is only one tag.
    pub fn position(&mut self, method: &str, tag: &str, dot: Option<Dot>, error_m: Option<f64>) {
        let known = self.series.get(method).and_then(|tags| tags.get(tag)).copied();
        let at = known.unwrap_or_else(|| {
            let at = self.picture.series.len();
            self.series.entry(method.to_owned()).or_default().insert(tag.to_owned(), at);
            self.picture.series.push(Series { method: method.to_owned(), tag: tag.to_owned(), ..Series::default() });
            at
        });
        if let Some(series) = self.picture.series.get_mut(at) {
            series.dots.extend(dot);
            series.errors_m.extend(error_m);
        }
    }

    /// Adds a true position of a tag, in the order of time, metres. `is_dwell`: the tag dwelt there, and was not
    /// followed on its way.
    pub fn truth(&mut self, tag: &str, at_m: [f64; 2], is_dwell: bool) {
        let at = self.ways.get(tag).copied().unwrap_or_else(|| {
            let at = self.picture.truth.len();
            self.ways.insert(tag.to_owned(), at);
            self.picture.truth.push(Way { tag: tag.to_owned(), are_dwells: is_dwell, ..Way::default() });
            at
        });
        if let Some(way) = self.picture.truth.get_mut(at) {
            way.points_m.push(at_m);
        }
    }

    /// Adds the time of a position, seconds: the legend has the first and the last one.
    pub fn time(&mut self, t_s: f64) {
        let [first, last] = self.picture.times_s.unwrap_or([t_s; 2]);
        self.picture.times_s = Some([first.min(t_s), last.max(t_s)]);
    }

    /// The picture, with its tags in their order: that of numbers, or else the alphabet's. A result without any
    /// position is a series all the same.
    pub fn finish(mut self) -> Picture {
        let methods = super::pens::methods(&self.picture.series);
        let place = |method: &str| methods.iter().position(|other| other == method);
        self.picture.series.sort_by_cached_key(|series| (place(&series.method), in_order(&series.tag)));
        self.picture.truth.sort_by_cached_key(|way| in_order(&way.tag));
        self.picture
    }
}
