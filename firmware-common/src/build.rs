//! Which build an image is of: eight bytes that the node tells in each hello, and that its ELF file has in the section
//! `.baliza.build`, so that a host knows whether both belong together.
#![allow(unsafe_code, reason = "a section of one's own is written in assembly")]

/// The build id: four bytes of the commit, four that stand for the sources, the target and the image. Zeros on a desktop.
pub static BUILD: &[u8; 8] = &include!(concat!(env!("OUT_DIR"), "/build_id.rs"));

// The same bytes in a section that is in the file and not in the chip: no linker script needs to know of it, and the linker
// drops no section of this kind.
#[cfg(target_os = "none")]
core::arch::global_asm!(
    ".pushsection .baliza.build,\"\",%progbits",
    concat!(".byte ", env!("BALIZA_BUILD_BYTES")),
    ".popsection"
);
