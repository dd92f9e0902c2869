//! A room to test a tag in: six anchors on the walls, a tag that walks round in it, and the tag's config record.

use core::convert::Infallible;

use embassy_futures::join::join_array;
use embedded_hal_async::delay::DelayNs;
use heapless::Vec;
use ranging::RadioInstant;
use ranging::exchange::{Guidance, Report};
use ranging::native::{self, Anchor, AnchorConfig};
use ranging::node::{self, Listener};
use wire::config::{Calibration, Identity, Mode, Network, Phy, Record, Role, Solver, Tag};

use crate::radio::ANTENNA_DELAY;
use crate::{AirDelay, AirRadio, Crystal, Path, World};

/// The number of anchors.
pub const ANCHORS: usize = 6;
/// Receptions lost, per thousand.
pub const LOSS_PER_MILLE: u32 = 20;
/// The duration of a test, microseconds: one second until the tag has joined, then about ninety rounds.
pub const LIFE_US: u64 = 5_500_000;
/// The seed of everything random.
pub const SEED: u64 = 20_260_101;
/// The tag's EUI-64. Its last two bytes are the short address.
pub const TAG_EUI: u64 = 0xDECA_0000_0000_0100;
/// The tag walks round from this corner, millimetres …
const CORNER_MM: [i32; 3] = [1_500, 1_500, 1_200];
/// … along a rectangle with these sides …
const SIDES_MM: [u64; 2] = [5_000, 3_000];
/// … at this speed, millimetres per second.
const PACE_MM_S: u64 = 800;
/// The anchors' positions, alternately low and high, millimetres.
const PLACES_MM: [[i32; 3]; ANCHORS] =
    [[0, 0, 2_600], [4_000, 0, 400], [8_000, 0, 2_500], [8_000, 6_000, 500], [4_000, 6_000, 2_700], [0, 6_000, 600]];
/// How much the anchors' clocks are fast, parts per billion.
const FAST_PPB: [i32; ANCHORS] = [3_000, -17_500, 12_250, -6_125, 19_000, -1_500];
/// The tag's clock, which is fast and about to wrap.
const TAG_CRYSTAL: Crystal = Crystal { start: (1 << 40) - 40_000_000_000, fast_ppb: 8_750 };

/// The position of the tag after a time in microseconds, millimetres.
pub fn walk(t_us: u64) -> [i32; 3] {
    let [width, depth] = SIDES_MM;
    let gone = t_us * PACE_MM_S / 1_000_000 % (2 * (width + depth));
    let (x, y) = if gone < width {
        (gone, 0)
    } else if gone < width + depth {
        (width, gone - width)
    } else if gone < 2 * width + depth {
        (2 * width + depth - gone, depth)
    } else {
        (0, 2 * (width + depth) - gone)
    };
    [CORNER_MM[0] + x as i32, CORNER_MM[1] + y as i32, CORNER_MM[2]]
}

/// The tag's config record, with the solver of its positions.
pub fn record(solver: Solver) -> Record {
    Record {
        identity: Identity::default(),
        role: Role::Tag(Tag {
            height_m: None,
            rate_chz: Some(2_000),
            still_rate_chz: None,
            sleep: false,
            anchors_per_round: ANCHORS as u8,
            tell_distances: false,
            scan: None,
            report_ranges: true,
            solver,
            scheme: None,
        }),
        network: Network {
            pan: 0xBA12,
            mode: Mode::Native,
            phy: Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None },
            turnaround: None,
            region: None,
        },
        calibration: Calibration::default(),
        pins: None,
        anchors: Vec::new(),
        beacons: Vec::new(),
        beacon_key: None,
    }
}

/// The world of the room, without nodes, for nodes of this network.
pub fn world(network: &native::Network) -> World {
    World::new(network.phy, SEED, LOSS_PER_MILLE)
}

/// The radio of the tag that walks; none if the world is full.
pub fn tag(world: &World) -> Option<AirRadio<'_>> {
    world.add(Path::Walk(walk), TAG_CRYSTAL)
}

/// The radio of a tag that lies still for the first ten seconds and then walks.
pub fn lazy_tag(world: &World) -> Option<AirRadio<'_>> {
    world.add(Path::Walk(|t_us| walk(t_us.saturating_sub(10_000_000))), TAG_CRYSTAL)
}

/// Runs the anchors. They report their positions on the air.
pub async fn anchors(world: &World, network: native::Network) -> [Infallible; ANCHORS] {
    let anchors = core::array::from_fn(|i| {
        let position_m = PLACES_MM[i].map(|mm| mm as f32 / 1000.0);
        let config = AnchorConfig {
            address: i as u16 + 1,
            network,
            antenna_delay: ANTENNA_DELAY,
            position_m: Some(position_m),
            rounds: None,
        };
        // The initial counts differ widely.
        let crystal = Crystal { start: (i as u64 + 1) << 37, fast_ppb: FAST_PPB[i] };
        anchor(world, Path::Fixed(PLACES_MM[i]), crystal, config)
    });
    join_array(anchors).await
}

async fn anchor(world: &World, place: Path, crystal: Crystal, config: AnchorConfig) -> Infallible {
    let mut delay: AirDelay<'_> = world.delay();
    let Some(mut radio) = world.add(place, crystal) else {
        // If the world has no room for the radio, there is one anchor less.
        loop {
            delay.delay_ms(1000).await;
        }
    };
    node::run(&mut radio, &mut delay, &mut Anchor::new(config), &mut Silent).await
}

/// Drops all reports.
struct Silent;

impl Listener for Silent {
    async fn report(&mut self, _: Report<'_>, _: RadioInstant) -> Guidance {
        Guidance::NONE
    }

    async fn radio_failed(&mut self, _: &impl core::fmt::Debug, _: u32) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_record_is_one_that_a_node_follows() {
        for solver in Solver::ALL {
            assert_eq!(record(solver).validate(), Ok(()));
        }
    }

    #[test]
    fn the_walk_goes_round_at_its_pace() {
        assert_eq!(walk(0), [1_500, 1_500, 1_200]);
        // The tag walks 0.8 m in a second, 5 m in 6.25 s, and a whole lap of 16 m in 20 s.
        assert_eq!(walk(1_000_000), [2_300, 1_500, 1_200]);
        assert_eq!(walk(6_250_000), [6_500, 1_500, 1_200]);
        assert_eq!(walk(10_000_000), [6_500, 4_500, 1_200]);
        assert_eq!(walk(20_000_000), walk(0));
        for t_us in (0..20_000_000).step_by(10_000) {
            let (a, b) = (walk(t_us), walk(t_us + 10_000));
            let step: u32 = a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).sum();
            assert_eq!(step, 8, "at {t_us}");
        }
    }
}
