//! The sites, and their recordings of ranges.

use std::path::Path;

use accuracy::prior::{Case, CaseEpoch, Group};
use analysis::Setup;
use anyhow::Result;
use positioning_core::nlos::{Feature, Features};
use recording::Diagnostics;
use recording::{
    Anchor, Coordinates, Epochs, Files, Height, Measured, MeasurementMode, Recording, Space, Truth, Truths,
};

/// A site with recorded ranges, and the folders of its recordings.
const SITES: [(&str, &[&str]); 5] = [
    ("leiria, spot 1", &["leiria_128_los_pos1", "leiria_128_nlos_pos1", "leiria_1024_nlos_pos1"]),
    ("leiria, spot 2", &["leiria_128_nlos_pos2"]),
    ("leiria, belt", &["leiria_128_move_slow"]),
    ("cuhk", &["cuhk_dynamic_mid", "cuhk_static"]),
    ("hanyang", &["hanyang_los_a_1", "hanyang_los_b_3", "hanyang_nlos_a_1", "hanyang_nlos_b_4"]),
];

/// A recording of ranges.
pub struct Ranged {
    /// Its site.
    pub site: String,
    /// Whether the site is simulated.
    pub simulated: bool,
    /// The recording's name.
    pub name: String,
    /// Anchors, and epochs with their true positions.
    pub recording: Recording,
    /// The space in which positions are computed.
    pub setup: Setup,
    /// The true positions with their own times, if they are not joined yet.
    pub truth: Option<Truth>,
}

/// The recordings of a data folder that exist.
///
/// # Errors
/// The first line of a file that is wrong.
pub fn recorded(data: &Path) -> Result<Vec<Ranged>> {
    let mut all = Vec::new();
    for (site, folders) in SITES {
        for folder in folders.iter().filter(|folder| data.join(folder).is_dir()) {
            let [anchors, ranges, truth] =
                ["anchors.csv", "ranges.csv", "truth.csv"].map(|file| data.join(folder).join(file));
            let recordings = Recording::read(&Files {
                anchors: &anchors,
                measured: &ranges,
                mode: MeasurementMode::Ranges,
                truth: Some(&truth),
                anchor_heights: true,
                truth_heights: true,
            })?;
            let setup = Setup::of(Space::Plane(Height::FromTruth));
            let truths = Truths::read(&truth, true)?;
            for recording in recordings {
                let truth = truths.of(recording.tag.as_deref())?.cloned();
                let (site, name) = (site.to_owned(), (*folder).to_owned());
                all.push(Ranged { site, simulated: false, name, recording, setup, truth });
            }
        }
    }
    Ok(all)
}

/// A case of the simulated set of this seed. Its site is its group.
pub fn simulated(case: &Case, seed: u64) -> Ranged {
    let space = match case.conditions.group {
        Group::Space => Space::Full(None),
        Group::Walk | Group::Rest | Group::Teleport | Group::Asynchronous | Group::Collinear | Group::ManyAnchors => {
            Space::Plane(Height::FromTruth)
        }
    };
    Ranged {
        site: format!("simulated, {}", case.conditions.group.as_str()),
        simulated: true,
        name: format!("{} of seed {seed}", case.name()),
        recording: drawn(&case.anchors_m, &case.epochs),
        setup: Setup::of(space),
        truth: None,
    }
}

/// Drawn ranges as a recording.
pub fn drawn(anchors_m: &[[f64; 3]], drawn: &[CaseEpoch]) -> Recording {
    let place = |[x_m, y_m, z_m]: [f64; 3]| Coordinates { x_m, y_m, z_m: Some(z_m) };
    let anchors = anchors_m.iter().enumerate();
    let anchors = anchors.map(|(at, at_m)| Anchor { name: at.to_string(), place: place(*at_m) }).collect();
    let mut epochs = Epochs::default();
    for (at, epoch) in drawn.iter().enumerate() {
        epochs.push(&at.to_string(), Some(epoch.t_s), Some(place(epoch.at_m)));
        epoch.ranges.iter().for_each(|range| epochs.push_range(&measured(range)));
    }
    Recording { tag: None, anchors, epochs }
}

fn measured(range: &accuracy::prior::CaseRange) -> Measured {
    let [received, first] = range.powers_dbm.map_or([f32::NAN; 2], |powers| powers.map(|dbm| dbm as f32));
    let mut features = Features::default();
    features.set(Feature::PowerDifference, received - first);
    Measured {
        anchor: range.anchor,
        t_s: None,
        range_m: range.range_m,
        line_of_sight: Some(!range.blocked),
        diagnostics: Diagnostics { features, power_dbm: received, ..Diagnostics::default() },
    }
}
