//! The files of Bluetooth beacons: `beacons.csv`, `fingerprints.csv`, `targets.csv`, `rssi.csv`, `walls.csv`.
//!
//! The functions read text and return rows, grouped by point or epoch, in the file's order. RSSI values are passed on
//! as reported, including values that no receiver can have measured. `positioning_core::ble` checks them, in the same
//! way for files and for received advertisements.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use positioning_core::ble::signal::rssi;

use crate::grouping::{ByName, tag_of};
use crate::table::quoted;
use crate::{Column, Coordinates, NoPosition, Position, Row, Solved, Table, Truths, UserError, by_time};

/// The largest number of beacons of a site.
const MOST_BEACONS: usize = 4096;
/// The largest number of walls of a site: every link is tested against every wall.
const MOST_WALLS: usize = 10_000;
/// The largest number of RSSI values of a survey, one for each point and beacon: a survey is a matrix in memory.
const MOST_VALUES: usize = 10_000_000;

/// Receivers report at most this RSSI, or this one where they did not measure it, dBm (Bluetooth Core Specification).
const LOUDEST_DBM: f64 = 20.0;
const UNAVAILABLE_DBM: f64 = 127.0;

/// A beacon, and what is known of its signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Beacon {
    /// The beacon's name in the other files.
    pub name: String,
    /// Its position, metres.
    pub position_m: [f64; 2],
    /// Its height, metres.
    pub height_m: Option<f64>,
    /// RSSI at one metre, dBm.
    pub rssi_1m_dbm: Option<f64>,
    /// Path loss exponent.
    pub path_loss_exponent: Option<f64>,
    /// Standard deviation of an RSSI about the path loss, dB.
    pub deviation_db: Option<f64>,
}

/// One received advertisement.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// The beacon that sent it.
    pub beacon: String,
    /// Its RSSI as reported, dBm.
    pub rssi_dbm: f64,
    /// The time of reception, seconds. Where the file does not give it: the time of the row before, or 0 for the first
    /// row.
    pub t_s: f64,
}

/// Samples taken at a known point: a fingerprint, or a target whose position is to be found.
#[derive(Clone, Debug, PartialEq)]
pub struct Dwell {
    /// The point's name in the file.
    pub point: String,
    /// The room of the point.
    pub room: Option<String>,
    /// The point's position, metres.
    pub position_m: [f64; 2],
    /// The samples received there, in the file's order.
    pub samples: Vec<Sample>,
}

/// Samples that make one position: an epoch of `rssi.csv`, or a dwell whose position is not given to the solver.
#[derive(Clone, Debug, PartialEq)]
pub struct Capture {
    /// The capture's name in the file.
    pub name: String,
    /// The time of its first row, seconds.
    pub t_s: Option<f64>,
    /// The tag's true position, metres.
    pub truth_m: Option<[f64; 2]>,
    /// Whether the capture is a dwell at a point. A dwell does not continue the capture before it.
    pub is_stay: bool,
    /// The received samples, in the file's order.
    pub samples: Vec<Sample>,
}

/// A wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wall {
    /// The wall's two ends, metres.
    pub ends_m: [[f64; 2]; 2],
    /// The attenuation of a signal through the wall, dB.
    pub attenuation_db: Option<f64>,
}

