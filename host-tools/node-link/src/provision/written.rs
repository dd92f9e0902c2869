//! Which nodes of a site are written already: a small CSV file beside the site's, so that work goes on after an
//! interruption, and begins again for a node whose settings or image change.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::one_by_one::Job;
use recording::UserError;
use recording::output;

const HEADER: [&str; 3] = ["node", "board", "sum"];

/// The file, and what it says.
#[derive(Debug)]
pub struct Written {
    file: PathBuf,
    rows: BTreeMap<String, (String, String)>,
}

impl Written {
    /// The file of a site's file, `site.written` for `site.toml`; none is written yet where it does not exist.
    ///
    /// # Errors
    /// The file cannot be read, or is another one.
    pub fn beside(site: &Path) -> Result<Self, UserError> {
        let file = site.with_extension("written");
        let mut rows = BTreeMap::new();
        if file.exists() {
            let wrong = |line| UserError::line(&file, line, "not node,board,sum: delete the file to begin again");
            let mut reader = csv::Reader::from_path(&file).map_err(|_| wrong(1))?;
            if !reader.headers().is_ok_and(|header| header.iter().eq(HEADER)) {
                return Err(wrong(1));
            }
            for (line, record) in (2..).zip(reader.deserialize()) {
                let (node, board, sum) = record.map_err(|_| wrong(line))?;
                rows.insert(node, (board, sum));
            }
        }
        Ok(Self { file, rows })
    }

    /// Whether exactly this was written.
    pub fn has(&self, job: &Job<'_>) -> bool {
        self.rows.get(job.name).is_some_and(|(board, sum)| board == job.board.name() && *sum == text(job.sum))
    }

    /// Notes that this is written.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn note(&mut self, job: &Job<'_>) -> Result<()> {
        self.rows.insert(job.name.to_owned(), (job.board.name().to_owned(), text(job.sum)));
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(HEADER)?;
        for (node, (board, sum)) in &self.rows {
            writer.write_record([node, board, sum])?;
        }
        let bytes = writer.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))?;
        output::write_file(&self.file, &bytes).with_context(|| format!("cannot write {}", self.file.display()))
    }
}

fn text(sum: u32) -> String {
    format!("{sum:08x}")
}
