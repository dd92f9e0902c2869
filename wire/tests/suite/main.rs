//! Tests of what nodes and hosts exchange: the config record, and telemetry by its bytes and in damaged streams.

mod config;
mod drawn;
mod telemetry_golden;
mod telemetry_streams;
