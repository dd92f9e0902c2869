//! Captures, as `tshark` reads them: every frame is complete, addresses and networks are as sent, and blinks are
//! blinks. With the dissector of `tools/wireshark` the contents are those that were sent, and what is no frame is said
//! to be none.

use std::path::Path;
use std::process::Command;

use host_tools::simulate::Capture;
use sim::scenario::{Scenario, Simulation};
use system_tests::{STAND, hall};
use wire::uwb::{Address, FrameBuffer, Header, decaranging, native};

/// Arguments of `tshark` with the project's dissector.
const WITH_DISSECTOR: [&str; 2] =
    ["-X", concat!("lua_script:", env!("CARGO_MANIFEST_DIR"), "/../tools/wireshark/baliza.lua")];

/// Fields of every frame of a capture, by `tshark` with these arguments; a field that occurs several times has `;`
/// between its values. `None` if there is no `tshark`.
fn dissected(capture: &Path, fields: &[&str], arguments: &[&str]) -> Option<Vec<Vec<String>>> {
    let mut command = Command::new("tshark");
    command.args(arguments).arg("-r").arg(capture);
    command.args(["-T", "fields", "-E", "separator=,", "-E", "aggregator=;"]);
    for field in fields {
        command.args(["-e", field]);
    }
    let Ok(output) = command.output() else {
        eprintln!("skipped: tshark is not installed");
        return None;
    };
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !errors.contains("Lua"), "{errors}");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Some(text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect())
}

/// Runs a scenario and dissects its capture.
fn frames_of(text: &str, fields: &[&str], arguments: &[&str]) -> Option<Vec<Vec<String>>> {
    let scenario = Scenario::parse(text).expect("the test's scenario");
    let seconds = scenario.seconds;
    let mut simulation = Simulation::new(scenario);
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("capture.pcap");
    let capture = Capture::begin(&simulation, &file).expect("a file");
    simulation.run_until(seconds);
    capture.finish().expect("a capture");
    dissected(&file, fields, arguments)
}

const FIELDS: [&str; 7] =
    ["_ws.malformed", "wpan.fcs_ok", "wpan.frame_type", "wpan.dst_pan", "wpan.src16", "wpan.dst16", "wpan.seq_no"];

#[test]
fn native_frames_are_data_frames_of_their_network() {
    let Some(frames) = frames_of(&hall("seconds = 2", 4, &[STAND]), &FIELDS, &[]) else { return };
    assert!(frames.len() > 1000);
    let mut last_of_tag: Option<u8> = None;
    for frame in &frames {
        let [malformed, check, kind, pan, source, destination, sequence] = &frame[..] else { panic!("{frame:?}") };
        assert!(malformed.is_empty() && matches!(check.as_str(), "1" | "True"), "{frame:?}");
        assert_eq!((kind.as_str(), pan.as_str()), ("0x0001", "0xba12"), "{frame:?}");
        match source.as_str() {
            "0x1001" => assert_eq!(destination, "0xffff", "{frame:?}"),
            "0x0001" | "0x0002" | "0x0003" | "0x0004" => {
                assert!(matches!(destination.as_str(), "0x1001" | "0xffff"), "{frame:?}");
            }
            other => panic!("nobody is {other}"),
        }
        if source == "0x1001" {
            let sequence: u8 = sequence.parse().expect("a sequence number");
            assert!(last_of_tag.is_none_or(|last| sequence == last.wrapping_add(1)), "{frame:?}");
            last_of_tag = Some(sequence);
        }
    }
}

/// A DecaRanging tag √26 m from its anchor.
fn pair(variant: &str) -> String {
    format!(
        "[simulation]\nseconds = 3\n[network]\nmode = \"{variant}\"\n\
         [[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n\
         [[node]]\nrole = \"tag\"\nsimulation = {{ path_m = [[5, 0, 1]] }}\n"
    )
}

