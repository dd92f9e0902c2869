//! What a node is told once: its configuration in flash.
//!
//! A [`Record`] is written by the host (`baliza provision`) as postcard with a header and a checksum ([`encode`]), into
//! one of two flash pages in turn: a power cut during writing leaves the other page's record. A node takes it by
//! [`load`]. What it knows of beacons' levels on the spot, [`StoredSiteModels`], lies beside.

mod board;
mod models;
mod page;
mod record;
mod region;
mod store;
mod validate;

pub use board::{Board, BoardSpec, Flasher, Memory, Pages, PinChoice};
pub use models::{
    BeaconModel, MODELS_BYTES, MODELS_VERSION, StoredSiteModels, decode_models, encode_models, load_models,
};
pub use page::{HEADER_BYTES, LoadError, MAX_BYTES, MODEL_AT, MODEL_BYTES, decode, encode, version};
pub use record::*;
pub use store::{Next, StoreError, load, load_model, model_of, newest, next, store};
pub use validate::{Invalid, Value};

/// The version of the records that are written; those of version 1 are read as well.
pub const VERSION: u8 = 2;
