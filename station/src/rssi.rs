//! RSSI values between a device and nodes at known places, to the device's position.
//!
//! A path loss is the same in both directions. So a terminal that receives beacons and a device that fixed receivers
//! receive are one case. The input is one RSSI a node, the output the mean of the positions that are possible with
//! them, and their spread (`positioning_core::ble::posterior`, as in `baliza ble solve`). One node alone gives a
//! position, with a deviation that says how little it means. The height of the device is not known, and so heights are
//! not used.

use std::collections::BTreeMap;

use positioning_core::ble::path_loss::PathLoss;
use positioning_core::ble::posterior::{PosteriorSettings, posterior};
use positioning_core::ble::rssi::RssiObservation;
use positioning_core::{Area, MAX_ANCHORS, SolveError};

use crate::bounds::FARTHEST_M;
use crate::input::{ReportKind, SolvedFrom};

/// The standard deviation of the device's own offset, dB: devices differ (the same as for tags in a locator).
const DEVICE_DB: f32 = 5.0;
/// A device can be this far outside of the box around the nodes, metres.
const MARGIN_M: f32 = 3.0;

/// A position in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RssiPosition {
    /// Metres.
    pub position_m: [f64; 2],
    /// Standard deviations, metres.
    pub sigma_m: [f64; 2],
    /// m².
    pub cov_xy_m2: f64,
    /// The number of nodes that were used.
    pub used: u8,
}

impl RssiPosition {
    /// As the report of a tag.
    pub fn of(self, tag: String) -> ReportKind {
        let Self { position_m, sigma_m, cov_xy_m2, used } = self;
        let solved_from = SolvedFrom::Rssi;
        ReportKind::Position {
            tag,
            round: None,
            position_m,
            z_m: None,
            sigma_m,
            sigma_z_m: None,
            cov_xy_m2,
            used,
            solved_from,
            doubt: None,
        }
    }
}

/// A beacon or a receiver at a known place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownNode {
    /// Metres.
    pub position_m: [f64; 3],
    /// RSSI at one metre, dBm; None: that of most beacons.
    pub rssi_1m_dbm: Option<f64>,
    /// None: that of rooms.
    pub path_loss_exponent: Option<f64>,
}

impl KnownNode {
    /// The path loss between this node and a device of which `rssi_1m_dbm` is known or not. None where a number cannot
    /// be right.
    fn path_loss(&self, rssi_1m_dbm: Option<f64>) -> Option<PathLoss<f32>> {
        let usual = PathLoss::<f32>::default();
        let path_loss = PathLoss {
            level_1m: rssi_1m_dbm.or(self.rssi_1m_dbm).map_or(usual.level_1m, |dbm| dbm as f32),
            exponent: self.path_loss_exponent.map_or(usual.exponent, |exponent| exponent as f32),
            ..usual
        };
        let is_place = self.position_m.iter().all(|at| at.abs() <= FARTHEST_M);
        (is_place && path_loss.is_sane()).then_some(path_loss)
    }
}

/// The position of a device from one RSSI a node, dBm. Nodes that are not known do not count. `rssi_1m_dbm` is that of
/// the device, where it is known: it counts more than the nodes' own.
///
/// # Errors
/// Why there is none: `too-few-beacons` where no RSSI counts, else the reason of a solver.
pub fn solve<'a>(
    nodes: &BTreeMap<String, KnownNode>,
    rssis_dbm: impl IntoIterator<Item = (&'a str, f64)>,
    rssi_1m_dbm: Option<f64>,
) -> Result<RssiPosition, &'static str> {
    let received = rssis_dbm.into_iter().filter_map(|(name, rssi_dbm)| {
        let node = nodes.get(name)?;
        Some((node.position_m, node.path_loss(rssi_1m_dbm)?, rssi_dbm as f32))
    });
    let mut received: Vec<([f64; 3], PathLoss<f32>, f32)> = received.collect();
    // The strongest, where there are more than a solver takes.
    received.sort_by(|(.., a), (.., b)| b.total_cmp(a));
    received.truncate(MAX_ANCHORS);
    let Some(&(origin_m, ..)) = received.first() else { return Err("too-few-beacons") };
    // Single precision is enough near the loudest node.
    let local = |[x, y, _]: [f64; 3]| [(x - origin_m[0]) as f32, (y - origin_m[1]) as f32];
    let observations: Vec<RssiObservation<f32, 2>> = received
        .iter()
        .map(|&(position_m, path_loss, rssi_dbm)| RssiObservation {
            beacon_m: local(position_m),
            above_m: 0.0,
            rssi_dbm,
            path_loss,
        })
        .collect();
    let places = nodes.values().filter(|node| node.path_loss(None).is_some()).map(|node| local(node.position_m));
    let area = places.fold(Area { min: [-MARGIN_M; 2], max: [MARGIN_M; 2] }, |area, place| Area {
        min: std::array::from_fn(|axis| area.min[axis].min(place[axis] - MARGIN_M)),
        max: std::array::from_fn(|axis| area.max[axis].max(place[axis] + MARGIN_M)),
    });
    let belief = PosteriorSettings { offset_deviation: DEVICE_DB, ..PosteriorSettings::default() };
    let fix = posterior(&observations, &area, &[], &belief)
        .map_err(|error| match error {
            SolveError::TooFewAnchors => "too-few-beacons",
            other => other.as_str(),
        })?
        .fix;
    let covariance = fix.covariance;
    let sigma_m = [0, 1].map(|axis: usize| f64::from(covariance[axis][axis]).sqrt());
    if !sigma_m.iter().all(|sigma| sigma.is_finite()) {
        return Err(SolveError::Diverged.as_str());
    }
    Ok(RssiPosition {
        position_m: [0, 1].map(|axis: usize| f64::from(fix.position[axis]) + origin_m[axis]),
        sigma_m,
        cov_xy_m2: f64::from(covariance[0][1]),
        used: u8::try_from(observations.len()).unwrap_or(u8::MAX),
    })
}
