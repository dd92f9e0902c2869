//! Puts the board's memory map where the linker finds it.

use std::path::PathBuf;
use std::{env, error, fs};

fn main() -> Result<(), Box<dyn error::Error>> {
    println!("cargo::rerun-if-changed=memory");
    let enabled = |board: &str| env::var_os(format!("CARGO_FEATURE_{}", board.to_uppercase())).is_some();
    let processor = env::var("CARGO_CFG_TARGET_ARCH")?;
    let map = match ["dwm1001", "evk1000", "simulated", "wired"].into_iter().find(|board| enabled(board)) {
        Some("simulated" | "wired") if ["arm", "riscv32"].contains(&processor.as_str()) => {
            Some(format!("simulated-{processor}"))
        }
        // On a desktop there is no map to be had.
        Some("simulated" | "wired") | None => None,
        Some(board) => Some(board.to_owned()),
    };
    if let Some(map) = map {
        let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("cargo sets OUT_DIR")?);
        fs::copy(format!("memory/{map}.x"), out.join("memory.x"))?;
        println!("cargo::rustc-link-search={}", out.display());
    }
    Ok(())
}
