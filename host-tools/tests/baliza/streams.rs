//! `baliza decode`, `record` and `replay`: a simulated tag's telemetry, complete, damaged, of other builds, and bytes
//! without telemetry.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::process::{Output, Stdio};
use std::time::{Duration, Instant};

use positioning_core::Method;
use rand::{Rng, RngCore, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use sim::scenario::{Scenario, Simulation, What};
use wire::telemetry::{
    Address, BeaconId, Board, Condition, Counters, Diagnostics, Difference, Fix, Hello, MAX_FRAME, Message, Range,
    Reset, ResetCause, Role, Room, RoomEstimate, RoomProbability, Sighting, State, encode,
};

use crate::support::Folder;

/// The telemetry of a tag that walks for two seconds among six anchors, with ten positions a second and one beacon in
/// range.
pub fn walk() -> Vec<Message> {
    let mut scenario = Scenario::rooms(6, 1);
    (scenario.seconds, scenario.tag.rate_hz) = (2.0, Some(10.0));
    // This method does not use weights, which the files do not have.
    scenario.tag.method = Some(Method::Nls);
    let mut simulation = Simulation::new(scenario);
    let hello = |t_us| Hello {
        t_us,
        eui: 0x1020_5F12_3456_7890,
        address: 4097,
        role: Role::Tag,
        board: Board::Simulated,
        build: [1, 2, 3, 4, 5, 6, 7, 0xAB],
    };
    let mut told = vec![
        Message::Hello(hello(1000)),
        Message::Reset(Reset { t_us: 1100, cause: ResetCause::PowerOn, crash: None }),
        Message::State(State { t_us: 1200, is: Condition::Searching }),
    ];
    for record in simulation.run_until(2.0) {
        let What::Epoch(epoch) = &record.what else { continue };
        let (t_us, round) = (epoch.fix.t_us, epoch.number as u16);
        told.extend(record.messages().map(|message| match message {
            Message::Range(range) => Message::Range(Range { round, ..range }),
            Message::Fix(fix) => Message::Fix(Fix { round, age_us: 8500, ..fix }),
            other => other,
        }));
        let beacon = BeaconId { network: 0xB940_7F30, major: 7, minor: 513 };
        told.push(Message::Sighting(Sighting { t_us: t_us + 20_000, beacon, rssi_dbm: -67, measured_power_dbm: -59 }));
    }
    let counters = Counters { t_us: 2_000_000, sent: 20, telemetry_dropped: 2, ..Counters::default() };
    told.push(Message::Counters(counters));
    told.push(Message::Hello(hello(2_000_100)));
    told
}

pub fn frame(message: &Message) -> Vec<u8> {
    encode(message, &mut [0; MAX_FRAME]).to_vec()
}

pub fn stream(messages: &[Message]) -> Vec<u8> {
    messages.iter().flat_map(frame).collect()
}

/// A folder with the walk's stream as `walk.bin`.
fn folder() -> Folder {
    let folder = Folder::with(&[]);
    folder.write("walk.bin", &stream(&walk()));
    folder
}

fn count(messages: &[Message], kind: &str) -> u64 {
    messages.iter().filter(|message| message.kind() == kind).count() as u64
}

/// Runs with `bytes` on standard input.
fn run_with(folder: &Folder, arguments: &str, bytes: &[u8]) -> Output {
    let mut command = folder.command(arguments);
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let mut stdin = child.stdin.take().expect("piped");
    let bytes = bytes.to_vec();
    let writer = std::thread::spawn(move || stdin.write_all(&bytes));
    let output = child.wait_with_output().expect("it ends");
    writer.join().expect("no panic").expect("all is read");
    output
}

/// The golden test of the crate `telemetry` has the objects themselves as literals.
#[test]
fn every_message_is_a_line_of_json() {
    let messages = walk();
    let run = folder().run("decode --file walk.bin").ok();
    let lines: Vec<String> = messages.iter().map(|message| message.json().to_string()).collect();
    assert_eq!(run.stdout.lines().collect::<Vec<_>>(), lines);
    let first = serde_json::json!({
        "type": "hello", "t_s": 0.001, "eui": "10205f1234567890", "address": "0x1001", "role": "tag", "board": "simulated",
        "build": "01020304050607ab",
    });
    assert_eq!(serde_json::from_str::<Value>(&lines[0]).expect("JSON"), first);
    let fixes = count(&messages, "fix");
    assert!(fixes >= 15, "{fixes}");
    let told = format!("{} frames in {} bytes: 2 hello, {fixes} fix", messages.len(), stream(&messages).len());
    assert!(run.stderr.starts_with(&told), "{}", run.stderr);
}

/// The telemetry of a tag about a round that it overheard: the poll of anchor 257, and that 258 is 1.2345 m nearer.
fn overheard() -> Vec<Message> {
    let diagnostics = Diagnostics {
        rx_power_cdbm: -7925,
        first_path_power_cdbm: -8150,
        first_path_index_64ths: 47_712,
        first_path_amplitudes: [9000, 10_500, 8000],
        cir_power: 12_000,
        preamble_count: 118,
        noise_deviation: 52,
        clock_offset_cppm: -235,
    };
    let told = |peer, difference_tenth_mm, deviation_tenth_mm, position| {
        let (t_us, round, reference, position_tenth_mm) = (12_345_600, 300, 257, Some(position));
        Message::Difference(Difference {
            t_us,
            round,
            reference,
            peer,
            difference_tenth_mm,
            deviation_tenth_mm,
            position_tenth_mm,
            diagnostics,
        })
    };
    vec![told(257, 0, 300, [10_000, 20_000, 24_000]), told(258, -12_345, 420, [0, -125_000, 24_000])]
}

#[test]
fn what_a_listening_tag_measured_is_shown_tabled_and_recorded() {
    let folder = Folder::with(&[]);
    folder.write("tdoa.bin", &stream(&overheard()));
    let run = folder.run("decode --file tdoa.bin").ok();
    let lines: Vec<Value> = run.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(
        (&lines[1]["type"], &lines[1]["reference"], &lines[1]["peer"]),
        (&"difference".into(), &"0x0101".into(), &"0x0102".into())
    );
    assert_eq!((&lines[1]["difference_m"], &lines[1]["peer_y_m"]), (&(-1.2345).into(), &(-12.5).into()));
    assert!(run.stderr.contains("2 difference"), "{}", run.stderr);
    let run = folder.run("decode --file tdoa.bin --format csv --table differences").ok();
    assert_eq!(
        (run.column("anchor"), run.column("difference_m")),
        (vec!["0x0101", "0x0102"], vec!["0.0000", "-1.2345"])
    );
    assert_eq!((run.column("reference"), run.column("rx_power_dbm")), (vec!["0x0101"; 2], vec!["-79.25"; 2]));
    folder.run("record --file tdoa.bin --out walk").ok();
    let text = |name: &str| String::from_utf8(folder.read(name)).expect("text");
    assert!(text("walk/anchors.csv").contains("0x0102,0.0000,-12.5000,2.4000"));
    assert_eq!(text("walk/differences.csv").lines().count(), 3);
}

#[test]
fn rooms_are_shown_tabled_and_recorded() {
    let [hall, attic] =
        [RoomProbability { room: 0, probability_255ths: 255 }, RoomProbability { room: 1, probability_255ths: 102 }];
    let at = |t_us, is| Message::Room(Room { t_us, is });
    let told = [
        at(500_000, RoomEstimate::Unknown),
        at(1_000_000, RoomEstimate::Room(hall)),
        at(2_000_000, RoomEstimate::Between([hall, attic])),
    ];
    let folder = Folder::with(&[]);
    folder.write("rooms.bin", &stream(&told));
    let run = folder.run("decode --file rooms.bin").ok();
    let lines: Vec<Value> = run.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(
        lines[1],
        serde_json::json!({"type": "room", "t_s": 1.0, "is": "room", "rooms": [0], "probabilities": [1.0]})
    );
    assert_eq!((&lines[0]["rooms"], &lines[2]["rooms"]), (&serde_json::json!([]), &serde_json::json!([0, 1])));
    assert!(run.stderr.contains("3 room"), "{}", run.stderr);
    let run = folder.run("decode --file rooms.bin --format csv --table rooms").ok();
    assert_eq!((run.column("is"), run.column("room")), (vec!["unknown", "room", "between"], vec!["", "0", "0"]));
    assert_eq!((run.column("other_room"), run.column("other_probability")), (vec!["", "", "1"], vec!["", "", "0.400"]));
    let run = folder.run("monitor --file rooms.bin").ok();
    assert!(run.stdout.contains("0 (100 %) or 1 (40 %)"), "{}", run.stdout);
    let run = folder.run("record --file rooms.bin --out walk").ok();
    assert!(run.stderr.contains("recorded: 3 times in which room"), "{}", run.stderr);
    assert_eq!(String::from_utf8(folder.read("walk/rooms.csv")).expect("text").lines().count(), 4);
}

#[test]
fn json_is_one_document_of_what_came_and_what_was_lost() {
    let messages = walk();
    let run = folder().run("decode --file walk.bin --json").ok();
    assert_eq!(run.stderr, "");
    let json = run.object();
    assert_eq!(
        (&json["frames"]["total"], &json["frames"]["fix"]),
        (&messages.len().into(), &count(&messages, "fix").into())
    );
    assert_eq!(
        (&json["malformed"]["total"], &json["lost_bytes"], &json["torn_at_start"]),
        (&0.into(), &0.into(), &0.into())
    );
    assert_eq!(
        (&json["restarts"], &json["rounds_missed"], &json["telemetry_dropped"]),
        (&0.into(), &0.into(), &2.into())
    );
    assert_eq!((&json["node"]["role"], &json["node"]["board"]), (&"tag".into(), &"simulated".into()));
    assert_eq!((&json["first_t_s"], &json["last_t_s"]), (&0.001.into(), &2.0001.into()));
}

#[test]
fn of_a_stream_with_one_byte_in_a_hundred_flipped_every_frame_that_is_whole_is_decoded() {
    let messages = walk();
    let whole = stream(&messages);
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut damaged = whole.clone();
    for byte in &mut damaged {
        if random.random_bool(0.01) {
            *byte ^= random.random_range(1..=255);
        }
    }
    let mut begin = 0;
    let untouched: Vec<&Message> = messages
        .iter()
        .filter(|message| {
            let place = begin..begin + frame(message).len();
            begin = place.end;
            damaged[place.clone()] == whole[place]
        })
        .collect();
    assert!(untouched.len() > messages.len() / 2 && untouched.len() < messages.len() - 20, "{}", untouched.len());
    let folder = folder();
    folder.write("damaged.bin", &damaged);
    let run = folder.run("decode --file damaged.bin").ok();
    let times: Vec<Value> =
        run.stdout.lines().map(|line| serde_json::from_str::<Value>(line).expect("JSON")["t_s"].clone()).collect();
    assert_eq!(times, untouched.iter().map(|message| Value::from(message.t_us() as f64 / 1e6)).collect::<Vec<_>>());
    // A changed bit ends a frame early or joins it with the next frame, so that a damaged frame may count twice or not
    // at all.
    let json = folder.run("decode --file damaged.bin --json").ok().object();
    let lost = messages.len() - untouched.len();
    let malformed = json["malformed"]["total"].as_u64().expect("a count") as usize;
    assert!((lost / 2..=2 * lost).contains(&malformed), "{malformed} of {lost}");
    assert!(json["lost_bytes"].as_u64() > Some(lost as u64 * 8));
}

#[test]
fn random_bytes_are_counted_around_a_frame_and_refused_without_one() {
    let mut noise = vec![0; 1 << 20];
    Pcg64Mcg::seed_from_u64(2).fill_bytes(&mut noise);
    let folder = Folder::with(&[]);
    folder.write("noise.bin", &noise);
    let said = "noise.bin: this is no telemetry: there is no frame in 1048576 bytes\n";
    for command in [
        "decode noise.bin",
        "decode noise.bin --format csv --out a.csv",
        "replay noise.bin",
        "record --file noise.bin --out walk",
    ] {
        let run = folder.run(command);
        assert_eq!((run.code, run.stdout.as_str(), run.stderr.as_str()), (Some(2), "", said), "{command}");
    }
    assert_eq!(folder.names(), ["noise.bin", "walk"]);
    assert_eq!(std::fs::read_dir(folder.path("walk")).expect("a folder").count(), 0);
    folder.write("noise.bin", &[&noise[..], &[0], &frame(&walk()[0])].concat());
    let json = folder.run("decode --file noise.bin --json").ok().object();
    assert_eq!(json["frames"]["total"], 1);
    // One zero in 256 bytes ends a chunk: about four thousand chunks, of which few are too long.
    assert!((3000..5000).contains(&json["malformed"]["total"].as_u64().expect("a count")), "{json}");
    for key in ["total", "too_long", "cobs", "checksum"] {
        assert!(json["malformed"][key].as_u64() > Some(0), "{key} in {json}");
    }
    folder.write("empty.bin", b"");
    assert_eq!(folder.run("decode --file empty.bin").ok().stderr, "0 frames in 0 bytes\n");
}

#[test]
fn a_stream_of_another_build_is_told_from_a_broken_one() {
    let folder = Folder::with(&[]);
    // The golden frames of the state message in docs/wire-format.md, with schema 2 and with message 99.
    let other = b"\x0B\x02\x04\x80\x89\x7A\x04\x81\x02\x27\xDF\0".repeat(3);
    folder.write("other.bin", &[&other[..], b"\x06\x01\x63\x05\x70\xF5\0"].concat());
    let run = folder.run("decode --file other.bin").ok();
    assert_eq!(run.stdout, "");
    assert!(run.stderr.contains("\n3 frames of another schema: the node's build is another than this program's\n"));
    assert!(
        run.stderr.contains("\n1 frames with a message that this program does not know: the node's build is newer\n")
    );
    let json = folder.run("decode --file other.bin --json").ok().object();
    assert_eq!((&json["newer"]["schema"], &json["newer"]["unknown"]), (&3.into(), &1.into()));
    assert_eq!((&json["malformed"]["total"], &json["lost_bytes"]), (&0.into(), &0.into()));
}

#[test]
fn defmt_frames_and_text_of_a_serial_line_are_foreign() {
    let messages = walk();
    let mixed: Vec<u8> = messages
        .iter()
        .flat_map(|message| [&b"\xFF\0\x07\x81\xC3\x01\xFE\0"[..], &frame(message)].concat())
        .chain(*b"ESP-ROM:esp32c3-api1-20210207\r\n")
        .chain(frame(&messages[0]))
        .collect();
    let output = run_with(&Folder::with(&[]), "decode --json", &mixed);
    let json: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let json = &json["results"][0];
    assert_eq!(json["frames"]["total"], messages.len() + 1);
    assert_eq!((&json["malformed"]["total"], &json["torn_at_start"]), (&0.into(), &0.into()));
    assert_eq!(
        (&json["foreign"], &json["foreign_bytes"]),
        (&(messages.len() + 1).into(), &(messages.len() * 5 + 31).into())
    );
}

#[test]
fn csv_has_the_columns_that_solve_and_plot_know() {
    let messages = walk();
    let folder = folder();
    let positions = folder.run("decode --file walk.bin --format csv").ok();
    let header = "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,used,reason";
    assert_eq!(positions.stdout.lines().next(), Some(header));
    let (x, reasons) = (positions.numbers("x_m"), positions.column("reason"));
    assert_eq!(x.len() as u64, count(&messages, "fix"));
    assert!(x.iter().zip(&reasons).all(|(x, reason)| x.is_nan() != reason.is_empty()), "a position or a reason");
    assert!(x.iter().any(|x| x.is_nan()) && x.iter().any(|x| x.is_finite()), "the first rounds hear too few anchors");
    let ranges = folder.run("decode --file walk.bin --format csv --table ranges").ok();
    let start =
        "epoch,t_s,anchor,range_m,rx_power_dbm,fp_power_dbm,fp_idx,fp_amp1,fp_amp2,fp_amp3,cir_pwr,rxpacc,std_noise";
    assert!(ranges.stdout.starts_with(start), "{}", ranges.stdout);
    assert_eq!(ranges.column("anchor").len() as u64, count(&messages, "range"));
    let rssi = folder.run("decode --file walk.bin --format csv --table rssi").ok();
    assert!(rssi.stdout.starts_with("epoch,t_s,beacon,rssi_dbm,measured_power_dbm\n"));
    assert!(rssi.column("beacon").iter().all(|beacon| *beacon == "b9407f30-7-513"));
    folder.write("positions.csv", positions.stdout.as_bytes());
    folder.run("plot --positions positions.csv --out walk.svg").ok();
}

#[test]
fn messages_appear_as_they_come() {
    let folder = Folder::with(&[]);
    let mut command = folder.command("decode");
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
    let (mut stdin, stdout) = (child.stdin.take().expect("piped"), child.stdout.take().expect("piped"));
    let mut lines = BufReader::new(stdout).lines();
    for message in &walk()[..3] {
        stdin.write_all(&frame(message)).expect("it reads");
        // The line appears although the stream has not ended.
        let line: Value = serde_json::from_str(&lines.next().expect("a line").expect("read")).expect("JSON");
        assert_eq!(line["type"], message.kind());
    }
    drop(stdin);
    assert!(child.wait().expect("it ends").success());
}

#[test]
fn out_is_a_whole_file_or_what_it_was_before() {
    let folder = folder();
    folder.write("out.jsonl", b"before");
    let mut command = folder.command("decode --stdin --out out.jsonl");
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
    let mut stdin = child.stdin.take().expect("piped");
    stdin.write_all(&folder.read("walk.bin")).expect("it reads");
    std::thread::sleep(Duration::from_millis(300));
    child.kill().expect("it runs");
    child.wait().expect("it ends");
    assert_eq!(folder.read("out.jsonl"), b"before");
    let run = folder.run("decode --file walk.bin --out out.jsonl").ok();
    assert_eq!(run.stdout, "");
    assert_eq!(folder.read("out.jsonl"), folder.run("decode --file walk.bin").ok().stdout.into_bytes());
}

/// The stream has not ended, but the user stops the recording.
#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_recording_with_its_files() {
    let folder = folder();
    let mut command = folder.command("record --stdin --out walk");
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
    let mut stdin = child.stdin.take().expect("piped");
    stdin.write_all(&folder.read("walk.bin")).expect("it reads");
    std::thread::sleep(Duration::from_millis(500));
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().expect("kill runs").success());
    assert!(child.wait().expect("it ends").success());
    assert_eq!(folder.read("walk/telemetry.bin"), folder.read("walk.bin"));
    let told = folder.run("decode --file walk.bin --format csv").ok();
    assert_eq!(folder.read("walk/positions.csv"), told.stdout.as_bytes());
}

