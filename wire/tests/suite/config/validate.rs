//! Which values of a config record are valid.

use baliza_wire::config::{
    Anchor, Beacon, Board, Identity, Invalid, Mode, Phy, Pins, PollContent, Record, Region, ReplyDelay, Role, Scan,
    Scheme, Solver, Tag, TagArea,
};
use radio::phy::{Channel, DataRate, PreambleLength, Prf};
use radio::{Capabilities, PhyConfig};

use super::examples::{anchor, beacon, longest, tag, tag_within};

fn refusal(of: Record, change: impl FnOnce(&mut Record)) -> String {
    let mut record = of;
    change(&mut record);
    record.validate().expect_err("it cannot be done").to_string()
}

fn role_of(record: &mut Record) -> &mut Tag {
    match &mut record.role {
        Role::Tag(tag) => tag,
        Role::Anchor { .. } | Role::Advertiser(_) | Role::Scanner => panic!("it is a tag"),
    }
}

fn area_of(record: &mut Record) -> &mut TagArea {
    role_of(record).area.as_mut().expect("it has an area")
}

fn pinned(record: &mut Record) -> &mut ReplyDelay {
    record.network.turnaround.as_mut().expect("it is pinned")
}

#[test]
fn the_examples_are_valid() {
    for record in [anchor(), tag(), beacon(), longest()] {
        assert_eq!(record.validate(), Ok(()), "{record:?}");
    }
}

#[test]
fn refusals_name_the_field_and_its_value() {
    let of_phy = |phy: Phy| refusal(anchor(), |record| record.network.phy = phy);
    let fast = anchor().network.phy;
    let cases = [
        (refusal(anchor(), |r| r.identity.address = Some(0xFFFF)), "identity.address is 0xFFFF: "),
        (refusal(anchor(), |r| r.identity.address = Some(0xFFFE)), "identity.address is 0xFFFE: "),
        (refusal(anchor(), |r| r.identity.eui = Some(0)), "identity.eui is 0x0000: "),
        (
            refusal(anchor(), |r| r.identity = Identity { eui: Some(0xAFFFF), address: None }),
            "identity.eui is 0xAFFFF: ",
        ),
        (refusal(anchor(), |r| r.network.pan = 0xFFFF), "network.pan is 0xFFFF: "),
        (of_phy(Phy { channel: 6, ..fast }), "network.phy.channel is 6: it must be 1, 2, 3, 4, 5 or 7"),
        (of_phy(Phy { prf_mhz: 32, ..fast }), "network.phy.prf_mhz is 32: it must be 16 or 64"),
        (of_phy(Phy { rate_kbps: 6800, ..fast }), "network.phy.rate_kbps is 6800: "),
        (of_phy(Phy { preamble: 100, ..fast }), "network.phy.preamble is 100: "),
        (of_phy(Phy { rate_kbps: 110, ..fast }), "network.phy.preamble is 128: it must be 1024 or more at 110 kbit/s"),
        (of_phy(Phy { code: Some(3), ..fast }), "network.phy.code is 3: "),
        (refusal(anchor(), |r| pinned(r).answer_us = 0), "network.turnaround.answer_us is 0: "),
        (refusal(anchor(), |r| pinned(r).listen_again_us = 0), "network.turnaround.listen_again_us is 0: "),
        (refusal(anchor(), |r| pinned(r).transmit_us = 251), "network.turnaround.transmit_us is 251: "),
        (refusal(anchor(), |r| pinned(r).answer_us = 20_001), "network.turnaround.answer_us is 20001: "),
        (refusal(anchor(), |r| r.calibration.crystal_trim = Some(32)), "calibration.crystal_trim is 32: "),
        (refusal(tag(), |r| role_of(r).height_m = Some(f32::NAN)), "tag.height_m is NaN: "),
        (refusal(tag_within(), |r| role_of(r).height_m = None), "tag.height_sigma_m is 0.3: "),
        (refusal(tag(), |r| role_of(r).height_sigma_m = f32::NAN), "tag.height_sigma_m is NaN: "),
        (refusal(tag(), |r| role_of(r).height_sigma_m = 1.5), "tag.height_sigma_m is 1.5: "),
        (refusal(tag_within(), |r| area_of(r).greatest_m[0] = 0.0), "tag.area is 0: "),
        (refusal(tag_within(), |r| area_of(r).least_m[1] = f32::NAN), "tag.area is 0: "),
        (refusal(tag_within(), |r| area_of(r).least_m[2] = f32::INFINITY), "tag.area is 0: "),
        (refusal(tag(), |r| role_of(r).rate_chz = Some(0)), "tag.rate_hz is 0: it must be 0.01 to 1000"),
        (
            refusal(tag(), |r| (r.network.mode, role_of(r).rate_chz) = (Mode::DecaRanging { fast: false }, Some(12))),
            "tag.rate_hz is 0.12: it must be 0.13 to 1000",
        ),
        (
            refusal(anchor(), |r| r.network.mode = Mode::Listening { rounds_chz: 12 }),
            "network.rounds_hz is 0.12: it must be 0.13 to 1000",
        ),
        (
            refusal(tag(), |r| (r.network.mode, role_of(r).rate_chz) = (Mode::Blink, Some(1001))),
            "tag.rate_hz is 10.01: it must be 0.01 to 10",
        ),
        (
            refusal(tag(), |r| {
                (r.network.mode, role_of(r).rate_chz, role_of(r).still_rate_chz) = (Mode::Blink, None, None)
            }),
            "tag.rate_hz is absent: it must be given",
        ),
        (refusal(tag(), |r| role_of(r).rate_chz = Some(100_001)), "tag.rate_hz is 1000.01: "),
        (refusal(tag(), |r| role_of(r).still_rate_chz = Some(1001)), "tag.still_rate_hz is 10.01: "),
        (refusal(tag(), |r| role_of(r).anchors_per_round = 0), "tag.anchors_per_round is 0: "),
        (refusal(tag(), |r| role_of(r).anchors_per_round = 9), "tag.anchors_per_round is 9: it must be 1 to 8"),
        (
            refusal(tag(), |r| role_of(r).scan = Some(Scan { interval_ms: 2, window_ms: 2 })),
            "tag.scan.interval_ms is 2: ",
        ),
        (
            refusal(tag(), |r| role_of(r).scan = Some(Scan { interval_ms: 50, window_ms: 51 })),
            "tag.scan.window_ms is 51: ",
        ),
        (refusal(beacon(), |r| r.beacon_key = None), "beacon_key is absent: "),
    ];
    for (said, expected) in cases {
        assert!(said.starts_with(expected), "{said}, not {expected}");
    }
}

