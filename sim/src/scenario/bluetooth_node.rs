//! A node without a UWB chip, which faults switch: a beacon or a scanner.

use std::cell::RefCell;
use std::convert::Infallible;
use std::future::Future;
use std::pin::Pin;

use firmware_common::settings::Cipher;
use firmware_common::{Start, introduce};
use wire::config::Record;
use wire::telemetry::{Board, Hello, ResetCause, Role};
use wire::uwb::native::software_code;

use super::FaultKind;
use super::config::eui;
use super::telemetry::Reporter;
use crate::{TaskId, World};

/// What a node does while it is on.
type Life = Pin<Box<dyn Future<Output = Infallible>>>;

/// Reports the identity of a node with this record, as at each start.
pub(super) fn introduced(reporter: &Reporter, role: Role, address: u16, record: Record) -> (Hello, Record) {
    // It sends no frames that have codes.
    let cipher = Cipher { seed: 0, make_code: software_code };
    let start = Start { record: Ok(record), eui: eui(address), reset: ResetCause::PowerOn, crash: None, cipher };
    let (hello, followed) = introduce(reporter, Board::Simulated, role, start);
    let Some((record, _)) = followed else { unreachable!("the site was checked") };
    (hello, record)
}

/// A node that can be switched.
pub(super) struct BluetoothNode {
    world: World,
    live: Box<dyn Fn() -> Life>,
    task: RefCell<Option<TaskId>>,
}

impl BluetoothNode {
    /// Starts a node, which does this while it is on.
    pub(super) fn start<F: Future<Output = Infallible> + 'static>(
        world: &World,
        live: impl Fn() -> F + 'static,
    ) -> Self {
        let live = Box::new(move || -> Life { Box::pin(live()) });
        let node = Self { world: world.clone(), live, task: RefCell::new(None) };
        node.switch_on();
        node
    }

    /// Applies a fault to the node.
    pub(super) fn suffer(&self, fault: FaultKind) {
        match fault {
            FaultKind::Off => self.switch_off(),
            FaultKind::On => self.switch_on(),
            FaultKind::Reset => {
                self.switch_off();
                self.switch_on();
            }
        }
    }

    fn switch_off(&self) {
        if let Some(task) = self.task.take() {
            self.world.abort(task);
        }
    }

    fn switch_on(&self) {
        if self.task.borrow().is_none() {
            let life = (self.live)();
            let task = self.world.spawn(async move {
                life.await;
            });
            *self.task.borrow_mut() = Some(task);
        }
    }
}
