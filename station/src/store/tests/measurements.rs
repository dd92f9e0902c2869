//! Measurements, and the nodes that they are to.

use super::*;
use crate::model::{HealthFigures, MeasuredValue, NodeMeasurement, NodeRole, NodeStatus, PlacedNode, RangeMeasurement};

pub const RANGE: MeasuredValue = MeasuredValue::Range(RangeMeasurement {
    rx_power_dbm: Some(-81.25),
    first_path_power_dbm: Some(-84.5),
    clock_offset_ppm: Some(-2.35),
    ..RangeMeasurement::of(3.217)
});

/// A measurement 5 ms before the end of its round.
pub fn measurement(tag: &str, node: &str, round_ms: i64, what: MeasuredValue) -> NodeMeasurement {
    let (site, tag, node) = ("hall".to_owned(), tag.to_owned(), node.to_owned());
    NodeMeasurement { site, tag, node, round: at(round_ms), t: at(round_ms) - Duration::from_millis(5), what }
}

pub fn node(name: &str, role: NodeRole, position_m: Option<[f64; 3]>, rssi_1m_dbm: Option<f64>) -> NodeStatus {
    NodeStatus {
        node: name.to_owned(),
        site: "hall".to_owned(),
        name: None,
        role,
        position_m,
        rssi_1m_dbm,
        path_loss_exponent: rssi_1m_dbm.map(|_| 2.25),
        last_seen: None,
        health: HealthFigures::default(),
    }
}

on_both! {
    async fn measurements_come_back_as_they_were_written_and_once(place) {
        let store = place.open().await;
        let bare = MeasuredValue::Range(RangeMeasurement::of(0.0));
        let rows = [
            measurement("a", "0x0101", 10, RANGE),
            measurement("a", "0x0102", 10, bare),
            measurement("b", "1-7", 61_000, MeasuredValue::Rssi(-60.5)),
            NodeMeasurement { site: "attic".to_owned(), ..measurement("a", "0x0101", 10, RANGE) },
        ];
        for _ in 0..2 {
            assert_eq!(store.write_measurements(&rows).await.unwrap(), 0);
        }
        assert_eq!(store.measurements("hall", EVER()).await.unwrap(), rows[..3]);
        assert_eq!(store.measurements("attic", EVER()).await.unwrap(), rows[3..]);
        assert_eq!(store.measurements("hall", span(10, 11)).await.unwrap(), rows[..2]);
        assert_eq!(store.measurements("hall", span(11, 61_000)).await.unwrap(), []);
        // The tags are those of positions, and seen from the first to the last round.
        store.write(&[position("a", 10)], &[]).await.unwrap();
        let tags = store.tags().await.unwrap();
        let seen: Vec<_> = tags.iter().map(|tag| (tag.site.as_str(), tag.tag.as_str(), tag.first_seen)).collect();
        assert_eq!(seen, [("attic", "a", at(10)), ("hall", "a", at(10)), ("hall", "b", at(61_000))]);
    }

    async fn a_peer_has_the_place_that_was_written_last(place) {
        let store = place.open().await;
        store.write_measurements(&[measurement("a", "0x0101", 10, RANGE)]).await.unwrap();
        assert_eq!(store.peers("hall").await.unwrap(), [], "no place is known");
        let anchor = |x_m| node("0x0101", NodeRole::Anchor, Some([x_m, -2.5, 2.125]), None);
        let beacon = node("1-7", NodeRole::Beacon, Some([0.0; 3]), Some(-59.5));
        store.write_peers(&[anchor(1.0), beacon, node("1-8", NodeRole::Beacon, None, None)]).await.unwrap();
        store.write_peers(&[anchor(1.5)]).await.unwrap();
        let placed = |node: &str, role, position_m, rssi_1m_dbm: Option<f64>| PlacedNode {
            site: "hall".to_owned(),
            node: node.to_owned(),
            name: None,
            role,
            position_m,
            rssi_1m_dbm,
            path_loss_exponent: rssi_1m_dbm.map(|_| 2.25),
        };
        let expected = [
            placed("0x0101", NodeRole::Anchor, [1.5, -2.5, 2.125], None),
            placed("1-7", NodeRole::Beacon, [0.0; 3], Some(-59.5)),
        ];
        assert_eq!(store.peers("hall").await.unwrap(), expected);
        assert_eq!(store.peers("attic").await.unwrap(), []);
    }

    async fn old_measurements_are_deleted_after_their_time_or_with_the_positions(place) {
        const HOUR: i64 = 3_600_000;
        let store = place.open().await;
        let rows: Vec<_> = (0..25).map(|minute| measurement("a", "0x0101", minute * 60_000, RANGE)).collect();
        store.write_measurements(&rows).await.unwrap();
        store.write(&[position("a", 0), position("a", 24 * 60_000)], &[]).await.unwrap();
        let hour = Some(Duration::from_secs(3600));
        store.retain(Retention { measurements: hour, ..Retention::default() }, at(HOUR + 20 * 60_000)).await.unwrap();
        assert_eq!(store.measurements("hall", EVER()).await.unwrap(), rows[20..]);
        assert_eq!(times(&store.positions("hall", "a", EVER(), 10).await.unwrap()), [24 * 60_000, 0]);
        store.retain(Retention { delete_after: hour, ..Retention::default() }, at(HOUR + 22 * 60_000)).await.unwrap();
        assert_eq!(store.measurements("hall", EVER()).await.unwrap(), rows[22..]);
    }
}