#[test]
fn an_advertiser_s_ranges() {
    let change = |f: fn(&mut baliza_wire::config::Advertiser)| {
        refusal(beacon(), |record| match &mut record.role {
            Role::Advertiser(advertiser) => f(advertiser),
            Role::Tag(_) | Role::Anchor { .. } | Role::Scanner => panic!("it is a beacon"),
        })
    };
    assert!(change(|a| a.interval_ms = 19).starts_with("beacon.interval_ms is 19: "));
    assert!(change(|a| a.interval_ms = 10_241).starts_with("beacon.interval_ms is 10241: "));
    assert!(change(|a| a.tx_power_dbm = 21).starts_with("beacon.tx_power_dbm is 21: "));
    assert!(change(|a| a.channels = 0).starts_with("beacon.channels is 0: "));
    assert!(change(|a| a.channels = 8).starts_with("beacon.channels is 8: "));
}

#[test]
fn only_a_dwm1001_that_knows_its_position_and_does_not_scan_advertises_it() {
    let advertising = |change: fn(&mut Record)| {
        let mut record = tag();
        (role_of(&mut record).tells, role_of(&mut record).scan) = (PollContent::Advertised, None);
        change(&mut record);
        record
    };
    let said = |record: &Record, board| record.validate_for(board).map_err(|invalid| invalid.to_string());
    assert_eq!(said(&advertising(|_| ()), Board::Dwm1001), Ok(()));
    let refused = |change, board, why: &str| {
        let said = said(&advertising(change), board).expect_err(why);
        assert_eq!(said, format!("tag.advertise_position is true: it must be absent{why}"));
    };
    refused(|_| (), Board::Esp32C3, ": only the DWM1001's image of a tag advertises");
    let scan = |record: &mut Record| role_of(record).scan = Some(Scan { interval_ms: 50, window_ms: 50 });
    refused(scan, Board::Dwm1001, " beside scan_interval_ms: the image that scans does not advertise");
    let blink = |record: &mut Record| record.network.mode = Mode::Blink;
    refused(blink, Board::Dwm1001, " in mode blink: such a tag does not know its position");
}