#[test]
fn decaranging_frames_are_those_of_the_boards() {
    // The ZigBee heuristic reads two bytes of every payload, even if there is only one byte, as in a fast poll. The
    // fast response's code is 6LoWPAN's code for broadcasts.
    let without = ["--disable-protocol", "zbee_nwk", "--disable-protocol", "6lowpan"];
    for (variant, arguments) in [("decaranging", &[][..]), ("decaranging-fast", &without[..])] {
        let fields = ["_ws.malformed", "wpan.fcs_ok", "wpan.frame_type", "frame.len", "wpan.dst_pan", "wpan.src64"];
        let Some(frames) = frames_of(&pair(variant), &fields, arguments) else { return };
        assert!(frames.len() > 50, "{}", frames.len());
        for frame in &frames {
            assert!(frame[0].is_empty() && matches!(frame[1].as_str(), "1" | "True"), "{frame:?}");
        }
        // A blink is a frame of type 5, which the standard calls multipurpose: twelve bytes, the tag's long address, no
        // network.
        let (blinks, others): (Vec<_>, Vec<_>) = frames.iter().partition(|frame| frame[2] == "0x0005");
        assert!(!blinks.is_empty());
        for blink in blinks {
            assert_eq!(
                (blink[3].as_str(), blink[4].as_str(), blink[5].as_str()),
                ("12", "", "de:ca:00:00:00:00:10:01")
            );
        }
        assert!(others.iter().all(|frame| frame[2] == "0x0001" && frame[4] == "0xdeca"), "{variant}");
    }
}

#[test]
fn the_dissector_knows_every_frame_of_a_network() {
    let fields = ["baliza.code", "baliza.wrong", "baliza.anchor", "baliza.x", "wpan.src16"];
    let Some(frames) = frames_of(&hall("seconds = 2", 4, &[STAND]), &fields, &WITH_DISSECTOR) else { return };
    let of_code = |code: &'static str| frames.iter().filter(move |frame| frame[0] == code);
    // Poll, response, sync frame, request.
    for (code, least) in [("0x30", 300), ("0x31", 1200), ("0x32", 60), ("0x33", 1)] {
        assert!(of_code(code).count() >= least, "{code}: {}", of_code(code).count());
    }
    assert!(frames.iter().all(|frame| !frame[0].is_empty() && frame[1].is_empty()));
    for poll in of_code("0x30") {
        assert!(
            poll[2].split(';').all(|anchor| ["0x0001", "0x0002", "0x0003", "0x0004"].contains(&anchor)),
            "{poll:?}"
        );
    }
    // The scenario's anchors, in metres.
    let scenario = Scenario::parse(&hall("seconds = 2", 4, &[STAND])).expect("the test's scenario");
    for sync_frame in of_code("0x32") {
        let x: f64 = sync_frame[3].parse().expect("a coordinate");
        let address = u16::from_str_radix(sync_frame[4].trim_start_matches("0x"), 16).expect("an address");
        let anchor = scenario.anchors.iter().find(|anchor| anchor.address == address).expect("an anchor");
        assert!((x - anchor.at[0]).abs() < 0.001, "{sync_frame:?}");
    }
}

#[test]
fn the_dissector_shows_the_distance_of_both_variants_of_decaranging() {
    for variant in ["decaranging", "decaranging-fast"] {
        let fields = ["wpan.frame_type", "baliza.code", "baliza.wrong", "baliza.tof.distance"];
        let Some(frames) = frames_of(&pair(variant), &fields, &WITH_DISSECTOR) else { return };
        assert!(frames.iter().all(|frame| frame[0] == "0x0005" || !frame[1].is_empty() && frame[2].is_empty()));
        let mut distances: Vec<f64> = frames.iter().filter_map(|frame| frame[3].parse().ok()).collect();
        distances.sort_by(f64::total_cmp);
        // √26 m are 5.099 m.
        let median = distances[distances.len() / 2];
        assert!(distances.len() > 20 && (median - 5.099).abs() < 0.1, "{variant}: {median}");
    }
}

/// A file of frames without check bytes (link type 230).
fn capture_of(frames: &[Vec<u8>], file: &Path) {
    let mut bytes = [0xa1b2_c3d4_u32, 0x0002_0004, 0, 0, 127, 230].map(u32::to_be_bytes).concat();
    for frame in frames {
        let length = frame.len() as u32;
        bytes.extend([0, 0, length, length].map(u32::to_be_bytes).concat());
        bytes.extend(frame);
    }
    std::fs::write(file, bytes).expect("a file");
}

