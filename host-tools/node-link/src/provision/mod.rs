//! Node records: from a file written by people to the flash of a node, and back.
//!
//! `site.toml`, which the crate `site` parses → [`Site`], its [`Node`]s with their records → [`image`], a file for any flasher, or [`transfer`], over
//! a debug probe, [`one_by_one`] for many boards; with its [`Firmware`], where that is flashed, too. A page of flash →
//! the record → [`show`], whose output [`Site::parse`] reads.

mod advice;
mod calibrated;
mod firmware;
pub mod image;
pub mod one_by_one;
mod region;
pub mod show;
mod site;
pub mod site_models;
mod site_names;
pub mod transfer;
mod written;

pub use ::site::{EXAMPLE, example};
pub use advice::oddities;
pub use firmware::Firmware;
pub use region::warnings;
pub use site::{Node, NodeModels, Site, in_file, read_site};
pub use site_names::{NamedNode, NamedRole, SITE, SiteNames};
pub use written::Written;
