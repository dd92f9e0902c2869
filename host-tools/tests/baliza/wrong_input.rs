//! Wrong input gives one line of error, exit code 2 and no output.

use std::fs::File;
use std::io::{Seek, SeekFrom, Write};

use crate::limits::in_time;
use crate::support::{Folder, Run};

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,0\nb,3,0,0\nc,0,4,0\n";
const RANGES: &str = "epoch,t_s,anchor,range_m\n7,0.5,a,5\n7,0.5,b,4\n7,0.5,c,3\n";
const TRUTH: &str = "epoch,t_s,x_m,y_m,z_m\n7,0.5,3,4,0\n";
const COMMAND: &str =
    "solve --anchors anchors.csv --ranges ranges.csv --truth truth.csv --dims 2 --out out.csv --plot out.svg";

fn good() -> Folder {
    Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES), ("truth.csv", TRUTH)])
}

/// Asserts that a run was refused with this line.
fn refused(run: &Run, line: &str) {
    assert_eq!((run.code, run.stdout.as_str(), run.stderr.as_str()), (Some(2), "", format!("{line}\n").as_str()));
}

/// Solves with one file replaced. Asserts that this is refused with this line, without output.
fn refuses(file: &str, bytes: impl AsRef<[u8]>, line: &str) {
    let folder = good();
    folder.write(file, bytes.as_ref());
    refused(&folder.run(COMMAND), line);
    assert_eq!(folder.names(), ["anchors.csv", "ranges.csv", "truth.csv"]);
}

#[test]
fn the_files_are_right_before_one_is_made_wrong() {
    let folder = good();
    folder.run(COMMAND).ok();
    assert_eq!(folder.names(), ["anchors.csv", "out.csv", "out.svg", "ranges.csv", "truth.csv"]);
}

