//! What a simulation yields: epochs beside the truth, changes of links, failures; and the sum of it.

use firmware_tag::Position;
use positioning_core::NoFix;
use positioning_core::nlos::Shape;
use ranging::exchange::{Link, Range};
use serde::Serialize;

use crate::air::AirStatistics;

/// Something that a node found out, or that happened to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// When, seconds of true time.
    pub t_s: f64,
    /// The node, by its address.
    pub node: u16,
    /// What.
    pub what: What,
}

/// What a node found out, or what happened to it.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// A tag finished a round.
    Epoch(Epoch),
    /// A link has changed.
    Link(Link),
    /// The radio failed for the so-manieth time in a row.
    RadioFailed(u32),
    /// The scenario did something to the node.
    Fault(super::FaultKind),
}

/// A round of a tag, and what it made of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Epoch {
    /// Counts the epochs of all tags, from 0.
    pub number: u64,
    /// Where the tag was, metres.
    pub truth_m: [f64; 3],
    /// Where it thinks it is, or why it does not know.
    pub outcome: Result<Position, NoFix>,
    /// Anchors that were asked.
    pub asked: u8,
    /// The ranges had.
    pub ranges: Vec<RangeRecord>,
}

/// A range beside the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeRecord {
    /// As the exchange reported it.
    pub range: Range,
    /// The straight distance, metres.
    pub truth_m: f64,
    /// Whether nothing stands in between.
    pub los: bool,
    /// The shape of its impulse response, where that was read.
    pub shape: Option<Shape>,
}

impl Epoch {
    /// How far the position is from the truth, metres: in the plane where the height was given, else in space.
    pub fn error_m(&self) -> Option<f64> {
        let position = self.outcome.as_ref().ok()?;
        let axes = if position.height_is_given() { 2 } else { 3 };
        let square: f64 = (0..axes).map(|i| (f64::from(position.position_m[i]) - self.truth_m[i]).powi(2)).sum();
        Some(square.sqrt())
    }
}

/// A simulation in figures. Metres and seconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Tags.
    pub tags: usize,
    /// Anchors.
    pub anchors: usize,
    /// Seconds simulated.
    pub seconds: f64,
    /// Positions found.
    pub fixes: usize,
    /// Positions found a second, by all tags together.
    pub fixes_per_s: f64,
    /// Root mean square of the positions' errors; none without positions.
    pub rmse_m: Option<f64>,
    /// Half of the positions err less.
    pub p50_m: Option<f64>,
    /// Nine in ten err less.
    pub p90_m: Option<f64>,
    /// Frames sent.
    pub frames_sent: u64,
    /// Receptions that were begun and came to nothing: by the scenario's loss, for want of power, under another frame.
    /// A frame to many receivers may count more than once.
    pub frames_lost: u64,
    /// Frames that another frame destroyed at one receiver or more.
    pub collisions: u64,
    /// Time frames were on the air, summed over all channels, against the time passed.
    pub airtime_share: f64,
}

impl Summary {
    /// Of the errors of all positions, in any order.
    pub(super) fn new(nodes: [usize; 2], seconds: f64, mut errors_m: Vec<f64>, air: AirStatistics) -> Self {
        errors_m.sort_by(f64::total_cmp);
        let fixes = errors_m.len();
        let square: f64 = errors_m.iter().map(|e| e * e).sum();
        let per_second = if seconds > 0.0 { 1.0 / seconds } else { 0.0 };
        Self {
            tags: nodes[0],
            anchors: nodes[1],
            seconds,
            fixes,
            fixes_per_s: fixes as f64 * per_second,
            rmse_m: (fixes > 0).then(|| (square / fixes as f64).sqrt()),
            p50_m: percentile(&errors_m, 0.5),
            p90_m: percentile(&errors_m, 0.9),
            frames_sent: air.frames_sent,
            frames_lost: air.lost_by_chance + air.lost_to_noise + air.lost_to_collision,
            collisions: air.frames_collided,
            airtime_share: air.airtime_s * per_second,
        }
    }
}

/// The value below which `part` of the sorted values lie, interpolated linearly between neighbours.
fn percentile(sorted: &[f64], part: f64) -> Option<f64> {
    let place = part * sorted.len().checked_sub(1)? as f64;
    let below = sorted.get(place as usize)?;
    let above = sorted.get(place as usize + 1).unwrap_or(below);
    Some(below + (above - below) * place.fract())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_four_errors_by_hand() {
        let air = AirStatistics {
            frames_sent: 7,
            lost_by_chance: 1,
            lost_to_noise: 2,
            lost_to_collision: 3,
            frames_collided: 2,
            airtime_s: 0.5,
            ..Default::default()
        };
        let summary = Summary::new([1, 4], 2.0, vec![4.0, 1.0, 2.0, 2.0], air);
        // √((1 + 4 + 4 + 16) / 4) = 2.5; the middle of 2 and 2; 0.9·3 = 2.7: 0.7 of the way from 2 to 4.
        assert_eq!((summary.rmse_m, summary.p50_m), (Some(2.5), Some(2.0)));
        assert!((summary.p90_m.unwrap() - 3.4).abs() < 1e-12);
        assert_eq!((summary.fixes, summary.fixes_per_s, summary.airtime_share), (4, 2.0, 0.25));
        assert_eq!((summary.frames_sent, summary.frames_lost, summary.collisions), (7, 6, 2));
    }

    #[test]
    fn no_position_has_no_error() {
        let summary = Summary::new([1, 4], 1.0, Vec::new(), AirStatistics::default());
        assert_eq!((summary.rmse_m, summary.p50_m, summary.p90_m), (None, None, None));
    }
}
