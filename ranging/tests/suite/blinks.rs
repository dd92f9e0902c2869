//! Tags that blink, on a small simulated air: anchors with a host report all their blinks, and their leases last.

use crate::air::anchors::{corner, drift};
use crate::air::{ANTENNA_DELAY, Air, Boxed, What, boxed, boxed_sleeper};
use ranging::exchange::{Arrival, ArrivedFrame, Protocol};
use ranging::native::{
    Anchor, AnchorConfig, AnchorTables, Network, NetworkKey, PollContent, Rate, Scheme, Tag, TagConfig,
};
use ranging::{PhyConfig, RadioDuration};
use wire::uwb::native::software_code;

fn network(key: Option<u8>, seed: u64) -> Network {
    let key = key.map(|key| NetworkKey::new([key; 16], seed, software_code));
    Network { key, ..Network::new(0xBA1A, PhyConfig::FAST) }
}

fn room(air: &mut Air, key: Option<u8>, anchors: u16) -> Vec<usize> {
    (0..anchors)
        .map(|i| {
            let position = corner(i, anchors);
            let mut anchor = Anchor::new(
                AnchorConfig {
                    address: i + 1,
                    network: network(key, i.into()),
                    antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
                    position_m: Some(position.map(|metres| metres as f32)),
                    rounds: None,
                },
                AnchorTables::default(),
            );
            anchor.set_host(true);
            air.add(position, drift(i), boxed(anchor))
        })
        .collect()
}

fn blinking(address: u16, key: Option<u8>, period_ms: u32) -> Tag {
    Tag::new(TagConfig {
        address,
        network: network(key, address.into()),
        anchors: 8,
        rate: Rate::Every(RadioDuration::from_micros(1_000 * period_ms)),
        scheme: Scheme::SingleSided,
        tells: PollContent::Nothing,
        blinks: true,
    })
}

fn sleeping(mut tag: Tag) -> Boxed {
    tag.doze();
    boxed_sleeper(tag)
}

/// What an anchor reported from `from` on.
fn arrivals(air: &Air, anchor: usize, from: f64) -> Vec<Arrival> {
    let of_anchor = air.reports.iter().filter(|report| report.node == anchor && report.time >= from);
    of_anchor.filter_map(|report| if let What::Arrival(arrival) = report.what { Some(arrival) } else { None }).collect()
}

/// The share of a tag's blinks that an anchor reported, between the first and the last of them, and how many there were.
fn share(arrivals: &[Arrival], tag: u16) -> (f64, usize) {
    let numbers: Vec<u16> = arrivals
        .iter()
        .filter(|arrival| arrival.frame == ArrivedFrame::Blink && arrival.source == tag)
        .map(|arrival| arrival.number)
        .collect();
    let (Some(first), Some(last)) = (numbers.first(), numbers.last()) else { return (0.0, 0) };
    let sent = usize::from(last.wrapping_sub(*first)) + 1;
    (numbers.len() as f64 / sent as f64, sent)
}

#[test]
fn anchors_report_all_blinks_of_tags_that_share_a_slot_and_their_leases_last() {
    for (key, loss) in [(None, 0.0), (Some(7), 0.02)] {
        let mut air = Air::new(PhyConfig::FAST, 11);
        air.loss = loss;
        let anchors = room(&mut air, key, 4);
        for i in 0..9 {
            air.add([f64::from(i) - 4.0, 2.0, 1.0], drift(i), boxed(blinking(0x100 + i, key, 200)));
        }
        // A term of blinks twice in a second is 11.2 s: each lease is confirmed several times.
        air.run_until(60.0);
        for &anchor in &anchors {
            let arrivals = arrivals(&air, anchor, 10.0);
            for tag in 0x100..0x109 {
                let (share, sent) = share(&arrivals, tag);
                assert!(sent > 240 && share > 0.99 - 3.0 * loss, "{key:?}: {tag:#x}: {share} of {sent}");
            }
            // Its own sync frames, and those of three others, in 500 superframes; one in 128 is left out.
            let of_superframes = |frame| arrivals.iter().filter(|arrival| arrival.frame == frame).count();
            let [own, others] = [ArrivedFrame::OwnSyncFrame, ArrivedFrame::SyncFrame].map(of_superframes);
            assert!((490..=510).contains(&own), "{own}");
            assert!((0.98 - loss..=1.01).contains(&(others as f64 / 1500.0)), "{others}");
        }
        // Nobody ranges.
        assert!(air.reports.iter().all(|report| !matches!(report.what, What::Round { .. })));
    }
}

#[test]
fn a_sleeping_tag_that_blinks_hardly_listens() {
    let mut air = Air::new(PhyConfig::FAST, 12);
    let anchors = room(&mut air, None, 4);
    let tags: Vec<usize> = (0..3)
        .map(|i| air.add([f64::from(i), 2.0, 1.0], drift(i), sleeping(blinking(0x100 + i, None, 1_000))))
        .collect();
    air.run_until(60.0);
    let before: Vec<f64> = tags.iter().map(|tag| air.received(*tag)).collect();
    air.run_until(360.0);
    for (tag, before) in tags.into_iter().zip(before) {
        let received = (air.received(tag) - before) / 300.0;
        // Timers that are up to 30 µs late: a sync frame of 0.5 ms and more for each two blinks at most. A round takes 1.2.
        assert!(received < 0.45e-3, "{received}");
    }
    for tag in 0x100..0x103 {
        let (share, sent) = share(&arrivals(&air, anchors[0], 60.0), tag);
        assert!(sent > 290 && share > 0.98, "{tag:#x}: {share} of {sent}");
    }
}

#[test]
fn anchors_without_a_host_report_nothing() {
    let mut air = Air::new(PhyConfig::FAST, 13);
    let anchors = crate::air::anchors::room(&mut air, network(None, 0), 3, None);
    air.add([1.0, 2.0, 1.0], 5.0, boxed(blinking(0x100, None, 100)));
    air.run_until(10.0);
    assert!(anchors.into_iter().all(|anchor| arrivals(&air, anchor, 0.0).is_empty()));
    assert!(air.sent.len() > 150);
}
