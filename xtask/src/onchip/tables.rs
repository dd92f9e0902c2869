//! The tables of `qa/onchip-bench/README.md`, in Markdown.

use anyhow::{Context, Result, ensure};
use baliza_report::MarkdownTable;
use onchip_bench::cases::ANCHORS;
use onchip_bench::{cases, step, walk};
use positioning_core::Method;

use super::Measured;
use super::budget::{
    ALL_METHODS_2D, BEACONS, CALLS, CallBudget, ENGINE_INSTRUCTIONS, ENGINE_LINKS, ENGINE_STACK, FEATURES,
};
use crate::chip::Chip;

/// Every method with every number of anchors.
pub fn costs(measured: &Measured) -> String {
    let mut text = format!(
        "### {}\n\n{}, {}. Chip and desktop differ by {} mm at most.\n\n",
        measured.chip.title(),
        measured.chip.target().triple(),
        measured.compiler,
        measured.disagreement_m * 1.0e3
    );
    for dims in [2, 3] {
        let instructions = ANCHORS.map(|anchors| format!("instructions, {anchors} anchors:"));
        let stack = ANCHORS.map(|anchors| format!("stack, {anchors}:"));
        let (first, last) = ([format!("method, {dims}D")], ["code, bytes:".to_owned()]);
        let mut table = MarkdownTable::new(first.into_iter().chain(instructions).chain(stack).chain(last));
        for method in Method::ALL {
            let worst = ANCHORS.map(|anchors| measured.printed.worst(&format!("solve {method} {dims} {anchors} ")));
            let instructions = worst.map(|(instructions, _)| grouped(instructions)).join(" | ");
            let stack = worst.map(|(_, stack)| grouped(stack)).join(" | ");
            let code = measured.sizes.of(method, dims).map_or_else(String::new, grouped);
            table.row(format_args!("`{method}` | {instructions} | {stack} | {code}"));
        }
        let all = grouped(measured.sizes.of_all(dims));
        table.row(format_args!("all together | {}{all}", "| ".repeat(2 * ANCHORS.len())));
        text += &table.into_text();
        text.push('\n');
    }
    text
}

/// The budgets beside the measurements, and whether all are kept.
///
/// # Errors
/// A measurement is missing.
pub fn budgets(measured: &[Measured]) -> Result<(String, bool)> {
    let chip = measured.iter().find(|measured| measured.chip == Chip::CortexM4F).context("no Cortex-M4F")?;
    let mut table = MarkdownTable::new(["what, Cortex-M4F", "measured:", "budget:", ""]);
    let mut within = true;
    let mut row = |what: String, figure: u64, budget: u64| {
        let verdict = if figure <= budget { "within" } else { "OVER" };
        within &= figure <= budget;
        table.row(format_args!("{what} | {} | {} | {verdict}", grouped(figure), grouped(budget)));
    };
    for CallBudget { method, dims, anchors, instructions: most, stack: most_stack } in CALLS {
        let case = format!("`{method}`, {anchors} anchors, {dims}D");
        let (instructions, stack) = chip.printed.worst(&format!("solve {method} {dims} {anchors} "));
        row(format!("{case}: instructions"), instructions, most);
        row(format!("{case}: bytes of stack"), stack, most_stack);
    }
    let (features, _) = chip.printed.worst("nlos features");
    row("features of an impulse response of 152 samples: instructions".to_owned(), features, FEATURES);
    for (what, title, budget) in BEACONS {
        let mut calls = chip.printed.calls("beacons ");
        let (_, call) = calls.find(|(name, _)| *name == what).with_context(|| format!("no {what}"))?;
        row(format!("{title}: instructions"), call.instructions.into(), budget);
    }
    let (instructions, stack) = chip.printed.worst(&format!("engine range 2 {ENGINE_LINKS}"));
    let case = format!("engine, a range, {ENGINE_LINKS} links followed");
    row(format!("{case}: instructions"), instructions, ENGINE_INSTRUCTIONS);
    row(format!("{case}: bytes of stack"), stack, ENGINE_STACK);
    row("all methods in 2D: bytes of code".to_owned(), chip.sizes.of_all(2), ALL_METHODS_2D);
    Ok((table.into_text(), within))
}

/// Square roots and the step of weighted least squares, library by library.
///
/// # Errors
/// A library has no measured square root.
pub fn algebra(measured: &Measured) -> Result<String> {
    let printed = &measured.printed;
    let mut roots = MarkdownTable::new(["square root", "instructions, worst:", "error, worst:"]);
    for library in ["core", "libm", "micromath"] {
        let begin = format!("root {library} ");
        let (instructions, _) = printed.worst(&begin);
        let errors = printed.calls(&begin).map(|(argument, call)| {
            let argument: f32 = argument.parse()?;
            Ok((call.results.first().context("no square root")? / argument.sqrt() - 1.0).abs())
        });
        let error = errors.collect::<Result<Vec<_>>>()?.into_iter().fold(0.0, f32::max);
        roots.row(format_args!("{} | {instructions} | {:.2} %", title(library), error * 100.0));
    }
    let epoch = cases::DrawnEpoch::<2>::new(step::ANCHORS, 0);
    let exact = step::by_hand(epoch.samples(), &step::weights(), step::START, f32::sqrt);
    let mut steps = MarkdownTable::new(["weighted step", "square root", "instructions:", "stack, bytes:", "off by:"]);
    for (words, call) in printed.calls("step ") {
        let (variant, library) = words.split_once(' ').context("no library")?;
        let off_m = call.results.iter().zip(exact).map(|(is, exact)| (is - exact).powi(2)).sum::<f32>().sqrt();
        let (instructions, stack) = (grouped(call.instructions.into()), grouped(call.stack as u64));
        steps.row(format_args!("{variant} | {} | {instructions} | {stack} | {off_m:.3} m", title(library)));
    }
    Ok(format!("### {}\n\n{}\n{}\n", measured.chip.title(), roots.into_text(), steps.into_text()))
}

