//! Sets `BALIZA_VERSION`, which `baliza --version` prints: the package's version, and the commit where it is known.
//!
//! The commit is that of the repository, or what the environment's `BALIZA_COMMIT` says, for builds from an archive.
//! Nothing of the machine goes into it, so that equal sources make equal programs.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The number of digits of a commit that are printed.
const DIGITS: usize = 12;

fn main() {
    println!("cargo::rerun-if-env-changed=BALIZA_COMMIT");
    println!("cargo::rerun-if-changed=build.rs");
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("..");
    let version = env::var("CARGO_PKG_VERSION").expect("cargo sets it");
    let version = match env::var("BALIZA_COMMIT").ok().or_else(|| commit(&root)).as_deref().and_then(shortened) {
        Some(commit) => format!("{version} ({commit})"),
        None => version,
    };
    println!("cargo::rustc-env=BALIZA_VERSION={version}");
}

/// The commit's first digits; `None` for what is no commit.
fn shortened(commit: &str) -> Option<&str> {
    commit.trim().get(..DIGITS).filter(|digits| digits.bytes().all(|digit| digit.is_ascii_hexdigit()))
}

/// The commit of the project's own repository, and not of one that the project's folder happens to lie in.
fn commit(root: &Path) -> Option<String> {
    if !root.join(".git").exists() {
        return None;
    }
    let git = |arguments: &[&str]| {
        let output = Command::new("git").arg("-C").arg(root).args(arguments).output().ok()?;
        output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    // Git writes this file at each commit and each change of branch.
    if let Some(log) = git(&["rev-parse", "--git-path", "logs/HEAD"]) {
        println!("cargo::rerun-if-changed={}", root.join(log).display());
    }
    git(&["rev-parse", "HEAD"])
}
