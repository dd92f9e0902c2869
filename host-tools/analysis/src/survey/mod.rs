//! Surveys of a site: fingerprints, coverage, path loss, antenna delays, rooms, and positions for anchors.

pub mod antenna_delay;
pub mod calibration;
pub mod campaign;
pub mod coverage;
pub mod fingerprint;
pub mod placement;
pub mod presence;
pub mod rooms;
