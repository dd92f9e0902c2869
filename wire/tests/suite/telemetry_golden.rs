//! Literal bytes of every message, here and in `docs/reference/wire-format.md`.
//!
//! They were made by an independent implementation, some thirty lines of Python that do not use this crate: varints by
//! repeated division by 128; zigzag as 2n and −2n − 1; the CRC bit by bit with polynomial 0x1021 (it gives 0x29B1 for
//! "123456789"); COBS as the lengths of the pieces between zeros; the fields of each message in the order of the page.

use std::collections::BTreeMap;
#[cfg(feature = "host")]
use std::collections::BTreeSet;

use baliza_wire::telemetry::*;
use baliza_wire::uwb::native::UserData;

const T_FIX_US: u64 = 12_345_678;

fn fix(outcome: Outcome, doubt: Doubt) -> Message {
    Message::Fix(Fix { t_us: T_FIX_US, round: 300, age_us: 8500, asked: 6, outcome, solver: Solver::BWls, doubt })
}

fn diagnostics() -> Diagnostics {
    Diagnostics {
        rx_power_cdbm: -7925,
        first_path_power_cdbm: -8150,
        first_path_index_64ths: 47_712,
        first_path_amplitudes: [9000, 10_500, 8000],
        cir_power: 12_000,
        preamble_count: 118,
        noise_deviation: 52,
        clock_offset_cppm: -235,
    }
}

fn difference(peer: u16, difference_tenth_mm: i32, deviation_tenth_mm: u32, position: [i32; 3]) -> Message {
    let (position_tenth_mm, diagnostics) = (Some(position), diagnostics());
    Message::Difference(Difference {
        t_us: 12_345_600,
        round: 300,
        reference: 257,
        peer,
        difference_tenth_mm,
        deviation_tenth_mm,
        position_tenth_mm,
        diagnostics,
    })
}

fn range(distance_tenth_mm: i32, position_tenth_mm: Option<[i32; 3]>) -> Message {
    Message::Range(Range {
        t_us: 12_345_600,
        round: 300,
        peer: 258,
        distance_tenth_mm,
        deviation_tenth_mm: 350,
        position_tenth_mm,
        diagnostics: diagnostics(),
    })
}

fn room(t_us: u64, is: RoomEstimate) -> Message {
    Message::Room(Room { t_us, is })
}

