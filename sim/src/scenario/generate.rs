//! Scenarios without a file: as many furnished rooms as the tags need.

use std::f64::consts::TAU;

use ranging::phy::{Channel, Prf};
use wire::config::{Network, Phy};

use super::{AirModel, Anchor, Fidelity, LISTENING, Motion, NETWORK, Scenario, Tag, TagSettings, Walk};
use crate::air::{Material, Wall};
use crate::bluetooth::BluetoothConfig;
use crate::board::BoardProfile;

/// A room, metres.
const ROOM: [f64; 2] = [12.0, 8.0];
/// From a room's corner to the corner of the next room, metres.
const PITCH_M: f64 = 40.0;
/// The most tags in a room that range more than once a superframe: a network lists 16.
const TAGS_A_ROOM: usize = 16;
/// The most rounds a second of all tags in a room that range less often: 25 leased slots in a superframe.
const LEASED_HZ: f64 = 25.0 * SUPERFRAMES_HZ;
const SUPERFRAMES_HZ: f64 = 10.0;
/// Tags on ellipses of their own; further ones share them.
const ELLIPSES: usize = 20;
/// The minimum number of anchors in a room, if there are several rooms.
const ANCHORS_A_ROOM: usize = 4;
/// Anchors hang at this distance from the walls, alternately high and low, metres.
const FROM_WALL_M: f64 = 0.2;
const HEIGHTS_M: [f64; 2] = [2.6, 1.8];
/// The height at which tags are carried, metres. It is configured in the tags.
const TAG_HEIGHT_M: f32 = 1.2;
/// The walking speed of the tags, metres per second.
const WALKING_M_S: f64 = 1.0;

impl Scenario {
    /// `tags` tags that walk in a furnished room of 12 m × 8 m, with `anchors` anchors on its walls; at least one of
    /// each. More than sixteen tags fill further rooms, if there are four anchors for each. Each room has its own
    /// network and channel.
    pub fn rooms(anchors: usize, tags: usize) -> Self {
        Self::rooms_at(anchors, tags, f64::INFINITY)
    }

    /// The same for tags that range this often a second. Of those that range once a superframe (10 Hz) or less, more are
    /// in a room: 25 at 10 Hz, 250 at 1 Hz.
    pub fn rooms_at(anchors: usize, tags: usize, rate_hz: f64) -> Self {
        let tags_a_room = if rate_hz > SUPERFRAMES_HZ { TAGS_A_ROOM } else { (LEASED_HZ / rate_hz) as usize };
        let rooms = tags.max(1).div_ceil(tags_a_room).min(anchors / ANCHORS_A_ROOM).max(1);
        Self::in_rooms(rooms, anchors, tags)
    }

    /// All nodes in one room, and tags that only listen.
    pub fn listening(anchors: usize, tags: usize) -> Self {
        let mut scenario = Self::in_rooms(1, anchors, tags);
        for network in &mut scenario.networks {
            network.mode = LISTENING;
        }
        scenario
    }

    fn in_rooms(rooms: usize, anchors: usize, tags: usize) -> Self {
        let (anchors, tags) = (anchors.max(1), tags.max(1));
        let columns = (rooms as f64).sqrt().ceil() as usize;
        let mut scenario = Self {
            seconds: 10.0,
            seed: 1,
            loss: 0.0,
            fidelity: Fidelity::Spi,
            air: AirModel::default(),
            clock_ppm: 20.0,
            board: BoardProfile::DWM1001,
            method: None,
            weigh_nlos: true,
            networks: Vec::new(),
            beacon_key: None,
            walls: Vec::new(),
            bluetooth: BluetoothConfig::default(),
            beacons: Vec::new(),
            scanners: Vec::new(),
            anchors: Vec::new(),
            listed_anchors: Vec::new(),
            tags: Vec::new(),
            faults: Vec::new(),
            attackers: Vec::new(),
        };
        let mut settings = TagSettings::default();
        settings.record.height_m = Some(TAG_HEIGHT_M);
        for room in 0..rooms {
            let (column, row) = (room % columns, room / columns);
            let corner = [column as f64 * PITCH_M, row as f64 * PITCH_M];
            scenario.networks.push(network(room, column, row));
            scenario.walls.extend(walls(corner));
            let share = |all: usize| all * (room + 1) / rooms - all * room / rooms;
            for place in perimeter(corner, share(anchors)) {
                let address = scenario.anchors.len() as u16 + 1;
                scenario.anchors.push(Anchor {
                    address,
                    network: room,
                    at: place,
                    gateway: false,
                    wifi: false,
                    board: None,
                    antenna_delay_ticks: None,
                });
            }
            for number in 0..share(tags) {
                let address = scenario.tags.len() as u16 + 0x1001;
                scenario.tags.push(Tag {
                    address,
                    network: room,
                    settings: settings.clone(),
                    blinks: false,
                    wifi: false,
                    walk: walk(corner, number),
                    board: None,
                    antenna_delay_ticks: None,
                    motion: Motion::default(),
                    data_every_s: None,
                    messages_every_s: None,
                });
            }
        }
        scenario
    }
}

