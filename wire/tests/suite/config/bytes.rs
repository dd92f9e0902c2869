//! The page's bytes.

use baliza_wire::config::{
    Advertiser, Anchor, Beacon, Calibration, HEADER_BYTES, Identity, LoadError, MAX_BYTES, Mode, Network, Phy, Pins,
    PollContent, Record, Region, ReplyDelay, Role, Scan, Scheme, Solver, Tag, TagArea, VERSION, decode, encode,
    version,
};
use proptest::collection::vec;
use proptest::option::of;
use proptest::prelude::*;

use super::examples::{anchor, beacon, longest, tag, tag_within};

fn page(record: &Record, sequence: u32) -> Vec<u8> {
    encode(record, sequence, &mut [0; MAX_BYTES]).to_vec()
}

fn from_hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

// The pages below were written by a separate Python program. It implements postcard from its specification only
// (varints, options as 00 or 01, variants by number, floats little-endian) and takes the CRC-32 from zlib.

#[test]
fn an_anchor_s_page_has_these_bytes() {
    let header = "42 4c 5a 52 02 00 38 00 07 00 00 00 58 fb a2 94";
    let body = "01 ef 9b af cd f8 ac d1 91 01  01 81 02   \
                01 01 00 00 80 3f 00 00 20 40 00 00 00 bf \
                ca bd 03 00 05 40 9a 35 80 01 00  fa 01 28 96 01 \
                01 b4 80 01 00 00  00 00 00 00  00 00 00";
    assert_eq!(page(&anchor(), 7), from_hex(&format!("{header} {body}")));
}

#[test]
fn a_tag_s_page_has_these_bytes() {
    let bytes = "42 4c 5a 52 02 00 30 00 01 00 00 00 12 64 46 e3 \
                 00 01 81 04  00 01 9a 99 99 3f 01 e8 07 01 64 01 04 00 01 64 32 01 \
                 ca bd 03 00 05 40 9a 35 80 01 00 00 00 00  00 00 00 00 00 00 00  01 00 02 01 01";
    assert_eq!(page(&tag(), 1), from_hex(bytes));
}

#[test]
fn a_tag_s_page_with_what_is_known_of_its_place_has_these_bytes() {
    // The same Python program. Version 3 is version 2 and: ± 0.3 m; x from 0 to 6, y from −0.5 to 4, z to 2.6 m.
    let bytes = "42 4c 5a 52 03 00 4c 00 01 00 00 00 eb 80 31 e1 \
                 00 01 81 04  00 01 9a 99 99 3f 01 e8 07 01 64 01 04 00 01 64 32 01 \
                 ca bd 03 00 05 40 9a 35 80 01 00 00 00 00  00 00 00 00 00 00 00  01 00 02 01 01 \
                 9a 99 99 3e  00 00 00 00 00 00 00 bf 00 00 80 ff  00 00 c0 40 00 00 80 40 66 66 26 40";
    let record = tag_within();
    assert_eq!(page(&record, 1), from_hex(bytes));
    assert_eq!(decode(&page(&record, 1)), Ok((record, 1)));
    // Images that read no version 3 read a record without limits.
    assert_eq!(version(&page(&tag(), 1)), Ok(2));
}

/// A tag's page of version 1, with these bytes for the reply delay.
fn tag_of_version_1(checksum: &str, turnaround: &str) -> Vec<u8> {
    from_hex(&format!(
        "42 4c 5a 52 01 00 2d 00 01 00 00 00 {checksum} \
         00 01 81 04  00 01 9a 99 99 3f 01 e8 07 01 64 01 04 00 01 64 32 01 \
         ca bd 03 00 05 40 9a 35 80 01 00 {turnaround}  00 00 00 00 00 00 00"
    ))
}

/// The part of `tag` that version 1 can express.
fn tag_without_what_version_2_added(turnaround: Option<ReplyDelay>) -> Record {
    let mut record = tag();
    record.network = Network { turnaround, region: None, ..record.network };
    if let Role::Tag(tag) = &mut record.role {
        (tag.solver, tag.scheme) = (Solver::Track, None);
    }
    record
}

#[test]
fn a_page_of_version_1_is_read() {
    let slow = tag_of_version_1("fc bb 59 fd", "d8 04 78 ac 02");
    let pinned = ReplyDelay { answer_us: 600, listen_again_us: 120, transmit_us: 300 };
    assert_eq!(decode(&slow), Ok((tag_without_what_version_2_added(Some(pinned)), 1)));
}

#[test]
fn the_default_turnaround_of_version_1_pins_nothing() {
    let plain = tag_of_version_1("3e 99 80 f4", "fa 01 28 96 01");
    assert_eq!(decode(&plain), Ok((tag_without_what_version_2_added(None), 1)));
    assert_eq!((version(&plain), version(&page(&tag(), 1))), (Ok(1), Ok(2)));
}

