//! The commands in the documents work as written. Each page has a folder with the files of `examples/`, in which the
//! commands of its code blocks run one after the other. Commands that need a board, and those within sentences, are
//! only parsed: `--help` behind them succeeds where command, flags and values exist.
#![cfg(unix)]

use std::fmt;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::support::{Folder, root};

/// The commands of code blocks that cannot run here, by their beginning, and what they need.
const NOT_RUN: [(&str, &str); 11] = [
    ("baliza flash ", "a board at the probe"),
    ("baliza monitor --chip ", "a board at the probe"),
    ("baliza forward serial:", "a board at the port, and a station; the tests of `forward` run it"),
    ("baliza serve ", "a person who ends it; the tests of `serve` run it"),
    ("baliza live ", "a terminal, and a person; the tests of `live` have both"),
    ("baliza station backup ", "the store of a station; the tests of `station` run it"),
    ("baliza station export ", "the store of a station; the tests of `station` and `maps` run it"),
    ("baliza station restore ", "a back-up; the tests of `station` run it"),
    ("baliza provision --read ", "a board at the probe"),
    ("baliza provision --config site.toml --node anchor-1 --write", "a board at the probe"),
    (
        "baliza survey fingerprints --points examples/flat/points.csv --out ",
        "a tag at the probe, and a person who walks",
    ),
];

/// How the README runs the program out of the repository.
const BY_CARGO: &str = "cargo run --release -p host-tools --bin baliza -- ";

/// A command, and where it stands.
struct Written {
    page: String,
    line: usize,
    text: String,
    /// It is a line of a code block, not a part of a sentence.
    in_block: bool,
}

impl fmt::Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.page, self.line, self.text)
    }
}

impl Written {
    /// Runs the command as a shell does. Returns what went wrong.
    fn run(&self, folder: &Folder) -> Option<String> {
        let program = Path::new(env!("CARGO_BIN_EXE_baliza"));
        let path = program.parent().expect("a folder").display();
        let output = Command::new("sh")
            .args(["-c", &format!("PATH='{path}':\"$PATH\"; {}", self.text)])
            .current_dir(folder.path(""))
            .stdin(Stdio::null())
            .output()
            .expect("a shell");
        let said = String::from_utf8_lossy(&output.stderr);
        (!output.status.success()).then(|| format!("{self}\n    {}: {}", output.status, said.trim_end()))
    }

    /// Has the command parsed only. Returns what is wrong with it.
    fn parse(&self, folder: &Folder) -> Option<String> {
        let text = self.text.split(" #").next().unwrap_or_default();
        let mut words: Vec<&str> = Vec::new();
        for word in text.split_whitespace().skip(1) {
            // An ellipsis stands for the value of a flag, or for whatever else there may be. Of alternatives, the first
            // counts.
            let is_value = words.last().is_some_and(|flag| flag.starts_with("--"));
            if word != "…" || is_value {
                words.push(word.split('|').next().unwrap_or_default());
            }
        }
        let run = folder.run(&format!("{} --help", words.join(" ")));
        (run.code != Some(0)).then(|| format!("{self}\n    {}", run.stderr.trim_end()))
    }
}

/// The commands of a page.
fn commands(page: &Path) -> Vec<Written> {
    let text = fs::read_to_string(page).unwrap_or_else(|error| panic!("{}: {error}", page.display()));
    let name = page.strip_prefix(root()).expect("a page of the repository").display().to_string();
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let (mut all, mut from, mut in_block) = (Vec::new(), 0, false);
    let fences = lines.iter().enumerate().filter(|(_, line)| line.starts_with("```")).map(|(at, _)| at);
    for to in fences.chain([lines.len()]) {
        let found = if in_block { in_code(&lines, from..to) } else { in_sentences(&lines, from..to) };
        all.extend(found.into_iter().map(|(line, text)| Written { page: name.clone(), line, text, in_block }));
        (from, in_block) = (to + 1, !in_block);
    }
    all
}

/// Number and text of the lines of a code block; a line goes on after `\`.
fn in_code(lines: &[&str], block: Range<usize>) -> Vec<(usize, String)> {
    let mut commands: Vec<(usize, String)> = Vec::new();
    let mut goes_on = false;
    for at in block {
        let line = lines[at].strip_prefix("$ ").unwrap_or(lines[at]);
        let part = line.strip_suffix('\\');
        match commands.last_mut() {
            Some((_, command)) if goes_on => command.push_str(part.unwrap_or(line)),
            _ => commands.push((at + 1, part.unwrap_or(line).to_owned())),
        }
        goes_on = part.is_some();
    }
    for (_, command) in &mut commands {
        if let Some(arguments) = command.strip_prefix(BY_CARGO) {
            *command = format!("baliza {arguments}");
        }
    }
    commands
}

