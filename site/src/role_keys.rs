//! Which keys of `[[node]]` are for nodes of which role.

use crate::document::{KeyLines, SiteError};
use crate::node::RoleName;

/// The keys that are only for anchors, only for tags, …
const ROLE_KEYS: [(RoleName, &[&str]); 4] = [
    (
        RoleName::Anchor,
        &[
            "position_m",
            "wifi",
            "simulation.network",
            "simulation.gateway",
            "simulation.cpu_slowdown",
            "simulation.true_antenna_delay_ticks",
        ],
    ),
    (
        RoleName::Tag,
        &[
            "height_m",
            "height_sigma_m",
            "mode",
            "solver",
            "scheme",
            "rate_hz",
            "still_rate_hz",
            "sleep",
            "anchors_per_round",
            "tell_distances",
            "tell_position",
            "advertise_position",
            "report_ranges",
            "scan_interval_ms",
            "scan_window_ms",
            "nlos_model",
            "nlos_classifier",
            "fingerprint_map",
            "room_model",
            "wifi",
            "simulation.count",
            "simulation.data_every_s",
            "simulation.messages_every_s",
            "simulation.network",
            "simulation.cpu_slowdown",
            "simulation.true_antenna_delay_ticks",
            "simulation.path_m",
            "simulation.speed_m_s",
            "simulation.closed",
            "simulation.leaves_s",
            "simulation.carried_by",
            "simulation.vibration_mg",
            "simulation.motion_sensor",
        ],
    ),
    (
        RoleName::Beacon,
        &[
            "position_m",
            "uuid",
            "major",
            "minor",
            "measured_power_dbm",
            "interval_ms",
            "tx_power_dbm",
            "channels",
            "rotate_s",
            "simulation.rssi_1m_dbm",
            "simulation.format",
            "simulation.listed",
        ],
    ),
    (RoleName::Scanner, &["position_m", "wifi", "rssi_1m_dbm", "path_loss_exponent"]),
];

/// Refuses the keys that are not for nodes of this role.
pub(crate) fn refuse_foreign_keys(own: RoleName, lines: &KeyLines) -> Result<(), SiteError> {
    let is_of = |role: RoleName, key: &str| ROLE_KEYS.iter().any(|(of, keys)| *of == role && keys.contains(&key));
    let foreign = lines.keys.iter().filter(|(key, _)| !is_of(own, key));
    let foreign = foreign.filter_map(|(key, line)| {
        let (of, _) = ROLE_KEYS.iter().find(|(_, keys)| keys.contains(&key.as_str()))?;
        let key = key.rsplit('.').next().unwrap_or(key);
        let what = "is a key of a node whose role is";
        Some((line, format!("{key} {what} {}, this one's is {}", of.as_str(), own.as_str())))
    });
    foreign.min_by_key(|(line, _)| **line).map_or(Ok(()), |(line, what)| Err(SiteError::at(*line, what)))
}
