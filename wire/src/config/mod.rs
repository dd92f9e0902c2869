//! The configuration of a node, stored in its flash.
//!
//! The host writes a [`Record`] (`baliza provision`) as postcard with a header and a checksum ([`encode`]). It uses two
//! flash pages in turn: a power cut during writing leaves the other page's record. A node reads the record with
//! [`load`]. The flash also contains [`StoredSiteModels`], the models of the beacons' RSSI at the site.

mod board;
mod models;
mod page;
mod record;
mod region;
mod store;
mod validate;
mod wifi_settings;

pub use board::{Board, BoardSpec, Flasher, Memory, Pages, PinChoice};
pub use models::{
    BeaconModel, MODELS_BYTES, MODELS_VERSION, StoredSiteModels, decode_models, encode_models, load_models,
};
pub use page::{HEADER_BYTES, LoadError, MAX_BYTES, MODEL_AT, MODEL_BYTES, decode, encode, version};
pub use record::*;
pub use store::{Next, StoreError, load, load_model, model_of, newest, next, store};
pub use validate::{Invalid, MAX_RATE_CHZ, Value};
pub use wifi_settings::{WIFI_AT, WIFI_BYTES, WIFI_VERSION, Wifi, WifiKey, encode_wifi, load_wifi, wifi_of};

/// The newest version of config records. Older ones, from 1 on, can also be read.
pub const VERSION: u8 = 4;
