//! `baliza ble`: positions from the levels of Bluetooth beacons.

mod rooms;
mod solve;

use std::collections::BTreeSet;

use anyhow::Result;
use host_tools::ble::files::{Beacon, Capture};

/// Positions from the levels of Bluetooth beacons
#[derive(clap::Subcommand)]
pub enum Command {
    Rooms(rooms::Arguments),
    Solve(solve::Arguments),
}

pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Rooms(arguments) => rooms::run(arguments),
        Command::Solve(arguments) => solve::run(arguments),
    }
}

/// Tells of what was heard and is not on the map, and of what is on the map and was never heard.
fn tell_unknown(beacons: &[Beacon], captures: &[Capture]) {
    let heard: BTreeSet<&str> =
        captures.iter().flat_map(|capture| &capture.samples).map(|sample| sample.beacon.as_str()).collect();
    let known: BTreeSet<&str> = beacons.iter().map(|beacon| beacon.name.as_str()).collect();
    let listed = |names: BTreeSet<&str>| names.into_iter().collect::<Vec<_>>().join(", ");
    let strange: BTreeSet<&str> = heard.difference(&known).copied().collect();
    if !strange.is_empty() {
        super::tell(&format!("heard, but not on the map: {}\n", listed(strange)));
    }
    let mute: BTreeSet<&str> = known.difference(&heard).copied().collect();
    if !mute.is_empty() {
        super::tell(&format!("on the map, but never heard: {}\n", listed(mute)));
    }
    let usual = beacons.iter().filter(|beacon| beacon.rssi_1m_dbm.is_none() || beacon.path_loss_exponent.is_none());
    let usual: BTreeSet<&str> = usual.map(|beacon| beacon.name.as_str()).collect();
    if !usual.is_empty() {
        super::tell(&format!("path loss not known, taken to be usual: {}\n", listed(usual)));
    }
}
