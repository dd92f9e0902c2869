//! `cargo xtask qemu tag`: the tag's images for boards without hardware run in QEMU, on both cores. They must find
//! the same positions as the same app on a desktop, once by a track, and once by B-WLS for each round by itself. The
//! positions must agree to the last bit; a digest in the log shows that.
//!
//! The output of the images on RTT's channels is written to files; `baliza monitor` reads log and telemetry from them
//! as from a probe.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use wire::config::Solver;
use wire::telemetry::{Decoder, Message};

use crate::chip::Chip;
use crate::{cargo, firmware, qemu, target_directory};

/// The solvers of the tag, one run after the other.
const SOLVERS: [Solver; 2] = [Solver::Track, Solver::BWls];
/// Greatest accepted difference between the positions of a core and of the desktop, metres.
const SAME_M: f64 = 0.001;
/// Least number of positions: the tag ranges twenty times a second for five seconds.
const LEAST_FIXES: usize = 90;

/// Runs both images and compares them with the desktop.
///
/// # Errors
/// A build or a run fails, or the results differ.
pub fn run() -> Result<()> {
    let references = SOLVERS.iter().map(|solver| desktop(*solver)).collect::<Result<Vec<_>>>()?;
    for chip in Chip::ALL {
        let name = match chip {
            Chip::CortexM4F => "tag-simulated-arm",
            Chip::RiscV32 => "tag-simulated-riscv",
            // It would repeat the test of the other Cortex-M.
            Chip::CortexM3 => continue,
        };
        let elf = firmware::elf(name)?;
        let directory = directory().join(name);
        fs::create_dir_all(&directory).with_context(|| format!("cannot make {}", directory.display()))?;
        for (solver, reference) in SOLVERS.into_iter().zip(&references) {
            qemu::run_in(chip, &elf, &directory, solver.name())?;
            println!("\n{}, {}: log and positions", chip.title(), solver.name());
            let agreement = examine(&elf, &directory, solver, reference);
            println!("{}, {}: {}", chip.title(), solver.name(), agreement.with_context(|| chip.title())?);
        }
    }
    Ok(())
}

/// Compares the files that an image left in its directory with the desktop's results; returns a text where they
/// agree.
fn examine(elf: &Path, directory: &Path, solver: Solver, reference: &Life) -> Result<String> {
    let (log, telemetry) = (directory.join("tag-simulated.defmt"), directory.join("tag-simulated.telemetry"));
    let log = show(elf, &telemetry, &log)?;
    let messages = messages(&telemetry)?;
    let (lines, expected) =
        (log.iter().filter(|line| is_position_by(line, solver)).count(), positions_in_log(&messages));
    ensure!(lines == expected, "the log has {lines} positions by {}, not {expected}", solver.name());
    let agreement = compare(&messages, &reference.messages)?;
    let digest = log.iter().find_map(|line| digest_in(line)).context("the log has no digest")?;
    ensure!(digest == reference.digest, "digest {digest}, on the desktop {}: not the same bits", reference.digest);
    Ok(format!("{agreement}; digest {digest} of all their bits, the desktop's"))
}

/// Whether a line of the log is a position that this solver made.
fn is_position_by(line: &str, solver: Solver) -> bool {
    line.contains("fix x=") && line.split(", ").any(|part| part.split_whitespace().next() == Some(solver.name()))
}

/// The digest in a line.
fn digest_in(line: &str) -> Option<&str> {
    line.split_once("digest ")?.1.split_whitespace().next()
}

/// The record of a tag's run on the desktop.
struct Life {
    messages: Vec<Message>,
    digest: String,
}

/// Time from one round's line in the log to the next one's, microseconds: at most 25 a second.
const LINE_US: u64 = 40_000;

/// The folder of the channels' files.
fn directory() -> PathBuf {
    target_directory().join("qemu")
}

