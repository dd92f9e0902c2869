//! The results of a survey of the site: a fingerprint map and a classifier of rooms. Both lie in flash beside the
//! record, and the tag reads them in place. This module matches their beacons with the record's list of beacons, for
//! the locator.

use heapless::Vec;
use positioning_core::ble::fingerprint::{MAX_NODE_POINTS, Map, MapError};
use positioning_core::ble::rooms::{NodeModel, StoredError, Svm};
use positioning_core::locator::{ForBeacons, SiteModels};
use wire::config::{Beacon, BeaconModel, LoadError, MAX_BEACONS, StoredSiteModels};
use wire::telemetry::{Condition, RssiModelError};

/// The models in flash, for a tag with this list of beacons. A model that cannot be used is left out, and `complain` is
/// called once for it.
pub fn site_models<'a>(
    models: Result<StoredSiteModels<'a>, LoadError>,
    list: &[Beacon],
    mut complain: impl FnMut(Condition),
) -> SiteModels<'a> {
    let models = match models {
        Ok(models) => models,
        Err(error) => {
            let unused = match error {
                LoadError::Missing => None,
                LoadError::Version(version) => Some(RssiModelError::Version(version)),
                LoadError::Corrupt => Some(RssiModelError::Corrupt),
                LoadError::Invalid(_) => Some(RssiModelError::Invalid),
            };
            unused
                .into_iter()
                .for_each(|error| complain(Condition::Unused(wire::telemetry::SiteModelPart::All, error)));
            return SiteModels::default();
        }
    };
    let mut unused = |part, error| complain(Condition::Unused(part, error));
    let map = models.map.map(|of| map(&of, list)).transpose();
    let rooms = models.rooms.map(|of| rooms(&of, list)).transpose();
    SiteModels {
        map: map.map_err(|error| unused(wire::telemetry::SiteModelPart::Map, error)).ok().flatten(),
        rooms: rooms.map_err(|error| unused(wire::telemetry::SiteModelPart::Rooms, error)).ok().flatten(),
    }
}

fn map<'a>(of: &BeaconModel<'a>, list: &[Beacon]) -> Result<ForBeacons<Map<'a>>, RssiModelError> {
    let (model, _) = Map::decode(of.model).map_err(|error| match error {
        MapError::Version(version) => RssiModelError::Version(version),
        MapError::Missing | MapError::Corrupt => RssiModelError::Corrupt,
        MapError::Invalid | MapError::TooLong => RssiModelError::Invalid,
    })?;
    if !model.has_deviations() || model.points() > MAX_NODE_POINTS {
        return Err(RssiModelError::Invalid);
    }
    Ok(ForBeacons { beacons: indices(of, list, model.beacons())?, model })
}

fn rooms<'a>(of: &BeaconModel<'a>, list: &[Beacon]) -> Result<ForBeacons<Svm<'a>>, RssiModelError> {
    let (model, _) = NodeModel::decode(of.model).map_err(|error| match error {
        StoredError::Version { found, read: _ } => RssiModelError::Version(found),
        StoredError::Missing | StoredError::Corrupt => RssiModelError::Corrupt,
        StoredError::Invalid | StoredError::TooLong => RssiModelError::Invalid,
    })?;
    let beacons = indices(of, list, model.beacons())?;
    let NodeModel::Svm(model) = model;
    Ok(ForBeacons { model, beacons })
}

/// The index in the record's list of each of the `count` beacons of a model. A model with a beacon that is not in the
/// list is refused.
fn indices(of: &BeaconModel<'_>, list: &[Beacon], count: usize) -> Result<Vec<u8, MAX_BEACONS>, RssiModelError> {
    let mut indices = Vec::new();
    for numbers in of.numbers() {
        let index = list.iter().position(|beacon| (beacon.major, beacon.minor) == numbers);
        let index = index.and_then(|index| u8::try_from(index).ok()).ok_or(RssiModelError::OtherBeacons)?;
        indices.push(index).map_err(|_| RssiModelError::Invalid)?;
    }
    if indices.len() == count { Ok(indices) } else { Err(RssiModelError::Invalid) }
}

#[cfg(test)]
mod tests;
