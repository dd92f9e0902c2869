//! How often a model is right: for whole dwells, for short windows, and for the room estimates with hysteresis.

use anyhow::{Context, Result};
use positioning_core::ble::rooms::{Classifier, Model, RoomEstimate, RoomHysteresis, Settings, likeliest};

use super::survey::{Point, Survey};
use super::train::{Method, Trained, train};

/// The score of a method.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// The method.
    pub method: Method,
    /// Number of points with the right room from the whole dwell.
    pub right: usize,
    /// For each true room the number of answers of each room for a whole dwell; the last column is no answer.
    pub confusion: Vec<Vec<usize>>,
    /// Number of windows with the right room.
    pub windows_right: usize,
    /// Number of windows.
    pub windows: usize,
    /// How often the room changed from one window of a dwell to the next, without hysteresis.
    pub changes: usize,
    /// The answers of [`RoomHysteresis`] for the windows.
    pub settled: Settled,
}

/// Answers of [`RoomHysteresis`], one a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Settled {
    /// Answers of the right room.
    pub right: usize,
    /// Answers of another one.
    pub wrong: usize,
    /// Answers between two rooms, or unknown.
    pub between: usize,
    /// How often a room followed another room within a dwell.
    pub changes: usize,
}

impl Score {
    fn new(method: Method, rooms: usize) -> Self {
        Self {
            method,
            right: 0,
            confusion: vec![vec![0; rooms + 1]; rooms],
            windows_right: 0,
            windows: 0,
            changes: 0,
            settled: Settled::default(),
        }
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.confusion.iter().flatten().sum()
    }

    fn add(&mut self, trained: &Trained, point: &Point, window_us: u64) -> Result<()> {
        let (model, _) = Model::decode(&trained.bytes).context("cannot read the model that was made")?;
        let answer = |scan: &[Option<f32>]| {
            let probabilities = model.probabilities(scan);
            let room =
                probabilities.as_ref().and_then(likeliest).and_then(|(room, _)| trained.rooms.get(room).copied());
            (probabilities, room)
        };
        let (_, room) = answer(&point.scan());
        self.right += usize::from(room == Some(point.room));
        let row = &mut self.confusion[point.room];
        let none = row.len() - 1;
        row[room.unwrap_or(none)] += 1;

        let mut presence = RoomHysteresis::new(Settings::default());
        let (mut before, mut settled_before) = (None, None);
        for (window, scan) in (1..).zip(&point.windows) {
            let (probabilities, room) = answer(scan);
            self.windows += 1;
            self.windows_right += usize::from(room == Some(point.room));
            self.changes += usize::from(before.is_some() && before != room);
            before = room.or(before);
            match presence.step(window * window_us, probabilities.as_ref()) {
                RoomEstimate::Room(number) => {
                    let room = trained.rooms.get(usize::from(number)).copied();
                    if room == Some(point.room) {
                        self.settled.right += 1;
                    } else {
                        self.settled.wrong += 1;
                    }
                    self.settled.changes += usize::from(settled_before.is_some() && settled_before != room);
                    settled_before = room;
                }
                RoomEstimate::Between(..) | RoomEstimate::Unknown => self.settled.between += 1,
            }
        }
        Ok(())
    }
}

/// Trains on all points of a survey and classifies the targets; `step` is called for each.
///
/// # Errors
/// The training fails, as in [`train`].
pub fn score(method: Method, survey: &Survey, targets: &Survey, window_s: f64, step: impl Fn()) -> Result<Score> {
    let chosen: Vec<&Point> = survey.points.iter().collect();
    let trained = train(method, survey, &chosen)?.context("the fingerprints are of one room")?;
    evaluate(method, &trained, targets, window_s, step)
}

/// Classifies the targets by a model; `step` is called for each.
///
/// # Errors
/// The model cannot be read.
pub fn evaluate(method: Method, trained: &Trained, targets: &Survey, window_s: f64, step: impl Fn()) -> Result<Score> {
    let mut score = Score::new(method, targets.rooms.len());
    for point in &targets.points {
        score.add(trained, point, microseconds(window_s))?;
        step();
    }
    Ok(score)
}

/// Classifies each point by a model of all the others; `step` is called for each. The model takes nothing from the
/// point that is left out, neither fall-back RSSI values nor a choice.
///
/// # Errors
/// The training fails, as in [`train`].
pub fn leave_one_out(method: Method, survey: &Survey, window_s: f64, step: impl Fn()) -> Result<Score> {
    let mut score = Score::new(method, survey.rooms.len());
    for (index, point) in survey.points.iter().enumerate() {
        let others = survey.points.iter().enumerate().filter(|(other, _)| *other != index);
        let chosen: Vec<&Point> = others.map(|(_, other)| other).collect();
        let trained = train(method, survey, &chosen)?.context("without one of the points there is one room left")?;
        score.add(&trained, point, microseconds(window_s))?;
        step();
    }
    Ok(score)
}

fn microseconds(window_s: f64) -> u64 {
    (1e6 * window_s) as u64
}