/// Every frame with its name in the document, and its JSON object with ' for ": programs of users read its keys.
fn golden() -> Vec<(&'static str, Message, &'static str, &'static str)> {
    let position = Outcome::Position {
        position_tenth_mm: [32_100, 40_500, 15_000],
        deviation_tenth_mm: [600, 500, 1200],
        correlation_127ths: [32, 0, -64],
        used: 0b11_1011,
        quality_255ths: 230,
    };
    let in_3 = RoomProbability { room: 3, probability_255ths: 242 };
    let between = RoomEstimate::Between([
        RoomProbability { room: 0, probability_255ths: 140 },
        RoomProbability { room: 2, probability_255ths: 90 },
    ]);
    let crash = Crash { reason: CrashReason::Stalled, program_counter: 0x2_A4F6, line: 0, file: 0 };
    let counters = Counters {
        t_us: 60_000_000,
        sent: 600,
        received: 3550,
        timeouts: 50,
        corrupt: 7,
        late: 2,
        not_sent: 1,
        radio_failures: 0,
        rounds_dropped: 3,
        telemetry_dropped: 0,
        sightings: 1200,
        sightings_dropped: 4,
        refused: 2,
    };
    // 1234 and -5600 mm; (16 + 9) · 2⁷, (16 + 3) · 2⁸ and 16 · 2⁹ sixteenths of a millimetre; 42/127, 13/127; 0x81: of the
    // round before, suspect.
    let told = [0xD2, 4, 0, 0x20, 0xEA, 0xFF, 0, 0, 0, 0x79, 0x83, 0x90, 42, 13, 0, 0x81];
    let tag_fix = TagFix { t_us: 12_345_600, tag: 0x1001, round: 300, asked: 4, age_us: 250_000, position: told };
    let hello = Hello {
        t_us: 1_500_000,
        eui: 0x1020_5F12_3456_7890,
        address: 0x1234,
        role: Role::Tag,
        board: Board::Evk1000,
        build: [0x01, 0x23, 0x45, 0x67, 0x89, 0xAB, 0xCD, 0xEF],
        keyed: true,
    };
    let beacon = BeaconId { network: 0xB940_7F30, major: 7, minor: 513 };
    let no_record = Condition::NoRecord(RecordError::Version(3));
    vec![
        (
            "hello",
            Message::Hello(hello),
            "02 01 0F E0 C6 5B 90 F1 D9 A2 A3 E2 97 90 10 B4 24 0D 01 01 23 45 67 89 AB CD EF 01 23 C4 00",
            "{'type':'hello','t_s':1.5,'eui':'10205f1234567890','address':'0x1234','role':'tag','board':'evk1000',\
             'build':'0123456789abcdef','keyed':true}",
        ),
        (
            "fix",
            fix(position, Doubt::None),
            "0C 01 01 CE C2 F1 05 AC 02 B4 42 06 11 C8 F5 03 E8 F8 04 B0 EA 01 D8 04 F4 03 B0 09 20 07 C0 3B E6 03 5A 39 00",
            "{'type':'fix','t_s':12.345678,'round':300,'age_s':0.0085,'asked':6,'x_m':3.21,'y_m':4.05,'z_m':1.5,\
             'sigma_x_m':0.06,'sigma_y_m':0.05,'sigma_z_m':0.12,'covariance_m2':[[0.0036,0.000755906,0.0],\
             [0.000755906,0.0025,-0.003023622],[0.0,-0.003023622,0.0144]],'used':5,'used_ranges':[0,1,3,4,5],\
             'quality':0.902,'reason':null,'solver':'b-wls','flag':null,'alt_x_m':null,'alt_y_m':null,'alt_z_m':null}",
        ),
        (
            "fix, ambiguous",
            fix(position, Doubt::Ambiguous([32_100, -19_500, 15_000])),
            "0C 01 01 CE C2 F1 05 AC 02 B4 42 06 11 C8 F5 03 E8 F8 04 B0 EA 01 D8 04 F4 03 B0 09 20 11 C0 3B E6 03 02 C8 F5 \
             03 D7 B0 02 B0 EA 01 81 1F 00",
            "{'type':'fix','t_s':12.345678,'round':300,'age_s':0.0085,'asked':6,'x_m':3.21,'y_m':4.05,'z_m':1.5,\
             'sigma_x_m':0.06,'sigma_y_m':0.05,'sigma_z_m':0.12,'covariance_m2':[[0.0036,0.000755906,0.0],\
             [0.000755906,0.0025,-0.003023622],[0.0,-0.003023622,0.0144]],'used':5,'used_ranges':[0,1,3,4,5],\
             'quality':0.902,'reason':null,'solver':'b-wls','flag':'ambiguous','alt_x_m':3.21,'alt_y_m':-1.95,\
             'alt_z_m':1.5}",
        ),
        (
            "no fix",
            fix(Outcome::Reason(SolveError::RangesDisjoint), Doubt::None),
            "11 01 01 CE C2 F1 05 AC 02 B4 42 06 01 05 03 8B 3E 00",
            "{'type':'fix','t_s':12.345678,'round':300,'age_s':0.0085,'asked':6,'x_m':null,'y_m':null,'z_m':null,\
             'sigma_x_m':null,'sigma_y_m':null,'sigma_z_m':null,'covariance_m2':null,'used':null,'used_ranges':null,\
             'quality':null,'reason':'ranges-disjoint','solver':'b-wls','flag':null,'alt_x_m':null,'alt_y_m':null,\
             'alt_z_m':null}",
        ),
        (
            "range",
            range(54_321, Some([0, -125_000, 24_000])),
            "11 01 02 80 C2 F1 05 AC 02 82 02 E2 D0 06 DE 02 01 1C 8F A1 0F 80 F7 02 E9 7B AB 7F E0 F4 02 A8 46 84 52 C0 \
             3E E0 5D 76 34 D5 03 3E 23 00",
            "{'type':'range','t_s':12.3456,'round':300,'peer':'0x0102','range_m':5.4321,'sigma_m':0.035,'peer_x_m':0.0,\
             'peer_y_m':-12.5,'peer_z_m':2.4,'rx_power_dbm':-79.25,'fp_power_dbm':-81.5,'fp_idx':745.5,\
             'fp_amp1':9000,'fp_amp2':10500,'fp_amp3':8000,'cir_pwr':12000,'rxpacc':118,'std_noise':52,\
             'clock_offset_ppm':-2.35}",
        ),
        (
            "range, place unknown",
            range(-120, None),
            "0F 01 02 80 C2 F1 05 AC 02 82 02 EF 01 DE 02 16 E9 7B AB 7F E0 F4 02 A8 46 84 52 C0 3E E0 5D 76 34 D5 03 74 \
             20 00",
            "{'type':'range','t_s':12.3456,'round':300,'peer':'0x0102','range_m':-0.012,'sigma_m':0.035,'peer_x_m':null,\
             'peer_y_m':null,'peer_z_m':null,'rx_power_dbm':-79.25,'fp_power_dbm':-81.5,'fp_idx':745.5,\
             'fp_amp1':9000,'fp_amp2':10500,'fp_amp3':8000,'cir_pwr':12000,'rxpacc':118,'std_noise':52,\
             'clock_offset_ppm':-2.35}",
        ),
        (
            "sighting",
            Message::Sighting(Sighting { t_us: 20_000_000, beacon, rssi_dbm: -67, measured_power_dbm: -59 }),
            "13 01 03 80 DA C4 09 B0 FE 81 CA 0B 07 81 04 BD C5 E5 2D 00",
            "{'type':'sighting','t_s':20.0,'beacon':'b9407f30-7-513','network':3108011824,'major':7,'minor':513,\
             'rssi_dbm':-67,'measured_power_dbm':-59}",
        ),
        (
            "state",
            Message::State(State { t_us: 2_000_000, is: Condition::Synchronised(257) }),
            "0B 01 04 80 89 7A 04 81 02 52 17 00",
            "{'type':'state','t_s':2.0,'state':'synchronised','peer':'0x0101','slots':null,'times':null,\
             'record_fault':null,'record_version':null,'levels_fault':null,'levels_version':null,'beacon':null,\
             'for_s':null}",
        ),
        (
            "network full",
            Message::State(State { t_us: 2_000_000, is: Condition::NetworkFull }),
            "09 01 04 80 89 7A 0F 38 AC 00",
            "{'type':'state','t_s':2.0,'state':'network-full','peer':null,'slots':null,'times':null,\
             'record_fault':null,'record_version':null,'levels_fault':null,'levels_version':null,'beacon':null,\
             'for_s':null}",
        ),
        (
            "unlisted",
            Message::State(State { t_us: 2_000_000, is: Condition::Unlisted }),
            "09 01 04 80 89 7A 11 C7 5F 00",
            "{'type':'state','t_s':2.0,'state':'unlisted','peer':null,'slots':null,'times':null,\
             'record_fault':null,'record_version':null,'levels_fault':null,'levels_version':null,'beacon':null,\
             'for_s':null}",
        ),
        (
            "motion sensor silent",
            Message::State(State { t_us: 2_000_000, is: Condition::MotionSensor(MotionSensor::Silent) }),
            "0A 01 04 80 89 7A 10 01 0A 4F 00",
            "{'type':'state','t_s':2.0,'state':'motion-sensor-silent','peer':null,'slots':null,'times':null,\
             'record_fault':null,'record_version':null,'levels_fault':null,'levels_version':null,'beacon':null,\
             'for_s':null}",
        ),
        (
            "no record",
            Message::State(State { t_us: 250_000, is: no_record }),
            "06 01 04 90 A1 0F 05 01 03 06 2E 00",
            "{'type':'state','t_s':0.25,'state':'no-record','peer':null,'slots':null,'times':null,\
             'record_fault':'version','record_version':3,'levels_fault':null,'levels_version':null,'beacon':null,\
             'for_s':null}",
        ),
        (
            "counters",
            Message::Counters(counters),
            "0F 01 05 80 8E CE 1C D8 04 DE 1B 32 07 02 01 02 03 07 B0 09 04 02 7F 6B 00",
            "{'type':'counters','t_s':60.0,'sent':600,'received':3550,'timeouts':50,'corrupt':7,'late':2,\
             'not_sent':1,'radio_failures':0,'rounds_dropped':3,'telemetry_dropped':0,'sightings':1200,\
             'sightings_dropped':4,'refused':2}",
        ),
        (
            "reset",
            Message::Reset(Reset { t_us: 1200, cause: ResetCause::Watchdog, crash: Some(crash) }),
            "0B 01 06 B0 09 04 01 03 F6 C9 0A 01 03 26 F1 00",
            "{'type':'reset','t_s':0.0012,'cause':'watchdog','cause_number':null,'crash':{'reason':'stalled',\
             'program_counter':'0002a4f6','line':0,'file_hash':'00000000'}}",
        ),
        (
            "power",
            Message::Reset(Reset { t_us: 900, cause: ResetCause::PowerOn, crash: None }),
            "05 01 06 84 07 01 03 6C 14 00",
            "{'type':'reset','t_s':0.0009,'cause':'power-on','cause_number':null,'crash':null}",
        ),
        (
            "difference, the reference",
            difference(257, 0, 300, [10_000, 20_000, 24_000]),
            "0D 01 07 80 C2 F1 05 AC 02 81 02 81 02 22 AC 02 01 A0 9C 01 C0 B8 02 80 F7 02 E9 7B AB 7F E0 F4 02 A8 46 84 \
             52 C0 3E E0 5D 76 34 D5 03 86 B0 00",
            "{'type':'difference','t_s':12.3456,'round':300,'reference':'0x0101','peer':'0x0101','difference_m':0.0,\
             'sigma_m':0.03,'peer_x_m':1.0,'peer_y_m':2.0,'peer_z_m':2.4,'rx_power_dbm':-79.25,'fp_power_dbm':-81.5,\
             'fp_idx':745.5,'fp_amp1':9000,'fp_amp2':10500,'fp_amp3':8000,'cir_pwr':12000,'rxpacc':118,\
             'std_noise':52,'clock_offset_ppm':-2.35}",
        ),
        (
            "difference",
            difference(258, -12_345, 420, [0, -125_000, 24_000]),
            "13 01 07 80 C2 F1 05 AC 02 81 02 82 02 F1 C0 01 A4 03 01 1C 8F A1 0F 80 F7 02 E9 7B AB 7F E0 F4 02 A8 46 84 \
             52 C0 3E E0 5D 76 34 D5 03 5A 36 00",
            "{'type':'difference','t_s':12.3456,'round':300,'reference':'0x0101','peer':'0x0102','difference_m':-1.2345,\
             'sigma_m':0.042,'peer_x_m':0.0,'peer_y_m':-12.5,'peer_z_m':2.4,'rx_power_dbm':-79.25,\
             'fp_power_dbm':-81.5,'fp_idx':745.5,'fp_amp1':9000,'fp_amp2':10500,'fp_amp3':8000,'cir_pwr':12000,\
             'rxpacc':118,'std_noise':52,'clock_offset_ppm':-2.35}",
        ),
        (
            "room",
            room(30_500_000, RoomEstimate::Room(in_3)),
            "0C 01 08 A0 C9 C5 0E 01 03 F2 DD C1 00",
            "{'type':'room','t_s':30.5,'is':'room','rooms':[3],'probabilities':[0.949]}",
        ),
        (
            "between rooms",
            room(31_000_000, between),
            "08 01 08 C0 8B E4 0E 02 06 8C 02 5A AB 43 00",
            "{'type':'room','t_s':31.0,'is':'between','rooms':[0,2],'probabilities':[0.549,0.353]}",
        ),
        (
            "room unknown",
            room(42_000_000, RoomEstimate::Unknown),
            "07 01 08 80 BD 83 14 03 D7 03 00",
            "{'type':'room','t_s':42.0,'is':'unknown','rooms':[],'probabilities':[]}",
        ),
        (
            "map unused",
            Message::State(State { t_us: 300_000, is: Condition::Unused(SiteModelPart::Map, RssiModelError::Corrupt) }),
            "0B 01 04 E0 A7 12 0B 01 01 8D 54 00",
            "{'type':'state','t_s':0.3,'state':'map-unused','peer':null,'slots':null,'times':null,\
             'record_fault':null,'record_version':null,'levels_fault':'corrupt','levels_version':null,'beacon':null,\
             'for_s':null}",
        ),
        (
            "models of beacons unused",
            Message::State(State {
                t_us: 300_000,
                is: Condition::Unused(SiteModelPart::All, RssiModelError::Version(2)),
            }),
            "07 01 04 E0 A7 12 0B 01 04 02 32 B3 00",
            "{'type':'state','t_s':0.3,'state':'levels-unused','peer':null,'slots':null,'times':null,\
             'record_fault':null,'record_version':null,'levels_fault':'version','levels_version':2,'beacon':null,\
             'for_s':null}",
        ),
        (
            "tag-fix",
            Message::TagFix(tag_fix),
            "11 01 0A 80 C2 F1 05 81 20 AC 02 04 90 A1 0F D2 04 04 20 EA FF 01 01 06 79 83 90 2A 0D 04 81 A7 CA 00",
            "{'type':'tag-fix','t_s':12.3456,'tag':'0x1001','round':299,'rounds_ago':1,'asked':4,'age_s':0.25,'x_m':1.234,'y_m':-5.6,\
             'z_m':0.0,'sigma_x_m':0.2,'sigma_y_m':0.304,'sigma_z_m':0.512,'covariance_m2':[[0.04,0.020107087,0.01048189],[0.020107087,0.092416,0.0],[0.01048189,0.0,0.262144]],'flag':'suspect'}",
        ),
        (
            "tag-data",
            Message::TagData(TagData::new(12_345_600, 0, 0x1001, &UserData::new(7, b"door 3").unwrap())),
            "0A 01 0B 80 C2 F1 05 81 20 07 08 06 64 6F 6F 72 20 33 01 01 01 01 01 01 01 01 01 01 01 01 01 01 01 01 01 03 FC FB 00",
            "{'type':'tag-data','t_s':12.3456,'tag':'0x1001','number':7,'age_s':0.0,'data':'646F6F722033'}",
        ),
        (
            "tag-answer",
            Message::TagAnswer(TagAnswer { t_us: 12_345_600, tag: 0x1001, number: 200, age_us: 250_000, code: 2 }),
            "10 01 0D 80 C2 F1 05 81 20 C8 90 A1 0F 02 D6 65 00",
            "{'type':'tag-answer','t_s':12.3456,'tag':'0x1001','number':200,'age_s':0.25,'answer':'needs-key'}",
        ),
        (
            "arrival of a blink",
            Message::Arrival(Arrival {
                t_us: 12_345_600,
                source: 0x1001,
                number: 300,
                frame: ArrivedFrame::Blink,
                ticks: 0xFF_0102_0304,
                rx_power_cdbm: -7925,
                first_path_power_cdbm: -8150,
            }),
            "0B 01 0C 80 C2 F1 05 81 20 AC 02 0D 84 86 88 88 F0 1F E9 7B AB 7F 0C 04 00",
            "{'type':'arrival','t_s':12.3456,'frame':'blink','source':'0x1001','number':300,'ticks':1095233569540,\
             'rx_power_dbm':-79.25,'first_path_power_dbm':-81.5}",
        ),
        (
            "departure of an own sync frame",
            Message::Arrival(Arrival {
                t_us: 12_345_600,
                source: 0x0107,
                number: 65_535,
                frame: ArrivedFrame::OwnSyncFrame,
                ticks: 5,
                rx_power_cdbm: i16::MIN,
                first_path_power_cdbm: i16::MIN,
            }),
            "16 01 0C 80 C2 F1 05 87 02 FF FF 03 02 05 FF FF 03 FF FF 03 08 C2 00",
            "{'type':'arrival','t_s':12.3456,'frame':'own-sync-frame','source':'0x0107','number':65535,'ticks':5,\
             'rx_power_dbm':null,'first_path_power_dbm':null}",
        ),
        (
            "supply",
            Message::Supply(Supply { t_us: 60_000_000, supply_mv: 3300, temperature_centi_celsius: 2449 }),
            "0D 01 09 80 8E CE 1C E4 19 A2 26 E3 35 00",
            "{'type':'supply','t_s':60.0,'supply_v':3.3,'temperature_c':24.49}",
        ),
        (
            "supply, temperature unknown",
            Message::Supply(Supply { t_us: 61_000_000, supply_mv: 2850, temperature_centi_celsius: i16::MIN }),
            "0E 01 09 C0 92 8B 1D A2 16 FF FF 03 87 9C 00",
            "{'type':'supply','t_s':61.0,'supply_v':2.85,'temperature_c':null}",
        ),
    ]
}

fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u8> = hex.bytes().filter(|digit| !digit.is_ascii_whitespace()).collect();
    let byte = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok();
    digits.chunks(2).map(|pair| byte(pair).expect("two hexadecimal digits")).collect()
}

#[test]
fn messages_are_written_as_the_golden_bytes_and_read_back() {
    for (name, message, hex, _) in golden() {
        assert_eq!(encode(&message, &mut [0xA5; MAX_FRAME]), bytes(hex), "{name}");
        assert_eq!(decode(&bytes(hex)), Ok(message), "{name}");
    }
}

#[cfg(feature = "host")]
#[test]
fn messages_are_these_objects_of_json() {
    for (name, message, _, json) in golden() {
        assert_eq!(message.json().to_string(), json.replace('\'', "\""), "{name}");
    }
    let kinds: BTreeSet<_> = golden().iter().map(|(_, message, ..)| message.kind()).collect();
    assert_eq!(kinds, BTreeSet::from_iter(Message::KINDS.iter().copied()), "every message is here");
}

#[test]
fn the_page_has_the_golden_bytes() {
    let page = include_str!("../../../docs/reference/wire-format.md");
    let section = page.split("\n## ").find(|section| section.starts_with("Golden frames")).expect("the section");
    let rows = section.lines().filter_map(|line| {
        let mut cells = line.split('|').map(str::trim).skip(1);
        let (name, hex) = (cells.next()?, cells.next()?);
        Some((name, bytes(hex.strip_prefix('`')?.strip_suffix('`')?)))
    });
    let golden: BTreeMap<_, _> = golden().into_iter().map(|(name, _, hex, _)| (name, bytes(hex))).collect();
    assert_eq!(rows.collect::<BTreeMap<_, _>>(), golden);
    // The example that the document explains byte by byte.
    assert!(page.contains("The frame is `0B 01 04 80 89 7A 04 81 02 52 17 00`"));
}

