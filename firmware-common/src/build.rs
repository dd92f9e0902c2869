//! The build that an image comes from: eight bytes. The node sends them in each hello, and its ELF file has them in the
//! section `.baliza.build`. So a host knows whether the node and the file belong together.
#![allow(unsafe_code, reason = "a section of one's own is written in assembly")]

/// The build id: four bytes of the commit, and four bytes of a hash of the sources, the target and the image. Zeros on
/// a desktop.
pub static BUILD: &[u8; 8] = &include!(concat!(env!("OUT_DIR"), "/build_id.rs"));

// The same bytes in a section that is in the file and not in the chip. No linker script needs to list the section, and
// the linker drops no section of this kind.
#[cfg(target_os = "none")]
core::arch::global_asm!(
    ".pushsection .baliza.build,\"\",%progbits",
    concat!(".byte ", env!("BALIZA_BUILD_BYTES")),
    ".popsection"
);
