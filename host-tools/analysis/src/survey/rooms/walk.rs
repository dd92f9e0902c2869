//! The rooms of a walk, interval by interval, by the model that a tag has.
//!
//! The input is the RSSI values of one tag with their times. Each window becomes a scan, which the model classifies.
//! The output is the most frequent room of each interval, and the room estimate of the tag at its end.

use anyhow::{Context, Result};
use positioning_core::ble::rooms::{Classifier, Model, RoomEstimate, RoomHysteresis, Settings, likeliest};

use super::survey::windows;
use super::train::Trained;
use recording::beacons::Sample;

/// An interval of a walk.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// Its beginning, seconds.
    pub t_s: f64,
    /// Its windows.
    pub windows: usize,
    /// The windows in which a beacon of the model was received.
    pub classified: usize,
    /// The most frequent of the windows' most probable rooms, and in how many of the classified windows it is; `None`
    /// where none is classified.
    pub room: Option<(usize, usize)>,
    /// The room estimate of the tag at the end of the interval.
    pub answer: RoomEstimate,
}

/// The rooms of a walk in intervals of `every_s`, by windows of `window_s`, both in seconds. `beacons` are those of the
/// model in its order. An incomplete window at the end is dropped.
///
/// # Errors
/// The model cannot be read.
pub fn follow(
    trained: &Trained,
    beacons: &[String],
    samples: &[Sample],
    window_s: f64,
    every_s: f64,
) -> Result<Vec<Interval>> {
    let (model, _) = Model::decode(&trained.bytes).context("cannot read the model that was made")?;
    let begin_s = samples.iter().map(|sample| sample.t_s).fold(f64::INFINITY, f64::min);
    let mut presence = RoomHysteresis::new(Settings::default());
    let mut intervals: Vec<(Interval, Vec<usize>)> = Vec::new();
    for (index, scan) in windows(samples, beacons, window_s).iter().enumerate() {
        let since_s = index as f64 * window_s;
        let number = (since_s / every_s + 1e-9) as usize;
        if intervals.len() <= number {
            let t_s = begin_s + number as f64 * every_s;
            let new = Interval { t_s, windows: 0, classified: 0, room: None, answer: RoomEstimate::Unknown };
            intervals.resize(number + 1, (new, vec![0; trained.rooms.len()]));
        }
        let Some((interval, counts)) = intervals.last_mut() else { continue };
        let probabilities = model.probabilities(scan);
        interval.windows += 1;
        if let Some(count) = probabilities.as_ref().and_then(likeliest).and_then(|(room, _)| counts.get_mut(room)) {
            interval.classified += 1;
            *count += 1;
        }
        interval.answer = presence.step((1e6 * (since_s + window_s)) as u64, probabilities.as_ref());
    }
    let finished = |(interval, counts): (Interval, Vec<usize>)| {
        // Of two equally frequent rooms, the first.
        let most = counts.iter().copied().max().filter(|most| *most > 0);
        let room = most.and_then(|most| Some((counts.iter().position(|count| *count == most)?, most)));
        Interval { room, ..interval }
    };
    Ok(intervals.into_iter().map(finished).collect())
}
