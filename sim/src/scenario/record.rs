//! The output of a simulation: the nodes' reports beside the true values, the faults, and a summary.

use baliza_report::Statistics;
use positioning_core::nlos::Shape;
use serde::Serialize;
use wire::telemetry::{Difference, Fix, Message, Range};

use super::draw::{Charges, Drawn};
use crate::air::AirStatistics;
use crate::bluetooth::BluetoothStatistics;

/// A report of a node, or a fault of the node.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// When, seconds of true time.
    pub t_s: f64,
    /// The node, by its address.
    pub node: u16,
    /// The report or fault.
    pub what: What,
}

impl Record {
    /// The epoch, if it is one.
    pub fn epoch(&self) -> Option<&SimulatedEpoch> {
        match &self.what {
            What::Epoch(epoch) => Some(epoch),
            What::Message(_) | What::Fault(_) => None,
        }
    }

    /// The node's messages that the record is made of, in their order: none of a position that a station has computed.
    pub fn messages(&self) -> impl Iterator<Item = Message> {
        let (epoch, message) = match &self.what {
            What::Epoch(epoch) => (Some(epoch).filter(|epoch| !epoch.is_of_station), None),
            What::Message(message) => (None, Some(*message)),
            What::Fault(_) => (None, None),
        };
        let of_epoch = epoch.into_iter().flat_map(|epoch| {
            let ranges = epoch.ranges.iter().map(|range| Message::Range(range.range));
            let differences = epoch.differences.iter().map(|difference| Message::Difference(difference.difference));
            ranges.chain(differences).chain([Message::Fix(epoch.fix)])
        });
        of_epoch.chain(message)
    }
}

/// A node's report or fault.
#[derive(Clone, Debug, PartialEq)]
pub enum What {
    /// A tag finished a round, or a window of RSSI values.
    Epoch(SimulatedEpoch),
    /// A node reported anything else.
    Message(Message),
    /// The scenario did something to the node.
    Fault(super::FaultKind),
}

/// The sensors that gave a tag's position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// A round with anchors. Beacons received in the meantime are also in the track.
    Anchors,
    /// A window of RSSI values of beacons, while anchors gave no position.
    Beacons,
}

/// A round of a tag, or a window of RSSI values, and its result.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedEpoch {
    /// Counts the epochs of all tags, from 0.
    pub number: u64,
    /// The true position of the tag, metres.
    pub truth_m: [f64; 3],
    /// The reported position, or the reason why there is none.
    pub fix: Fix,
    /// Whether a station has computed it, of a tag's blink.
    pub is_of_station: bool,
    /// The measured ranges.
    pub ranges: Vec<RangeRecord>,
    /// The measured differences, if the tag only listens; the reference is first.
    pub differences: Vec<DifferenceRecord>,
}

/// What a tag's engine was given of a reception. Telemetry rounds it to tenths of millimetres and hundredths of dB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unrounded {
    /// The range or the difference, metres.
    pub measured_m: f32,
    /// Its expected standard deviation with line of sight, metres.
    pub deviation_m: f32,
    /// Received power and power of the first path, dBm.
    pub powers_dbm: [f32; 2],
}

/// A range beside the true distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeRecord {
    /// As the tag reported it.
    pub range: Range,
    /// As the tag's engine used it.
    pub unrounded: Unrounded,
    /// The straight distance, metres.
    pub truth_m: f64,
    /// Whether nothing is between the tag and the anchor.
    pub los: bool,
    /// The shape of its impulse response, if it was read.
    pub shape: Option<Shape>,
}

/// A difference of arrivals beside the true difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DifferenceRecord {
    /// As the tag reported it.
    pub difference: Difference,
    /// As the tag's engine used it.
    pub unrounded: Unrounded,
    /// The straight distance minus that of the reference, metres.
    pub truth_m: f64,
    /// Whether nothing is between the tag and the anchor.
    pub los: bool,
}

impl SimulatedEpoch {
    /// The sensors that gave the position.
    pub fn source(&self) -> Source {
        if self.fix.asked == 0 { Source::Beacons } else { Source::Anchors }
    }

    /// The position's error, metres: in the plane if the height was given, otherwise in space.
    pub fn error_m(&self) -> Option<f64> {
        let (position_m, deviation_m) = (self.fix.position_m()?, self.fix.deviation_m()?);
        let axes = if deviation_m[2] == 0.0 { 2 } else { 3 };
        let square: f64 = (0..axes).map(|i| (position_m[i] - self.truth_m[i]).powi(2)).sum();
        Some(square.sqrt())
    }