#[test]
fn the_page_tells_the_longest_frames() {
    let page = include_str!("../../../docs/reference/wire-format.md");
    assert!(page.contains(&format!("| longest frame of schema 1 as it is here | {MAX_FRAME} bytes")));
    assert!(page.contains(&format!("| longest frame of any build | {LONGEST_FRAME} bytes")));
}

#[test]
fn frames_of_other_builds_are_told_from_broken_ones() {
    // By the same Python as the golden bytes, each with a good checksum.
    let cases = [
        ("the state, of schema 2", "0B 02 04 80 89 7A 04 81 02 27 DF 00", Err(DecodeError::Schema(2))),
        ("message 99", "06 01 63 05 70 F5 00", Err(DecodeError::Unknown)),
        ("condition 77", "0A 01 04 80 89 7A 4D 01 E9 37 00", Err(DecodeError::Unknown)),
        ("the state without its last field", "09 01 04 80 89 7A 04 53 1D 00", Err(DecodeError::Body)),
        ("an option that is neither 0 nor 1", "05 01 06 84 07 04 02 2E 34 00", Err(DecodeError::Body)),
        ("one bit of the state's time is another", "0B 01 04 81 89 7A 04 81 02 52 17 00", Err(DecodeError::Checksum)),
        ("a distance beyond the end", "0C 01 04 80 89 7A 04 81 02 52 17 00", Err(DecodeError::Cobs)),
        ("no checksum", "02 01 00", Err(DecodeError::Cobs)),
    ];
    for (name, hex, expected) in cases {
        assert_eq!(decode(&bytes(hex)), expected, "{name}");
    }
}

