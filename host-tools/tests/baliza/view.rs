//! `baliza convert` and `monitor --foxglove`: what Foxglove gets, read by the `mcap` crate and a WebSocket client.

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::Message;
use wire::telemetry::Range;

use crate::foxglove_client::{connect, json_of, messages, wait};
use crate::messages::{frame, range as range_to};
use crate::monitor::testing::{BUILD, fix, hello, telemetry_frame};
use crate::support::Folder;

/// An anchor 258 at (1, 2, 3) and a range of 4.5 m to it.
fn range(t_us: u64) -> Vec<u8> {
    frame(&Range { position_tenth_mm: Some([10_000, 20_000, 30_000]), ..range_to(t_us, 258) }.into())
}

#[test]
fn a_recording_becomes_an_mcap_file() {
    let folder = Folder::with(&[]);
    std::fs::create_dir(folder.path("walk")).expect("made");
    folder.write("walk/anchors.csv", b"anchor,x_m,y_m,z_m\na,0,0,2\nb,5,0,2\n");
    folder.write("walk/ranges.csv", b"epoch,t_s,anchor,range_m,los\n0,1.5,a,4.5,1\n0,1.5,b,3.25,\n1,,a,4.5,\n");
    let positions = "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,used,reason\n\
                     0,1.5,nls,1,2,0.5,0.1,0.2,0.3,4,\n1,1.6,nls,,,,,,,,too-few-anchors\n";
    folder.write("walk/positions.csv", positions.as_bytes());
    folder.write("walk/truth.csv", b"epoch,t_s,x_m,y_m\n0,1.25,1,2\n");
    let run = folder.run("convert walk --out walk.mcap").ok();
    assert_eq!(run.stderr, "2 ranges, 2 positions, in walk.mcap\n1 rows without t_s left out\n");
    let messages = messages(&folder.read("walk.mcap"));
    let rows = |topic: &str| {
        let rows = messages.get(topic).unwrap_or_else(|| panic!("no {topic} in {:?}", messages.keys()));
        rows.iter().map(|(schema, t_ns, _)| (schema.as_str(), *t_ns)).collect::<Vec<_>>()
    };
    // The file begins with its first time, that of the truth.
    assert_eq!(rows("/anchors"), [("foxglove.SceneUpdate", 1_250_000_000); 2]);
    assert_eq!(rows("/truth/pose"), [("foxglove.PoseInFrame", 1_250_000_000)]);
    assert_eq!(rows("/nls/pose"), [("foxglove.PoseInFrame", 1_500_000_000)]);
    assert_eq!(rows("/nls/uncertainty"), [("foxglove.SceneUpdate", 1_500_000_000)]);
    assert_eq!(rows("/nls/position"), [("baliza.Position", 1_500_000_000), ("baliza.Position", 1_600_000_000)]);
    let [(_, _, first), (_, _, second)] = &messages["/ranges"][..] else { panic!("{messages:?}") };
    assert_eq!(json_of(first), json!({"t_s": 1.5, "epoch": "0", "anchor": "a", "range_m": 4.5, "los": true}));
    assert_eq!(json_of(second)["los"], Value::Null);
    let without = json_of(&messages["/nls/position"][1].2);
    assert_eq!((&without["x_m"], &without["reason"]), (&Value::Null, &json!("too-few-anchors")));
    // Protobuf: field 2 is the frame, field 3 the pose, whose x, y and z are doubles.
    let pose = &messages["/nls/pose"][0].2;
    for part in [b"map".to_vec(), 2.0_f64.to_le_bytes().to_vec(), 0.5_f64.to_le_bytes().to_vec()] {
        assert!(pose.windows(part.len()).any(|window| window == part), "{pose:?}");
    }
}

#[test]
fn a_stream_becomes_an_mcap_file_with_the_hosts_time() {
    let folder = Folder::with(&[]);
    let stream = [telemetry_frame(&hello(100, BUILD)), range(450_000), telemetry_frame(&fix(500_000, 3.21))].concat();
    folder.write("telemetry.bin", &stream);
    folder.run("convert telemetry.bin --out node.mcap").ok();
    let messages_of_node = messages(&folder.read("node.mcap"));
    assert_eq!(messages_of_node["/ranges"][0].1, 450_000_000);
    assert_eq!(json_of(&messages_of_node["/tag/position"][0].2)["x_m"], json!(3.21));
    assert!(messages_of_node.contains_key("/anchors") && messages_of_node.contains_key("/tag/pose"));

    std::fs::create_dir(folder.path("walk")).expect("made");
    folder.write("walk/telemetry.bin", &stream);
    folder.write("walk/telemetry.times.csv", b"offset,t_s,utc_us\n40,0.45,1700000000000000\n");
    folder.run("convert walk --out walk.mcap").ok();
    assert_eq!(messages(&folder.read("walk.mcap"))["/tag/pose"][0].1, 1_700_000_000_050_000_000);
}

#[test]
fn what_is_no_recording_is_refused_and_leaves_no_file() {
    let folder = Folder::with(&[("positions.csv", "epoch,x_m,y_m\n0,1,2\n")]);
    let run = folder.run("convert positions.csv --out x.mcap");
    let told = "positions.csv: this is no telemetry: there is no frame in 20 bytes\n";
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), told));
    assert_eq!(folder.names(), ["positions.csv"]);
}

#[test]
fn a_live_stream_is_advertised_and_sent_to_a_websocket() {
    let folder = Folder::with(&[]);
    let mut command = folder.command("monitor --stdin --foxglove 127.0.0.1:0");
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let mut stdin = child.stdin.take().expect("a pipe");
    let mut line = String::new();
    BufReader::new(child.stderr.as_mut().expect("a pipe")).read_line(&mut line).expect("read");
    let address = line.trim().strip_prefix("foxglove: ").unwrap_or_else(|| panic!("{line}"));
    let mut client = connect(address);

    stdin.write_all(&telemetry_frame(&fix(500_000, 3.5))).expect("written");
    let channel = wait(&mut client, |message| {
        let advertised = json_of(message.to_text().ok()?.as_bytes());
        let channels = advertised["channels"].as_array()?;
        channels.iter().find(|channel| channel["topic"] == "/tag/position")?["id"].as_u64()
    });
    let subscribe = json!({"op": "subscribe", "subscriptions": [{"id": 7, "channelId": channel}]});
    client.send(Message::text(subscribe.to_string())).expect("sent");
    // The subscription is taken some time later: positions come until one is received.
    let feeding = std::thread::spawn(move || {
        for round in 0.. {
            if stdin.write_all(&telemetry_frame(&fix(600_000 + round * 50_000, 3.5))).is_err() {
                break;
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    let position = loop {
        // Opcode 1, the subscription (u32), the time (u64), the message. A server that has only just advertised a
        // channel may not know it yet: it answers with a status, and the subscription is sent again.
        let answer = wait(&mut client, |message| match message {
            Message::Binary(bytes) if bytes.starts_with(&[1, 7, 0, 0, 0]) => Some(Some(json_of(bytes.get(13..)?))),
            Message::Text(text) if text.contains("Unknown channel") => Some(None),
            _ => None,
        });
        match answer {
            Some(position) => break position,
            None => client.send(Message::text(subscribe.to_string())).expect("sent"),
        }
    };
    assert_eq!(position["x_m"], json!(3.5));
    child.kill().expect("ended");
    child.wait().expect("ended");
    feeding.join().expect("ended");
}
