//! Tests of the whole system: ranging between simulated chips, positions by Bluetooth beacons, and the same positions on
//! tag and host.

mod bluetooth;
mod locator;
mod ranging;
