//! The build script of the nodes' packages: the linker's scripts, which differ from one board to the next.

use std::env;

/// Cortex-M. `--nmagic`: sections are not spread over pages of an operating system. `--icf`: functions of equal code become one.
const CORTEX_M: [&str; 4] = ["--nmagic", "--icf=all", "-Tlink.x", "-Tdefmt.x"];

fn main() {
    println!("cargo::rerun-if-changed=../boards/link.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let boards = ["dwm1001", "evk1000", "esp32c3", "esp32c6", "esp32", "simulated", "wired"];
    let enabled = |board: &&str| env::var_os(format!("CARGO_FEATURE_{}", board.to_uppercase())).is_some();
    let arguments: &[&[&str]] = match boards.into_iter().find(enabled) {
        Some("dwm1001") => &[&CORTEX_M],
        // STM32F105RC: the last two pages of its flash (256 KiB) hold the node record.
        Some("evk1000") => &[&["--defsym=_flash_origin=0x08000000", "--defsym=_flash_length=252K"], &CORTEX_M],
        // What esp-hal's `linkall.x` includes, but for its `memory.x`: the linker would take the DWM1001's for it.
        Some("esp32c3") => &[&["-Tmap-esp32c3.x", "-Tesp32c3.x", "-Thal-defaults.x", "-Tdefmt.x"]],
        Some("esp32c6") => &[&["-Tmap-esp32c6.x", "-Tesp32c6.x", "-Thal-defaults.x", "-Tdefmt.x"]],
        Some("esp32") => &[&["-Tmap-esp32.x", "-Talias.x", "-Tesp32.x", "-Thal-defaults.x", "-Tdefmt.x"]],
        Some("simulated" | "wired") => match env::var("CARGO_CFG_TARGET_ARCH").as_deref() {
            Ok("riscv32") => &[&["--nmagic", "-Tmap-simulated-riscv32.x", "-Tlink.x", "-Tdefmt.x"]],
            // QEMU's mps2-an386 has 4 MiB of flash, and as much RAM, from whose end the stack grows.
            _ => &[&[
                "--defsym=_flash_length=4M",
                "--defsym=_stack_start=0x20400000",
                "--nmagic",
                "-Tlink.x",
                "-Tdefmt.x",
            ]],
        },
        _ => &[],
    };
    for argument in arguments.iter().copied().flatten() {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