/// What `tshark` says of these frames.
fn fields_of(frames: &[Vec<u8>], fields: &[&str]) -> Option<Vec<Vec<String>>> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("frames.pcap");
    capture_of(frames, &file);
    let lines = dissected(&file, fields, &WITH_DISSECTOR)?;
    assert_eq!(lines.len(), frames.len());
    Some(lines)
}

fn from_hex(text: &str) -> Vec<u8> {
    let digits: Vec<u8> = text.bytes().filter(|byte| *byte != b' ').collect();
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).expect("digits"), 16).expect("hexadecimal");
    digits.chunks(2).map(byte).collect()
}

/// The frames of the wire format's page, whose text says what they contain, and a sync frame by hand.
const GOLDEN: [&str; 15] = [
    "30341220 A8010003 02",
    "30010031 00010002 00030020 030080E7 FF",
    "31FE0104 030201FF 67452301",
    "31FE0104 030201FF 67452301 FDCDAB89 00",
    "34 02 01",
    "32 0201 05 01 02 0701 63 00020304050607080900000000000000 0210 89 0300 09 B131 E80300 18FCFF FFFFFF 82 0C 00 \
     0210 7F 0310 02",
    "30010012 000100E8 0300FFFF FFC42000 69A00040 000083",
    "32 0201 03 04 05 0706 E8 101112131415161718191A1B1C1D1E1F 214300 0C0B 09 B590 E80300 FFFFFF C42000 00 11 41 \
     0908 05 12 6300 0908 45 12 63A0 0908 85 12 6300 0908 C5 12 6300 0B0A A8",
    "3C020108 EEF885D1 6B0008",
    "3D040302 01080706 05B0E06C C074A158 7E",
    "3A 0201 03 04 05 0706 E8 101112131415161718191A1B1C1D1E1F 214300 0C0B 09 B590 E80300 FFFFFF C42000 00 11 09      04030201 1009 08070605 0B0A A8 FAE2EC06 47840B80",
    "32 0201 03 04 05 0706 E8 101112131415161718191A1B1C1D1E1F 214300 0C0B 09 B590 E80300 FFFFFF C42000 00 91 00 \
     3412 18FCFF 020100 B80B00",
    "32 0201 03 04 05 0706 E8 101112131415161718191A1B1C1D1E1F 214301 0C0B 09 B590 E80300 FFFFFF C42000 20 51 00 \
     19 0C 0281 1004",
    "32 0201 03 04 05 0706 E8 101112131415161718191A1B1C1D1E1F 214300 0C0B 09 B590 E80300 FFFFFF C42000 20 11 00 \
     00 08 0100 0201000000000000",
    "36 0908 3412 80F0 05 E80300 FFFFFF C42000 69A00040 000083 0908 3412 02F1 85 FE06646F 6F722033",
];

fn golden() -> Vec<Vec<u8>> {
    GOLDEN.iter().map(|payload| from_hex(&format!("41882A1A BAFFFF07 01 {payload}"))).collect()
}

