//! Positions from the CSV files of a recording: `cargo run -p host-tools --example solve_csv` at the repository's root.

use std::path::Path;

use analysis::{Setup, Solver};
use positioning_core::Method;
use recording::{Files, MeasurementMode, Recording, Space, UserError};

fn main() -> Result<(), UserError> {
    let folder = Path::new("examples/room");
    let (anchors, ranges) = (folder.join("anchors.csv"), folder.join("ranges.csv"));
    let files = Files {
        anchors: &anchors,
        measured: &ranges,
        mode: MeasurementMode::Ranges,
        truth: None,
        anchor_heights: true,
        truth_heights: false,
    };
    // One recording a tag.
    for recording in Recording::read(&files)? {
        let solver = Solver::new(&recording.anchors, Setup::of(Space::Full(None)));
        for epoch in recording.epochs.iter() {
            match solver.solve(Method::Robust, &epoch).outcome {
                Ok(position) => {
                    let (at, sigma) = (position.place, position.sigma);
                    println!("{}: {:.2} ± {:.2} m, {:.2} ± {:.2} m", epoch.name, at.x_m, sigma.x_m, at.y_m, sigma.y_m);
                }
                Err(reason) => println!("{}: no position: {}", epoch.name, reason.as_str()),
            }
        }
    }
    Ok(())
}
