//! Warnings about probable mistakes in a site whose records are valid: positions that no room has, anchors that cannot
//! locate the tags of the site.

use wire::config::{Mode, Role, Tag};

use super::{Node, Site};
use analysis::check;
use recording::{Anchor, Coordinates};

/// Anchors of one network are hardly farther apart than this, metres.
const FAR_M: f32 = 300.0;
/// Tags are hardly carried higher than this, metres.
const HIGH_M: f32 = 50.0;

/// Warnings about the site as a whole.
pub fn oddities(site: &Site) -> Vec<String> {
    let tags: Vec<(&Node, &Tag)> = site.nodes.iter().filter_map(|node| Some((node, tag(node)?))).collect();
    let anchors = site.nodes.iter().filter(|node| matches!(node.record.role, Role::Anchor { .. })).count();
    let placed: Vec<Anchor> = site.nodes.iter().filter_map(anchor).collect();
    let mut warnings: Vec<String> = site.nodes.iter().filter_map(far).collect();
    let are_near = warnings.is_empty();
    warnings.extend(check::one_place(placed.iter().map(|anchor| {
        let Coordinates { x_m, y_m, z_m } = anchor.place;
        (anchor.name.as_str(), [x_m, y_m, z_m.unwrap_or(0.0)])
    })));
    if anchors > 0 && placed.is_empty() {
        warnings.push(
            "no anchor has a position_m, so that tags have no positions: measure where the anchors are".to_owned(),
        );
    }
    if !placed.is_empty() {
        warnings.extend(unplaced(site));
    }
    // A DecaRanging pair measures distances only, and anchors may be nodes of another file.
    let needs_three =
        |(node, _): &(&Node, &Tag)| is_own_mode(node.record.network.mode) && node.record.anchors.is_empty();
    if tags.iter().any(needs_three) && (1..3).contains(&anchors) {
        let is = if anchors == 1 { "is only 1 anchor" } else { "are only 2 anchors" };
        warnings.push(format!(
            "there {is}, but a position needs the ranges of 3 where the height is known (height_m), else of 4"
        ));
    }
    let in_space = tags.iter().find(|(_, tag)| tag.height_m.is_none());
    if let Some((node, _)) = in_space.filter(|of| needs_three(of) && anchors == 3 && !placed.is_empty()) {
        warnings.push(format!(
            "there are only 3 anchors, but {} needs the ranges of 4: give it the height at which it is carried, height_m",
            node.name
        ));
    }
    let is_on_a_line = are_near && check::on_a_line(&placed);
    if is_on_a_line && !tags.iter().all(|(_, tag)| tag.area.is_some()) {
        warnings.push(
            "the anchors lie nearly on one line, so that each position has a mirror image on its other side: put an anchor \
             beside the line, or give the [area] in which tags can be"
                .to_owned(),
        );
    } else if let Some((node, _)) = in_space.filter(|_| !is_on_a_line && check::coplanar(&placed)) {
        warnings.push(format!(
            "the anchors lie in one plane, so that the height of {} is uncertain: put one anchor higher or lower, or give \
             height_m",
            node.name
        ));
    }
    for (node, tag) in tags {
        if let Some(height_m) = tag.height_m.filter(|height_m| height_m.abs() > HIGH_M) {
            warnings.push(format!("height_m of {} is {height_m}: is it in metres?", node.name));
        }
    }
    if site.nodes.iter().any(|node| node.wifi.is_some()) && !site.has_gateways() {
        warnings.push(
            "[wifi] has no `gateways`: telemetry goes without a key, and a station takes that with --open-udp only"
                .to_owned(),
        );
    }
    for node in &site.nodes {
        if let Role::Advertiser(beacon) = &node.record.role
            && beacon.measured_power_dbm > 0
        {
            let power = beacon.measured_power_dbm;
            warnings.push(format!(
                "measured_power_dbm of {} is {power}: the RSSI at 1 m is below 0 dBm, is the minus sign missing?",
                node.name
            ));
        }
    }
    warnings
}

/// A warning about anchors without a position.
fn unplaced(site: &Site) -> Option<String> {
    let is_listed = |node: &Node| {
        let listed = |tag: &Node| tag.record.anchors.iter().any(|of| Some(of.address) == node.record.identity.address);
        site.nodes.iter().any(listed)
    };
    let unplaced = |node: &&Node| matches!(node.record.role, Role::Anchor { position_m: None }) && !is_listed(node);
    let names: Vec<&str> = site.nodes.iter().filter(unplaced).map(|node| node.name.as_str()).collect();
    let [first, ..] = names[..] else { return None };
    let names = names.join(", ");
    Some(format!("no position_m of {names}: tags do not use ranges to an anchor without one, measure where {first} is"))
}

fn is_own_mode(mode: Mode) -> bool {
    match mode {
        Mode::Native | Mode::Blink | Mode::Listening { .. } => true,
        Mode::DecaRanging { .. } => false,
    }
}

fn tag(node: &Node) -> Option<&Tag> {
    match &node.record.role {
        Role::Tag(tag) => Some(tag),
        Role::Anchor { .. } | Role::Advertiser(_) | Role::Scanner => None,
    }
}

fn anchor(node: &Node) -> Option<Anchor> {
    let Role::Anchor { position_m } = node.record.role else { return None };
    let [x_m, y_m, z_m] = position_m?.map(f64::from);
    Some(Anchor { name: node.name.clone(), place: Coordinates { x_m, y_m, z_m: Some(z_m) } })
}

fn far(node: &Node) -> Option<String> {
    let Role::Anchor { position_m } = node.record.role else { return None };
    let coordinate = position_m?.into_iter().find(|coordinate| coordinate.abs() > FAR_M)?;
    Some(format!(
        "position_m of {} has {coordinate}, farther than {FAR_M} m from the origin: is it in metres?",
        node.name
    ))
}
