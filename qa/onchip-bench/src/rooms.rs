//! The cost of room estimates: a classifier's decision, and the hysteresis of the estimate. The computations are the
//! same on chip and desktop.

use positioning_core::ble::rooms::{
    Classifier, Nearest, Probabilities, RoomHysteresis, Settings, Svm, level_byte, likeliest,
};

use crate::beacons::Measure;

const ROOMS: usize = 5;
const BEACONS: usize = 12;
/// The number of planes: one for each pair of rooms.
const PLANES: usize = ROOMS * (ROOMS - 1) / 2;
/// The bytes of a plane: an offset, and a weight for each beacon.
const PLANE: usize = 4 * (BEACONS + 1);
/// The fingerprints of the nearest-neighbour classifier: eight for each room.
const PRINTS: usize = 8 * ROOMS;
const WEAKEST_DBM: f32 = -95.0;
/// From one room estimate to the next, microseconds.
const WINDOW_US: u64 = 1_000_000;

/// Calls `measure` with a decision of each classifier, and with a step of the hysteresis.
#[inline(never)]
pub fn for_each(measure: &mut impl Measure) {
    // All beacons but one are received, with RSSI values between the fingerprints of the first room and those of the
    // second.
    let scan: [Option<f32>; BEACONS] = core::array::from_fn(|beacon| {
        (beacon != 3).then(|| 0.6 * rssi(0, beacon) + 0.4 * rssi(1, beacon) + (beacon % 3) as f32 - 1.0)
    });

    let fallback = numbers::<{ 4 * BEACONS }>(|_| WEAKEST_DBM);
    // Offsets that keep margins within a few units, and weights of both signs.
    let planes = numbers::<{ PLANES * PLANE }>(|at| match at % (BEACONS + 1) {
        0 => 0.5 - (at % 7) as f32 / 7.0,
        weight => ((at * 31 + weight * 17) % 13) as f32 * 0.005 - 0.03,
    });
    let svm = Svm { rooms: ROOMS as u8, slope: 5.0, fallback_dbm: &fallback, planes: &planes };
    measure.call("rooms-svm", &(), |()| decide(&svm, &scan));

    let weakest = [level_byte(Some(WEAKEST_DBM)); BEACONS];
    let mut prints = [0; PRINTS * (BEACONS + 1)];
    for (at, print) in prints.chunks_exact_mut(BEACONS + 1).enumerate() {
        let room = at % ROOMS;
        if let Some((first, rssis)) = print.split_first_mut() {
            *first = room as u8;
            for (beacon, byte) in rssis.iter_mut().enumerate() {
                *byte = level_byte(Some(rssi(room, beacon) + ((at * 5 + beacon * 3) % 9) as f32 - 4.0));
            }
        }
    }
    let nearest = Nearest { rooms: ROOMS as u8, neighbours: 3, fallback: &weakest, fingerprints: &prints };
    measure.call("rooms-nearest", &(), |()| decide(&nearest, &scan));

    let told: Probabilities = [0.55, 0.3, 0.1, 0.03, 0.02].into_iter().collect();
    let mut presence = RoomHysteresis::new(Settings::default());
    presence.step(WINDOW_US, Some(&told));
    measure.call("rooms-presence", &presence, |presence| answer(presence, &told));
}

/// The RSSI of a beacon in the middle of a room, dBm.
fn rssi(room: usize, beacon: usize) -> f32 {
    -50.0 - ((room * 37 + beacon * 61) % 40) as f32
}

/// Little-endian numbers, as models have them.
fn numbers<const BYTES: usize>(number: impl Fn(usize) -> f32) -> [u8; BYTES] {
    let mut bytes = [0; BYTES];
    for (at, four) in bytes.chunks_exact_mut(4).enumerate() {
        four.copy_from_slice(&number(at).to_le_bytes());
    }
    bytes
}

/// The number of the most probable room and its probability, as one number.
#[inline(never)]
fn decide(classifier: &impl Classifier<Evidence = [Option<f32>]>, scan: &[Option<f32>; BEACONS]) -> f32 {
    let probabilities = classifier.probabilities(scan);
    probabilities.as_ref().and_then(likeliest).map_or(f32::NAN, |(room, p)| room as f32 + p)
}

/// The next room estimate: between the first two rooms.
#[inline(never)]
fn answer(presence: &mut RoomHysteresis, told: &Probabilities) -> f32 {
    use positioning_core::ble::rooms::RoomEstimate::{Between, Room, Unknown};
    match presence.step(2 * WINDOW_US, Some(told)) {
        Unknown => f32::NAN,
        Room(room) => f32::from(room),
        Between(one, other) => 100.0 + 10.0 * f32::from(one) + f32::from(other),
    }
}
