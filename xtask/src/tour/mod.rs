//! `docs/build/tour.md`: one round with all its numbers and bytes. The page is a template ([`PAGE`]) with named values,
//! and a run of the simulation ([`run`]) gives the values.

mod run;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use anyhow::{Context, Result, bail, ensure};
use positioning_core::engine;
use ranging::RadioInstant;
use ranging::time::METRES_PER_TICK;
use wire::telemetry::{self, Outcome};
use wire::uwb::Header;

use crate::onchip::grouped;
use crate::promises::{self, Made};
use run::{Tour, TourAnswer};

const PAGE: &str = include_str!("page.md");

/// The name of the document in `promises.toml`.
const DOCUMENT: &str = "tour";
/// Bytes of a poll between header and anchors: code, round, number of anchors and layout.
const POLL_START: usize = 5;
/// Bytes of a response's parts after the header: code and round; `poll_rx`; the reply delay.
const RESPONSE: [usize; 3] = [3, 5, 4];

/// The counter's rate: 499.2 MHz × 128.
const TICKS_PER_US: f64 = 63_897.6;

/// The page.
///
/// # Errors
/// The run fails, or lacks a value of the template.
pub fn made() -> Result<Made> {
    Ok(Made::file(&promises::path(DOCUMENT)?.display().to_string(), page(|_| ())?))
}

/// The page of a run whose engine has changed settings.
fn page(tune: fn(&mut engine::Settings<f32>)) -> Result<String> {
    let tour = run::run(tune)?;
    let mut values = Values::default();
    exchange(&tour, &mut values)?;
    range(&tour, &mut values)?;
    position(&tour, &mut values)?;
    told(&tour, &mut values)?;
    values.fill(PAGE)
}

