//! What `solve` and `track` keep of a long recording: a few hundred bytes an epoch, whatever the file has.

use std::fmt::Write as _;
use std::fs;
use std::io::Read;
use std::process::Stdio;

use crate::support::{Folder, root};

/// The epochs of `examples/room`.
const EPOCHS: usize = 299;
/// An epoch of eight ranges: 8 · 24 bytes of ranges, 32 of true position and 64 of name, time and places, 200 of its
/// result. A table that grows has as much again in reserve, or is copied while it grows.
const MOST_BYTES: usize = 2 * (8 * 24 + 32 + 64 + 200);

/// `examples/room`, this number of times one after the other.
fn room(times: usize) -> Folder {
    let read = |name: &str| fs::read_to_string(root().join("examples/room").join(name)).expect("an example");
    let repeated = |name: &str| {
        let text = read(name);
        let (header, rows) = text.split_once('\n').expect("a header");
        let mut all = format!("{header}\n");
        for time in 0..times {
            for row in rows.lines() {
                let [epoch, t_s, rest] = row.splitn(3, ',').collect::<Vec<_>>()[..] else { panic!("{row}") };
                let epoch = epoch.parse::<usize>().expect("a number") + 300 * time;
                let t_s = t_s.parse::<f64>().expect("a number") + 30.0 * time as f64;
                writeln!(all, "{epoch},{t_s:.1},{rest}").expect("a text");
            }
        }
        all
    };
    Folder::with(&[
        ("anchors.csv", &read("anchors.csv")),
        ("ranges.csv", &repeated("ranges.csv")),
        ("truth.csv", &repeated("truth.csv")),
    ])
}

/// The most memory that the command takes until it writes its positions, bytes. By then it holds whatever it holds:
/// standard output takes 64 kB before it is read, which is less than the positions, so the command waits.
fn peak(folder: &Folder, command: &str) -> usize {
    let mut child = folder.command(command).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
    let mut positions = child.stdout.take().expect("piped");
    let mut text = vec![0];
    positions.read_exact(&mut text).expect("a position");
    let status = fs::read_to_string(format!("/proc/{}/status", child.id())).expect("the command waits");
    positions.read_to_end(&mut text).expect("positions");
    assert!(text.len() > 70_000, "{} bytes are no more than standard output takes at once", text.len());
    assert!(child.wait().expect("a child").success());
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB"));
    1024 * peak.and_then(|kilobytes| kilobytes.parse::<usize>().ok()).expect("Linux says how much")
}

#[test]
fn twenty_times_as_many_epochs_take_no_more_than_their_columns() {
    let [short, long] = [3, 60].map(room);
    for command in ["solve .", "track ."] {
        let [less, more] = [&short, &long].map(|folder| peak(folder, command));
        let an_epoch = more.saturating_sub(less) / (57 * EPOCHS);
        assert!(an_epoch < MOST_BYTES, "{command}: {an_epoch} bytes an epoch, from {less} to {more}");
    }
}
