//! Tables in Markdown.

use std::fmt::{Arguments, Display, Write as _};

/// A table that is written row by row.
#[derive(Clone, Debug)]
pub struct MarkdownTable(String);

impl MarkdownTable {
    /// A table with these column titles. A title with a colon at its end is of a column of numbers, which is aligned
    /// to the right.
    pub fn new<T: Display>(titles: impl IntoIterator<Item = T>) -> Self {
        let (mut head, mut rule) = (String::from("|"), String::from("|"));
        for title in titles {
            let title = title.to_string();
            let (title, line) = title.strip_suffix(':').map_or((title.as_str(), "---|"), |title| (title, "---:|"));
            // Writing to a string cannot fail.
            let _ = write!(head, " {title} |");
            rule += line;
        }
        Self(format!("{head}\n{rule}\n"))
    }

    /// Adds a row: its cells with ` | ` between them.
    pub fn row(&mut self, cells: Arguments<'_>) {
        let _ = writeln!(self.0, "| {cells} |");
    }

    /// The text, which ends with a line end.
    pub fn into_text(self) -> String {
        self.0
    }

    /// The same for a terminal: columns with two spaces between them, numbers aligned to the right.
    pub fn into_columns(self) -> String {
        let cells = |line: &str| -> Vec<String> {
            let line = line.trim_start_matches('|').trim_end_matches('|');
            line.split('|').map(|cell| cell.trim().replace('`', "")).collect()
        };
        let mut lines = self.0.lines().map(cells);
        let (head, rule) = (lines.next().unwrap_or_default(), lines.next().unwrap_or_default());
        let rows: Vec<Vec<String>> = [head].into_iter().chain(lines).collect();
        let width = |column: usize| {
            rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..rule.len()).map(width).collect();
        let mut text = String::new();
        for row in &rows {
            let mut line = String::new();
            for ((cell, width), rule) in row.iter().zip(&widths).zip(&rule) {
                let padding = " ".repeat(width.saturating_sub(cell.chars().count()));
                let between = if line.is_empty() { "" } else { "  " };
                let _ = match rule.ends_with(':') {
                    true => write!(line, "{between}{padding}{cell}"),
                    false => write!(line, "{between}{cell}{padding}"),
                };
            }
            let _ = writeln!(text, "{}", line.trim_end());
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::MarkdownTable;

    #[test]
    fn numbers_are_aligned_to_the_right() {
        let mut table = MarkdownTable::new(["method", "RMSE, m:"]);
        table.row(format_args!("`{}` | {:.2}", "lls", 0.5));
        assert_eq!(table.into_text(), "| method | RMSE, m |\n|---|---:|\n| `lls` | 0.50 |\n");
    }

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let mut table = MarkdownTable::new(["method", "RMSE, m:"]);
        table.row(format_args!("`lls` | 0.50"));
        table.row(format_args!("bounding-box | 12.25"));
        assert_eq!(table.into_columns(), "method        RMSE, m\nlls              0.50\nbounding-box    12.25\n");
    }
}
