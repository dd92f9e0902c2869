//! `baliza record`: what is received is in files at once, whatever ends the program.

use std::collections::BTreeMap;
use std::io::Write;
use std::process::{Child, ChildStdin, Stdio};
use std::time::SystemTime;

use wire::telemetry::{Address, Message, Range};

use crate::messages::{frame, run_with, stream, walk, walk_folder};
use crate::support::{Folder, Run, wait_until};

/// A recording of a pipe.
fn recording(folder: &Folder, arguments: &str) -> (Child, ChildStdin) {
    let mut command = folder.command(arguments);
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
    let stdin = child.stdin.take().expect("piped");
    (child, stdin)
}

/// Waits until a file has these bytes.
fn wait_for(folder: &Folder, name: &str, is_there: impl Fn(&[u8]) -> bool) {
    wait_until(&format!("{name} does not come"), || {
        std::fs::read(folder.path(name)).is_ok_and(|bytes| is_there(&bytes))
    });
}

#[test]
fn bytes_tables_and_times_are_there_while_the_node_sends() {
    let folder = walk_folder();
    let micros = || SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("after 1970").as_micros();
    let begun = micros();
    let (mut child, mut stdin) = recording(&folder, "record --stdin --out walk");
    let bytes = folder.read("walk.bin");
    // In two pieces, each of which the program has read before the next one, cut within a frame.
    let (first, second) = bytes.split_at(1000);
    stdin.write_all(first).expect("it reads");
    wait_for(&folder, "walk/telemetry.bin", |written| written == first);
    stdin.write_all(second).expect("it reads");
    wait_for(&folder, "walk/telemetry.bin", |written| written == bytes);
    let told = folder.run("decode walk.bin --format csv").ok();
    wait_for(&folder, "walk/positions.csv", |written| written == told.stdout.as_bytes());
    wait_for(&folder, "walk/anchors.csv", |written| written.iter().filter(|byte| **byte == b'\n').count() == 7);
    child.kill().expect("it runs");
    child.wait().expect("it ends");

    // A row a frame: its first byte, its time as in the tables, and when it came.
    let times = String::from_utf8(folder.read("walk/telemetry.times.csv")).expect("UTF-8");
    let mut rows = times.lines();
    assert_eq!(rows.next(), Some("offset,t_s,utc_us"));
    let rows: Vec<Vec<&str>> = rows.map(|row| row.split(',').collect()).collect();
    let mut offset = 0;
    let messages = walk();
    assert_eq!(rows.len(), messages.len());
    for (row, message) in rows.iter().zip(&messages) {
        let t_s = message.t_us() as f64 / 1e6;
        assert_eq!((row[0], row[1]), (offset.to_string().as_str(), format!("{t_s:.6}").as_str()));
        let utc_us: u128 = row[2].parse().expect("a number");
        assert!((begun..=micros()).contains(&utc_us), "{row:?}");
        offset += frame(message).len();
    }
}