/// Line and text of what stands between backticks; it may go on in the next line of its paragraph.
fn in_sentences(lines: &[&str], part: Range<usize>) -> Vec<(usize, String)> {
    let mut spans: Vec<(usize, String)> = Vec::new();
    let mut is_open = false;
    for at in part {
        is_open &= !lines[at].is_empty();
        for (index, piece) in lines[at].split('`').enumerate() {
            is_open ^= index > 0;
            match spans.last_mut() {
                Some((_, span)) if is_open && index == 0 => {
                    span.push(' ');
                    span.push_str(piece);
                }
                _ if is_open => spans.push((at + 1, piece.to_owned())),
                _ => {}
            }
        }
    }
    spans
}

/// README.md and the pages under `docs/`.
fn pages() -> Vec<PathBuf> {
    let documents = files_under(&root().join("docs")).into_iter();
    let mut pages: Vec<_> = documents.filter(|path| path.extension().is_some_and(|end| end == "md")).collect();
    pages.extend(
        ["README.md", "CONTRIBUTING.md", "qa/papers/README.md", "qa/accuracy/README.md", "qa/onchip-bench/README.md"]
            .map(|name| root().join(name)),
    );
    pages.sort();
    pages
}

/// A folder with the files of `examples/`.
fn folder_with_examples() -> Folder {
    let folder = Folder::with(&[]);
    for file in files_under(&root().join("examples")) {
        let to = folder.path(file.strip_prefix(root()).expect("a file of the repository").to_str().expect("UTF-8"));
        fs::create_dir_all(to.parent().expect("a folder")).expect("a folder");
        fs::copy(&file, to).expect("a copy");
    }
    folder
}

fn files_under(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut files: Vec<_> =
        entries.flat_map(|path| if path.is_dir() { files_under(&path) } else { vec![path] }).collect();
    files.sort();
    files
}

/// The names of the chores of `cargo xtask`: the variants of `Chore`, as clap spells them.
fn chores() -> Vec<String> {
    let source = fs::read_to_string(root().join("xtask/src/main.rs")).expect("the chores");
    let (_, variants) = source.split_once("enum Chore {").expect("the chores");
    let variants = variants.split("\n}").next().expect("text").lines().filter_map(|line| line.strip_prefix("    "));
    let names = variants.filter(|line| line.starts_with(char::is_uppercase));
    let name = |line: &str| line.chars().take_while(char::is_ascii_alphanumeric).collect::<String>();
    names.map(name).map(|name| kebab(&name)).collect()
}

fn kebab(name: &str) -> String {
    let mut text = String::new();
    for (at, letter) in name.char_indices() {
        if at > 0 && letter.is_uppercase() {
            text.push('-');
        }
        text.push(letter.to_ascii_lowercase());
    }
    text
}

