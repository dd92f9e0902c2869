//! A case as the files of a recording, and an index of cases.

use std::fmt::Write as _;

use super::Case;

/// The names and texts of a case's files: `anchors.csv`, `ranges.csv`, `truth.csv`.
pub fn texts(case: &Case) -> [(&'static str, String); 3] {
    // Writing to a string cannot fail.
    let mut anchors = String::from("anchor,x_m,y_m,z_m\n");
    for (anchor, [x, y, z]) in case.anchors_m.iter().enumerate() {
        let _ = writeln!(anchors, "{anchor},{x},{y},{z}");
    }
    let mut ranges = String::from("epoch,t_s,anchor,range_m,rx_power_dbm,fp_power_dbm,los\n");
    let mut truth = String::from("epoch,t_s,x_m,y_m,z_m\n");
    for (number, epoch) in case.epochs.iter().enumerate() {
        let t_s = epoch.t_s;
        for range in &epoch.ranges {
            let powers =
                range.powers_dbm.map_or_else(|| ",".to_owned(), |[received, first]| format!("{received},{first}"));
            let (anchor, range_m, direct) = (range.anchor, range.range_m, u8::from(!range.blocked));
            let _ = writeln!(ranges, "{number},{t_s},{anchor},{range_m},{powers},{direct}");
        }
        let [x, y, z] = epoch.at_m;
        let _ = writeln!(truth, "{number},{t_s},{x:.4},{y:.4},{z:.4}");
    }
    [("anchors.csv", anchors), ("ranges.csv", ranges), ("truth.csv", truth)]
}

/// A table of cases and their conditions, as CSV.
pub fn index<'c>(cases: impl IntoIterator<Item = &'c Case>) -> String {
    let mut text = String::from(
        "case,dims,length_m,width_m,height_m,anchors,layout,movement,rate_hz,seconds,loss,common_m,\
         lasting_length_m,white_m,blocked,blocked_length_m,wild,powers\n",
    );
    for case in cases {
        let of = &case.conditions;
        let dims = if of.group == super::Group::Space { 3 } else { 2 };
        let [length, width, height] = of.room_m;
        let (layout, movement, powers) = (of.layout.as_str(), of.movement.as_str(), of.powers.as_str());
        let _ = write!(text, "{},{dims},{length:.2},{width:.2},{height:.2},{},", case.name(), of.anchors);
        let _ = write!(text, "{layout},{movement},{:.2},{:.1},{:.3},", of.rate_hz, of.seconds, of.loss);
        let _ = write!(text, "{:.3},{:.2},{:.3},", of.common_m, of.lasting_length_m, of.white_m);
        let _ = writeln!(text, "{:.3},{:.2},{:.4},{powers}", of.blocked, of.blocked_length_m, of.wild);
    }
    text
}
