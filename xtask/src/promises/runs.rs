//! Figures that a run of `baliza … --json` gives: templates of cells and sentences, filled with the keys of a result.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use baliza_report::MarkdownTable;
use serde::Deserialize;
use serde_json::Value;

use super::Made;
use super::file::PromisedTable;
use crate::baliza;

/// The key of a result for simulated seconds per second of the clock.
const SPEED: &str = "times_real_time";

/// What runs `baliza`.
pub trait Runner {
    /// The `results` of a run with these arguments and `--json`.
    ///
    /// # Errors
    /// The run fails, or prints something else.
    fn results(&self, arguments: &str) -> Result<Vec<Value>>;
}

/// The program itself.
pub struct BuiltBaliza;

impl Runner for BuiltBaliza {
    fn results(&self, arguments: &str) -> Result<Vec<Value>> {
        // Built before any time is measured.
        baliza::binary()?;
        let words = baliza::words(arguments)?;
        let begun = Instant::now();
        let mut results: Vec<Value> = baliza::json(words.into_iter().chain(["--json".into()]))?;
        let took_s = begun.elapsed().as_secs_f64();
        for result in results.iter_mut().filter_map(Value::as_object_mut) {
            if let Some(seconds) = result.get("seconds").and_then(Value::as_f64) {
                result.insert(SPEED.to_owned(), (seconds / took_s).into());
            }
        }
        Ok(results)
    }
}

/// A text with keys of a result in braces: `{p50_m:3}` has three digits after the point, `{airtime_share:%}` is a
/// percentage, `{tag_mean_current_ma:life 500}` what a battery of 500 mAh lasts. A key may be a path,
/// `bluetooth.by_beacons.rmse_m`.
#[derive(Clone, Debug, Deserialize, PartialEq)]
#[serde(try_from = "String")]
pub struct Template(pub Vec<Piece>);

/// A piece of a template.
#[derive(Clone, Debug, PartialEq)]
pub enum Piece {
    /// As it is.
    Text(String),
    /// A key's value.
    Key { key: String, format: NumberFormat },
}

/// How a number is printed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NumberFormat {
    /// With this number of digits after the point.
    Digits(usize),
    /// Times a hundred, and a percent sign.
    Percent,
    /// The life of a battery with this charge, mAh; the number is a current in mA.
    Life(f64),
}

impl TryFrom<String> for Template {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let mut pieces = Vec::new();
        let mut rest = text.as_str();
        while let Some((before, after)) = rest.split_once('{') {
            let (inside, behind) = after.split_once('}').ok_or_else(|| format!("no closing brace after {{{after}"))?;
            let (key, format) = inside.split_once(':').ok_or_else(|| format!("no format in {{{inside}}}"))?;
            let format = match (format, format.strip_prefix("life ")) {
                ("%", _) => NumberFormat::Percent,
                (_, Some(mah)) => NumberFormat::Life(mah.parse().map_err(|_| format!("no charge in {{{inside}}}"))?),
                (digits, None) => {
                    NumberFormat::Digits(digits.parse().map_err(|_| format!("no format in {{{inside}}}"))?)
                }
            };
            pieces.extend((!before.is_empty()).then(|| Piece::Text(before.to_owned())));
            pieces.push(Piece::Key { key: key.to_owned(), format });
            rest = behind;
        }
        pieces.extend((!rest.is_empty()).then(|| Piece::Text(rest.to_owned())));
        Ok(Self(pieces))
    }
}

impl Template {
    /// The text with the values of a result.
    ///
    /// # Errors
    /// The result lacks a key.
    pub fn fill(&self, result: &Value) -> Result<String> {
        let text = |piece: &Piece| match piece {
            Piece::Text(text) => Ok(text.clone()),
            Piece::Key { key, format } => Ok(format.text(number(result, key)?)),
        };
        self.0.iter().map(text).collect()
    }
}

/// The number of a key; `None` where it is null.
///
/// # Errors
/// There is no such key, or it is no number.
pub fn number(result: &Value, key: &str) -> Result<Option<f64>> {
    let mut value = result;
    for name in key.split('.') {
        value = value.get(name).with_context(|| format!("the result has no {key}"))?;
    }
    match value {
        Value::Null => Ok(None),
        other => Ok(Some(other.as_f64().with_context(|| format!("{key} is no number: {other}"))?)),
    }
}

impl NumberFormat {
    fn text(self, number: Option<f64>) -> String {
        let Some(number) = number else { return "–".to_owned() };
        match self {
            Self::Digits(digits) => format!("{number:.digits$}"),
            Self::Percent => format!("{:.0} %", 100.0 * number),
            Self::Life(mah) => {
                let days = mah / number / 24.0;
                if days < 100.0 { format!("{days:.0} days") } else { format!("{:.1} years", days / 365.25) }
            }
        }
    }
}

/// The only result of a run, or the one with these values.
///
/// # Errors
/// There is none, or there are several.
pub fn chosen<'r>(results: &'r [Value], wanted: &BTreeMap<String, String>) -> Result<&'r Value> {
    let is = |result: &&Value| {
        wanted.iter().all(|(key, wanted)| match result.get(key) {
            Some(Value::String(text)) => text == wanted,
            Some(other) => *wanted == format!("{other}"),
            None => false,
        })
    };
    let mut found = results.iter().filter(is);
    match (found.next(), found.next()) {
        (Some(result), None) => Ok(result),
        (None, _) => bail!("no result has {wanted:?}"),
        (Some(_), Some(_)) => bail!("several results have {wanted:?}"),
    }
}