#[test]
fn version_2_keeps_a_pinned_turnaround_that_is_the_default_of_version_1() {
    let record = tag_without_what_version_2_added(Some(ReplyDelay::DWM1001));
    assert_eq!(decode(&page(&record, 1)), Ok((record, 1)));
}

#[test]
fn a_network_to_listen_to_has_these_bytes() {
    let mut listening = tag();
    listening.network.mode = Mode::Listening { rounds_chz: 1000 };
    // 1000 is E8 07.
    let body = "00 01 81 04  00 01 9a 99 99 3f 01 e8 07 01 64 01 04 00 01 64 32 01 \
                ca bd 03 02 e8 07 05 40 9a 35 80 01 00 00 00 00  00 00 00 00 00 00 00  01 00 02 01 01";
    assert_eq!(page(&listening, 1)[HEADER_BYTES..], from_hex(body));
}

#[test]
fn a_beacon_s_page_has_these_bytes() {
    let bytes = "42 4c 5a 52 02 00 74 00 ff ff ff ff c1 bd 80 47 \
                 00 00  02 00 01 02 03 04 05 06 07 08 09 0a 0b 0c 0d 0e 0f 01 ac 02 c5 64 fc 07 84 07 \
                 ca bd 03 01 00 02 10 6e 80 08 01 04 fa 01 28 96 01  00 01 0f 01 c8 d0 a0 70  01 06 07 02 0a 03 04 \
                 01 82 02 00 00 00 00 00 00 00 00 00 00 40 40 \
                 01 01 02 00 00 80 3f 00 00 80 3f 00 00 00 40 01 00 00 72 c2 00 \
                 01 ab ab ab ab ab ab ab ab ab ab ab ab ab ab ab ab  00 00 00";
    assert_eq!(page(&beacon(), u32::MAX), from_hex(bytes));
}

#[test]
fn the_bytes_are_those_of_the_documentation() {
    let documentation = include_str!("../../../../docs/reference/wire-format.md");
    // The page has the bytes in groups of four.
    let digits = documentation.replace(' ', "");
    for page in [page(&anchor(), 7), page(&tag(), 1), page(&tag_within(), 1)] {
        let bytes: String = page.iter().map(|byte| format!("{byte:02X}")).collect();
        assert!(digits.contains(&format!("`{bytes}`")), "{bytes}");
    }
    assert!(documentation.contains(&format!("{} bytes at most", MAX_BYTES - HEADER_BYTES)));
}

#[test]
fn the_longest_record_fits() {
    let record = longest();
    assert_eq!(record.validate(), Ok(()));
    // Identity 11 + 4; role 1 + 16 + 3 + 3 + 1 + 2 + 1 + 1 + 3; network 3 + 4 + 1 + 1 + 2 + 2 + 2 + 9; calibration 4 +
    // 2 + 6; pins 7; 24 anchors of 3 + 12, 24 beacons of 3 + 3 + 12 + 5 + 5, a byte for each list's length; the key 17;
    // a region 2; solver and scheme 1 each.
    let longest = 15 + 31 + 24 + 12 + 7 + (1 + 24 * 15) + (1 + 24 * 28) + 17 + 4;
    assert_eq!(page(&record, 1).len(), HEADER_BYTES + longest);
    assert_eq!(decode(&page(&record, 1)), Ok((record, 1)));
    // A tag's role and limits are longer than a beacon's role.
    let mut tag = super::examples::longest();
    tag.role = tag_within().role;
    tag.network.mode = Mode::Native;
    assert_eq!(decode(&page(&tag, 1)), Ok((tag, 1)));
}

#[test]
fn the_page_s_rest_does_not_matter() {
    let mut bytes = page(&anchor(), 3);
    bytes.extend([0xFF; 4000]);
    assert_eq!(decode(&bytes), Ok((anchor(), 3)));
    bytes[2000] = 0;
    assert_eq!(decode(&bytes), Ok((anchor(), 3)));
}

#[test]
fn a_key_is_the_end_of_version_4() {
    let mut keyed = anchor();
    keyed.network.key = Some(core::array::from_fn(|i| i as u8));
    let bytes = page(&keyed, 3);
    assert_eq!((bytes[4], &bytes[bytes.len() - 16..]), (4, &keyed.network.key.unwrap()[..]));
    // Before it come the limits of version 3, which an anchor has not.
    assert_eq!(bytes[bytes.len() - 44..bytes.len() - 16], [0; 28]);
    assert_eq!(decode(&bytes), Ok((keyed.clone(), 3)));
    // Without a key older images read it.
    assert_eq!(page(&anchor(), 3)[4], 2);
    keyed.network.mode = Mode::DecaRanging { fast: true };
    assert!(matches!(decode(&page(&keyed, 3)), Err(LoadError::Invalid(invalid)) if invalid.field == "network.key"));
}

