//! The linker arguments for the build scripts of the boards' crates. They differ from one board to the next.

use std::path::{Path, PathBuf};
use std::{env, fs};

/// The arguments for Cortex-M. `--nmagic`: sections are not aligned to pages of an operating system. `--icf`: functions
/// with equal code are merged.
const CORTEX_M: [&str; 4] = ["--nmagic", "--icf=all", "-Tlink.x", "-Tdefmt.x"];

/// The RAM in `memory.x` at the top of the repository.
const TOP_RAM: Region = Region { origin: 0x2000_0000, length: 64 << 10 };

/// Links the images of a Cortex-M board. The file `memory.x` in its crate's directory gives the addresses of flash and
/// RAM. Without that file the board is a DWM1001, whose map is at the top of the repository.
///
/// The linker prefers a `memory.x` in the directory where it runs to any other, and cargo runs it at the top of the
/// repository. So the numbers of another board's file become symbols for the map at the top. But flip-link needs the
/// numbers of the RAM themselves in that map. Of a larger RAM, the variables get the first 64 KiB, and the stack gets
/// the rest behind them. With flip-link the stack gets the rest of the 64 KiB instead.
///
/// # Panics
/// The file lacks a line of `FLASH` or `RAM` with plain numbers. Or its RAM begins at another address than that of the
/// DWM1001, or is smaller.
pub fn cortex_m() {
    if !is_image() {
        return;
    }
    let map = directory().join("memory.x");
    watch(&map);
    if let Ok(text) = fs::read_to_string(&map) {
        let (flash, ram) = (region(&text, "FLASH"), region(&text, "RAM"));
        let is_like_top = ram.origin == TOP_RAM.origin && ram.length >= TOP_RAM.length;
        assert!(is_like_top, "memory.x: RAM must begin at 0x20000000 and have 64K or more, as in memory.x at the top");
        argument(&format!("--defsym=_flash_origin={:#x}", flash.origin));
        argument(&format!("--defsym=_flash_length={:#x}", flash.length));
        argument(&format!("--defsym=_stack_start={:#x}", ram.origin + ram.length));
    }
    watch(&top().join("memory.x"));
    search(&top());
    CORTEX_M.iter().for_each(|it| argument(it));
}

/// Links the images of an ESP: with the memory map `memory-<chip>.x` in the crate's directory, and with the files that
/// esp-hal's `linkall.x` includes. Its own `memory.x` is left out, because the linker would take the DWM1001's file of
/// that name.
pub fn esp(chip: &str) {
    if !is_image() {
        return;
    }
    script(&directory().join(format!("memory-{chip}.x")));
    // The linker script `rwtext_hook.x`, which esp-hal's scripts include, is in this directory.
    search(&directory());
    if env::var("CARGO_CFG_TARGET_ARCH").as_deref() == Ok("xtensa") {
        argument("-Talias.x");
    }
    argument(&format!("-T{chip}.x"));
    ["-Thal-defaults.x", "-Tdefmt.x"].iter().for_each(|it| argument(it));
}

/// Links the images of QEMU's machines.
pub fn qemu() {
    if !is_image() {
        return;
    }
    if env::var("CARGO_CFG_TARGET_ARCH").as_deref() == Ok("riscv32") {
        script(&top().join("boards/link/riscv32.x"));
    } else {
        // mps2-an386 has 4 MiB of flash and 4 MiB of RAM. The stack grows from the end of the RAM.
        argument("--defsym=_flash_length=4M");
        argument("--defsym=_stack_start=0x20400000");
        search(&top());
    }
    ["--nmagic", "-Tlink.x", "-Tdefmt.x"].iter().for_each(|it| argument(it));
}

/// The address and size of a memory, bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Region {
    origin: u64,
    length: u64,
}

/// The region with this name in a memory map with lines like `FLASH : ORIGIN = 0x08000000, LENGTH = 252K`.
fn region(map: &str, name: &str) -> Region {
    let numbers = map.lines().find_map(|line| {
        let rest = line.trim().strip_prefix(name)?.trim_start().strip_prefix(':')?;
        let (origin, length) = rest.split_once(',')?;
        let value =
            |text: &str, key: &str| number(text.trim().strip_prefix(key)?.trim_start().strip_prefix('=')?.trim());
        Some(Region { origin: value(origin, "ORIGIN")?, length: value(length, "LENGTH")? })
    });
    numbers.unwrap_or_else(|| panic!("memory.x has no line `{name} : ORIGIN = …, LENGTH = …` with plain numbers"))
}

fn number(text: &str) -> Option<u64> {
    if let Some(digits) = text.strip_prefix("0x") {
        return u64::from_str_radix(digits, 16).ok();
    }
    let (digits, unit) = match text.strip_suffix('K') {
        Some(digits) => (digits, 1 << 10),
        None => text.strip_suffix('M').map_or((text, 1), |digits| (digits, 1 << 20)),
    };
    digits.parse::<u64>().ok()?.checked_mul(unit)
}

/// Whether this build is for a chip. A build for a desktop needs no arguments.
fn is_image() -> bool {
    env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("none")
}

/// The directory of the board's crate.
fn directory() -> PathBuf {
    env::var_os("CARGO_MANIFEST_DIR").map(PathBuf::from).expect("cargo sets it")
}

/// The top of the repository, two levels above each board's crate.
fn top() -> PathBuf {
    directory().join("../..").canonicalize().expect("boards are in the repository")
}

fn script(path: &Path) {
    watch(path);
    argument(&format!("-T{}", path.display()));
}

fn search(directory: &Path) {
    println!("cargo::rustc-link-search={}", directory.display());
}

fn watch(path: &Path) {
    println!("cargo::rerun-if-changed={}", path.display());
}

fn argument(it: &str) {
    println!("cargo::rustc-link-arg-bins={it}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_of_a_map_are_read() {
        let map =
            "MEMORY\n{\n  FLASH : ORIGIN = 0x08000000, LENGTH = 252K\n  RAM   : ORIGIN = 0x20000000, LENGTH = 1M\n}\n";
        assert_eq!(region(map, "FLASH"), Region { origin: 0x0800_0000, length: 252 * 1024 });
        assert_eq!(region(map, "RAM"), Region { origin: 0x2000_0000, length: 1024 * 1024 });
    }

    #[test]
    fn numbers_have_units() {
        assert_eq!(["0x10", "16", "1K", "2M", "1G"].map(number), [Some(16), Some(16), Some(1024), Some(2 << 20), None]);
    }
}