#[test]
fn a_scanner_needs_a_chip_of_espressif() {
    let scanner = Record { role: Role::Scanner, ..anchor() };
    for board in Board::HARDWARE {
        let is_esp = matches!(board, Board::Esp32C3 | Board::Esp32C6 | Board::Esp32);
        let said = scanner.validate_for(board).map_err(|invalid| invalid.to_string());
        let must = "it must be on an ESP32: no other board has an image of a scanner";
        assert_eq!(said, if is_esp { Ok(()) } else { Err(format!("role is scanner: {must}")) }, "{board:?}");
    }
    assert!(!scanner.transmits());
}

#[test]
fn places_are_finite_and_near() {
    let at = |position_m| Anchor { address: 1, position_m };
    for bad in [f32::NAN, f32::INFINITY, -100_001.0] {
        let said = refusal(tag(), |record| record.anchors.push(at([0.0, bad, 0.0])).unwrap());
        assert!(said.starts_with("anchors[0].position_m is "), "{said}");
    }
    // An anchor sends its own position on the air, where a coordinate has three bytes of millimetres.
    let said = refusal(anchor(), |record| record.role = Role::Anchor { position_m: Some([0.0, 0.0, 8_389.0]) });
    assert!(said.starts_with("anchor.position_m is 8389: "), "{said}");
}

#[test]
fn lists_have_nobody_twice() {
    let one = Anchor { address: 7, position_m: [0.0; 3] };
    let said = refusal(tag(), |record| record.anchors = heapless::Vec::from_slice(&[one, one]).unwrap());
    assert_eq!(said, "anchors[1].address is 0x0007: it must be different from the others'");
    let one = Beacon { major: 1, minor: 2, position_m: [0.0; 3], rssi_1m_dbm: None, path_loss_exponent: None };
    let said = refusal(tag(), |record| record.beacons = heapless::Vec::from_slice(&[one, one]).unwrap());
    assert!(said.starts_with("beacons[1].minor is 2: "), "{said}");
    let said = refusal(tag(), |r| r.beacons.push(Beacon { rssi_1m_dbm: Some(f32::NAN), ..one }).unwrap());
    assert!(said.starts_with("beacons[0].rssi_1m_dbm is NaN: "), "{said}");
    let said = refusal(tag(), |r| r.beacons.push(Beacon { path_loss_exponent: Some(0.0), ..one }).unwrap());
    assert!(said.starts_with("beacons[0].path_loss_exponent is 0: "), "{said}");
}

#[test]
fn pins_are_distinct_and_the_board_has_them() {
    let pins = Pins { sck: 6, mosi: 7, miso: 2, cs: 10, irq: 3, reset: 4 };
    let with = |pins: Pins| Record { pins: Some(pins), ..anchor() };
    assert_eq!(with(pins).validate_for(Board::Esp32C3), Ok(()));
    let twice = with(Pins { irq: 6, ..pins }).validate().map_err(|invalid| invalid.to_string());
    assert_eq!(twice, Err("pins.irq is 6: it must be a pin that no other signal has".into()));
    let field = |record: &Record, board| record.validate_for(board).map_err(|Invalid { field, .. }| field);
    // The C3's GPIO 18 is its USB port; the ESP32's GPIO 6 and 7 are its flash, and 34 is an input only.
    assert_eq!(field(&with(Pins { cs: 18, ..pins }), Board::Esp32C3), Err("pins.cs"));
    assert_eq!(field(&with(pins), Board::Esp32), Err("pins.sck"));
    let classic = Pins { sck: 18, mosi: 23, miso: 19, cs: 4, irq: 34, reset: 27 };
    assert_eq!(field(&with(classic), Board::Esp32), Ok(()));
    assert_eq!(field(&with(Pins { irq: 27, reset: 34, ..classic }), Board::Esp32), Err("pins.reset"));
    assert_eq!(field(&with(classic), Board::Dwm1001), Err("pins.sck"), "its DW1000 is soldered");
}

