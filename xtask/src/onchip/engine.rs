//! The engine's steps on the chip: the comparison with the desktop, and the table.

use anyhow::{Result, ensure};
use baliza_report::MarkdownTable;
use onchip_bench::walk::{ANCHORS, WARM_UP, WalkStep, walk};

use super::Measured;
use super::printed::EngineStep;
use super::tables::grouped;

/// The greatest accepted difference between chip and desktop, metres: errors of rounding add up from step to step.
const TOLERANCE_M: f32 = 5.0e-3;

/// Budget of a step with one range, instructions, with [`BUDGET_ANCHORS`] tracked links.
pub const STEP_INSTRUCTIONS: u64 = 6_000;
/// Budget of its stack, bytes.
pub const STEP_STACK: u64 = 1_536;
/// Number of links of the budget.
pub const BUDGET_ANCHORS: u16 = 8;

/// Compares every position of the chip with the desktop's.
///
/// # Errors
/// A position differs by more than the tolerance, or is missing.
pub fn compare(steps: &[EngineStep]) -> Result<()> {
    let mut here = Vec::new();
    for space in [false, true] {
        for anchors in ANCHORS {
            let warm_up = WARM_UP * (u32::from(anchors) + 1);
            let mut count = 0;
            walk(anchors, space, |engine, step, now, measurement| {
                count += 1;
                let output = engine.step(now, measurement);
                if count > warm_up || step == WalkStep::Start {
                    let position = output.fix.map_or([f32::NAN; 3], |fix| fix.position);
                    here.push((step.as_str(), if space { 3 } else { 2 }, anchors, position));
                }
                output
            });
        }
    }
    ensure!(here.len() == steps.len(), "the chip made {} of {} steps", steps.len(), here.len());
    for (there, (what, dims, anchors, position)) in steps.iter().zip(here) {
        let same = (there.what.as_str(), there.dims, there.anchors) == (what, dims, anchors);
        let distance = there.position.iter().zip(position).map(|(t, h)| (t - h).powi(2)).sum::<f32>().sqrt();
        ensure!(same && distance <= TOLERANCE_M, "chip and desktop disagree: {there:?}, here {position:?}");
    }
    Ok(())
}

/// The worst instructions and the worst stack of a kind of step.
pub fn worst(steps: &[EngineStep], what: &str, dims: usize, anchors: u16) -> (u64, u64) {
    let steps = steps.iter().filter(|step| (step.what.as_str(), step.dims, step.anchors) == (what, dims, anchors));
    steps.fold((0, 0), |(instructions, stack), step| {
        (instructions.max(step.instructions.into()), stack.max(step.stack as u64))
    })
}

/// The table of one chip.
pub fn table(measured: &Measured) -> String {
    let links = ANCHORS.map(|anchors| format!("instructions, {anchors} links:"));
    let stacks = ANCHORS.map(|anchors| format!("stack, {anchors}:"));
    let mut table = MarkdownTable::new(std::iter::once("step".to_owned()).chain(links).chain(stacks));
    for (what, title) in [
        ("range", "a range"),
        ("round-end", "the end of a round"),
        ("start", "the end of the first round: solved, and its ranges let in"),
    ] {
        for dims in [2, 3] {
            let costs = ANCHORS.map(|anchors| worst(&measured.printed.engine, what, dims, anchors));
            let instructions = costs.map(|(instructions, _)| grouped(instructions)).join(" | ");
            let stack = costs.map(|(_, stack)| grouped(stack)).join(" | ");
            table.row(format_args!("{title}, {dims}D | {instructions} | {stack}"));
        }
    }
    format!("### {}\n\n{}\n", measured.chip.title(), table.into_text())
}
