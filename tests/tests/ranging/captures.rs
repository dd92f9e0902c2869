//! Captures, as `tshark` reads them: every frame is complete, addresses and networks are as sent, and blinks are
//! blinks.

use std::path::Path;
use std::process::Command;

use host_tools::simulate::Capture;
use sim::scenario::{Scenario, Simulation};
use system_tests::{STAND, hall};

/// Fields of every frame of a capture, without some of `tshark`'s heuristics for payloads; `None` if there is no
/// `tshark`.
fn dissected(capture: &Path, fields: &[&str], without: &[&str]) -> Option<Vec<Vec<String>>> {
    let mut command = Command::new("tshark");
    for guess in without {
        command.args(["--disable-protocol", guess]);
    }
    command.args([
        "-r".as_ref(),
        capture.as_os_str(),
        "-T".as_ref(),
        "fields".as_ref(),
        "-E".as_ref(),
        "separator=,".as_ref(),
    ]);
    for field in fields {
        command.args(["-e", field]);
    }
    let output = command.output().ok()?;
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    Some(text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect())
}

/// Runs a scenario and dissects its capture.
fn frames_of(text: &str, fields: &[&str], without: &[&str]) -> Option<Vec<Vec<String>>> {
    let scenario = Scenario::parse(text).expect("the test's scenario");
    let seconds = scenario.seconds;
    let mut simulation = Simulation::new(scenario);
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("capture.pcap");
    let capture = Capture::begin(&simulation, &file).expect("a file");
    simulation.run_until(seconds);
    capture.finish().expect("a capture");
    let frames = dissected(&file, fields, without);
    if frames.is_none() {
        eprintln!("skipped: tshark is not installed");
    }
    frames
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

#[test]
fn decaranging_frames_are_those_of_the_boards() {
    // The ZigBee heuristic reads two bytes of every payload, even if there is only one byte, as in a fast poll. The
    // fast response's code is 6LoWPAN's code for broadcasts.
    for (variant, without) in [("decaranging", &[][..]), ("decaranging-fast", &["zbee_nwk", "6lowpan"][..])] {
        let text = format!(
            "[simulation]\nseconds = 3\n[network]\nmode = \"{variant}\"\n\
             [[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n\
             [[node]]\nrole = \"tag\"\nsimulation = {{ path_m = [[5, 0, 1]] }}\n"
        );
        let fields = ["_ws.malformed", "wpan.fcs_ok", "wpan.frame_type", "frame.len", "wpan.dst_pan", "wpan.src64"];
        let Some(frames) = frames_of(&text, &fields, without) else { return };
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
