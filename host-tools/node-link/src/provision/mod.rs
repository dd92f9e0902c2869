//! Node records: from a file written by people to the flash of a node, and back.
//!
//! `site.toml` → [`Site`], its [`Node`]s with their records → [`image`], a file for any flasher, or [`transfer`], over
//! a debug probe, [`one_by_one`] for many boards; with its [`Firmware`], where that is flashed, too. A page of flash →
//! the record → [`show`], whose output [`Site::parse`] reads.

mod advice;
mod calibrated;
mod document;
mod firmware;
pub mod image;
mod lists;
mod network;
mod node;
pub mod one_by_one;
mod receivers;
mod region;
pub mod show;
mod site;
pub mod site_models;
mod site_names;
pub mod transfer;
mod written;

pub use advice::oddities;
pub use firmware::Firmware;
pub use node::Node;
pub use receivers::Receiver;
pub use region::warnings;
pub use site::Site;
pub use site_names::{NamedNode, NamedRole, SITE, SiteNames};
pub use written::Written;

/// An example file to start from: four anchors, a tag and a beacon, with comments.
pub const EXAMPLE: &str = include_str!("site.toml");
