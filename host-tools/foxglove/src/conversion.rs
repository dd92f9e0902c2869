//! A recording, or a stream of telemetry, as messages in the order of time.

use std::io::Read;
use std::path::Path;

use anyhow::{Context, Result};

use super::{Estimate, RangeRow, Sink, TAG, View};
use node_link::decode::{Stream, StreamFiles};
use node_link::recorder::TIMES;
use recording::folder::Folder;
use recording::{Coordinates, Recording, Table, Truths, UserError, read_anchors};
use recording::{Files, MeasurementMode, positions};

/// The host's time of a recording's times.
#[derive(Clone, Debug, Default)]
pub struct Clock {
    /// Seconds of the recording and microseconds since 1970, in the order of the first.
    rows: Vec<(f64, f64)>,
}

impl Clock {
    /// Reads the times at which frames were received. Without a file, times are those of the recording.
    ///
    /// # Errors
    /// The first line that is wrong.
    pub fn read(file: Option<&Path>) -> Result<Self, UserError> {
        let Some(file) = file else { return Ok(Self::default()) };
        let mut table = Table::open(file)?;
        let (time, utc) = (table.column("t_s")?, table.column("utc_us")?);
        let mut rows = Vec::new();
        while let Some(row) = table.next_row()? {
            rows.push((row.some_number(time)?, row.some_number(utc)?));
        }
        rows.sort_by(|(one, _), (other, _)| one.total_cmp(other));
        Ok(Self { rows })
    }

    /// Nanoseconds: since 1970 where the host's time is known, else the recording's own.
    pub fn ns(&self, t_s: f64) -> u64 {
        let next = self.rows.partition_point(|(row_s, _)| *row_s <= t_s);
        // The conversions saturate. Of the times since 1970, a double keeps microseconds and no nanoseconds.
        match next.checked_sub(1).and_then(|at| self.rows.get(at)).or(self.rows.first()) {
            Some((row_s, utc_us)) => ((utc_us + (t_s - row_s) * 1e6).round() as u64).saturating_mul(1000),
            None => (t_s * 1e9).round() as u64,
        }
    }
}

/// What was converted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Converted {
    /// Ranges.
    pub ranges: u64,
    /// Positions, and epochs without one.
    pub positions: u64,
    /// Rows without a time, which are left out.
    pub timeless: u64,
}

/// A row of any table.
enum Row {
    Range { tag: Option<String>, epoch: String, anchor: usize, range_m: f64, los: Option<bool> },
    Position { name: String, row: positions::PositionRow },
    Truth { name: String, place: Coordinates },
}

