//! The comparison of what documents print with what is measured, and of both with what must be reached.

use std::fmt;

use anyhow::{Context, Result};
use serde_json::Value;

use super::compare::{self, CellDifference};
use super::file::{Figure, PromisedTable, Promises, Reach};
use super::{Book, Promise, document, runs, sentences};

/// A promise that does not hold, as one line.
#[derive(Clone, Debug, PartialEq)]
pub struct Failure {
    /// Where it is printed: document, table, row, column.
    place: String,
    what: String,
    /// What to do about it.
    remedy: String,
}

impl fmt::Display for Failure {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}: {}; {}", self.place, self.what, self.remedy)
    }
}

impl Failure {
    /// A figure that is not what a document says.
    fn off(place: &str, name: &str, promised: &str, measured: &str, why: &str) -> Self {
        let what = match (promised, measured) {
            ("", "") => why.to_owned(),
            _ => format!("promised {promised}, measured {measured} ({why})"),
        };
        let remedy = format!("mend the code, or remake it by `cargo xtask promises {name}` and say in the commit why");
        Self { place: place.to_owned(), what, remedy }
    }

    /// A figure that misses its reach.
    fn missed(place: String, measured: f64, sign: &str, limit: f64) -> Self {
        let what = format!("measured {measured}, must be {sign} {limit}");
        Self { place, what, remedy: "mend the code: a reach is not lowered".to_owned() }
    }

    /// A promise that could not be made.
    pub fn error(name: &str, error: &anyhow::Error) -> Self {
        let remedy = format!("mend it, its entry in {}, or its document", super::file::FILE);
        Self { place: name.to_owned(), what: format!("{error:#}"), remedy }
    }

    /// What the maker of tables says against them.
    pub fn complaint(name: &str, complaint: &str) -> Self {
        Self { place: name.to_owned(), what: complaint.to_owned(), remedy: "mend the code".to_owned() }
    }
}

impl Book<'_> {
    /// Makes a promise, and compares it with its document and its reach.
    ///
    /// # Errors
    /// A run fails, or a document has no such place.
    pub fn check(&self, promise: &Promise) -> Result<Vec<Failure>> {
        match promise {
            Promise::Tables(table) => self.check_tables(table),
            Promise::Figure(figure) => self.check_figure(figure),
        }
    }

    fn check_tables(&self, table: &PromisedTable) -> Result<Vec<Failure>> {
        let made = self.make(table)?;
        let path = self.promises.path(&table.document)?;
        let mut failures = Vec::new();
        for (name, text) in &made.tables {
            let page = self.files.read(path)?;
            let promised = document::table(&page, name).with_context(|| path.display().to_string())?;
            let tolerance = |column: &str| {
                let is_compared = !(self.quick && table.measured.contains(column));
                is_compared.then(|| table.tolerance_percent(column))
            };
            for CellDifference { row, column, promised, measured, why } in compare::tables(promised, text, &tolerance) {
                let place = [path.display().to_string(), name.clone(), row, column];
                let place = place.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ");
                failures.push(Failure::off(&place, &table.name, &promised, &measured, &why));
            }
            failures.extend(reaches(self.promises, table, text));
        }
        for (path, text) in &made.files {
            let old = self.files.read(path)?;
            if let Some((line, promised, measured)) = first_difference(&old, text) {
                let place = format!("{}:{line}", path.display());
                failures.push(Failure::off(&place, &table.name, promised, measured, "not the same"));
            }
        }
        failures.extend(made.complaint.map(|complaint| Failure::complaint(&table.name, complaint)));
        Ok(failures)
    }

    fn check_figure(&self, figure: &Figure) -> Result<Vec<Failure>> {
        let results = self.runner.results(&figure.run)?;
        let result = runs::chosen(&results, &figure.result)?;
        let mut failures = figure_reaches(figure, result)?;
        let (Some(document), Some(sentence)) = (&figure.document, &figure.sentence) else { return Ok(failures) };
        let path = self.promises.path(document)?;
        let page = self.files.read(path)?;
        let found = sentences::find(&page, sentence).with_context(|| path.display().to_string())?;
        let percent = figure.tolerance_percent.unwrap_or(super::file::TOLERANCE_PERCENT);
        for (promised, measured) in found.promised(&page).iter().zip(sentences::numbers(sentence, result)?) {
            if let Some(why) = compare::why(promised, &measured, percent) {
                let place = format!("{}, {}", path.display(), figure.name);
                failures.push(Failure::off(&place, &figure.name, promised, &measured, &why));
            }
        }
        Ok(failures)
    }
}

/// The reaches that a made table misses.
pub fn reaches(promises: &Promises, table: &PromisedTable, text: &str) -> Vec<Failure> {
    let rows = compare::rows(text);
    let of_table = promises.reaches.iter().filter(|reach| reach.table == table.name);
    let missed = of_table.flat_map(|reach| {
        let Reach { row, column, at_least, at_most, .. } = reach;
        let place = format!("{}, {row}, {column}", reach.table);
        let cell = || {
            let at = rows.first()?.iter().position(|title| title == column)?;
            compare::first_number(rows.iter().find(|cells| cells.first() == Some(&row.as_str()))?.get(at)?)
        };
        match cell() {
            Some(measured) => limits(&place, measured, *at_least, *at_most),
            None => vec![Failure::complaint(&place, "the table has no such number, which must reach something")],
        }
    });
    missed.collect()
}

/// The reaches that a figure misses.
///
/// # Errors
/// The result lacks a key.
pub fn figure_reaches(figure: &Figure, result: &Value) -> Result<Vec<Failure>> {
    let mut failures = Vec::new();
    let keys = figure.at_least.iter().map(|(key, limit)| (key, Some(*limit), None));
    for (key, at_least, at_most) in keys.chain(figure.at_most.iter().map(|(key, limit)| (key, None, Some(*limit)))) {
        let place = format!("{}, {key}", figure.name);
        let measured = runs::number(result, key)?.with_context(|| format!("{place} is null"))?;
        failures.extend(limits(&place, measured, at_least, at_most));
    }
    Ok(failures)
}

fn limits(place: &str, measured: f64, at_least: Option<f64>, at_most: Option<f64>) -> Vec<Failure> {
    let low = at_least.filter(|limit| measured < *limit).map(|limit| (limit, "at least"));
    let high = at_most.filter(|limit| measured > *limit).map(|limit| (limit, "at most"));
    let missed = low.into_iter().chain(high);
    missed.map(|(limit, sign)| Failure::missed(place.to_owned(), measured, sign, limit)).collect()
}

/// The first line, from 1, in which two texts differ, and the line in both.
pub fn first_difference<'t>(old: &'t str, new: &'t str) -> Option<(usize, &'t str, &'t str)> {
    let lines = old.lines().count().max(new.lines().count());
    let line = |text: &'t str, at| text.lines().nth(at).unwrap_or("nothing");
    (0..lines).find(|&at| line(old, at) != line(new, at)).map(|at| (at + 1, line(old, at), line(new, at)))
}
