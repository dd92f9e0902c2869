//! `baliza live` in a real terminal: a pseudo-terminal that `script` of util-linux makes.
#![cfg(target_os = "linux")]

use std::fs;
use std::io::Write;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::serve::Station;
use crate::support::{Folder, PATIENCE};

/// The terminal's other screen: on and off.
const OTHER_SCREEN: [&str; 2] = ["\u{1b}[?1049h", "\u{1b}[?1049l"];

/// A text without blanks, and without the sequences that move the cursor and choose colours.
fn without_blanks(text: &str) -> String {
    let mut parts = text.split("\u{1b}[");
    let first = parts.next().unwrap_or_default();
    let after = parts.map(|part| part.find(|c: char| c.is_ascii_alphabetic()).map_or("", |end| &part[end + 1..]));
    let all: String = std::iter::once(first).chain(after).collect();
    all.split_whitespace().collect()
}

/// A run of `baliza live` in a terminal of its own.
struct InTerminal {
    folder: Folder,
    child: Child,
    keys: Option<ChildStdin>,
}

impl InTerminal {
    /// Starts it. None where there is no `script`, which is said; with CI=true that is an error.
    fn start(arguments: &str, environment: &[(&str, &str)]) -> Option<Self> {
        if Command::new("script").arg("--version").stdout(Stdio::null()).status().is_err() {
            assert_ne!(std::env::var("CI").as_deref(), Ok("true"), "script of util-linux is needed");
            let _ = writeln!(std::io::stderr(), "tests of `live` in a terminal are left out: there is no `script`");
            return None;
        }
        let folder = Folder::with(&[]);
        let program = crate::PROGRAM;
        // The inner shell becomes the program, whose number is needed for signals; the outer one says what is left.
        let inner = format!("stty rows 30 cols 120; echo $$ > pid; exec '{program}' live {arguments}");
        let outer = format!("sh -c '{}'; echo \"code $?\"; stty -a", inner.replace('\'', "'\\''"));
        let mut command = Command::new("script");
        command.args(["--quiet", "--flush", "--command", &outer, "screen"]).current_dir(folder.path(""));
        command.env("TERM", "xterm-256color").env_remove("NO_COLOR").envs(environment.iter().copied());
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().expect("script runs");
        let keys = child.stdin.take();
        Some(Self { folder, child, keys })
    }

    /// What was written to the terminal.
    fn written(&self) -> String {
        String::from_utf8_lossy(&fs::read(self.folder.path("screen")).unwrap_or_default()).into_owned()
    }

    /// Waits until this was written. Blanks do not count: those that are on the screen already are not written again.
    fn wait(&self, text: &str) {
        let begun = Instant::now();
        let text = without_blanks(text);
        while !without_blanks(&self.written()).contains(&text) {
            assert!(begun.elapsed() < PATIENCE, "{text:?} did not come: {:?}", self.written());
            thread::sleep(Duration::from_millis(50));
        }
    }

    fn press(&mut self, keys: &str) {
        let stdin = self.keys.as_mut().expect("open");
        stdin.write_all(keys.as_bytes()).and_then(|()| stdin.flush()).expect("the terminal takes keys");
    }

    fn signal(&self, name: &str) {
        let process = fs::read_to_string(self.folder.path("pid")).expect("it has begun");
        let killed = Command::new("kill").args([&format!("-{name}"), process.trim()]).status().expect("kill runs");
        assert!(killed.success());
    }

    /// Asserts that it ends with this code and that the terminal is as before. Returns all that was written.
    fn assert_restored(mut self, code: i32) -> String {
        let begun = Instant::now();
        while self.child.try_wait().expect("a child").is_none() {
            assert!(begun.elapsed() < PATIENCE, "it does not end: {:?}", self.written());
            thread::sleep(Duration::from_millis(50));
        }
        let written = self.written();
        let [on, off] = OTHER_SCREEN.map(|sequence| written.rfind(sequence));
        assert!(on.is_some() && off > on, "{written:?}");
        let after = &written[off.expect("off")..];
        assert!(after.contains(&format!("code {code}")), "{after:?}");
        // Cursor shown, lines with echo again.
        assert!(after.contains("\u{1b}[?25h"), "{after:?}");
        assert!(after.contains(" icanon") && after.contains(" echo ") && !after.contains("-icanon"), "{after:?}");
        written
    }
}

impl Drop for InTerminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[test]
fn tags_are_drawn_and_q_gives_the_terminal_back() {
    let Some(mut live) = InTerminal::start("--simulate", &[]) else { return };
    // A simulated tag in the list, and the anchors' health.
    live.wait("0x1001");
    live.press("\t");
    live.wait("FP-RX dB");
    live.press("?");
    live.wait("zoom in and out");
    live.press("q");
    let written = live.assert_restored(0);
    assert!(written.contains("room 1") && written.contains("\u{1b}[38;5;"), "{written:?}");
}

#[test]
fn signals_give_the_terminal_back() {
    for signal in ["TERM", "HUP", "INT"] {
        let Some(live) = InTerminal::start("--simulate", &[]) else { return };
        live.wait("0x1001");
        live.signal(signal);
        live.assert_restored(0);
    }
}

#[test]
fn a_terminal_that_is_closed_ends_it() {
    let Some(mut live) = InTerminal::start("--simulate", &[]) else { return };
    live.wait("0x1001");
    let process = fs::read_to_string(live.folder.path("pid")).expect("it has begun");
    // The terminal's other end goes away, as with a connection that breaks.
    live.child.kill().and_then(|()| live.child.wait()).expect("script ends");
    let begun = Instant::now();
    // Its parent is gone: nobody may ask for its exit code, so it may stay as a zombie.
    let state = || fs::read_to_string(format!("/proc/{}/stat", process.trim())).unwrap_or_default();
    while !state().is_empty() && !state().contains(") Z ") {
        assert!(begun.elapsed() < PATIENCE, "it goes on without a terminal");
        thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn a_recording_is_played_without_colours_where_none_are_wanted() {
    let folder = Folder::with(&[]);
    folder.run("simulate --tags 1 --seconds 3 --fidelity air --out run --quiet").ok();
    let recording = folder.path("run");
    let arguments = recording.to_str().expect("UTF-8").to_owned();
    let Some(mut live) = InTerminal::start(&arguments, &[("NO_COLOR", "1")]) else { return };
    live.wait("0x1001");
    // What a source says is on the screen, and not across it.
    live.wait("it has ended");
    live.press("q");
    let written = live.assert_restored(0);
    assert!(!written.contains("\u{1b}[38;5;") && !written.contains("\u{1b}[31m"), "{written:?}");
}

#[test]
fn a_running_station_is_shown_by_its_address() {
    let folder = Folder::with(&[]);
    let station = Station::start(&folder, "--simulate");
    let Some(mut live) = InTerminal::start(&format!("--url http://{}", station.address()), &[]) else { return };
    live.wait("0x1001");
    live.wait("room 1");
    // The station may end before.
    station.stop();
    live.wait("no answer of http://");
    live.press("q");
    live.assert_restored(0);
}

#[test]
fn without_a_terminal_it_says_what_to_do() {
    let run = Folder::with(&[]).run("live --simulate");
    run.refused("ssh -t");
    assert_eq!(run.stdout, "");
}

#[test]
fn wrong_sources_are_refused_before_the_terminal_is_taken() {
    let Some(live) = InTerminal::start("missing.bin", &[]) else { return };
    live.wait("code 2");
    let written = live.written();
    assert!(written.contains("missing.bin") && !written.contains(OTHER_SCREEN[0]), "{written:?}");
}