/// A file that can be opened, but not read.
#[cfg(target_os = "linux")]
#[test]
fn a_failure_to_read_leaves_no_file() {
    let folder = Folder::with(&[]);
    folder.write("out.jsonl", b"before");
    for command in ["decode --file /proc/self/mem --out out.jsonl", "record --file /proc/self/mem --out walk"] {
        let run = folder.run(command);
        let said = "baliza: cannot read /proc/self/mem: ";
        assert!(run.code == Some(1) && run.stdout.is_empty() && run.stderr.starts_with(said), "{run:?}");
    }
    assert_eq!(folder.names(), ["out.jsonl", "walk"]);
    assert_eq!(folder.read("out.jsonl"), b"before");
    assert_eq!(std::fs::read_dir(folder.path("walk")).expect("a folder").count(), 0);
}

#[test]
fn what_is_recorded_is_solved_to_what_the_tag_found() {
    let folder = folder();
    let run = folder.run("record --file walk.bin --out walk").ok();
    assert!(run.stderr.contains(" to 6 anchors, ") && run.stdout.is_empty(), "{run:?}");
    assert_eq!(folder.read("walk/telemetry.bin"), folder.read("walk.bin"));
    let told = folder.run("decode --file walk --format csv").ok();
    assert_eq!(folder.read("walk/positions.csv"), told.stdout.as_bytes());
    let rssi = folder.run("decode --file walk --format csv --table rssi").ok();
    assert_eq!(folder.read("walk/rssi.csv"), rssi.stdout.as_bytes());
    let files = "--anchors walk/anchors.csv --ranges walk/ranges.csv";
    let solved = folder.run(&format!("solve {files} --dims 2 --height-m 1.2 --method nls")).ok();
    // The tag solves the same ranges with the same code. The wire format and the files have four decimals.
    let by_epoch = |run: &crate::support::Run| -> BTreeMap<String, [f64; 2]> {
        let epochs = run.column("epoch").into_iter().map(str::to_owned);
        epochs.zip(run.numbers("x_m").into_iter().zip(run.numbers("y_m")).map(|(x, y)| [x, y])).collect()
    };
    let (tag, host) = (by_epoch(&told), by_epoch(&solved));
    let near = |epoch: &str| {
        let (tag, host) = (tag[epoch], host[epoch]);
        tag.iter().zip(host).all(|(tag, host)| (tag - host).abs() < 0.005)
    };
    let found: Vec<_> = tag.iter().filter(|(_, place)| place[0].is_finite()).map(|(epoch, _)| epoch).collect();
    assert!(found.len() >= 15 && found.iter().all(|epoch| near(epoch)), "{tag:?}\n{host:?}");
}

