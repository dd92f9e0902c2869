//! `baliza replay`: the messages of a recording, at its pace.

use std::io::{BufRead, BufReader};
use std::process::Stdio;
use std::time::Instant;

use serde_json::Value;

use crate::messages::walk_folder;

#[test]
fn a_replay_gives_what_decode_gives_or_the_very_bytes() {
    let folder = walk_folder();
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
    let folder = walk_folder();
    let begun = Instant::now();
    let mut command = folder.command("replay walk.bin --speed 4");
    let mut child = command.stdout(Stdio::piped()).spawn().expect("baliza runs");
    let mut came = Vec::new();
    for line in BufReader::new(child.stdout.take().expect("piped")).lines() {
        let line: Value = serde_json::from_str(&line.expect("read")).expect("JSON");
        came.push((line["t_s"].as_f64().expect("a time"), begun.elapsed().as_secs_f64()));
    }
    assert!(child.wait().expect("it ends").success());
    // No message is early: the last one comes two seconds after the first at four times the speed.
    assert!(came.iter().all(|(t_s, elapsed)| *elapsed >= (t_s - 0.001) / 4.0), "{came:?}");
    assert!(came.last().is_some_and(|(t_s, _)| *t_s > 1.9), "{came:?}");
}
