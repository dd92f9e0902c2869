//! `baliza classify-rooms`.

use crate::support::Folder;

const ROOMS: &str =
    "room,x_m,y_m\nhall,0,0\nhall,4,0\nhall,4,4\nhall,0,4\nattic,4,0\nattic,8,0\nattic,8,4\nattic,4,4\n";
const POSITIONS: &str = "epoch,t_s,method,x_m,y_m,sigma_x_m,sigma_y_m\n\
                         1,0,m,1,2,0.1,0.1\n2,1,m,4.1,2,0.5,0.1\n3,2,m,,,,\n4,3,m,9,9,0.1,0.1\n5,30,m,7,1,0.1,0.1\n1,0,n,7,1,,\n";

#[test]
fn each_position_has_its_room_and_the_tags_answer() {
    let truth = "epoch,t_s,x_m,y_m\n1,0,1,2\n2,1,3.9,2\n5,30,7,1\n";
    let folder = Folder::with(&[("p.csv", POSITIONS), ("r.csv", ROOMS), ("t.csv", truth)]);
    let run = folder.run("presence --positions p.csv --outlines r.csv").ok();
    // The position is 0.1 m beyond the wall, with σ 0.5 m. The quadrature nodes at −1.356 σ and −2.857 σ are before the
    // wall, with 0.233 of the Gaussian.
    assert_eq!(run.column("room"), ["hall", "attic", "", "", "attic", "attic"]);
    assert_eq!(run.column("probability"), ["1.000", "0.767", "", "", "1.000", "1.000"]);
    // One position beyond the wall does not change the answer. After 27 s without a position in a room, the answer
    // begins again.
    assert_eq!(run.column("answer"), ["hall", "hall", "hall", "hall", "attic", "attic"]);

    let json = folder.run("classify-rooms --positions p.csv --outlines r.csv --truth t.csv --json").ok().json();
    let m = &json[0];
    assert_eq!((&m["positions"], &m["outside"], &m["judged"]), (&5.into(), &2.into(), &3.into()));
    assert_eq!((&m["accuracy"], &m["wrong"], &m["changes"]), (&0.666_667.into(), &0.into(), &1.into()));
    assert_eq!((&json[1]["method"], &json[1]["wrong"]), (&"n".into(), &1.into()));

    // The rows of method m have a median deviation of 0.1 m.
    assert_eq!((&m["settle_s"], &json[1]["settle_s"]), (&1.0.into(), &4.6.into()));

    folder.write("two.csv", b"room,x_m,y_m\nhall,0,0\nhall,1,0\n");
    let run = folder.run("presence --positions p.csv --outlines two.csv");
    assert_eq!((run.code, run.stderr.trim_end()), (Some(2), "two.csv: room \"hall\" has fewer than three corners"));
}