#[test]
fn a_recording_that_was_cut_short_is_finished_later() {
    let folder = walk_folder();
    folder.run("record --file walk.bin --out whole").ok();
    std::fs::create_dir(folder.path("cut")).expect("made");
    folder.write("cut/telemetry.bin", &folder.read("walk.bin"));
    // What a full disk or a loss of power leaves.
    folder.write("cut/positions.csv", b"epoch,t_s,method\n12,1.0");
    folder.write("cut/notes.txt", b"mine");
    folder.run("record --finish cut").ok();
    for table in ["anchors.csv", "positions.csv", "ranges.csv", "rssi.csv"] {
        assert_eq!(folder.read(&format!("cut/{table}")), folder.read(&format!("whole/{table}")), "{table}");
    }
    assert_eq!(
        (folder.read("cut/telemetry.bin"), folder.read("cut/notes.txt")),
        (folder.read("walk.bin"), b"mine".into())
    );
    // An error in a table of the user is reported, and the table stays.
    let anchors = b"anchor,x_m,y_m,z_m\n0x0101,0,0,2,4\n";
    folder.write("cut/anchors.csv", anchors);
    let run = folder.run("record --finish cut");
    assert!(run.code == Some(2) && run.stderr.starts_with("cut/anchors.csv:2: "), "{run:?}");
    assert_eq!(folder.read("cut/anchors.csv"), anchors);
    // A header only, as a recording without any range has it.
    folder.write("cut/anchors.csv", b"anchor,x_m,y_m,z_m\n");
    folder.run("record --finish cut").ok();
    assert_eq!(folder.read("cut/anchors.csv"), folder.read("whole/anchors.csv"));
    // A simulation knows more than its telemetry.
    folder.run("simulate --seconds 0.5 --out simulated --json").ok();
    let run = folder.run("record --finish simulated");
    assert!(run.code == Some(2) && run.stderr.starts_with("--finish: simulated is of a simulation"), "{run:?}");
    let run = folder.run("record --finish none");
    assert!(run.code == Some(2) && run.stderr.starts_with("none/telemetry.bin: cannot open it"), "{run:?}");
}

#[test]
fn parts_of_a_rotated_recording_are_recordings_and_together_one_stream() {
    let folder = walk_folder();
    let bytes = folder.read("walk.bin");
    folder.run("record --file walk.bin --out site --rotate 1kB").ok();
    let mut parts: Vec<_> =
        std::fs::read_dir(folder.path("site")).expect("a folder").map(|part| part.expect("an entry").path()).collect();
    parts.sort();
    assert!(parts.len() > 3 && parts[0].ends_with("site/000001"));
    let read =
        |name: &str| parts.iter().map(|part| std::fs::read(part.join(name)).expect("it is there")).collect::<Vec<_>>();
    assert_eq!(read("telemetry.bin").concat(), bytes);
    // A part ends with the frame that fills it; no frame is longer than 256 bytes.
    let lengths: Vec<_> = read("telemetry.bin").iter().map(Vec::len).collect();
    assert!(lengths.iter().rev().skip(1).all(|length| (1000..1256).contains(length)), "{lengths:?}");
    let told = folder.run("decode walk.bin --format csv").ok().stdout;
    assert_eq!(folder.run("decode site --format csv").ok().stdout, told);
    assert_eq!(folder.run("monitor --file site --format csv").ok().stdout, told);
    let header = told.lines().next().expect("a header").len() + 1;
    let rows: Vec<u8> = read("positions.csv").iter().flat_map(|table| table[header..].to_vec()).collect();
    assert_eq!(rows, &told.as_bytes()[header..]);
    // Anchors that are known in one part are known in the next one.
    assert!(read("anchors.csv")[parts.len() - 1].len() >= read("anchors.csv")[1].len());
    folder.run("solve --anchors site/000002/anchors.csv --ranges site/000002/ranges.csv --dims 2 --height-m 1.2").ok();
    // The next run goes on behind the last part, and a recording without parts does not mix with them.
    let before = read("positions.csv");
    folder.run("record --finish site").ok();
    assert_eq!(read("positions.csv"), before);
    folder.run("record --file walk.bin --out site --rotate 1h").ok();
    let next = folder.path("site").join(format!("{:06}", parts.len() + 1));
    assert_eq!(std::fs::read(next.join("telemetry.bin")).expect("it is there"), bytes);
    let run = folder.run("record --file walk.bin --out site");
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "--out: site has the parts of a recording (000001)\n"));
}

