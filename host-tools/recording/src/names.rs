//! Names of rows in little memory: a recording may have millions of epochs.

use std::hash::{BuildHasher, RandomState};

use hashbrown::HashTable;

/// Texts one behind the other, each with a number.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Texts {
    all: String,
    /// The end of each text, bytes.
    ends: Vec<usize>,
}

impl Texts {
    /// Adds a text, and returns its number.
    pub(crate) fn push(&mut self, text: &str) -> usize {
        self.all.push_str(text);
        self.ends.push(self.all.len());
        self.ends.len() - 1
    }

    /// The text of a number.
    pub(crate) fn get(&self, at: usize) -> Option<&str> {
        let begin = at.checked_sub(1).map_or(Some(0), |before| self.ends.get(before).copied())?;
        self.all.get(begin..*self.ends.get(at)?)
    }

    pub(crate) fn len(&self) -> usize {
        self.ends.len()
    }
}

/// Finds the numbers of texts.
#[derive(Clone, Debug, Default)]
pub(crate) struct Index {
    numbers: HashTable<usize>,
    hasher: RandomState,
}

impl Index {
    /// The number of a text.
    pub(crate) fn find(&self, texts: &Texts, text: &str) -> Option<usize> {
        self.numbers.find(self.hasher.hash_one(text), |at| texts.get(*at) == Some(text)).copied()
    }

    /// Makes the text of a number known, which must be new.
    pub(crate) fn insert(&mut self, texts: &Texts, at: usize) {
        let hash = |at: &usize| self.hasher.hash_one(texts.get(*at).unwrap_or(""));
        self.numbers.insert_unique(hash(&at), at, hash);
    }
}

#[cfg(test)]
mod tests {
    use super::{Index, Texts};

    #[test]
    fn texts_are_found_by_their_content_and_one_may_be_empty() {
        let (mut texts, mut index) = (Texts::default(), Index::default());
        for text in ["b", "", "bb", "a"] {
            assert_eq!(index.find(&texts, text), None);
            let at = texts.push(text);
            index.insert(&texts, at);
        }
        assert_eq!(
            ["b", "", "bb", "a", "ab"].map(|text| index.find(&texts, text)),
            [Some(0), Some(1), Some(2), Some(3), None]
        );
        assert_eq!([0, 1, 2, 3, 4].map(|at| texts.get(at)), [Some("b"), Some(""), Some("bb"), Some("a"), None]);
    }
}