#[test]
fn a_radio_refuses_what_it_lacks() {
    let field = |record: Record, radio: &Capabilities| record.network.validate_for(radio).map_err(|of| of.to_string());
    // A radio such as the DW3000: no 110 kbit/s, and of the channels of the DW1000 only 5.
    let other = Capabilities {
        channels: &[Channel::Ch5],
        data_rates: &[DataRate::Kbps850, DataRate::Kbps6810],
        ..baliza_dw1000::CAPABILITIES
    };
    let with = |channel, rate_kbps| {
        let mut record = anchor();
        record.network.phy = Phy { channel, prf_mhz: 64, rate_kbps, preamble: 1024, code: None };
        record
    };
    assert_eq!(field(with(5, 6810), &other), Ok(()));
    assert_eq!(field(with(2, 110), &baliza_dw1000::CAPABILITIES), Ok(()));
    let must = "it must be one that the radio of this board has";
    assert_eq!(field(with(2, 6810), &other), Err(format!("network.phy.channel is 2: {must}")));
    assert_eq!(field(with(5, 110), &other), Err(format!("network.phy.rate_kbps is 110: {must}")));
}

#[test]
fn the_table_of_boards_has_the_capabilities_of_the_driver() {
    for board in Board::HARDWARE.into_iter().chain([Board::Simulated]) {
        assert_eq!(board.spec().radio, baliza_dw1000::CAPABILITIES, "{board:?}");
    }
}

#[test]
fn boards_without_bluetooth_neither_scan_nor_advertise() {
    let field = |record: &Record, board| record.validate_for(board).map_err(|Invalid { field, .. }| field);
    assert_eq!(field(&tag(), Board::Dwm1001), Ok(()));
    assert_eq!(field(&tag(), Board::Evk1000), Err("tag.scan.interval_ms"));
    assert_eq!(field(&Record { pins: None, ..beacon() }, Board::Dwm1001), Err("beacon.minor"));
    assert_eq!(field(&beacon(), Board::Esp32C6), Ok(()));
}

#[test]
fn rounds_to_listen_to_are_within_a_clock_s_range() {
    let said = refusal(anchor(), |record| record.network.mode = Mode::Listening { rounds_chz: 12 });
    assert!(said.starts_with("network.rounds_hz is 0.12: "), "{said}");
    let mut slow = anchor();
    slow.network.mode = Mode::Listening { rounds_chz: 13 };
    assert_eq!(slow.validate(), Ok(()));
}

#[test]
fn a_region_refuses_what_it_forbids_and_only_of_nodes_that_transmit() {
    let on = |record: Record, region, channel| {
        let mut record = record;
        record.network.region = region;
        record.network.phy = Phy { channel, code: None, ..record.network.phy };
        record.validate().map_err(|Invalid { field, .. }| field)
    };
    let refused = Err("network.phy.channel");
    // Commission Implementing Decision (EU) 2019/785: 6.0 to 8.5 GHz without a limit of the duty cycle; this band
    // contains channels 5 and 7.
    for channel in [1, 2, 3, 4, 5, 7] {
        let eu = if channel < 5 { refused } else { Ok(()) };
        assert_eq!(on(anchor(), Some(Region::Eu), channel), eu, "{channel}");
        // 7.25 GHz and above, or DAA: no channel fulfils this.
        assert_eq!(on(anchor(), Some(Region::Japan), channel), refused, "{channel}");
        // MIIT No. 77 (2024): 7163 to 8812 MHz; channel 7 ends at 7.03 GHz.
        assert_eq!(on(anchor(), Some(Region::China), channel), refused, "{channel}");
        for anywhere in [None, Some(Region::Us), Some(Region::Unchecked)] {
            assert_eq!(on(anchor(), anywhere, channel), Ok(()), "{channel}");
        }
        assert_eq!(on(beacon(), Some(Region::Japan), channel), Ok(()), "its radio is Bluetooth's");
    }
    let mut listener = tag();
    role_of(&mut listener).solver = Solver::Track;
    listener.network.mode = Mode::Listening { rounds_chz: 1000 };
    assert_eq!(on(listener.clone(), Some(Region::Eu), 2), Ok(()), "it only listens");
    listener.role = anchor().role;
    assert_eq!(on(listener, Some(Region::Eu), 2), refused);
    let said = refusal(anchor(), |record| (record.network.region, record.network.phy.channel) = (Some(Region::Eu), 2));
    assert!(said.starts_with("network.phy.channel is 2: it must be 5 or 7 in region \"eu\": "), "{said}");
}

