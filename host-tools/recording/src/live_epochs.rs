//! Ranges that arrive in a pipe: each epoch is complete as soon as the next one of its tag begins.

use std::collections::VecDeque;
use std::path::Path;

use crate::epochs::{Epochs, Gathering};
use crate::grouping::tag_of;
use crate::recording::{AGE, RangeColumns};
use crate::{Anchor, Column, Table, UserError};

/// This number of a tag's epochs that have ended are remembered: a row of one of them is an error.
const REMEMBERED: usize = 64;

/// The epochs of all tags in a pipe, one after another.
pub struct LiveEpochs<'a> {
    table: Table,
    epoch: Column,
    time: Column,
    age: Column,
    tag: Column,
    range: RangeColumns<'a>,
    /// The epoch of each tag that has not ended.
    open: Vec<OpenEpoch>,
}

/// The current epoch of a tag.
#[derive(Default)]
struct OpenEpoch {
    tag: Option<String>,
    name: String,
    rows: Gathering,
    ended: VecDeque<String>,
}

impl OpenEpoch {
    /// Ends the epoch, and begins another one.
    fn end(&mut self, next: &str) -> (Option<String>, Epochs) {
        if self.ended.len() == REMEMBERED {
            self.ended.pop_front();
        }
        self.ended.push_back(std::mem::replace(&mut self.name, next.to_owned()));
        (self.tag.clone(), std::mem::take(&mut self.rows).finish())
    }
}

impl<'a> LiveEpochs<'a> {
    /// Opens the table, and waits for its header.
    ///
    /// # Errors
    /// The header is wrong.
    pub fn open(file: &Path, anchors: &'a [Anchor]) -> Result<Self, UserError> {
        let table = Table::open(file)?;
        let [time, age, tag] = ["t_s", AGE, "tag"].map(|name| table.optional(name));
        let (epoch, range) = (table.column("epoch")?, RangeColumns::of(&table, anchors)?);
        Ok(Self { table, epoch, time, age, tag, range, open: Vec::new() })
    }

    /// Whether the table has several tags, or one with a name.
    pub fn has_tags(&self) -> bool {
        self.tag.is_present()
    }

    /// The next epoch that has ended, with the name of its tag. It waits for the rows. `None` at the end.
    ///
    /// # Errors
    /// The first line that is wrong, or that belongs to an epoch that has ended.
    pub fn next_epoch(&mut self) -> Result<Option<(Option<String>, Epochs)>, UserError> {
        let Self { table, epoch, time, age, tag, range, open } = self;
        while let Some(row) = table.next_row()? {
            let (name, t_s, tag) = (row.some_text(*epoch)?, row.number(*time)?, tag_of(&row, *tag));
            let age_s = row.number(*age)?;
            let measured = range.read(&row, t_s)?;
            let at = open.iter().position(|of| of.tag.as_deref() == tag).unwrap_or_else(|| {
                open.push(OpenEpoch { tag: tag.map(str::to_owned), name: name.to_owned(), ..OpenEpoch::default() });
                open.len() - 1
            });
            let Some(of) = open.get_mut(at) else { continue };
            if of.ended.iter().any(|ended| ended == name) {
                return Err(row.wrong(
                    *epoch,
                    &format!("{name:?} has ended: in a pipe the rows of an epoch follow each other; sort them, or give a file"),
                ));
            }
            let ended = (of.name != name).then(|| of.end(name));
            of.rows.begin_row(name, t_s, age_s);
            measured.iter().for_each(|measured| of.rows.push_range(measured));
            if ended.is_some() {
                return Ok(ended);
            }
        }
        Ok(if open.is_empty() { None } else { Some(open.remove(0).end("")) })
    }
}