#[test]
fn ranges_to_anchors_of_unknown_place_are_left_out_unless_the_user_knows_it() {
    let mut messages = walk();
    let peers: Vec<u16> =
        messages.iter().filter_map(|m| if let Message::Range(r) = m { Some(r.peer) } else { None }).collect();
    let silent = peers[0];
    let late = *peers.iter().find(|peer| **peer != silent).expect("several anchors");
    // One anchor never reports its position, and one does not report it in its first range.
    let mut heard = 0;
    for message in &mut messages {
        let Message::Range(range) = message else { continue };
        heard += u32::from(range.peer == late);
        if range.peer == silent || range.peer == late && heard == 1 {
            range.position_tenth_mm = None;
        }
    }
    let folder = Folder::with(&[("known.csv", &format!("anchor,x_m,y_m,z_m\n{silent},1,2,3\n"))]);
    folder.write("walk.bin", &stream(&messages));
    let run = folder.run("record --file walk.bin --out walk --json").ok();
    let json = run.object();
    let left_out = peers.iter().filter(|peer| **peer == silent).count();
    assert_eq!(json["recorded"]["left_out"], serde_json::json!({ Address(silent).to_string(): left_out }));
    assert_eq!(
        (&json["recorded"]["ranges"], &json["recorded"]["anchors"]),
        (&(peers.len() - left_out).into(), &5.into())
    );
    folder.run("solve --anchors walk/anchors.csv --ranges walk/ranges.csv --dims 2 --height-m 1.2").ok();
    let json = folder.run("record --file walk.bin --out known --anchors known.csv --json").ok().object();
    assert_eq!(
        (&json["recorded"]["ranges"], &json["recorded"]["left_out"]),
        (&peers.len().into(), &serde_json::json!({}))
    );
    let anchors = String::from_utf8(folder.read("known/anchors.csv")).expect("UTF-8");
    assert!(anchors.contains(&format!("\n{},1.0000,2.0000,3.0000\n", Address(silent))), "{anchors}");
}

