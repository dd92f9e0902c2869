//! The file of promises, `promises.toml`: which figures the documents print, what makes them, how far they may be off,
//! and what they must reach.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use serde::Deserialize;

use super::runs::Template;
use crate::root;

/// Its path in the repository.
pub const FILE: &str = "promises.toml";
/// How far a deterministic figure may be off, percent, where its promise says nothing else: small changes of the code
/// need no new tables.
pub const TOLERANCE_PERCENT: f64 = 3.0;

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Promises {
    /// Documents by their names in this file: paths in the repository.
    pub documents: BTreeMap<String, PathBuf>,
    /// Tables.
    #[serde(rename = "table")]
    pub tables: Vec<PromisedTable>,
    /// Single figures: in a sentence, or only with a reach.
    #[serde(rename = "figure")]
    pub figures: Vec<Figure>,
    /// What cells of tables must reach.
    #[serde(rename = "reach")]
    pub reaches: Vec<Reach>,
}

/// Tables that are made together.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromisedTable {
    /// The name on the command line, and between the marks of the document where `way` does not name others.
    pub name: String,
    /// The document.
    pub document: String,
    /// What makes it.
    #[serde(default)]
    pub way: TableWay,
    /// About how long it takes, seconds.
    pub seconds: u32,
    /// Whether `--quick` includes it.
    #[serde(default)]
    pub quick: bool,
    /// What it cannot be made without.
    #[serde(default)]
    pub needs: Vec<Need>,
    /// How far the cells of a column may be off, percent, by titles. Others: [`TOLERANCE_PERCENT`].
    #[serde(default)]
    pub tolerance_percent: BTreeMap<String, f64>,
    /// Titles of columns that the machine's speed determines. `--quick` does not compare them.
    #[serde(default)]
    pub measured: BTreeSet<String>,
    /// For [`TableWay::Prints`]: the picture that the runs draw with `--plot`. It is written, and not compared.
    pub picture: Option<PathBuf>,
    /// For [`TableWay::Runs`]: the title of the first column, the others, and the rows.
    #[serde(default)]
    pub first: String,
    #[serde(default)]
    pub columns: Vec<PromisedColumn>,
    #[serde(default)]
    pub rows: Vec<Row>,
}

/// What makes a table.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum TableWay {
    /// A run of `baliza … --json` for each row.
    #[default]
    Runs,
    /// The texts that runs of `baliza` print.
    Prints(Vec<String>),
    /// Code of this program, by its name in `ways.rs`.
    Code(String),
}

/// A column of figures.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PromisedColumn {
    pub title: String,
    /// The text with keys of the result in braces, such as `{p50_m:3}`. `None`: the rows have it, in `beside`.
    pub cell: Option<Template>,
}

/// A row.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// The first cell.
    pub title: String,
    /// The arguments of `baliza`, without `--json`.
    pub run: String,
    /// The cells of the columns that are not measured: what others have, say.
    #[serde(default)]
    pub beside: Vec<String>,
}

/// A single figure.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Figure {
    /// The name on the command line.
    pub name: String,
    /// The arguments of `baliza`, without `--json`.
    pub run: String,
    /// The result, where the run has several: the values of its keys.
    #[serde(default)]
    pub result: BTreeMap<String, String>,
    /// The document, and the sentence there with keys in braces.
    pub document: Option<String>,
    pub sentence: Option<Template>,
    /// What a key must reach.
    #[serde(default)]
    pub at_least: BTreeMap<String, f64>,
    #[serde(default)]
    pub at_most: BTreeMap<String, f64>,
    /// As of a table.
    pub seconds: u32,
    #[serde(default)]
    pub quick: bool,
    #[serde(default)]
    pub needs: Vec<Need>,
    pub tolerance_percent: Option<f64>,
}

/// What the first number of a table's cell must reach.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reach {
    pub table: String,
    pub row: String,
    pub column: String,
    pub at_least: Option<f64>,
    pub at_most: Option<f64>,
}

