//! Protocols on a small simulated air: among themselves, against stock boards, and against attackers and any bytes.

mod air;
mod attack;
mod blinks;
mod decaranging;
mod downlinks;
mod faults;
mod forged_leases;
mod hostile;
mod keyed;
mod listening;
mod native;
mod seldom;
mod spacing;
mod stock;