/// Reads `beacons.csv`: `beacon,x_m,y_m` (of a plan for anchors, `anchor,x_m,y_m`) and, where known,
/// `z_m,rssi_1m_dbm,path_loss_exponent,deviation_db`.
///
/// # Errors
/// The first line that is wrong: a beacon that is listed twice, or an exponent or a deviation that is not above 0.
pub fn read_beacons(file: &Path) -> Result<Vec<Beacon>, UserError> {
    let mut table = Table::open(file)?;
    let name = if table.optional("anchor").is_present() { "anchor" } else { "beacon" };
    let (beacon, x, y) = (table.column(name)?, table.column("x_m")?, table.column("y_m")?);
    let [z, rssi, exponent, deviation] =
        ["z_m", "rssi_1m_dbm", "path_loss_exponent", "deviation_db"].map(|name| table.optional(name));
    let mut beacons: Vec<Beacon> = Vec::new();
    let mut lines: HashMap<String, u64> = HashMap::new();
    while let Some(row) = table.next_row()? {
        let name = row.some_text(beacon)?.to_owned();
        if let Some(line) = lines.insert(name.clone(), row.line()) {
            return Err(row.wrong(beacon, &format!("{} stands in line {line} already", quoted(&name))));
        }
        let (path_loss_exponent, deviation_db) = (row.number(exponent)?, row.number(deviation)?);
        for (column, number) in [(exponent, path_loss_exponent), (deviation, deviation_db)] {
            if number.is_some_and(|number| number <= 0.0) {
                return Err(row.wrong(column, "is not above 0"));
            }
        }
        let position_m = [row.some_number(x)?, row.some_number(y)?];
        let (height_m, rssi_1m_dbm) = (row.number(z)?, row.number(rssi)?);
        if let Some(rssi_dbm) = rssi_1m_dbm.filter(|rssi_dbm| *rssi_dbm > LOUDEST_DBM) {
            return Err(row.wrong(rssi, &no_level(rssi_dbm)));
        }
        beacons.push(Beacon { name, position_m, height_m, rssi_1m_dbm, path_loss_exponent, deviation_db });
    }
    at_most(file, "beacons", beacons.len(), MOST_BEACONS)?;
    if beacons.is_empty() { Err(UserError::line(file, 1, "no beacons below the header")) } else { Ok(beacons) }
}

/// What is said of a level that no beacon has.
fn no_level(rssi_dbm: f64) -> String {
    format!("{rssi_dbm} is no level in dBm, which is below 0: is the minus sign missing?")
}

fn at_most(file: &Path, what: &str, count: usize, most: usize) -> Result<(), UserError> {
    if count > most {
        Err(UserError::file(file, format!("{count} {what}, where at most {most} are allowed")))
    } else {
        Ok(())
    }
}

/// Reads `fingerprints.csv` or `targets.csv`: `point,x_m,y_m,beacon,rssi_dbm` and, where known, `t_s,room`. A row
/// without an RSSI means that the beacon was not received.
///
/// # Errors
/// The first line that is wrong: a point that has two positions or two rooms.
pub fn read_stays(file: &Path) -> Result<Vec<Dwell>, UserError> {
    let mut table = Table::open(file)?;
    let (point, x, y) = (table.column("point")?, table.column("x_m")?, table.column("y_m")?);
    let room = table.optional("room");
    let mut signal = Signal::of(&table)?;
    let mut stays = ByName::<Dwell>::default();
    while let Some(row) = table.next_row()? {
        let name = row.some_text(point)?;
        let position_m = [row.some_number(x)?, row.some_number(y)?];
        let room_name = Some(row.text(room)).filter(|room| !room.is_empty());
        let stay = stays.of(name, || {
            let room = room_name.map(str::to_owned);
            Dwell { point: name.to_owned(), room, position_m, samples: Vec::new() }
        });
        if stay.position_m != position_m {
            let [x_m, y_m] = stay.position_m;
            return Err(row.wrong(point, &format!("{} was at {x_m}, {y_m} before", quoted(name))));
        }
        if stay.room.as_deref() != room_name {
            let before = stay.room.as_deref().unwrap_or("");
            return Err(row.wrong(room, &format!("differs from {} of {} before", quoted(before), quoted(name))));
        }
        signal.read(&row, &mut stay.samples)?;
    }
    signal.end()?;
    let stays = stays.in_order();
    let beacons =
        stays.iter().flat_map(|stay| &stay.samples).map(|sample| &sample.beacon).collect::<HashSet<_>>().len();
    if stays.is_empty() {
        return Err(UserError::line(file, 1, "no samples below the header"));
    }
    at_most(file, "beacons", beacons, MOST_BEACONS)?;
    at_most(file, "points times beacons", stays.len() * beacons, MOST_VALUES)?;
    Ok(stays)
}

