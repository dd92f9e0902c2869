//! Pages of flash: a config record, settings of Wi-Fi and the models of a site, with their checksums made right.

use wire::config::{
    Board, Identity, MAX_BYTES, MODELS_BYTES, MODELS_VERSION, Mode, Network, Phy, Record, Role, StoredSiteModels,
    VERSION, WIFI_AT, WIFI_BYTES, WIFI_VERSION, Wifi, WifiKey, decode, decode_models, encode, encode_models,
    encode_wifi, newest, next, wifi_of,
};

use crate::seal;

/// The first five bytes are the version and the sequence number, the rest is the record.
pub fn record(input: &[u8]) {
    let half = input.split_at(input.len() / 2);
    let _ = (decode(input), newest([half.0, half.1]), next([half.0, half.1]));
    let Some((&[version, a, b, c, d], body)) = input.split_first_chunk() else { return };
    let page = seal::page(*b"BLZR", version % (VERSION + 2), [a, b, c, d], body);
    if let Ok((record, sequence)) = decode(&page) {
        assert!(record.validate().is_ok());
        for board in Board::HARDWARE {
            let _ = record.validate_for(board);
        }
        let _ = record.phy();
        let mut buffer = [0; MAX_BYTES];
        let again = decode(encode(&record, sequence, &mut buffer));
        let text = format!("{record:?}");
        assert_eq!(again.map(|(record, sequence)| (format!("{record:?}"), sequence)), Ok((text.clone(), sequence)));
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}

pub fn record_seeds() -> Vec<Vec<u8>> {
    let phy = Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None };
    let record = Record {
        identity: Identity { eui: None, address: Some(0x0101) },
        role: Role::Anchor { position_m: Some([1.0, 2.0, 3.0]) },
        network: Network { pan: 0xBA11, mode: Mode::Native, phy, turnaround: None, region: None, key: None },
        calibration: Default::default(),
        pins: None,
        anchors: Default::default(),
        beacons: Default::default(),
        beacon_key: None,
    };
    let mut buffer = [0; MAX_BYTES];
    let page = encode(&record, 1, &mut buffer);
    vec![[&page[4..5], &page[8..12], &page[wire::config::HEADER_BYTES..]].concat()]
}

pub fn site_models(input: &[u8]) {
    wifi_settings(input);
    let _ = decode_models(input);
    if input.len() > MODELS_BYTES - wire::config::HEADER_BYTES {
        return;
    }
    let page = seal::page(*b"BLZB", MODELS_VERSION, [0; 4], input);
    if let Ok(models) = decode_models(&page) {
        let mut region = [0; MODELS_BYTES];
        let again = encode_models(&models, &mut region).expect("as long as before");
        assert_eq!(decode_models(again), Ok(models));
        for of in [models.map, models.rooms].into_iter().flatten() {
            let _ = of.numbers().count();
        }
    }
}

/// What is beside a record and neither a model.
fn wifi_settings(input: &[u8]) {
    let beside = |settings: &[u8]| [&vec![0xFF; WIFI_AT][..], settings].concat();
    let _ = wifi_of(&beside(input));
    if input.len() > WIFI_BYTES - wire::config::HEADER_BYTES {
        return;
    }
    if let Ok(wifi) = wifi_of(&beside(&seal::page(*b"BLZW", WIFI_VERSION, [0; 4], input))) {
        assert!(wifi.validate().is_ok());
        assert_eq!(wifi_of(&beside(encode_wifi(&wifi, &mut [0; WIFI_BYTES]))), Ok(wifi));
    }
}

pub fn site_model_seeds() -> Vec<Vec<u8>> {
    let mut region = [0; MODELS_BYTES];
    let models = StoredSiteModels { map: None, rooms: None, room_names: "hall\nattic" };
    let page = encode_models(&models, &mut region).expect("it fits");
    let wifi = Wifi {
        ssid: "hall".parse().expect("short"),
        password: "correct horse".parse().expect("short"),
        host: "nas".parse().expect("short"),
        port: 7000,
        key: Some(WifiKey { gateway: 1, secret: [2; 32] }),
    };
    let mut bytes = [0; WIFI_BYTES];
    let pages = [page, encode_wifi(&wifi, &mut bytes)];
    pages.map(|page| page[wire::config::HEADER_BYTES..].to_vec()).to_vec()
}
