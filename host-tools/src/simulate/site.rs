//! A site in a simulation: its scenario, with the files that it names in the tags, and the survey of its beacons for
//! maps and room models.

use std::path::Path;

use anyhow::{Context, Result};
use sim::scenario::{Scenario, survey};
use site::Purpose;
use wire::config::Role;

use analysis::survey::presence::{Room, room_of};
use node_link::provision::{NodeModels, in_file, read_site};
use recording::UserError;
use recording::read_text;

/// Greatest number of positions of a survey, which are receivers that are simulated at once.
const MOST_PLACES: usize = 10_000;

/// The scenario of a site's file. With `has_models`, its tags have what the files hold that the site names: classifiers,
/// maps and room models.
///
/// # Errors
/// A file cannot be read, or the first line of it that is wrong.
pub fn read_scenario(file: &Path, has_models: bool) -> Result<Scenario, UserError> {
    let site = read_site(file, &read_text(file)?, Purpose::Simulation)?;
    let mut scenario = Scenario::of_site(&site).map_err(|error| in_file(file, error))?;
    let tags = site.nodes.iter().filter(|node| matches!(node.record.role, Role::Tag(_)));
    for (tag, node) in scenario.tags.iter_mut().zip(tags).filter(|_| has_models) {
        let NodeModels { nlos, site } = NodeModels::read(file, node)?;
        tag.settings.model = nlos.map(|chosen| chosen.bytes().into());
        tag.settings.site_models = site.map(Into::into);
    }
    Ok(scenario)
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
    let height = scenario.height_m().map_or(1.2, f64::from);
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