#[test]
fn fields_that_a_newer_build_appends_are_ignored() {
    // The state with the bytes 9, 0, 200 after it, by the same Python.
    let state = Message::State(State { t_us: 2_000_000, is: Condition::Synchronised(257) });
    assert_eq!(decode(&bytes("0A 01 04 80 89 7A 04 81 02 09 04 C8 FB 68 00")), Ok(state));
}

#[test]
fn a_fix_of_a_build_without_solvers_or_of_one_with_more_is_read() {
    // The fix without its last byte, as in builds before there were solvers, and the same with 77 for a solver, by the
    // same Python.
    let frames = [
        "0C 01 01 CE C2 F1 05 AC 02 B4 42 06 11 C8 F5 03 E8 F8 04 B0 EA 01 D8 04 F4 03 B0 09 20 06 C0 3B E6 9A 18 00",
        "0C 01 01 CE C2 F1 05 AC 02 B4 42 06 11 C8 F5 03 E8 F8 04 B0 EA 01 D8 04 F4 03 B0 09 20 07 C0 3B E6 4D 50 90 00",
        "10 01 01 CE C2 F1 05 AC 02 B4 42 06 01 05 93 E6 00",
    ];
    for hex in frames {
        let Ok(Message::Fix(fix)) = decode(&bytes(hex)) else { panic!("{hex} is a fix") };
        assert_eq!((fix.round, fix.solver, fix.doubt), (300, Solver::Unknown, Doubt::None), "{hex}");
    }
}

