//! A reader of CSV files from any program: columns by name, rows one at a time, in bounded memory.
//!
//! A row is a line: unlike in general CSV, a quoted field ends on the line where it began. So the reader never holds
//! more than [`LONGEST_LINE`], however broken the file is, and every error has its line number. A line without quotes
//! is split at its commas where it lies; the others, and the header, go through the CSV parser.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Stdin};
use std::ops::Range;
use std::path::{Path, PathBuf};

use csv::{Reader, ReaderBuilder, StringRecord, Trim};

use crate::UserError;
use crate::inputs::note_read;
use crate::output::STANDARD;

/// The longest accepted line, bytes.
pub const LONGEST_LINE: usize = 64 * 1024;
/// Names of columns that are more alike than this (Jaro-Winkler) may be meant for each other.
const ALIKE: f64 = 0.9;
/// A record that is read after each line, and that no line can contain. An open quote in the line swallows the
/// beginning of this record. A carriage return within the line puts another record before this one.
const BEHIND: &str = "\n\".\n.\"\n";

/// A CSV file whose header has been read.
#[derive(Debug)]
pub struct Table {
    file: PathBuf,
    input: BufReader<Input>,
    header: Vec<String>,
    line: u64,
    fields: Fields,
    /// Splits lines that have quotes.
    records: Reader<Cursor<Vec<u8>>>,
}

/// A text, and its fields in it without blanks around them.
#[derive(Debug, Default)]
struct Fields {
    text: String,
    /// The bytes of each field.
    places: Vec<Range<usize>>,
}

impl Fields {
    fn get(&self, index: usize) -> Option<&str> {
        self.text.get(self.places.get(index)?.clone())
    }

    fn iter(&self) -> impl Iterator<Item = &str> {
        self.places.iter().filter_map(|place| self.text.get(place.clone()))
    }

    /// Splits the text at its commas.
    fn split(&mut self) {
        self.places.clear();
        let mut begin = 0;
        for field in self.text.split(',') {
            let blanks = field.len() - field.trim_start().len();
            self.places.push(begin + blanks..begin + blanks + field.trim().len());
            begin += field.len() + 1;
        }
    }
}

/// The source of a table.
#[derive(Debug)]
enum Input {
    File(File),
    Standard(Stdin),
}

impl Read for Input {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(buffer),
            Self::Standard(stdin) => stdin.read(buffer),
        }
    }
}

/// A column, found by its name. An optional column may be absent; then all its fields are empty.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    name: &'static str,
    index: Option<usize>,
    bound: Bound,
}

impl Column {
    /// Whether the file has the column.
    pub fn is_present(&self) -> bool {
        self.index.is_some()
    }
}

/// One line of the table.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    file: &'a Path,
    line: u64,
    fields: &'a Fields,
}

impl Table {
    /// Opens a file, or with `-` standard input, and reads its header.
    ///
    /// # Errors
    /// The file cannot be opened, is empty, or its first line is not a CSV header.
    pub fn open(file: &Path) -> Result<Self, UserError> {
        let (file, input) = if file.as_os_str() == STANDARD {
            (Path::new("standard input"), Input::Standard(io::stdin()))
        } else {
            let opened = File::open(file).map_err(|error| UserError::file(file, format!("cannot open it: {error}")))?;
            note_read(file);
            (file, Input::File(opened))
        };
        log::info!("reading {}", file.display());
        let mut table = Self {
            file: file.to_owned(),
            input: BufReader::with_capacity(LONGEST_LINE, input),
            header: Vec::new(),
            line: 0,
            fields: Fields::default(),
            records: ReaderBuilder::new()
                .has_headers(false)
                .flexible(true)
                .trim(Trim::All)
                .from_reader(Cursor::default()),
        };
        if !table.advance()? {
            return Err(UserError::line(file, 1, "the file is empty; a header is expected"));
        }
        table.header = table.fields.iter().map(str::to_owned).collect();
        for (index, name) in table.header.iter().enumerate() {
            if !name.is_empty() && table.header[..index].contains(name) {
                return Err(table.wrong(format!("column {} stands twice", quoted(name))));
            }
        }
        Ok(table)
    }

    /// The names of all columns.
    pub fn header(&self) -> &[String] {
        &self.header
    }

    /// A required column.
    ///
    /// # Errors
    /// The column is absent.
    pub fn column(&self, name: &'static str) -> Result<Column, UserError> {
        let column = self.optional(name);
        if column.is_present() {
            Ok(column)
        } else {
            let missing = format!("no column {name} in the header {}", quoted(&self.header.join(",")));
            Err(UserError::line(&self.file, self.line, missing + &self.hint(name)))
        }
    }

    /// Whether decimal commas may have split the numbers of the row: it has too many fields, none has a point, and two
    /// neighbours are whole numbers.
    fn has_decimal_commas(&self) -> bool {
        let fields: Vec<&str> = self.fields.iter().collect();
        let is_whole = |text: &&str| text.parse::<i64>().is_ok();
        fields.len() > self.header.len()
            && !fields.iter().any(|text| text.contains('.'))
            && fields.windows(2).any(|pair| pair.iter().all(is_whole))
    }

