//! The flags of `baliza serve` for MQTT, Home Assistant and ESPresense.

use std::path::PathBuf;
use std::time::Duration;

use recording::UserError;
use recording::read_text;
use station_core::mqtt::espresense::{House, NoHouse};
use station_core::mqtt::{Broker, MqttSettings, NoBroker, Topics};

/// Where the broker's password may be.
const PASSWORD: &str = "BALIZA_MQTT_PASSWORD";
/// The longest time between two positions of a tag, seconds.
const LONGEST_S: f64 = 3600.0;
/// Instead of a prefix of Home Assistant: none.
const OFF: &str = "off";

/// The flags.
#[derive(clap::Args)]
#[command(next_help_heading = "MQTT")]
pub struct MqttArguments {
    /// Publish positions, rooms, events and devices for Home Assistant at a broker: mqtt://USER@HOST:PORT, or mqtts://
    /// for TLS
    #[arg(long, value_name = "URL")]
    mqtt: Option<String>,
    /// A file with the broker's password, which may also be in the environment variable BALIZA_MQTT_PASSWORD
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    mqtt_password_file: Option<PathBuf>,
    /// The certificate of the authority that signed the broker's (PEM); else those that this computer trusts
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    mqtt_ca: Option<PathBuf>,
    /// What the topics begin with. Stations at one broker need different ones
    #[arg(long, value_name = "PREFIX", default_value = "baliza")]
    mqtt_prefix: String,
    /// The least time between two positions of a tag, seconds
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    mqtt_every_s: f64,
    /// The prefix of Home Assistant's discovery; "off" describes no devices
    #[arg(long, value_name = "PREFIX", default_value = "homeassistant")]
    mqtt_discovery: String,
    /// Locate what the house's ESPresense receivers at the broker receive: the config.yaml of ESPresense's companion
    #[arg(long, value_name = "FILE", requires = "mqtt")]
    espresense: Option<PathBuf>,
}

impl MqttArguments {
    /// What the flags say; none without `--mqtt`. The house belongs to `site`.
    pub fn read(&self, site: &str) -> Result<Option<MqttSettings>, UserError> {
        let Some(url) = &self.mqtt else { return Ok(None) };
        let password = match &self.mqtt_password_file {
            Some(file) => Some(read_text(file)?.trim_end_matches(['\r', '\n']).to_owned()),
            None => std::env::var(PASSWORD).ok(),
        };
        let authority = self.mqtt_ca.as_deref().map(read_text).transpose()?;
        let broker = Broker::new(url, password, authority.as_deref().map(str::as_bytes));
        let broker = broker.map_err(|error| match (&error, &self.mqtt_ca) {
            (NoBroker::Certificate, Some(file)) => UserError::file(file, error.to_string()),
            (NoBroker::NoTls, _) => UserError::flag("--mqtt-ca", error.to_string()),
            _ => UserError::flag("--mqtt", error.to_string()),
        })?;
        let topics = |flag, prefix: &str| Topics::new(prefix).map_err(|error| UserError::flag(flag, error.to_string()));
        if !(0.0..=LONGEST_S).contains(&self.mqtt_every_s) {
            let what = format!("{} is not between 0 and {LONGEST_S} seconds", self.mqtt_every_s);
            return Err(UserError::flag("--mqtt-every-s", what));
        }
        let house = self.espresense.as_deref().map(|file| {
            House::read(&read_text(file)?).map_err(|error| match error {
                NoHouse::Yaml { line: Some(line), text } => UserError::line(file, line, text),
                NoHouse::Yaml { line: None, text } | NoHouse::Value(text) => UserError::file(file, text),
            })
        });
        Ok(Some(MqttSettings {
            broker,
            topics: topics("--mqtt-prefix", &self.mqtt_prefix)?,
            every: Duration::from_secs_f64(self.mqtt_every_s),
            discovery: match self.mqtt_discovery.as_str() {
                OFF => None,
                prefix => Some(topics("--mqtt-discovery", prefix)?),
            },
            espresense: house.transpose()?.map(|house| (house, site.to_owned())),
        }))
    }
}
