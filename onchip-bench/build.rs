//! Linker scripts and memory map of the bare-metal images; nothing for a desktop.

use std::path::PathBuf;
use std::{env, fs};

fn main() -> std::io::Result<()> {
    println!("cargo::rerun-if-changed=build.rs");
    let memory = match env::var("CARGO_CFG_TARGET_ARCH").as_deref() {
        Ok("arm") => include_str!("memory-cortex-m4f.x"),
        Ok("riscv32") => {
            println!("cargo::rustc-link-arg-bins=-Tmemory.x");
            include_str!("memory-riscv32.x")
        }
        Ok(_) | Err(_) => return Ok(()),
    };
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    fs::write(out.join("memory.x"), memory)?;
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rerun-if-changed=memory-cortex-m4f.x");
    println!("cargo::rerun-if-changed=memory-riscv32.x");
    Ok(())
}
