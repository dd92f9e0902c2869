//! The build script of the nodes' packages: the linker's scripts, which differ from one family of boards to the next.

use std::env;

fn main() {
    println!("cargo::rerun-if-changed=../boards/link.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let enabled = |board: &str| env::var_os(format!("CARGO_FEATURE_{}", board.to_uppercase())).is_some();
    let arguments: &[&str] = if ["dwm1001", "evk1000"].iter().any(|board| enabled(board)) {
        // `--nmagic`: sections are not spread over pages of an operating system. `--icf`: functions of equal code become one.
        &["--nmagic", "--icf=all", "-Tlink.x", "-Tdefmt.x"]
    } else if ["esp32c3", "esp32c6", "esp32"].iter().any(|board| enabled(board)) {
        &["-Tlinkall.x", "-Tdefmt.x"]
    } else if ["simulated", "wired"].iter().any(|board| enabled(board)) {
        match env::var("CARGO_CFG_TARGET_ARCH").as_deref() {
            // The memory map is a script of its own there.
            Ok("riscv32") => &["--nmagic", "-Tmemory.x", "-Tlink.x", "-Tdefmt.x"],
            _ => &["--nmagic", "-Tlink.x", "-Tdefmt.x"],
        }
    } else {
        &[]
    };
    for argument in arguments {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
