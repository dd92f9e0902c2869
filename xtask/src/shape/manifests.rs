//! Manifests switch off what a package does not have: a test program without tests, a run of examples without examples.
//! Each costs a start, and a link. What is switched off must not be there, or nobody would run it.

use std::fs;

use anyhow::{Context, Result};

use super::{File, within_package};
use crate::root;

/// What is wrong with the manifests of packages.
pub fn wrong(files: &[File]) -> Result<Vec<String>> {
    let mut wrong = Vec::new();
    let libraries = files.iter().filter_map(|file| file.path.strip_suffix("/src/lib.rs"));
    for package in libraries {
        let path = format!("{package}/Cargo.toml");
        let manifest = fs::read_to_string(root().join(&path)).with_context(|| format!("cannot read {path}"))?;
        let sources = files.iter().filter(|file| within_package(&file.path).is_some_and(|(of, _)| of == package));
        let (mut has_tests, mut has_examples) = (false, false);
        for file in sources {
            has_tests |= !file.path.contains("/src/bin/") && has_test(&file.bare);
            has_examples |= has_example(&file.text);
        }
        let says = |key: &str| library(&manifest).any(|line| line == format!("{key} = false"));
        if has_tests && says("test") {
            wrong.push(format!("{path}: `test = false`, but there are unit tests"));
        }
        if !has_tests && !says("test") {
            wrong.push(format!("{path}: there are no unit tests: write `test = false` under [lib]"));
        }
        if has_examples && says("doctest") {
            wrong.push(format!("{path}: `doctest = false`, but its documentation has examples"));
        }
        if !has_examples && !says("doctest") {
            wrong.push(format!("{path}: no documentation has an example: write `doctest = false` under [lib]"));
        }
    }
    Ok(wrong)
}

/// The lines of a manifest's table `[lib]`.
fn library(manifest: &str) -> impl Iterator<Item = &str> {
    manifest.lines().skip_while(|line| *line != "[lib]").skip(1).take_while(|line| !line.starts_with('['))
}

fn has_test(bare: &str) -> bool {
    ["#[test]", "#[tokio::test", "proptest!"].iter().any(|mark| bare.contains(mark))
}

/// Whether a documentation comment begins a block of code that is Rust.
fn has_example(text: &str) -> bool {
    let mut is_within = false;
    for line in text.lines().map(str::trim_start) {
        let comment = line.strip_prefix("//!").or_else(|| line.strip_prefix("///"));
        let Some(kind) = comment.and_then(|comment| comment.trim().strip_prefix("```")) else { continue };
        is_within = !is_within;
        let is_rust =
            |word: &str| ["", "rust", "no_run", "should_panic", "compile_fail", "edition2024"].contains(&word);
        if is_within && kind.split(',').all(|word| is_rust(word.trim())) {
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_are_blocks_of_rust_in_documentation() {
        assert!(has_example("//! ```\n//! let x = 1;\n//! ```\n"));
        assert!(has_example("    /// ```no_run\n    /// x();\n    /// ```\n"));
        assert!(!has_example("//! ```text\n//! a table\n//! ```\n// ```\n"));
    }

    #[test]
    fn only_the_table_of_the_library_counts() {
        let manifest = "[lib]\nname = \"a\"\ntest = false\n\n[[bin]]\ndoctest = false\n";
        let lines: Vec<_> = library(manifest).collect();
        assert!(lines.contains(&"test = false") && !lines.contains(&"doctest = false"));
    }
}
