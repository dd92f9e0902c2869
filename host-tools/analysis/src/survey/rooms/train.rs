//! A model trained on chosen points, in the format that a node reads.

use anyhow::{Context, Result};
use positioning_core::ble::rooms::{Kind, Model, Nearest, Svm, level_byte};

use super::survey::{Point, Survey};
use super::svm::{self, Example};

/// The slope of the sigmoid of a margin: on the recorded floor, with points left out in turn, the logarithmic loss is
/// flat between 3 and 10.
const SLOPE: f32 = 5.0;
/// Number of fingerprints that vote.
const NEIGHBOURS: u8 = 3;
/// Assumed RSSI of a beacon that no chosen point receives, dBm.
const NEVER_HEARD_DBM: f64 = -100.0;
/// Room for any model: 32 rooms and 24 beacons, or some two thousand fingerprints.
const LONGEST: usize = 64 * 1024;

/// How rooms are classified.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Linear support vector machine, one plane for each pair of rooms.
    Svm,
    /// The three nearest fingerprints.
    Nearest,
}

impl Method {
    /// All of them, the best first.
    pub const ALL: [Self; 2] = [Self::Svm, Self::Nearest];

    /// Its name on the command line.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Svm => "svm",
            Self::Nearest => "knn",
        }
    }
}

impl From<&Kind<'_>> for Method {
    fn from(kind: &Kind) -> Self {
        match kind {
            Kind::Svm(_) => Self::Svm,
            Kind::Nearest(_) => Self::Nearest,
        }
    }
}

/// A trained model.
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// The bytes that the node reads.
    pub bytes: Vec<u8>,
    /// The model's rooms, by their indices in [`Survey::rooms`].
    pub rooms: Vec<usize>,
}

/// Trains on chosen points; `None` where they are of fewer than two rooms.
///
/// # Errors
/// There are too many points for a model.
pub fn train(method: Method, survey: &Survey, chosen: &[&Point]) -> Result<Option<Trained>> {
    let rooms: Vec<usize> =
        (0..survey.rooms.len()).filter(|room| chosen.iter().any(|point| point.room == *room)).collect();
    if rooms.len() < 2 {
        return Ok(None);
    }
    let number = |room: usize| rooms.iter().position(|known| *known == room).unwrap_or(0);
    // A beacon that is not received counts as its weakest RSSI at the points that receive it.
    let fallback_dbm: Vec<f64> = (0..survey.beacons.len())
        .map(|beacon| {
            let means = chosen.iter().filter_map(|point| point.heard[beacon]).map(|heard| heard.mean_dbm);
            means.reduce(f64::min).unwrap_or(NEVER_HEARD_DBM)
        })
        .collect();
    let bytes_of = |numbers: &mut dyn Iterator<Item = f64>| -> Vec<u8> {
        numbers.flat_map(|number| (number as f32).to_le_bytes()).collect()
    };
    let (fallback, contents);
    let kind = match method {
        Method::Svm => {
            let examples: Vec<Example> = chosen
                .iter()
                .map(|point| {
                    let heard = point.heard.iter().zip(&fallback_dbm);
                    let rssis = heard.map(|(heard, fallback)| {
                        heard.map_or((*fallback, 0.0), |heard| (heard.mean_dbm, heard.deviation_db))
                    });
                    Example { room: number(point.room), rssis: rssis.collect() }
                })
                .collect();
            fallback = bytes_of(&mut fallback_dbm.iter().copied());
            contents = bytes_of(&mut svm::planes(rooms.len(), &examples).into_iter().flatten());
            Kind::Svm(Svm { rooms: rooms.len() as u8, slope: SLOPE, fallback_dbm: &fallback, planes: &contents })
        }
        Method::Nearest => {
            fallback = fallback_dbm.iter().map(|rssi| level_byte(Some(*rssi as f32))).collect();
            contents = chosen
                .iter()
                .flat_map(|point| {
                    let rssis = point.scan().into_iter().map(level_byte);
                    std::iter::once(number(point.room) as u8).chain(rssis).collect::<Vec<_>>()
                })
                .collect();
            let neighbours = NEIGHBOURS.min(u8::try_from(chosen.len()).unwrap_or(NEIGHBOURS));
            Kind::Nearest(Nearest {
                rooms: rooms.len() as u8,
                neighbours,
                fallback: &fallback,
                fingerprints: &contents,
            })
        }
    };
    let mut buffer = vec![0; LONGEST];
    let bytes = Model { kind }.encode(&mut buffer).context("cannot make a model of these fingerprints")?.to_vec();
    Ok(Some(Trained { bytes, rooms }))
}
