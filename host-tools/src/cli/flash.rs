//! `baliza flash`: writes a node's image and record to its board.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use node_link::probe::ProbeArguments;
use node_link::provision::one_by_one::Job;
use node_link::provision::transfer::{self, Flash};
use node_link::provision::{Firmware, Node, Site, warnings};
use recording::UserError;
use wire::config::{Board, Flasher};

use super::boards::{board_of, contents, one_after_another};
use super::progress::Progress;
use super::provision::boards;

/// Write a node's image and record to its board, over the debug probe
///
/// The image is chosen by the node's board and role, from the folder of a release or of `cargo xtask firmware`, and
/// verified after writing. A tag that scans gets the image with Bluetooth.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The file of the site, as `baliza provision --example` prints one
    #[arg(long, value_name = "FILE", default_value = "site.toml")]
    config: PathBuf,
    /// Which node of the file, where there are several; NAME,NAME… are written board after board
    #[arg(long, value_name = "NAME", value_delimiter = ',', conflicts_with = "all")]
    node: Vec<String>,
    /// All nodes of the file, board after board; those that are written already are skipped
    #[arg(long, conflicts_with = "image")]
    all: bool,
    /// The board; it overrides the one in the file
    #[arg(long, value_name = "BOARD", value_parser = boards())]
    board: Option<Board>,
    /// The image: an ELF file
    #[arg(long, value_name = "FILE", conflicts_with = "images")]
    image: Option<PathBuf>,
    /// The folder of the images [default: target/firmware, firmware, or the folder firmware of a release]
    #[arg(long, value_name = "FOLDER")]
    images: Option<PathBuf>,
    #[command(flatten)]
    probe: ProbeArguments,
}

const EXAMPLES: &str = "\
Examples:
  baliza flash --node anchor-1
  baliza flash --node tag-1 --config site.toml --images baliza-0.1.0/firmware
  baliza flash --all
  baliza flash --node anchor-1,anchor-2,anchor-3,tag-1";

/// What goes to one board.
struct Load<'a> {
    node: &'a Node,
    board: Board,
    firmware: Firmware,
}

/// Runs `baliza flash`.
///
/// # Errors
/// The site's file or an image is wrong, the probe fails, or the flash does not keep what is written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let mut site = Site::read(&arguments.config)?;
    super::provision::give_keys(&mut site)?;
    if arguments.all || arguments.node.len() > 1 {
        let named = arguments.node.iter().map(|name| site.node(Some(name))).collect::<Result<Vec<_>, _>>()?;
        let nodes = if arguments.all { site.nodes.iter().collect() } else { named };
        if arguments.image.is_some() {
            return Err(UserError::flag("--image", "only with one node").into());
        }
        let loads = nodes.iter().map(|node| arguments.load(node)).collect::<Result<Vec<_>>>()?;
        warn(nodes);
        let jobs: Vec<_> = loads.iter().map(Load::job).collect();
        let remedy = "; where a board does not exist, name the others: --node NAME,NAME";
        return one_after_another(&arguments.probe, &arguments.config, (&jobs, remedy), &mut |flash, job| {
            let load = loads.iter().find(|load| load.node.name == job.name).context("no such node")?;
            load.write(flash).map(drop)
        });
    }
    let load = arguments.load(site.node(arguments.node.first().map(String::as_str))?)?;
    warn([load.node]);
    let probe = arguments.probe.attach(load.board.spec().flasher.probe_chip()).map_err(|error| load.by_hand(error))?;
    let (addresses, sequence) = load.write(probe.into_flash().as_mut())?;
    let places = addresses.iter().map(|address| format!("0x{address:08X}")).collect::<Vec<_>>().join(" and ");
    super::note(&format!(
        "{}: {} flashed and verified, record written at {places} with sequence {sequence}, the node restarted\n",
        load.node.name,
        load.firmware.file.display()
    ));
    Ok(())
}

fn warn<'n>(nodes: impl IntoIterator<Item = &'n Node>) {
    warnings(nodes).iter().for_each(|line| super::note(&format!("warning: {line}\n")));
}

impl Arguments {
    /// The image and the record of a node.
    fn load<'a>(&self, node: &'a Node) -> Result<Load<'a>> {
        let board = board_of(self.board, node)?;
        node.record_for(Some(board))?;
        let file = match &self.image {
            Some(file) => file.clone(),
            None => Firmware::find(&self.folders(), board, node)?,
        };
        Ok(Load { node, board, firmware: Firmware::read(&file, board, node)? })
    }

    /// Where images are looked for.
    fn folders(&self) -> Vec<PathBuf> {
        if let Some(folder) = &self.images {
            return vec![folder.clone()];
        }
        firmware_folders()
    }
}