#[test]
fn an_earlier_recording_is_replaced_by_the_first_frame_and_not_before() {
    let folder = walk_folder();
    folder.run("record --file walk.bin --out walk").ok();
    let rssi = folder.read("walk/rssi.csv");
    folder.write("noise.bin", &[b'x'; 1000]);
    assert_eq!(folder.run("record --file noise.bin --out walk --force").code, Some(2));
    folder.run("record --stdin --out walk --force").ok();
    assert_eq!(folder.read("walk/rssi.csv"), rssi, "nothing came");
    let run = folder.run("record --file walk --out walk --force");
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "--out: walk is the input --file; name another file\n"));
    let run = folder.run("record --file walk.bin --anchors walk/anchors.csv --out walk --force");
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "--out: walk is the input --anchors; name another file\n"));
    let without: Vec<Message> = walk().into_iter().filter(|message| message.kind() != "sighting").collect();
    folder.write("walk.bin", &stream(&without));
    folder.run("record --file walk.bin --out walk --force").ok();
    assert!(!folder.path("walk/rssi.csv").exists());
    assert_eq!(folder.read("walk/telemetry.bin"), folder.read("walk.bin"));
}

/// A stream of ranges to an anchor that reports its position in the last one only.
fn ranges_without_position(count: u64) -> Vec<u8> {
    let walk = walk();
    let range = walk.iter().find_map(|m| if let Message::Range(range) = m { Some(*range) } else { None });
    let range = range.expect("a range");
    let at = |index: u64| {
        Message::Range(Range {
            t_us: index * 1000,
            round: index as u16,
            position_tenth_mm: if index + 1 == count { Some([10_000, 20_000, 24_000]) } else { None },
            ..range
        })
    };
    (0..count).flat_map(|index| frame(&at(index))).collect()
}

#[cfg(target_os = "linux")]
#[test]
fn ranges_that_wait_for_a_position_are_all_recorded_and_do_not_fill_the_memory() {
    let folder = Folder::with(&[]);
    let peak_kb = |ranges: u64, out: &str| {
        let bytes = ranges_without_position(ranges);
        let (mut child, mut stdin) = recording(&folder, &format!("record --stdin --out {out}"));
        stdin.write_all(&bytes).expect("it reads");
        wait_for(&folder, &format!("{out}/telemetry.bin"), |written| written == bytes);
        let has_two_lines = |written: &[u8]| written.iter().filter(|byte| **byte == b'\n').count() == 2;
        wait_for(&folder, &format!("{out}/anchors.csv"), has_two_lines);
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).expect("it runs");
        let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).expect("the greatest memory");
        let peak_kb: u64 = peak.trim().trim_end_matches(" kB").parse().expect("a number");
        drop(stdin);
        assert!(child.wait().expect("it ends").success());
        let rows = String::from_utf8(folder.read(&format!("{out}/ranges.csv"))).expect("UTF-8");
        assert_eq!(rows.lines().count() as u64, ranges + 1);
        peak_kb
    };
    let (short_kb, long_kb) = (peak_kb(400, "short"), peak_kb(40_000, "long"));
    // A waiting range once took 875 bytes, and all of them 35 MB.
    assert!(long_kb < short_kb + 17_500, "{long_kb} kB; the program by itself {short_kb} kB");
}

/// Needs the right to mount.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_keeps_what_was_recorded_so_far() {
    let folder = Folder::with(&[]);
    folder.write("long.bin", &ranges_without_position(4000));
    // A file system of 64 kB, in name spaces of its own.
    let script = format!(
        "mkdir small && mount -t tmpfs -o size=64k tmpfs small || exit 77; {} record --file long.bin --out small/rec; \
         code=$?; cp small/rec/telemetry.bin kept.bin; exit $code",
        env!("CARGO_BIN_EXE_baliza")
    );
    let mut command = std::process::Command::new("unshare");
    command.args(["--map-root-user", "--mount", "sh", "-c", &script]).current_dir(folder.path("."));
    let Ok(output) = command.output() else { return };
    let said = String::from_utf8(output.stderr).expect("UTF-8");
    if output.status.code() != Some(1) || said.contains("unshare") {
        assert!(output.status.code() == Some(77) || said.contains("unshare"), "{:?}: {said}", output.status);
        eprintln!("no right to mount: not tested");
        return;
    }
    assert!(
        said.starts_with(
            "baliza: cannot write the recording; what came before stays in small/rec, and `record --finish`"
        ),
        "{said}"
    );
    assert!(said.trim_end().ends_with("No space left on device (os error 28)"), "{said}");
    let kept = folder.read("kept.bin");
    assert!(kept.len() >= 16_000 && folder.read("long.bin").starts_with(&kept), "{} bytes", kept.len());
}

