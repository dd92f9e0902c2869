//! An anchor's program, but for what its board brings: the board's binary takes the board, starts the [`Node`], and spawns what
//! [`Memory::anchor`] gives.

use firmware_common::AnchorProtocol;
use firmware_common::node::{Configured, Node, Reporter, Tasks};
use ranging::dw1000;
use static_cell::StaticCell;
use wire::config::Role;
use wire::telemetry::Condition;

/// What an anchor's task works on, for a `static`.
pub struct Memory {
    machine: StaticCell<AnchorProtocol>,
}

/// What an anchor's task is made of.
pub struct Anchor<R: 'static> {
    /// The radio's driver.
    pub radio: &'static mut R,
    /// The anchor's side of the exchange.
    pub machine: &'static mut AnchorProtocol,
    /// Where it reports to.
    pub reporter: &'static Reporter,
}

impl Memory {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self { machine: StaticCell::new() }
    }

    /// The anchor that a record asks for, with the radio's driver that `radio` makes; `None`, and reported, where it is for another role.
    pub fn anchor<R>(
        &'static self,
        node: &mut Node,
        configured: &Configured,
        radio: impl FnOnce(dw1000::Config) -> &'static mut R,
    ) -> Option<Anchor<R>> {
        let settings = &configured.settings;
        match settings.role {
            Role::Anchor { position_m } => {
                node.tasks = Tasks::Ranging;
                Some(Anchor {
                    radio: radio(settings.radio),
                    machine: self.machine.init_with(|| AnchorProtocol::new(settings, position_m)),
                    reporter: node.reporter,
                })
            }
            Role::Tag(_) | Role::Advertiser(_) => {
                node.report(Condition::WrongRecord);
                None
            }
        }
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}
