//! Puts the board's memory map where the linker finds it: `map-….x`, or the DWM1001's `memory.x`, which stands at the top of the
//! repository and serves all Cortex-M images (see there); for an ESP also what of the code lies in RAM.

use std::path::PathBuf;
use std::{env, error, fs};

fn main() -> Result<(), Box<dyn error::Error>> {
    println!("cargo::rerun-if-changed=memory");
    println!("cargo::rerun-if-changed=../memory.x");
    let enabled = |board: &str| env::var_os(format!("CARGO_FEATURE_{}", board.to_uppercase())).is_some();
    let processor = env::var("CARGO_CFG_TARGET_ARCH")?;
    let boards = ["dwm1001", "evk1000", "esp32c3", "esp32c6", "esp32", "simulated", "wired"];
    let board = boards.into_iter().find(|board| enabled(board));
    let (map, name) = match (board, processor.as_str()) {
        (Some("dwm1001" | "evk1000" | "simulated" | "wired"), "arm") => {
            ("../memory.x".to_owned(), "memory.x".to_owned())
        }
        (Some("simulated" | "wired"), "riscv32") => {
            ("memory/simulated-riscv32.x".to_owned(), "map-simulated-riscv32.x".to_owned())
        }
        (Some(esp @ ("esp32c3" | "esp32c6" | "esp32")), "riscv32" | "xtensa") => {
            (format!("memory/{esp}.x"), format!("map-{esp}.x"))
        }
        // On a desktop there is no map to be had.
        _ => return Ok(()),
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("cargo sets OUT_DIR")?);
    fs::copy(map, out.join(name))?;
    if board.is_some_and(|board| board.starts_with("esp")) {
        fs::copy("memory/rwtext_hook.x", out.join("rwtext_hook.x"))?;
    }
    println!("cargo::rustc-link-search={}", out.display());
    Ok(())
}
