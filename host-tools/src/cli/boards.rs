//! Boards at the debug probe, for `flash` and `provision --write`.

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use analysis::train::Chosen;
use anyhow::{Result, bail};
use node_link::probe::ProbeArguments;
use node_link::provision::image::Contents;
use node_link::provision::one_by_one::{self, Desk, Job, Seen, write_all};
use node_link::provision::transfer::Flash;
use node_link::provision::{Node, Written};
use recording::UserError;
use wire::config::{Board, Record};

use super::stream::{STOP, catch_signals};

/// The time between two looks for a board.
const PAUSE: Duration = Duration::from_millis(500);

/// The content of a node's flash: its record, its models and its settings of Wi-Fi.
pub fn contents<'a>(node: &'a Node, record: &'a Record) -> Contents<'a> {
    let (model, site_models) = (node.model.as_ref().map(Chosen::bytes), node.site_models.as_deref());
    Contents { record, model, site_models, wifi: node.wifi.as_ref() }
}

/// The board of a node: the given one, else the one in the file.
///
/// # Errors
/// Neither is known.
pub fn board_of(given: Option<Board>, node: &Node) -> Result<Board, UserError> {
    given.or(node.board).ok_or_else(|| {
        let what = format!("say what {} is built on, here or by `board` in the file", node.name);
        UserError::flag("--board", what)
    })
}

/// Writes jobs to boards that the person connects one after another. What is written is noted beside the site's file.
/// Beside the jobs is what to do where a board is missing.
///
/// # Errors
/// The probe's arguments or the file of what is written are wrong, or the person ends before all is written.
pub fn one_after_another(
    probe: &ProbeArguments,
    site: &Path,
    (jobs, remedy): (&[Job<'_>], &str),
    write: &mut dyn FnMut(&mut dyn Flash, &Job<'_>) -> Result<()>,
) -> Result<()> {
    let mut written = Written::beside(site)?;
    catch_signals()?;
    super::prompt(&format!("{}{remedy}\n", one_by_one::waits_for(jobs, &written)));
    let left = write_all(&mut Probes(probe), jobs, &mut written, write)?;
    if left.is_empty() {
        return Ok(());
    }
    bail!("not written: {}; the same command goes on with them", left.join(", "))
}

struct Probes<'a>(&'a ProbeArguments);

impl Desk for Probes<'_> {
    fn look(&mut self, board: Board) -> Result<Seen> {
        if !self.0.is_connected()? {
            return Ok(Seen::Nothing);
        }
        match self.0.attach(board.spec().flasher.probe_chip()) {
            Ok(probe) => {
                let name = probe.name().to_owned();
                Ok(Seen::Board(probe.into_flash(), name))
            }
            Err(error) if error.is::<UserError>() => Err(error),
            Err(error) => Ok(Seen::Trouble(format!("{error:#}"))),
        }
    }

    fn show(&mut self, text: &str) {
        super::prompt(&format!("{text}\n"));
    }

    fn wait(&mut self) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < PAUSE && !STOP.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(50));
        }
        !STOP.load(Ordering::Relaxed)
    }
}
