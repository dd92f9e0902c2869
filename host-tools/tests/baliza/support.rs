//! Runs the program in a temporary folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// The longest wait for anything: what takes longer, hangs.
pub const PATIENCE: Duration = Duration::from_secs(180);

/// The results of a run.
#[derive(Debug)]
pub struct Run {
    pub code: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl Run {
    /// Asserts that the run succeeded.
    pub fn ok(self) -> Self {
        assert_eq!(self.code, Some(0), "{self:?}");
        self
    }

    /// Asserts that the run was refused with code 2 and one line, which says this.
    pub fn refused(&self, expected: &str) {
        assert!(self.code == Some(2) && self.stderr.lines().count() == 1, "{self:?}");
        assert!(self.stderr.contains(expected), "{expected:?} is missing: {self:?}");
    }

    /// The JSON document on standard output, which agrees with the schema of its command.
    pub fn document(&self) -> serde_json::Value {
        let document = serde_json::from_str(&self.stdout).expect("one JSON document on standard output");
        crate::schema_check::check(&document);
        document
    }

    /// The results of the JSON document: a list.
    pub fn json(&self) -> serde_json::Value {
        let document = self.document();
        assert_eq!((&document["schema"], document["results"].is_array()), (&1.into(), true), "{document}");
        document["results"].clone()
    }

    /// The only result of the JSON document.
    pub fn object(&self) -> serde_json::Value {
        let results = self.json();
        assert_eq!(results.as_array().map(Vec::len), Some(1), "{results}");
        results[0].clone()
    }

    /// The fields of a column of the CSV on standard output; the column is found by its name.
    pub fn column(&self, name: &str) -> Vec<&str> {
        let mut rows = self.stdout.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let header = rows.next().expect("a header");
        let at = header.iter().position(|column| *column == name).unwrap_or_else(|| panic!("no column {name}"));
        rows.map(|row| row[at]).collect()
    }

    /// The numbers of a column; an empty field is NaN.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        let number = |field: &str| if field.is_empty() { f64::NAN } else { field.parse().expect("a number") };
        self.column(name).into_iter().map(number).collect()
    }
}

/// A table without its columns of flags, the first of which has this index, and in which no row has one. Where rows come
/// one by one there are such columns, as later rows may have a flag; a file has them only where a row does.
pub fn without_flags(table: &str, first: usize) -> String {
    let without = |row: &str| {
        let fields: Vec<_> = row.split(',').collect();
        let (flags, after) = fields[first..].split_at(4);
        assert!([["flag", "alt_x_m", "alt_y_m", "alt_z_m"], [""; 4]].iter().any(|of| flags == *of), "{row}");
        [&fields[..first], after].concat().join(",") + "\n"
    };
    table.lines().map(without).collect()
}

/// Waits until this is true. `what` says what does not come where it stays false.
pub fn wait_until(what: &str, is_right: impl Fn() -> bool) {
    let begun = Instant::now();
    while !is_right() {
        assert!(begun.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A folder with files, where the program runs.
pub struct Folder(TempDir);

impl Folder {
    /// A folder with these files.
    pub fn with(files: &[(&str, &str)]) -> Self {
        let folder = Self(TempDir::new().expect("a temporary folder"));
        for (name, text) in files {
            folder.write(name, text.as_bytes());
        }
        folder
    }

    pub fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).expect("a file in the temporary folder");
    }

    pub fn read(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// The names of all files, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).expect("the temporary folder");
        let mut names: Vec<_> =
            entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("a name in UTF-8")).collect();
        names.sort();
        names
    }

    /// Waits until an output is in progress in the folder: its file or folder has a hidden name.
    pub fn wait_for_temporary(&self) {
        wait_until("no output is begun", || self.names().iter().any(|name| name.starts_with(".baliza-")));
    }

    /// Runs `baliza` with arguments that are separated by blanks.
    pub fn run(&self, arguments: &str) -> Run {
        self.run_by(Path::new(crate::PROGRAM), arguments)
    }

    /// Runs another copy of `baliza`.
    pub fn run_by(&self, program: &Path, arguments: &str) -> Run {
        let output = self.command_of(program, arguments).output().expect("baliza runs");
        let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
        Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    pub fn command(&self, arguments: &str) -> Command {
        self.command_of(Path::new(crate::PROGRAM), arguments)
    }

    fn command_of(&self, program: &Path, arguments: &str) -> Command {
        let mut command = Command::new(program);
        command.args(arguments.split_whitespace()).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }
}

/// The root of the repository.
pub fn root() -> &'static Path {
    let has_lock = |folder: &&Path| folder.join("Cargo.lock").is_file();
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(has_lock).expect("the package is in the repository")
}

/// The recordings that the replays use.
pub const REPLAYED: [&str; 4] =
    ["leiria_128_los_pos1", "leiria_128_nlos_pos1", "leiria_128_move_slow", "cuhk_dynamic_mid"];

/// The folder of a recording that is not part of the project. Prints a message if it is missing.
pub fn recording(name: &str) -> Option<PathBuf> {
    let data = std::env::var_os("BALIZA_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let recording = data.join(name);
    if !recording.is_dir() {
        eprintln!("{name} is not in {}: not replayed", data.display());
        return None;
    }
    Some(recording)
}

/// Replays recordings that are not part of the project with a subcommand, with the tag's height known. Asserts that
/// each epoch has a position, that the root mean square errors, metres, are at most `reach_m`, and the conditions of
/// `check` on the summary. `BALIZA_DATA` gives the folder of the recordings. Without it, they are expected beside the
/// repository.
pub fn replay(subcommand: &str, reach_m: [f64; REPLAYED.len()], check: impl Fn(&str, &serde_json::Value)) {
    for (name, reach) in REPLAYED.into_iter().zip(reach_m) {
        let Some(recording) = recording(name) else { continue };
        let file = |name: &str| recording.join(name).display().to_string();
        let files = format!("{} --ranges {} --truth {}", file("anchors.csv"), file("ranges.csv"), file("truth.csv"));
        let run = Folder::with(&[]).run(&format!("{subcommand} --anchors {files} --dims 2 --height-from-truth --json"));
        let summary = &run.ok().json()[0];
        assert_eq!(summary["epochs"], summary["fixed"], "{name}: {summary}");
        let rmse = summary["rmse_m"].as_f64().expect("a number");
        assert!(rmse <= reach, "{name}: {rmse} m is more than {reach} m");
        check(name, summary);
    }
}

/// Two rooms of three points each: point, room, x in metres, and the RSSI values of two beacons, dBm, which decrease
/// towards the other room.
pub const TWO_ROOMS: [(&str, &str, i32, [i32; 2]); 6] = [
    ("a", "hall", 1, [-52, -80]),
    ("b", "hall", 2, [-56, -77]),
    ("c", "hall", 3, [-60, -74]),
    ("d", "attic", 5, [-74, -61]),
    ("e", "attic", 6, [-78, -57]),
    ("f", "attic", 7, [-81, -53]),
];