#[test]
fn an_erased_page_has_no_record() {
    assert_eq!(decode(&[0xFF; 4096]), Err(LoadError::Missing));
    assert_eq!(decode(&[]), Err(LoadError::Missing));
    assert_eq!(decode(&[0; 4096]), Err(LoadError::Corrupt));
}

#[test]
fn a_page_cut_short_is_corrupt() {
    let bytes = page(&beacon(), 1);
    for length in 1..bytes.len() {
        assert_eq!(decode(&bytes[..length]), Err(LoadError::Corrupt), "{length} bytes");
    }
}

#[test]
fn any_flipped_bit_is_noticed() {
    let bytes = page(&beacon(), 1);
    for bit in 0..bytes.len() * 8 {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        assert_eq!(decode(&flipped), Err(LoadError::Corrupt), "bit {bit}");
    }
}

/// Rewrites a page's checksum. It is computed from the definition: bit by bit, from the lowest, with the polynomial
/// mirrored.
fn seal(bytes: &mut [u8]) {
    let mut crc = u32::MAX;
    for byte in bytes[..12].iter().chain(&bytes[16..]) {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 };
        }
    }
    bytes[12..16].copy_from_slice(&(!crc).to_le_bytes());
}

#[test]
fn another_version_is_told_by_its_number() {
    for version in [0, VERSION + 1, 255] {
        let mut bytes = page(&anchor(), 1);
        bytes[4] = version;
        assert_eq!(decode(&bytes), Err(LoadError::Corrupt), "its checksum is wrong");
        seal(&mut bytes);
        assert_eq!(decode(&bytes), Err(LoadError::Version(version)));
    }
}

#[test]
fn a_whole_page_that_is_no_record_is_corrupt() {
    // One byte too many within the length, and an unknown role (its byte is the fourteenth of the body).
    let mut longer = page(&anchor(), 1);
    longer.push(0);
    longer[6] += 1;
    seal(&mut longer);
    assert_eq!(decode(&longer), Err(LoadError::Corrupt));
    let mut unknown = page(&anchor(), 1);
    assert_eq!(unknown[16 + 13], 1);
    unknown[16 + 13] = 9;
    seal(&mut unknown);
    assert_eq!(decode(&unknown), Err(LoadError::Corrupt));
}

#[test]
fn a_whole_record_that_cannot_be_done_is_invalid() {
    let mut record = anchor();
    record.identity.address = Some(0xFFFF);
    assert!(
        matches!(decode(&page(&record, 1)), Err(LoadError::Invalid(invalid)) if invalid.field == "identity.address")
    );
}

fn place() -> impl Strategy<Value = [f32; 3]> {
    [-8_388_f32..8_388.0, -8_388_f32..8_388.0, -8_388_f32..8_388.0]
}

prop_compose! {
    fn an_area()(least_m in place(), size in [0.1_f32..1e3, 0.1_f32..1e3, 0.1_f32..1e3]) -> TagArea {
        TagArea { least_m, greatest_m: core::array::from_fn(|axis| least_m[axis] + size[axis]) }
    }
}

prop_compose! {
    fn a_tag()(
        height_m in of(-10_f32..100.0), rate in of(100..=100_000_u32), still in of(0.0..1_f64), sleep: bool,
        anchors_per_round in 1..=8_u8, tells in prop::sample::select(vec![PollContent::Nothing, PollContent::Distances, PollContent::Position, PollContent::Advertised]),
        scan in of((3..=10_240_u16, 0.0..1_f64)),
        report_ranges: bool, scheme in of(prop::sample::select(&Scheme::ALL)), sigma in of(0.01_f32..1.0),
        area in of(an_area()),
    ) -> Role {
        let slower = |share: f64| (f64::from(rate.unwrap_or(100)) * share).max(13.0) as u32;
        let window = |(interval_ms, share): (u16, f64)| {
            Scan { interval_ms, window_ms: 3 + (f64::from(interval_ms - 3) * share) as u16 }
        };
        Role::Tag(Tag {
            height_m, rate_chz: rate, still_rate_chz: still.map(slower), sleep, anchors_per_round, tells,
            scan: scan.map(window), report_ranges, solver: Solver::Track, scheme,
            height_sigma_m: sigma.filter(|_| height_m.is_some()).unwrap_or(0.0), area,
        })
    }
}

