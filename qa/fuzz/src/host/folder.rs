//! The folder of the files that an input becomes, in memory where the system has such a folder.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Writes a file of this name, and returns its path.
pub fn file(name: &str, bytes: &[u8]) -> PathBuf {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let memory = Path::new("/dev/shm");
        let base = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        let folder = base.join(format!("baliza-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        folder
    });
    let file = folder.join(name);
    std::fs::write(&file, bytes).expect("a file");
    file
}
