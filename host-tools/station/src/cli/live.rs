//! `baliza live`: the live map in a terminal.

use std::collections::VecDeque;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crate::Remote;
use crate::screen::{Raw, Screen, Snapshot, Then, on_hangup};
use anyhow::{Context, Result};
use ratatui::crossterm::event::{self, Event};
use recording::UserError;
use station_core::hub::NullStore;
use station_core::model::SiteMap;
use station_core::store::Retention;
use station_core::{Hub, LiveState, Utc};

use super::serve::{InputArguments, Sources, sources_help};
use host_tools::cli::stream::{STOP, catch_signals_and};
use host_tools::cli::verbosity;

/// Show a live map of the positions of tags in this terminal
///
/// The map has rooms, anchors, tags with names, trails and uncertainty (ellipses of two standard deviations); beside
/// it are lists of the tags and of the anchors' health. Nothing is stored and nothing listens: it is for a look over
/// SSH. Press ? for the keys. With NO_COLOR set it has no colours.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    #[command(flatten)]
    inputs: InputArguments,
    /// Show what a running station knows, and not sources: http://HOST:PORT
    #[arg(long, conflicts_with_all = ["sources", "simulate", "site", "rooms"])]
    url: Option<Remote>,
    /// A file with the token by which the station may be asked
    #[arg(long, value_name = "FILE", requires = "url")]
    token_file: Option<PathBuf>,
}

const EXAMPLES: &str = concat!(
    sources_help!(),
    "
Examples:
  baliza live --simulate
  baliza live --site site.toml --rooms rooms.csv serial:/dev/ttyACM0
  baliza live --url http://127.0.0.1:8080
  ssh -t gateway baliza live /dev/ttyACM0"
);

/// The time between two pictures without a key.
const PICTURE: Duration = Duration::from_millis(200);
/// The longest wait for a key, so that signals are seen.
const SIGNALS: Duration = Duration::from_millis(50);
/// The time between two questions to a running station.
const ASK: Duration = Duration::from_millis(500);
/// The most messages that wait to be shown.
const NOTES: usize = 64;

/// Messages for the user, which cannot go to standard error while the terminal is drawn on.
#[derive(Clone, Debug, Default)]
struct Notes(Arc<Mutex<VecDeque<String>>>);

impl Notes {
    fn push(&self, note: &str) {
        let mut notes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if notes.len() >= NOTES {
            notes.pop_front();
        }
        notes.push_back(note.trim().to_owned());
    }

    fn pop(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).pop_front()
    }
}

/// Runs `baliza live`.
///
/// # Errors
/// Standard output is no terminal, or flags or files are wrong.
pub fn run(arguments: &Arguments) -> Result<()> {
    if !Raw::is_possible() {
        let what = "it draws on a terminal, and standard output is none (over SSH, `ssh -t` makes one); baliza serve \
                    shows the map in a browser";
        return Err(UserError::flag("live", what).into());
    }
    let notes = Notes::default();
    match &arguments.url {
        Some(remote) => {
            let token = arguments.token_file.as_deref();
            let remote = token.map_or_else(|| Ok(remote.clone()), |file| remote.clone().with_token(file))?;
            let sites = remote.sites()?;
            catch_signals_and(Raw::restore)?;
            let last = poll(remote, notes.clone());
            show(sites, &notes, || last.lock().unwrap_or_else(PoisonError::into_inner).take())
        }
        None => {
            let sources = Sources::of(&arguments.inputs, None)?;
            catch_signals_and(Raw::restore)?;
            let runtime =
                tokio::runtime::Builder::new_multi_thread().enable_all().build().context("cannot start the runtime")?;
            let (sites, zones): (Vec<_>, Vec<_>) = sources.sites().into_iter().unzip();
            let mut live = LiveState::new(arguments.inputs.limits());
            live.set_zones(zones.into_iter().flatten().collect());
            let (hub, _task) = runtime.block_on(Hub::start(live, NullStore, Retention::default()))?;
            let to_notes = notes.clone();
            sources.start(&hub, &[], move |note| to_notes.push(note));
            let shown = show(sites, &notes, || Some(hub.read(|live| Snapshot::of(live, Utc::now()))));
            hub.stop();
            shown
        }
    }
}

/// Asks a station again and again. Returns where its last answer is.
fn poll(remote: Remote, notes: Notes) -> Arc<Mutex<Option<Snapshot>>> {
    let last: Arc<Mutex<Option<Snapshot>>> = Arc::default();
    let to = Arc::clone(&last);
    thread::spawn(move || {
        let mut is_failing = false;
        loop {
            match remote.snapshot() {
                Ok(snapshot) => {
                    if is_failing {
                        notes.push("it answers again");
                    }
                    is_failing = false;
                    *to.lock().unwrap_or_else(PoisonError::into_inner) = Some(snapshot);
                }
                Err(error) => {
                    notes.push(&format!("{error:#}"));
                    is_failing = true;
                }
            }
            thread::sleep(ASK);
        }
    });
    last
}

/// Shows states in the terminal until a person or a signal ends it.
fn show(sites: Vec<SiteMap>, notes: &Notes, state: impl FnMut() -> Option<Snapshot>) -> Result<()> {
    let mut screen = Screen::new(sites, host_tools::cli::stdout_has_colours());
    let [of_panics, of_log] = [notes.clone(), notes.clone()];
    // Nothing is kept, so nothing is lost.
    on_hangup(|| std::process::exit(0));
    let mut raw = Raw::enter(move |panic| of_panics.push(&panic)).context("cannot draw on the terminal")?;
    verbosity::divert(move |line| of_log.push(line));
    let ended = watch(state, &mut screen, notes, &mut raw);
    drop(raw);
    verbosity::undivert();
    match ended {
        // The terminal was closed.
        Err(_) if STOP.load(Ordering::Relaxed) => Ok(()),
        ended => ended.context("the terminal is lost"),
    }
}

/// Draws until a person or a signal ends it.
fn watch(
    mut state: impl FnMut() -> Option<Snapshot>,
    screen: &mut Screen,
    notes: &Notes,
    raw: &mut Raw,
) -> io::Result<()> {
    let mut drawn: Option<Instant> = None;
    while !STOP.load(Ordering::Relaxed) {
        if drawn.is_none_or(|drawn| drawn.elapsed() >= PICTURE) {
            if let Some(snapshot) = state() {
                screen.take(snapshot);
            }
            while let Some(note) = notes.pop() {
                screen.note(note);
            }
            raw.terminal.draw(|frame| screen.draw(frame))?;
            drawn = Some(Instant::now());
        }
        if event::poll(SIGNALS)? {
            match event::read()? {
                Event::Key(key) if screen.key(key) == Then::Quit => return Ok(()),
                // Another size, or something else is to be seen.
                Event::Key(_) | Event::Resize(_, _) => drawn = None,
                Event::FocusGained | Event::FocusLost | Event::Mouse(_) | Event::Paste(_) => {}
            }
        }
    }
    Ok(())
}
