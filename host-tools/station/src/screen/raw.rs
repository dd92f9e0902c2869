//! The terminal in raw mode with its other screen, until the end, however the program ends.

use std::io::{self, IsTerminal, Stdout, stdout};
use std::panic;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::cursor::Show;
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode};

/// Whether the terminal is to be restored.
static IS_RAW: AtomicBool = AtomicBool::new(false);

/// The terminal, for a program that draws on all of it. It is restored when this is dropped, when its thread panics,
/// and by [`Raw::restore`].
#[derive(Debug)]
pub struct Raw {
    /// Where frames are drawn.
    pub terminal: Terminal<CrosstermBackend<Stdout>>,
}

impl Raw {
    /// Whether a program can draw on standard output.
    pub fn is_possible() -> bool {
        stdout().is_terminal() && std::env::var_os("TERM").is_none_or(|term| term != "dumb")
    }

    /// Takes the terminal. `note` gets the panics of other threads, which must not write over what is drawn.
    ///
    /// # Errors
    /// The terminal refuses.
    pub fn enter(note: impl Fn(String) + Send + Sync + 'static) -> io::Result<Self> {
        let (own, earlier) = (thread::current().id(), panic::take_hook());
        panic::set_hook(Box::new(move |info| {
            if thread::current().id() == own || !IS_RAW.load(Ordering::SeqCst) {
                Self::restore();
                earlier(info);
            } else {
                note(info.to_string());
            }
        }));
        IS_RAW.store(true, Ordering::SeqCst);
        let entered = enable_raw_mode()
            .and_then(|()| execute!(stdout(), EnterAlternateScreen))
            .and_then(|()| Terminal::new(CrosstermBackend::new(stdout())));
        match entered {
            Ok(terminal) => Ok(Self { terminal }),
            Err(error) => {
                Self::restore();
                Err(error)
            }
        }
    }

    /// Makes the terminal as it was. The second time does nothing.
    pub fn restore() {
        if IS_RAW.swap(false, Ordering::SeqCst) {
            // The terminal may be closed: then there is nothing to restore.
            let _ = execute!(stdout(), LeaveAlternateScreen, Show);
            let _ = disable_raw_mode();
        }
    }
}

/// Calls `ended` once the terminal is closed. crossterm, up to 0.29, reads a closed terminal for ever and so never sees
/// the end of the program.
#[cfg(any(target_os = "linux", target_vendor = "apple"))]
pub fn on_hangup(ended: impl FnOnce() + Send + 'static) {
    use rustix::event::{PollFd, PollFlags, Timespec, poll};

    thread::spawn(move || {
        loop {
            // Nothing is waited for but what is always told: that the terminal is closed, or no terminal any more.
            let stdout = stdout();
            let mut terminal = [PollFd::new(&stdout, PollFlags::empty())];
            let wait = Timespec { tv_sec: 1, tv_nsec: 0 };
            // An error is a signal in between.
            if poll(&mut terminal, Some(&wait)).is_ok_and(|closed| closed > 0) {
                return ended();
            }
        }
    });
}

/// Elsewhere a closed terminal ends the program by itself.
#[cfg(not(any(target_os = "linux", target_vendor = "apple")))]
pub fn on_hangup(_: impl FnOnce() + Send + 'static) {}

impl Drop for Raw {
    fn drop(&mut self) {
        Self::restore();
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::io::{Write, stderr};
    use std::process::Command;

    use super::*;

    #[test]
    #[ignore = "the process that the test of a panic starts in a terminal"]
    fn panics_while_it_draws() {
        let notes = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
        let to_notes = std::sync::Arc::clone(&notes);
        let _raw = Raw::enter(move |note| to_notes.lock().expect("a list").push(note)).expect("a terminal");
        // That of another thread is not written over the picture.
        assert!(thread::spawn(|| panic!("elsewhere")).join().is_err());
        let notes = notes.lock().expect("a list").join("; ");
        panic!("here, after {}", if notes.contains("elsewhere") { "a note" } else { "no note" });
    }

    #[test]
    fn a_panic_gives_the_terminal_back_and_then_says_what_it_is() {
        let program = std::env::current_exe().expect("this program");
        let name = "screen::raw::tests::panics_while_it_draws";
        let command = format!(
            "stty rows 24 cols 80; '{}' --exact {name} --ignored --nocapture --test-threads=1; stty -a",
            program.display()
        );
        let run = Command::new("script").args(["--quiet", "--command", &command, "/dev/null"]).output();
        let Ok(run) = run else {
            assert_ne!(std::env::var("CI").as_deref(), Ok("true"), "script of util-linux is needed");
            let _ = writeln!(stderr(), "the test of a panic is left out: there is no `script`");
            return;
        };
        let written = String::from_utf8_lossy(&run.stdout);
        let at = |text: &str| written.find(text).unwrap_or_else(|| panic!("{text:?} is not in {written:?}"));
        assert!(at("\u{1b}[?1049h") < at("\u{1b}[?1049l") && at("\u{1b}[?1049l") < at("here, after a note"));
        assert!(at("here, after a note") < at(" icanon") && !written.contains("-icanon"), "{written:?}");
    }
}
