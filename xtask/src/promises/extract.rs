//! Extracts of printed tables for the documents: the rows and columns that readers need. The input is a table's name
//! and its text. The output is the extract, or nothing where the table is only printed.

/// The extract of a table, by the name of its place in the document.
pub fn of(name: &str, text: &str) -> Option<String> {
    let tables = blocks(text);
    let all = |_: &[String]| true;
    let first = tables.first().map_or(&[][..], Vec::as_slice);
    match name {
        "schemes" => Some(table(first, &[0, 1, 3, 5], all)),
        "thesis" => Some(beside_printed(first)),
        // The method with an oracle has no positions where the true line of sight is unknown.
        "recordings" => Some(table(first, &[0, 1, 2, 3, 4], |row| row.iter().skip(1).any(|cell| cell != "no fix"))),
        // Comparisons of sites, beacons and settings follow this table.
        "accuracy" => Some(table(first, &[0, 2, 3, 5, 6, 7], all)),
        // The path losses of single beacons come before this table.
        "beacons by path loss" => Some(table(tables.last()?, &[0, 1, 2, 3, 4], all)),
        // The thesis prints other numbers of neighbours too; the particle filter hardly changes anything.
        "fingerprints" => Some(table(first, &[0, 1, 2, 3, 5, 6, 7], |row| {
            row.first().is_some_and(|method| ["`w5nn`", "`5nn`", "`gp`", "`gp-walk`"].contains(&method.as_str()))
        })),
        // Powers by themselves separate the classes only in this flat, because its direct paths are short.
        // Corrections of ranges follow this table.
        "nlos" => Some(table(first, &[0, 1, 2, 4, 6], |row| row.iter().all(|cell| !cell.contains("power_mean_dbm")))),
        // The confusion matrix follows this table.
        "rooms" => Some(table(first, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9], all)),
        // Images of boards, without their targets.
        "firmware" => Some(table(first, &[0, 2, 3, 4, 5, 6, 7], |row| {
            row.first().is_some_and(|image| !image.contains("-simulated-") && !image.contains("-wired-"))
        })),
        "budgets" => Some(table(first, &[0, 1, 2], all)),
        "cost on the chip" => methods(text),
        "costs"
        | "sizes"
        | "frames"
        | "libraries"
        | "engine"
        | "sight on the chip"
        | "beacons on the chip"
        | "walls as barriers"
        | "predicted maps" => None,
        _ => Some(text.to_owned()),
    }
}

/// The tables of a text, each as its rows of cells: the titles, the line below them, and the rest.
fn blocks(text: &str) -> Vec<Vec<Vec<String>>> {
    let mut tables = vec![Vec::new()];
    for line in text.lines() {
        match (line.strip_prefix('|').and_then(|line| line.strip_suffix('|')), tables.last_mut()) {
            (Some(row), Some(table)) => table.push(row.split('|').map(|cell| cell.trim().to_owned()).collect()),
            _ => tables.push(Vec::new()),
        }
    }
    tables.retain(|table| !table.is_empty());
    tables
}

/// A table with these columns, where they exist, and the wanted rows.
fn table(rows: &[Vec<String>], columns: &[usize], wanted: impl Fn(&[String]) -> bool) -> String {
    let kept = rows.iter().enumerate().filter(|(at, row)| *at < 2 || wanted(row));
    kept.map(|(at, row)| line(columns.iter().filter_map(|&column| row.get(column)), at == 1)).collect()
}

/// A row in Markdown; the line below the titles has no spaces.
fn line<'c>(cells: impl Iterator<Item = &'c String>, is_rule: bool) -> String {
    let cells: String =
        cells.map(|cell| if is_rule { format!("{}|", rule(cell)) } else { format!(" {cell} |") }).collect();
    format!("|{cells}\n")
}

/// Alignment to the left or right, without the width.
fn rule(cell: &str) -> &'static str {
    if cell.ends_with(':') { "---:" } else { "---" }
}

/// The column over all points, for the rows of a method and the rows printed for it, which are one below the other in
/// the text and side by side here.
fn beside_printed(rows: &[Vec<String>]) -> String {
    let mut text = String::from("| method | RMSE, m | as printed, m |\n|---|---:|---:|\n");
    let mut rows = rows.iter().skip(2).peekable();
    while let Some(row) = rows.next() {
        let printed = rows.next_if(|next| next.first().is_some_and(|title| title == "as printed"));
        let all = |row: &Vec<String>| row.get(1).cloned().unwrap_or_default();
        let printed = printed.map(all).unwrap_or_default();
        text += &format!("| {} | {} | {printed} |\n", row.first().map_or("", String::as_str), all(row));
    }
    text
}

