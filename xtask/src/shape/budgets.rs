//! The budgets of the sources' shape: what `cargo xtask shape` holds them to.
//!
//! Each has the greatest value that is allowed now, and the value to be reached. An allowed value is lowered when the
//! sources have shrunk; it is raised only with a reason in the commit.

/// What a crate is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CratePurpose {
    /// Firmware of tags, anchors and beacons, and what it links.
    Nodes,
    /// The programs of a computer and the station.
    Host,
    /// Simulated chips, air and boards.
    Simulation,
    /// What no user runs.
    Tools,
}

/// The purpose of each folder. The longest name that fits counts.
pub const PURPOSES: [(&str, CratePurpose); 23] = [
    ("positioning-core/", CratePurpose::Nodes),
    ("radio/", CratePurpose::Nodes),
    ("dw1000/", CratePurpose::Nodes),
    ("ranging/", CratePurpose::Nodes),
    ("wire/", CratePurpose::Nodes),
    ("firmware-common/", CratePurpose::Nodes),
    ("firmware-tag/", CratePurpose::Nodes),
    ("firmware-anchor/", CratePurpose::Nodes),
    ("firmware-beacon/", CratePurpose::Nodes),
    ("firmware-gateway/", CratePurpose::Nodes),
    ("firmware-scanner/", CratePurpose::Nodes),
    ("boards/", CratePurpose::Nodes),
    ("site/", CratePurpose::Host),
    ("host-tools/", CratePurpose::Host),
    ("station/", CratePurpose::Host),
    ("python/", CratePurpose::Host),
    ("sim/", CratePurpose::Simulation),
    ("boards/wired/", CratePurpose::Simulation),
    ("qa/qemu-link/", CratePurpose::Simulation),
    ("qa/", CratePurpose::Tools),
    ("xtask/", CratePurpose::Tools),
    ("examples/", CratePurpose::Tools),
    ("tests/", CratePurpose::Tools),
];

/// What is measured, the greatest value that is allowed, and the value to be reached.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// As it is printed.
    pub what: &'static str,
    /// The greatest value that is allowed now.
    pub most: usize,
    /// The value to be reached.
    pub reach: usize,
}

/// Lines of code without tests, benches and examples.
pub const LINES: [(CratePurpose, Budget); 4] = [
    (CratePurpose::Nodes, Budget { what: "lines: nodes", most: 32_900, reach: 25_000 }),
    (CratePurpose::Host, Budget { what: "lines: host and station", most: 44_100, reach: 34_000 }),
    (CratePurpose::Simulation, Budget { what: "lines: simulation", most: 11_000, reach: 11_000 }),
    (CratePurpose::Tools, Budget { what: "lines: developers' tools", most: 15_700, reach: 10_000 }),
];

/// Names of public types that more than two types bear.
pub const TYPE_NAMES: Budget = Budget { what: "type names used more than twice", most: 30, reach: 30 };
/// Names that each command or table may have for its own: they are only used with the module's name before them.
pub const COMMON_TYPE_NAMES: [&str; 2] = ["Arguments", "Row"];

/// Names of modules that stand in more than two rooms and are not [`SHARED_MODULE_NAMES`]. A room is a package, or a
/// folder of its sources. Developers' tools do not count, nor do commands, which bear the names of what they call.
pub const MODULE_NAMES: Budget = Budget { what: "module names in more than two rooms", most: 0, reach: 0 };

/// Names of modules that mean the same in each room.
pub const SHARED_MODULE_NAMES: [&str; 20] = [
    "air",
    "beacons",
    "ble",
    "bluetooth",
    "board",
    "chip",
    "clock",
    "config",
    "flash",
    "messages",
    "motion",
    "node",
    "queue",
    "random",
    "rooms",
    "settings",
    "site_models",
    "tag",
    "telemetry",
    "track",
];
/// The rooms of commands.
pub const COMMANDS: [&str; 1] = ["cli"];

/// Functions of more lines than [`MOST_LINES`], outside of tests and [`WIRING`].
pub const FUNCTIONS: Budget = Budget { what: "functions over 80 lines", most: 0, reach: 0 };
/// The most lines of a function.
pub const MOST_LINES: usize = 80;
/// Functions that only list what is connected with what.
pub const WIRING: [(&str, &str); 2] = [("boards/dwm1001/src/lib.rs", "take"), ("boards/evk1000/src/board.rs", "take")];

/// Files of more than [`MOST_LINES_OF_FILE`] lines without their tests.
pub const FILES: Budget = Budget { what: "files over 500 lines without tests", most: 0, reach: 0 };
/// The most lines of a file, without its tests.
pub const MOST_LINES_OF_FILE: usize = 500;