    /// The square of the horizontal error in units of the reported covariance: 2 in the mean where that is right.
    pub fn normalised_square(&self) -> Option<f64> {
        let (position_m, [[xx, xy, _], [_, yy, _], _]) = (self.fix.position_m()?, self.fix.covariance_m2()?);
        let [x, y] = [0, 1].map(|axis| position_m[axis] - self.truth_m[axis]);
        let square = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy);
        square.is_finite().then_some(square)
    }
}

/// The error of a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct PositionError {
    /// What gave the position.
    pub(super) source: Source,
    /// Metres.
    pub(super) error_m: f64,
    /// In units of the reported covariance; none where that is singular.
    pub(super) normalised_square: Option<f64>,
}

/// The figures of a simulation, in metres and seconds.
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
    /// Positions found per second, by all tags together.
    pub fixes_per_s: f64,
    /// Root mean square of the positions' errors. `None` without positions.
    pub rmse_m: Option<f64>,
    /// Median of the positions' errors.
    pub p50_m: Option<f64>,
    /// 90th percentile of the positions' errors.
    pub p90_m: Option<f64>,
    /// Mean of the positions' errors.
    pub mae_m: Option<f64>,
    /// The share of the horizontal errors inside the reported 1σ ellipse: 0.39 where the covariance is right.
    pub inside_1_sigma: Option<f64>,
    /// The mean of the squared horizontal errors in units of their reported covariance (normalised estimation error
    /// squared): 2 where the covariance is right.
    pub nees: Option<f64>,
    /// Frames sent.
    pub frames_sent: u64,
    /// Receptions that began and were lost: by the scenario's loss, by too little power, under another frame. A frame
    /// to many receivers may count more than once.
    pub frames_lost: u64,
    /// Frames that another frame destroyed at one receiver or more.
    pub collisions: u64,
    /// The share of the time at which a frame of a network was on the air: the mean over networks.
    pub airtime_share: f64,
    /// The same of the busiest network.
    pub airtime_share_max: f64,
    /// Tags that had slots of a network at some time. Tags that only listen, or have no native mode, need none.
    pub tags_joined: usize,
    /// When the last of them had slots for the first time, seconds. `None` if none had.
    pub joined_s: Option<f64>,
    /// The share of the slots of tags with a fixed rate that gave a position, since each tag joined; above 1 if slots
    /// come a little more often than asked for. `None` without such tags.
    pub slots_with_fix: Option<f64>,
    /// The share of the positions told in polls that an anchor with a cable reported. `None` without such positions.
    pub uplink_share: Option<f64>,
    /// The time from a tag's report of a position to that of the anchor which 99 % of them do not exceed, seconds.
    pub uplink_p99_s: Option<f64>,
    /// The share of the data of tags' users that an anchor with a cable reported. `None` without such data.
    pub data_share: Option<f64>,
    /// The share of the hosts' messages to tags that their tags took. `None` without messages.
    pub message_share: Option<f64>,
    /// The time from a host's message to the tag's answer which 99 % of them do not exceed, seconds.
    pub message_p99_s: Option<f64>,
    /// Frames that attackers have sent. `None` without attackers.
    pub forged_frames: Option<u64>,
    /// How often a node has believed one of them: it was in another state afterwards, or did something else, than after a
    /// frame that it cannot read.
    pub forged_accepted: Option<u64>,
    /// Mean current of a tag from its supply, board and DW1000 together, milliamperes. It counts from the tag's first
    /// position on, or from the beginning if the tag found no position. `None` for radios directly on the air.
    pub tag_mean_current_ma: Option<f64>,
    /// The same charge per position found in that time, microcoulombs.
    pub charge_per_fix_uc: Option<f64>,
    /// The mean current by consumer.
    pub tag_currents_ma: Option<Charges>,
    /// The figures about beacons, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bluetooth: Option<BluetoothSummary>,
}

/// A simulation's figures about beacons.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BluetoothSummary {
    /// Beacons.
    pub beacons: usize,
    /// Advertisements sent; each channel counts.
    pub adverts_sent: u64,
    /// Receptions.
    pub adverts_heard: u64,
    /// Lost receptions: by the scenario's loss, by too little power, under another advertisement.
    pub adverts_lost: u64,
    /// The positions of rounds with anchors.
    pub by_anchors: Cover,
    /// The positions by beacons, where anchors gave none.
    pub by_beacons: Cover,
}

/// The figures of the positions found by one kind of sensor, in metres.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cover {
    /// The number of positions.
    pub fixes: usize,
    /// Root mean square of their errors. `None` without positions.
    pub rmse_m: Option<f64>,
    /// Median of their errors.
    pub p50_m: Option<f64>,
    /// 90th percentile of their errors.
    pub p90_m: Option<f64>,
}

