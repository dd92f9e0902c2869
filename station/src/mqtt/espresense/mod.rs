//! ESPresense: fixed Bluetooth receivers, which say at `espresense/devices/DEVICE/RECEIVER` what they receive.
//!
//! The input is messages of the broker; the output is reports of the site: a device and its RSSI at a receiver, whose
//! place the companion's file gives ([`House`]). What is no such message is refused, counted and logged.

mod config;
mod floors;

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use serde::Deserialize;
use tokio::sync::mpsc;
use tokio::time::Instant;

pub use self::config::{House, NoHouse};
use self::floors::Floors;
use crate::bounds::is_name;
use crate::model::NodeRole;
use crate::{ReportKind, SourceReport, Utc};

/// The time between two lines of the log about messages that were refused.
const LOG_EVERY: Duration = Duration::from_secs(60);
/// Receivers that are noted because the file does not have them.
const STRANGERS: usize = 100;
/// The most bytes of a topic's level in the log.
const SHOWN: usize = 80;

/// What a receiver says of a device.
#[derive(Debug, Deserialize)]
struct Said {
    name: Option<String>,
    /// Some messages are about the battery alone.
    rssi: Option<f64>,
    #[serde(rename = "rssi@1m")]
    rssi_1m: Option<f64>,
}

/// The receivers of a house.
pub(super) struct Espresense {
    house: House,
    site: String,
    reports: mpsc::Sender<SourceReport>,
    /// By key: node and floor.
    receivers: HashMap<String, Vec<(String, usize)>>,
    floors: Floors,
    strangers: HashSet<String>,
    refused: u64,
    logged: Option<Instant>,
}

impl Espresense {
    /// What it subscribes to.
    pub(super) const FILTERS: [&'static str; 2] = ["espresense/devices/+/+", "espresense/rooms/+/status"];

    pub(super) fn new(house: House, site: String, reports: mpsc::Sender<SourceReport>) -> Self {
        let mut receivers: HashMap<String, Vec<(String, usize)>> = HashMap::new();
        for receiver in &house.receivers {
            receivers.entry(receiver.key.clone()).or_default().push((receiver.node.clone(), receiver.floor));
        }
        Self {
            house,
            site,
            reports,
            receivers,
            floors: Floors::default(),
            strangers: HashSet::new(),
            refused: 0,
            logged: None,
        }
    }

    /// Takes a message.
    pub(super) async fn take(&mut self, topic: &str, payload: &[u8], is_retained: bool) {
        let levels: Vec<&str> = topic.split('/').collect();
        match levels[..] {
            // A retained one is of an unknown time.
            ["espresense", "devices", device, receiver] if !is_retained => match self.said(device, receiver, payload) {
                Ok(reports) => {
                    for report in reports {
                        // The hub has ended: nobody takes reports any more.
                        let _ = self.reports.send(report).await;
                    }
                }
                Err(why) => self.refuse(topic, &why),
            },
            ["espresense", "rooms", receiver, "status"] if payload == b"offline" => {
                log::warn!("espresense: the receiver {} is offline", shown(receiver));
            }
            _ => {}
        }
    }

    /// The reports of a message; none of what is not wanted.
    fn said(&mut self, device: &str, receiver: &str, payload: &[u8]) -> Result<Vec<SourceReport>, String> {
        let said: Said = serde_json::from_slice(payload).map_err(|error| error.to_string())?;
        let Some(rssi_dbm) = said.rssi else { return Ok(Vec::new()) };
        for dbm in [Some(rssi_dbm), said.rssi_1m].into_iter().flatten() {
            positioning_core::ble::signal::rssi(dbm).map_err(|_| format!("{dbm} dBm is no RSSI"))?;
        }
        if !is_name(device) {
            return Err("the device's id is too long".to_owned());
        }
        let said_name = said.name.as_deref().filter(|name| is_name(name));
        let Some(wanted) = self.house.device(device, said_name) else { return Ok(Vec::new()) };
        let Some(nodes) = self.receivers.get(&config::key(receiver)) else {
            if self.strangers.len() < STRANGERS && self.strangers.insert(receiver.to_owned()) {
                log::warn!(
                    "espresense: the receiver {} is not in the file's `nodes`: what it receives is left out",
                    shown(receiver)
                );
            }
            return Ok(Vec::new());
        };
        let t = Utc::now();
        let name = wanted.name.or(said_name);
        let floors: Vec<usize> = nodes.iter().map(|(_, floor)| *floor).collect();
        let Some((floor, is_new)) = self.floors.note(device, name, &floors, rssi_dbm, t) else {
            return Err("there are too many devices".to_owned());
        };
        let mut whats = Vec::new();
        if is_new {
            let (node, name) = (device.to_owned(), name.map(str::to_owned));
            whats.push(ReportKind::Node { node, name, role: NodeRole::Tag, position_m: None });
        }
        if let Some((node, _)) = nodes.iter().find(|(_, on)| *on == floor) {
            let rssi_1m_dbm = wanted.rssi_1m_dbm.or(said.rssi_1m);
            whats.push(ReportKind::ReceiverSighting {
                receiver: node.clone(),
                device: device.to_owned(),
                rssi_dbm,
                rssi_1m_dbm,
            });
        }
        Ok(whats.into_iter().map(|what| SourceReport { t, site: self.site.clone(), what }).collect())
    }

    fn refuse(&mut self, topic: &str, why: &str) {
        self.refused += 1;
        if self.logged.is_none_or(|logged| logged.elapsed() >= LOG_EVERY) {
            let (count, topic) = (std::mem::take(&mut self.refused), shown(topic));
            log::warn!("espresense: {count} messages were refused, the last one at {topic}: {why}");
            self.logged = Some(Instant::now());
        }
    }
}

/// The beginning of a text from the air.
fn shown(text: &str) -> String {
    text.chars().take(SHOWN).flat_map(char::escape_debug).collect()
}

#[cfg(test)]
mod tests;