/// Rooms side by side have different channels; the rooms after those have different preamble codes.
fn network(room: usize, column: usize, row: usize) -> Network {
    let channel = [Channel::Ch5, Channel::Ch2, Channel::Ch1, Channel::Ch3][column % 2 + 2 * (row % 2)];
    let codes = channel.preamble_codes(Prf::Mhz64);
    let code = codes[(column / 2 + 2 * (row / 2)) % codes.len()];
    let phy = Phy { channel: channel.number(), code: Some(code), ..NETWORK.phy };
    Network { pan: NETWORK.pan.wrapping_add(room as u16), phy, ..NETWORK }
}

/// Concrete walls around, a partition, a cabinet of sheet metal, shelves, and a person who stands in the middle.
fn walls([x, y]: [f64; 2]) -> [Wall; 8] {
    let wall = |from: [f64; 2], to: [f64; 2], material| Wall {
        from: [x + from[0], y + from[1]],
        to: [x + to[0], y + to[1]],
        material,
    };
    let [w, h] = ROOM;
    [
        wall([0.0, 0.0], [w, 0.0], Material::CONCRETE),
        wall([w, 0.0], [w, h], Material::CONCRETE),
        wall([w, h], [0.0, h], Material::CONCRETE),
        wall([0.0, h], [0.0, 0.0], Material::CONCRETE),
        wall([8.5, 0.0], [8.5, 1.4], Material::DRYWALL),
        wall([3.0, 0.5], [4.0, 0.5], Material::METAL),
        wall([1.0, 7.0], [2.5, 7.0], Material::WOOD),
        wall([5.8, 4.0], [6.2, 4.0], Material::BODY),
    ]
}

/// Positions along the walls at equal distances, beginning in a corner.
fn perimeter([x, y]: [f64; 2], count: usize) -> impl Iterator<Item = [f64; 3]> {
    let [w, h] = ROOM.map(|side| side - 2.0 * FROM_WALL_M);
    (0..count).map(move |i| {
        let along = 2.0 * (w + h) * i as f64 / count as f64;
        let [dx, dy] = match along {
            a if a < w => [a, 0.0],
            a if a < w + h => [w, a - w],
            a if a < 2.0 * w + h => [2.0 * w + h - a, h],
            a => [0.0, 2.0 * (w + h) - a],
        };
        [x + FROM_WALL_M + dx, y + FROM_WALL_M + dy, HEIGHTS_M[i % 2]]
    })
}

/// An ellipse around the room's middle as twelve straight segments. The ellipse of each tag is a little narrower than
/// the one before; every second tag walks in the opposite direction.
fn walk([x, y]: [f64; 2], number: usize) -> Walk {
    let narrow = 1.0 - 0.04 * (number % ELLIPSES) as f64;
    let direction = if number.is_multiple_of(2) { 1.0 } else { -1.0 };
    let points = (0..12).map(|step| {
        let angle = direction * TAU * step as f64 / 12.0 + number as f64;
        let [a, b] = [4.4 * narrow, 2.4 * narrow];
        [x + 0.5 * ROOM[0] + a * angle.cos(), y + 0.5 * ROOM[1] + b * angle.sin(), f64::from(TAG_HEIGHT_M)]
    });
    let points: Vec<_> = points.collect();
    let standing = Walk::standing(points[0]);
    Walk::new(points, WALKING_M_S, true).unwrap_or(standing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_hundred_tags_share_fifty_rooms_with_networks_of_their_own() {
        let campus = Scenario::rooms(200, 800);
        assert_eq!((campus.networks.len(), campus.anchors.len(), campus.tags.len()), (50, 200, 800));
        for room in 0..50 {
            let anchors = campus.anchors.iter().filter(|a| a.network == room).count();
            let tags = campus.tags.iter().filter(|t| t.network == room).count();
            assert_eq!((anchors, tags), (4, 16), "room {room}");
        }
        let rooms = |tags, rate_hz| Scenario::rooms_at(16, tags, rate_hz).networks.len();
        assert_eq!(
            [rooms(250, 1.0), rooms(251, 1.0), rooms(25, 10.0), rooms(17, 11.0), rooms(16, 400.0)],
            [1, 2, 1, 2, 1]
        );
        for (i, a) in campus.networks.iter().enumerate() {
            for b in &campus.networks[..i] {
                assert_ne!(a.pan, b.pan);
            }
        }
        // Rooms 0 and 1 are side by side; rooms 0 and 8 are one above the other (the grid has 8 columns).
        let channel = |room: usize| campus.networks[room].phy.channel;
        assert_ne!(channel(0), channel(1));
        assert_ne!(channel(0), channel(8));
    }

    #[test]
    fn everybody_is_in_the_room() {
        let room = Scenario::rooms_at(7, 20, 1.0);
        let inside = |p: [f64; 3]| p[0] > 0.0 && p[0] < ROOM[0] && p[1] > 0.0 && p[1] < ROOM[1];
        assert!(room.anchors.iter().all(|anchor| inside(anchor.at)));
        assert!(room.tags.iter().all(|tag| (0..600).all(|t| inside(tag.walk.at(f64::from(t) * 0.1)))));
        // Four anchors are a quarter of the perimeter from each other: 2·(11.6 + 7.6)/4 = 9.6 m along the first wall.
        let four: Vec<_> = perimeter([0.0; 2], 4).collect();
        assert!((four[1][0] - four[0][0] - 9.6).abs() < 1e-9 && four[1][1] == four[0][1], "{four:?}");
    }
}
