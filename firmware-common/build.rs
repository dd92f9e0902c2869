//! Computes the build id of an image: four bytes of the commit, then four bytes of a hash. The hash covers the present
//! sources, the target, the profile and the image's name (`BALIZA_IMAGE`, such as `tag-dwm1001-ble`). The id is zeros
//! on a desktop, which needs none.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

/// The sources of an image beside its crates, relative to the repository's root.
const SOURCES: [&str; 5] = [".cargo/config.toml", "Cargo.toml", "Cargo.lock", "memory.x", "boards"];

fn main() {
    println!("cargo::rerun-if-env-changed=BALIZA_IMAGE");
    let bare_metal = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "none");
    let mut id = [0_u8; 8];
    if bare_metal {
        let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("..");
        id[..4].copy_from_slice(&commit(&root));
        id[4..].copy_from_slice(&everything_else(&root).to_be_bytes());
    } else {
        println!("cargo::rerun-if-changed=build.rs");
    }
    let list = id.map(|byte| byte.to_string()).join(",");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it"));
    fs::write(out.join("build_id.rs"), format!("[{list}]\n")).expect("OUT_DIR is ours");
    println!("cargo::rustc-env=BALIZA_BUILD_BYTES={list}");
}

/// The first four bytes of the commit, or zeros without a repository.
fn commit(root: &Path) -> [u8; 4] {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    // Git writes this file at each commit and each change of branch.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={}", root.join(log).display());
    }
    let commit = git(&["rev-parse", "HEAD"]).and_then(|hash| u32::from_str_radix(hash.get(..8)?, 16).ok());
    commit.unwrap_or(0).to_be_bytes()
}

fn everything_else(root: &Path) -> u32 {
    let mut hash = Fnv(0x811C_9DC5);
    for name in ["TARGET", "PROFILE", "BALIZA_IMAGE"] {
        hash.add(env::var(name).unwrap_or_default().as_bytes());
    }
    let crates =
        fs::read_dir(root).into_iter().flatten().flatten().map(|entry| entry.path()).filter(|path| is_no_std(path));
    let mut sources: Vec<PathBuf> = SOURCES.iter().map(|source| root.join(source)).chain(crates).collect();
    sources.sort();
    for path in sources {
        println!("cargo::rerun-if-changed={}", path.display());
        hash.add_path(&path);
    }
    hash.0
}

/// Whether a directory has a crate that needs no operating system. All crates of an image are of this kind.
fn is_no_std(directory: &Path) -> bool {
    let library = fs::read_to_string(directory.join("src/lib.rs"));
    library.is_ok_and(|source| source.lines().any(|line| line == "#![no_std]"))
}

/// FNV-1a, 32 bits.
struct Fnv(u32);

impl Fnv {
    fn add(&mut self, bytes: &[u8]) {
        // The length separates one text from the next.
        let length = (bytes.len() as u32).to_le_bytes();
        self.0 =
            length.iter().chain(bytes).fold(self.0, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193));
    }

    /// Adds a file, or all files below a directory in the order of their names.
    fn add_path(&mut self, path: &Path) {
        if let Ok(entries) = fs::read_dir(path) {
            let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
            paths.sort();
            paths.iter().for_each(|path| self.add_path(path));
        } else if let Ok(bytes) = fs::read(path) {
            self.add(path.file_name().unwrap_or_default().as_encoded_bytes());
            self.add(&bytes);
        }
    }
}
