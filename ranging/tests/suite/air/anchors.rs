//! Anchors of native mode on the air, and their positions in the tests.

use ranging::RadioDuration;
use ranging::native::{Anchor, AnchorConfig, AnchorTables, Network, Rate};

use super::{ANTENNA_DELAY, Air, Boxed, boxed};

/// An anchor with a known position, which ranges to the other anchors as often as `rounds` says.
pub fn anchor(network: Network, address: u16, position: [f64; 3], rounds: Option<Rate>) -> Boxed {
    boxed(Anchor::new(
        AnchorConfig {
            address,
            network,
            antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
            position_m: Some(position.map(|metres| metres as f32)),
            rounds,
        },
        AnchorTables::default(),
    ))
}

/// The position of anchor `i` of `anchors` anchors on a circle of 10 m.
pub fn corner(i: u16, anchors: u16) -> [f64; 3] {
    let angle = f64::from(i) / f64::from(anchors) * std::f64::consts::TAU;
    [10.0 * angle.cos(), 10.0 * angle.sin(), 2.0 + f64::from(i % 2)]
}

/// Its drift, ppm.
pub fn drift(i: u16) -> f64 {
    if i.is_multiple_of(2) { 20.0 } else { -20.0 }
}

/// Anchors 1, 2, … in their corners.
pub fn room(air: &mut Air, network: Network, anchors: u16, rounds: Option<Rate>) -> Vec<usize> {
    let place = |i: u16| corner(i, anchors);
    (0..anchors).map(|i| air.add(place(i), drift(i), anchor(network, i + 1, place(i), rounds))).collect()
}
