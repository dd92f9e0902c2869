//! The node record: its bytes, its way into flash and out of it, and what it refuses.

mod bytes;
mod examples;
mod flash;
mod models;
mod power;
mod store;
mod validate;