impl Cover {
    fn of(errors_m: impl Iterator<Item = f64>) -> Self {
        let errors_m: Vec<f64> = errors_m.collect();
        let figures = Statistics::of(&errors_m);
        Self {
            fixes: errors_m.len(),
            rmse_m: figures.map(|figures| figures.rmse),
            p50_m: figures.map(|figures| figures.p50),
            p90_m: figures.map(|figures| figures.p90),
        }
    }
}

impl BluetoothSummary {
    /// Makes the figures from the number of beacons and the errors of all positions.
    pub(super) fn new(beacons: usize, errors: &[PositionError], air: BluetoothStatistics) -> Self {
        let by =
            |source: Source| Cover::of(errors.iter().filter(|error| error.source == source).map(|error| error.error_m));
        Self {
            beacons,
            adverts_sent: air.sent,
            adverts_heard: air.heard,
            adverts_lost: air.lost_to_noise + air.lost_by_chance + air.lost_to_collision,
            by_anchors: by(Source::Anchors),
            by_beacons: by(Source::Beacons),
        }
    }
}

impl Summary {
    /// Makes the figures from the errors of all positions, in any order, and from the airtime shares of all networks.
    pub(super) fn new(
        nodes: [usize; 2],
        seconds: f64,
        errors: &[PositionError],
        air: AirStatistics,
        airtime_shares: &[f64],
    ) -> Self {
        let Cover { fixes, rmse_m, p50_m, p90_m } = Cover::of(errors.iter().map(|error| error.error_m));
        let squares: Vec<f64> = errors.iter().filter_map(|error| error.normalised_square).collect();
        let inside = squares.iter().map(|square| if *square <= 1.0 { 1.0 } else { 0.0 });
        let per_second = if seconds > 0.0 { 1.0 / seconds } else { 0.0 };
        Self {
            tags: nodes[0],
            anchors: nodes[1],
            seconds,
            fixes,
            fixes_per_s: fixes as f64 * per_second,
            rmse_m,
            p50_m,
            p90_m,
            mae_m: mean(errors.iter().map(|error| error.error_m)),
            inside_1_sigma: mean(inside),
            nees: mean(squares.iter().copied()),
            frames_sent: air.frames_sent,
            frames_lost: air.lost_by_chance + air.lost_to_noise + air.lost_to_collision,
            collisions: air.frames_collided,
            airtime_share: airtime_shares.iter().sum::<f64>() / airtime_shares.len().max(1) as f64,
            airtime_share_max: airtime_shares.iter().copied().fold(0.0, f64::max),
            tags_joined: 0,
            joined_s: None,
            slots_with_fix: None,
            uplink_share: None,
            uplink_p99_s: None,
            data_share: None,
            message_share: None,
            message_p99_s: None,
            forged_frames: None,
            forged_accepted: None,
            tag_mean_current_ma: None,
            charge_per_fix_uc: None,
            tag_currents_ma: None,
            bluetooth: None,
        }
    }

    /// Adds how tags joined: for each of those the time, seconds, its rate, if that is fixed, rounds a second, and its
    /// number of positions.
    pub(super) fn with_joined(self, joined: &[(f64, Option<f64>, usize)]) -> Self {
        let last_s = joined.iter().map(|(at_s, ..)| *at_s).fold(f64::NEG_INFINITY, f64::max);
        let of_fixed = joined.iter().filter_map(|&(at_s, rate_hz, fixes)| Some((at_s, rate_hz?, fixes)));
        let (slots, fixes) = of_fixed.fold((0.0, 0), |(slots, all), (at_s, rate_hz, fixes)| {
            (slots + (self.seconds - at_s) * rate_hz, all + fixes)
        });
        Self {
            tags_joined: joined.len(),
            joined_s: last_s.is_finite().then_some(last_s),
            slots_with_fix: (slots > 0.0).then(|| fixes as f64 / slots),
            ..self
        }
    }

    /// Adds the charge that all tags together drew.
    pub(super) fn with_charge(self, drawn: Option<Drawn>) -> Self {
        let currents_ma = drawn.and_then(|drawn| drawn.currents_ma());
        let per_fix = |drawn: Drawn| drawn.charges.sum() / drawn.fixes as f64;
        Self {
            tag_mean_current_ma: currents_ma.map(|currents| currents.sum()),
            charge_per_fix_uc: drawn.filter(|drawn| drawn.fixes > 0).map(per_fix),
            tag_currents_ma: currents_ma,
            ..self
        }
    }
}