/// Converts the tables of a folder.
///
/// # Errors
/// A file is wrong, no row has a time, or the sink returns an error.
pub fn convert<S: Sink>(folder: &Folder, view: &mut View<S>) -> Result<Converted> {
    let clock = Clock::read(folder.find(TIMES).as_deref())?;
    let anchors = folder.find_rows("anchors.csv")?;
    let ranges = folder.find_rows("ranges.csv")?;
    let mut rows: Vec<(Option<f64>, Row)> = Vec::new();
    let recordings = match &ranges {
        Some(measured) => Recording::read(&Files {
            anchors: &folder.file("anchors.csv")?,
            measured,
            mode: MeasurementMode::Ranges,
            truth: None,
            anchor_heights: false,
            truth_heights: false,
        })?,
        // Tags that receive beacons, or only listen, have positions.
        None => Vec::new(),
    };
    for Recording { tag, epochs, .. } in recordings {
        for epoch in epochs.iter() {
            rows.extend(epoch.ranges.iter().map(|range| {
                let (tag, epoch_name) = (tag.clone(), epoch.name.to_owned());
                let (anchor, range_m, los) = (range.anchor, range.range_m, range.line_of_sight);
                (range.t_s.or(epoch.t_s), Row::Range { tag, epoch: epoch_name, anchor, range_m, los })
            }));
        }
    }
    if let Some(file) = folder.find("positions.csv") {
        rows.extend(positions::read(&file)?.into_iter().map(|row| {
            let method = Some(row.method.as_str()).filter(|method| !method.is_empty()).unwrap_or(TAG);
            (row.t_s, Row::Position { name: under(row.tag.as_deref(), method), row })
        }));
    }
    if let Some(file) = folder.find("truth.csv") {
        let truths = Truths::read(&file, false)?;
        for (tag, truth) in truths.by_tag() {
            rows.extend(
                truth.rows().map(|(_, t_s, place)| (t_s, Row::Truth { name: under(tag, "truth"), place: *place })),
            );
        }
    }
    let mut converted =
        Converted { timeless: rows.iter().filter(|(t_s, _)| t_s.is_none()).count() as u64, ..Converted::default() };
    let mut timed: Vec<(f64, Row)> = rows.into_iter().filter_map(|(t_s, row)| Some((t_s?, row))).collect();
    timed.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    let Some(begin_s) = timed.first().map(|(t_s, _)| *t_s) else {
        let ranges = folder.file("ranges.csv")?;
        return Err(UserError::line(&ranges, 1, "no row has a t_s, and messages need times").into());
    };
    let anchors = anchors.as_deref().map(read_anchors).transpose()?.unwrap_or_default();
    for anchor in &anchors {
        let place = &anchor.place;
        view.anchor(clock.ns(begin_s), &anchor.name, [place.x_m, place.y_m, place.z_m.unwrap_or(0.0)])?;
    }
    for (t_s, row) in timed {
        let t_ns = clock.ns(t_s);
        match row {
            Row::Range { tag, epoch, anchor, range_m, los } => {
                let anchor = anchors.get(anchor).map_or("", |anchor| anchor.name.as_str());
                view.range(t_ns, tag.as_deref(), &RangeRow { t_s, epoch: &epoch, anchor, range_m, los })?;
                converted.ranges += 1;
            }
            Row::Position { name, row } => {
                let [sigma_x, sigma_y] = row.sigma_m.map_or([None; 2], |sigma_m| sigma_m.map(Some));
                let sigma_m = [sigma_x, sigma_y, row.sigma_z_m];
                let reason = Some(row.reason.as_str()).filter(|reason| !reason.is_empty());
                view.position(t_ns, &name, &Estimate { t_s, epoch: &row.epoch, place: row.place, sigma_m, reason })?;
                converted.positions += 1;
            }
            Row::Truth { name, place } => view.pose(t_ns, &name, &place)?,
        }
    }
    Ok(converted)
}

/// Converts a stream of telemetry: a file, or that of a recording's folder.
///
/// # Errors
/// The stream cannot be read or has no frame, or the sink returns an error.
pub fn convert_stream<S: Sink>(file: &Path, clock: &Clock, view: &mut View<S>) -> Result<Converted> {
    let mut from = StreamFiles::open(file)?;
    let (mut stream, mut converted) = (Stream::default(), Converted::default());
    let mut chunk = vec![0; 1 << 16];
    loop {
        let read = from.read(&mut chunk).with_context(|| format!("cannot read {}", file.display()))?;
        if read == 0 {
            break;
        }
        for byte in chunk.iter().take(read) {
            let Some((stamp, message)) = stream.feed(*byte) else { continue };
            view.telemetry(clock.ns(stamp.t_s), stamp, &message)?;
            converted.ranges += u64::from(message.kind() == "range");
            converted.positions += u64::from(message.kind() == "fix");
        }
    }
    stream.summary().is_of_telemetry(file)?;
    Ok(converted)
}

fn under(tag: Option<&str>, name: &str) -> String {
    tag.map_or_else(|| name.to_owned(), |tag| format!("{tag}/{name}"))
}

#[cfg(test)]
mod tests {
    use super::Clock;

    #[test]
    fn times_are_the_hosts_where_it_is_known() {
        assert_eq!(Clock::default().ns(1.25), 1_250_000_000);
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join(super::TIMES);
        std::fs::write(&file, "offset,t_s,utc_us\n0,5.0,1700000000000000\n9,7.0,1700000002000100\n").expect("written");
        let clock = Clock::read(Some(&file)).expect("read");
        // Before the first row by the first, then by the last row before: 7.5 s is half a second after the second row.
        assert_eq!(clock.ns(4.0), 1_699_999_999_000_000_000);
        assert_eq!(clock.ns(6.0), 1_700_000_001_000_000_000);
        assert_eq!(clock.ns(7.5), 1_700_000_002_500_100_000);
    }
}