#[test]
fn a_header_that_lacks_or_repeats_a_column() {
    refuses(
        "ranges.csv",
        "epoch,t_s,anchor,range\n7,0.5,a,5\n",
        r#"ranges.csv:1: no column range_m in the header "epoch,t_s,anchor,range"; range is near it"#,
    );
    for (header, near) in [
        ("epoch,t_s,anchor,Range_M", "Range_M is near it"),
        ("epoch,t_s,anchor,distance_m", "distance_m is near it"),
        ("# made by hand,,,", "the header must be the first line, without comments"),
    ] {
        let line = format!("ranges.csv:1: no column epoch in the header \"{header}\"; {near}");
        let line = if header.starts_with('#') { line } else { line.replace("column epoch", "column range_m") };
        refuses("ranges.csv", format!("{header}\n7,0.5,a,5\n"), &line);
    }
    let comment = "epoch,t_s,anchor,range_m\n# the second walk\n7,0.5,a,5\n";
    refuses("ranges.csv", comment, "ranges.csv:2: 1 fields where the header has 4; remove the comment: CSV has none");
    refuses("anchors.csv", "anchor,x_m,z_m\na,0,0\n", r#"anchors.csv:1: no column y_m in the header "anchor,x_m,z_m""#);
    refuses("truth.csv", "t_s,x_m,y_m\n0,0,0\n", r#"truth.csv:1: no column epoch in the header "t_s,x_m,y_m""#);
    refuses("anchors.csv", "anchor,x_m,y_m,x_m\na,0,0,0\n", r#"anchors.csv:1: column "x_m" stands twice"#);
}

#[test]
fn a_field_that_is_not_what_its_column_says() {
    let with = |row: &str| format!("{RANGES}{row}\n");
    refuses("ranges.csv", with("7,0.5,a,5.o"), r#"ranges.csv:5: range_m "5.o" is not a number"#);
    refuses("ranges.csv", with("7,0.5,a,nan"), r#"ranges.csv:5: range_m "nan" is not finite"#);
    refuses("ranges.csv", with("7,0.5,a,-inf"), r#"ranges.csv:5: range_m "-inf" is not finite"#);
    refuses("ranges.csv", with("7,0.5,a,1e999"), r#"ranges.csv:5: range_m "1e999" is not finite"#);
    refuses("ranges.csv", with("7,noon,a,5"), r#"ranges.csv:5: t_s "noon" is not a number"#);
    refuses("ranges.csv", with(",0.5,a,5"), "ranges.csv:5: epoch is empty");
    refuses("ranges.csv", with("7,0.5,z,5"), r#"ranges.csv:5: anchor "z" is not in the file of anchors"#);
    refuses("ranges.csv", with("7,0.5,a"), "ranges.csv:5: 3 fields where the header has 4");
    refuses("ranges.csv", with("7,0.5,a,5,6"), "ranges.csv:5: 5 fields where the header has 4");
    refuses("anchors.csv", format!("{ANCHORS}d,,0,0\n"), "anchors.csv:5: x_m is empty");
    refuses("anchors.csv", format!("{ANCHORS}a,9,9,9\n"), r#"anchors.csv:5: anchor "a" stands in line 2 already"#);
    refuses("truth.csv", format!("{TRUTH}7,0.5,3,4,0\n"), r#"truth.csv:3: epoch "7" stands in line 2 already"#);
    let sights = "epoch,t_s,anchor,range_m,los\n7,0.5,a,5,1\n7,0.5,b,4,yes\n";
    refuses("ranges.csv", sights, r#"ranges.csv:3: los "yes" is neither 1 nor 0"#);
}

#[test]
fn lines_are_counted_as_an_editor_counts_them() {
    refuses(
        "ranges.csv",
        RANGES.replace('\n', "\r\n\r\n") + "7,0.5,a,x",
        r#"ranges.csv:9: range_m "x" is not a number"#,
    );
}

#[test]
fn a_file_without_content() {
    refuses("ranges.csv", "", "ranges.csv:1: the file is empty; a header is expected");
    refuses("ranges.csv", "\n\n", "ranges.csv:1: the file is empty; a header is expected");
    refuses("ranges.csv", "epoch,t_s,anchor,range_m\n", "ranges.csv:1: no ranges below the header");
    refuses("anchors.csv", "anchor,x_m,y_m,z_m\n", "anchors.csv:1: no anchors below the header");
    refuses("truth.csv", "epoch,t_s,x_m,y_m,z_m\n", "truth.csv:1: no positions below the header");
}

#[test]
fn a_file_that_is_no_csv() {
    refuses("ranges.csv", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", "ranges.csv:1: not a text file: byte 0x89 is not UTF-8");
    // UTF-16, as a spreadsheet may export.
    let utf16: Vec<u8> = [0xfeff].into_iter().chain(RANGES.encode_utf16()).flat_map(u16::to_le_bytes).collect();
    refuses("ranges.csv", utf16, "ranges.csv:1: not a text file: byte 0xff is not UTF-8");
    refuses(
        "ranges.csv",
        b"epoch,t_s,anchor,range_m\n7,\xff,a,5\n",
        "ranges.csv:2: not a text file: byte 0xff is not UTF-8",
    );
    refuses(
        "ranges.csv",
        format!("{RANGES}7,0.5,\"a,5\n7,0.5,b,4\n"),
        "ranges.csv:5: a quote is not closed on its line",
    );
    refuses("ranges.csv", RANGES.replace('\n', "\r"), "ranges.csv:1: a carriage return within the line");
    refuses(
        "ranges.csv",
        "{\"epoch\": 7}\u{7}\u{1b}[31m\n",
        r#"ranges.csv:1: no column epoch in the header "{\"epoch\": 7}\u{7}\u{1b}[31m""#,
    );
}

#[test]
fn a_line_of_a_terabyte_is_refused_at_once() {
    for head in ["", RANGES, "epoch,t_s,anchor,range_m\n7,0.5,a,\""] {
        let folder = good();
        // A sparse file: very many zeros, after a valid beginning or from the start.
        let mut file = File::create(folder.path("ranges.csv")).expect("a file");
        file.write_all(head.as_bytes()).expect("written");
        file.seek(SeekFrom::Start(1 << 40)).expect("a file system with sparse files");
        file.write_all(b"\n").expect("written");
        drop(file);
        let line = 1 + head.lines().count() - usize::from(!head.is_empty() && !head.ends_with('\n'));
        // To read it whole would take several minutes.
        refused(&in_time(&folder, COMMAND), &format!("ranges.csv:{line}: the line is longer than 65536 bytes"));
    }
}

#[test]
fn a_file_that_cannot_be_opened() {
    let folder = good();
    std::fs::remove_file(folder.path("ranges.csv")).expect("removed");
    let run = folder.run(COMMAND);
    assert!(run.code == Some(2) && run.stderr.starts_with("ranges.csv: cannot open it: "), "{run:?}");
    std::fs::create_dir(folder.path("ranges.csv")).expect("a folder");
    let run = folder.run(COMMAND);
    assert!(run.code == Some(2) && run.stderr.starts_with("ranges.csv"), "{run:?}");
    assert_eq!(run.stderr.lines().count(), 1);
}

#[test]
fn heights_are_missed_only_where_they_are_needed() {
    let flat = "anchor,x_m,y_m\na,0,0\nb,3,0\nc,0,4\n";
    let folder =
        Folder::with(&[("anchors.csv", flat), ("ranges.csv", RANGES), ("truth.csv", "epoch,x_m,y_m\n7,3,4\n")]);
    folder.run("solve --anchors anchors.csv --ranges ranges.csv --dims 2").ok();
    let missing =
        r#"anchors.csv:1: no column z_m in the header "anchor,x_m,y_m"; only --dims 2 without a height needs no z_m"#;
    refused(&folder.run("solve --anchors anchors.csv --ranges ranges.csv"), missing);
    refused(&folder.run("solve --anchors anchors.csv --ranges ranges.csv --dims 2 --height-m 1"), missing);
    folder.write("anchors.csv", b"anchor,x_m,y_m,z_m\na,0,0,0\nb,3,0,\nc,0,4,0\n");
    refused(&folder.run("solve --anchors anchors.csv --ranges ranges.csv"), "anchors.csv:3: z_m is empty");
    folder.write("anchors.csv", ANCHORS.as_bytes());
    let from_truth = "solve --anchors anchors.csv --ranges ranges.csv --dims 2 --truth truth.csv --height-from-truth";
    refused(&folder.run(from_truth), r#"truth.csv:1: no column z_m in the header "epoch,x_m,y_m""#);
}

#[test]
fn an_argument_that_is_wrong_is_named() {
    let cases = [
        ("--method nosuch", "--method"),
        ("--dims 4", "--dims"),
        ("--height-m high", "--height-m"),
        ("--height-m nan", "--height-m"),
        ("--height-m 1 --height-from-truth", "--height-m"),
        ("--dims 3 --height-m 1", "--height-m: only with --dims 2"),
        ("--dims 3 --height-from-truth --truth truth.csv", "--height-from-truth: only with --dims 2"),
        ("--dims 2 --side below", "--side: only with --dims 3"),
        ("--dims 2 --height-from-truth", "--truth"),
        ("--side left", "--side"),
        ("--area 0,0,1", "--area"),
        ("--area 0,0,0,1", "--area"),
        ("--area 0,0,inf,1", "--area"),
        ("--plot picture.gif", "--plot: picture.gif ends in neither .svg nor .png"),
        ("--plot nowhere/picture.svg", "--plot: the folder nowhere does not exist"),
        ("--out nowhere/positions.csv", "--out: the folder nowhere does not exist"),
        ("--out .", "--out: . is a folder"),
        ("--nosuch", "--nosuch"),
    ];
    let folder = good();
    for (arguments, said) in cases {
        let run = folder.run(&format!("solve --anchors anchors.csv --ranges ranges.csv {arguments}"));
        assert_eq!(
            (run.code, run.stdout.as_str(), run.stderr.lines().count()),
            (Some(2), "", 1),
            "{arguments}: {run:?}"
        );
        assert!(run.stderr.contains(said), "{arguments}: {run:?}");
    }
    folder.run("solve --ranges ranges.csv").refused("--anchors");
    folder.run("bench thesis --points none").refused("--points");
}

#[test]
fn an_output_file_is_whole_or_as_it_was() {
    let folder = good();
    folder.write("out.csv", b"what was here before");
    folder.write("ranges.csv", format!("{RANGES}7,0.5,a,x\n").as_bytes());
    assert_eq!(folder.run(COMMAND).code, Some(2));
    assert_eq!(folder.read("out.csv"), b"what was here before");
    folder.write("ranges.csv", RANGES.as_bytes());
    folder.run(COMMAND).ok();
    assert!(folder.read("out.csv").starts_with(b"epoch,t_s,method"));
}

#[test]
#[cfg(target_os = "linux")]
fn what_cannot_be_written_is_another_failure_with_its_cause() {
    let run = good().run("solve --anchors anchors.csv --ranges ranges.csv --dims 2 --out /dev/full");
    assert_eq!(run.code, Some(1));
    assert!(run.stderr.starts_with("baliza: cannot write /dev/full: "), "{run:?}");
}

#[test]
#[cfg(target_os = "linux")]
fn help_that_cannot_be_written_is_a_failure() {
    let full = File::options().write(true).open("/dev/full").expect("/dev/full");
    let folder = good();
    let mut command = folder.command("solve --help");
    let run = command.stdout(full).stderr(std::process::Stdio::piped()).output().expect("it runs");
    let said = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.code() == Some(1) && said.contains("cannot write to standard output"), "{said}");
}