/// The telemetry of the app on a desktop.
fn desktop(solver: Solver) -> Result<Life> {
    let file = directory().join("desktop.telemetry");
    fs::create_dir_all(directory()).with_context(|| format!("cannot make {}", directory().display()))?;
    println!("running the tag on the desktop, by {}", solver.name());
    let mut command = cargo();
    command.args(["run", "--quiet", "--package", "firmware-tag", "--example", "simulated", "--"]);
    let output = command.arg(&file).arg(solver.name()).output().context("cannot run cargo")?;
    ensure!(output.status.success(), "the tag: {}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8(output.stdout).context("the tag prints no text")?;
    let digest = digest_in(&said).context("the tag prints no digest")?.to_owned();
    Ok(Life { messages: messages(&file)?, digest })
}

/// Prints the lines of the log, and returns them.
fn show(elf: &Path, telemetry: &Path, log: &Path) -> Result<Vec<String>> {
    let mut command = cargo();
    command.args([
        "run",
        "--quiet",
        "--package",
        "host-tools",
        "--features",
        "defmt",
        "--bin",
        "baliza",
        "--",
        "monitor",
        "--format",
        "jsonl",
    ]);
    command.arg("--elf").arg(elf).arg("--file").arg(telemetry).arg("--defmt-file").arg(log);
    let output = command.output().context("cannot run cargo")?;
    ensure!(output.status.success(), "baliza monitor: {}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).context("baliza monitor prints no text")?;
    let said = text.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let lines = said.filter(|said| said["type"] == "log").filter_map(|said| said["text"].as_str().map(str::to_owned));
    let logged: Vec<String> = lines.collect();
    logged.iter().for_each(|line| println!("{line}"));
    Ok(logged)
}

/// All messages of a file; an error where the file contains something else.
fn messages(file: &Path) -> Result<Vec<Message>> {
    let bytes = fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut decoder = Decoder::new();
    let decoded = bytes.into_iter().filter_map(|byte| decoder.feed(byte));
    decoded.map(|message| message.with_context(|| format!("{} is torn", file.display()))).collect()
}

/// The number of positions with a line in the log. Rounds that are nearer to each other than [`LINE_US`] share one
/// line.
fn positions_in_log(messages: &[Message]) -> usize {
    let (mut last_us, mut positions) = (None, 0);
    for message in messages {
        let Message::Fix(fix) = message else { continue };
        if last_us.is_none_or(|last_us| fix.t_us >= last_us + LINE_US) {
            last_us = Some(fix.t_us);
            positions += usize::from(fix.position_m().is_some());
        }
    }
    positions
}

/// Compares message by message; returns a text where they agree.
fn compare(messages: &[Message], reference: &[Message]) -> Result<String> {
    ensure!(messages.len() == reference.len(), "{} messages, on the desktop {}", messages.len(), reference.len());
    let (mut farthest_m, mut equal, mut positions) = (0.0_f64, 0, 0);
    for (place, (ours, theirs)) in messages.iter().zip(reference).enumerate() {
        ensure!(
            ours.kind() == theirs.kind(),
            "message {place} is a {}, on the desktop a {}",
            ours.kind(),
            theirs.kind()
        );
        equal += usize::from(ours == theirs);
        let (Message::Fix(ours), Message::Fix(theirs)) = (ours, theirs) else { continue };
        ensure!((ours.round, ours.t_us) == (theirs.round, theirs.t_us), "rounds {} and {}", ours.round, theirs.round);
        match (ours.position_m(), theirs.position_m()) {
            (Some(a), Some(b)) => {
                let apart_m = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
                ensure!(apart_m <= SAME_M, "round {}: {apart_m} m from the desktop's position", ours.round);
                farthest_m = farthest_m.max(apart_m);
                positions += 1;
            }
            (None, None) => ensure!(ours.reason() == theirs.reason(), "round {}: another reason", ours.round),
            (Some(_), None) | (None, Some(_)) => anyhow::bail!("round {}: one has a position", ours.round),
        }
    }
    ensure!(positions >= LEAST_FIXES, "{positions} positions");
    let other = messages.len() - equal;
    Ok(format!(
        "{positions} positions, at most {:.1} mm from the desktop's; of {} messages {other} differ (the build id)",
        1000.0 * farthest_m,
        messages.len()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::{Fix, Outcome, SolveError};

    fn fix(x: i32) -> Message {
        let outcome = Outcome::Position {
            position_tenth_mm: [x, 0, 0],
            deviation_tenth_mm: [1; 3],
            correlation_127ths: [0; 3],
            used: 0b1111,
            quality_255ths: 255,
        };
        Message::Fix(Fix { t_us: 0, round: 0, age_us: 0, asked: 4, outcome, solver: wire::telemetry::Solver::Track })
    }

    #[test]
    fn a_millimetre_is_the_same_and_more_is_not() {
        let reference = vec![fix(0); LEAST_FIXES];
        let mut ours = reference.clone();
        // In units of 0.1 mm.
        ours[3] = fix(10);
        let agreement = compare(&ours, &reference).unwrap();
        assert!(
            agreement.starts_with("90 positions, at most 1.0 mm") && agreement.contains(" 1 differ"),
            "{agreement}"
        );
        ours[3] = fix(11);
        assert!(compare(&ours, &reference).is_err());
    }

    #[test]
    fn of_rounds_that_follow_each_other_closely_the_log_has_the_first() {
        let at = |t_us| {
            let Message::Fix(fix) = fix(0) else { unreachable!("a fix") };
            Message::Fix(Fix { t_us, ..fix })
        };
        assert_eq!(positions_in_log(&[0, 10_000, 39_999, 40_000, 100_000].map(at)), 3);
    }

    #[test]
    fn a_line_of_the_log_names_its_solver() {
        let line = "fix x=3.21 y=-0.05 z=1.50 ±0.06 m, 6 anchors, 12 ms, b-wls";
        assert!(is_position_by(line, Solver::BWls) && !is_position_by(line, Solver::BWlsR));
        assert!(!is_position_by(line, Solver::Track));
        assert_eq!(digest_in("digest 00ff, and more"), Some("00ff,"));
    }

    #[test]
    fn a_position_more_or_less_is_not_the_same() {
        let reference = vec![fix(0); LEAST_FIXES + 1];
        assert!(compare(&reference[1..], &reference).is_err());
        let mut ours = reference.clone();
        let Message::Fix(last) = &mut ours[LEAST_FIXES] else { unreachable!("a fix") };
        last.outcome = Outcome::Reason(SolveError::Diverged);
        assert!(compare(&ours, &reference).is_err());
        assert!(compare(&reference[..LEAST_FIXES - 1], &reference[..LEAST_FIXES - 1]).is_err());
    }
}