    /// What may be the reason that a column is missing: another separator, a comment, or another spelling.
    fn hint(&self, name: &str) -> String {
        match &self.header[..] {
            [first, ..] if first.starts_with('#') => "; the header must be the first line, without comments".to_owned(),
            [only] if only.contains(';') => "; separated by `;`? commas are expected".to_owned(),
            [only] if only.contains('\t') => "; separated by tabs? commas are expected".to_owned(),
            _ => self.near(name).map_or_else(String::new, |near| format!("; {near} is near it")),
        }
    }

    /// The column of the file that is called nearly so, or by another word for the same.
    fn near(&self, name: &str) -> Option<&str> {
        let (_, unit) = name.rsplit_once('_').unwrap_or((name, ""));
        let is_other_word = |column: &str| {
            name == "range_m" && ["range", "distance", "dist"].iter().any(|word| column.starts_with(word))
        };
        let alike = |column: &&String| {
            let column = column.to_lowercase();
            column == name
                || is_other_word(&column)
                || strsim::jaro_winkler(&column, name) > ALIKE && column.ends_with(unit)
        };
        self.header.iter().find(alike).map(String::as_str)
    }

    /// An optional column.
    pub fn optional(&self, name: &'static str) -> Column {
        let index = self.header.iter().position(|column| column == name);
        Column { name, index, bound: Bound::of(name) }
    }

    /// The next row that is not blank; `None` at the end of the file.
    ///
    /// # Errors
    /// The line is too long, is not UTF-8, does not have the header's number of fields, or cannot be read.
    pub fn next_row(&mut self) -> Result<Option<Row<'_>>, UserError> {
        if !self.advance()? {
            return Ok(None);
        }
        let (found, expected) = (self.fields.places.len(), self.header.len());
        if found != expected {
            let hint = match self.fields.get(0) {
                Some(first) if first.starts_with('#') => "; remove the comment: CSV has none",
                _ if self.has_decimal_commas() => "; decimal commas? points are expected",
                _ => "",
            };
            return Err(self.wrong(format!("{found} fields where the header has {expected}{hint}")));
        }
        Ok(Some(Row { file: &self.file, line: self.line, fields: &self.fields }))
    }

    /// Reads the next line that is not blank into `self.fields`; false at the end of the file.
    fn advance(&mut self) -> Result<bool, UserError> {
        loop {
            self.line += 1;
            let mut bytes = std::mem::take(&mut self.fields.text).into_bytes();
            bytes.clear();
            let read = self.input.by_ref().take(LONGEST_LINE as u64 + 1).read_until(b'\n', &mut bytes);
            if let Err(error) = read {
                return Err(self.wrong(format!("cannot read it: {error}")));
            }
            if bytes.is_empty() {
                return Ok(false);
            }
            if bytes.len() > LONGEST_LINE {
                return Err(self.wrong(format!("the line is longer than {LONGEST_LINE} bytes")));
            }
            let text = &mut self.fields.text;
            *text = match String::from_utf8(bytes) {
                Ok(text) => text,
                Err(error) => {
                    let byte = error.as_bytes()[error.utf8_error().valid_up_to()];
                    return Err(self.wrong(format!("not a text file: byte {byte:#04x} is not UTF-8")));
                }
            };
            text.truncate(text.trim_end_matches(['\r', '\n']).len());
            if text.trim().is_empty() {
                continue;
            }
            let is_header = self.header.is_empty();
            return if !is_header && !text.bytes().any(|byte| matches!(byte, b'"' | b'\r')) {
                self.fields.split();
                Ok(true)
            } else if self.parse() {
                Ok(true)
            } else if self.fields.text.trim_ascii_end().contains('\r') {
                Err(self.wrong("a carriage return within the line"))
            } else {
                Err(self.wrong("a quote is not closed on its line"))
            };
        }
    }

    /// Parses a line that may have quotes; false where it is not exactly one record.
    fn parse(&mut self) -> bool {
        let cursor = self.records.get_mut();
        cursor.set_position(0);
        cursor.get_mut().clear();
        cursor.get_mut().extend_from_slice(self.fields.text.as_bytes());
        cursor.get_mut().extend_from_slice(BEHIND.as_bytes());
        let (mut record, mut behind) = (StringRecord::new(), StringRecord::new());
        let mut next = |record| self.records.read_record(record).is_ok_and(|found| found);
        let found = next(&mut record) && next(&mut behind);
        if !found || behind != [".\n."][..] || record.iter().any(|field| field.contains('\n')) {
            return false;
        }
        let Fields { text, places } = &mut self.fields;
        text.clear();
        places.clear();
        for field in &record {
            places.push(text.len()..text.len() + field.len());
            text.push_str(field);
        }
        true
    }

    fn wrong(&self, what: impl Into<String>) -> UserError {
        UserError::line(&self.file, self.line, what)
    }
}

