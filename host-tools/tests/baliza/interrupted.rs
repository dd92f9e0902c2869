//! Commands that are killed at any instant: each output is the old one or the new one, and a recording loses nothing
//! that was in it. The next command removes what a killed one has left. `BALIZA_KILLS` is the number of
//! kills [default: 40].

#![cfg(unix)]

use std::collections::BTreeMap;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::messages::{frame, stream, walk};
use crate::support::{Folder, wait_until};

/// Ctrl-C, a closed terminal, `kill`, and the kill that no program can catch.
const SIGNALS: [(&str, i32); 4] = [("INT", 2), ("HUP", 1), ("TERM", 15), ("KILL", 9)];

/// The number of kills of each of the commands.
fn kills() -> u64 {
    let all: u64 = std::env::var("BALIZA_KILLS").map_or(40, |number| number.parse().expect("BALIZA_KILLS is a number"));
    all.div_ceil(4)
}

fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(status.expect("kill runs").success());
}

/// The names of the outputs in progress in a folder.
fn temporary(folder: &Folder, of: &str) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path(of)).into_iter().flatten();
    let names = entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"));
    names.filter(|name| name.starts_with(".baliza-")).collect()
}

/// The files of a folder that are not hidden, by name.
fn files(folder: &Folder, of: &str) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder.path(of)).into_iter().flatten();
    let names = entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"));
    names
        .filter(|name| !name.starts_with('.'))
        .map(|name| (name.clone(), folder.read(&format!("{of}/{name}"))))
        .collect()
}

/// Kills a command that writes into the folder `out` again and again: after each kill, the folder is as the first
/// command makes it, or as the second one does.
fn is_old_or_new(folder: &Folder, old: &str, new: &str, seed: u64) {
    let made = |command: &str| {
        let begun = Instant::now();
        folder.run(command).ok();
        (files(folder, "out"), begun.elapsed())
    };
    let ((before, _), (after, mut takes)) = (made(old), made(new));
    assert!(before != after && !after.is_empty());
    let mut random = Pcg64::seed_from_u64(seed);
    let mut seen = [0_u32; 2];
    for kill in 0..kills() {
        let (name, number) = SIGNALS[kill as usize % SIGNALS.len()];
        made(old);
        // The kill before has left nothing.
        assert_eq!((temporary(folder, ""), temporary(folder, "out")), (vec![], vec![]), "kill {kill}");
        let mut child = folder.command(new).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("baliza runs");
        // Three of four kills are near the instant at which the files appear.
        let is_near = random.random_bool(0.75);
        std::thread::sleep(takes.mul_f64(if is_near { random.random_range(0.97..1.03) } else { random.random() }));
        signal(&child, name);
        let status = child.wait().expect("it ends");
        let now = files(folder, "out");
        let is = [now == before, now == after];
        assert!(is[0] || is[1], "kill {kill} ({name}): {:?} are neither old nor new", now.keys());
        seen.iter_mut().zip(is).for_each(|(seen, is)| *seen += u32::from(is));
        if is_near {
            takes = takes.mul_f64(if is[0] { 1.05 } else { 0.95 });
        }
        let ended = [status.code() == Some(0), status.code() == Some(130), status.signal() == Some(number)];
        assert!(ended.contains(&true), "{name}: {status:?}");
        // A command that says that it is done, has done it.
        assert!(!ended[0] || is[1], "{name}: done, but {:?} are old", now.keys());
    }
    eprintln!("{new}: {} times old, {} times new", seen[0], seen[1]);
}

#[test]
fn a_simulation_leaves_the_old_recording_or_the_new_one() {
    let folder = Folder::with(&[]);
    let simulate = "simulate --tags 1 --anchors 4 --fidelity air --force --out out --seconds";
    is_old_or_new(&folder, &format!("{simulate} 1.5 --mode tdoa"), &format!("{simulate} 3"), 1);
}

#[test]
fn records_are_the_old_ones_or_the_new_ones() {
    let folder = Folder::with(&[]);
    folder.run("provision --example --out site.toml").ok();
    let provision = "provision --config site.toml --all --out out --force --format";
    is_old_or_new(&folder, &format!("{provision} bin"), &format!("{provision} hex"), 2);
}

#[test]
fn solved_positions_are_the_old_ones_or_the_new_ones() {
    let folder = Folder::with(&[]);
    folder.run("example --out room").ok();
    std::fs::create_dir(folder.path("out")).expect("made");
    let solve = "solve --anchors room/anchors.csv --ranges room/ranges.csv --out out/positions.csv --method";
    is_old_or_new(&folder, &format!("{solve} lls"), &format!("{solve} lls,nls"), 3);
}

