//! What `baliza simulate` prints: positions while it runs, and the summary at its end.

use std::collections::HashMap;
use std::fmt::{Display, Write as _};
use std::io::IsTerminal;

use anyhow::Result;
use sim::scenario::{BluetoothSummary, Cover, Record, Scenario, SimulatedEpoch, Summary, What};
use wire::telemetry::{Address, Message, RoomLine, SolveError};

use crate::simulate::{position_header, position_row};

/// The least interval between two rows of a tag in the table on a terminal, seconds; the number of tags with rows; and
/// the number of rows of them all, so that a usual run fits on a screen.
const ROW_S: f64 = 0.5;
const ROW_TAGS: usize = 8;
const ROWS: f64 = 24.0;
/// Of more tags the summary tells how they joined.
const FEW_TAGS: usize = 8;

/// The output to standard output while the simulation runs.
pub(super) enum Show {
    Nothing,
    /// Every position, in the format of a file.
    Rows {
        methods: HashMap<u16, &'static str>,
    },
    /// On a terminal: one line for each tag at intervals, and a line for every change.
    Lines {
        every_s: f64,
        next_s: Vec<(u16, f64)>,
    },
}

impl Show {
    pub(super) fn new(is_silent: bool, scenario: &Scenario) -> Self {
        if is_silent {
            Self::Nothing
        } else if std::io::stdout().is_terminal() {
            let next_s: Vec<_> = scenario.tags.iter().take(ROW_TAGS).map(|tag| (tag.address, 0.0)).collect();
            let every_s = (scenario.seconds * next_s.len() as f64 / ROWS / ROW_S).ceil().max(1.0) * ROW_S;
            Self::Lines { every_s, next_s }
        } else {
            let methods = scenario.tags.iter().map(|tag| (tag.address, scenario.method_name(tag))).collect();
            Self::Rows { methods }
        }
    }

    pub(super) fn begin(&self) -> Result<()> {
        match self {
            Self::Nothing => Ok(()),
            Self::Rows { .. } => crate::cli::print(&row(&position_header())?),
            Self::Lines { .. } => crate::cli::print(
                format!(
                    "{:>8} {:>6} {:>9} {:>9} {:>8} {:>9} {:>8} {:>8}\n",
                    "t_s", "tag", "x_m", "y_m", "z_m", "sigma_m", "anchors", "error_m"
                )
                .as_bytes(),
            ),
        }
    }

    pub(super) fn take(&mut self, records: &[Record]) -> Result<()> {
        let mut text = Vec::new();
        for record in records {
            let line = |what: &dyn Display| {
                format!("{:>8.3} {:>6} {what}\n", record.t_s, Address(record.node).to_string()).into_bytes()
            };
            match (&mut *self, &record.what) {
                (Self::Rows { methods }, What::Epoch(epoch)) => {
                    let method = methods.get(&record.node).copied().unwrap_or_default();
                    text.extend(row(&position_row(record, method, epoch))?);
                }
                (Self::Lines { every_s, next_s }, What::Epoch(epoch)) => {
                    let due = next_s.iter_mut().find(|(tag, next)| *tag == record.node && record.t_s >= *next);
                    if let Some((_, next)) = due {
                        *next = (record.t_s / *every_s).floor() * *every_s + *every_s;
                        text.extend(line(&epoch_text(epoch)));
                    }
                }
                (Self::Lines { .. }, What::Fault(fault)) => text.extend(line(&format_args!("fault: {fault:?}"))),
                (Self::Lines { .. }, What::Message(Message::State(state))) => text.extend(line(&state.is)),
                (Self::Lines { .. }, What::Message(Message::Room(room))) => text.extend(line(&RoomLine(room.is))),
                (Self::Lines { .. } | Self::Rows { .. }, What::Message(_) | What::Fault(_)) | (Self::Nothing, _) => {}
            }
        }
        crate::cli::print(&text)
    }
}

fn row<T: AsRef<[u8]>>(fields: &[T]) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(fields)?;
    writer.into_inner().map_err(|error| anyhow::Error::from(error.into_error()))
}

fn epoch_text(epoch: &SimulatedEpoch) -> String {
    let mut text = match (epoch.fix.position_m(), epoch.fix.deviation_m(), epoch.fix.reason()) {
        (Some([x, y, z]), Some(deviation_m), _) => {
            let sigma = deviation_m.iter().map(|s| s * s).sum::<f64>().sqrt();
            format!("{x:>9.2} {y:>9.2} {z:>8.2} {sigma:>9.2} {:>8}", epoch.fix.used().unwrap_or(0).count_ones())
        }
        (_, _, reason) => format!("no position: {}", reason.map_or("", SolveError::as_str)),
    };
    if let Some(error_m) = epoch.error_m() {
        let _ = write!(text, " {error_m:>8.3}");
    }
    text
}