/// Where the images of a release or of `cargo xtask firmware` are. A release has the program in `bin`, beside `firmware`.
pub fn firmware_folders() -> Vec<PathBuf> {
    let program = std::env::current_exe().ok();
    let release = program.as_deref().and_then(Path::parent).and_then(Path::parent).map(|up| up.join("firmware"));
    ["target/firmware", "firmware"].map(PathBuf::from).into_iter().chain(release).collect()
}

impl Load<'_> {
    fn job(&self) -> Job<'_> {
        let record = contents(self.node, &self.node.record).binary(self.board);
        Job {
            name: &self.node.name,
            board: self.board,
            record: &self.node.record,
            sum: super::provision::sum(&[&record, &self.firmware.elf]),
        }
    }

    /// Writes the image, then the record, and restarts the node.
    fn write(&self, flash: &mut (impl Flash + ?Sized)) -> Result<(Vec<u32>, u32)> {
        super::note(&format!("{}: {}\n", self.node.name, self.firmware.file.display()));
        let mut bar: Option<(Progress, u64)> = None;
        flash.write_image(&self.firmware, &mut |done, all| {
            let (bar, before) =
                bar.get_or_insert_with(|| (Progress::new(usize::try_from(all).unwrap_or(usize::MAX)), 0));
            bar.advance(done.saturating_sub(*before));
            *before = done;
        })?;
        drop(bar);
        transfer::write(flash, self.board, &contents(self.node, &self.node.record))
    }

    /// Adds what to do for an ESP that no probe reaches, such as one behind a serial bridge.
    fn by_hand(&self, error: anyhow::Error) -> anyhow::Error {
        let Flasher::Espflash(chip) = self.board.spec().flasher else { return error };
        if error.is::<UserError>() {
            return error;
        }
        let (image, node) = (self.firmware.file.display(), &self.node.name);
        let address = contents(self.node, &self.node.record).address(self.board);
        error.context(format!(
            "the chip's own USB socket is not reached; over a serial bridge: espflash flash --chip {chip} {image}; baliza \
             provision --config … --node {node} --board {} --out {node}.bin; espflash write-bin 0x{address:X} {node}.bin",
            self.board.name()
        ))
    }
}

#[cfg(test)]
mod tests {
    use anyhow::bail;
    use node_link::provision::EXAMPLE;

    use super::*;

    /// A flash that notes what is done to it, and whose probe may be pulled while the image is written.
    #[derive(Default)]
    struct Notes {
        done: Vec<String>,
        pages: std::collections::BTreeMap<u32, Vec<u8>>,
        is_pulled: bool,
    }

    impl Flash for Notes {
        fn read(&mut self, address: u32, bytes: &mut [u8]) -> Result<()> {
            bytes.fill(0xFF);
            if let Some(page) = self.pages.get(&address) {
                bytes.copy_from_slice(page);
            }
            Ok(())
        }

        fn write_page(&mut self, address: u32, page: &[u8]) -> Result<()> {
            self.done.push(format!("page {address:#x}"));
            self.pages.insert(address, page.to_vec());
            Ok(())
        }

        fn write_image(&mut self, image: &Firmware, progress: &mut dyn FnMut(u64, u64)) -> Result<()> {
            progress(2, 4);
            if self.is_pulled {
                bail!("the probe is gone");
            }
            progress(4, 4);
            self.done.push(image.file.display().to_string());
            Ok(())
        }

        fn restart(&mut self) -> Result<()> {
            self.done.push("restart".to_owned());
            Ok(())
        }
    }

    fn written(flash: &mut Notes) -> Result<(Vec<u32>, u32)> {
        let site = Site::parse("site.toml".as_ref(), EXAMPLE).expect("the example is right");
        let board = Board::Dwm1001;
        let firmware = Firmware { file: "anchor.elf".into(), elf: vec![1], segments: vec![(0, vec![1])], board };
        Load { node: &site.nodes[0], board, firmware }.write(flash)
    }

    #[test]
    fn the_image_is_first_then_the_record_and_one_restart() {
        let mut flash = Notes::default();
        assert_eq!(written(&mut flash).expect("written"), (vec![0x7E000], 1));
        assert_eq!(flash.done, ["anchor.elf", "page 0x7e000", "restart"]);
    }

    #[test]
    fn unplugged_within_the_image_no_record_is_written() {
        let mut flash = Notes { is_pulled: true, ..Notes::default() };
        assert_eq!(written(&mut flash).expect_err("pulled").to_string(), "the probe is gone");
        assert!(flash.done.is_empty());
    }
}
