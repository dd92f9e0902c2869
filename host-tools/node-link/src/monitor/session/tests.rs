//! Tests of a session, event by event.

use std::path::Path;
use std::time::Duration;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use wire::telemetry::Message;

use super::{FindImage, Item, NodeOutput, Session};
use crate::monitor::elf::{Build, Image, SourceLocation};
use crate::monitor::source::{Event, NodeChannel};
use crate::monitor::testing::{BUILD, OTHER_BUILD, elf, fix, frame, hello, telemetry_frame};

const fn ms(milliseconds: u64) -> Duration {
    Duration::from_millis(milliseconds)
}

fn image(build: Option<[u8; 8]>) -> Image {
    Image::parse(Path::new("image.elf"), &elf(build)).expect("an image")
}

fn session(image: Option<Image>, live: bool) -> Session {
    let find =
        |_| Err("the ELF file image.elf is 1a2b3c4d5e6f7081: flash it, or give the ELF that was flashed".to_owned());
    let find: FindImage = Box::new(find);
    let has_image = image.is_some();
    Session::new(image, has_image.then_some(find), live)
}

fn accept(session: &mut Session, now: Duration, event: Event) {
    session.accept(now, event).expect("nothing is recorded");
}

fn log(session: &mut Session, now: Duration, t_us: u64, argument: u8) {
    accept(session, now, Event::Bytes(NodeChannel::Log, frame(1, t_us, &[argument])));
}

fn receive(session: &mut Session, now: Duration, message: &Message) {
    accept(session, now, Event::Bytes(NodeChannel::Telemetry, telemetry_frame(message)));
}

/// The session's output, in short form.
fn output(session: &mut Session, now: Duration) -> Vec<String> {
    let short = |item| match item {
        Item::Node(NodeOutput::Log(line)) => line.text,
        Item::Node(NodeOutput::Message(_, message)) => format!("{} {}", message.kind(), message.t_us()),
        Item::Node(NodeOutput::Text(text)) => text,
        Item::Node(NodeOutput::Unreadable) => "unreadable".into(),
        Item::Note(note) => format!("({note})"),
    };
    std::iter::from_fn(|| session.next(now)).map(short).collect()
}

fn notes(session: &mut Session) -> Vec<String> {
    std::iter::from_fn(|| session.note()).collect()
}

#[test]
fn the_log_waits_for_the_nodes_build_and_the_order_of_arrival_is_kept() {
    let mut session = session(Some(image(Some(BUILD))), true);
    log(&mut session, ms(0), 100, 1);
    receive(&mut session, ms(1), &fix(90, 1.0));
    assert!(output(&mut session, ms(1000)).is_empty());
    receive(&mut session, ms(1500), &hello(200, BUILD));
    log(&mut session, ms(1501), 180, 2);
    assert_eq!(output(&mut session, ms(1501)), ["hello 1", "fix 90", "hello 200", "hello 2"]);
    assert!(notes(&mut session).is_empty());
}

#[test]
fn a_wrong_elf_file_is_reported_in_one_sentence_and_telemetry_goes_on() {
    let mut session = session(Some(image(Some(BUILD))), true);
    log(&mut session, ms(0), 100, 1);
    for round in 0..3 {
        receive(&mut session, ms(1), &hello(200 + round, OTHER_BUILD));
        log(&mut session, ms(2), 300, 2);
    }
    receive(&mut session, ms(3), &fix(400, 1.0));
    assert_eq!(output(&mut session, ms(500)), ["unreadable", "hello 200", "hello 201", "hello 202", "fix 400"]);
    assert_eq!(
        notes(&mut session),
        [
            "the node runs build 3c4d000000000001, the ELF file image.elf is 1a2b3c4d5e6f7081: flash it, or give the ELF that \
          was flashed"
        ]
    );
    assert_eq!((session.counts().log_unreadable, session.counts().log_lines, session.counts().fixes), (4, 0, 1));

    // The node is flashed.
    accept(&mut session, ms(600), Event::Restarted);
    receive(&mut session, ms(601), &hello(1, BUILD));
    log(&mut session, ms(602), 2, 3);
    assert_eq!(output(&mut session, ms(900)), ["(the node has restarted)", "hello 1", "hello 3"]);
}

#[test]
fn an_elf_file_that_was_rebuilt_is_read_again() {
    let newer: FindImage = Box::new(|Build(build)| Ok(image(Some(build))));
    let mut session = Session::new(Some(image(Some(BUILD))), Some(newer), true);
    receive(&mut session, ms(0), &hello(1, OTHER_BUILD));
    log(&mut session, ms(0), 2, 1);
    assert_eq!(output(&mut session, ms(300)), ["hello 1", "hello 1"]);
    assert_eq!(notes(&mut session), ["image.elf was rebuilt, and is the node's again"]);
}

