//! `solve` and `track` of ranges in a pipe that stays open: positions come while it does.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write};
use std::process::Stdio;
use std::sync::mpsc::channel;

use crate::support::{Folder, PATIENCE};

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,0\nb,6,0,0\nc,6,8,0\nd,0,8,0\n";
/// Of a tag at (3, 4): 5 m from each corner of 6 by 8 m.
const RANGE_M: f64 = 5.0;

/// The rows of an epoch, and how they begin and end.
fn epoch(number: u32, tag: &str) -> String {
    ["a", "b", "c", "d"].iter().fold(String::new(), |mut rows, anchor| {
        let _ = writeln!(rows, "{number},{},{anchor},{RANGE_M}{tag}", 0.1 * f64::from(number));
        rows
    })
}

#[test]
fn an_open_pipe_gives_the_position_of_each_epoch_when_the_next_one_begins() {
    let folder = Folder::with(&[("anchors.csv", ANCHORS)]);
    for command in ["solve", "track", "track --group-s 0.05"] {
        let mut command = folder.command(&format!("{command} --anchors anchors.csv --ranges - --dims 2"));
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("baliza runs");
        let (mut to, from) = (child.stdin.take().expect("piped"), child.stdout.take().expect("piped"));
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            BufReader::new(from).lines().map_while(Result::ok).all(|line| sender.send(line).is_ok())
        });
        to.write_all(b"epoch,t_s,anchor,range_m\n").expect("written");
        for number in 0..20 {
            to.write_all(epoch(number, "").as_bytes()).expect("written");
        }
        // The pipe is open: what comes now does not wait for its end. Epoch 19 may have more rows.
        let row = || lines.recv_timeout(PATIENCE).expect("a row while the pipe is open");
        assert!(row().starts_with("epoch,t_s,method,x_m,y_m"), "the header");
        let names: Vec<_> = (0..18).map(|_| row().split(',').next().map(str::to_owned)).collect();
        assert_eq!(names, (0..18).map(|number| Some(number.to_string())).collect::<Vec<_>>());
        drop(to);
        let rest: Vec<_> = std::iter::from_fn(|| lines.recv_timeout(PATIENCE).ok()).collect();
        assert_eq!(rest.iter().map(|row| &row[..3]).collect::<Vec<_>>(), ["18,", "19,"]);
        let fields: Vec<_> = rest[1].split(',').collect();
        let [x_m, y_m] = [3, 4].map(|at| fields[at].parse::<f64>().expect("a number"));
        assert!((x_m - 3.0).abs() < 0.05 && (y_m - 4.0).abs() < 0.05, "{rest:?}");
        assert!(child.wait().expect("it ends").success());
    }
}

/// Runs a command with this text in a pipe.
fn run(folder: &Folder, command: &str, text: &str) -> (Option<i32>, String, String) {
    let mut command = folder.command(command);
    let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = child.expect("baliza runs");
    // A program that refuses a line reads no further.
    let _ = child.stdin.take().expect("piped").write_all(text.as_bytes());
    let output = child.wait_with_output().expect("it ends");
    let [stdout, stderr] = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).expect("UTF-8"));
    (output.status.code(), stdout, stderr)
}

#[test]
fn a_pipe_gives_what_a_file_gives() {
    let tags = (0..10).map(|number| epoch(number, ",x") + &epoch(number, ",y")).collect::<String>();
    let truth = "epoch,t_s,x_m,y_m\n0,0,3,4\n1,100,3,4\n";
    let text = "epoch,t_s,anchor,range_m,tag\n".to_owned() + &tags;
    let folder = Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", &text), ("truth.csv", truth)]);
    for command in ["solve", "solve --method nls,lls", "track", "track --format jsonl"] {
        let command = format!("{command} --anchors anchors.csv --dims 2 --truth truth.csv --ranges");
        let sorted = |text: &str| {
            let mut lines: Vec<_> = text.lines().map(str::to_owned).collect();
            lines.sort();
            lines
        };
        // A pipe has columns of flags, as later rows may have one; no row of the file has.
        let without_flags = |line: &str| {
            let line = line.replace(",\"flag\":null,\"alt_x_m\":null,\"alt_y_m\":null", "");
            match line.strip_suffix(",flag,alt_x_m,alt_y_m,tag") {
                Some(columns) => columns.to_owned() + ",tag",
                None => ["x", "y"].into_iter().fold(line.clone(), |line, tag| {
                    let empty = line.strip_suffix(tag).and_then(|row| row.strip_suffix(",,,,"));
                    empty.map_or(line.clone(), |row| format!("{row},{tag}"))
                }),
            }
        };
        let by_file = folder.run(&format!("{command} ranges.csv")).ok();
        let (code, by_pipe, said) = run(&folder, &format!("{command} -"), &text);
        // The positions of two tags come as their epochs end.
        let by_pipe: String = by_pipe.lines().map(|line| without_flags(line) + "\n").collect();
        assert_eq!((code, sorted(&by_pipe)), (Some(0), sorted(&by_file.stdout)), "{command}: {said}");
        let positions = by_file.stdout.lines().count() - usize::from(!command.contains("jsonl"));
        assert!(said.starts_with(&format!("{positions} positions, RMSE 0.0")), "{said}");
    }
}

#[test]
fn what_a_pipe_cannot_have_is_refused_with_its_line() {
    let folder = Folder::with(&[("anchors.csv", ANCHORS)]);
    let header = "epoch,t_s,anchor,range_m\n";
    let solve = "solve --anchors anchors.csv --ranges - --dims 2";
    let late = format!("{header}{}{}0,0,a,5\n", epoch(0, ""), epoch(1, ""));
    let (code, _, said) = run(&folder, solve, &late);
    let expected = "standard input:10: epoch \"0\" has ended: in a pipe the rows of an epoch follow each other; sort them, or \
                    give a file\n";
    assert_eq!((code, said.as_str()), (Some(2), expected));
    let (code, rows, said) = run(&folder, solve, &format!("{header}0,0,a,5\n1,0.1,a,5\n"));
    assert_eq!((code, rows.lines().count()), (Some(1), 3), "{said}");
    assert!(said.contains("none of 2 epochs has a position; 2 of them: too-few-anchors"), "{said}");
}
