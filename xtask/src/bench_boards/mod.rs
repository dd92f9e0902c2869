//! `cargo xtask bench-boards --dut FOLDER`: the steps of `docs/use/hardware.md` as a program, for boards on a desk.
//!
//! The folder has `site.toml`, as `baliza provision` reads it, and one `*.toml` a board ([`dut::BoardUnderTest`]). Each step
//! flashes, provisions or listens by commands of `baliza`, holds what they print against its criterion, and gives a
//! verdict with figures. What no program can do (a meter, a button, a hand) is printed as a task for a person.

mod dut;
mod heard;
mod steps;

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use baliza_report::MarkdownTable;

use crate::baliza;
use dut::Desk;
use steps::{BenchStep, STEPS, StepVerdict};

/// The arguments of `cargo xtask bench-boards`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The folder with site.toml and one TOML file a board
    #[arg(long, value_name = "FOLDER")]
    dut: PathBuf,
    /// List what would be done, and do nothing
    #[arg(long)]
    dry_run: bool,
    /// Only these steps, by their numbers in docs/use/hardware.md
    #[arg(long, value_name = "N", value_delimiter = ',')]
    steps: Vec<u8>,
    /// Write the report into this file, too
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

/// Runs commands of `baliza`.
trait Commands {
    /// The standard output of a command; an error with what it says otherwise.
    ///
    /// # Errors
    /// It cannot be started, or fails.
    fn run(&mut self, words: &[String]) -> Result<String>;
}

/// The program itself.
struct Program(PathBuf);

impl Commands for Program {
    fn run(&mut self, words: &[String]) -> Result<String> {
        let output = Command::new(&self.0).args(words).output().context("cannot run baliza")?;
        let said = String::from_utf8_lossy(&output.stderr);
        ensure!(output.status.success(), "baliza {}: {}", words.join(" "), said.trim_end());
        Ok(String::from_utf8(output.stdout)?)
    }
}

/// Goes through the steps, one after the other.
///
/// # Errors
/// A file of the folder is wrong, or a step fails; after all have been tried.
pub fn run(arguments: &Arguments) -> Result<()> {
    let desk = Desk::read(&arguments.dut)?;
    let is_wanted = |step: &&BenchStep| arguments.steps.is_empty() || arguments.steps.contains(&step.number);
    let chosen: Vec<&BenchStep> = STEPS.iter().filter(is_wanted).collect();
    ensure!(!chosen.is_empty(), "there are steps 1 to {}", STEPS.len());
    if arguments.dry_run {
        print!("{}", plan(&desk, &chosen));
        return Ok(());
    }
    let verdicts = go(&desk, &chosen, &mut Program(baliza::binary()?), |line| eprintln!("{line}"));
    let report = report(&desk, &verdicts);
    println!("{report}");
    if let Some(file) = &arguments.report {
        std::fs::write(file, &report).with_context(|| format!("cannot write {}", file.display()))?;
    }
    let failed = verdicts.iter().filter(|(_, verdict)| matches!(verdict, StepVerdict::Failed(_))).count();
    ensure!(failed == 0, "{failed} of {} steps failed", verdicts.len());
    Ok(())
}

/// Does the steps. A failed one does not stop those after it: they tell more about the fault.
fn go<'s>(
    desk: &Desk,
    steps: &[&'s BenchStep],
    commands: &mut dyn Commands,
    mut progress: impl FnMut(&str),
) -> Vec<(&'s BenchStep, StepVerdict)> {
    let mut verdicts = Vec::new();
    for step in steps {
        progress(&format!("step {}: {}", step.number, step.what));
        let verdict = step.check(desk, commands);
        progress(&format!("    {verdict}"));
        verdicts.push((*step, verdict));
    }
    verdicts
}

/// What would be done.
fn plan(desk: &Desk, steps: &[&BenchStep]) -> String {
    let mut text = desk.to_string();
    for step in steps {
        text += &format!("\nstep {}: {}\n", step.number, step.what);
        match step.commands(desk) {
            Ok(commands) => {
                commands.iter().for_each(|words| text += &format!("    baliza {}\n", words.join(" ")));
                text += &format!("    expect: {}\n", step.expect);
            }
            Err(missing) => text += &format!("    left out: {missing:#}\n"),
        }
    }
    text
}

/// The report.
fn report(desk: &Desk, verdicts: &[(&BenchStep, StepVerdict)]) -> String {
    let mut table = MarkdownTable::new(["step", "what", "expected", "verdict"]);
    for (step, verdict) in verdicts {
        table.row(format_args!("{} | {} | {} | {verdict}", step.number, step.what, step.expect));
    }
    format!("{desk}\n{}", table.into_text())
}

/// The words of a command.
fn words(text: &str) -> Vec<String> {
    text.split_whitespace().map(str::to_owned).collect()
}

/// A path as a word.
fn word(path: &Path) -> String {
    path.display().to_string()
}

#[cfg(test)]
mod tests;