#[test]
fn a_recording_without_beacons_has_no_file_of_them_and_a_second_one_does_not_go_into_its_folder() {
    let folder = Folder::with(&[]);
    let without: Vec<Message> = walk().into_iter().filter(|message| message.kind() != "sighting").collect();
    folder.write("walk.bin", &stream(&without));
    let output = run_with(&folder, "record --stdin --out walk", &stream(&without));
    assert!(output.status.success());
    let mut names: Vec<_> = std::fs::read_dir(folder.path("walk"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"))
        .collect();
    names.sort();
    assert_eq!(names, ["anchors.csv", "positions.csv", "ranges.csv", "telemetry.bin", "telemetry.times.csv"]);
    let before = folder.read("walk/ranges.csv");
    let run = folder.run("record --file walk.bin --out walk");
    assert_eq!(
        (run.code, run.stderr.as_str()),
        (Some(2), "--out: walk has anchors.csv already; --force replaces it\n")
    );
    assert_eq!(folder.read("walk/ranges.csv"), before);
}

#[test]
fn a_restart_of_the_node_starts_no_epoch_again() {
    let folder = Folder::with(&[]);
    folder.write("walk.bin", &[stream(&walk()), stream(&walk())].concat());
    let json = folder.run("record --file walk.bin --out walk --json").ok().object();
    assert_eq!((&json["restarts"], &json["rounds_missed"]), (&1.into(), &0.into()));
    assert_eq!(json["last_t_s"], 4.0002);
    let positions = folder.run("decode --file walk --format csv").ok();
    let epochs = positions.column("epoch");
    let times = positions.numbers("t_s");
    assert!(epochs.iter().zip(&epochs[1..]).all(|(a, b)| a.parse::<u64>().unwrap() < b.parse().unwrap()), "{epochs:?}");
    assert!(times.is_sorted());
}

#[test]
fn a_replay_gives_what_decode_gives_or_the_very_bytes() {
    let folder = folder();
    let decoded = folder.run("decode --file walk.bin").ok().stdout;
    assert_eq!(folder.run("decode walk.bin").ok().stdout, decoded);
    let replayed = folder.run("replay walk.bin --speed 1000000").ok();
    assert_eq!(replayed.stdout, decoded);
    assert_eq!(replayed.stderr, folder.run("decode walk.bin").ok().stderr, "the same count in the end");
    folder.run("record --file walk.bin --out walk").ok();
    let raw = folder.command("replay walk --speed 1000000 --raw").output().expect("baliza runs");
    assert_eq!((raw.status.code(), raw.stdout), (Some(0), folder.read("walk.bin")));
}

#[test]
fn a_replay_keeps_the_pace_of_the_recording() {
    let folder = folder();
    let begun = Instant::now();
    let mut command = folder.command("replay walk.bin --speed 4");
    let mut child = command.stdout(Stdio::piped()).spawn().expect("baliza runs");
    let mut came = Vec::new();
    for line in BufReader::new(child.stdout.take().expect("piped")).lines() {
        let line: Value = serde_json::from_str(&line.expect("read")).expect("JSON");
        came.push((line["t_s"].as_f64().expect("a time"), begun.elapsed().as_secs_f64()));
    }
    assert!(child.wait().expect("it ends").success());
    // No message is early; two seconds at four times the speed.
    assert!(came.iter().all(|(t_s, elapsed)| *elapsed >= (t_s - 0.001) / 4.0), "{came:?}");
    assert!(came.first().is_some_and(|first| came.last().is_some_and(|last| last.1 - first.1 > 0.4)), "{came:?}");
}

#[test]
fn what_is_wrong_is_told_in_one_line_and_nothing_is_written() {
    let folder = folder();
    folder.write("file", b"");
    folder.write("named.csv", b"anchor,x_m,y_m,z_m\nA1,0,0,0\n");
    let cases = [
        ("decode --file none.bin", "none.bin: cannot open it: "),
        ("decode --file none.bin --out out.jsonl", "none.bin: cannot open it: "),
        ("decode --file walk.bin --stdin", "the argument '--file <FILE>' cannot be used with '--stdin'"),
        ("decode --file walk.bin --table ranges", "--table: only with --format csv\n"),
        ("decode --file walk.bin --format xml", "invalid value 'xml' for '--format <FORMAT>'"),
        ("decode --file walk.bin --out none/out.jsonl", "--out: the folder none does not exist\n"),
        ("record --file none.bin --out walk", "none.bin: cannot open it: "),
        ("record --file walk.bin --stdin --out walk", "the argument '--file <FILE>' cannot be used with '--stdin'"),
        ("record --file walk.bin --out file", "--out: file is not a folder\n"),
        (
            "record --file walk.bin --out walk --anchors named.csv",
            "--anchors: anchor \"A1\" is not called by its short address",
        ),
        ("replay walk.bin --speed 0", "invalid value '0' for '--speed <X>'"),
        ("replay none.bin", "none.bin: cannot open it: "),
        ("replay walk.bin --raw --format csv", "the argument '--raw' cannot be used with '--format <FORMAT>'"),
    ];
    let before = folder.names();
    for (arguments, said) in cases {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stdout.as_str()), (Some(2), ""), "{arguments}: {run:?}");
        assert!(run.stderr.starts_with(said) && run.stderr.lines().count() == 1, "{arguments}: {}", run.stderr);
    }
    assert_eq!(folder.names(), before);
}
