//! `baliza import`: text of other systems becomes recordings that `solve` reads.

use crate::support::Folder;

/// A tag with PANS at (3, 2, 1) among four anchors.
fn lec(prefix: &str) -> String {
    let anchors =
        [("0F90", [0.0, 0.0, 2.0]), ("1B24", [8.0, 0.0, 0.5]), ("5A11", [8.0, 6.0, 2.0]), ("D2E0", [0.0, 6.0, 0.5])];
    let of = |(index, (name, [x, y, z])): (usize, (&str, [f64; 3]))| {
        let range = ((3.0 - x).powi(2) + (2.0 - y).powi(2) + (1.0_f64 - z).powi(2)).sqrt();
        format!("AN{index},{name},{x:.2},{y:.2},{z:.2},{range:.4},")
    };
    let anchors: String = anchors.into_iter().enumerate().map(of).collect();
    format!("{prefix}DIST,4,{anchors}POS,3.01,1.98,1.05,91\n")
}

#[test]
fn output_of_pans_is_solved_after_an_import() {
    let folder = Folder::with(&[("tag.log", &format!("dwm> lec\n{}{}{}", lec(""), lec(""), "DIST,4,AN0,0F90,0.0"))]);
    let run = folder.run("import pans tag.log --out walk").ok();
    let told = "2 rounds, 8 ranges to 4 anchors, in walk\n\
                2 lines left out, the first: tag.log:1: neither a line of lec nor of les\n";
    assert_eq!((run.stderr.as_str(), run.stdout.as_str()), (told, ""));
    let positions = "epoch,t_s,method,x_m,y_m,z_m\n0,0,pans,3.01,1.98,1.05\n1,0.1,pans,3.01,1.98,1.05\n";
    assert_eq!(folder.read("walk/positions.csv"), positions.as_bytes());
    let solved = folder.run("solve walk --method nls").ok();
    for (column, expected) in [("x_m", 3.0), ("y_m", 2.0), ("z_m", 1.0)] {
        assert!(solved.numbers(column).iter().all(|at| (at - expected).abs() < 2e-3), "{}", solved.stdout);
    }
    assert_eq!(folder.run("import pans tag.log --out walk").code, Some(2));
}

#[test]
fn text_without_a_range_is_refused_with_its_first_line() {
    let folder = Folder::with(&[("tag.log", "\ndwm> lec\n"), ("empty.log", "")]);
    let run = folder.run("import pans tag.log --out walk");
    let told = "tag.log:2: neither a line of lec nor of les; no line of the file has a range\n";
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), told));
    assert_eq!(folder.run("import pans empty.log --out walk").stderr, "empty.log:1: no line has a range\n");
    assert!(!folder.path("walk").exists());
}

#[test]
fn a_log_of_a_crazyflie_is_solved_after_an_import() {
    let anchors = "anchor,x_m,y_m,z_m\n0,0,0,2\n1,8,0,0.5\n2,8,6,2\n3,0,6,0.5\n7,1,1,1\n";
    // The distances from (3, 2, 1): √(9 + 4 + 1), √(25 + 4 + 0.25), √(25 + 16 + 1), √(9 + 16 + 0.25).
    let log = "Timestamp,ranging.distance0,ranging.distance1,ranging.distance2,ranging.distance3,ranging.distance4,\
               kalman.stateX,kalman.stateY,kalman.stateZ\n\
               120500,3.741657,5.408327,6.480741,5.024938,0.0,3.1,2.1,0.9\n\
               120600,3.741657,oops,6.480741,5.024938,0.0,3.1,2.1,0.9\n\
               120700,3.741657,5.408327,6.480741,5.024938,0.0,3.2,2.1,0.9\n";
    let folder = Folder::with(&[("anchors.csv", anchors), ("log.csv", log)]);
    let run = folder.run("import crazyflie log.csv --anchors anchors.csv --out flight").ok();
    let told = "2 rounds, 8 ranges to 4 anchors, in flight\n\
                1 lines left out, the first: log.csv:3: ranging.distance1 \"oops\" is not a number\n";
    assert_eq!(run.stderr, told);
    let solved = folder.run("solve flight --method nls").ok();
    assert_eq!(solved.numbers("t_s"), [120.5, 120.7]);
    assert!(solved.numbers("x_m").iter().all(|x_m| (x_m - 3.0).abs() < 2e-3), "{}", solved.stdout);
    assert!(
        String::from_utf8_lossy(&folder.read("flight/positions.csv")).contains("\n1,120.7,crazyflie,3.2,2.1,0.9\n")
    );
}

#[test]
fn a_crazyflie_needs_the_positions_of_its_anchors() {
    let log = "Timestamp,ranging.distance0,ranging.distance5\n1000,3.5,4.5\n";
    let folder = Folder::with(&[
        ("anchors.csv", "anchor,x_m,y_m,z_m\n0,0,0,2\n"),
        ("log.csv", log),
        ("other.csv", "Timestamp,x\n1,2\n"),
    ]);
    let run = folder.run("import crazyflie log.csv --anchors anchors.csv --out flight");
    assert_eq!(run.code, Some(2));
    assert_eq!(run.stderr, "--anchors: no position with z_m for anchor 5, which the log has ranges to\n");
    let run = folder.run("import crazyflie other.csv --anchors anchors.csv --out flight");
    assert_eq!(run.stderr, "other.csv:1: no column ranging.distance0 to ranging.distance7\n");
}
