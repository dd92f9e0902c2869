//! Writes nodes to boards that a person connects one after another.
//!
//! A board that holds the record of one of the nodes stays that node, whichever is next; any other board becomes the
//! next node. What is written already is skipped, so that the same call goes on after an interruption.

use anyhow::Result;
use wire::config::{Board, Record};

use super::transfer::{self, Flash};
use super::written::Written;

/// What is to be written to a board.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The node's name.
    pub name: &'a str,
    /// Its board.
    pub board: Board,
    /// Its record.
    pub record: &'a Record,
    /// A checksum of all that is written.
    pub sum: u32,
}

/// What is at the probe.
pub enum Seen {
    /// Nothing is connected.
    Nothing,
    /// A probe that does not reach a chip, and why.
    Trouble(String),
    /// A board: its flash, and a name that identifies the probe.
    Board(Box<dyn Flash>, String),
}

/// The desk at which a person connects boards.
pub trait Desk {
    /// Looks for a board of this kind.
    ///
    /// # Errors
    /// Looking again would not help.
    fn look(&mut self, board: Board) -> Result<Seen>;

    /// Shows a line to the person.
    fn show(&mut self, text: &str);

    /// Waits a moment; false where the person wants to end.
    fn wait(&mut self) -> bool;
}

/// Which boards are waited for.
pub fn waits_for(jobs: &[Job<'_>], written: &Written) -> String {
    let left: Vec<_> = jobs.iter().filter(|job| !written.has(job)).collect();
    let names: Vec<_> = left.iter().map(|job| format!("{} ({})", job.name, job.board.name())).collect();
    format!("{} of {} boards are waited for, one at a time: {}", left.len(), jobs.len(), names.join(", "))
}

/// Writes all jobs that are not written yet, with `write`. Returns the names of those that are left where the person
/// ends earlier.
///
/// # Errors
/// The desk fails for good, or the file of what is written cannot be written. A board that fails is no error: the
/// person connects it again, or another one.
pub fn write_all<'a>(
    desk: &mut dyn Desk,
    jobs: &[Job<'a>],
    written: &mut Written,
    write: &mut dyn FnMut(&mut dyn Flash, &Job<'a>) -> Result<()>,
) -> Result<Vec<&'a str>> {
    for job in jobs.iter().filter(|job| written.has(job)) {
        desk.show(&format!("{}: written already", job.name));
    }
    // Probes of boards whose flash cannot be read: they are known by their probes.
    let mut used: Vec<String> = Vec::new();
    let mut last = String::new();
    // After a failure, the board must be disconnected first, so that its flash is not worn by endless attempts.
    let mut failed = false;
    while let Some(next) = jobs.iter().find(|job| !written.has(job)) {
        let call = format!("connect {} ({})", next.name, next.board.name());
        let mut show = |desk: &mut dyn Desk, text: String| {
            if text != last {
                desk.show(&text);
                last = text;
            }
        };
        match desk.look(next.board)? {
            Seen::Nothing => {
                failed = false;
                show(desk, call);
            }
            Seen::Trouble(why) => {
                failed = false;
                show(desk, format!("{call}: {why}"));
            }
            Seen::Board(..) if failed => {}
            Seen::Board(mut flash, probe) => match job_of(flash.as_mut(), &probe, next, jobs, &used) {
                Ok(Some(job)) if written.has(job) => {
                    show(desk, format!("this board is {}, which is written; {call}", job.name));
                }
                Ok(Some(job)) => match write(flash.as_mut(), job) {
                    Ok(()) => {
                        written.note(job)?;
                        used.push(probe);
                        show(desk, format!("{}: written", job.name));
                    }
                    Err(error) => {
                        failed = true;
                        show(desk, format!("{}: {error:#}; disconnect it, and connect it again", job.name));
                    }
                },
                Ok(None) => show(desk, format!("this board is written; {call}")),
                Err(error) => show(desk, format!("{call}: {error:#}")),
            },
        }
        if !desk.wait() {
            break;
        }
    }
    Ok(jobs.iter().filter(|job| !written.has(job)).map(|job| job.name).collect())
}

/// The job of the board that is connected; `None` for a board that was written in this run and cannot say which it is.
fn job_of<'j, 'a>(
    flash: &mut dyn Flash,
    probe: &str,
    next: &'j Job<'a>,
    jobs: &'j [Job<'a>],
    used: &[String],
) -> Result<Option<&'j Job<'a>>> {
    if !next.board.spec().flasher.is_readable() {
        return Ok((!used.iter().any(|name| name == probe)).then_some(next));
    }
    let Ok(held) = transfer::read(flash, next.board)? else { return Ok(Some(next)) };
    let is_same = |job: &&Job<'_>| {
        let (identity, own) = (&held.record.identity, &job.record.identity);
        let named = own.address.is_some() || own.eui.is_some();
        named && job.board == next.board && identity == own && held.record.network.pan == job.record.network.pan
    };
    Ok(Some(jobs.iter().find(is_same).unwrap_or(next)))
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::BTreeMap;
    use std::path::Path;
    use std::rc::Rc;

    use anyhow::{Result, bail};
    use wire::config::Board;

    use super::{Desk, Flash, Job, Seen, waits_for, write_all};
    use crate::provision::image::Contents;
    use crate::provision::{EXAMPLE, Firmware, Site, Written, transfer};

    /// A board: its pages, and after how many of them it is pulled from the probe.
    #[derive(Default)]
    struct Pages {
        pages: BTreeMap<u32, Vec<u8>>,
        pulled_after: Option<usize>,
    }

    #[derive(Clone, Default)]
    struct Chip(Rc<RefCell<Pages>>);

    impl Flash for Chip {
        fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
            bytes.fill(0xFF);
            for (at, page) in self.0.borrow().pages.range(address..address + bytes.len() as u32) {
                bytes[(at - address) as usize..][..page.len()].copy_from_slice(page);
            }
            Ok(())
        }

        fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()> {
            let mut chip = self.0.borrow_mut();
            if chip.pulled_after == Some(0) {
                chip.pulled_after = None;
                // Less than a record.
                chip.pages.insert(address, page[..8].to_vec());
                bail!("the probe is gone");
            }
            chip.pulled_after = chip.pulled_after.map(|left| left - 1);
            chip.pages.insert(address, page.to_vec());
            Ok(())
        }

        fn write_image(&mut self, _: &Firmware, _: &mut dyn FnMut(u64, u64)) -> Result<()> {
            bail!("these tests write records")
        }

        fn restart(&mut self) -> Result<()> {
            Ok(())
        }
    }

    /// What is at the probe at each look; the person ends after the last one.
    struct Script {
        seen: Vec<Option<(Chip, &'static str)>>,
        said: Vec<String>,
    }

    impl Desk for Script {
        fn look(&mut self, _: Board) -> Result<Seen> {
            Ok(match self.seen.remove(0) {
                Some((chip, probe)) => Seen::Board(Box::new(chip), probe.to_owned()),
                None => Seen::Nothing,
            })
        }

        fn show(&mut self, text: &str) {
            self.said.push(text.to_owned());
        }

        fn wait(&mut self) -> bool {
            !self.seen.is_empty()
        }
    }

    /// Writes the example's first three anchors on this kind of board. Returns what is left, and what was said.
    fn run(folder: &Path, board: Board, seen: Vec<Option<(Chip, &'static str)>>) -> (Vec<String>, Vec<String>) {
        let site = Site::parse("site.toml".as_ref(), EXAMPLE).expect("the example is right");
        let jobs: Vec<_> = (1..)
            .zip(&site.nodes[..3])
            .map(|(sum, node)| Job { name: &node.name, board, record: &node.record, sum })
            .collect();
        let mut script = Script { seen, said: Vec::new() };
        let mut written = Written::beside(&folder.join("site.toml")).expect("a good file, or none");
        let left = write_all(&mut script, &jobs, &mut written, &mut |flash, job| {
            let contents = Contents { record: job.record, model: None, site_models: None, wifi: None };
            transfer::write(flash, job.board, &contents).map(drop)
        });
        (left.expect("the desk stays").into_iter().map(str::to_owned).collect(), script.said)
    }

    fn address(chip: &Chip) -> Option<u16> {
        transfer::read(&mut chip.clone(), Board::Dwm1001).expect("it is read").ok()?.record.identity.address
    }

    #[test]
    fn new_boards_become_the_nodes_in_order() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [a, b, c] = [(); 3].map(|()| Chip::default());
        let see = |chip: &Chip| Some((chip.clone(), "probe"));
        let (left, said) = run(
            folder.path(),
            Board::Dwm1001,
            // The first stays at the probe for another look.
            vec![None, see(&a), see(&a), None, see(&b), None, see(&c)],
        );
        assert!(left.is_empty());
        assert_eq!([&a, &b, &c].map(address), [Some(0x0101), Some(0x0102), Some(0x0103)]);
        assert_eq!(
            said,
            [
                "connect anchor-1 (dwm1001)",
                "anchor-1: written",
                "this board is anchor-1, which is written; connect anchor-2 (dwm1001)",
                "connect anchor-2 (dwm1001)",
                "anchor-2: written",
                "connect anchor-3 (dwm1001)",
                "anchor-3: written",
            ]
        );
    }

    #[test]
    fn it_says_which_boards_are_waited_for() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        run(folder.path(), Board::Dwm1001, vec![Some((Chip::default(), "probe"))]);
        let site = Site::parse("site.toml".as_ref(), EXAMPLE).expect("the example is right");
        let job = |(sum, at): (u32, usize)| {
            let node = &site.nodes[at];
            Job { name: &node.name, board: node.board.expect("it has one"), record: &node.record, sum }
        };
        let jobs = [(1, 0), (2, 1), (3, 5)].map(job);
        let written = Written::beside(&folder.path().join("site.toml")).expect("it was written");
        let said = "2 of 3 boards are waited for, one at a time: anchor-2 (dwm1001), beacon-1 (esp32c3)";
        assert_eq!(waits_for(&jobs, &written), said);
    }

    #[test]
    fn after_an_interruption_the_same_call_goes_on() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [a, b, c] = [(); 3].map(|()| Chip::default());
        let see = |chip: &Chip| Some((chip.clone(), "probe"));
        let (left, _) = run(folder.path(), Board::Dwm1001, vec![see(&a), None]);
        assert_eq!(left, ["anchor-2", "anchor-3"]);
        let (left, said) = run(folder.path(), Board::Dwm1001, vec![see(&b), None, see(&c)]);
        assert!(left.is_empty());
        assert_eq!(said[..2], ["anchor-1: written already", "anchor-2: written"]);
        // A node whose settings changed is written again: on another kind of board, say.
        let (left, _) = run(folder.path(), Board::Evk1000, vec![None]);
        assert_eq!(left.len(), 3);
        std::fs::write(folder.path().join("site.written"), "something else\n").expect("written");
        let error = Written::beside(&folder.path().join("site.toml")).expect_err("another file").to_string();
        assert!(error.ends_with("site.written:1: not node,board,sum: delete the file to begin again"), "{error}");
    }

    #[test]
    fn a_board_unplugged_in_the_middle_is_written_when_it_is_back() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let chip = Chip::default();
        chip.0.borrow_mut().pulled_after = Some(0);
        let see = || Some((chip.clone(), "probe"));
        // It is at the probe again without having been away: nothing is written then.
        let (left, said) = run(folder.path(), Board::Dwm1001, vec![see(), see()]);
        assert_eq!((left.len(), address(&chip)), (3, None));
        assert!(said[0].starts_with("anchor-1: cannot write the flash"), "{said:?}");
        assert!(said[0].ends_with("the probe is gone; disconnect it, and connect it again"), "{said:?}");
        let (left, said) = run(folder.path(), Board::Dwm1001, vec![None, see()]);
        assert_eq!((left, address(&chip)), (vec!["anchor-2".to_owned(), "anchor-3".to_owned()], Some(0x0101)));
        assert_eq!(said, ["connect anchor-1 (dwm1001)", "anchor-1: written"]);
    }

    #[test]
    fn a_board_with_a_record_of_the_site_stays_that_node() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let chips = [(); 3].map(|()| Chip::default());
        let see = |chip: &Chip| Some((chip.clone(), "probe"));
        run(folder.path(), Board::Dwm1001, chips.iter().map(see).collect());
        std::fs::remove_file(folder.path().join("site.written")).expect("it was there");
        let (left, said) = run(folder.path(), Board::Dwm1001, vec![see(&chips[2]), see(&chips[0])]);
        assert_eq!(
            (left, said),
            (vec!["anchor-2".to_owned()], ["anchor-3: written", "anchor-1: written"].map(Into::into).into())
        );
        assert_eq!(chips.each_ref().map(address), [Some(0x0101), Some(0x0102), Some(0x0103)]);
    }

    #[test]
    fn a_board_that_cannot_be_read_is_known_by_its_probe() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [a, b] = [(); 2].map(|()| Chip::default());
        let (left, said) = run(
            folder.path(),
            Board::Esp32C3,
            vec![Some((a.clone(), "a")), Some((a.clone(), "a")), Some((b.clone(), "b"))],
        );
        assert_eq!(left, ["anchor-3"]);
        let expected = ["anchor-1: written", "this board is written; connect anchor-2 (esp32c3)", "anchor-2: written"];
        assert_eq!(said, expected);
        assert_ne!(a.0.borrow().pages[&0x9000], b.0.borrow().pages[&0x9000]);
    }
}
