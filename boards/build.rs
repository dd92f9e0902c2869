//! Puts the board's memory map where the linker finds it.

use std::path::PathBuf;
use std::{env, error, fs};

fn main() -> Result<(), Box<dyn error::Error>> {
    println!("cargo::rerun-if-changed=memory");
    let enabled = |board: &str| env::var_os(format!("CARGO_FEATURE_{}", board.to_uppercase())).is_some();
    if let Some(board) = ["dwm1001", "evk1000"].iter().find(|board| enabled(board)) {
        let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("cargo sets OUT_DIR")?);
        fs::copy(format!("memory/{board}.x"), out.join("memory.x"))?;
        println!("cargo::rustc-link-search={}", out.display());
    }
    Ok(())
}
