//! Positions as CSV, JSON lines and Parquet: the same columns and values.

use std::fs::File;

use parquet::basic::{LogicalType, Type as Physical};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::record::Field;
use serde_json::{Value, json};

use crate::schema_check;
use crate::support::Folder;

/// Columns of text. Those of all other names hold numbers.
const TEXTS: [&str; 5] = ["epoch", "method", "reason", "flag", "tag"];

/// Four anchors around the tag at (3, 4), as far as the ranges say; epoch 8 has too few ranges.
fn folder() -> Folder {
    Folder::with(&[
        ("anchors.csv", "anchor,x_m,y_m,z_m\na,0,0,0\nb,3,0,0\nc,0,4,0\nd,6,8,0\n"),
        ("ranges.csv", "epoch,t_s,anchor,range_m\n7,0.5,a,5\n7,0.5,b,4\n7,0.5,c,3\n7,0.5,d,5\n8,,a,5\n"),
    ])
}

/// The header and the rows of a file of CSV.
fn csv(folder: &Folder, name: &str) -> (Vec<String>, Vec<Vec<String>>) {
    let bytes = folder.read(name);
    let mut reader = csv::Reader::from_reader(bytes.as_slice());
    let texts = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect::<Vec<_>>();
    let header = texts(reader.headers().expect("a header"));
    (header, reader.records().map(|record| texts(&record.expect("a row"))).collect())
}

/// The objects of JSON lines, which agree with their schema.
fn jsonl(text: &[u8]) -> Vec<Value> {
    let text = std::str::from_utf8(text).expect("UTF-8");
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    schema_check::check_positions(&lines);
    lines
}

fn parquet(folder: &Folder, name: &str) -> SerializedFileReader<File> {
    SerializedFileReader::new(File::open(folder.path(name)).expect("a file")).expect("a file of Parquet")
}

/// The field of CSV that has a value of Parquet.
fn text_of(field: &Field) -> String {
    match field {
        Field::Null => String::new(),
        Field::Str(text) => text.clone(),
        Field::Long(count) => count.to_string(),
        Field::Double(number) => number.to_string(),
        other => panic!("{other:?} in a file of positions"),
    }
}

#[test]
fn the_three_formats_have_the_same_columns_and_values() {
    let folder = folder();
    folder.run("example --out room").ok();
    // Two tags: the second has no position.
    folder.write("tags.csv", b"epoch,t_s,anchor,range_m,tag\n1,0,a,5,x\n1,0,b,4,x\n1,0,c,3,x\n1,0,d,5,x\n1,0,a,5,y\n");
    folder.write("beacons.csv", b"beacon,x_m,y_m\nA,0,0\nB,6,0\nC,0,6\n");
    let stays = "point,x_m,y_m,beacon,rssi_dbm,t_s\np,1,1,A,-60,0\np,1,1,B,-75,0.1\np,1,1,C,-75,0.2\n\
                 q,5,1,A,-74,0\nq,5,1,B,-60,0.1\nq,5,1,C,-78,0.2\n";
    folder.write("stays.csv", stays.as_bytes());
    let room = "--anchors room/anchors.csv --ranges room/ranges.csv --truth room/truth.csv";
    for (command, more) in [
        ("solve --anchors anchors.csv --ranges ranges.csv --dims 2 --method all".to_owned(), [].as_slice()),
        ("solve --anchors anchors.csv --ranges tags.csv --dims 2".to_owned(), &["tag"]),
        (format!("solve {room}"), &["error_m", "cov_xz_m2"]),
        (format!("track {room}"), &["error_m", "cov_xz_m2", "vx_m_s", "vz_m_s"]),
        ("ble solve --beacons beacons.csv --rssi stays.csv".to_owned(), &["error_m"]),
        ("ble fingerprint --fingerprints stays.csv --targets stays.csv".to_owned(), &["error_m"]),
    ] {
        for format in ["csv", "jsonl", "parquet"] {
            folder.run(&format!("{command} --out p.{format}")).ok();
        }
        let (header, rows) = csv(&folder, "p.csv");
        assert!(!rows.is_empty() && more.iter().all(|column| header.iter().any(|name| name == column)), "{header:?}");
        let lines = jsonl(&folder.read("p.jsonl"));
        let parquet: Vec<_> = parquet(&folder, "p.parquet").into_iter().map(|row| row.expect("a row")).collect();
        assert_eq!((lines.len(), parquet.len()), (rows.len(), rows.len()), "{command}");
        for ((row, line), stored) in rows.iter().zip(&lines).zip(parquet) {
            let keys: Vec<_> = line.as_object().expect("an object").keys().collect();
            assert_eq!(keys, header.iter().collect::<Vec<_>>(), "{command}");
            let stored = stored.into_columns();
            assert_eq!(stored.iter().map(|(name, _)| name).collect::<Vec<_>>(), keys, "{command}");
            for ((name, text), (_, field)) in header.iter().zip(row).zip(&stored) {
                let expected: Value = match text.as_str() {
                    "" => Value::Null,
                    text if TEXTS.contains(&name.as_str()) => text.into(),
                    text if name == "used" => text.parse::<u64>().expect("a count").into(),
                    text => text.parse::<f64>().expect("a number").into(),
                };
                assert_eq!(line[name], expected, "{command}: {name}");
                match expected.as_f64() {
                    Some(number) => assert_eq!(text_of(field).parse(), Ok(number), "{command}: {name}"),
                    None => assert_eq!(&text_of(field), text, "{command}: {name}"),
                }
            }
        }
    }
}

