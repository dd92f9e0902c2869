//! Maps and room models in a simulation: loads the files that a scenario names into its tags, and makes the survey of
//! its beacons for such files.

use std::path::Path;

use anyhow::{Context, Result};
use sim::scenario::{Scenario, survey};

use analysis::survey::presence::{Room, room_of};
use node_link::provision::site_models::{Part, encode, read_map, read_rooms};
use recording::UserError;

/// Greatest number of positions of a survey, which are receivers that are simulated at once.
const MOST_PLACES: usize = 10_000;

/// Reads the files that the scenario of this file names, and gives them to the tags, bound to the beacons that are
/// configured on them.
///
/// # Errors
/// A file cannot be read, or does not fit these tags.
pub fn load_site_models(scenario: &mut Scenario, file: &Path) -> Result<(), UserError> {
    let files = &scenario.bluetooth.files;
    if files.map.is_none() && files.rooms.is_none() {
        return Ok(());
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    let wrong = |key: &str, name: &str, what: String| UserError::file(file, format!("{key}: {name}: {what}"));
    let map = files.map.as_ref().map(|name| read_map(&folder.join(name)).map_err(|what| wrong("map", name, what)));
    let rooms =
        files.rooms.as_ref().map(|name| read_rooms(&folder.join(name)).map_err(|what| wrong("rooms", name, what)));
    let (map, rooms) = (map.transpose()?, rooms.transpose()?);
    let listed: Vec<_> = scenario.beacons.iter().filter_map(|beacon| beacon.listed).collect();
    let site_models = encode(map.as_deref(), rooms.as_ref(), &listed).map_err(|(part, what)| {
        let key = match part {
            Part::Map => "map",
            Part::Rooms => "rooms",
        };
        UserError::file(file, format!("{key} {what}"))
    })?;
    scenario.bluetooth.site_models = Some(site_models.into());
    Ok(())
}

/// A survey of the scenario's beacons as `fingerprints.csv`: dwells of `stay_s` seconds on a grid over the area
/// between the beacons, at the tags' height; with outlines, only the points within rooms.
///
/// # Errors
/// There are no beacons, or too many points, or the CSV writer fails.
pub fn survey_csv(scenario: &Scenario, step_m: f64, stay_s: f64, rooms: Option<&[Room]>) -> Result<Vec<u8>> {
    let axis = |axis: usize| scenario.beacons.iter().filter_map(move |beacon| beacon.at.get(axis).copied());
    let [x, y] = [0, 1].map(|a| {
        let (low, high) = (axis(a).fold(f64::INFINITY, f64::min), axis(a).fold(f64::NEG_INFINITY, f64::max));
        let steps = ((high - low) / step_m).round().max(0.0);
        (low, (high - low) / steps.max(1.0), if steps < MOST_PLACES as f64 { steps as usize + 1 } else { MOST_PLACES })
    });
    if scenario.beacons.is_empty() {
        return Err(UserError::flag("--survey", "the scenario has no beacons").into());
    }
    if x.2 * y.2 > MOST_PLACES {
        let what = format!("{} points, where {MOST_PLACES} can be simulated", x.2 * y.2);
        return Err(UserError::flag("--survey-step-m", what).into());
    }
    let height = scenario.tag.height_m.map_or(1.2, f64::from);
    let grid = (0..x.2).flat_map(|i| (0..y.2).map(move |j| (i, j)));
    let places = grid.map(|(i, j)| [x.0 + i as f64 * x.1, y.0 + j as f64 * y.1, height]);
    let room = |[x, y, _]: [f64; 3]| rooms.map(|rooms| room_of(rooms, [x, y]).and_then(|room| rooms.get(room)));
    // Without outlines every position is used.
    let places: Vec<([f64; 3], Option<&Room>)> =
        places.filter_map(|at| room(at).map_or(Some((at, None)), |room| room.map(|room| (at, Some(room))))).collect();
    let at: Vec<[f64; 3]> = places.iter().map(|(at, _)| *at).collect();
    let mut heard = survey(scenario, &at, stay_s);
    heard.sort_by_key(|heard| heard.place);
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["point", "room", "x_m", "y_m", "beacon", "rssi_dbm", "t_s"])?;
    for sample in &heard {
        let Some(([x, y, _], room)) = places.get(sample.place) else { continue };
        writer.write_record([
            format!("p{}", sample.place),
            room.map_or_else(String::new, |room| room.name.clone()),
            format!("{x:.3}"),
            format!("{y:.3}"),
            sample.beacon.clone(),
            sample.rssi_dbm.to_string(),
            format!("{:.3}", sample.t_s),
        ])?;
    }
    writer.into_inner().map_err(csv::IntoInnerError::into_error).context("cannot write the survey")
}
