//! The station as others see it: its API over real connections, and its messages at a real broker.

#![allow(clippy::duplicate_mod, reason = "the broker is shared with the tests of the program")]

mod api;
mod mqtt;
