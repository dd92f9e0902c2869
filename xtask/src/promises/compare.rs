//! What documents print beside what is measured: number by number, with the text between them.

/// A cell or a sentence that is not as promised.
#[derive(Clone, Debug, PartialEq)]
pub struct CellDifference {
    /// The row, and the column. Empty for a whole table or a sentence.
    pub row: String,
    pub column: String,
    /// What the document prints.
    pub promised: String,
    /// What was measured.
    pub measured: String,
    /// What is wrong about it.
    pub why: String,
}

/// How a column is compared: how far it may be off, percent; `None`: not at all.
pub type ToleranceOf<'t> = &'t dyn Fn(&str) -> Option<f64>;

/// A number in a text, with its unit in the last place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Number {
    value: f64,
    unit: f64,
}

/// The numbers of a text, and the text between them.
fn parts(text: &str) -> (Vec<Number>, String) {
    let (mut numbers, mut between) = (Vec::new(), String::new());
    let mut rest = text;
    let mut last = ' ';
    while let Some(first) = rest.chars().next() {
        let is_inside_word = last.is_alphanumeric() || matches!(last, '_' | '-' | '−' | '.');
        match number_at(rest).filter(|_| !is_inside_word) {
            Some((number, length)) => {
                numbers.push(number);
                between.push('#');
                last = '0';
                rest = &rest[length..];
            }
            None => {
                between.push(first);
                last = first;
                rest = &rest[first.len_utf8()..];
            }
        }
    }
    (numbers, between)
}

/// The number at the beginning of a text, and its length in bytes: a sign, digits in groups of three or not, a point
/// and digits.
fn number_at(text: &str) -> Option<(Number, usize)> {
    let unsigned = text.strip_prefix(['-', '−', '+']).unwrap_or(text);
    let is_negative = unsigned.len() < text.len() && !text.starts_with('+');
    let digits = |text: &str| text.bytes().take_while(u8::is_ascii_digit).count();
    let mut length = digits(unsigned);
    if length == 0 {
        return None;
    }
    while unsigned[length..].starts_with(',') && digits(&unsigned[length + 1..]) == 3 {
        length += 4;
    }
    let mut places = 0;
    if unsigned[length..].starts_with('.') {
        places = digits(&unsigned[length + 1..]);
        length += if places > 0 { 1 + places } else { 0 };
    }
    let value: f64 = unsigned[..length].replace(',', "").parse().ok()?;
    let unit = 10_f64.powi(-i32::try_from(places).ok()?);
    Some((Number { value: if is_negative { -value } else { value }, unit }, text.len() - unsigned.len() + length))
}

/// The first number of a text.
pub fn first_number(text: &str) -> Option<f64> {
    parts(text).0.first().map(|number| number.value)
}

/// The length of the number at the beginning of a text, bytes.
pub fn number_length(text: &str) -> Option<usize> {
    number_at(text).map(|(_, length)| length)
}

/// Why a text is not as promised: another number, or other words. A number may be off by this percentage, and by one in
/// its last place.
pub fn why(promised: &str, measured: &str, tolerance_percent: f64) -> Option<String> {
    let ((old, old_words), (new, new_words)) = (parts(promised), parts(measured));
    if old_words != new_words {
        return Some("it reads otherwise".to_owned());
    }
    let off = |(old, new): (&Number, &Number)| {
        let allowed = (tolerance_percent / 100.0 * old.value.abs()).max(old.unit) * (1.0 + 1e-9);
        let by = (new.value - old.value).abs();
        (by > allowed).then(|| match old.value {
            0.0 => format!("{by} off"),
            value => format!("{:.1} % off, {tolerance_percent} % allowed", 100.0 * by / value.abs()),
        })
    };
    old.iter().zip(&new).find_map(off)
}

/// A table's rows of cells, without the line below the titles.
pub fn rows(table: &str) -> Vec<Vec<&str>> {
    let rows = table.lines().filter_map(|line| line.strip_prefix('|')?.strip_suffix('|'));
    let cells = rows.map(|row| row.split('|').map(str::trim).collect::<Vec<_>>());
    cells.filter(|cells| !cells.iter().all(|cell| cell.starts_with("---"))).collect()
}

/// All that differs between a document's tables and the measured ones. Each column has its tolerance.
pub fn tables(promised: &str, measured: &str, tolerance: ToleranceOf<'_>) -> Vec<CellDifference> {
    let whole = |why: String| {
        let [row, column, promised, measured] = [const { String::new() }; 4];
        vec![CellDifference { row, column, promised, measured, why }]
    };
    let (old, new) = (rows(promised), rows(measured));
    let titles = |rows: &[Vec<&str>]| rows.first().map(|row| row.join(" | ")).unwrap_or_default();
    if titles(&old) != titles(&new) {
        return whole(format!("its columns are {}", titles(&new)));
    }
    if old.len() != new.len() {
        return whole(format!("it has {} rows, not {}", new.len().saturating_sub(1), old.len().saturating_sub(1)));
    }
    let columns = old.first().cloned().unwrap_or_default();
    let mut differences = Vec::new();
    for (old, new) in old.iter().zip(&new).skip(1) {
        let row = old.first().copied().unwrap_or_default();
        if new.first() != old.first() || new.len() != old.len() {
            return whole(format!("its row {row} is {}", new.join(" | ")));
        }
        for ((column, promised), measured) in columns.iter().zip(old).zip(new).skip(1) {
            let Some(percent) = tolerance(column) else { continue };
            if let Some(why) = why(promised, measured, percent) {
                let [row, column, promised, measured] = [row, column, promised, measured].map(str::to_owned);
                differences.push(CellDifference { row, column, promised, measured, why });
            }
        }
    }
    differences
}

