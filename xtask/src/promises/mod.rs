//! `cargo xtask promises`: remakes the figures that documents print, or checks that they still hold.
//!
//! `promises.toml` lists them. Each is made by a run of `baliza` or by code of this program ([`ways`]), printed into its
//! document, and compared there: the promised value is the one that the document prints.

mod check;
mod compare;
mod document;
mod extract;
mod file;
mod runs;
mod sentences;
mod ways;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail, ensure};

use crate::{baliza, root, toolchain};
use check::Failure;
pub use check::first_difference;
use file::{Figure, Need, PromisedTable, Promises, TableWay};
use runs::{BuiltBaliza, Runner};
pub use ways::Made;

/// The arguments of `cargo xtask promises`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only promises with these names, such as `simulation`; all, where none is named
    names: Vec<String>,
    /// Write nothing: compare what documents print with what is measured, and with what must be reached
    #[arg(long)]
    check: bool,
    /// Only what takes seconds, and nothing that depends on the machine's speed
    #[arg(long)]
    quick: bool,
    /// Run this `baliza` instead of building one: all figures are the same with any build but those of its speed,
    /// which are not remade then
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,
    /// List the promises, and what they need
    #[arg(long, conflicts_with_all = ["check"])]
    list: bool,
}

/// The path of a document, by its name in `promises.toml`.
///
/// # Errors
/// The file cannot be read, or has no such document.
pub fn path(document: &str) -> Result<PathBuf> {
    Promises::read()?.path(document).cloned()
}

/// Writes tables that were made outside of the list of promises into the document of the promise of this name.
///
/// # Errors
/// A file cannot be read or written, or a reach is missed.
pub fn remake(name: &str, made: &Made) -> Result<()> {
    let promises = Promises::read()?;
    let table =
        promises.tables.iter().find(|table| table.name == name).with_context(|| format!("no promise {name}"))?;
    let mut book = Book {
        promises: &promises,
        files: Files::of_repository(),
        runner: &BuiltBaliza,
        quick: false,
        keeps_speed: false,
    };
    let failures = book.print(table, Book::shown(made))?;
    ensure!(failures.is_empty(), "{}", failures.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n"));
    Ok(())
}

/// What is to be made: tables or a figure.
enum Promise<'p> {
    Tables(&'p PromisedTable),
    Figure(&'p Figure),
}

impl Promise<'_> {
    fn name(&self) -> &str {
        match self {
            Self::Tables(table) => &table.name,
            Self::Figure(figure) => &figure.name,
        }
    }

    fn seconds(&self) -> u32 {
        match self {
            Self::Tables(table) => table.seconds,
            Self::Figure(figure) => figure.seconds,
        }
    }

    fn is_quick(&self) -> bool {
        match self {
            Self::Tables(table) => table.quick,
            Self::Figure(figure) => figure.quick,
        }
    }

    /// What it needs and is not here.
    fn missing(&self) -> Option<&'static str> {
        let needs = match self {
            Self::Tables(table) => &table.needs,
            Self::Figure(figure) => &figure.needs,
        };
        needs.iter().find_map(|need| match need {
            Need::Recordings => baliza::data().is_none().then_some("recordings (BALIZA_DATA, ../shared/data)"),
            Need::BareMetal => (!toolchain::is_installed("qemu-system-arm")).then_some("QEMU (.ci/setup)"),
            Need::Browser => (!toolchain::is_installed("npm")).then_some("npm and Chromium (.ci/setup)"),
        })
    }
}

/// Remakes or checks.
///
/// # Errors
/// `promises.toml` or a name is wrong, a run fails, or a promise does not hold; after all have been tried.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(program) = &arguments.program {
        baliza::run_this(program)?;
    }
    let promises = Promises::read()?;
    for name in &arguments.names {
        let known = || promises.names().collect::<Vec<_>>().join(", ");
        ensure!(promises.names().any(|known| known == name), "no promise {name}; there are {}", known());
    }
    let all = promises.tables.iter().map(Promise::Tables).chain(promises.figures.iter().map(Promise::Figure));
    let is_wanted = |promise: &Promise| {
        let is_named = arguments.names.is_empty() || arguments.names.iter().any(|name| name == promise.name());
        is_named && (promise.is_quick() || !arguments.quick)
    };
    let chosen: Vec<Promise> = all.filter(is_wanted).collect();
    if arguments.list {
        chosen.iter().for_each(|promise| println!("{:20} {:5} s", promise.name(), promise.seconds()));
        return Ok(());
    }
    let files = Files::of_repository();
    let (quick, keeps_speed) = (arguments.quick, arguments.program.is_some());
    let mut book = Book { promises: &promises, files, runner: &Cached::new(&BuiltBaliza), quick, keeps_speed };
    let (mut failures, mut summary) = (Vec::new(), String::new());
    for (at, promise) in (1..).zip(&chosen) {
        let name = promise.name();
        eprintln!("[{at}/{}] {name}, about {} s", chosen.len(), promise.seconds());
        let begun = Instant::now();
        let outcome = match promise.missing() {
            Some(what) if arguments.check || arguments.names.is_empty() => format!("left out: no {what} here"),
            Some(what) => bail!("{name} needs {what}"),
            None => {
                let found = if arguments.check { book.check(promise) } else { book.remake(promise) };
                let found = found.unwrap_or_else(|error| vec![Failure::error(name, &error)]);
                let outcome = if found.is_empty() { "holds".to_owned() } else { format!("{} FAILED", found.len()) };
                failures.extend(found);
                outcome
            }
        };
        summary += &format!("{name:20} {outcome} ({:.0} s)\n", begun.elapsed().as_secs_f64());
    }
    eprintln!("\n{summary}");
    for failure in &failures {
        println!("{failure}");
    }
    ensure!(failures.is_empty(), "{} promises do not hold", failures.len());
    Ok(())
}

