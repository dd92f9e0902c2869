//! `baliza provision`: makes node records, shows and checks them, and moves them over a debug probe.

use std::collections::HashSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::builder::PossibleValuesParser;
use clap::builder::TypedValueParser;
use crc::{CRC_32_ISO_HDLC, Crc};
use node_link::probe::ProbeArguments;
use node_link::provision::image::{Contents, Held, RecordImage};
use node_link::provision::one_by_one::Job;
use node_link::provision::show::{self, Keys};
use node_link::provision::{Node, Site, SiteNames, example, oddities, transfer, warnings};
use recording::UserError;
use recording::output::{self, OutputFolder};
use recording::{IMAGE_BYTES, read_limited};
use wire::config::{Board, Flasher, MODELS_BYTES};

use super::boards::{board_of, contents, one_after_another};

/// Configure nodes: make their records, write, show and check them
///
/// A record is made from a TOML file, `--config`; --example prints one to begin with. It goes to a file, --out, for
/// espflash, probe-rs or any other flasher; or over a debug probe into the board, --write. docs/use/site.md has all
/// keys.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("what").required(true).args(["config", "show", "read", "check", "example"]))]
pub struct Arguments {
    /// Makes records from this file
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Which node of the file, where there are several
    #[arg(long, value_name = "NAME", requires = "config", conflicts_with = "all")]
    node: Option<String>,
    /// All nodes of the file: one record each into the folder --out, or with --write board after board
    #[arg(long, requires = "config")]
    all: bool,
    /// Where the record goes; a folder with --all
    #[arg(long, value_name = "PATH", conflicts_with_all = ["show", "read", "check"])]
    out: Option<PathBuf>,
    /// Replace the records that are in the folder (--all), or a file that is no record
    #[arg(long, requires = "out")]
    force: bool,
    /// As bytes, for the address that is printed; or as Intel HEX, which has the addresses in it
    #[arg(long, value_enum, default_value_t = Format::Bin, requires = "config")]
    format: Format,
    /// Writes the record over a debug probe, reads it back, compares, and restarts the node
    #[arg(long, requires = "config", conflicts_with = "out")]
    write: bool,
    /// The board; it overrides the one in the file
    #[arg(long, value_name = "BOARD", value_parser = boards())]
    board: Option<Board>,
    /// Prints the record of a file as TOML
    #[arg(long, value_name = "FILE")]
    show: Option<PathBuf>,
    /// Prints the record of the board at the debug probe as TOML
    #[arg(long, requires = "board")]
    read: bool,
    /// Prints keys, too
    #[arg(long, conflicts_with_all = ["config", "check", "example"])]
    show_keys: bool,
    /// Checks whether a file is a good record, in one line; exit code 2 where it is not
    #[arg(long, value_name = "FILE")]
    check: Option<PathBuf>,
    /// Prints a file to begin with: four anchors, a tag that scans, and a beacon
    #[arg(long)]
    example: bool,
    /// The same for so many boards: a tag, and anchors. With four boards, the tag needs its height
    #[arg(long, value_name = "4|5", requires = "example", value_parser = clap::value_parser!(u8).range(4..=5))]
    boards: Option<u8>,
    /// The names of nodes for --show and --read: the file that records are made from. A record has no room for a name
    #[arg(long, value_name = "FILE", conflicts_with_all = ["config", "check", "example"])]
    site: Option<PathBuf>,
    /// Prints JSON: results has an object a file written, or one object, with the node written, the record shown, or
    /// the verdict of --check
    #[arg(long, conflicts_with = "example")]
    json: bool,
    #[command(flatten)]
    probe: ProbeArguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Bin,
    Hex,
}

/// The argument parser of boards.
pub fn boards() -> impl TypedValueParser<Value = Board> {
    PossibleValuesParser::new(Board::HARDWARE.map(Board::name)).map(|name| {
        // The argument parser accepts only known names.
        Board::from_name(&name).unwrap_or(Board::Dwm1001)
    })
}

