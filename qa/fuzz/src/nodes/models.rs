//! Trained models as nodes read them, with their checksums made right, and then used: probabilities are probabilities,
//! positions are finite.

use positioning_core::ble::fingerprint::{self, Map, Nearest, Receiver, locate};
use positioning_core::ble::rooms::{self, Classifier as _};
use positioning_core::nlos::{self, Classifier as _, Feature, Features};

use crate::{finite, seal};

fn is_probability(p: f32) -> bool {
    (0.0..=1.0001).contains(&p)
}

pub fn nlos(input: &[u8]) {
    let _ = nlos::Model::decode(input);
    let bytes = seal::model(*b"NL", nlos::VERSION, input);
    let mut all = [Features::default(); 3];
    for (number, feature) in Feature::ALL.into_iter().enumerate() {
        all[0].set(feature, 1.0);
        all[1].set(feature, -1.0e30 * number as f32);
        all[2].set(feature, [f32::MAX, -f32::MAX, 0.0][number % 3]);
    }
    let check = |p: Option<f32>| assert!(p.is_none_or(is_probability), "{p:?}");
    if let Ok((model, _)) = nlos::Model::decode(&bytes) {
        all.iter().for_each(|features| check(model.nlos_probability(features)));
        let mut buffer = vec![0; 1 << 17];
        let again = model.encode(&mut buffer).expect("as long as before");
        let (same, rest) = nlos::Model::decode(again).expect("just written");
        assert!(rest.is_empty() && format!("{same:?}") == format!("{model:?}"));
    }
    if let Ok((model, _)) = nlos::NodeModel::decode(&bytes) {
        all.iter().for_each(|features| check(model.nlos_probability(features)));
    }
}

pub fn nlos_seeds() -> Vec<Vec<u8>> {
    (0..8).map(|kind| [&[kind][..], &[0, 0, 128, 63].repeat(20)].concat()).collect()
}

/// Scans that no receiver and some receivers make.
fn scans(beacons: usize) -> [Vec<Option<f32>>; 4] {
    let odd = |beacon: usize| (!beacon.is_multiple_of(2)).then_some(-1.0e30);
    [vec![Some(-60.0); beacons], (0..beacons).map(odd).collect(), vec![Some(f32::NAN); beacons], vec![None; beacons]]
}

pub fn rooms(input: &[u8]) {
    let _ = rooms::Model::decode(input);
    let bytes = seal::model(*b"RM", rooms::MODEL_VERSION, input);
    let check = |p: Option<rooms::Probabilities>| assert!(p.iter().flatten().all(|p| is_probability(*p)), "{p:?}");
    if let Ok((model, _)) = rooms::Model::decode(&bytes) {
        scans(model.beacons()).iter().for_each(|scan| check(model.probabilities(scan)));
        check(model.probabilities(&[]));
    }
    if let Ok((model, _)) = rooms::NodeModel::decode(&bytes) {
        scans(model.beacons()).iter().for_each(|scan| check(model.probabilities(scan)));
    }
}

pub fn room_seeds() -> Vec<Vec<u8>> {
    (0..2).map(|kind| [&[kind, 2][..], &[0, 0, 128, 63].repeat(20)].concat()).collect()
}

/// The first bytes are flags, the number of beacons and the rest of the header; the number of points follows from the
/// length.
pub fn map(input: &[u8]) {
    let _ = Map::decode(input);
    let Some((&[flags, count], rest)) = input.split_first_chunk() else { return };
    let Some((head, body)) = rest.split_first_chunk::<10>() else { return };
    let (flags, beacons) = (flags & 1, usize::from(count % 30));
    let stride = 2 + beacons + if flags == 1 { beacons.div_ceil(2) } else { 0 };
    let Some(points) = body.len().checked_sub(3 * beacons).map(|left| left / stride) else { return };
    let Ok(number) = u16::try_from(points) else { return };
    let mut bytes = vec![b'F', b'M', fingerprint::VERSION, flags];
    bytes.extend(number.to_le_bytes());
    bytes.extend([beacons as u8, 0]);
    bytes.extend(head);
    bytes.extend(&body[..3 * beacons + points * stride]);
    let bytes = seal::with_crc_16(bytes);
    let Ok((map, _)) = Map::decode(&bytes) else { return };
    for scan in scans(map.beacons()) {
        if let Ok(found) = locate(&map, &scan, &Receiver::default()) {
            finite(found.position.iter().chain(&found.covariance).copied().map(f64::from));
        }
        for (weighted, offset) in [(false, 0.0), (true, 0.0), (true, 3.0)] {
            if let Ok(found) = (Nearest { neighbours: 3, weighted, offset }).locate(&map, &scan) {
                finite(found.position.iter().chain(&found.scatter).copied().map(f64::from));
            }
        }
    }
    finite(map.about_its_origin().1.positions::<f32>().flatten().map(f64::from));
}

pub fn map_seeds() -> Vec<Vec<u8>> {
    [0, 1].map(|flags| [&[flags, 3, 0, 0, 0, 0, 0, 0, 0, 0, 100, 0][..], &[100; 90]].concat()).to_vec()
}
