//! CSV files: a recording, which is also solved, and all other readers.

use std::path::Path;

use analysis::check;
use analysis::locate::advice;
use analysis::locate::track::{Tracker, Weighting, settings, settings_of_single_epochs};
use analysis::survey::campaign::read_points;
use analysis::survey::presence::{follow, read_outlines};
use analysis::train::{DEFAULT_PLACEMENT, Samples};
use analysis::{Setup, Solver};
use positioning_core::Method;
use recording::beacons::{read_beacons, read_captures, read_stays, read_walls};
use recording::{Files, Height, MeasurementMode, Recording, Solved, Space, Truths, UserError, read_anchors};
use recording::{drop_repeats, positions, round_s, rounds};

use super::folder;
use crate::finite;

/// The parts of an input, of which a zero separates one from the next, as files.
fn files<const N: usize>(input: &[u8], names: [&str; N]) -> [std::path::PathBuf; N] {
    let mut parts = input.splitn(N, |byte| *byte == 0);
    names.map(|name| folder::file(name, parts.next().unwrap_or_default()))
}

/// Asserts that an error is one line.
fn one_line<T>(read: Result<T, UserError>) -> Option<T> {
    read.map_err(|error| assert!(!error.to_string().contains('\n'), "{error}")).ok()
}

pub fn recording(input: &[u8]) {
    let [anchors, ranges, truth] = files(input, ["anchors.csv", "ranges.csv", "truth.csv"]);
    let truth = input.iter().filter(|byte| **byte == 0).nth(1).map(|_| truth.as_path());
    let (measured, mode) = (&*ranges, MeasurementMode::Ranges);
    let files = Files { anchors: &anchors, measured, mode, truth, anchor_heights: true, truth_heights: false };
    one_line(Recording::read(&files)).into_iter().flatten().take(2).for_each(solve);
}

/// The recordings of a tag that only listens.
pub fn differences(input: &[u8]) {
    let [anchors, differences] = files(input, ["anchors.csv", "differences.csv"]);
    let (measured, mode) = (&*differences, MeasurementMode::Differences);
    let files = Files { anchors: &anchors, measured, mode, truth: None, anchor_heights: true, truth_heights: false };
    one_line(Recording::read(&files)).into_iter().flatten().take(2).for_each(solve);
}

pub fn difference_seeds() -> Vec<Vec<u8>> {
    let differences =
        "epoch,t_s,reference,anchor,difference_m,tag\n0,0,a,a,0,x\n0,0,a,b,2.6,x\n0,0,a,c,2.7,x\n0,0,a,d,0.1,x\n";
    vec![[ANCHORS, differences].join("\0").into_bytes()]
}

fn solve(mut recording: Recording) {
    drop_repeats(&mut recording.epochs);
    let _ = rounds(&recording.epochs, round_s(&recording.epochs).unwrap_or(0.1));
    for space in [Space::Full(None), Space::Plane(Height::Fixed(1.0)), Space::Plane(Height::Unknown)] {
        let setup = Setup::of(space);
        let of_rows = check::of_rows(&recording, space, 0);
        let all = of_rows.into_iter().chain(check::of_whole(&recording, &setup).findings);
        all.for_each(|finding| assert!(!finding.message.contains('\n'), "{finding:?}"));
        let solver = Solver::new(&recording.anchors, setup);
        for epoch in recording.epochs.iter().take(3) {
            Method::ALL.into_iter().for_each(|method| check(&solver.solve(method, &epoch)));
        }
        for settings in [settings(&setup, Weighting::Weigh), settings_of_single_epochs(&setup)] {
            let mut tracker = Tracker::new(&recording.anchors[..], setup, settings, None);
            recording.epochs.iter().take(20).for_each(|epoch| check(&tracker.follow(&epoch)));
        }
    }
}