/// Runs `baliza provision`.
///
/// # Errors
/// A file or a record is wrong, the probe fails, or an output cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(file) = &arguments.config {
        return make(arguments, file);
    }
    if let Some(file) = &arguments.show {
        let held = RecordImage::new(&read_file(file)?)
            .map_err(|(line, what)| UserError::line(file, line, what))?
            .read()
            .map_err(|fault| UserError::file(file, fault.to_string()))?;
        return print_record(arguments, &held);
    }
    if let Some(file) = &arguments.check {
        return check(arguments, file);
    }
    if arguments.read {
        return read(arguments);
    }
    let text = example(arguments.boards);
    match &arguments.out {
        Some(file) => {
            output::check("--out", file)?;
            super::write(file, text.as_bytes())
        }
        None => super::print(text.as_bytes()),
    }
}

/// `--config`: writes the records to files or to a board, or prints them as `--show` would.
fn make(arguments: &Arguments, file: &Path) -> Result<()> {
    let mut site = Site::read(file)?;
    give_keys(&mut site)?;
    if arguments.all && arguments.write {
        return write_all(arguments, file, &site);
    }
    if arguments.all {
        return make_all(arguments, &site);
    }
    let node = site.node(arguments.node.as_deref())?;
    let record = node.record_for(arguments.board)?;
    if arguments.write {
        write(arguments, node, board_of(arguments.board, node)?, &contents(node, record))?;
        warn(&site, [node]);
        return Ok(());
    }
    let Some(out) = &arguments.out else {
        return Err(UserError::flag("--config", "say where the record goes: --out FILE, or --write").into());
    };
    output::check("--out", out)?;
    if !arguments.force {
        refuse_other_content(out)?;
    }
    let board = board_of(arguments.board, node)?;
    let contents = contents(node, record);
    write_record(out, &contents, &encoded(arguments.format, board, &contents)?)?;
    warn(&site, [node]);
    report(arguments, &[made(node, board, &contents, out)])
}

/// Refuses a file that has something else than a record: the site, a model that it names, notes.
fn refuse_other_content(out: &Path) -> Result<(), UserError> {
    let is_file = fs::metadata(out).is_ok_and(|metadata| metadata.is_file() && metadata.len() > 0);
    if is_file && !holds_record(out) {
        return Err(UserError::flag("--out", format!("{} is no record; --force replaces it", out.display())));
    }
    Ok(())
}

/// The names of the files in a folder that have a good record.
fn records_in(folder: &Path) -> HashSet<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let is_named = |name: &String| name.ends_with(".bin") || name.ends_with(".hex");
    names.filter(|name| is_named(name) && holds_record(&folder.join(name))).collect()
}

/// Whether a file has a good record.
fn holds_record(file: &Path) -> bool {
    // It is looked at and not an input: the output may replace it.
    let is_small = fs::metadata(file).is_ok_and(|of| of.is_file() && of.len() <= IMAGE_BYTES);
    is_small && fs::read(file).is_ok_and(|bytes| RecordImage::new(&bytes).is_ok_and(|image| image.read().is_ok()))
}

fn warn<'n>(site: &Site, nodes: impl IntoIterator<Item = &'n Node>) {
    super::warn(warnings(nodes).into_iter().chain(oddities(site)));
}