#[test]
fn among_several_elf_files_that_of_the_nodes_build_is_taken() {
    let of_build: FindImage = Box::new(|Build(build)| match build {
        BUILD => Ok(image(Some(BUILD))),
        _ => Err("target/firmware has image.elf 1a2b3c4d5e6f7081".to_owned()),
    });
    let mut session = Session::new(None, Some(of_build), true);
    // Nothing is looked for until there is a log.
    receive(&mut session, ms(0), &hello(1, OTHER_BUILD));
    assert!(notes(&mut session).is_empty());
    log(&mut session, ms(1), 2, 1);
    assert_eq!(output(&mut session, ms(1)), ["hello 1", "unreadable"]);
    let none = "the node runs build 3c4d000000000001, target/firmware has image.elf 1a2b3c4d5e6f7081";
    assert_eq!(notes(&mut session), [none]);
    // Another node: its log comes before its build.
    accept(&mut session, ms(2), Event::Restarted);
    receive(&mut session, ms(3), &hello(1, BUILD));
    log(&mut session, ms(4), 2, 2);
    assert_eq!(output(&mut session, ms(4)), ["(the node has restarted)", "hello 1", "hello 2"]);
    assert_eq!(notes(&mut session), ["the node runs build 1a2b3c4d5e6f7081, which is image.elf"]);

    // A node that does not report its build cannot be read.
    let mut silent = Session::new(None, Some(Box::new(|_| Ok(image(Some(BUILD))))), true);
    log(&mut silent, ms(0), 1, 1);
    assert!(output(&mut silent, ms(2999)).is_empty());
    assert_eq!(output(&mut silent, ms(3000)), ["unreadable"]);
    receive(&mut silent, ms(3500), &hello(1, BUILD));
    log(&mut silent, ms(3501), 2, 3);
    assert_eq!(output(&mut silent, ms(3501)), ["hello 1", "hello 3"]);
}

#[test]
fn the_log_of_a_node_without_hello_is_read_with_the_elf_file() {
    let mut live = session(Some(image(Some(BUILD))), true);
    log(&mut live, ms(0), 1, 1);
    assert!(output(&mut live, ms(2999)).is_empty());
    assert_eq!(output(&mut live, ms(3000)), ["hello 1"]);

    let mut files = session(Some(image(Some(BUILD))), false);
    log(&mut files, ms(0), 1, 1);
    assert!(output(&mut files, ms(60_000)).is_empty());
    accept(&mut files, ms(60_000), Event::End);
    assert_eq!(output(&mut files, ms(60_000)), ["hello 1"]);
}

#[test]
fn a_comparison_with_the_flash_decides_before_hello_comes() {
    let mut same = session(Some(image(Some(BUILD))), true);
    accept(&mut same, ms(0), Event::Connected("chip".into()));
    accept(&mut same, ms(0), Event::Flashed { same: true });
    log(&mut same, ms(0), 1, 1);
    assert_eq!(output(&mut same, ms(200)), ["hello 1"]);

    let mut other = session(Some(image(Some(BUILD))), true);
    accept(&mut other, ms(0), Event::Flashed { same: false });
    log(&mut other, ms(0), 1, 1);
    assert!(output(&mut other, ms(2999)).is_empty());
    assert_eq!(output(&mut other, ms(3000)), ["unreadable"]);
    assert_eq!(
        notes(&mut other),
        [
            "the chip's flash does not hold the ELF file image.elf (build 1a2b3c4d5e6f7081): flash it, or give the ELF that was \
          flashed"
        ]
    );
}

#[test]
fn without_an_elf_file_there_is_a_hint_and_telemetry() {
    let mut session = session(None, true);
    receive(&mut session, ms(0), &hello(1, BUILD));
    log(&mut session, ms(0), 2, 1);
    log(&mut session, ms(0), 3, 1);
    assert_eq!(output(&mut session, ms(200)), ["hello 1"]);
    assert_eq!(
        notes(&mut session),
        ["the node writes a log as well: --elf FILE, the ELF file that was flashed, shows it"]
    );
    assert_eq!(session.counts().log_unreadable, 2);
}

#[test]
fn an_image_without_a_build_is_read_with_a_warning() {
    let mut session = session(Some(image(None)), true);
    log(&mut session, ms(0), 2, 1);
    assert_eq!(output(&mut session, ms(200)), ["hello 1"]);
    assert_eq!(
        notes(&mut session),
        ["image.elf has no build of ours (no section .baliza.build): it cannot be compared with the node's"]
    );
}

