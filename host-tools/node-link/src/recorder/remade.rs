//! Makes the tables of a recording again from its received bytes: where the recording was cut short, or where the
//! positions of anchors have become known since.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};

use super::file_names::{ANCHORS, STREAM, TRUTH, folders, is_table};
use super::tables::{Recorded, Tables, address_and_place};
use crate::decode::{DecodeSummary, Stream, StreamFiles};
use recording::output::OutputFolder;
use recording::read_text;
use recording::{Interrupted, UserError, read_anchors};

/// The number of bytes read at once.
const CHUNK: usize = 1 << 16;

/// Makes the tables of a recording, and of all its parts, in place of those that are there. `given` are the known
/// positions of anchors, metres, by their short addresses; those of an existing `anchors.csv` are known, too.
///
/// # Errors
/// The folder has no recording or a simulated one, its bytes are no telemetry, `stop` was set ([`Interrupted`]), or the
/// file system returns an error.
pub fn make_tables(
    folder: &Path,
    given: &BTreeMap<u16, [f64; 3]>,
    stop: &AtomicBool,
) -> Result<(DecodeSummary, Recorded)> {
    let mut stream = Stream::default();
    let mut recorded = Recorded::default();
    let mut reported = BTreeMap::new();
    for part in folders(folder) {
        if part.join(TRUTH).exists() {
            let what = format!("{} is of a simulation, whose tables have more than its telemetry", part.display());
            return Err(UserError::flag("--finish", what).into());
        }
        let bytes = StreamFiles::open(&part.join(STREAM))?;
        let mut known = known(&part)?;
        known.extend(given);
        let made = OutputFolder::begin("--finish", &part, is_table, true)?;
        let cannot = || format!("cannot write the tables into {}", part.display());
        let mut tables = Tables::create(made.path(), known, BTreeMap::new()).with_context(cannot)?;
        tables.know(reported);
        read(bytes, &part, &mut stream, &mut tables, stop)?;
        let of_part = tables.finish().with_context(cannot)?;
        made.finish().with_context(cannot)?;
        recorded.add(of_part.0);
        reported = of_part.1;
    }
    let summary = stream.summary();
    summary.is_of_telemetry(folder)?;
    Ok((summary, recorded))
}

fn read(
    mut bytes: StreamFiles,
    part: &Path,
    stream: &mut Stream,
    tables: &mut Tables,
    stop: &AtomicBool,
) -> Result<()> {
    let mut chunk = vec![0; CHUNK];
    loop {
        if stop.load(Ordering::Relaxed) {
            return Err(Interrupted.into());
        }
        let count = bytes.read(&mut chunk).with_context(|| format!("cannot read {}", part.join(STREAM).display()))?;
        if count == 0 {
            return Ok(());
        }
        for byte in chunk.get(..count).unwrap_or_default() {
            if let Some((stamp, message)) = stream.feed(*byte) {
                tables.message(stamp, &message).context("cannot write a row")?;
            }
        }
    }
}

/// The positions of the anchors that are in the folder.
fn known(part: &Path) -> Result<BTreeMap<u16, [f64; 3]>> {
    let file = part.join(ANCHORS);
    // A recording that was cut short may have no table, or one with a header only.
    if !file.exists() || read_text(&file)?.lines().count() < 2 {
        return Ok(BTreeMap::new());
    }
    Ok(read_anchors(&file)?.iter().map(address_and_place).collect::<Result<_, UserError>>()?)
}
