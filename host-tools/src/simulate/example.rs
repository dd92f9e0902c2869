//! The example recording as files: the content of `examples/room`.

use sim::example_room::{ANCHORS_M, record};

/// Seed of that recording.
pub const SEED: u64 = 1;

/// The three files by name and content.
///
/// # Errors
/// The CSV writer fails.
pub fn files() -> csv::Result<[(&'static str, Vec<u8>); 3]> {
    let mut anchors = with_header(&["anchor", "x_m", "y_m", "z_m"])?;
    for (number, [x, y, z]) in ANCHORS_M.iter().enumerate() {
        anchors.write_record([name(number), x.to_string(), y.to_string(), z.to_string()])?;
    }
    let mut ranges = with_header(&["epoch", "t_s", "anchor", "range_m", "los"])?;
    let mut truth = with_header(&["epoch", "t_s", "x_m", "y_m", "z_m"])?;
    for (number, epoch) in record(SEED).iter().enumerate() {
        let (number, time) = (number.to_string(), format!("{:.1}", epoch.t_s));
        for range in &epoch.ranges {
            let sight = if range.line_of_sight { "1" } else { "0" };
            ranges.write_record([&number, &time, &name(range.anchor), &metres(range.range_m), sight])?;
        }
        let [x, y, z] = epoch.position_m.map(metres);
        truth.write_record([&number, &time, &x, &y, &z])?;
    }
    Ok([("anchors.csv", finish(anchors)?), ("ranges.csv", finish(ranges)?), ("truth.csv", finish(truth)?)])
}

fn name(anchor: usize) -> String {
    format!("A{}", anchor + 1)
}

/// Whole millimetres, as a DW1000 reports them.
fn metres(value: f64) -> String {
    format!("{value:.3}")
}

type Writer = csv::Writer<Vec<u8>>;

fn with_header(columns: &[&str]) -> csv::Result<Writer> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(columns)?;
    Ok(writer)
}

fn finish(writer: Writer) -> csv::Result<Vec<u8>> {
    writer.into_inner().map_err(|error| error.into_error().into())
}