#[test]
fn a_suspect_fix_takes_a_byte_more_and_a_doubt_of_a_newer_build_is_left_out() {
    // The fix with 1 and 9 for a doubt, by the same Python.
    let start = "0C 01 01 CE C2 F1 05 AC 02 B4 42 06 11 C8 F5 03 E8 F8 04 B0 EA 01 D8 04 F4 03 B0 09 20 08 C0 3B E6 03";
    for (end, doubt) in [("01 5B ED 00", Doubt::Suspect), ("09 53 6C 00", Doubt::None)] {
        let hex = format!("{start} {end}");
        let Ok(Message::Fix(fix)) = decode(&bytes(&hex)) else { panic!("{hex} is a fix") };
        assert_eq!((fix.solver, fix.doubt), (Solver::BWls, doubt));
        let written = encode(&fix.into(), &mut [0; MAX_FRAME]).to_vec();
        assert_eq!(written == bytes(&hex), doubt == Doubt::Suspect, "{hex}");
    }
}

#[test]
fn a_fix_takes_at_most_49_bytes() {
    let longest = |t_us, round, age_us, position_tenth_mm, deviation_tenth_mm, doubt| {
        let (correlation_127ths, used, quality_255ths) = ([127, -127, 1], u16::MAX, 255);
        let outcome =
            Outcome::Position { position_tenth_mm, deviation_tenth_mm, correlation_127ths, used, quality_255ths };
        let fix = Message::Fix(Fix { t_us, round, age_us, asked: 255, outcome, solver: Solver::BoundingBox, doubt });
        encode(&fix, &mut [0; MAX_FRAME]).len()
    };
    // 31 days of uptime, 1 s old, a kilometre from the origin, deviations of 10 m.
    let month_us = 31 * 24 * 3600 * 1_000_000;
    assert_eq!(longest(month_us, u16::MAX, 1_000_000, [-10_000_000; 3], [100_000; 3], Doubt::None), 49);
    // No frame is longer: 1 schema, 1 message, varints of at most 10, 3 and 5 bytes, 1 asked, 1 outcome, 6 varints of
    // 5, 3 correlations, a varint of 3, 1 quality, 1 solver, 1 doubt, 3 varints of 5, 2 checksum, 2 of COBS.
    let worst = longest(u64::MAX, u16::MAX, u32::MAX, [i32::MIN; 3], [u32::MAX; 3], Doubt::Ambiguous([i32::MIN; 3]));
    assert_eq!(worst, 1 + 1 + 10 + 3 + 5 + 1 + 1 + 30 + 3 + 3 + 1 + 1 + 1 + 15 + 2 + 2);
    assert!(worst <= MAX_FRAME);
}

#[test]
fn the_longest_message_takes_a_frame_whole() {
    let diagnostics = Diagnostics {
        rx_power_cdbm: i16::MIN,
        first_path_power_cdbm: i16::MIN,
        first_path_index_64ths: u16::MAX,
        first_path_amplitudes: [u16::MAX; 3],
        cir_power: u16::MAX,
        preamble_count: u16::MAX,
        noise_deviation: u16::MAX,
        clock_offset_cppm: i16::MIN,
    };
    let difference = Message::Difference(Difference {
        t_us: u64::MAX,
        round: u16::MAX,
        reference: u16::MAX,
        peer: u16::MAX,
        difference_tenth_mm: i32::MIN,
        deviation_tenth_mm: u32::MAX,
        position_tenth_mm: Some([i32::MIN; 3]),
        diagnostics,
    });
    let mut frame = [0; MAX_FRAME];
    assert_eq!(encode(&difference, &mut frame).len(), MAX_FRAME);
    assert_eq!(decode(&frame), Ok(difference));
}
