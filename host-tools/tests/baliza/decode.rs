//! `baliza decode`: a simulated tag's telemetry, complete, damaged, of other builds, and between other bytes.

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use wire::telemetry::Message;

use crate::messages::{frame, run_with, stream, walk, walk_folder};
use crate::support::Folder;

fn count(messages: &[Message], kind: &str) -> u64 {
    messages.iter().filter(|message| message.kind() == kind).count() as u64
}

/// The golden test of the crate `telemetry` has the objects themselves as literals.
#[test]
fn every_message_is_a_line_of_json() {
    let messages = walk();
    let run = walk_folder().run("decode --file walk.bin").ok();
    let lines: Vec<String> = messages.iter().map(|message| message.json().to_string()).collect();
    assert_eq!(run.stdout.lines().collect::<Vec<_>>(), lines);
    let first = serde_json::json!({
        "type": "hello", "t_s": 0.001, "eui": "10205f1234567890", "address": "0x1001", "role": "tag", "board": "simulated",
        "build": "01020304050607ab", "keyed": false,
    });
    assert_eq!(serde_json::from_str::<Value>(&lines[0]).expect("JSON"), first);
    let fixes = count(&messages, "fix");
    assert!(fixes >= 15, "{fixes}");
    let counts = format!("{} frames in {} bytes: 2 hello, {fixes} fix", messages.len(), stream(&messages).len());
    assert!(run.stderr.starts_with(&counts), "{}", run.stderr);
}

#[test]
fn json_is_one_document_of_what_came_and_what_was_lost() {
    let messages = walk();
    let run = walk_folder().run("decode --file walk.bin --json").ok();
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
    let folder = walk_folder();
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
fn a_stream_of_another_build_is_not_counted_as_damaged() {
    let folder = Folder::with(&[]);
    // The golden frames of the state message in docs/reference/wire-format.md, with schema 2 and with message 99.
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
    let folder = walk_folder();
    let positions = folder.run("decode --file walk.bin --format csv").ok();
    let header = "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,used,reason,flag,alt_x_m,alt_y_m,alt_z_m";
    assert_eq!(positions.stdout.lines().next(), Some(header));
    let (x, reasons) = (positions.numbers("x_m"), positions.column("reason"));
    assert_eq!(x.len() as u64, count(&messages, "fix"));
    assert!(x.iter().zip(&reasons).all(|(x, reason)| x.is_nan() != reason.is_empty()), "a position or a reason");
    assert!(x.iter().any(|x| x.is_finite()), "no position");
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
    let folder = walk_folder();
    folder.write("out.jsonl", b"before");
    let mut command = folder.command("decode --stdin --out out.jsonl");
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
    let mut stdin = child.stdin.take().expect("piped");
    stdin.write_all(&folder.read("walk.bin")).expect("it reads");
    folder.wait_for_temporary();
    child.kill().expect("it runs");
    child.wait().expect("it ends");
    assert_eq!(folder.read("out.jsonl"), b"before");
    let run = folder.run("decode --file walk.bin --out out.jsonl").ok();
    assert_eq!(run.stdout, "");
    assert_eq!(folder.read("out.jsonl"), folder.run("decode --file walk.bin").ok().stdout.into_bytes());
}
