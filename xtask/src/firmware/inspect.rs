//! Memory use of an ELF file, and checks that the data for a probe, a bootloader or a host are where these look for
//! them.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use object::read::{Object, ObjectSection, ObjectSymbol};
use object::{File, SectionFlags, elf};
use wire::config::Memory;

use super::matrix::{NodeImage, Platform};
use super::{fast_code, stack};

/// The magic word of an ESP app descriptor.
const APP_DESCRIPTOR: u32 = 0xABCD_5432;

/// Memory use, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Takes {
    /// Code, constants and initial values.
    pub flash: u64,
    /// Variables, without stack.
    pub ram: u64,
    /// The heap, which is a part of the variables, where there is one.
    pub heap: Option<u64>,
    /// The RAM that is left for the stack.
    pub stack: u64,
    /// The stack that a board's program needs, on a Cortex-M.
    pub stack_needed: Option<u64>,
}

/// Bytes of flash: all sections that are loaded, but not those that are filled with zeros at the start.
///
/// # Errors
/// The file cannot be read, or is no ELF file.
pub fn flash(file: &Path) -> Result<u64> {
    let bytes = fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    Ok(flash_of(&parse(file, &bytes)?))
}

/// What an image's sections take, bytes, as the program `size` counts them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sections {
    /// Code and constants.
    pub text: u64,
    /// Variables with initial values.
    pub data: u64,
    /// Variables that are zero at the start, and room that is only reserved.
    pub bss: u64,
}

/// Reads the sections of an image.
///
/// # Errors
/// The file cannot be read, or is no ELF file.
pub fn sections(file: &Path) -> Result<Sections> {
    let bytes = fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let mut sizes = Sections::default();
    for section in parse(file, &bytes)?.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else { continue };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 {
            continue;
        }
        let sum = if section.kind().is_bss() {
            &mut sizes.bss
        } else if sh_flags & u64::from(elf::SHF_WRITE) != 0 {
            &mut sizes.data
        } else {
            &mut sizes.text
        };
        *sum += section.size();
    }
    Ok(sizes)
}

/// Reads an image's file, and checks its landmarks.
///
/// # Errors
/// The file cannot be read, is no ELF file, or lacks something that its platform needs.
pub fn inspect(file: &Path, image: &NodeImage) -> Result<Takes> {
    let bytes = fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let elf = parse(file, &bytes)?;
    check(&elf, image).with_context(|| file.display().to_string())?;
    let mut takes = takes(&elf, image.platform.memory());
    if matches!(image.platform, Platform::Board(_)) && image.platform.target().is_cortex_m() {
        takes.stack_needed = Some(stack::needed(&elf).with_context(|| file.display().to_string())?);
    }
    Ok(takes)
}

fn parse<'b>(file: &Path, bytes: &'b [u8]) -> Result<File<'b>> {
    File::parse(bytes).with_context(|| format!("{} is no ELF file", file.display()))
}

fn is_loaded(flags: SectionFlags) -> bool {
    matches!(flags, SectionFlags::Elf { sh_flags } if sh_flags & u64::from(elf::SHF_ALLOC) != 0)
}

fn flash_of(elf: &File<'_>) -> u64 {
    let sections = elf.sections().filter(|section| is_loaded(section.flags()) && !section.kind().is_bss());
    sections.map(|section| section.size()).sum()
}

