//! A tag whose frames must be a millisecond apart, on a small simulated air.

use crate::air::{Air, anchors, boxed};
use ranging::native::{Network, PollContent, Rate, Scheme, Tag, TagConfig};
use ranging::{PhyConfig, RadioDuration};

const NETWORK: Network = Network::new(0xBA1A, PhyConfig::FAST);
const SPACING_US: u32 = 1_000;

/// A greedy tag's rounds in three seconds, and the shortest time from the beginning of one of its frames to that of the
/// next, seconds.
fn rounds_and_spacing(anchors: u16, scheme: Scheme, is_spaced: bool) -> (usize, f64) {
    let mut air = Air::new(NETWORK.phy, 1);
    anchors::room(&mut air, NETWORK, anchors, None);
    let config = TagConfig {
        address: 0x100,
        network: NETWORK,
        anchors: 8,
        rate: Rate::Greedy,
        scheme,
        tells: PollContent::Nothing,
        blinks: false,
    };
    let mut tag = Tag::new(config);
    if is_spaced {
        tag.space_frames(RadioDuration::from_micros(SPACING_US));
    }
    let node = air.add([1.0, 2.0, 1.0], -20.0, boxed(tag));
    air.run_until(3.0);
    let begins: Vec<f64> = air.sent.iter().filter(|flight| flight.sender == node).map(|flight| flight.begin).collect();
    let shortest = begins.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    (air.rounds(node, 0.0).len(), shortest)
}

#[test]
fn frames_of_a_tag_are_a_millisecond_apart_where_that_is_asked_for() {
    for (anchors, scheme) in [(1, Scheme::SingleSided), (1, Scheme::DoubleSided), (4, Scheme::DoubleSided)] {
        let (rounds, spacing_s) = rounds_and_spacing(anchors, scheme, false);
        let (spaced_rounds, spaced_s) = rounds_and_spacing(anchors, scheme, true);
        let what = format!("{anchors} anchors, {scheme:?}: {rounds} rounds, {spaced_rounds} spaced");
        assert!(spacing_s < 0.95e-3, "{what}: {spacing_s} s without being asked");
        // The tag's clock is 20 ppm slow.
        assert!(spaced_s > 0.9999e-3, "{what}: {spaced_s} s");
        // Three seconds minus half a second to join, and minus a sixth for sync frames: 2.1 s. A round of one anchor
        // takes a millisecond or a little more, a double-sided one of four anchors three and a half.
        assert!(spaced_rounds > 600 && spaced_rounds <= rounds, "{what}");
    }
}

#[test]
fn rounds_of_several_anchors_are_that_long_anyway() {
    let [(rounds, _), (spaced_rounds, spaced_s)] =
        [false, true].map(|is_spaced| rounds_and_spacing(4, Scheme::SingleSided, is_spaced));
    assert!(spaced_s > 0.9999e-3, "{spaced_s} s");
    assert_eq!(rounds, spaced_rounds);
}