/// The summary as text.
pub(super) fn summary_text(summary: &Summary) -> String {
    let metres = |figure: Option<f64>| figure.map_or_else(|| "-".to_owned(), |m| format!("{m:.3} m"));
    let consistency = summary
        .inside_1_sigma
        .zip(summary.nees)
        .map_or_else(String::new, |(inside, nees)| format!("; {:.0} % inside 1 sigma, NEES {nees:.2}", 100.0 * inside));
    let mut text = format!(
        "{}, {}, {} s: {}, {:.1} a second\n\
         accuracy: RMSE {}, half below {}, nine in ten below {}{}\n\
         air: {} frames, {} receptions lost, {} frames collided, {} of the time\n",
        counted(summary.tags, "tag"),
        counted(summary.anchors, "anchor"),
        summary.seconds,
        counted(summary.fixes, "position"),
        summary.fixes_per_s,
        metres(summary.rmse_m),
        metres(summary.p50_m),
        metres(summary.p90_m),
        consistency,
        summary.frames_sent,
        summary.frames_lost,
        summary.collisions,
        airtime(summary)
    );
    if summary.tags > FEW_TAGS {
        let last = summary.joined_s.map_or_else(String::new, |last_s| format!(", the last after {last_s:.1} s"));
        let slots = summary
            .slots_with_fix
            .map_or_else(String::new, |share| format!("; {:.1} % of their slots gave a position", 100.0 * share));
        let _ = writeln!(
            text,
            "slots: {} of {} have had some{last}{slots}",
            summary.tags_joined,
            counted(summary.tags, "tag")
        );
    }
    if let Some(share) = summary.uplink_share {
        let within =
            summary.uplink_p99_s.map_or_else(String::new, |p99_s| format!(", 99 % of these within {p99_s:.2} s"));
        let percent = 100.0 * share;
        let _ = writeln!(text, "told in polls: {percent:.1} % of the positions reached an anchor with a cable{within}");
    }
    if let Some(share) = summary.data_share {
        let percent = 100.0 * share;
        let _ = writeln!(text, "data of users: {percent:.1} % reached an anchor with a cable");
    }
    if let Some(share) = summary.message_share {
        let within =
            summary.message_p99_s.map_or_else(String::new, |p99_s| format!(", 99 % of these within {p99_s:.2} s"));
        let percent = 100.0 * share;
        let _ = writeln!(text, "messages to tags: {percent:.1} % were taken{within}");
    }
    if let Some((forged, accepted)) = summary.forged_frames.zip(summary.forged_accepted) {
        let _ = writeln!(text, "attack: {forged} frames; nodes believed {accepted}");
    }
    if let Some(current_ma) = summary.tag_mean_current_ma {
        let charge = summary.charge_per_fix_uc.map_or_else(|| "-".to_owned(), |charge_uc| format!("{charge_uc:.1} µC"));
        let _ = writeln!(text, "supply of a tag: {current_ma:.3} mA in the mean, {charge} a position");
    }
    if let Some(bluetooth) = &summary.bluetooth {
        let BluetoothSummary { beacons, adverts_sent, adverts_heard, adverts_lost, by_anchors, by_beacons } = bluetooth;
        let _ = writeln!(
            text,
            "beacons: {beacons}; {adverts_sent} advertisements, {adverts_heard} receptions, {adverts_lost} lost"
        );
        for (by, Cover { fixes, rmse_m, p50_m, p90_m }) in [("anchors", by_anchors), ("beacons alone", by_beacons)] {
            let [rmse, p50, p90] = [*rmse_m, *p50_m, *p90_m].map(metres);
            let _ = writeln!(
                text,
                "by {by}: {}; accuracy: RMSE {rmse}, half below {p50}, nine in ten below {p90}",
                counted(*fixes, "position")
            );
        }
    }
    text
}

/// How much of the time a network's frames are on the air, in words.
fn airtime(summary: &Summary) -> String {
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    let (mean, max) = (percent(summary.airtime_share), percent(summary.airtime_share_max));
    if mean == max { mean } else { format!("{mean} in the mean of the networks, {max} in the busiest") }
}

/// A number of things, in words.
fn counted(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}