/// Native mode frame by frame: the protocols' steps, and the bus traffic of the driver for sending or receiving the
/// frame.
///
/// # Errors
/// The ranges of the exchange are wrong, or a frame is missing.
pub fn frames(measured: &Measured) -> Result<String> {
    let printed = &measured.printed;
    // The image's tag is ten metres from each of four anchors.
    let near = printed.ranges.iter().filter(|metres| (*metres - 10.0).abs() < 0.02).count();
    ensure!(near == 4, "the exchange's ranges are {:?}", printed.ranges);
    let titles = ["step", "frame, bytes:", "instructions:", "stack:", "SPI transactions:", "SPI bytes:"];
    let mut table = MarkdownTable::new(titles);
    // Transactions, and bytes beside those of the frame: from `baliza_dw1000::driver`, checked by its test
    // `costs_are_those_of_the_table`.
    for (name, title, (transactions, beside)) in [
        ("poll", "tag makes the poll; sent at its instant", (5, 13)),
        ("answer", "anchor answers a poll; response sent at an instant", (6, 17)),
        ("response", "tag makes a range of a response; received, listening on", (9, 47)),
    ] {
        let begin = format!("frame {name} ");
        let lengths =
            printed.calls(&begin).map(|(length, _)| Ok(length.parse::<u32>()?)).collect::<Result<Vec<_>>>()?;
        let length = lengths.into_iter().max().with_context(|| format!("no {name}"))?;
        let (instructions, stack) = printed.worst(&begin);
        table.row(format_args!(
            "{title} | {length} | {} | {} | {transactions} | {}",
            grouped(instructions),
            grouped(stack),
            length + beside
        ));
    }
    Ok(format!("### {}\n\n{}\n", measured.chip.title(), table.into_text()))
}

/// The features of an impulse response and every classifier, chip by chip.
///
/// # Errors
/// A chip lacks a measurement.
pub fn sight(measured: &[Measured]) -> Result<String> {
    let title =
        |what: &str| if what == "features" { "magnitudes and features".to_owned() } else { format!("`{what}`") };
    calls(measured, "nlos ", title)
}

/// Costs of the functions on the RSSI of beacons, chip by chip.
///
/// # Errors
/// A chip lacks a measurement.
pub fn beacons(measured: &[Measured]) -> Result<String> {
    let known = [
        ("advert", "an advert: judged, smoothed, a distance"),
        ("scan", "a scan of 12 beacons, 6 of them heard"),
        ("particles", "a step of 256 particles, resampled, 6 beacons"),
        ("particles-kept", "the same, not resampled"),
        ("nearest", "5 nearest of 200 points × 12 beacons, weighted"),
        ("map", "checking a map of 200 points × 12 beacons, once"),
        ("lattice", "the posterior over 200 points × 12 beacons"),
        ("walk", "a step of the walk over them"),
        ("rooms-svm", "one of 5 rooms by 12 beacons, support vector machine"),
        ("rooms-nearest", "the same, 3 nearest of 40 fingerprints"),
        ("rooms-presence", "the answer that does not flap, a step"),
    ];
    let title = |what: &str| {
        let found = known.iter().find(|(name, _)| *name == what);
        found.map_or_else(|| format!("`{what}`, 6 beacons"), |(_, title)| (*title).to_owned())
    };
    calls(measured, "beacons ", title)
}

/// Calls that return a number, chip by chip.
fn calls(measured: &[Measured], begin: &str, title: impl Fn(&str) -> String) -> Result<String> {
    let titles =
        measured.iter().flat_map(|of| [format!("{}: instructions:", of.chip.title()), "stack, bytes:".to_owned()]);
    let mut table = MarkdownTable::new(std::iter::once("what".to_owned()).chain(titles));
    let first = measured.first().context("no chip")?;
    for (at, (what, _)) in first.printed.calls(begin).enumerate() {
        let cells = measured.iter().map(|chip| {
            let (_, call) = chip.printed.calls(begin).nth(at).context("a chip left something out")?;
            Ok(format!("{} | {}", grouped(call.instructions.into()), grouped(call.stack as u64)))
        });
        table.row(format_args!("{} | {}", title(what), cells.collect::<Result<Vec<_>>>()?.join(" | ")));
    }
    Ok(table.into_text())
}

/// The engine's steps.
pub fn engine(measured: &Measured) -> String {
    let links = walk::ANCHORS.map(|anchors| format!("instructions, {anchors} links:"));
    let stacks = walk::ANCHORS.map(|anchors| format!("stack, {anchors}:"));
    let mut table = MarkdownTable::new(std::iter::once("step".to_owned()).chain(links).chain(stacks));
    for (what, title) in [
        ("range", "a range"),
        ("round-end", "the end of a round"),
        ("start", "the end of the first round: solved, and its ranges let in"),
    ] {
        for dims in [2, 3] {
            let costs = walk::ANCHORS.map(|links| measured.printed.worst(&format!("engine {what} {dims} {links}")));
            let instructions = costs.map(|(instructions, _)| grouped(instructions)).join(" | ");
            let stack = costs.map(|(_, stack)| grouped(stack)).join(" | ");
            table.row(format_args!("{title}, {dims}D | {instructions} | {stack}"));
        }
    }
    format!("### {}\n\n{}\n", measured.chip.title(), table.into_text())
}

fn title(library: &str) -> &str {
    if library == "core" { "`positioning_core::Real`" } else { library }
}

/// 12345 as 12,345.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::grouped;

    #[test]
    fn thousands_are_parted() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
    }
}