/// What a promise cannot be made without.
#[derive(Clone, Copy, Debug, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "kebab-case")]
pub enum Need {
    /// The folder of recordings.
    Recordings,
    /// QEMU and a compiler for bare metal.
    BareMetal,
    /// npm and Chromium.
    Browser,
}

impl Promises {
    /// Reads the repository's file.
    ///
    /// # Errors
    /// The file cannot be read, or is wrong.
    pub fn read() -> Result<Self> {
        let file = root().join(FILE);
        let text = std::fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
        Self::parse(&text)
    }

    /// Parses and checks a file.
    ///
    /// # Errors
    /// It is wrong; the error has the line or the promise.
    pub fn parse(text: &str) -> Result<Self> {
        let promises: Self = toml::from_str(text).with_context(|| FILE.to_owned())?;
        promises.check()?;
        Ok(promises)
    }

    fn check(&self) -> Result<()> {
        let mut names = BTreeSet::new();
        for name in self.names() {
            ensure!(names.insert(name), "{FILE}: {name} is there twice");
        }
        for table in &self.tables {
            self.path(&table.document).with_context(|| format!("{FILE}: {}", table.name))?;
            match table.way {
                TableWay::Runs => ensure!(!table.rows.is_empty(), "{FILE}: {} has no rows", table.name),
                TableWay::Prints(_) | TableWay::Code(_) => {
                    ensure!(table.rows.is_empty(), "{FILE}: {} is made otherwise: no rows", table.name);
                }
            }
        }
        for figure in &self.figures {
            match (&figure.document, &figure.sentence) {
                (Some(document), Some(_)) => _ = self.path(document)?,
                (None, None) => {
                    let has_reach = !figure.at_least.is_empty() || !figure.at_most.is_empty();
                    ensure!(has_reach, "{FILE}: {} has neither a sentence nor a reach", figure.name);
                }
                (Some(_), None) | (None, Some(_)) => bail!("{FILE}: {}: a document needs a sentence", figure.name),
            }
        }
        for Reach { table, at_least, at_most, .. } in &self.reaches {
            ensure!(self.tables.iter().any(|of| of.name == *table), "{FILE}: a reach of {table}, which is no table");
            ensure!(at_least.is_some() || at_most.is_some(), "{FILE}: a reach of {table} without a limit");
        }
        Ok(())
    }

    /// All names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let figures = self.figures.iter().map(|figure| figure.name.as_str());
        self.tables.iter().map(|table| table.name.as_str()).chain(figures)
    }

    /// The path of a document.
    ///
    /// # Errors
    /// It is not in the list.
    pub fn path(&self, document: &str) -> Result<&PathBuf> {
        self.documents.get(document).with_context(|| format!("{document} is not in [documents]"))
    }
}

impl PromisedTable {
    /// How far a cell of this column may be off, percent.
    pub fn tolerance_percent(&self, column: &str) -> f64 {
        self.tolerance_percent.get(column).copied().unwrap_or(TOLERANCE_PERCENT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = "reach = []\nfigure = []\n[documents]\npage = \"page.md\"\n\
                         [[table]]\nname = \"a\"\ndocument = \"page\"\nseconds = 1\nfirst = \"x\"\n\
                         columns = [{ title = \"p\", cell = \"{p50_m:3}\" }]\nrows = [{ title = \"1\", run = \"simulate\" }]\n";

    #[test]
    fn mistakes_are_named() {
        assert!(Promises::parse(SMALL).is_ok());
        let wrong = |from: &str, to: &str| format!("{:#}", Promises::parse(&SMALL.replacen(from, to, 1)).unwrap_err());
        assert!(wrong("document = \"page\"", "document = \"side\"").contains("side is not in [documents]"));
        assert!(wrong("seconds = 1", "seconds = 1\nquik = true").contains("quik"));
        assert!(wrong("rows = [{ title = \"1\", run = \"simulate\" }]", "rows = []").contains("a has no rows"));
        assert!(wrong("{p50_m:3}", "{p50_m").contains("{p50_m"));
        assert!(wrong("reach = []", "reach = [{ table = \"b\", row = \"1\", column = \"p\" }]").contains("no table"));
    }
}