/// The files that are read and written, by their paths in the repository.
#[derive(Default)]
struct Files {
    /// Read or changed ones. Nothing else is read where `root` is `None`.
    texts: BTreeMap<String, String>,
    root: Option<&'static Path>,
}

impl Files {
    fn of_repository() -> Self {
        Self { texts: BTreeMap::new(), root: Some(root()) }
    }

    fn read(&self, path: &Path) -> Result<String> {
        let name = path.display().to_string();
        match (self.texts.get(&name), self.root) {
            (Some(text), _) => Ok(text.clone()),
            (None, Some(root)) => fs::read_to_string(root.join(path)).with_context(|| format!("cannot read {name}")),
            (None, None) => bail!("there is no {name}"),
        }
    }

    fn write(&mut self, path: &Path, text: &str) -> Result<()> {
        let name = path.display().to_string();
        match self.root {
            Some(root) => {
                fs::write(root.join(path), text).with_context(|| format!("cannot write {name}"))?;
            }
            None => _ = self.texts.insert(name, text.to_owned()),
        }
        Ok(())
    }
}

/// Runs of equal arguments run once.
struct Cached<'r> {
    runner: &'r dyn Runner,
    results: std::cell::RefCell<BTreeMap<String, Vec<serde_json::Value>>>,
}

impl<'r> Cached<'r> {
    fn new(runner: &'r dyn Runner) -> Self {
        Self { runner, results: Default::default() }
    }
}

impl Runner for Cached<'_> {
    fn results(&self, arguments: &str) -> Result<Vec<serde_json::Value>> {
        if let Some(results) = self.results.borrow().get(arguments) {
            return Ok(results.clone());
        }
        let results = self.runner.results(arguments)?;
        self.results.borrow_mut().insert(arguments.to_owned(), results.clone());
        Ok(results)
    }
}

/// The promises with what makes them and where they are printed.
struct Book<'b> {
    promises: &'b Promises,
    files: Files,
    runner: &'b dyn Runner,
    quick: bool,
    /// Figures of the machine's speed stay as they are printed.
    keeps_speed: bool,
}

impl Book<'_> {
    /// What a table's way makes; each table as documents show it.
    fn make(&self, table: &PromisedTable) -> Result<Made> {
        let made = match &table.way {
            TableWay::Runs => {
                let text = runs::table(table, self.runner, |row| eprintln!("    {row}"))?;
                Made::one(&table.name, text)
            }
            TableWay::Prints(arguments) => runs::printed(&table.name, arguments, table.picture.as_deref())?,
            TableWay::Code(name) => ways::make(name)?,
        };
        if !self.quick {
            made.tables.iter().for_each(|(_, text)| println!("{text}"));
        }
        let shown = Self::shown(&made);
        for (name, text) in &shown.tables {
            ensure!(!text.trim().is_empty(), "{name} was made, and is empty");
        }
        Ok(shown)
    }

    /// The tables as documents show them.
    fn shown(made: &Made) -> Made {
        let extract = |(name, text): &(String, String)| Some((name.clone(), extract::of(name, text)?));
        Made { tables: made.tables.iter().filter_map(extract).collect(), ..made.clone() }
    }

    /// Makes a promise and writes it where it is printed. Returns the reaches that are missed.
    fn remake(&mut self, promise: &Promise) -> Result<Vec<Failure>> {
        match promise {
            Promise::Tables(table) => self.remake_tables(table),
            Promise::Figure(figure) => self.remake_figure(figure),
        }
    }

    fn remake_tables(&mut self, table: &PromisedTable) -> Result<Vec<Failure>> {
        self.print(table, self.make(table)?)
    }

    /// Writes what was made. Returns the reaches that are missed.
    fn print(&mut self, table: &PromisedTable, made: Made) -> Result<Vec<Failure>> {
        let path = self.promises.path(&table.document)?;
        let mut failures = Vec::new();
        for (name, text) in &made.tables {
            let page = self.files.read(path)?;
            let old = document::table(&page, name).with_context(|| path.display().to_string())?;
            let keeps = |column: &str| table.measured.contains(column);
            let tolerance =
                |column: &str| if self.keeps_speed { f64::INFINITY } else { table.tolerance_percent(column) };
            let text = compare::keeping(old, text, &keeps, &|column| Some(tolerance(column)));
            failures.extend(check::reaches(self.promises, table, &text));
            self.files.write(path, &document::with_table(&page, name, &text)?)?;
        }
        for (path, text) in made.files.iter().chain(&made.pictures) {
            self.files.write(path, text)?;
        }
        failures.extend(made.complaint.map(|complaint| Failure::complaint(&table.name, complaint)));
        Ok(failures)
    }

    fn remake_figure(&mut self, figure: &Figure) -> Result<Vec<Failure>> {
        let results = self.runner.results(&figure.run)?;
        let result = runs::chosen(&results, &figure.result)?;
        if let (Some(document), Some(sentence)) = (&figure.document, &figure.sentence) {
            let path = self.promises.path(document)?;
            let page = self.files.read(path)?;
            let place = sentences::find(&page, sentence).with_context(|| path.display().to_string())?;
            let numbers = sentences::numbers(sentence, result)?;
            println!("{}: {}", figure.name, numbers.join(", "));
            self.files.write(path, &place.replaced(&page, &numbers))?;
        }
        check::figure_reaches(figure, result)
    }
}

#[cfg(test)]
mod tests;
