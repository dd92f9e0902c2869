//! Rows of several tags in one file: the column `tag`.

use std::collections::HashMap;

use crate::{Column, Row};

/// What a file has of each tag, in the order in which the tags appear.
#[derive(Debug)]
pub(crate) struct ByTag<T> {
    places: HashMap<Option<String>, usize>,
    each: Vec<T>,
}

impl<T> Default for ByTag<T> {
    fn default() -> Self {
        Self { places: HashMap::new(), each: Vec::new() }
    }
}

impl<T> ByTag<T> {
    /// What there is of a tag and its index; `new` makes it at the tag's first row.
    pub(crate) fn of(&mut self, tag: Option<&str>, new: impl FnOnce(Option<String>) -> T) -> (usize, &mut T) {
        let tag = tag.map(str::to_owned);
        let at = *self.places.entry(tag.clone()).or_insert_with(|| {
            self.each.push(new(tag));
            self.each.len() - 1
        });
        (at, &mut self.each[at])
    }

    /// All of it, in the order of the first rows.
    pub(crate) fn in_order(self) -> Vec<T> {
        self.each
    }
}

/// The tag of a row; `None` where the file has no such column, or the field is empty.
pub(crate) fn tag_of<'a>(row: &'a Row, column: Column) -> Option<&'a str> {
    Some(row.text(column)).filter(|tag| !tag.is_empty())
}