/// The values of the template, by their names.
#[derive(Default)]
struct Values(BTreeMap<&'static str, String>);

impl Values {
    fn set(&mut self, name: &'static str, value: impl ToString) {
        self.0.insert(name, value.to_string());
    }

    /// The template with the values.
    fn fill(&self, template: &str) -> Result<String> {
        let (mut text, mut rest) = (String::new(), template);
        let mut unused: Vec<&str> = self.0.keys().copied().collect();
        while let Some((before, after)) = rest.split_once('{') {
            let (name, behind) = after.split_once('}').context("no closing brace")?;
            let value = self.0.get(name).with_context(|| format!("the run has no {name}"))?;
            unused.retain(|other| *other != name);
            text = text + before + value;
            rest = behind;
        }
        ensure!(unused.is_empty(), "the page has no {}", unused.join(", "));
        Ok(text + rest)
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

/// The length of a frame's header, and its sequence number.
fn header(frame: &[u8]) -> Result<(usize, u8)> {
    let (header, payload) = Header::parse(frame).ok().context("a frame without header")?;
    Ok((frame.len() - payload.len(), header.sequence))
}

fn ticks(instant: RadioInstant) -> String {
    grouped(instant.ticks())
}

/// The first response.
fn first(tour: &Tour) -> Result<&TourAnswer> {
    tour.exchange.answers.first().context("no response")
}

/// Sections 1 and 2: the frames.
fn exchange(tour: &Tour, values: &mut Values) -> Result<()> {
    let Tour { exchange, epoch, scenario, .. } = tour;
    for (name, metres) in ["truth_x", "truth_y", "truth_z"].into_iter().zip(epoch.truth_m) {
        values.set(name, format!("{metres:.3}"));
    }
    values.set("round", exchange.number);
    values.set("rate", run::RATE_HZ);
    values.set("seconds", run::SECONDS);
    let poll = &exchange.poll;
    let (length, sequence) = header(poll)?;
    values.set("poll", hex(poll));
    values.set("poll_header", hex(&poll[..length]));
    values.set("poll_sequence", format!("0x{sequence:02X}"));
    let network = scenario.networks.first().context("no network")?;
    values.set("pan", format!("0x{:04X}", network.pan));
    let tag = scenario.tags.first().context("no tag")?.address;
    values.set("tag", format!("0x{tag:04X}"));
    let anchors = poll.get(length + POLL_START..).context("a short poll")?;
    values.set("poll_start", hex(&poll[length..length + POLL_START]));
    values.set("poll_anchors", hex(anchors));
    let slots = anchors.chunks_exact(2).map(|address| u16::from_le_bytes([address[0], address[1]]).to_string());
    values.set("slots", slots.collect::<Vec<_>>().join(", "));
    values.set("asked", epoch.fix.asked);
    values.set("poll_tx", ticks(exchange.poll_tx.context("the poll was not sent")?));
    let answer = first(tour)?;
    values.set("anchor", answer.anchor);
    values.set("others", exchange.answers.len() - 1);
    let (length, sequence) = header(&answer.bytes)?;
    values.set("response", hex(&answer.bytes));
    values.set("response_header", hex(&answer.bytes[..length]));
    values.set("response_sequence", format!("0x{sequence:02X}"));
    let mut rest = answer.bytes.get(length..).context("a short response")?;
    for (name, bytes) in ["response_start", "response_poll_rx", "response_reply"].into_iter().zip(RESPONSE) {
        let (part, behind) = rest.split_at_checked(bytes).context("a short response")?;
        values.set(name, hex(part));
        rest = behind;
    }
    ensure!(rest.is_empty(), "the response has {} more bytes than the page says", rest.len());
    values.set("poll_rx", ticks(answer.response.poll_rx));
    values.set("poll_rx_hex", format!("0x{:010X}", answer.response.poll_rx.ticks()));
    values.set("resp_rx", ticks(answer.rx_time));
    values.set("power", minus(format!("{:.1}", answer.diagnostics.rx_power_dbm)));
    values.set("first_path", minus(format!("{:.1}", answer.diagnostics.first_path_power_dbm)));
    values.set("carrier", minus(format!("{:+.3}", answer.diagnostics.clock_offset_ppm)));
    Ok(())
}

/// A number with the sign of typography.
fn minus(number: String) -> String {
    number.replace('-', "−")
}

/// Section 3: from instants to a distance. The formula is that of [`ranging::tof`], written out again.
fn range(tour: &Tour, values: &mut Values) -> Result<()> {
    let answer = first(tour)?;
    let poll_tx = tour.exchange.poll_tx.context("the poll was not sent")?;
    let round_trip = answer.rx_time.since(poll_tx).ticks();
    let reply = answer.response.reply.ticks();
    let count = |ticks: i64| grouped(ticks.unsigned_abs());
    values.set("round_trip", count(round_trip));
    values.set("reply", count(reply));
    values.set("reply_us", format!("{:.2}", reply as f64 / TICKS_PER_US));
    let raw = 0.5 * (round_trip - reply) as f64;
    values.set("raw_ticks", minus(format!("{raw:.1}")));
    values.set("raw_m", minus(format!("{:.3}", raw * METRES_PER_TICK)));
    let earlier = tour.before.answers.iter().find(|other| other.anchor == answer.anchor);
    let earlier = earlier.context("the anchor did not answer in the round before")?;
    let anchor_gap = answer.response.poll_rx.since(earlier.response.poll_rx).ticks();
    let tag_gap = poll_tx.since(tour.before.poll_tx.context("the poll before was not sent")?).ticks();
    let rate = anchor_gap as f64 / tag_gap as f64 - 1.0;
    values.set("anchor_gap", count(anchor_gap));
    values.set("tag_gap", count(tag_gap));
    values.set("rate_ppm", minus(format!("{:+.4}", 1e6 * rate)));
    let flight = 0.5 * (round_trip as f64 - reply as f64 / (1.0 + rate));
    values.set("tof_ticks", format!("{flight:.2}"));
    values.set("tof_m", format!("{:.4}", flight * METRES_PER_TICK));
    let range = tour.exchange.ranges.iter().find(|range| range.peer == answer.anchor).context("no range")?;
    values.set("range_m", format!("{:.4}", range.distance_m));
    values.set("range_deviation_cm", format!("{:.1}", 100.0 * range.deviation_m));
    let record = tour.epoch.ranges.iter().find(|of| of.range.peer == answer.anchor).context("no true distance")?;
    values.set("true_m", format!("{:.4}", record.truth_m));
    values.set("link_error_cm", minus(format!("{:.1}", 100.0 * (f64::from(range.distance_m) - record.truth_m))));
    Ok(())
}

/// Section 4: what each range does to the track.
fn position(tour: &Tour, values: &mut Values) -> Result<()> {
    let [x, y, _] = tour.predicted_m;
    values.set("predicted_x", format!("{x:.4}"));
    values.set("predicted_y", format!("{y:.4}"));
    let mut rows = String::new();
    for (at, step) in (1..).zip(&tour.steps) {
        let [x, y, _] = step.position_m;
        let bold = if at == tour.steps.len() { "**" } else { "" };
        write!(
            rows,
            "{}| {} | {:.4} | {:.4} | {:.1} | {bold}{x:.4}, {y:.4}{bold} |",
            if at == 1 { "" } else { "\n" },
            step.anchor,
            step.range_m,
            step.expected_m,
            step.power_difference_db
        )?;
    }
    values.set("steps", rows);
    values.set("error_cm", format!("{:.1}", 100.0 * tour.epoch.error_m().context("no position")?));
    let [x, y, _] = tour.epoch.fix.deviation_m().context("no position")?;
    values.set("sigma_x_cm", format!("{:.1}", 100.0 * x));
    values.set("sigma_y_cm", format!("{:.1}", 100.0 * y));
    Ok(())
}

/// Sections 5 and 6: the telemetry, and what a host prints of it.
fn told(tour: &Tour, values: &mut Values) -> Result<()> {
    let fix = tour.epoch.fix;
    let message = telemetry::Message::from(fix);
    let mut frame = [0; telemetry::MAX_FRAME];
    let frame = telemetry::encode(&message, &mut frame);
    values.set("telemetry", hex(frame));
    let plain = uncobbed(frame)?;
    let [schema, number, .., low, high] = plain[..] else { bail!("a short frame") };
    values.set("schema", schema);
    values.set("message", number);
    values.set("crc", format!("0x{:04X}", u16::from_le_bytes([low, high])));
    values.set("t_us", grouped(fix.t_us));
    values.set("age_us", grouped(fix.age_us.into()));
    let Outcome::Position { position_tenth_mm, deviation_tenth_mm, correlation_127ths, used, quality_255ths } =
        fix.outcome
    else {
        bail!("no position");
    };
    values.set("position_tenth_mm", position_tenth_mm.map(|axis| axis.to_string()).join(", "));
    values.set("deviation_tenth_mm", deviation_tenth_mm.map(|axis| axis.to_string()).join(", "));
    values.set("correlations", minus(correlation_127ths.map(|axes| axes.to_string()).join(", ")));
    values.set("used", format!("0x{used:02X}"));
    values.set("quality", quality_255ths);
    values.set("solver", fix.solver.as_str().context("an unknown solver")?);
    let time = format!("{}.{:06}", fix.t_us / 1_000_000, fix.t_us % 1_000_000);
    values.set("line", format!("{time:>13} {:5} {message}", message.label()));
    Ok(())
}

/// The bytes that COBS has stuffed: each block begins with the distance to the next zero, and 0xFF has none.
fn uncobbed(frame: &[u8]) -> Result<Vec<u8>> {
    let mut plain = Vec::new();
    let mut rest = frame.strip_suffix(&[0]).context("a frame without end")?;
    while let Some((&length, behind)) = rest.split_first() {
        let block = behind.get(..usize::from(length).saturating_sub(1)).context("a frame that ends early")?;
        plain.extend_from_slice(block);
        rest = &behind[block.len()..];
        if length < u8::MAX && !rest.is_empty() {
            plain.push(0);
        }
    }
    Ok(plain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::root;

    #[test]
    fn the_page_is_that_of_the_run() {
        let file = promises::path(DOCUMENT).expect("in promises.toml");
        let committed = std::fs::read_to_string(root().join(&file)).expect("a document");
        let made = page(|_| ()).expect("a run");
        assert!(committed == made, "{} is of another run: `cargo xtask promises tour` remakes it", file.display());
    }

    #[test]
    fn a_tenth_more_noise_in_the_filter_makes_another_page() {
        let noisier = page(|settings| settings.filter.noise.direct_sigma *= 1.1).expect("a run");
        assert_ne!(noisier, page(|_| ()).expect("a run"));
    }

    #[test]
    fn a_value_that_is_missing_or_unused_is_an_error() {
        let mut values = Values::default();
        values.set("a", 1);
        assert_eq!(values.fill("x {a}").expect("all there"), "x 1");
        assert!(values.fill("{a} {b}").is_err());
        assert!(values.fill("nothing").is_err());
    }
}
