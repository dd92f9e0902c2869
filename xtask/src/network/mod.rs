//! `cargo xtask qemu network`: a tag and its anchors as images in QEMU, on simulated DW1000s, beside `baliza simulate`.
//!
//! The simulation takes the cost of a node's code from a table. Here the code itself runs, as compiled for each chip,
//! and its instructions are counted. Clock, cycles an instruction, and the times of bus and interrupts are the same
//! in both.

mod figures;
mod guest;
mod log;
mod node;
mod scene;
mod steps;

use anyhow::{Result, ensure};
use dw1000_sim::BoardProfile;
use sim::scenario::{AirModel, Scenario};

use crate::chip::Chip;
use crate::firmware;
use figures::Figures;
use node::Work;
use scene::{Images, Lived, NetworkRun};

/// The arguments of `cargo xtask qemu network`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Simulated time, seconds.
    #[arg(long, default_value_t = 3.0)]
    seconds: f64,
    /// Only this board: dwm1001, evk1000 or esp32c3.
    #[arg(long)]
    board: Option<String>,
    /// Make the processors slower by this factor.
    #[arg(long, default_value_t = 1.0)]
    cpu_slowdown: f64,
    /// Print what the instructions of the tag and of the first anchor went to.
    #[arg(long)]
    steps: bool,
    /// How far images and simulation may be apart, in percent.
    #[arg(long, default_value_t = 10.0)]
    tolerance: f64,
    /// Write what the images report in their first second beside their boards, in boards/*/expected.
    #[arg(long, conflicts_with = "cpu_slowdown")]
    document: bool,
}

/// Runs images and simulation, and compares them.
///
/// # Errors
/// A build or a run fails, there is no such board, or the figures differ by more than the tolerance.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut disagreements = Vec::new();
    let mut ran = false;
    for chip in Chip::SIMULATED {
        let board = match chip {
            Chip::CortexM4F => BoardProfile::DWM1001,
            Chip::CortexM3 => BoardProfile::EVB1000,
            Chip::RiscV32 => BoardProfile::ESP32C3,
        };
        if arguments.board.as_ref().is_some_and(|wanted| wanted != board.name) {
            continue;
        }
        ran = true;
        let scenario = Scenario {
            seconds: arguments.seconds,
            // Rates are compared, not errors.
            air: AirModel::Ideal,
            board: board.slowed(arguments.cpu_slowdown),
            ..Scenario::rooms(4, 1)
        };
        let images = Images {
            tag: firmware::elf(&format!("tag-wired-{}", chip.name()))?,
            anchor: firmware::elf(&format!("anchor-wired-{}", chip.name()))?,
        };
        let outcome = scene::run(chip, &images, &scenario)?;
        // Slower processors report the same later.
        if arguments.cpu_slowdown == 1.0 {
            logs(chip, &outcome, arguments.document, &mut disagreements)?;
        }
        let (images, simulation) = (Figures::of_images(&outcome, scenario.seconds), Figures::of_simulation(&scenario));
        println!("\n{} as {}, {} s\n", chip.title(), board.name, scenario.seconds);
        println!("{}\n{}", images.table(&simulation), spent(&outcome));
        if arguments.steps {
            for (role, lives) in [("tag", &outcome.tags), ("anchor", &outcome.anchors)] {
                let tables = lives.first().map(|Lived { life, .. }| life.steps.table());
                println!("Instructions of the {role}:\n{}", tables.unwrap_or_default());
            }
        }
        let found = images.disagreements(&simulation, arguments.tolerance / 100.0);
        disagreements.extend(found.into_iter().map(|what| format!("{}: {what}", chip.title())));
    }
    ensure!(ran, "there are images for dwm1001, evk1000 and esp32c3");
    ensure!(
        disagreements.is_empty(),
        "images and simulation, or images and what is expected of them, do not agree:\n{}",
        disagreements.join("\n")
    );
    println!("images and simulation agree within {} %", arguments.tolerance);
    Ok(())
}

/// Writes or compares what a tag and the first anchor report.
fn logs(chip: Chip, outcome: &NetworkRun, document: bool, disagreements: &mut Vec<String>) -> Result<()> {
    for (role, lives) in [("tag", &outcome.tags), ("anchor", &outcome.anchors)] {
        let Some(Lived { life, .. }) = lives.first() else { continue };
        let (image, log) = (format!("{role}-wired-{}", chip.name()), log::text(life));
        if document {
            firmware::expected::write_log(&image, &log)?;
        } else {
            disagreements.extend(firmware::expected::log_complaint(&image, &log)?);
        }
    }
    Ok(())
}

/// A table of where the images' instructions are spent.
fn spent(outcome: &NetworkRun) -> String {
    let mut text = String::new();
    let mut messages = 0;
    for (role, lives) in [("tag", &outcome.tags), ("anchor", &outcome.anchors)] {
        for Lived { life, .. } in lives {
            let Work { messages: asked, transactions, ranging, background, .. } = life.work;
            messages += asked;
            let frames = life.frames();
            let each = |count: u64, of: u64| count.checked_div(of).unwrap_or(0);
            text += &format!(
                "{role}: {transactions} transactions, {frames} frames; instructions of ranging {} a transaction, {} a frame; of the rest {} a frame; {} rounds dropped\n",
                each(ranging, transactions),
                each(ranging, frames),
                each(background, frames),
                life.rounds_dropped(),
            );
        }
    }
    let rate = messages as f64 / outcome.took.as_secs_f64();
    text + &format!("{messages} messages in {:.1} s: {rate:.0} a second\n", outcome.took.as_secs_f64())
}
