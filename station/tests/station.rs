//! The station as others see it: its API over real connections, and its messages at a real broker.

mod api;
mod mqtt;
