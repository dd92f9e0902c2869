//! Rows that belong together by a name in one of their columns: those of a tag, those of an epoch.

use std::collections::HashMap;

use crate::{Column, Row};

/// Items by name, in the order in which the names appear.
#[derive(Debug)]
pub(crate) struct ByName<T> {
    places: HashMap<String, usize>,
    items: Vec<T>,
}

impl<T> Default for ByName<T> {
    fn default() -> Self {
        Self { places: HashMap::new(), items: Vec::new() }
    }
}

impl<T> ByName<T> {
    /// The item of a name; `new` makes it where the name is new.
    pub(crate) fn of(&mut self, name: &str, new: impl FnOnce() -> T) -> &mut T {
        let at = match self.places.get(name) {
            Some(&at) => at,
            None => {
                self.places.insert(name.to_owned(), self.items.len());
                self.items.push(new());
                self.items.len() - 1
            }
        };
        &mut self.items[at]
    }

    /// All items, in the order of their names' first rows.
    pub(crate) fn in_order(self) -> Vec<T> {
        self.items
    }
}

/// The tag of a row; `None` where the file has no such column, or the field is empty.
pub(crate) fn tag_of<'a>(row: &'a Row, column: Column) -> Option<&'a str> {
    Some(row.text(column)).filter(|tag| !tag.is_empty())
}
