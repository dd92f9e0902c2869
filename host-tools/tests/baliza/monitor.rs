//! `baliza monitor` on files and standard input: the log and telemetry together, wrong and missing ELF files, damaged
//! streams.

use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::support::{Folder, Run};

#[path = "../../node-link/src/monitor/testing.rs"]
pub mod testing;

use testing::{BUILD, OTHER_BUILD, elf, fix, frame, hello, telemetry_frame};

/// A node's first second: its log and its telemetry.
fn streams(build: [u8; 8]) -> (Vec<u8>, Vec<u8>) {
    let log = [frame(1, 50, &[1]), frame(2, 400_000, b"\x03\0\0\0tag\x01"), frame(1, 900_000, &[2])].concat();
    let telemetry = [
        telemetry_frame(&hello(100, build)),
        telemetry_frame(&fix(500_000, 3.21)),
        telemetry_frame(&fix(1_000_000, 3.25)),
    ]
    .concat();
    (log, telemetry)
}

/// The streams as an ESP image sends them, after its boot loader.
fn mixture() -> Vec<u8> {
    let announced = |frame: Vec<u8>| [vec![0xFF, 0], frame].concat();
    let parts = [
        b"ESP-ROM:esp32c3-api1-20210207\r\nrst:0x1 (POWERON)\r\n".to_vec(),
        announced([vec![0], frame(1, 50, &[1])].concat()),
        telemetry_frame(&hello(100, BUILD)),
        telemetry_frame(&fix(500_000, 3.21)),
        announced(frame(2, 400_000, b"\x03\0\0\0tag\x01")),
        telemetry_frame(&fix(1_000_000, 3.25)),
    ];
    parts.concat()
}

fn folder() -> Folder {
    let folder = Folder::with(&[]);
    let (log, telemetry) = streams(BUILD);
    folder.write("log.bin", &log);
    folder.write("telemetry.bin", &telemetry);
    folder.write("mixture.bin", &mixture());
    folder.write("image.elf", &elf(Some(BUILD)));
    folder.write("other.elf", &elf(Some(OTHER_BUILD)));
    folder
}