#[test]
fn what_is_recorded_is_solved_to_what_the_tag_found() {
    let folder = walk_folder();
    let run = folder.run("record --file walk.bin --out walk").ok();
    assert!(run.stderr.contains(" to 6 anchors, ") && run.stdout.is_empty(), "{run:?}");
    assert_eq!(folder.read("walk/telemetry.bin"), folder.read("walk.bin"));
    let decoded = folder.run("decode --file walk --format csv").ok();
    assert_eq!(folder.read("walk/positions.csv"), decoded.stdout.as_bytes());
    let rssi = folder.run("decode --file walk --format csv --table rssi").ok();
    assert_eq!(folder.read("walk/rssi.csv"), rssi.stdout.as_bytes());
    let files = "--anchors walk/anchors.csv --ranges walk/ranges.csv";
    let solved = folder.run(&format!("solve {files} --dims 2 --height-m 1.2 --method nls")).ok();
    // The tag solves the same ranges with the same code. The wire format and the files have four decimals.
    let by_epoch = |run: &Run| -> BTreeMap<String, [f64; 2]> {
        let epochs = run.column("epoch").into_iter().map(str::to_owned);
        epochs.zip(run.numbers("x_m").into_iter().zip(run.numbers("y_m")).map(|(x, y)| [x, y])).collect()
    };
    let (tag, host) = (by_epoch(&decoded), by_epoch(&solved));
    let near = |epoch: &str| {
        let (tag, host) = (tag[epoch], host[epoch]);
        tag.iter().zip(host).all(|(tag, host)| (tag - host).abs() < 0.005)
    };
    let found: Vec<_> = tag.iter().filter(|(_, place)| place[0].is_finite()).map(|(epoch, _)| epoch).collect();
    assert!(found.len() >= 15 && found.iter().all(|epoch| near(epoch)), "{tag:?}\n{host:?}");
}

#[test]
fn ranges_to_anchors_of_unknown_position_are_left_out_unless_the_user_gives_it() {
    let mut messages = walk();
    let peers: Vec<u16> =
        messages.iter().filter_map(|m| if let Message::Range(r) = m { Some(r.peer) } else { None }).collect();
    let silent = peers[0];
    let late = *peers.iter().find(|peer| **peer != silent).expect("several anchors");
    // One anchor never reports its position, and one does not report it in its first range.
    let mut late_ranges = 0;
    for message in &mut messages {
        let Message::Range(range) = message else { continue };
        late_ranges += u32::from(range.peer == late);
        if range.peer == silent || range.peer == late && late_ranges == 1 {
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

/// The stream has not ended, but the user stops the recording.
#[cfg(unix)]
#[test]
fn ctrl_c_ends_a_recording_with_its_files() {
    let folder = walk_folder();
    let mut command = folder.command("record --stdin --out walk");
    let mut child = command.stdin(Stdio::piped()).stderr(Stdio::null()).spawn().expect("baliza runs");
    let mut stdin = child.stdin.take().expect("piped");
    stdin.write_all(&folder.read("walk.bin")).expect("it reads");
    let bytes = folder.read("walk.bin");
    wait_for(&folder, "walk/telemetry.bin", |written| written == bytes);
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().expect("kill runs").success());
    assert!(child.wait().expect("it ends").success());
    assert_eq!(folder.read("walk/telemetry.bin"), folder.read("walk.bin"));
    let decoded = folder.run("decode --file walk.bin --format csv").ok();
    assert_eq!(folder.read("walk/positions.csv"), decoded.stdout.as_bytes());
}
