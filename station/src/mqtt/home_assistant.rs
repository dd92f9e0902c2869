//! Discovery documents for Home Assistant, one a device (its documentation: "MQTT", "Device discovery payload").
//!
//! A tag is a device with the sensor of its room, a tracker, and whether it reports. An anchor is a device that has a
//! problem while it was probably moved. Both have the supply voltage of their radio, where it is known. The states are
//! in the topics of [`Topics`]; templates take them from there.

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::topics::{Topics, identifier};
use crate::model::{NodeRole, NodeStatus, TagStatus};

/// Where Home Assistant tells that it is there, below its prefix.
pub(super) const STATUS: &str = "status";
/// What it says.
pub(super) const ONLINE: &[u8] = b"online";

/// Discovery below a prefix of Home Assistant's, `homeassistant` unless it was changed.
#[derive(Clone, Debug)]
pub(super) struct Discovery {
    prefix: String,
    topics: Topics,
}

/// What belongs to all components of a device.
#[derive(Serialize)]
struct Shared {
    device: Value,
    origin: Value,
    availability: [Value; 1],
    components: Map<String, Value>,
}

impl Discovery {
    pub(super) fn new(prefix: &Topics, topics: &Topics) -> Self {
        Self { prefix: prefix.prefix().to_owned(), topics: topics.clone() }
    }

    /// What its topics begin with.
    pub(super) fn prefix(&self) -> &str {
        &self.prefix
    }

    /// Where Home Assistant says that it is there.
    pub(super) fn status(&self) -> String {
        format!("{}/{STATUS}", self.prefix)
    }

    /// The topic of a tag's or a node's document.
    pub(super) fn topic(&self, site: &str, name: &str) -> String {
        format!("{}/device/{}/config", self.prefix, self.device_id(site, name))
    }

    /// A tag's document.
    pub(super) fn tag(&self, tag: &TagStatus) -> String {
        let id = self.device_id(&tag.site, &tag.tag);
        let (room, position) = (self.topics.room(&tag.site, &tag.tag), self.topics.position(&tag.site, &tag.tag));
        let components = [
            (
                "room",
                json!({
                    "platform": "sensor",
                    "name": "Room",
                    "icon": "mdi:floor-plan",
                    "state_topic": &room,
                    // Home Assistant takes `None` for an unknown state.
                    "value_template": "{{ value_json.room }}",
                }),
            ),
            (
                "tracker",
                json!({
                    "platform": "device_tracker",
                    "name": null,
                    "source_type": "bluetooth_le",
                    "state_topic": &room,
                    "value_template": "{{ 'not_home' if value_json.silent else (value_json.room or 'home') }}",
                    "json_attributes_topic": position,
                }),
            ),
            (
                "reports",
                json!({
                    "platform": "binary_sensor",
                    "name": "Reports",
                    "device_class": "connectivity",
                    "entity_category": "diagnostic",
                    "state_topic": &room,
                    "value_template": "{{ 'OFF' if value_json.silent else 'ON' }}",
                }),
            ),
        ];
        let supply = tag.supply_v.map(|_| ("supply", supply(room)));
        let name = tag.name.as_deref().unwrap_or(&tag.tag);
        self.document(&id, name, "tag", &tag.tag, components.into_iter().chain(supply))
    }

    /// An anchor's document; none for what does not measure ranges, which nobody can see to be moved.
    pub(super) fn node(&self, node: &NodeStatus) -> Option<String> {
        match node.role {
            NodeRole::Anchor => {}
            NodeRole::Tag | NodeRole::Beacon | NodeRole::Receiver => return None,
        }
        let id = self.device_id(&node.site, &node.node);
        let moved = json!({
            "platform": "binary_sensor",
            "name": "Moved",
            "device_class": "problem",
            "entity_category": "diagnostic",
            "state_topic": self.topics.health(&node.site, &node.node),
            "value_template": "{{ 'ON' if value_json.moved else 'OFF' }}",
        });
        let supply = node.health.supply_v.map(|_| ("supply", supply(self.topics.health(&node.site, &node.node))));
        let name = node.name.as_deref().unwrap_or(&node.node);
        Some(self.document(&id, name, "anchor", &node.node, [("moved", moved)].into_iter().chain(supply)))
    }

    fn device_id(&self, site: &str, name: &str) -> String {
        identifier(&[self.topics.prefix(), site, name])
    }

    fn document<'a>(
        &self,
        id: &str,
        name: &str,
        model: &str,
        address: &str,
        components: impl Iterator<Item = (&'a str, Value)>,
    ) -> String {
        let component = |(key, mut component): (&str, Value)| {
            let unique = format!("{id}__{key}");
            component["unique_id"] = json!(unique);
            (unique, component)
        };
        let shared = Shared {
            device: json!({
                "identifiers": [id],
                "name": name,
                "manufacturer": "Baliza",
                "model": model,
                "serial_number": address,
            }),
            origin: json!({ "name": "Baliza", "sw_version": env!("CARGO_PKG_VERSION") }),
            availability: [json!({ "topic": self.topics.status() })],
            components: components.map(component).collect(),
        };
        super::json(&shared)
    }
}

/// The sensor of a radio's supply voltage, which a document of a topic has.
fn supply(topic: String) -> Value {
    json!({
        "platform": "sensor",
        "name": "Supply",
        "device_class": "voltage",
        "state_class": "measurement",
        "unit_of_measurement": "V",
        "entity_category": "diagnostic",
        "state_topic": topic,
        "value_template": "{{ value_json.supply_v }}",
    })
}
