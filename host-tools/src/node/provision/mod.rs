//! Node records: from a file written by people to the flash of a node, and back.
//!
//! `site.toml` → [`Site`], its [`Node`]s with their records → [`image`], a file for any flasher, or [`transfer`], over
//! a debug probe. A page of flash → the record → [`show`], whose output [`Site::parse`] reads.

mod advice;
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

pub use advice::oddities;
pub use node::Node;
pub use region::warnings;
pub use site::Site;

/// An example file to start from: four anchors, a tag and a beacon, with comments.
pub const EXAMPLE: &str = include_str!("site.toml");
