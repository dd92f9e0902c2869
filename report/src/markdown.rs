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
}
