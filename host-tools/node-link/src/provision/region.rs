//! Warnings about nodes under the rules of their region, where a record is not refused. `docs/use/regulation.md` has
//! the rules with their sources.

use wire::config::Region;

use super::Node;

/// Warnings for the user who provisions these nodes, each once.
pub fn warnings<'n>(nodes: impl IntoIterator<Item = &'n Node>) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for line in nodes.into_iter().flat_map(of) {
        if !lines.contains(&line) {
            lines.push(line);
        }
    }
    lines
}

fn of(node: &Node) -> Vec<String> {
    let network = &node.record.network;
    let mut lines = Vec::new();
    if !node.record.transmits() {
        return lines;
    }
    match network.region {
        None => lines.push(
            "region is missing in [network], so the radio rules of the country are not checked: set \"eu\", \"us\", \
             \"japan\", \"china\" or \"none\" (docs/use/regulation.md)"
                .to_owned(),
        ),
        Some(Region::Unchecked) => (),
        Some(Region::Eu | Region::Us | Region::Japan | Region::China) => {
            if node.record.calibration.tx_power.is_some() {
                lines.push(format!("uwb_tx_power of {}: measure that it stays below -41.3 dBm/MHz", node.name));
            }
            if network.region == Some(Region::Eu) && network.phy.channel == 7 {
                let line = "channel 7 begins at 5.95 GHz, but the EU's band at 6.0 GHz: measure, or use channel 5";
                lines.push(line.to_owned());
            }
        }
    }
    lines
}