#[test]
fn what_a_lost_connection_cuts_is_counted_and_spoils_nothing_after_it() {
    let mut session = session(Some(image(Some(BUILD))), true);
    accept(&mut session, ms(0), Event::Connected("port".into()));
    receive(&mut session, ms(0), &hello(1, BUILD));
    let (line, place) = (frame(1, 5, &[1]), telemetry_frame(&fix(6, 1.0)));
    accept(&mut session, ms(1), Event::Bytes(NodeChannel::Log, line[..4].to_vec()));
    accept(&mut session, ms(1), Event::Bytes(NodeChannel::Telemetry, place[..9].to_vec()));
    accept(&mut session, ms(2), Event::Lost("the cable is gone".into()));
    accept(&mut session, ms(3), Event::Connected("port".into()));
    receive(&mut session, ms(4), &hello(7, BUILD));
    accept(&mut session, ms(5), Event::Bytes(NodeChannel::Log, frame(1, 8, &[2])));
    accept(&mut session, ms(5), Event::Bytes(NodeChannel::Telemetry, place));
    assert_eq!(output(&mut session, ms(300)), ["hello 1", "hello 7", "hello 2", "fix 6"]);
    let counts = session.counts();
    assert_eq!((counts.log_malformed, counts.telemetry.lost_bytes, counts.lost, counts.restarts), (1, 9, 1, 0));
    assert_eq!(
        notes(&mut session),
        [
            "connected to port",
            "connection lost (the cable is gone); trying to connect again until Ctrl-C",
            "connected again to port"
        ]
    );
}

#[test]
fn a_clock_that_falls_back_is_a_restart() {
    let mut session = session(Some(image(Some(BUILD))), false);
    for life in 0..3 {
        receive(&mut session, ms(0), &hello(1000, BUILD));
        log(&mut session, ms(0), 2000, life);
        receive(&mut session, ms(0), &fix(9_000_000, 1.0));
        log(&mut session, ms(0), 9_000_001, life);
    }
    accept(&mut session, ms(0), Event::End);
    let life = |life: u8| ["hello 1000".into(), format!("hello {life}"), "fix 9000000".into(), format!("hello {life}")];
    // Each restart is noted where it is, although all bytes come before all output.
    let restarted = vec!["(the node has restarted)".to_owned()];
    let all = [life(0).to_vec(), restarted.clone(), life(1).to_vec(), restarted, life(2).to_vec()];
    assert_eq!(output(&mut session, ms(0)), all.concat());
    assert_eq!((session.counts().restarts, notes(&mut session).len()), (2, 0));
}

#[test]
fn random_bytes_on_both_channels_are_counted_and_do_no_harm() {
    let mut random = Pcg64::seed_from_u64(3);
    let mut session = session(Some(image(Some(BUILD))), true);
    receive(&mut session, ms(0), &hello(1, BUILD));
    for now in 0..500 {
        for channel in [NodeChannel::Log, NodeChannel::Telemetry] {
            let bytes = (0..200).map(|_| random.random()).collect();
            accept(&mut session, ms(now), Event::Bytes(channel, bytes));
        }
        while session.next(ms(now)).is_some() {}
    }
    let counts = session.counts();
    // One byte in 256 ends a frame: 100 000 bytes give about 390 frames on each channel.
    assert!((300..500).contains(&(counts.log_malformed + counts.log_lines)), "{counts:?}");
    assert!(counts.telemetry.lost_bytes > 90_000 && counts.lost_frames() > 600, "{counts:?}");
    assert_eq!(counts.fixes, 0);
}

#[test]
fn a_line_of_the_log_that_telemetry_has_is_marked_where_there_is_telemetry() {
    let is_marked = |file: &str, telemetry: bool| {
        let mut image = image(None);
        image.places.insert(1, SourceLocation { file: file.into(), line: 1 });
        let mut session = session(Some(image), true);
        if telemetry {
            receive(&mut session, ms(0), &hello(1, BUILD));
        }
        log(&mut session, ms(0), 2, 1);
        let items = std::iter::from_fn(|| session.next(ms(0)));
        items
            .filter_map(
                |item| if let Item::Node(NodeOutput::Log(line)) = item { Some(line.is_in_telemetry) } else { None },
            )
            .collect::<Vec<_>>()
    };
    // The path as the compiler receives it, and as an absolute path.
    for file in ["wire/src/telemetry/log.rs", "/home/ada/baliza/wire/src/telemetry/log.rs"] {
        assert_eq!((is_marked(file, true), is_marked(file, false)), (vec![true], vec![false]));
    }
    assert_eq!(is_marked("firmware-tag/src/lib.rs", true), [false]);
}
