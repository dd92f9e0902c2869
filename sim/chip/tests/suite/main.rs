//! Tests of the simulated chip: its bus, start, status, radio, tuning and energy, the processor beside it, the air between
//! chips, and the published driver on it. [`host`] reads and writes registers for them.

mod air;
mod broken_frames;
mod chip_bus;
mod chip_radio;
mod chip_start;
mod chip_status;
mod energy;
mod host;
mod processor;
mod published_driver;
mod tuning;
mod world;