#[test]
fn the_commands_of_every_page_work_as_written() {
    let chores = chores();
    let (mut wrong, mut needs, mut ran) = (Vec::new(), Vec::new(), 0);
    for page in pages() {
        let mut folder = None;
        for command in commands(&page) {
            let folder = folder.get_or_insert_with(folder_with_examples);
            if let Some(chore) = command.text.strip_prefix("cargo xtask ") {
                let name = chore.split_whitespace().next().unwrap_or_default();
                if !name.starts_with('-') && !chores.iter().any(|chore| chore == name) {
                    wrong.push(format!("{command}\n    cargo xtask has no {name}"));
                }
            } else if command.text.starts_with("baliza ") {
                let not_run = NOT_RUN.iter().find(|(begin, _)| command.text.starts_with(begin));
                needs.extend(not_run.filter(|_| command.in_block).map(|(begin, _)| *begin));
                let is_run = command.in_block && not_run.is_none();
                wrong.extend(if is_run { command.run(folder) } else { command.parse(folder) });
                ran += usize::from(is_run);
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    for (begin, need) in NOT_RUN {
        assert!(needs.contains(&begin), "{begin} ({need}) is on no page");
    }
    assert!(ran >= 25, "only {ran} commands were found");
}

#[test]
fn the_images_that_the_readme_names_are_built() {
    let boards = fs::read_dir(root().join("boards")).expect("boards").map(|board| board.expect("a board").path());
    let manifests = boards.filter_map(|board| fs::read_to_string(board.join("Cargo.toml")).ok());
    // { bin = "tag", board = "dwm1001", features = ["ble"], … } is tag-dwm1001-ble.elf.
    let name = |line: &str| line.split('"').skip(1).step_by(2).collect::<Vec<_>>().join("-");
    let is_image = |line: &&str| line.trim_start().starts_with("{ bin = ");
    let built: Vec<String> =
        manifests.flat_map(|text| text.lines().filter(is_image).map(name).collect::<Vec<_>>()).collect();
    let readme = fs::read_to_string(root().join("README.md")).expect("the page");
    let named: Vec<&str> = readme
        .split(|c: char| c.is_whitespace() || "`(),;".contains(c))
        .filter_map(|word| word.rsplit('/').next()?.strip_suffix(".elf"))
        .filter(|name| !name.is_empty() && !name.starts_with('…'))
        .collect();
    assert!(named.len() > 5, "{named:?}");
    for name in named {
        assert!(
            built.iter().any(|built| built == name),
            "README.md names {name}.elf, which no board builds: {built:?}"
        );
    }
}

#[test]
fn the_page_about_recordings_has_every_reason_why_there_is_no_position() {
    let page = fs::read_to_string(root().join("docs/use/recordings.md")).expect("the page");
    // Where each `as_str` of a reason is.
    for file in [
        "positioning-core/src/fix.rs",
        "positioning-core/src/engine/output.rs",
        "positioning-core/src/ble/fingerprint/mod.rs",
        "host-tools/recording/src/position.rs",
    ] {
        let source = fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
        let (_, arms) = source.split_once("fn as_str").unwrap_or_else(|| panic!("{file}: no reasons"));
        let arms = arms.split("\n    }").next().expect("text").split("=> \"").skip(1);
        let reasons: Vec<&str> = arms.filter_map(|arm| arm.split('"').next()).collect();
        assert!(!reasons.is_empty(), "{file}");
        for reason in reasons {
            assert!(page.contains(&format!("`{reason}`")), "the page lacks {reason} of {file}");
        }
    }
}

#[test]
fn the_files_of_the_flat_are_those_that_the_commands_beside_them_make() {
    let page = root().join("examples/README.md");
    let folder = folder_with_examples();
    let commands: Vec<_> = commands(&page).into_iter().filter(|command| command.in_block).collect();
    assert_eq!(commands.len(), 3);
    let wrong: Vec<_> = commands.iter().filter_map(|command| command.run(&folder)).collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    let flat = root().join("examples/flat");
    let (shipped, made) = (files_under(&flat), files_under(&folder.path("examples/flat")));
    assert_eq!(shipped.len(), made.len(), "{made:?}");
    for (shipped, made) in shipped.iter().zip(made) {
        let is_same = fs::read(shipped).expect("it ships") == fs::read(made).expect("it was made");
        assert!(is_same, "{}: run the commands of examples/README.md again", shipped.display());
    }
}

#[test]
fn the_first_command_of_the_readme_fills_a_screen_at_most() {
    use std::io::Read;
    use std::time::Duration;

    use serialport::{SerialPort, TTYPort};

    let command = commands(&root().join("README.md")).into_iter().find(|command| command.in_block).expect("a command");
    let arguments = command.text.strip_prefix("baliza ").expect("it is baliza").to_owned();
    let folder = Folder::with(&[]);
    let (mut ours, theirs) = TTYPort::pair().expect("a pseudo terminal");
    let terminal = fs::File::options().write(true).open(theirs.name().expect("a name")).expect("opened");
    let mut running = folder.command(&arguments);
    let running = running.stdout(terminal.try_clone().expect("a handle")).stderr(Stdio::piped());
    let running = running.spawn().expect("baliza runs");
    drop(terminal);
    ours.set_timeout(Duration::from_millis(200)).expect("a timeout");
    let reading = std::thread::spawn(move || running.wait_with_output().expect("it ends"));
    let (mut text, mut part) = (Vec::new(), [0; 4096]);
    loop {
        match ours.read(&mut part) {
            Ok(length) => text.extend(&part[..length]),
            Err(_) if reading.is_finished() => break,
            Err(_) => {}
        }
    }
    let output = reading.join().expect("it ends");
    assert!(output.status.success(), "{output:?}");
    let said = String::from_utf8(output.stderr).expect("UTF-8");
    let lines = String::from_utf8(text).expect("UTF-8").lines().count() + said.lines().count();
    assert!((24..=40).contains(&lines), "{lines} lines");
    assert!(folder.path("room.png").is_file(), "{said}");
}
