//! Runs `baliza` as a user does: arguments and files in; exit code, standard output, standard error and files out.

mod accuracy;
mod antenna_delay;
mod ble;
mod causes;
mod contract;
mod coverage;
mod decode;
#[cfg(feature = "station")]
mod deploy;
mod documents;
mod example;
mod fingerprint;
mod flash;
mod formats;
mod import;
mod interrupted;
mod limits;
#[cfg(feature = "station")]
mod live;
mod manners;
#[cfg(all(feature = "foxglove", feature = "station"))]
mod maps;
#[cfg(target_os = "linux")]
mod memory;
mod messages;
mod monitor;
#[cfg(feature = "station")]
mod mqtt;
mod nlos;
mod outputs;
mod pictures;
mod presence;
mod provision;
#[cfg(feature = "station")]
mod receivers;
mod record;
mod recordings;
mod replay;
mod residuals;
mod rooms;
mod schemas;
#[cfg(feature = "station")]
mod serve;
mod simulate;
mod site_models;
mod site_names;
#[cfg(feature = "station")]
mod station;
mod streams;
mod support;
mod survey;
mod tags;
mod thesis;
mod time;
mod track;
#[cfg(feature = "foxglove")]
mod view;
mod wrong_input;
