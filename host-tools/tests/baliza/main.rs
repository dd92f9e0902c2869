//! Runs `baliza` as a user does: arguments and files in; exit code, standard output, standard error and files out.

/// The program.
const PROGRAM: &str = env!("CARGO_BIN_EXE_baliza");

mod antenna_delay;
mod ble;
mod building;
mod causes;
mod check;
mod companions;
mod contract;
mod coverage;
mod decode;
mod documents;
mod example;
mod fingerprint;
mod flash;
mod folders;
mod formats;
#[cfg(feature = "foxglove")]
mod foxglove_client;
mod import;
mod interrupted;
mod limits;
mod links;
mod manners;
#[cfg(target_os = "linux")]
mod memory;
mod messages;
mod monitor;
mod nlos;
mod outputs;
mod pictures;
mod piped;
mod presence;
mod provision;
mod record;
mod recordings;
mod replay;
mod residuals;
mod rooms;
mod same_positions;
mod schema_check;
mod schemas;
mod simulate;
mod site_models;
mod site_names;
mod smooth;
mod streams;
mod support;
mod survey;
mod tags;
mod time;
mod track;
#[cfg(feature = "foxglove")]
mod view;
mod wrong_input;