/// Runs with standard input.
fn piped(folder: &Folder, arguments: &str, input: &[u8]) -> Run {
    let mut command = folder.command(arguments);
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    child.stdin.take().expect("a pipe").write_all(input).expect("written");
    let output = child.wait_with_output().expect("baliza ends");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

const HELLO: &str = "     0.000100 hello tag 0x1234 on dwm1001, EUI deca000000001234, build 1a2b3c4d5e6f7081\n";
const FIXES: [&str; 2] = [
    "     0.500000 fix   x=3.21 y=4.05 z=1.50 (given) ±0.05 m, 6 anchors, 12 ms, b-wls\n",
    "     1.000000 fix   x=3.25 y=4.05 z=1.50 (given) ±0.05 m, 6 anchors, 12 ms, b-wls\n",
];
const LOG: [&str; 3] =
    ["     0.000050 INFO  hello 1\n", "     0.400000 WARN  tag is true\n", "     0.900000 INFO  hello 2\n"];

#[test]
fn log_and_telemetry_of_two_files_are_one_text() {
    let run = folder().run("monitor --file telemetry.bin --defmt-file log.bin --elf image.elf").ok();
    assert_eq!(run.stdout, [HELLO, FIXES[0], FIXES[1], LOG[0], LOG[1], LOG[2]].concat());
    assert!(
        run.stderr.ends_with(" s: 2 fixes, 0 rounds without one, 1 other messages, 3 lines of the log\n"),
        "{run:?}"
    );
    assert_eq!(run.stderr.lines().count(), 1, "{run:?}");
}

#[test]
fn a_serial_mixture_comes_apart_from_a_file_or_a_pipe() {
    let folder = folder();
    let boot = "              boot  ESP-ROM:esp32c3-api1-20210207\n              boot  rst:0x1 (POWERON)\n";
    let expected = [boot, LOG[0], HELLO, FIXES[0], LOG[1], FIXES[1]].concat();
    assert_eq!(folder.run("monitor --file mixture.bin --elf image.elf").ok().stdout, expected);
    assert_eq!(piped(&folder, "monitor --stdin --elf image.elf", &mixture()).ok().stdout, expected);
}

#[test]
fn without_an_elf_file_telemetry_is_shown_and_a_hint() {
    let folder = folder();
    // Images are looked for beside the program, too, and the one that is tested may have some. A link needs its file system.
    let alone = tempfile::TempDir::new_in(env!("CARGO_TARGET_TMPDIR")).expect("a temporary folder");
    std::fs::create_dir(alone.path().join("bin")).expect("a folder");
    let program = alone.path().join("bin/baliza");
    std::fs::hard_link(env!("CARGO_BIN_EXE_baliza"), &program).expect("a link");
    let run = folder.run_by(&program, "monitor --file mixture.bin").ok();
    assert!(run.stdout.ends_with(&[HELLO, FIXES[0], FIXES[1]].concat()), "{run:?}");
    let hint = "the node writes a log as well: --elf FILE, the ELF file that was flashed, shows it";
    assert_eq!(run.stderr.lines().next(), Some(hint));
    assert!(run.stderr.contains(", 2 frames of the log not decodable"), "{run:?}");
}

#[test]
fn a_wrong_elf_file_is_reported_in_one_sentence_with_both_builds() {
    let run = folder().run("monitor --file telemetry.bin --defmt-file log.bin --elf other.elf").ok();
    let unreadable = "              log   [defmt text not decodable]\n";
    assert_eq!(run.stdout, [HELLO, FIXES[0], FIXES[1], unreadable].concat());
    let sentence = "the node runs build 1a2b3c4d5e6f7081, the ELF file other.elf is 3c4d000000000001: flash it, or give the ELF \
                    that was flashed";
    assert_eq!(run.stderr.lines().next(), Some(sentence));
    assert!(run.stderr.contains(", 3 frames of the log not decodable"), "{run:?}");
}

#[test]
fn of_several_elf_files_that_of_the_nodes_build_is_taken() {
    let folder = folder();
    let text = [HELLO, FIXES[0], FIXES[1], LOG[0], LOG[1], LOG[2]].concat();
    for images in ["target/firmware", "images"] {
        std::fs::create_dir_all(folder.path(images)).expect("a folder");
        folder.write(&format!("{images}/anchor-dwm1001.elf"), &elf(Some(OTHER_BUILD)));
        folder.write(&format!("{images}/broken.elf"), b"ELF?");
        let none = folder.run(&format!("monitor --file telemetry.bin --defmt-file log.bin --elf {images}")).ok();
        let said = format!(
            "the node runs build 1a2b3c4d5e6f7081, {images} has anchor-dwm1001.elf 3c4d000000000001: flash one, or give --elf \
             the ELF that was flashed"
        );
        assert_eq!(none.stderr.lines().next(), Some(said.as_str()));
        folder.write(&format!("{images}/tag-dwm1001-ble.elf"), &elf(Some(BUILD)));
        let run = folder.run(&format!("monitor --file telemetry.bin --defmt-file log.bin --elf {images}")).ok();
        assert_eq!(run.stdout, text);
        let said = format!("the node runs build 1a2b3c4d5e6f7081, which is {images}/tag-dwm1001-ble.elf");
        assert_eq!(run.stderr.lines().next(), Some(said.as_str()));
    }
    // Without --elf, it looks where `cargo xtask firmware` puts images.
    let run = folder.run("monitor --file mixture.bin").ok();
    assert!(run.stdout.contains(LOG[1]), "{run:?}");
    // Telemetry without a log needs no image.
    let run = folder.run("monitor --file telemetry.bin").ok();
    assert_eq!((run.stdout, run.stderr.lines().count()), ([HELLO, FIXES[0], FIXES[1]].concat(), 1));
}

#[test]
fn json_lines_are_those_of_decode_and_the_log() {
    let folder = folder();
    let run = folder.run("monitor --file telemetry.bin --defmt-file log.bin --elf image.elf --format jsonl").ok();
    let lines: Vec<serde_json::Value> =
        run.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let kinds: Vec<_> = lines.iter().map(|line| line["type"].as_str().expect("a type")).collect();
    assert_eq!(kinds, ["hello", "fix", "fix", "log", "log", "log"]);
    let line = serde_json::json!({"type": "log", "t_s": 0.4, "level": "warn", "text": "tag is true", "file": null, "line": null});
    assert_eq!(lines[4], line);
    let decoded = folder.run("decode --file telemetry.bin").ok();
    let messages: Vec<_> = run.stdout.lines().filter(|line| !line.contains("\"log\"")).collect();
    assert_eq!(messages, decoded.stdout.lines().collect::<Vec<_>>());
}

#[test]
fn csv_and_a_recording_are_those_of_decode_and_record() {
    let folder = folder();
    let run = folder.run("monitor --file mixture.bin --elf image.elf --format csv --record walk").ok();
    assert_eq!(run.stdout, folder.run("decode --file telemetry.bin --format csv").ok().stdout);
    assert_eq!(run.numbers("x_m"), [3.21, 3.25]);
    assert_eq!(folder.read("walk/telemetry.bin"), folder.read("telemetry.bin"));
    assert_eq!(folder.run("monitor --file walk").ok().stdout, [HELLO, FIXES[0], FIXES[1]].concat());
}

#[test]
fn spoilt_streams_are_counted_and_what_is_whole_is_shown() {
    let folder = folder();
    let mut random = Pcg64::seed_from_u64(4);
    let good: Vec<u8> = mixture().repeat(300);
    let mut flipped = good.clone();
    flipped.iter_mut().for_each(|byte| {
        if random.random_bool(0.01) {
            *byte ^= 1 << random.random_range(0..8);
        }
    });
    let noise: Vec<u8> = (0..100_000).map(|_| random.random()).collect();
    folder.write("flipped.bin", &flipped);
    folder.write("noise.bin", &noise);

    let whole = |file: &str| {
        let run = folder.run(&format!("monitor --file {file} --elf image.elf --format jsonl")).ok();
        run.stdout.lines().filter(|line| line.contains(r#""type":"fix""#)).count()
    };
    folder.write("good.bin", &good);
    assert_eq!(whole("good.bin"), 600);
    // A frame of about 40 bytes is damaged with a probability of one third, by itself or by the bytes before it.
    let count = whole("flipped.bin");
    assert!((300..=540).contains(&count), "{count}");
    let run = folder.run("monitor --file flipped.bin --elf image.elf").ok();
    assert!(
        run.stderr.contains("malformed frames of the log") && run.stderr.contains("malformed telemetry frames"),
        "{run:?}"
    );
    let run = folder.run("monitor --file noise.bin --elf image.elf");
    assert_eq!(run.code, Some(2));
    assert_eq!(run.stderr, "noise.bin: this is no telemetry, and no log: there is no frame in it\n");
}

#[test]
fn it_ends_after_so_many_positions_or_seconds() {
    let folder = folder();
    let run = folder.run("monitor --file telemetry.bin --fixes 1").ok();
    assert_eq!(run.stdout, [HELLO, FIXES[0]].concat());

    // A pipe that stays open, without bytes.
    let mut command = folder.command("monitor --stdin --seconds 0.3");
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let mut pipe = child.stdin.take().expect("a pipe");
    pipe.write_all(&streams(BUILD).1).expect("written");
    // The time may be over before a busy computer has read all.
    let output = child.wait_with_output().expect("baliza ends");
    let shown = String::from_utf8(output.stdout).expect("UTF-8");
    assert!(output.status.success() && [HELLO, FIXES[0], FIXES[1]].concat().starts_with(&shown), "{shown}");
    drop(pipe);
}

#[test]
#[cfg(unix)]
fn ctrl_c_ends_it_cleanly_with_the_count() {
    let folder = folder();
    let mut command = folder.command("monitor --stdin");
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let mut pipe = child.stdin.take().expect("a pipe");
    pipe.write_all(&streams(BUILD).1).expect("written");
    // The program prints a line when it listens.
    let mut first = [0; 10];
    std::io::Read::read_exact(child.stdout.as_mut().expect("a pipe"), &mut first).expect("a line");
    let killed =
        std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(killed.success());
    let output = child.wait_with_output().expect("baliza ends");
    let said = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!((output.status.code(), said.contains(" s: 2 fixes, ")), (Some(0), true), "{said}");
    drop(pipe);
}

#[test]
#[cfg(unix)]
fn a_serial_port_is_read_and_its_loss_is_reported() {
    use serialport::{SerialPort, TTYPort};

    // The two ends of a pseudo terminal: one for the test, and one that the program opens by name.
    let (ours, theirs) = TTYPort::pair().expect("a pseudo terminal");
    // Unlike the original, the copy is not inherited by the program, which would hold it open.
    let mut copy = ours.try_clone_native().expect("a copy");
    drop(ours);
    let name = theirs.name().expect("it has a name");
    let folder = folder();
    let mut command = folder.command(&format!("monitor --serial {name} --baud 115200 --elf image.elf --seconds 600"));
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let mut said = BufReader::new(child.stderr.take().expect("a pipe")).lines();
    let mut next = move || said.next().expect("a line").expect("UTF-8");
    assert_eq!(next(), format!("connected to {name}"));
    copy.write_all(&mixture()).expect("written");
    let mut lines = BufReader::new(child.stdout.take().expect("a pipe")).lines();
    let last =
        lines.find(|line| line.as_ref().is_ok_and(|line| line.contains("x=3.25"))).expect("a fix").expect("UTF-8");
    assert_eq!(last, FIXES[1].trim_end());
    drop((copy, theirs));
    assert!(next().starts_with("connection lost ("));
    let killed =
        std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(killed.success() && child.wait().expect("baliza ends").success());
    assert!(
        next().ends_with(" s: 2 fixes, 0 rounds without one, 1 other messages, 2 lines of the log, 1 lost connections")
    );
}

/// Two lives of a node, in one read of the file.
#[cfg(unix)]
#[test]
fn a_restart_is_reported_in_its_place_among_the_messages() {
    let folder = Folder::with(&[]);
    let life = [telemetry_frame(&fix(5_000_000, 3.21)), telemetry_frame(&fix(9_000_000, 3.25))].concat();
    folder.write("lives.bin", &life.repeat(2));
    let script = format!("{} monitor --file lives.bin 2>&1", env!("CARGO_BIN_EXE_baliza"));
    let output = std::process::Command::new("sh").args(["-c", &script]).current_dir(folder.path(".")).output();
    let text = String::from_utf8(output.expect("sh runs").stdout).expect("UTF-8");
    let lines: Vec<_> = text.lines().map(|line| line.split(" y=").next().unwrap_or_default().trim()).collect();
    let fixes = ["5.000000 fix   x=3.21", "9.000000 fix   x=3.25"];
    assert_eq!(lines[..5], [fixes[0], fixes[1], "the node has restarted", fixes[0], fixes[1]]);
}

#[test]
fn an_error_is_one_line() {
    let folder = folder();
    folder.write("text", b"no ELF file");
    folder.write("plain.elf", &std::fs::read(env!("CARGO_BIN_EXE_baliza")).expect("the program itself")[..]);
    let cases = [
        ("--file nosuch", "nosuch: cannot open it: "),
        ("--file telemetry.bin --elf text", "text: not an ELF file: give the .elf that was flashed"),
        ("--file telemetry.bin --elf plain.elf", "plain.elf: it has no defmt table"),
        ("--file telemetry.bin --elf nosuch", "nosuch: cannot open it: "),
        ("--file telemetry.bin --stdin", "--file"),
        ("--file telemetry.bin --reset", "--reset"),
        ("--defmt-file log.bin", "--file"),
        ("--file telemetry.bin --defmt-file log.bin", "--elf"),
        ("--baud 9600", "--serial"),
        ("--serial /dev/nosuch", "--serial: no port /dev/nosuch: plug in the board"),
        ("--serial /dev/null", "--serial: /dev/null is not a serial port"),
        ("--stdin --seconds -1", "invalid value '-1' for '--seconds <N>': it must be above 0"),
        ("--stdin --seconds soon", "--seconds"),
        ("--stdin --table ranges", "--table: only with --format csv"),
        ("--stdin --fixes 0", "--fixes"),
    ];
    for (arguments, said) in cases {
        let run = folder.run(&format!("monitor {arguments}"));
        assert_eq!(
            (run.code, run.stdout.as_str(), run.stderr.lines().count()),
            (Some(2), "", 1),
            "{arguments}: {run:?}"
        );
        assert!(run.stderr.contains(said), "{arguments}: {run:?}");
    }
}

#[test]
fn a_source_without_a_byte_is_said_in_one_sentence() {
    let said = |arguments: &str| {
        let run = folder().run(arguments);
        (run.code, run.stderr)
    };
    let empty = "standard input: it ended without telemetry and without a log\n".to_owned();
    assert_eq!(said("monitor --stdin"), (Some(2), empty.clone()));
    assert_eq!(piped(&folder(), "monitor --stdin", b"").stderr, empty);
    #[cfg(target_os = "linux")]
    assert_eq!(said("monitor --serial /dev/null"), (Some(2), "--serial: /dev/null is not a serial port\n".to_owned()));
}
