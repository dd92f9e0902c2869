//! Runs `baliza serve`, `baliza live` and `baliza station` as a user does.

mod deploy;
mod forward;
#[cfg(feature = "foxglove")]
#[path = "../../../tests/baliza/foxglove_client.rs"]
mod foxglove_client;
mod live;
#[cfg(feature = "foxglove")]
mod maps;
mod mqtt;
mod receivers;
#[allow(dead_code)]
#[path = "../../../tests/baliza/schema_check.rs"]
mod schema_check;
mod serve;
mod store;
#[allow(dead_code)]
#[path = "../../../tests/baliza/support.rs"]
mod support;
mod wifi;

/// The program. It has the commands of `baliza`, too.
const PROGRAM: &str = env!("CARGO_BIN_EXE_baliza-station");
