//! Telemetry messages with the results of ranging.

use ranging::exchange;
use wire::telemetry::quantised::{deviation, hundredths, length, position};
use wire::telemetry::{Arrival, Difference, Range};

/// The message of a range, published at `t_us`, microseconds since the node started.
pub fn range_message(t_us: u64, round: u16, range: &exchange::Range) -> Range {
    Range {
        t_us,
        round,
        peer: range.peer,
        distance_tenth_mm: length(range.distance_m),
        deviation_tenth_mm: deviation(range.deviation_m),
        position_tenth_mm: range.position_m.and_then(position),
        diagnostics: range.diagnostics.into(),
    }
}

/// The message of an arrival, published at `t_us`, microseconds since the node started.
pub fn arrival_message(t_us: u64, arrival: &exchange::Arrival) -> Arrival {
    let exchange::Arrival { source, number, frame, instant, rx_power_dbm, first_path_power_dbm } = *arrival;
    Arrival {
        t_us,
        source,
        number,
        frame,
        ticks: instant.ticks(),
        rx_power_cdbm: hundredths(rx_power_dbm),
        first_path_power_cdbm: hundredths(first_path_power_dbm),
    }
}

/// The messages of all differences of a round, published at `t_us`, microseconds since the node started. The reference
/// comes first.
pub fn difference_messages<'r>(
    t_us: u64,
    round: &exchange::Differences<'r>,
) -> impl Iterator<Item = Difference> + use<'r> {
    let (number, reference) = (round.number, round.reference);
    let first = Difference {
        t_us,
        round: number,
        reference,
        peer: reference,
        difference_tenth_mm: 0,
        deviation_tenth_mm: deviation(round.reference_deviation_m),
        position_tenth_mm: position(round.reference_m),
        diagnostics: round.reference_diagnostics.into(),
    };
    let others = round.differences.iter().map(move |measured| Difference {
        t_us,
        round: number,
        reference,
        peer: measured.peer,
        difference_tenth_mm: length(measured.difference_m),
        deviation_tenth_mm: deviation(measured.deviation_m),
        position_tenth_mm: position(measured.position_m),
        diagnostics: measured.diagnostics.into(),
    });
    core::iter::once(first).chain(others)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_told_with_the_place_of_its_anchor_where_that_is_one() {
        let mut range = exchange::Range {
            peer: 7,
            distance_m: 5.43212,
            deviation_m: 0.035,
            position_m: Some([1.0, 2.0, 3.0]),
            diagnostics: ranging::Diagnostics::default(),
        };
        let told = range_message(5, 6, &range);
        assert_eq!((told.t_us, told.round, told.peer), (5, 6, 7));
        assert_eq!((told.distance_m(), told.deviation_m(), told.position_m()), (5.4321, 0.035, Some([1.0, 2.0, 3.0])));
        range.position_m = Some([1.0, f32::NAN, 3.0]);
        assert_eq!(range_message(5, 6, &range).position_m(), None);
    }

    #[test]
    fn differences_are_told_after_their_reference() {
        let heard = |peer, difference_m| exchange::Difference {
            peer,
            difference_m,
            deviation_m: 0.04,
            position_m: [1.0, 2.0, 3.0],
            diagnostics: ranging::Diagnostics::default(),
        };
        let differences = [heard(8, -1.23456), heard(9, 0.5)];
        let round = exchange::Differences {
            number: 6,
            poll: ranging::RadioInstant::default(),
            asked: 3,
            reference: 7,
            reference_m: [0.0, 0.5, 2.0],
            reference_deviation_m: 0.03,
            reference_diagnostics: ranging::Diagnostics { preamble_count: 99, ..ranging::Diagnostics::default() },
            differences: &differences,
        };
        let told: std::vec::Vec<_> = difference_messages(5, &round).collect();
        assert!(told.iter().all(|told| (told.t_us, told.round, told.reference) == (5, 6, 7)));
        let numbers = told.iter().map(|told| (told.peer, told.difference_m(), told.deviation_m()));
        assert!(numbers.eq([(7, 0.0, 0.03), (8, -1.2346, 0.04), (9, 0.5, 0.04)]));
        assert_eq!((told[0].position_m(), told[0].diagnostics.preamble_count), (Some([0.0, 0.5, 2.0]), 99));
        assert_eq!(told[2].position_m(), Some([1.0, 2.0, 3.0]));
    }
}