/// The stream of a node that sends a frame each millisecond, killed at any instant. What was read from the recording
/// stays, and all that was sent is in it while nothing more comes.
#[test]
fn a_recording_keeps_what_was_in_it_and_gets_all_that_was_sent() {
    let mut random = Pcg64::seed_from_u64(4);
    let sent: Vec<Vec<u8>> = walk().iter().cycle().take(1000).map(frame).collect();
    for kill in 0..kills() {
        let folder = Folder::with(&[]);
        let (name, number) = SIGNALS[kill as usize % SIGNALS.len()];
        let mut command = folder.command("record --stdin --out out");
        let mut child = command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
        let mut stdin = child.stdin.take().expect("piped");
        // The folder is there when signals are caught.
        while !folder.path("out").is_dir() {
            std::thread::sleep(Duration::from_millis(5));
        }
        let lives = Duration::from_millis(random.random_range(100..1000));
        let begun = Instant::now();
        let mut bytes = Vec::new();
        for frame in &sent {
            stdin.write_all(frame).expect("it reads");
            bytes.extend(frame);
            if begun.elapsed() >= lives {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        let recorded = || std::fs::read(folder.path("out/telemetry.bin")).unwrap_or_default();
        // Half of the nodes are silent at last.
        if random.random() {
            wait_until("the last frames are not recorded", || recorded() == bytes);
        }
        let old = recorded().len();
        signal(&child, name);
        let status = child.wait().expect("it ends");
        let kept = recorded();
        assert!(bytes.starts_with(&kept), "kill {kill} ({name})");
        assert!(kept.len() >= old, "kill {kill} ({name}): {} bytes are left of {old}", kept.len());
        if number == 9 {
            assert_eq!(status.signal(), Some(number));
            if !kept.is_empty() {
                folder.run("record --finish out").ok();
            }
        } else {
            // A signal ends the recording of a live node well.
            assert_eq!(status.code(), Some(0), "{name}");
        }
        if !kept.is_empty() {
            let told = folder.run("decode out --format csv").ok();
            assert_eq!(folder.read("out/positions.csv"), told.stdout.as_bytes(), "kill {kill} ({name})");
        }
    }
}

/// A part of a file is not the whole.
#[test]
fn an_interrupted_command_reports_it_and_keeps_the_old_file() {
    let folder = Folder::with(&[]);
    // A sparse file: messages, and then a terabyte of zeros, which nothing reads to its end.
    folder.write("long.bin", &stream(&walk()).repeat(20));
    let long = std::fs::File::options().write(true).open(folder.path("long.bin")).expect("a file");
    long.set_len(1 << 40).expect("a file system with sparse files");
    for (name, _) in SIGNALS.into_iter().take(3) {
        folder.write("out.jsonl", b"before");
        let mut command = folder.command("decode --file long.bin --out out.jsonl");
        let child = command.stderr(Stdio::piped()).spawn().expect("baliza runs");
        folder.wait_for_temporary();
        signal(&child, name);
        let output = child.wait_with_output().expect("it ends");
        let said = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!((output.status.code(), said.as_str()), (Some(130), "baliza: interrupted\n"), "{name}");
        assert_eq!(folder.names(), ["long.bin", "out.jsonl"]);
        assert_eq!(folder.read("out.jsonl"), b"before");
    }
}

/// A file in progress, killed: another command removes it, but not the file of a command that still runs.
#[test]
fn the_next_command_removes_the_file_of_a_killed_one_and_not_that_of_a_running_one() {
    let folder = Folder::with(&[]);
    let messages = walk();
    let begin = |out: &str| {
        let mut command = folder.command(&format!("decode --stdin --out {out}"));
        command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs")
    };
    let mut killed = begin("killed.jsonl");
    folder.wait_for_temporary();
    killed.kill().expect("it runs");
    killed.wait().expect("it ends");
    let left = temporary(&folder, "");
    assert_eq!(left.len(), 1);
    let mut running = begin("running.jsonl");
    wait_until("the file of the killed one stays", || {
        temporary(&folder, "") != left && temporary(&folder, "").len() == 1
    });
    let kept = temporary(&folder, "");
    folder.run("provision --example --out site.toml").ok();
    assert_eq!(temporary(&folder, ""), kept);
    // Its reader has all that it waits for.
    running.stdin.take().expect("piped").write_all(&stream(&messages)).expect("it reads");
    assert!(running.wait().expect("it ends").success());
    assert_eq!(folder.names(), ["running.jsonl", "site.toml"]);
    let lines = folder.read("running.jsonl").iter().filter(|byte| **byte == b'\n').count();
    assert_eq!(lines, messages.len());
}

/// As above, with a folder in progress.
#[test]
fn the_next_command_removes_the_folder_of_a_killed_one() {
    let folder = Folder::with(&[]);
    let simulate = "simulate --tags 1 --anchors 4 --fidelity air --seconds 3600 --out out";
    let mut command = folder.command(simulate);
    let mut killed = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("baliza runs");
    folder.wait_for_temporary();
    killed.kill().expect("it runs");
    killed.wait().expect("it ends");
    assert_eq!(temporary(&folder, "").len(), 1);
    folder.run("example --out room").ok();
    assert_eq!(folder.names(), ["room"]);
}