/// The arithmetic mean. `None` without values.
fn mean(values: impl ExactSizeIterator<Item = f64>) -> Option<f64> {
    (values.len() > 0).then(|| baliza_report::mean(values))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(source: Source, error_m: f64, normalised_square: Option<f64>) -> PositionError {
        PositionError { source, error_m, normalised_square }
    }

    #[test]
    fn figures_of_four_errors_by_hand() {
        let air = AirStatistics {
            frames_sent: 7,
            lost_by_chance: 1,
            lost_to_noise: 2,
            lost_to_collision: 3,
            frames_collided: 2,
            ..Default::default()
        };
        let of = |(error_m, square)| error(Source::Anchors, error_m, square);
        let errors = [(4.0, Some(5.0)), (1.0, Some(0.25)), (2.0, None), (2.0, Some(0.75))].map(of);
        let summary = Summary::new([1, 4], 2.0, &errors, air, &[0.5, 0.0]);
        // √((1 + 4 + 4 + 16) / 4) = 2.5; the middle of 2 and 2; 0.9·3 = 2.7: 0.7 of the way from 2 to 4.
        assert_eq!((summary.rmse_m, summary.p50_m), (Some(2.5), Some(2.0)));
        assert!((summary.p90_m.unwrap() - 3.4).abs() < 1e-12);
        // (4 + 1 + 2 + 2) / 4 = 2.25; two of three squares are at most 1; (5 + 0.25 + 0.75) / 3 = 2.
        assert_eq!((summary.mae_m, summary.inside_1_sigma, summary.nees), (Some(2.25), Some(2.0 / 3.0), Some(2.0)));
        assert_eq!((summary.fixes, summary.fixes_per_s), (4, 2.0));
        assert_eq!((summary.airtime_share, summary.airtime_share_max), (0.25, 0.5));
        assert_eq!((summary.frames_sent, summary.frames_lost, summary.collisions), (7, 6, 2));
    }

    #[test]
    fn joined_tags_and_their_slots_by_hand() {
        let summary = Summary::new([4, 4], 10.0, &[], AirStatistics::default(), &[]);
        assert_eq!((summary.tags_joined, summary.joined_s, summary.slots_with_fix), (0, None, None));
        // 8 slots of one tag and 5 · 2 of another: 18, of which 17 gave a position. A greedy tag has no number of slots.
        let summary = summary.with_joined(&[(2.0, Some(1.0), 8), (5.0, Some(2.0), 9), (6.0, None, 900)]);
        assert_eq!((summary.tags_joined, summary.joined_s, summary.slots_with_fix), (3, Some(6.0), Some(17.0 / 18.0)));
    }

    #[test]
    fn charge_is_shared_among_tags_and_positions() {
        let summary = Summary::new([2, 4], 5.0, &[], AirStatistics::default(), &[]);
        // 20 mC by two tags in five seconds: 2 mA each. Four positions: 5 mC each.
        let charges = Charges { receiving: 15_000.0, processor: 5_000.0, ..Charges::default() };
        let charged = summary.clone().with_charge(Some(Drawn { charges, seconds: 10.0, fixes: 4 }));
        assert_eq!(charged.tag_currents_ma.map(|currents| (currents.receiving, currents.processor)), Some((1.5, 0.5)));
        assert_eq!((charged.tag_mean_current_ma, charged.charge_per_fix_uc), (Some(2.0), Some(5_000.0)));
        assert_eq!(summary.clone().with_charge(None), summary);
    }

    #[test]
    fn positions_are_told_apart_by_what_gave_them() {
        let air = BluetoothStatistics { sent: 9, heard: 2, lost_to_noise: 1, lost_by_chance: 2, lost_to_collision: 3 };
        let errors = [(Source::Anchors, 0.1), (Source::Beacons, 3.0), (Source::Beacons, 1.0)];
        let errors = errors.map(|(source, error_m)| error(source, error_m, None));
        let summary = BluetoothSummary::new(5, &errors, air);
        assert_eq!((summary.beacons, summary.adverts_lost), (5, 6));
        assert_eq!((summary.by_anchors.fixes, summary.by_anchors.p50_m), (1, Some(0.1)));
        // The middle of 1 and 3.
        assert_eq!((summary.by_beacons.fixes, summary.by_beacons.p50_m), (2, Some(2.0)));
    }

    #[test]
    fn no_position_has_no_error() {
        let summary = Summary::new([1, 4], 1.0, &[], AirStatistics::default(), &[]);
        assert_eq!((summary.rmse_m, summary.p50_m, summary.p90_m), (None, None, None));
        assert_eq!((summary.mae_m, summary.inside_1_sigma, summary.nees), (None, None, None));
    }
}
