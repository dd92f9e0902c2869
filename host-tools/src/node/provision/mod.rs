//! Node records: from a file that people write to the flash of a node, and back.
//!
//! `site.toml` → [`Site`], its [`Node`]s with their records → [`image`], a file for any flasher, or [`transfer`], over
//! a debug probe. A page of flash → the record → [`show`], which prints what [`Site::parse`] reads.

mod calibrated;
mod document;
pub mod image;
mod lists;
mod network;
mod node;
mod region;
pub mod show;
mod site;
pub mod site_models;
pub mod transfer;

pub use node::Node;
pub use region::warnings;
pub use site::Site;

/// A file to begin with: four anchors, a tag and a beacon, with comments.
pub const EXAMPLE: &str = include_str!("site.toml");
