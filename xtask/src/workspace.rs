//! The crates of this repository, as cargo lists them.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::{cargo, printed};

/// A crate.
#[derive(Debug, Deserialize)]
pub struct Package {
    pub name: String,
    pub manifest_path: PathBuf,
    /// The oldest Rust that builds it.
    pub rust_version: Option<String>,
    pub features: BTreeMap<String, Vec<String>>,
    pub targets: Vec<Product>,
    /// The table `package.metadata` of its manifest.
    pub metadata: Option<serde_json::Value>,
}

/// A product of a crate: its library or a binary.
#[derive(Debug, Deserialize)]
pub struct Product {
    pub name: String,
    #[serde(rename = "required-features", default)]
    pub required_features: Vec<String>,
}

impl Package {
    /// Whether its library is `no_std`.
    pub fn is_no_std(&self) -> bool {
        let library = self.manifest_path.with_file_name("src").join("lib.rs");
        fs::read_to_string(library).is_ok_and(|source| source.lines().any(|line| line == "#![no_std]"))
    }
}

/// All crates.
///
/// # Errors
/// Cargo cannot list them.
pub fn packages() -> Result<Vec<Package>> {
    #[derive(Deserialize)]
    struct Metadata {
        packages: Vec<Package>,
    }
    let text = printed(cargo().args(["metadata", "--no-deps", "--format-version", "1"]))?;
    let metadata: Metadata = serde_json::from_str(&text).context("cargo metadata")?;
    Ok(metadata.packages)
}