/// The captures of one tag.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Captured {
    /// The tag's name; `None` where the file has no column `tag`.
    pub tag: Option<String>,
    /// Its captures, in the order of the file.
    pub captures: Vec<Capture>,
}

/// Reads `rssi.csv`: `epoch,t_s,beacon,rssi_dbm` and, where there are several tags, `tag`; or a file of dwells, whose
/// points are the true positions. `truth` is `truth.csv`. There is at least one tag.
///
/// # Errors
/// The first line that is wrong.
pub fn read_captures(file: &Path, truth: Option<&Path>) -> Result<Vec<Captured>, UserError> {
    let mut tags = if Table::open(file)?.optional("point").is_present() {
        vec![Captured { tag: None, captures: read_stays(file)?.into_iter().map(Capture::from).collect() }]
    } else {
        read_epochs(file)?
    };
    if let Some(truth) = truth {
        let truths = Truths::read(truth, false)?;
        for Captured { tag, captures } in &mut tags {
            let Some(truth) = truths.of(tag.as_deref())? else { continue };
            let named = captures.iter().map(|capture| (capture.name.as_str(), capture.t_s));
            let (places, _) = truth.of_epochs(named, 0.0);
            for (capture, place) in captures.iter_mut().zip(places) {
                // A dwell is at its point.
                capture.truth_m = place.map(|place| [place.x_m, place.y_m]).or(capture.truth_m);
            }
        }
    }
    Ok(tags)
}

fn read_epochs(file: &Path) -> Result<Vec<Captured>, UserError> {
    let mut table = Table::open(file)?;
    let (epoch, tag) = (table.column("epoch")?, table.optional("tag"));
    let mut signal = Signal::of(&table)?;
    let mut tags = ByName::<(Option<String>, ByName<Capture>)>::default();
    while let Some(row) = table.next_row()? {
        let (name, t_s) = (row.some_text(epoch)?, row.number(signal.time)?);
        let tag = tag_of(&row, tag);
        let (_, captures) = tags.of(tag.unwrap_or(""), || (tag.map(str::to_owned), ByName::default()));
        let new = || Capture { name: name.to_owned(), t_s, truth_m: None, is_stay: false, samples: Vec::new() };
        signal.read(&row, &mut captures.of(name, new).samples)?;
    }
    signal.end()?;
    let captured = |(tag, captures): (_, ByName<_>)| Captured { tag, captures: captures.in_order() };
    let tags: Vec<_> = tags.in_order().into_iter().map(captured).collect();
    if tags.is_empty() { Err(UserError::line(file, 1, "no samples below the header")) } else { Ok(tags) }
}

/// Reads `walls.csv`. The file has the corners of an outline in their order, `x_m,y_m` (or `x,y`), and each corner is
/// joined to the next. Or the file has single walls, `x1_m,y1_m,x2_m,y2_m` and, where known, `attenuation_db`.
///
/// # Errors
/// The first line that is wrong, fewer than two corners, or an attenuation below 0.
pub fn read_walls(file: &Path) -> Result<Vec<Wall>, UserError> {
    let mut table = Table::open(file)?;
    let mut walls = Vec::new();
    if table.optional("x1_m").is_present() {
        let [x1, y1, x2, y2] = ["x1_m", "y1_m", "x2_m", "y2_m"].map(|name| table.column(name));
        let (x1, y1, x2, y2, attenuation) = (x1?, y1?, x2?, y2?, table.optional("attenuation_db"));
        while let Some(row) = table.next_row()? {
            let attenuation_db = row.number(attenuation)?;
            if attenuation_db.is_some_and(|attenuation| attenuation < 0.0) {
                return Err(row.wrong(attenuation, "is below 0"));
            }
            let ends_m = [[row.some_number(x1)?, row.some_number(y1)?], [row.some_number(x2)?, row.some_number(y2)?]];
            walls.push(Wall { ends_m, attenuation_db });
        }
    } else {
        let [x, y] = if table.optional("x").is_present() { ["x", "y"] } else { ["x_m", "y_m"] };
        let (x, y) = (table.column(x)?, table.column(y)?);
        let mut corner = None;
        while let Some(row) = table.next_row()? {
            let next = [row.some_number(x)?, row.some_number(y)?];
            walls.extend(corner.replace(next).map(|corner| Wall { ends_m: [corner, next], attenuation_db: None }));
        }
    }
    at_most(file, "walls", walls.len(), MOST_WALLS)?;
    if walls.is_empty() { Err(UserError::line(file, 1, "no wall below the header")) } else { Ok(walls) }
}

