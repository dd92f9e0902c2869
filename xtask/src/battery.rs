//! Current drawn by a tag and life of its battery: runs `baliza simulate` and makes a table of the results.

use anyhow::Result;
use baliza_report::MarkdownTable;
use serde::Deserialize;

use crate::baliza::result;
use crate::bench::Made;

/// The part of the output of `baliza simulate --json` that the table needs.
#[derive(Clone, Copy, Debug, Deserialize)]
struct Summary {
    tag_mean_current_ma: f64,
    charge_per_fix_uc: Option<f64>,
    tag_currents_ma: Currents,
    p50_m: Option<f64>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct Currents {
    receiving: f64,
    sending: f64,
    idle: f64,
    waking: f64,
    sleeping: f64,
    processor: f64,
    motion_sensor: f64,
    board: f64,
}

/// The mode of the tag, the arguments, and the current of PANS in the same mode (measured by users of the module).
const ROWS: [[&str; 3]; 5] = [
    ["10 rounds a second", "--scenario examples/battery.toml --rate 10", "2.23"],
    ["1 a second", "--scenario examples/battery.toml --rate 1 --seconds 3600", "about 0.22"],
    ["1 in 10 seconds", "--scenario examples/battery.toml --rate 0.1 --seconds 7200", "0.01"],
    ["lying still", "--scenario examples/battery-still.toml", "0.015"],
    ["out of its network", "--scenario examples/battery-searching.toml", "1.3"],
];
/// Batteries, mAh.
const CR2477_MAH: f64 = 1000.0;
const LIPO_MAH: f64 = 500.0;

/// Currents and battery lives.
///
/// # Errors
/// A run of `baliza` fails.
pub fn lives() -> Result<Option<Made>> {
    let mut table = MarkdownTable::new([
        "a tag",
        "`baliza simulate …`",
        "mA:",
        "of it receiving, sending, idle, starting, asleep; processor, board, µA",
        "µC a position:",
        "error P50, m:",
        "CR2477, 1000 mAh:",
        "LiPo, 500 mAh:",
        "PANS, mA:",
    ]);
    for [what, arguments, others] in ROWS {
        let summary: Summary = result(["simulate", "--json"].into_iter().chain(arguments.split(' ')))?;
        table.row(format_args!("{}", row(what, arguments, others, &summary)));
    }
    Ok(Made::one("battery", table.into_text()))
}

fn row(what: &str, arguments: &str, others: &str, summary: &Summary) -> String {
    let Currents { receiving, sending, idle, waking, sleeping, processor, motion_sensor, board } =
        summary.tag_currents_ma;
    let micro = |ma: f64| format!("{:.1}", 1e3 * ma);
    let radio = [receiving, sending, idle, waking, sleeping].map(micro).join(", ");
    let [processor, board] = [processor, board + motion_sensor].map(micro);
    let current = summary.tag_mean_current_ma;
    format!(
        "{what} | `{arguments}` | {current:.3} | {radio}; {processor}, {board} | {} | {} | {} | {} | {others}",
        summary.charge_per_fix_uc.map_or_else(|| "–".to_owned(), |charge| format!("{charge:.0}")),
        summary.p50_m.map_or_else(|| "–".to_owned(), |metres| format!("{metres:.3}")),
        life(CR2477_MAH / current),
        life(LIPO_MAH / current),
    )
}

/// A number of hours as text.
fn life(hours: f64) -> String {
    let days = hours / 24.0;
    if days < 100.0 { format!("{days:.0} days") } else { format!("{:.1} years", days / 365.25) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_currents_and_what_batteries_last() {
        let currents = Currents {
            receiving: 0.16,
            sending: 0.014,
            idle: 0.01,
            waking: 0.0098,
            sleeping: 0.00005,
            processor: 0.004,
            motion_sensor: 0.0005,
            board: 0.0015,
        };
        let summary = Summary {
            tag_mean_current_ma: 0.2,
            charge_per_fix_uc: Some(200.4),
            tag_currents_ma: currents,
            p50_m: None,
        };
        // 1000 mAh / 0.2 mA = 5000 h = 208 days = 0.57 years; half of it 104 days = 0.29 years.
        let expected =
            "one | `--rate 1` | 0.200 | 160.0, 14.0, 10.0, 9.8, 0.1; 4.0, 2.0 | 200 | – | 0.6 years | 0.3 years | 0.22";
        assert_eq!(row("one", "--rate 1", "0.22", &summary), expected);
        assert_eq!(life(240.0), "10 days");
    }
}