fn takes(elf: &File<'_>, memory: Memory) -> Takes {
    let (ram_origin, ram_bytes) = (u64::from(memory.ram.0), u64::from(memory.ram.1));
    let in_ram = |address: u64| (ram_origin..ram_origin + ram_bytes).contains(&address);
    let sections = elf.sections().filter(|section| is_loaded(section.flags()) && in_ram(section.address()));
    // A section that only reserves the stack is not a variable.
    let ram = sections.filter(|section| section.name() != Ok(".stack")).map(|section| section.size()).sum();
    // The allocator itself has this name, too.
    let is_heap = |name: &str, bytes: u64| name.contains("HEAP") && bytes > 1024;
    let heaps = elf.symbols().filter(|symbol| symbol.name().is_ok_and(|name| is_heap(name, symbol.size())));
    let heaps: Vec<_> = heaps.filter(|symbol| in_ram(symbol.address())).map(|symbol| symbol.size()).collect();
    let heap = (!heaps.is_empty()).then(|| heaps.iter().sum());
    let stack = match (address(elf, "_stack_start_cpu0"), address(elf, "_stack_end_cpu0")) {
        (Some(top), Some(bottom)) => top.saturating_sub(bottom),
        _ => ram_bytes.saturating_sub(ram),
    };
    Takes { flash: flash_of(elf), ram, heap, stack, stack_needed: None }
}

fn check(elf: &File<'_>, image: &NodeImage) -> Result<()> {
    let platform = image.platform;
    let memory = platform.memory();
    let (ram_origin, ram_bytes) = (u64::from(memory.ram.0), u64::from(memory.ram.1));
    let ram = ram_origin..=ram_origin + ram_bytes;
    // An image linked with another board's memory map has a section elsewhere.
    for section in elf.sections().filter(|section| is_loaded(section.flags()) && section.size() > 0) {
        let (name, address, bytes) = (section.name()?, section.address(), section.size());
        ensure!(
            memory.holds(address, bytes),
            "{bytes} bytes of {name} at {address:#x} are outside the board's memories"
        );
    }
    if platform.target().is_cortex_m() {
        let table = elf.section_by_name(".vector_table").context("no vector table")?;
        ensure!(
            Some(table.address()) == memory.image_origin.map(u64::from),
            "the vector table is at {:#x}",
            table.address()
        );
        let words = table.data().context("the vector table is empty")?;
        let stack = word(words, 0).context("the vector table is cut short")?;
        let reset = word(words, 1).context("the vector table is cut short")?;
        ensure!(ram.contains(&stack.into()), "the stack begins at {stack:#x}, outside the RAM");
        let code = memory.holds((reset & !1).into(), 2) && !ram.contains(&reset.into());
        ensure!(code, "the reset vector {reset:#x} is outside the flash");
        ensure!(reset & 1 == 1, "the reset vector {reset:#x} is no Thumb code");
    }
    if platform.espflash_chip().is_some() {
        let descriptor = address(elf, "esp_app_desc").context("no app descriptor")?;
        let magic = at(elf, descriptor).context("the app descriptor is in no section")?;
        ensure!(magic == APP_DESCRIPTOR, "the app descriptor begins with {magic:#x}");
        if image.ranges() {
            fast_code::check(elf, memory)?;
        }
    }
    match address(elf, "_SEGGER_RTT") {
        Some(block) => ensure!(ram.contains(&block), "the RTT control block is at {block:#x}, outside the RAM"),
        // The log goes to the serial port.
        None if address(elf, "_baliza_serial_log").is_some() => {}
        None => bail!("no RTT control block"),
    }
    ensure!(elf.section_by_name(".defmt").is_some(), "no table of log lines");
    let build = elf.section_by_name(".baliza.build").context("no build id")?;
    ensure!(build.size() == 8, "the build id has {} bytes", build.size());
    ensure!(build.data()?.iter().any(|byte| *byte != 0), "the build id is zero");
    Ok(())
}

fn address(elf: &File<'_>, name: &str) -> Option<u64> {
    elf.symbol_by_name(name).map(|symbol| symbol.address())
}

fn word(bytes: &[u8], index: usize) -> Option<u32> {
    let bytes = bytes.get(4 * index..4 * index + 4)?;
    Some(u32::from_le_bytes(bytes.try_into().ok()?))
}

/// The word at an address.
fn at(elf: &File<'_>, address: u64) -> Option<u32> {
    let holds = |section: &object::Section<'_, '_>| {
        is_loaded(section.flags()) && (section.address()..section.address() + section.size()).contains(&address)
    };
    let section = elf.sections().find(holds)?;
    let bytes = section.data_range(address, 4).ok()??;
    word(bytes, 0)
}