/// The RSSI values of every beacon in samples, in their order, dBm. Values that no receiver can have measured are left
/// out, and so are beacons without any other value.
pub fn rssis_by_beacon(samples: &[Sample]) -> HashMap<&str, Vec<f64>> {
    let mut heard: HashMap<&str, Vec<f64>> = HashMap::new();
    for sample in samples {
        if let Ok(rssi_dbm) = rssi(sample.rssi_dbm) {
            heard.entry(&sample.beacon).or_default().push(rssi_dbm);
        }
    }
    heard
}

/// The indices of captures, sorted by their time. Dwells keep the file's order, because each dwell may have a clock of
/// its own.
pub fn in_order(captures: &[Capture]) -> Vec<usize> {
    if captures.iter().any(|capture| capture.is_stay) {
        return (0..captures.len()).collect();
    }
    by_time(captures.iter().map(|capture| capture.t_s))
}

impl Capture {
    /// The capture's outcome, with the error where the true position is known.
    pub fn solved(&self, outcome: Result<Position, NoPosition>) -> Solved {
        let truth = self.truth_m.map(|[x_m, y_m]| Coordinates { x_m, y_m, z_m: None });
        Solved::of(outcome, truth)
    }
}

impl From<Dwell> for Capture {
    fn from(stay: Dwell) -> Self {
        let t_s = stay.samples.first().map(|sample| sample.t_s);
        Self { name: stay.point, t_s, truth_m: Some(stay.position_m), is_stay: true, samples: stay.samples }
    }
}

/// The columns of the received samples, and how many of them are no levels.
#[derive(Debug)]
struct Signal {
    beacon: Column,
    rssi: Column,
    time: Column,
    /// Samples whose RSSI is a number.
    samples: usize,
    /// Samples without their minus, and the error of the first of them.
    positive: (usize, Option<UserError>),
}

impl Signal {
    fn of(table: &Table) -> Result<Self, UserError> {
        let (beacon, rssi, time) = (table.column("beacon")?, table.column("rssi_dbm")?, table.optional("t_s"));
        Ok(Self { beacon, rssi, time, samples: 0, positive: (0, None) })
    }

    /// Adds the row's sample, where the row has an RSSI.
    fn read(&mut self, row: &Row, samples: &mut Vec<Sample>) -> Result<(), UserError> {
        let beacon = row.some_text(self.beacon)?;
        let (rssi, time) = (row.number(self.rssi)?, row.number(self.time)?);
        if let Some(rssi_dbm) = rssi {
            self.samples += usize::from(rssi_dbm != UNAVAILABLE_DBM);
            if rssi_dbm > LOUDEST_DBM && rssi_dbm != UNAVAILABLE_DBM {
                let (count, first) = &mut self.positive;
                *count += 1;
                first.get_or_insert_with(|| row.wrong(self.rssi, &no_level(rssi_dbm)));
            }
            let t_s = time.or(samples.last().map(|sample| sample.t_s)).unwrap_or(0.0);
            samples.push(Sample { beacon: beacon.to_owned(), rssi_dbm, t_s });
        }
        Ok(())
    }