/// The measured tables with the document's cell wherever `keeps` says so of a column and the cell is within its
/// tolerance: what depends on the machine's speed changes each time, and a document that is remade should show what the
/// code has changed.
pub fn keeping(promised: &str, measured: &str, keeps: &dyn Fn(&str) -> bool, tolerance: ToleranceOf<'_>) -> String {
    let (old, new) = (rows(promised), rows(measured));
    let titles = new.first().cloned().unwrap_or_default();
    let places = titles.iter().map(|title| old.first().and_then(|titles| titles.iter().position(|old| old == title)));
    let places: Vec<Option<usize>> = places.collect();
    let mut text = String::new();
    for line in measured.lines() {
        let cells: Option<Vec<&str>> =
            line.strip_prefix('|').and_then(|line| line.strip_suffix('|')).map(|row| row.split('|').collect());
        let kept = cells.filter(|cells| cells.len() == titles.len()).and_then(|cells| {
            let name = cells.first()?.trim();
            Some((cells, old.iter().skip(1).find(|row| row.first() == Some(&name))?))
        });
        match kept {
            Some((cells, old)) => {
                text.push('|');
                for ((column, cell), place) in titles.iter().zip(cells).zip(&places) {
                    let stays = |old: &&&str| {
                        keeps(column)
                            && tolerance(column).is_some_and(|percent| why(old, cell.trim(), percent).is_none())
                    };
                    let old = place.and_then(|place| old.get(place)).filter(stays);
                    text += &old.map_or_else(|| format!("{cell}|"), |old| format!(" {old} |"));
                }
            }
            None => text += line,
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_with_signs_groups_and_points() {
        let values = |text: &str| parts(text).0.iter().map(|number| number.value).collect::<Vec<_>>();
        assert_eq!(values("0.012, 0.092"), [0.012, 0.092]);
        assert_eq!(values("4,039 of 1,000,000"), [4039.0, 1_000_000.0]);
        assert_eq!(values("0.132 (-10 %), −3.5 dB"), [0.132, -10.0, -3.5]);
        assert_eq!(values("`b-wls-r` 2D nRF52832 w5nn."), [2.0]);
        assert_eq!(parts("24 %; 3.7").1, "# %; #");
    }

    #[test]
    fn a_number_may_be_off_by_its_tolerance_or_its_last_place() {
        assert_eq!(why("397", "386", 3.0), None);
        assert_eq!(why("397", "384", 3.0).as_deref(), Some("3.3 % off, 3 % allowed"));
        // 0.012 to 0.013 is 8 %, but one in the last place.
        assert_eq!(why("0.012, 0.092", "0.013, 0.092", 3.0), None);
        assert!(why("0.012, 0.092", "0.124, 0.197", 3.0).is_some());
        assert!(why("0.5", "no fix", 3.0).is_some());
        assert_eq!(why("20.5 years", "20.9 years", 3.0), None);
        assert!(why("0", "2", 3.0).is_some());
    }

    const OLD: &str = "| what | rate | speed |\n|---|---:|---:|\n| a | 100 | 30.0 |\n| b | 50 | 10.0 |\n";

    #[test]
    fn each_cell_is_compared_in_its_column() {
        let new = OLD.replace("| 100 | 30.0 |", "| 90 | 99.0 |");
        let rate_only = |column: &str| (column == "rate").then_some(3.0);
        let differences = tables(OLD, &new, &rate_only);
        let [only] = &differences[..] else { panic!("{differences:?}") };
        assert_eq!((only.row.as_str(), only.column.as_str(), only.measured.as_str()), ("a", "rate", "90"));
        assert_eq!(tables(OLD, &new, &|_| Some(3.0)).len(), 2);
    }

    #[test]
    fn rows_and_columns_that_come_or_go_are_told() {
        let why = |new: &str| tables(OLD, new, &|_| Some(3.0)).remove(0).why;
        assert_eq!(why(&OLD.replace("| b | 50 | 10.0 |\n", "")), "it has 1 rows, not 2");
        assert_eq!(why(&OLD.replace("rate", "pace")), "its columns are what | pace | speed");
        assert_eq!(why(&OLD.replace("| b |", "| c |")), "its row b is c | 50 | 10.0");
    }

    #[test]
    fn what_the_machine_determines_stays_within_its_tolerance() {
        let new = "| what | rate | speed |\n|---|---:|---:|\n| a | 101 | 33.0 |\n| b | 50 | 19.0 |\n";
        let kept = keeping(OLD, new, &|column| column == "speed", &|_| Some(50.0));
        assert_eq!(kept, new.replace("33.0", "30.0"));
        // A column comes between.
        let wider = new.replace("| speed |", "| new | speed |").replace("| 33.0 |", "| 7 | 33.0 |");
        let wider = wider.replace("---:|\n", "---:|---:|\n").replace("| 19.0 |", "| 8 | 19.0 |");
        let kept = keeping(OLD, &wider, &|column| column == "speed", &|_| Some(50.0));
        assert_eq!(kept, wider.replace("33.0", "30.0"));
    }
}