#[test]
fn a_tag_that_only_listens_follows_a_track() {
    let said = refusal(tag(), |record| record.network.mode = Mode::Listening { rounds_chz: 1000 });
    assert!(said.starts_with("tag.solver is b-wls: it must be track in mode \"listening\": "), "{said}");
}

#[test]
fn names_are_those_of_one_solver_scheme_and_region() {
    let solvers = ["track", "robust", "b-wls", "b-wls-r", "bounding-box"];
    assert_eq!(solvers.map(|name| Solver::from_name(name).map(Solver::name)), solvers.map(Some));
    let schemes = ["single-sided", "double-sided"];
    assert_eq!(schemes.map(|name| Scheme::from_name(name).map(Scheme::name)), schemes.map(Some));
    let regions = ["eu", "us", "japan", "china", "none"];
    assert_eq!(regions.map(|name| Region::from_name(name).map(Region::name)), regions.map(Some));
    assert_eq!((Solver::from_name("nls"), Scheme::from_name(""), Region::from_name("EU")), (None, None, None));
}

#[test]
fn the_phy_of_a_record_is_the_radios() {
    assert_eq!(anchor().phy(), Ok(PhyConfig::FAST));
    let old = PhyConfig::new(Channel::Ch2, Prf::Mhz16, DataRate::Kbps110, PreambleLength::Symbols1024).unwrap();
    assert_eq!(beacon().phy(), Ok(old.with_preamble_code(4).unwrap()));
}

#[test]
fn the_address_is_the_record_s_or_the_chip_s() {
    assert_eq!(anchor().identity.on(0x42), (0x0123_4567_89AB_CDEF, 0x0101));
    assert_eq!(Identity::default().on(0xDEAD_BEEF_0000_1234), (0xDEAD_BEEF_0000_1234, 0x1234));
}

#[test]
fn boards_keep_their_records_where_the_flash_ends() {
    // 512 KiB, 256 KiB seen from 0x0800_0000, and the partition `nvs` at 0x9000, 24 KiB long.
    assert_eq!(Board::Dwm1001.pages().addresses()[1] + 4096, 512 * 1024);
    assert_eq!(Board::Evk1000.pages().addresses(), [0x0803_F000, 0x0803_F800]);
    assert_eq!(Board::Evk1000.pages().offsets[1] + 2048, 256 * 1024);
    assert_eq!(Board::Esp32C3.pages().addresses(), [0x9000, 0xA000]);
    for board in Board::HARDWARE {
        assert!(board.pages().size as usize >= baliza_wire::config::MAX_BYTES);
        assert_eq!(Board::from_name(board.name()), Some(board));
    }
    assert_eq!(["dwm1000", "simulated"].map(Board::from_name), [None; 2]);
}

#[test]
fn images_end_before_the_pages_of_the_record_and_the_models() {
    for board in [Board::Dwm1001, Board::Evk1000] {
        let pages = board.pages();
        let first = pages.models_address().unwrap_or(pages.addresses()[0]);
        let &[(origin, bytes)] = board.spec().memory.flash else { panic!("{board:?}: one flash") };
        assert_eq!((board.spec().memory.image_origin, origin + bytes), (Some(pages.base), first), "{board:?}");
    }
}

/// The pins that a chip reads at reset (data sheets, "Strapping Pins"), without the one that the table excepts.
const STRAPPING: [(Board, &[u8]); 3] =
    [(Board::Esp32C3, &[8, 9]), (Board::Esp32C6, &[4, 5, 8, 9, 15]), (Board::Esp32, &[0, 2, 5, 12, 15])];

#[test]
fn default_pins_may_be_named_disturb_no_reset_and_are_six() {
    for (board, strapping) in STRAPPING {
        let choice = board.spec().pins.expect("the user wires it");
        let mut taken = choice.default.named().map(|(name, pin, driven)| {
            assert!(choice.allows(pin, driven), "{board:?} {name}");
            pin
        });
        assert!(!taken.iter().any(|pin| strapping.contains(pin)), "{board:?}");
        taken.sort_unstable();
        assert!(taken.windows(2).all(|pair| pair[0] < pair[1]), "{board:?}");
    }
}
