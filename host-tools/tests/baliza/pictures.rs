//! Pictures: the file format and the expected content.

use crate::support::Folder;

const ANCHORS: &str = "anchor,x_m,y_m,z_m\nwest & co <1>,0,0,0\nb,3,0,0\nc,0,4,0\nd,6,8,0\n";
const TRUTH: &str = "epoch,t_s,x_m,y_m\n0,0,1,1\n1,1,2,2\n2,2,3,3\n";
const POSITIONS: &str = "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,used,reason\n\
                         0,0,robust,1.1,1,,0.1,0.2,,4,\n1,1,robust,2.2,2,,0.1,0.2,,4,\n2,2,robust,,,,,,,,diverged\n\
                         0,0,lls,1.5,1,,,,,4,\n1,1,lls,99,99,,,,,4,\n2,2,lls,3,3.5,,,,,4,\n";
const FILES: [(&str, &str); 3] = [("anchors.csv", ANCHORS), ("truth.csv", TRUTH), ("positions.csv", POSITIONS)];

#[test]
fn an_svg_names_anchors_methods_and_figures() {
    let folder = Folder::with(&FILES);
    folder.run("plot --positions positions.csv --truth truth.csv --anchors anchors.csv --out picture.svg").ok();
    let svg = String::from_utf8(folder.read("picture.svg")).expect("text");
    // robust has errors of 0.1 and 0.2 m: RMSE √(0.05 ⁄ 2) = 0.158, P50 0.150, P90 0.1 + 0.9 · 0.1 = 0.190.
    for text in
        ["west &amp; co &lt;1&gt;", "robust", "lls", "0.158", "0.150", "0.190", "1 position lies outside of the map"]
    {
        assert!(svg.contains(text), "{text}");
    }
}

#[test]
fn a_png_has_the_signature_and_size_of_its_drawing() {
    let folder = Folder::with(&FILES);
    folder.run("plot --positions positions.csv --truth truth.csv --out picture.PNG").ok();
    let png = folder.read("picture.PNG");
    assert_eq!(png[..8], *b"\x89PNG\r\n\x1a\n");
    // The header chunk: width and height, 1.5 times those of the drawing.
    let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().expect("four bytes"));
    assert_eq!(number(16), 1860);
    assert!((600..1800).contains(&number(20)), "{}", number(20));
}

#[test]
fn positions_alone_are_a_map() {
    let folder = Folder::with(&FILES);
    folder.run("plot --positions positions.csv --out picture.svg").ok();
    let svg = String::from_utf8(folder.read("picture.svg")).expect("text");
    assert!(svg.contains("Positions") && !svg.contains("Distance from the truth"));
}

#[test]
fn without_any_position_there_is_still_a_picture() {
    let folder = Folder::with(&[("positions.csv", "epoch,method,x_m,y_m,reason\n0,robust,,,diverged\n")]);
    folder.run("plot --positions positions.csv --out picture.png").ok();
    assert_eq!(folder.names(), ["picture.png", "positions.csv"]);
}

#[test]
fn wrong_positions_are_refused_without_a_picture() {
    let folder = Folder::with(&[("positions.csv", "epoch,method,x_m,y_m\n0,robust,1,a\n")]);
    let run = folder.run("plot --positions positions.csv --out picture.svg");
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), "positions.csv:2: y_m \"a\" is not a number\n"));
    assert_eq!(folder.names(), ["positions.csv"]);
}

#[test]
fn the_benchmark_draws_its_figure() {
    let folder = Folder::with(&[]);
    let run = folder.run("bench thesis --points 50 --plot figure.svg").ok();
    assert_eq!(run.stderr, "picture: figure.svg\n");
    let svg = String::from_utf8(folder.read("figure.svg")).expect("text");
    assert!(svg.contains("bb-nls-r") && svg.contains("as printed"));
}
