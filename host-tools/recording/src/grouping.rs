//! Rows that belong together by a name in one of their columns: those of a tag, those of a capture.

use crate::names::{Index, Texts};
use crate::{Column, Row};

/// Items by name, in the order in which the names appear.
#[derive(Debug)]
pub struct ByName<T> {
    names: Texts,
    index: Index,
    items: Vec<T>,
    /// The item of the last call: rows of one name often follow each other.
    last: usize,
}

impl<T> Default for ByName<T> {
    fn default() -> Self {
        Self { names: Texts::default(), index: Index::default(), items: Vec::new(), last: 0 }
    }
}

impl<T> ByName<T> {
    /// The item of a name; `new` makes it where the name is new.
    pub fn of(&mut self, name: &str, new: impl FnOnce() -> T) -> &mut T {
        if self.names.get(self.last) != Some(name) {
            self.last = self.index.find(&self.names, name).unwrap_or_else(|| {
                let at = self.names.push(name);
                self.index.insert(&self.names, at);
                self.items.push(new());
                at
            });
        }
        &mut self.items[self.last]
    }

    /// All items, in the order of their names' first rows.
    pub fn in_order(self) -> Vec<T> {
        self.items
    }
}

/// The tag of a row; `None` where the file has no such column, or the field is empty.
pub fn tag_of<'a>(row: &'a Row, column: Column) -> Option<&'a str> {
    Some(row.text(column)).filter(|tag| !tag.is_empty())
}