#[test]
fn numbers_are_numbers_and_what_is_unknown_is_null() {
    let folder = folder();
    let solve = "solve --anchors anchors.csv --ranges ranges.csv --dims 2 --method nls";
    let lines = jsonl(folder.run(&format!("{solve} --format jsonl")).ok().stdout.as_bytes());
    let of = |line: &Value, keys: [&str; 8]| Value::from(keys.map(|key| line[key].clone()).to_vec());
    let keys = ["epoch", "t_s", "method", "x_m", "y_m", "z_m", "used", "reason"];
    assert_eq!(of(&lines[0], keys), json!(["7", 0.5, "nls", 3.0, 4.0, null, 4, null]));
    assert_eq!(of(&lines[1], keys), json!(["8", null, "nls", null, null, null, null, "too-few-anchors"]));

    folder.run(&format!("{solve} --out p.parquet")).ok();
    let reader = parquet(&folder, "p.parquet");
    let columns = reader.metadata().file_metadata().schema_descr().columns();
    for column in columns {
        let expected = match column.name() {
            "used" | "epoch" => (Physical::INT64, None),
            name if TEXTS.contains(&name) => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            _ => (Physical::DOUBLE, None),
        };
        let found = (column.physical_type(), column.logical_type_ref().cloned());
        assert_eq!(found, expected, "{}", column.name());
    }
    let about = reader.metadata().file_metadata().key_value_metadata().expect("metadata").clone();
    let about: Vec<_> = about.iter().map(|of| (of.key.as_str(), of.value.as_deref().unwrap_or(""))).collect();
    let [("baliza.version", version), ("baliza.command", command), ("baliza.units", units)] = about[..] else {
        panic!("{about:?}")
    };
    assert_eq!(folder.run("--version").stdout, format!("baliza {version}\n"));
    assert_eq!(command, format!("baliza {solve} --out p.parquet"));
    assert!(units.starts_with("t_s: s, x_m: m, ") && units.ends_with("cov_xy_m2: m²"), "{units}");
    let rows: Vec<_> = reader.into_iter().map(|row| row.expect("a row").into_columns()).collect();
    let field = |row: usize, name: &str| rows[row].iter().find(|(key, _)| key == name).expect("the column").1.clone();
    assert_eq!(field(0, "x_m"), Field::Double(3.0));
    assert_eq!((field(0, "used"), field(0, "epoch")), (Field::Long(4), Field::Long(7)));
    assert_eq!((field(1, "x_m"), field(1, "reason")), (Field::Null, Field::Str("too-few-anchors".to_owned())));
    // Where one name is no number, or another spelling of one, all are texts.
    for name in ["walk", "08"] {
        folder.write("named.csv", format!("epoch,t_s,anchor,range_m\n7,0.5,a,5\n{name},,a,5\n").as_bytes());
        folder.run("solve --anchors anchors.csv --ranges named.csv --dims 2 --out named.parquet");
        let epoch = parquet(&folder, "named.parquet").metadata().file_metadata().schema_descr().column(0);
        assert_eq!((epoch.name(), epoch.physical_type()), ("epoch", Physical::BYTE_ARRAY), "{name}");
    }
}

#[test]
fn the_format_is_that_of_the_flag_else_of_the_files_ending_else_csv() {
    let folder = folder();
    let solve = "solve --anchors anchors.csv --ranges ranges.csv --dims 2";
    let csv = folder.run(solve).ok().stdout;
    let jsonl = folder.run(&format!("{solve} --format jsonl")).ok().stdout;
    assert!(csv.starts_with("epoch,t_s,") && jsonl.starts_with("{\"epoch\":\"7\","), "{csv}{jsonl}");
    for (more, file, expected) in [
        ("", "p.CSV", &csv),
        ("", "p.txt", &csv),
        ("", "p", &csv),
        ("", "p.jsonl", &jsonl),
        ("--format csv", "p.parquet", &csv),
        ("--format jsonl", "p.csv", &jsonl),
    ] {
        folder.run(&format!("{solve} {more} --out {file}")).ok();
        assert_eq!(&String::from_utf8(folder.read(file)).expect("text"), expected, "{more} {file}");
    }
    folder.run(&format!("{solve} --format parquet --out p.bin")).ok();
    assert!(folder.read("p.bin").starts_with(b"PAR1"));
}

#[test]
fn parquet_needs_a_file() {
    let folder = folder();
    let said = "--format: parquet is binary: say with --out to which file it goes\n";
    for more in ["", "--out -", "--json"] {
        let solve = format!("solve --anchors anchors.csv --ranges ranges.csv --dims 2 --format parquet {more}");
        let run = folder.run(&solve);
        assert_eq!((run.code, run.stderr.as_str()), (Some(2), said));
        assert_eq!(run.stdout.is_empty(), more != "--json", "{}", run.stdout);
    }
}