    /// Refuses a file most of whose levels lack their minus. Receivers report single values like that; methods leave
    /// them out.
    fn end(self) -> Result<(), UserError> {
        match self.positive {
            (count, Some(first)) if 2 * count > self.samples => Err(first),
            (_, _) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::{read_beacons, read_captures, read_stays, read_walls};

    /// Files in a folder that exists as long as the test runs.
    fn files<const N: usize>(texts: [&str; N]) -> (tempfile::TempDir, [PathBuf; N]) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut index = 0;
        let files = texts.map(|text| {
            index += 1;
            let file = folder.path().join(format!("{index}.csv"));
            std::fs::write(&file, text).expect("written");
            file
        });
        (folder, files)
    }

    #[test]
    fn rows_of_a_point_are_one_stay_wherever_they_stand() {
        let (_folder, [file]) = files(["point,room,x_m,y_m,beacon,rssi_dbm,t_s\n\
             p,hall,1,2,7,-60,0\nq,,3,4,8,-70,0.1\np,hall,1,2,8,,0.2\np,hall,1,2,7,-61,\n"]);
        let stays = read_stays(&file).expect("read");
        assert_eq!(stays.iter().map(|stay| stay.point.as_str()).collect::<Vec<_>>(), ["p", "q"]);
        assert_eq!((stays[0].room.as_deref(), stays[1].room.as_deref()), (Some("hall"), None));
        let heard: Vec<_> = stays[0].samples.iter().map(|s| (s.beacon.as_str(), s.rssi_dbm, s.t_s)).collect();
        assert_eq!(heard, [("7", -60.0, 0.0), ("7", -61.0, 0.0)]);
    }

    #[test]
    fn each_tag_has_its_own_epochs_and_truth_and_the_truth_alone_makes_none() {
        let (_folder, [rssi, truth]) = files([
            "epoch,t_s,beacon,rssi_dbm,tag\n4,0.5,a,-60,7\n4,0.5,b,-70,8\n4,0.6,b,-71,7\n",
            "epoch,t_s,x_m,y_m,tag\n4,0.5,1,2,7\n4,0.5,9,9,8\n5,1.0,3,4,7\n",
        ]);
        let tags = read_captures(&rssi, Some(&truth)).expect("read");
        assert_eq!(tags.iter().map(|of| of.tag.as_deref()).collect::<Vec<_>>(), [Some("7"), Some("8")]);
        let each = tags.iter().map(|of| {
            let capture = &of.captures[0];
            (of.captures.len(), capture.t_s, capture.truth_m, capture.samples.len())
        });
        assert_eq!(
            each.collect::<Vec<_>>(),
            [(1, Some(0.5), Some([1.0, 2.0]), 2), (1, Some(0.5), Some([9.0, 9.0]), 1)]
        );
    }

    #[test]
    fn an_outline_of_three_corners_is_two_walls() {
        let (_folder, [outline, single]) =
            files(["x,y\n0,0\n1,0\n1,2\n", "x1_m,y1_m,x2_m,y2_m,attenuation_db\n0,0,1,0,3.5\n"]);
        let ends: Vec<_> = read_walls(&outline).expect("read").iter().map(|wall| wall.ends_m).collect();
        assert_eq!(ends, [[[0.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [1.0, 2.0]]]);
        assert_eq!(read_walls(&single).expect("read")[0].attenuation_db, Some(3.5));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let (_folder, [moved, twice, exponent, corner]) = files([
            "point,x_m,y_m,beacon,rssi_dbm\np,1,2,7,-60\np,1,3,7,-60\n",
            "beacon,x_m,y_m\na,0,0\na,1,1\n",
            "beacon,x_m,y_m,path_loss_exponent\na,0,0,0\n",
            "x,y\n0,0\n",
        ]);
        let refused = |said: Result<(), crate::UserError>, ending: &str| {
            let said = said.expect_err("wrong").to_string();
            assert!(said.ends_with(ending), "{said}");
        };
        refused(read_stays(&moved).map(drop), "1.csv:3: point \"p\" was at 1, 2 before");
        refused(read_beacons(&twice).map(drop), "2.csv:3: beacon \"a\" stands in line 2 already");
        refused(read_beacons(&exponent).map(drop), "3.csv:2: path_loss_exponent is not above 0");
        refused(read_walls(&corner).map(drop), "4.csv:1: no wall below the header");
    }
}
