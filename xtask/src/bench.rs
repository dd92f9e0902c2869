//! All tables and figures of the documents that are made by a simulation, a recording or QEMU: a list of them, and
//! their remaking.

use std::time::Instant;

use anyhow::{Result, bail};

use crate::{
    accuracy, air, battery, beacons, document, fingerprints, onchip, protocol, root, schemes, simulation, station,
    tracks,
};

const PERFORMANCE: &str = "docs/performance.md";
const SCENARIOS: &str = "docs/scenarios.md";
const RESEARCH: &str = "research/README.md";

/// A group of tables that is remade as a whole.
struct Part {
    /// The name on the command line.
    name: &'static str,
    /// A description.
    what: &'static str,
    /// The document of the tables.
    document: &'static str,
    make: fn() -> Result<Option<Made>>,
}

/// The result of a part.
pub struct Made {
    /// The tables, each with the name of its place in the document.
    tables: Vec<(&'static str, String)>,
    /// A complaint about the figures.
    complaint: Option<&'static str>,
}

impl Made {
    /// One table; `None` where the recording does not exist.
    pub fn one(name: &'static str, table: String) -> Option<Self> {
        Self::of(vec![(name, table)], None)
    }

    /// Several tables, and a complaint about their figures.
    pub fn of(tables: Vec<(&'static str, String)>, complaint: Option<&'static str>) -> Option<Self> {
        Some(Self { tables, complaint })
    }
}

const PARTS: [Part; 24] = [
    Part {
        name: "chip",
        what: "what the methods cost on the chip, in QEMU",
        document: PERFORMANCE,
        make: onchip::made,
    },
    // Comes before all parts that simulate nodes, because simulations read these costs.
    Part { name: "costs", what: "what a node's code costs, in QEMU", document: PERFORMANCE, make: onchip::costs },
    Part { name: "simulation", what: "whole nodes, simulated", document: PERFORMANCE, make: simulation::rooms },
    Part { name: "air", what: "simulated and recorded links", document: PERFORMANCE, make: air::compared },
    Part { name: "schemes", what: "schemes of two-way ranging", document: PERFORMANCE, make: schemes::compared },
    Part { name: "battery", what: "currents and battery lives", document: PERFORMANCE, make: battery::lives },
    Part {
        name: "scenarios",
        what: "tags among anchors and beacons",
        document: SCENARIOS,
        make: simulation::scenarios,
    },
    Part { name: "thesis", what: "ranges of the thesis' simulation", document: PERFORMANCE, make: accuracy::thesis },
    Part {
        name: "recordings",
        what: "every method on recorded ranges",
        document: PERFORMANCE,
        make: accuracy::recorded,
    },
    Part { name: "tracks", what: "the engine on recorded ranges", document: PERFORMANCE, make: tracks::recorded },
    Part { name: "accuracy", what: "the accuracy protocol", document: PERFORMANCE, make: protocol::made },
    Part {
        name: "garcia",
        what: "differences of arrival with blocked paths",
        document: RESEARCH,
        make: tracks::garcia,
    },
    Part { name: "barral", what: "ranges with blocked ones", document: RESEARCH, make: tracks::barral },
    Part { name: "fusion", what: "anchors and beacons together", document: RESEARCH, make: tracks::fusion },
    Part { name: "sweep", what: "the same under other conditions", document: RESEARCH, make: tracks::sweep },
    Part { name: "nlos", what: "line of sight by recorded responses", document: PERFORMANCE, make: accuracy::sight },
    Part { name: "linde", what: "levels and times of flight, simulated", document: RESEARCH, make: beacons::linde },
    Part { name: "beacons", what: "path loss in a recorded room", document: PERFORMANCE, make: beacons::by_path_loss },
    Part { name: "fingerprints", what: "recorded surveys", document: PERFORMANCE, make: fingerprints::comparisons },
    Part {
        name: "walls",
        what: "walls as barriers on a recorded walk",
        document: PERFORMANCE,
        make: fingerprints::barriers,
    },
    Part { name: "maps", what: "maps of few points", document: PERFORMANCE, make: fingerprints::maps },
    Part {
        name: "station",
        what: "what the station takes and costs",
        document: PERFORMANCE,
        make: station::bench::made,
    },
    Part { name: "page", what: "a frame of the map", document: PERFORMANCE, make: station::bench::page },
    Part { name: "rooms", what: "rooms of a recorded floor", document: PERFORMANCE, make: accuracy::rooms },
];

/// The names of all parts, for the help.
pub fn names() -> Vec<&'static str> {
    PARTS.iter().map(|part| part.name).collect()
}

/// Remakes these parts, or all where none is named, one after the other. A part that fails does not stop the others.
/// Every table is printed whole; documents have an extract of it, or nothing ([`extract`](crate::extract)).
///
/// # Errors
/// A part fails, after all have been tried.
pub fn run(names: &[String]) -> Result<()> {
    let chosen: Vec<&Part> =
        PARTS.iter().filter(|part| names.is_empty() || names.iter().any(|name| name == part.name)).collect();
    let mut summary = String::new();
    let mut failed = 0;
    for (at, Part { name, what, document, make }) in (1..).zip(&chosen) {
        eprintln!("\n=== {at} of {}: {name}, {what}", chosen.len());
        let begun = Instant::now();
        let outcome = make().and_then(|made| match made {
            None => Ok("as it was: no recording"),
            Some(Made { tables, complaint }) => {
                for (place, table) in tables {
                    println!("{table}");
                    document::remake(&root().join(document), place, &table)?;
                }
                complaint.map_or(Ok("remade"), |complaint| bail!("remade, but {complaint}"))
            }
        });
        failed += usize::from(outcome.is_err());
        let outcome = outcome.map_or_else(|error| format!("FAILED: {error:#}"), str::to_owned);
        let line = format!("{name:12} {outcome} ({} s)\n", begun.elapsed().as_secs());
        eprint!("{line}");
        summary += &line;
    }
    eprintln!("\n{summary}");
    if failed > 0 {
        bail!("{failed} of {} parts failed", chosen.len());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::{PARTS, names};
    use crate::root;

    #[test]
    fn every_part_has_a_name_of_its_own_and_a_document() {
        assert_eq!(names().into_iter().collect::<BTreeSet<_>>().len(), PARTS.len());
        assert!(PARTS.iter().all(|part| root().join(part.document).is_file()));
    }
}
