//! A site's file to what the station knows of the site.

use baliza_station::model::{Role, Zone, ZoneKind};
use baliza_station::{Report, Utc, What};

use crate::node::provision::{NamedNode, SiteNames};
use crate::survey::presence::Room;

/// The nodes of a site's file, as reports.
pub fn nodes(site: &str, names: &SiteNames, t: Utc) -> Vec<Report> {
    let what = |node: NamedNode<'_>| What::Node {
        role: match node.position_m {
            _ if node.is_beacon => Role::Beacon,
            Some(_) => Role::Anchor,
            None => Role::Tag,
        },
        node: node.key,
        name: node.name.map(str::to_owned),
        position_m: node.position_m,
    };
    names.nodes().map(|node| Report { t, site: site.to_owned(), what: what(node) }).collect()
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