fn check(solved: &Solved) {
    if let Ok(position) = &solved.outcome {
        let (place, sigma) = (position.place, position.sigma);
        finite([place.x_m, place.y_m, sigma.x_m, sigma.y_m, position.covariance_xy]);
        finite(place.z_m.into_iter().chain(sigma.z_m));
        assert!(sigma.x_m >= 0.0 && sigma.y_m >= 0.0 && sigma.z_m.is_none_or(|sigma| sigma >= 0.0), "{solved:?}");
    }
}

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,2\nb,10,0,2.5\nc,10,8,2\nd,0,8,3\n";
const RANGES: &str = "epoch,t_s,anchor,range_m,los,rx_power_dbm,fp_power_dbm\n0,0,a,5.5,1,-80,-81\n0,0,b,8.1,0,-80,-90\n\
                      0,0,c,8.2,1,-80,-81\n0,0,d,5.6,,,\n1,0.1,a,5.5,1,-80,-81\n";
const TRUTH: &str = "epoch,t_s,x_m,y_m,z_m\n0,0,3.5,3.5,1\n1,0.1,3.6,3.5,1\n";

pub fn recording_seeds() -> Vec<Vec<u8>> {
    let three = [ANCHORS, RANGES, TRUTH].join("\0").into_bytes();
    vec![three, [ANCHORS, RANGES].join("\0").into_bytes()]
}

pub fn readers(input: &[u8]) {
    let file = folder::file("any.csv", input);
    let _ =
        (one_line(read_anchors(&file)), one_line(Truths::read(&file, false)), one_line(positions::read_track(&file)));
    let _ = (one_line(read_beacons(&file)), one_line(read_stays(&file)), one_line(read_captures(&file, None)));
    let _ = (one_line(read_walls(&file)), one_line(read_points(&file)));
    let rows = one_line(positions::read(&file)).unwrap_or_default();
    let _ = advice::of_positions(&rows);
    if let Some(rooms) = one_line(read_outlines(&file)) {
        let _ = (follow(&rooms, &rows, 1.0), advice::of_outlines(&rooms));
    }
}

pub fn reader_seeds() -> Vec<Vec<u8>> {
    [
        ANCHORS,
        TRUTH,
        "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,used,reason,error_m\n0,0,m,1,2,,0.1,0.1,,4,,0.1\n1,1,m,,,,,,,,diverged,\n",
        "beacon,x_m,y_m,z_m,rssi_1m_dbm,path_loss_exponent,deviation_db\na,0,0,2,-59,2,4\n",
        "point,room,x_m,y_m,beacon,rssi_dbm,t_s\np,hall,0,0,a,-50,0\np,hall,0,0,b,-61,0\n",
        "epoch,t_s,beacon,rssi_dbm\n0,0,a,-55\n1,1,a,-56\n",
        "x1_m,y1_m,x2_m,y2_m,attenuation_db\n0,2,4,2,3.5\n",
        "x,y\n0,0\n1,0\n1,2\n",
        "room,x_m,y_m\nhall,0,0\nhall,4,0\nhall,4,4\n",
        "point,x_m,y_m,room,from_s\np,0,0,hall,1\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .to_vec()
}

pub fn receptions(input: &[u8]) {
    let file = folder::file("receptions.csv", input);
    let mut samples = Samples::default();
    one_line(samples.read_cir(Path::new(&file), DEFAULT_PLACEMENT));
    one_line(samples.read_ranges(Path::new(&file), DEFAULT_PLACEMENT, |_| Some(1.0)));
}

pub fn reception_seeds() -> Vec<Vec<u8>> {
    let window: String = (-16..136).map(|at| format!(",c{at}")).collect();
    let header = format!("label,fp_idx,range_m,rsl_dbm,fsl_dbm,fp_amp1,fp_amp2,fp_amp3,cir_pwr,noise_std_est{window}");
    let row = format!("los,745.5,3,-80,-81,9000,9000,8000,12000,52{}", ",100".repeat(152));
    vec![format!("{header}\n{row}\n").into_bytes(), RANGES.as_bytes().to_vec()]
}
