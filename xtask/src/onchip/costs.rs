//! Costs of a node's code in instructions: the image `costs` on every kind of processor. Makes the table
//! `sim/src/costs.csv`, which simulations read, and the same table for people.

use baliza_report::MarkdownTable;
use std::fmt::Write as _;

use anyhow::{Context, Result, ensure};

use super::run;
use super::tables::grouped;
use crate::chip::Chip;
use crate::promises::Made;
use crate::toolchain::Toolchain;

/// The file that simulations read.
const FILE: &str = "sim/src/costs.csv";

/// Descriptions of the rows, for the document.
const ROWS: [(&str, &str); 34] = [
    ("executor.wake", "executor and node's loop: from the interrupt handler's word to what the task waited for"),
    ("driver.transaction", "driver: a transaction, beside the bus's own code"),
    ("driver.now", "the clock is read"),
    ("driver.send-now", "sending at once, up to the wait"),
    ("driver.send-at", "sending at an instant, up to the wait"),
    ("driver.sent", "sent, from the interrupt on"),
    ("driver.receive-begin", "receiving, up to the wait"),
    ("driver.receive-go-on", "the same with the receiver on"),
    ("driver.receive-frame", "a frame, from the interrupt on, with its diagnostics"),
    ("driver.receive-timeout", "the end of a window, from the interrupt on"),
    ("driver.idle", "switching off what is off"),
    ("machine.poll-made", "machine: a tag makes a poll"),
    ("machine.poll-answered", "an anchor answers a poll"),
    ("machine.response-received", "a tag makes a range of a response"),
    ("machine.round-ended", "the same of the last"),
    ("machine.beacon-received", "a beacon is taken in"),
    ("machine.beacon-made", "an anchor makes a beacon"),
    ("machine.overheard", "a frame for somebody else is left alone"),
    ("machine.scheduled", "the next window or wait is chosen"),
    ("code.made", "the code of a frame with a key (four blocks), without the cipher"),
    ("code.in-software", "the same with AES in software"),
    ("tag.handover", "tag: a round goes to the engine"),
    ("tag.track-plane-4", "engine: a round of 4 ranges, in the plane, and its position published"),
    ("tag.track-plane-8", "of 8"),
    ("tag.track-space-4", "of 4, in space"),
    ("tag.track-space-8", "of 8"),
    ("tag.solve-plane-4", "`robust` alone: a round of 4 ranges, in the plane"),
    ("tag.solve-plane-8", "of 8"),
    ("tag.solve-space-4", "of 4, in space"),
    ("tag.solve-space-8", "of 8"),
    ("tag.publish-range", "a range, published with it"),
    ("tag.line", "a line of the log"),
    ("tag.features", "features of an impulse response"),
    ("tag.advert", "a beacon's advertisement"),
];

/// Measures, and makes the table for simulations and that of the document.
///
/// # Errors
/// An image cannot be built or run, or its rows are not the expected ones.
pub fn made() -> Result<Made> {
    let columns = Chip::SIMULATED.into_iter().map(measure).collect::<Result<Vec<_>>>()?;
    let mut table = String::from("what");
    for chip in Chip::SIMULATED {
        write!(table, ",{}", column(chip))?;
    }
    let titles = Chip::SIMULATED.into_iter().map(|chip| format!("{}:", chip.title()));
    let mut document = MarkdownTable::new(std::iter::once("instructions".to_owned()).chain(titles));
    for (name, title) in ROWS {
        write!(table, "\n{name}")?;
        let mut cells = Vec::new();
        for costs in &columns {
            let (_, instructions) =
                costs.iter().find(|(what, _)| what == name).with_context(|| format!("no {name} was measured"))?;
            write!(table, ",{instructions}")?;
            cells.push(grouped(u64::from(*instructions)));
        }
        document.row(format_args!("{title} | {}", cells.join(" | ")));
    }
    table.push('\n');
    for costs in &columns {
        ensure!(costs.len() == ROWS.len(), "the image measures what the table has no row for");
    }
    Ok(Made { files: vec![(FILE.into(), table)], ..Made::one("costs", document.into_text()) })
}

/// Builds and runs the image.
fn measure(chip: Chip) -> Result<Vec<(String, u32)>> {
    Ok(run(&Toolchain::find(chip.target())?, chip, "costs", "image,costs")?.costs)
}

/// The name of a processor in the table.
fn column(chip: Chip) -> &'static str {
    match chip {
        Chip::CortexM4F => "cortex-m4f",
        Chip::CortexM3 => "cortex-m3",
        Chip::RiscV32 => "riscv32",
    }
}
