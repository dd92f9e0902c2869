//! The config record: its bytes, its storing in flash and loading from it, and the values that it refuses.

mod bytes;
mod examples;
mod flash;
mod models;
mod power;
mod store;
mod validate;