#[test]
fn the_dissector_reads_what_the_page_of_the_wire_format_says() {
    let fields = [
        "baliza.round",
        "baliza.anchor",
        "baliza.distance",
        "baliza.wish.listen_again",
        "baliza.wish.final",
        "baliza.poll_rx",
        "baliza.final.round",
    ];
    let Some(frames) = fields_of(&golden(), &fields) else { return };
    let expected = [
        ["4660", "0x0001;0x0203", "", "96", "1", "", ""],
        ["1", "0x0001;0x0002;0x0003", "3.2;-0.1", "16", "0", "", ""],
        ["", "", "", "", "", "1095233569540", ""],
        ["", "", "", "", "", "1095233569540", "253"],
        ["258", "", "", "", "", "", ""],
    ];
    for (frame, expected) in frames.iter().zip(expected) {
        let frame: Vec<_> = frame.iter().map(|value| value.replace("True", "1").replace("False", "0")).collect();
        assert_eq!(frame, expected);
    }
    // 0x01234567 and 0x89ABCD ticks of 1/63.8976 GHz are 298.9 and 141.2 µs.
    let fields = ["baliza.reply", "baliza.after_response", "baliza.round.low", "baliza.confirmation"];
    let response = &fields_of(&golden()[3..4], &fields).expect("tshark")[0];
    assert_eq!(response[2..], ["254", "1"]);
    let [reply, after] = [&response[0], &response[1]].map(|text| text.parse::<f64>().expect("microseconds"));
    assert!((reply - 19_088_743.0 / 63_897.6).abs() < 1e-3 && (after - 9_022_413.0 / 63_897.6).abs() < 1e-3);
    let fields = [
        "baliza.superframe",
        "baliza.term",
        "baliza.age",
        "baliza.hops",
        "baliza.coordinator",
        "baliza.slot",
        "baliza.countdown",
        "baliza.requested_by",
        "baliza.layout.answer",
        "baliza.layout.listen_again",
        "baliza.layout.new",
        "baliza.x",
        "baliza.y",
        "baliza.z",
        "baliza.member",
        "baliza.share",
    ];
    let sync_frame = &fields_of(&golden()[5..6], &fields).expect("tshark")[0];
    // 0xB1 is the code 49, (16 + 1) · 2³ µs, of a new layout; 0x31 the same for listening again. 0x0003E8 is 1 m,
    // 0xFFFC18 −1 m, 0xFFFFFF −1 mm.
    let expected =
        "258 5 1 2 0x0107 3 3 0x1002 136 136 1 1 -1 -0.001 0x1002;0x1003 one in 10 superframes;greedy;2 a superframe";
    assert_eq!(sync_frame.join(" ").replace("True", "1"), expected);
    let fields = ["session", "epoch", "challenge", "polled_by", "integrity"].map(|field| format!("baliza.{field}"));
    let keyed = fields_of(&golden()[8..], &fields.each_ref().map(String::as_str)).expect("tshark");
    assert_eq!(keyed[0], ["", "", "", "", "08 ee f8 85 d1 6b 00 08"]);
    assert_eq!(keyed[1][..3], ["0x01020304", "", "0x05060708"]);
    assert_eq!(keyed[2][..4], ["0x01020304", "2320", "0x05060708", "0x0a0b"]);
    let fields =
        ["leased", "lease", "lease.grant", "lease.slot", "lease.period", "lease.phase", "lease.part", "polled_by"];
    let fields = fields.map(|field| format!("baliza.{field}"));
    let leases = &fields_of(&golden()[7..], &fields.each_ref().map(String::as_str)).expect("tshark")[0];
    // 2² · 5² superframes.
    assert_eq!(
        leases.join(" "),
        "17 0x0809;0x0809;0x0809;0x0809 0;1;2;3 5;5;5;5 100;100;100;100 99;99;99;99 0;5;0;0 0x0a0b"
    );
    let fields = ["leased", "neighbour", "x", "y", "z"].map(|field| format!("baliza.{field}"));
    let introducing = &fields_of(&golden()[11..], &fields.each_ref().map(String::as_str)).expect("tshark")[0];
    assert_eq!(introducing.join(" "), "17 0x1234 1;-1 -0.001;0.258 8.388;3");
    let fields = ["leased", "has_relay_slots", "wish.relay_slots", "gateway.taken", "gateway.taken_frames"];
    let fields = fields.map(|field| format!("baliza.{field}"));
    let relaying = &fields_of(&golden()[12..], &fields.each_ref().map(String::as_str)).expect("tshark")[0];
    assert_eq!(relaying.join(" ").replace("True", "1"), "17 1 1 0x8102 0x0410");
    let heard = &fields_of(&golden()[13..], &["baliza.gateway.heard"]).expect("tshark")[0];
    assert_eq!(heard.join(" "), "0x0000000000000102");
    let fields = ["relayed", "round", "relayed.asked", "x", "data"].map(|field| format!("baliza.{field}"));
    let relayed = &fields_of(&golden()[14..], &fields.each_ref().map(String::as_str)).expect("tshark")[0];
    assert_eq!(relayed.join(" "), "0x0809;0x0809 4660;4660 5;5 1 64 6f 6f 72 20 33");
    let fields = ["x", "y", "z", "sigma_x", "sigma_y", "sigma_z", "rho_xy", "rho_yz", "suspect", "rounds_ago"];
    let fields = fields.map(|field| format!("baliza.{field}"));
    let told = &fields_of(&golden()[6..], &fields.each_ref().map(String::as_str)).expect("tshark")[0];
    let [numbers @ .., suspect, ago] = &told[..] else { panic!("{told:?}") };
    let numbers: Vec<f64> = numbers.iter().map(|number| number.parse().expect("a number")).collect();
    // 64/127 = 0.503937.
    let expected = [1.0, -0.001, 8.388, 0.1, 1.024, 0.0, 64.0 / 127.0, 0.0];
    assert!(numbers.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{numbers:?}");
    assert_eq!((suspect.replace("True", "1").as_str(), ago.as_str()), ("1", "3"));
}

#[test]
fn the_dissector_and_the_nodes_agree_on_what_is_no_frame() {
    let decaranging = [
        decaranging::Message::RangingInit { tag: 0x1001, anchor_delay: 150, tag_delay: Some(0x8001) },
        decaranging::Message::Poll(decaranging::Variant::Standard, Some([7, 9])),
        decaranging::Message::Response(decaranging::Variant::Standard, decaranging::Answer::default()),
    ];
    let [destination, source] = [0x1001, 1].map(Address::Short);
    let header = Header { sequence: 1, pan: decaranging::PAN, destination, source };
    let mut whole = golden();
    for message in decaranging {
        let mut out = FrameBuffer::new();
        decaranging::Frame { header, message }.emit(&mut out);
        whole.push(out.bytes().to_vec());
    }
    let mut frames = whole.clone();
    for frame in &whole {
        frames.extend((10..frame.len()).map(|length| frame[..length].to_vec()));
        frames.extend([1, 3].map(|more| [&frame[..], &vec![0; more]].concat()));
        // Every byte of the payload after the code, with each of these values.
        for place in 10..frame.len() {
            for value in [0, 1, 2, 0x41, 0x7F, 0x80, 0x81, 0xFF] {
                let mut changed = frame.clone();
                changed[place] = value;
                frames.push(changed);
            }
        }
    }
    let Some(lines) = fields_of(&frames, &["baliza.code", "baliza.wrong"]) else { return };
    let mut refused = 0;
    for (frame, line) in frames.iter().zip(lines) {
        let is_frame = native::Frame::parse(frame).is_ok() && frame[3..5] != [0xCA, 0xDE]
            || decaranging::Frame::parse(frame).is_ok();
        assert!(!line[0].is_empty(), "{frame:02X?}");
        assert_eq!(line[1].is_empty(), is_frame, "{frame:02X?}: {line:?}");
        refused += usize::from(!is_frame);
    }
    assert!(refused > 150 && frames.len() - refused > 150, "{refused} of {}", frames.len());
}

#[test]
fn the_dissector_shows_what_anchors_pass_on() {
    let text = include_str!("../../../examples/halls.toml").replace("seconds = 60", "seconds = 12");
    let fields = ["code", "wrong", "gateway.cost", "relayed", "x", "neighbour"].map(|field| format!("baliza.{field}"));
    let fields: Vec<&str> = fields.iter().map(String::as_str).chain(["wpan.src16"]).collect();
    let Some(frames) = frames_of(&text, &fields, &WITH_DISSECTOR) else { return };
    assert!(frames.iter().all(|frame| !frame[0].is_empty() && frame[1].is_empty()));
    // One anchor has a cable; the farthest hall is two hops from it or more.
    let costs: Vec<(&str, u8)> =
        frames.iter().filter_map(|frame| Some((frame[6].as_str(), frame[2].parse().ok()?))).collect();
    assert!(costs.iter().all(|(source, cost)| (*cost == 0) == (*source == "0x0002")));
    assert!(costs.iter().any(|(_, cost)| *cost >= 16));
    let relaying: Vec<_> = frames.iter().filter(|frame| !frame[3].is_empty()).collect();
    assert!(relaying.len() > 100, "{}", relaying.len());
    for frame in relaying {
        let (tags, places) = (frame[3].split(';').count(), frame[4].split(';').count());
        // The anchor's own place in a sync frame, that of each tag and that of another anchor.
        let own = usize::from(frame[0] == "0x32");
        assert_eq!(places, own + tags + usize::from(!frame[5].is_empty()), "{frame:?}");
    }
}
