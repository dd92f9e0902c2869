//! A site's file to what the station knows of the site.

use station_core::model::{NodeRole, Zone, ZoneKind};
use station_core::{ReportKind, SourceReport, Utc};

use analysis::survey::presence::Room;
use node_link::provision::{NamedNode, NamedRole, SiteNames};

/// The nodes, beacons and receivers of a site's file, as reports.
pub fn nodes(site: &str, names: &SiteNames, t: Utc) -> Vec<SourceReport> {
    names.nodes().flat_map(reports).map(|what| SourceReport { t, site: site.to_owned(), what }).collect()
}

fn reports(node: NamedNode<'_>) -> impl Iterator<Item = ReportKind> {
    let NamedNode { key, name, role, position_m, height_m, rssi_1m_dbm, path_loss_exponent } = node;
    let role = match role {
        NamedRole::Beacon => NodeRole::Beacon,
        NamedRole::Receiver => NodeRole::Receiver,
        NamedRole::Ranging if position_m.is_some() => NodeRole::Anchor,
        NamedRole::Ranging => NodeRole::Tag,
    };
    let has_path_loss = rssi_1m_dbm.is_some() || path_loss_exponent.is_some();
    let path_loss = has_path_loss.then(|| ReportKind::PathLoss { node: key.clone(), rssi_1m_dbm, path_loss_exponent });
    let height = height_m.map(|height_m| ReportKind::Height { tag: key.clone(), height_m });
    let node = ReportKind::Node { node: key, name: name.map(str::to_owned), role, position_m };
    [node].into_iter().chain(height).chain(path_loss)
}

/// The outlines of a file as the rooms of a site.
pub fn zones(site: &str, rooms: &[Room]) -> Vec<Zone> {
    let corners = |room: &Room| room.corners_m.iter().map(|corner| corner.map(f64::from)).collect();
    let zone = |room: &Room| Zone {
        site: site.to_owned(),
        name: room.name.clone(),
        kind: ZoneKind::Room,
        corners_m: corners(room),
        alarm: false,
    };
    rooms.iter().map(zone).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sites_beacons_and_receivers_have_places_and_path_losses() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("site.toml");
        let text = "[network]\npan = 1\nregion = \"none\"\n[[node]]\nname = \"door\"\nboard = \"esp32c3\"\n\
                    role = \"beacon\"\nuuid = \"c2a8ad55-8a2f-4bb4-9c52-6b3cd7a0e511\"\nmajor = 1\nminor = 1\n\
                    measured_power_dbm = -57\ninterval_ms = 100\ntx_power_dbm = 0\nposition_m = [3.1, 2.0, 2.4]\n\
                    [[beacon]]\nmajor = 1\nminor = 2\nposition_m = [1.0, 0.0, 2.0]\nrssi_1m_dbm = -61.5\n\
                    path_loss_exponent = 2.2\n\
                    [[receiver]]\nname = \"hall\"\nposition_m = [0.5, 4.0, 2.0]\n\
                    [[receiver]]\nname = \"attic\"\nposition_m = [5.0, 4.0, 5.0]\npath_loss_exponent = 3.0\n";
        std::fs::write(&file, text).expect("written");
        let names = SiteNames::read(&file).expect("a site");
        let node = |node: &str, name: Option<&str>, position_m| ReportKind::Node {
            node: node.to_owned(),
            name: name.map(str::to_owned),
            role: NodeRole::Beacon,
            position_m: Some(position_m),
        };
        let receiver = |node: &str, position_m| ReportKind::Node {
            node: node.to_owned(),
            name: None,
            role: NodeRole::Receiver,
            position_m: Some(position_m),
        };
        let path_loss = |node: &str, rssi_1m_dbm, path_loss_exponent| ReportKind::PathLoss {
            node: node.to_owned(),
            rssi_1m_dbm,
            path_loss_exponent,
        };
        let reported: Vec<ReportKind> =
            nodes("hall", &names, Utc::default()).into_iter().map(|report| report.what).collect();
        assert_eq!(
            reported,
            [
                node("1-1", Some("door"), [3.1, 2.0, 2.4]),
                path_loss("1-1", Some(-57.0), None),
                node("1-2", None, [1.0, 0.0, 2.0]),
                path_loss("1-2", Some(-61.5), Some(2.2)),
                receiver("hall", [0.5, 4.0, 2.0]),
                receiver("attic", [5.0, 4.0, 5.0]),
                path_loss("attic", None, Some(3.0)),
            ]
        );
    }
}