impl<'a> Row<'a> {
    /// The row's line number in the file, from 1.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// The text of a field, without blanks around it. It is empty where the value is unknown.
    pub fn text(&self, column: Column) -> &'a str {
        column.index.and_then(|index| self.fields.get(index)).unwrap_or("")
    }

    /// The text of a field that must not be empty.
    ///
    /// # Errors
    /// The field is empty.
    pub fn some_text(&self, column: Column) -> Result<&'a str, UserError> {
        match self.text(column) {
            "" => Err(self.wrong(column, "is empty")),
            text => Ok(text),
        }
    }

    /// A number within the bound of its column; `None` where the field is empty.
    ///
    /// # Errors
    /// The field is not empty and not such a number.
    pub fn number(&self, column: Column) -> Result<Option<f64>, UserError> {
        let text = match self.text(column) {
            "" => return Ok(None),
            text => text,
        };
        let bound = column.bound;
        let is_wrong = |what: &str| Err(self.wrong(column, &format!("{} {what}", quoted(text))));
        match text.parse::<f64>() {
            Ok(number) if number.abs() <= bound.most => Ok(Some(number)),
            Ok(number) if number.is_finite() => is_wrong(&format!("is not within ±{}", bound.text)),
            Ok(_) => is_wrong("is not finite"),
            Err(_) if text.replace(',', ".").parse::<f64>().is_ok() => {
                is_wrong("is not a number; a decimal comma? a point is expected")
            }
            Err(_) => is_wrong("is not a number"),
        }
    }

    /// A number that is required, within the bound of its column.
    ///
    /// # Errors
    /// The field is empty or not such a number.
    pub fn some_number(&self, column: Column) -> Result<f64, UserError> {
        self.number(column)?.ok_or_else(|| self.wrong(column, "is empty"))
    }

    /// 1 or 0, which some programs write as 1.0 or 0.0; `None` where the field is empty.
    ///
    /// # Errors
    /// The field has any other text.
    pub fn truth_value(&self, column: Column) -> Result<Option<bool>, UserError> {
        match self.text(column) {
            "" => Ok(None),
            "1" | "1.0" => Ok(Some(true)),
            "0" | "0.0" => Ok(Some(false)),
            text => Err(self.wrong(column, &format!("{} is neither 1 nor 0", quoted(text)))),
        }
    }

    /// The error of a wrong field in this row.
    pub fn wrong(&self, column: Column, what: &str) -> UserError {
        UserError::line(self.file, self.line, format!("{} {what}", column.name))
    }
}

/// The largest magnitude of the numbers in a column. Beyond it no position, level or time makes sense, and arithmetic
/// and pictures would fail in ways that hide the wrong line.
#[derive(Clone, Copy, Debug)]
struct Bound {
    most: f64,
    /// The bound with its unit, for messages.
    text: &'static str,
}

impl Bound {
    /// The bound of the column with this name, by the unit at the name's end.
    fn of(column: &str) -> Self {
        let has_unit = |unit: &str| column.ends_with(unit);
        let (most, text) = match column {
            // A hundred metres in millimetres: `check` says which unit it is.
            "range_m" => (1.0e5, "100 km"),
            "path_loss_exponent" => (100.0, "100"),
            // Coordinates may be those of a national grid.
            "x" | "y" => (1.0e7, "10000 km"),
            _ if has_unit("_m") => (1.0e7, "10000 km"),
            _ if has_unit("_db") || has_unit("_dbm") => (1.0e3, "1000 dB"),
            _ if has_unit("_s") => (1.0e11, "1e11 s"),
            // What is computed in f32.
            _ => (1.0e30, "1e30"),
        };
        Self { most, text }
    }
}

/// Text from a file for an error message: printable, on one line, and short.
pub(crate) fn quoted(text: &str) -> String {
    const LONGEST: usize = 60;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{:?}…", &text[..end]),
        None => format!("{text:?}"),
    }
}

#[cfg(test)]
mod tests {
    use csv::{ReaderBuilder, StringRecord, Trim};

    use super::Fields;

    #[test]
    fn a_line_without_quotes_has_the_fields_that_a_parser_of_csv_finds() {
        // All lines of six characters of these: separator, letters of one and two bytes, blanks of one and two bytes.
        let characters = [',', 'a', 'é', ' ', '\u{a0}'];
        for number in 0..characters.len().pow(6) {
            let digits = (0..6).map(|place| number / characters.len().pow(place) % characters.len());
            let text: String = digits.map(|digit| characters[digit]).collect();
            let mut fields = Fields { text, places: Vec::new() };
            fields.split();
            let mut reader =
                ReaderBuilder::new().has_headers(false).trim(Trim::All).from_reader(fields.text.as_bytes());
            let mut record = StringRecord::new();
            assert!(reader.read_record(&mut record).expect("UTF-8"), "{:?}", fields.text);
            assert_eq!(fields.iter().collect::<Vec<_>>(), record.iter().collect::<Vec<_>>(), "{:?}", fields.text);
        }
    }
}
