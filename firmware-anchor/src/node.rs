//! An anchor's program without the parts of its board. The board's binary sets up the board, starts the [`Node`], and
//! spawns the task with what [`Memory::anchor`] returns.

use firmware_common::AnchorProtocol;
use firmware_common::node::{Configured, Node, Reporter, Tasks, fill};
use ranging::native::AnchorMemory;
use ranging::radio::Config;
use static_cell::{ConstStaticCell, StaticCell};
use wire::config::Role;
use wire::telemetry::Condition;

/// The memory that an anchor's task works on, for a `static`. The anchor knows up to `LEASES` leases.
pub struct Memory<const LEASES: usize = 1024> {
    tables: ConstStaticCell<AnchorMemory<LEASES>>,
    machine: StaticCell<AnchorProtocol<'static>>,
}

/// The parts of an anchor's task.
pub struct Anchor<R: 'static> {
    /// The radio's driver.
    pub radio: &'static mut R,
    /// The anchor's protocol.
    pub machine: &'static mut AnchorProtocol<'static>,
    /// The reporter of the node.
    pub reporter: &'static Reporter,
}

impl<const LEASES: usize> Memory<LEASES> {
    /// Empty memory.
    pub const fn new() -> Self {
        Self { tables: ConstStaticCell::new(AnchorMemory::new()), machine: StaticCell::new() }
    }

    /// The anchor that a record describes, with the radio's driver that `radio` creates. For a record of another role
    /// the function reports the fault and returns `None`.
    #[inline(never)]
    #[cold]
    pub fn anchor<R>(
        &'static self,
        node: &mut Node,
        configured: &Configured,
        radio: impl FnOnce(Config) -> &'static mut R,
    ) -> Option<Anchor<R>> {
        let settings = &configured.settings;
        match settings.role {
            Role::Anchor { position_m } => {
                node.tasks = Tasks::Ranging;
                let tables = self.tables.take().into();
                Some(Anchor {
                    radio: radio(settings.radio),
                    machine: fill(&self.machine, || AnchorProtocol::new(settings, position_m, tables)),
                    reporter: node.reporter,
                })
            }
            Role::Tag(_) | Role::Advertiser(_) | Role::Scanner => {
                node.report(Condition::WrongRecord);
                None
            }
        }
    }
}

impl<const LEASES: usize> Default for Memory<LEASES> {
    fn default() -> Self {
        Self::new()
    }
}