fn make_all(arguments: &Arguments, site: &Site) -> Result<()> {
    let Some(folder) = &arguments.out else {
        return Err(UserError::flag("--all", "say which folder the records go to: --out FOLDER").into());
    };
    let extension = match arguments.format {
        Format::Bin => "bin",
        Format::Hex => "hex",
    };
    let mut made_files = Vec::new();
    let mut files = Vec::new();
    for node in &site.nodes {
        let board = board_of(arguments.board, node)?;
        let contents = contents(node, node.record_for(Some(board))?);
        let name = format!("{}.{extension}", node.name);
        made_files.push(made(node, board, &contents, &folder.join(&name)));
        files.push((name, has_key(&contents), encoded(arguments.format, board, &contents)?));
    }
    let names: Vec<_> = site.nodes.iter().map(|node| node.name.clone()).collect();
    // A record of a node that is not in the file any more goes as well: a folder has the records of one file.
    let records = records_in(folder);
    let ours = move |file: &str| {
        let name = file.strip_suffix(".bin").or_else(|| file.strip_suffix(".hex"));
        name.is_some_and(|name| names.iter().any(|node| node == name)) || records.contains(file)
    };
    let output = OutputFolder::begin("--out", folder, ours, arguments.force)?;
    let cannot = || format!("cannot write the records into {}", folder.display());
    for (name, has_key, bytes) in &files {
        let written = if *has_key { output.write_private(name, bytes) } else { output.write(name, bytes) };
        written.with_context(cannot)?;
    }
    output.finish().with_context(cannot)?;
    warn(site, &site.nodes);
    report(arguments, &made_files)
}

fn has_key(contents: &Contents<'_>) -> bool {
    contents.record.network.key.or(contents.record.beacon_key).is_some() || contents.wifi.is_some()
}

/// Gives nodes with Wi-Fi their keys, and says which ones are new.
pub fn give_keys(site: &mut Site) -> Result<()> {
    if let Some((file, made)) = site.give_keys()?
        && !made.is_empty()
    {
        let (file, names) = (file.display(), made.join(", "));
        super::note(&format!("made keys in {file} for {names}: start the station with --gateways {file}\n"));
    }
    Ok(())
}

/// Writes a record to a file; one with a key is for its owner only.
fn write_record(file: &Path, contents: &Contents<'_>, bytes: &[u8]) -> Result<()> {
    if !has_key(contents) {
        return super::write(file, bytes);
    }
    output::write_private_file(file, bytes).with_context(|| format!("cannot write {}", file.display()))
}

/// A written file.
#[derive(serde::Serialize)]
struct Made {
    node: String,
    board: &'static str,
    file: String,
    flash_address: u32,
    #[serde(skip)]
    hint: String,
}

fn made(node: &Node, board: Board, contents: &Contents<'_>, file: &Path) -> Made {
    let flash_address = contents.address(board);
    let name = file.display();
    let hint = match board.spec().flasher {
        Flasher::Espflash(_) => format!("espflash write-bin 0x{flash_address:X} {name}"),
        Flasher::ProbeRs(chip) => {
            format!("probe-rs download --chip {chip} --binary-format bin --base-address 0x{flash_address:X} {name}")
        }
        Flasher::Qemu => String::new(),
    };
    Made { node: node.name.clone(), board: board.name(), file: name.to_string(), flash_address, hint }
}

fn report(arguments: &Arguments, files: &[Made]) -> Result<()> {
    for made in files {
        let hint = match arguments.format {
            Format::Bin => &made.hint,
            Format::Hex => "",
        };
        super::note(&format!("{}: {} for {}", made.file, made.node, made.board));
        super::note(&if hint.is_empty() { "\n".to_owned() } else { format!("; to flash it: {hint}\n") });
    }
    if arguments.json { super::print_json(&files) } else { Ok(()) }
}

fn encoded(format: Format, board: Board, contents: &Contents<'_>) -> Result<Vec<u8>> {
    match format {
        Format::Bin => Ok(contents.binary(board)),
        Format::Hex => Ok(contents.intel_hex(board).context("cannot write Intel HEX")?.into_bytes()),
    }
}

fn write(arguments: &Arguments, node: &Node, board: Board, contents: &Contents<'_>) -> Result<()> {
    let mut session = arguments.probe.attach(board.spec().flasher.probe_chip())?.into_flash();
    let (addresses, sequence) = transfer::write(session.as_mut(), board, contents)?;
    let places = addresses.iter().map(|address| format!("0x{address:08X}")).collect::<Vec<_>>().join(" and ");
    super::note(&format!(
        "{}: written at {places} with sequence {sequence}, compared, and the node restarted\n",
        node.name
    ));
    if arguments.json {
        super::print_json(&serde_json::json!({
            "node": node.name, "board": board.name(), "flash_addresses": addresses, "sequence": sequence,
        }))?;
    }
    Ok(())
}

