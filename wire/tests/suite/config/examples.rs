//! Config records for tests.

use baliza_wire::config::{
    Advertiser, Anchor, Beacon, Calibration, Identity, MAX_ANCHORS, MAX_BEACONS, Mode, Network, Phy, Pins, PollContent,
    Record, Region, ReplyDelay, Role, Scan, Scheme, Solver, Tag, TagArea,
};

pub const NETWORK: Network = Network {
    pan: 0xDECA,
    mode: Mode::Native,
    phy: Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None },
    turnaround: Some(ReplyDelay { answer_us: 250, listen_again_us: 40, transmit_us: 150 }),
    region: None,
    key: None,
};

/// An anchor at (1, 2.5, −0.5) m.
pub fn anchor() -> Record {
    Record {
        identity: Identity { eui: Some(0x0123_4567_89AB_CDEF), address: Some(0x0101) },
        role: Role::Anchor { position_m: Some([1.0, 2.5, -0.5]) },
        network: NETWORK,
        calibration: Calibration { antenna_delay: Some(16_436), crystal_trim: None, tx_power: None },
        pins: None,
        anchors: heapless::Vec::new(),
        beacons: heapless::Vec::new(),
        beacon_key: None,
    }
}

/// A tag without configured positions, with all fields that version 2 added.
pub fn tag() -> Record {
    let tag = Tag {
        height_m: Some(1.2),
        rate_chz: Some(1000),
        still_rate_chz: Some(100),
        sleep: true,
        anchors_per_round: 4,
        tells: PollContent::Nothing,
        scan: Some(Scan { interval_ms: 100, window_ms: 50 }),
        report_ranges: true,
        solver: Solver::BWls,
        scheme: Some(Scheme::DoubleSided),
        height_sigma_m: 0.0,
        area: None,
    };
    Record {
        identity: Identity { eui: None, address: Some(0x0201) },
        role: Role::Tag(tag),
        network: Network { turnaround: None, region: Some(Region::Eu), ..NETWORK },
        calibration: Calibration::default(),
        ..anchor()
    }
}

/// The same tag, with all fields that version 3 added.
pub fn tag_within() -> Record {
    let mut record = tag();
    if let Role::Tag(tag) = &mut record.role {
        tag.height_sigma_m = 0.3;
        tag.area = Some(TagArea { least_m: [0.0, -0.5, f32::NEG_INFINITY], greatest_m: [6.0, 4.0, 2.6] });
    }
    record
}

/// A beacon with all optional fields.
pub fn beacon() -> Record {
    let advertiser = Advertiser {
        uuid: core::array::from_fn(|index| index as u8),
        major: 1,
        minor: 300,
        measured_power_dbm: -59,
        interval_ms: 100,
        tx_power_dbm: -4,
        channels: 7,
        rotate_s: 900,
    };
    let known =
        Beacon { major: 1, minor: 2, position_m: [1.0, 1.0, 2.0], rssi_1m_dbm: Some(-60.5), path_loss_exponent: None };
    Record {
        identity: Identity::default(),
        role: Role::Advertiser(advertiser),
        network: Network {
            mode: Mode::DecaRanging { fast: false },
            phy: Phy { channel: 2, prf_mhz: 16, rate_kbps: 110, preamble: 1024, code: Some(4) },
            ..NETWORK
        },
        calibration: Calibration { antenna_delay: None, crystal_trim: Some(15), tx_power: Some(0x0E08_2848) },
        pins: Some(Pins { sck: 6, mosi: 7, miso: 2, cs: 10, irq: 3, reset: 4 }),
        anchors: heapless::Vec::from_slice(&[Anchor { address: 0x0102, position_m: [0.0, 0.0, 3.0] }]).unwrap(),
        beacons: heapless::Vec::from_slice(&[known]).unwrap(),
        beacon_key: Some([0xAB; 16]),
    }
}

/// Every number at its longest, every list full.
pub fn longest() -> Record {
    let far_m = [99_999.0, -99_999.0, 0.1];
    let mut record = beacon();
    record.identity = Identity { eui: Some(0xFEDC_BA98_7654_3210), address: Some(0xFFFD) };
    let Role::Advertiser(advertiser) = &mut record.role else { unreachable!("it is a beacon") };
    *advertiser = Advertiser {
        uuid: [0xFF; 16],
        major: 0xFFFF,
        minor: 0xFFFF,
        measured_power_dbm: -1,
        interval_ms: 10_240,
        rotate_s: 0xFFFF,
        ..*advertiser
    };
    record.network.pan = 0xFFFE;
    record.network.mode = Mode::Listening { rounds_chz: 100_000 };
    record.network.phy = Phy { rate_kbps: 6810, preamble: 4096, code: Some(4), ..record.network.phy };
    record.network.turnaround = Some(ReplyDelay { answer_us: 20_000, listen_again_us: 20_000, transmit_us: 20_000 });
    record.network.region = Some(Region::Unchecked);
    record.calibration =
        Calibration { antenna_delay: Some(0xFFFF), crystal_trim: Some(31), tx_power: Some(0xFFFF_FFFF) };
    record.anchors.clear();
    for index in 0..MAX_ANCHORS as u16 {
        record.anchors.push(Anchor { address: 0xFFFD - index, position_m: far_m }).unwrap();
    }
    record.beacons.clear();
    for index in 0..MAX_BEACONS as u16 {
        let known = Beacon {
            major: 0xFFFF,
            minor: 0xFFFF - index,
            position_m: far_m,
            rssi_1m_dbm: Some(-60.5),
            path_loss_exponent: Some(2.1),
        };
        record.beacons.push(known).unwrap();
    }
    record
}