/// A table of runs.
///
/// # Errors
/// A run fails, or its result lacks a key.
pub fn table(of: &PromisedTable, runner: &dyn Runner, mut progress: impl FnMut(&str)) -> Result<String> {
    let titles = of.columns.iter().map(|column| format!("{}:", column.title));
    let mut table = MarkdownTable::new(std::iter::once(of.first.clone()).chain(titles));
    for row in &of.rows {
        progress(&row.title);
        let results = runner.results(&row.run)?;
        let result = chosen(&results, &BTreeMap::new()).with_context(|| row.run.clone())?;
        let mut beside = row.beside.iter();
        let cells = of.columns.iter().map(|column| match &column.cell {
            Some(cell) => cell.fill(result),
            None => Ok(beside.next().cloned().unwrap_or_default()),
        });
        let cells = cells.collect::<Result<Vec<_>>>().with_context(|| row.run.clone())?;
        table.row(format_args!("{} | {}", row.title, cells.join(" | ")));
    }
    Ok(table.into_text())
}

/// The texts that runs print, as one table with its picture. Tables of aligned columns become Markdown.
///
/// # Errors
/// A run fails, or the picture cannot be read.
pub fn printed(name: &str, arguments: &[String], picture: Option<&Path>) -> Result<Made> {
    let drawn = baliza::scratch("promised.svg")?;
    let mut texts = Vec::new();
    for arguments in arguments {
        let plot = picture.map(|_| ["--plot".into(), drawn.clone()]);
        texts.push(baliza::baliza(baliza::words(arguments)?.into_iter().chain(plot.into_iter().flatten()))?);
    }
    let text = texts.join("\n");
    let mut made = Made::one(name, if text.contains('|') { text } else { markdown(&text) });
    if let Some(picture) = picture {
        let text = fs::read_to_string(&drawn).with_context(|| format!("cannot read {}", drawn.display()))?;
        made.pictures.push((picture.to_owned(), text));
    }
    Ok(made)
}

/// Tables with two spaces or more between their columns, in Markdown. An empty line ends a table.
fn markdown(text: &str) -> String {
    let tables = text.split("\n\n").map(|block| {
        let cells = |line| str::split(line, "  ").map(str::trim).filter(|cell| !cell.is_empty()).collect::<Vec<_>>();
        let rows: Vec<_> = block.lines().map(cells).filter(|cells| !cells.is_empty()).collect();
        let (titles, rows) = rows.split_first().map_or((&[][..], &[][..]), |(titles, rows)| (&**titles, rows));
        let is_number = |cell: &&str| cell.starts_with(|first: char| first.is_ascii_digit() || "-–".contains(first));
        let titles = titles.iter().enumerate().map(|(at, title)| {
            let is_of_numbers = rows.iter().filter_map(|cells| cells.get(at)).all(is_number);
            if is_of_numbers { format!("{title}:") } else { (*title).to_owned() }
        });
        let mut table = MarkdownTable::new(titles);
        rows.iter().for_each(|cells| table.row(format_args!("{}", cells.join(" | "))));
        table.into_text()
    });
    tables.collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aligned_columns_are_tables_in_markdown() {
        let text = "method  of   points  right windows\nsvm     all      37         94.4 %\n\nby svm, in  a  b\n";
        let expected = "| method | of | points | right windows |\n|---|---|---:|---:|\n| svm | all | 37 | 94.4 % |\n\n";
        assert!(markdown(text).starts_with(expected), "{}", markdown(text));
    }

    #[test]
    fn keys_are_filled_in_their_formats() {
        let result = serde_json::json!({ "p50_m": 0.0124, "share": 0.456, "ma": 0.2, "none": null, "in": { "x": 7 } });
        let fill = |text: &str| Template::try_from(text.to_owned()).unwrap().fill(&result).unwrap();
        assert_eq!(fill("P50 {p50_m:3} m, {share:%}"), "P50 0.012 m, 46 %");
        assert_eq!(fill("{none:2}; {in.x:0}"), "–; 7");
        // 1000 mAh / 0.2 mA = 5000 h = 208 days = 0.57 years; 400 mAh: 83 days.
        assert_eq!(fill("{ma:life 1000}, {ma:life 400}"), "0.6 years, 83 days");
        assert!(Template::try_from("{p90_m:1}".to_owned()).unwrap().fill(&result).is_err());
        assert!(Template::try_from("{p90_m}".to_owned()).is_err());
    }

    #[test]
    fn of_several_results_the_wanted_one_is_taken() {
        let results = [serde_json::json!({ "method": "a", "k": 1 }), serde_json::json!({ "method": "b", "k": 1 })];
        let wanted = |key: &str, value: &str| BTreeMap::from([(key.to_owned(), value.to_owned())]);
        assert_eq!(chosen(&results, &wanted("method", "b")).unwrap(), &results[1]);
        assert!(chosen(&results, &wanted("k", "1")).is_err());
        assert!(chosen(&results, &wanted("method", "c")).is_err());
    }
}