/// `--write --all`: writes the records of all nodes, board after board.
fn write_all(arguments: &Arguments, file: &Path, site: &Site) -> Result<()> {
    let mut jobs = Vec::new();
    for node in &site.nodes {
        let board = board_of(arguments.board, node)?;
        let record = node.record_for(Some(board))?;
        jobs.push(Job { name: &node.name, board, record, sum: sum(&[&contents(node, record).binary(board)]) });
    }
    warn(site, &site.nodes);
    one_after_another(&arguments.probe, file, (&jobs, ""), &mut |flash, job| {
        let node = site.node(Some(job.name))?;
        transfer::write(flash, job.board, &contents(node, job.record)).map(drop)
    })?;
    if arguments.json {
        let written = jobs.iter().map(|job| serde_json::json!({ "node": job.name, "board": job.board.name() }));
        super::print_json(&written.collect::<Vec<_>>())?;
    }
    Ok(())
}

/// A checksum by which a change of what is written is noticed.
pub fn sum(parts: &[&[u8]]) -> u32 {
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    parts.iter().for_each(|part| digest.update(part));
    digest.finalize()
}

fn read(arguments: &Arguments) -> Result<()> {
    let Some(board) = arguments.board else {
        return Err(UserError::flag("--board", "say what the node is built on").into());
    };
    if !board.spec().flasher.is_readable() {
        let [address, _] = board.pages().addresses();
        let bytes = 2 * board.pages().size + if board.pages().models.is_some() { MODELS_BYTES as u32 } else { 0 };
        let what = format!(
            "a probe does not read an ESP's flash: `espflash read-flash 0x{address:X} 0x{bytes:X} record.bin`, then \
             --show record.bin"
        );
        return Err(UserError::flag("--read", what).into());
    }
    let mut session = arguments.probe.attach(board.spec().flasher.probe_chip())?.into_flash();
    let held =
        transfer::read(session.as_mut(), board)?.with_context(|| format!("the {} at the probe", board.name()))?;
    print_record(arguments, &held)
}

fn print_record(arguments: &Arguments, held: &Held) -> Result<()> {
    let keys = if arguments.show_keys { Keys::Shown } else { Keys::Hidden };
    let names = arguments.site.as_deref().map(SiteNames::read).transpose()?.unwrap_or_default();
    if arguments.json {
        super::print_json(&show::json(held, arguments.board, keys, &names).context("cannot write JSON")?)
    } else {
        super::print(show::toml(held, arguments.board, keys, &names).as_bytes())
    }
}

fn check(arguments: &Arguments, file: &Path) -> Result<()> {
    let checked = match RecordImage::new(&read_file(file)?) {
        Ok(image) => image.check().map_err(|what| UserError::file(file, what)),
        Err((line, what)) => Err(UserError::line(file, line, what)),
    };
    let board = arguments.board.map(|board| (board, board.name()));
    let checked = checked.and_then(|held| match board {
        Some((board, name)) => match held.record.validate_for(board) {
            Ok(()) => Ok(held),
            Err(invalid) => Err(UserError::file(file, format!("a good record, but not for {name}: {invalid}"))),
        },
        None => Ok(held),
    });
    if arguments.json {
        let said = checked.as_ref().map_or_else(ToString::to_string, show::summary);
        let sequence = checked.as_ref().ok().map(|held| held.sequence);
        let document = serde_json::json!({ "good": checked.is_ok(), "verdict": said, "sequence": sequence });
        super::print_json(&document)?;
    }
    let held = checked?;
    if !arguments.json {
        super::print(format!("{}: good: {}\n", file.display(), show::summary(&held)).as_bytes())?;
    }
    Ok(())
}

fn read_file(file: &Path) -> Result<Vec<u8>> {
    Ok(read_limited(file, IMAGE_BYTES)?)
}