/// Instructions of the methods with eight anchors, chip by chip, in the plane and in space, and the first chip's code
/// size. The text has one heading a chip. Below it are two tables whose third column is for eight anchors and whose
/// last one is the code size.
fn methods(text: &str) -> Option<String> {
    let chips: Vec<(&str, Vec<Vec<Vec<String>>>)> =
        text.split("### ").skip(1).map(|chip| (chip.lines().next().unwrap_or_default(), blocks(chip))).collect();
    let mut table = String::from("| method |");
    for (title, _) in &chips {
        table += &format!(" {title}: 2D | 3D |");
    }
    table += &format!(" code, 2D, bytes |\n|---|{}\n", "---:|".repeat(2 * chips.len() + 1));
    let plane = chips.first()?.1.first()?;
    // The last row is for all methods together.
    for (at, row) in plane.iter().enumerate().take(plane.len().saturating_sub(1)).skip(2) {
        table += &format!("| {} |", row.first()?);
        for instructions in chips.iter().flat_map(|(_, tables)| tables).filter_map(|table| table.get(at)?.get(2)) {
            table += &format!(" {instructions} |");
        }
        table += &format!(" {} |\n", row.last()?);
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::of;

    #[test]
    fn chosen_columns_and_rows_stay() {
        let text = "| RMSE | a | b |\n|------|----:|----:|\n| `lls` | 1 | no fix |\n| `nls-ccv` | no fix | no fix |\n";
        let expected = "| RMSE | a | b |\n|---|---:|---:|\n| `lls` | 1 | no fix |\n";
        assert_eq!(of("recordings", text).as_deref(), Some(expected));
        let budgets = "| what | measured | budget | |\n|---|---:|---:|---|\n| x | 1 | 2 | within |\n";
        let expected = "| what | measured | budget |\n|---|---:|---:|\n| x | 1 | 2 |\n";
        assert_eq!(of("budgets", budgets).as_deref(), Some(expected));
    }

    #[test]
    fn the_first_or_the_last_of_two_tables_is_taken() {
        let text = "| a |\n|---|\n| 1 |\n\n| b |\n|---|\n| 2 |\n";
        assert_eq!(of("rooms", text).as_deref(), Some("| a |\n|---|\n| 1 |\n"));
        assert_eq!(of("beacons by path loss", text).as_deref(), Some("| b |\n|---|\n| 2 |\n"));
    }

    #[test]
    fn what_was_printed_stands_beside_its_method() {
        let text = "| RMSE | all | 3 DDP |\n|--|--:|--:|\n| `lls` | 0.7 | 0.8 |\n| as printed | 0.6 | 0.9 |\n| `robust` | 0.2 | 0.3 |\n";
        let expected =
            "| method | RMSE, m | as printed, m |\n|---|---:|---:|\n| `lls` | 0.7 | 0.6 |\n| `robust` | 0.2 |  |\n";
        assert_eq!(of("thesis", text).as_deref(), Some(expected));
    }

    #[test]
    fn methods_of_two_chips_are_in_one_table() {
        let table = |first: u32| {
            format!(
                "| m | 4 | 8 | s | code |\n|---|---|---|---|---|\n| `lls` | 1 | {first} | 9 | 30 |\n| all | | | | 99 |\n\n"
            )
        };
        let text = format!("### A\n\nnote\n\n{}{}### B\n\nnote\n\n{}{}", table(2), table(3), table(4), table(5));
        let expected = "| method | A: 2D | 3D | B: 2D | 3D | code, 2D, bytes |\n|---|---:|---:|---:|---:|---:|\n\
                        | `lls` | 2 | 3 | 4 | 5 | 30 |\n";
        assert_eq!(of("cost on the chip", &text).as_deref(), Some(expected));
    }

    #[test]
    fn what_is_only_printed_has_no_extract() {
        assert_eq!(of("libraries", "| a |\n"), None);
        assert_eq!(of("tracks", "as it is").as_deref(), Some("as it is"));
    }
}
