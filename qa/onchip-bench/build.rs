//! Sets the linker scripts and the memory map of the bare-metal images. It does nothing for a desktop.

use std::path::PathBuf;
use std::{env, fs};

fn main() -> std::io::Result<()> {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=memory-riscv32.x");
    println!("cargo::rerun-if-changed=../../memory.x");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    match env::var("CARGO_CFG_TARGET_ARCH").as_deref() {
        Ok("arm") => {
            // The DWM1001's map, with the flash of QEMU's mps2-an386, and the stack at the end of its RAM.
            fs::copy("../../memory.x", out.join("memory.x"))?;
            println!("cargo::rustc-link-arg-bins=--defsym=_flash_length=4M");
            println!("cargo::rustc-link-arg-bins=--defsym=_stack_start=0x20400000");
        }
        Ok("riscv32") => {
            fs::copy("memory-riscv32.x", out.join("map-riscv32.x"))?;
            println!("cargo::rustc-link-arg-bins=-Tmap-riscv32.x");
        }
        Ok(_) | Err(_) => return Ok(()),
    }
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    // Only the image that measures the log needs this script.
    println!("cargo::rustc-link-arg-bin=costs=-Tdefmt.x");
    Ok(())
}