prop_compose! {
    fn an_advertiser()(
        uuid: [u8; 16], major: u16, minor: u16, measured_power_dbm: i8, interval_ms in 20..=10_240_u16,
        tx_power_dbm in -40..=20_i8, channels in 1..=7_u8,
    ) -> Role {
        Role::Advertiser(Advertiser {
            uuid, major, minor, measured_power_dbm, interval_ms, tx_power_dbm, channels, rotate_s: 0,
        })
    }
}

fn a_mode() -> impl Strategy<Value = Mode> {
    prop_oneof![
        Just(Mode::Native),
        Just(Mode::Blink),
        any::<bool>().prop_map(|fast| Mode::DecaRanging { fast }),
        (13..=100_000_u32).prop_map(|rounds_chz| Mode::Listening { rounds_chz }),
    ]
}

prop_compose! {
    fn a_network()(
        pan in 0..0xFFFF_u16, mode in a_mode(), channel in prop::sample::select(vec![1_u8, 2, 3, 4, 5, 7]),
        prf_mhz in prop::sample::select(vec![16_u8, 64]), rate_kbps in prop::sample::select(vec![110_u16, 850, 6810]),
        preamble in prop::sample::select(vec![1024_u16, 1536, 2048, 4096]),
        turnaround in of((1000..=20_000_u16, 1..=1000_u16, 1..=1000_u16)),
        region in of(prop::sample::select(vec![Region::Us, Region::Unchecked])), key: Option<[u8; 16]>,
    ) -> Network {
        let turnaround = turnaround
            .map(|(answer_us, listen_again_us, transmit_us)| ReplyDelay { answer_us, listen_again_us, transmit_us });
        Network {
            pan,
            mode,
            phy: Phy { channel, prf_mhz, rate_kbps, preamble, code: None },
            turnaround,
            region,
            key: key.filter(|_| !matches!(mode, Mode::DecaRanging { .. })),
        }
    }
}

prop_compose! {
    fn a_record()(
        eui in of(1..0x1_0000_0000_0000_u64), address in 0..0xFFFE_u16,
        role in prop_oneof![a_tag(), an_advertiser(), Just(Role::Scanner), of(place()).prop_map(|position_m| Role::Anchor { position_m })],
        network in a_network(),
        antenna_delay: Option<u16>, crystal_trim in of(0..=31_u8), tx_power: Option<u32>,
        first_pin in of(0..40_u8),
        anchors in vec(place(), 0..=24),
        beacons in vec((any::<u16>(), place(), of(-120_f32..20.0), of(0.5_f32..10.0)), 0..=24),
        beacon_key: Option<[u8; 16]>,
    ) -> Record {
        let anchors = anchors.into_iter().enumerate();
        let beacons = beacons.into_iter().enumerate();
        // A tag blinks ten times a second at most.
        let blinks = !matches!(role, Role::Tag(Tag { rate_chz: None | Some(1_001..), .. }));
        let mode = if network.mode == Mode::Blink && !blinks { Mode::Native } else { network.mode };
        Record {
            identity: Identity { eui, address: Some(address) },
            role,
            network: Network { mode, ..network },
            calibration: Calibration { antenna_delay, crystal_trim, tx_power },
            pins: first_pin.map(|n| Pins { sck: n, mosi: n + 1, miso: n + 2, cs: n + 3, irq: n + 4, reset: n + 5 }),
            anchors: anchors.map(|(n, position_m)| Anchor { address: n as u16, position_m }).collect(),
            beacons: beacons
                .map(|(n, (major, position_m, rssi_1m_dbm, path_loss_exponent))| {
                    Beacon { major, minor: n as u16, position_m, rssi_1m_dbm, path_loss_exponent }
                })
                .collect(),
            beacon_key,
        }
    }
}

proptest! {
    #[test]
    fn what_is_written_is_read(record in a_record(), sequence: u32) {
        prop_assert_eq!(record.validate(), Ok(()));
        prop_assert_eq!(decode(&page(&record, sequence)), Ok((record, sequence)));
    }

    #[test]
    fn noise_is_no_record(bytes in vec(any::<u8>(), 1..2000)) {
        prop_assert!(matches!(decode(&bytes), Err(LoadError::Corrupt | LoadError::Missing)));
    }

    #[test]
    fn noise_under_a_right_checksum_is_refused_or_valid(body in vec(any::<u8>(), 0..300)) {
        let length = (body.len() as u16).to_le_bytes();
        let mut bytes = [b"BLZR".as_slice(), &[VERSION, 0], &length, &[1, 0, 0, 0, 0, 0, 0, 0]].concat();
        bytes.extend(&body);
        seal(&mut bytes);
        if let Ok((record, sequence)) = decode(&bytes) {
            prop_assert_eq!((record.validate(), sequence), (Ok(()), 1));
        }
    }
}
