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

/// The text of a picture that the arguments make.
fn svg(folder: &Folder, arguments: &str) -> String {
    folder.run(&format!("{arguments} --out picture.svg")).ok();
    String::from_utf8(folder.read("picture.svg")).expect("text")
}

/// The values of an attribute in all elements of a kind that contain all of some texts.
fn elements<'a>(svg: &'a str, kind: &str, with: &[&str]) -> Vec<&'a str> {
    let start = format!("<{kind} ");
    svg.lines().filter(|line| line.starts_with(&start) && with.iter().all(|text| line.contains(text))).collect()
}

/// The picture's elements: no coordinate is beyond its border. Pictures are drawn eight times as large as shown.
fn assert_inside(svg: &str) {
    let header = svg.lines().next().expect("a header");
    let size = |name: &str| attribute(header, name)[0].parse::<f64>().expect("a number");
    let (width, height) = (8.0 * size("width"), 8.0 * size("height"));
    let mut count = 0;
    for line in svg.lines().skip(1) {
        let points = attribute(line, "points");
        let pairs = points.iter().flat_map(|points| points.split_whitespace()).filter_map(|pair| pair.split_once(','));
        let number = |text: &str| text.parse::<f64>().expect("a number");
        let (mut xs, mut ys): (Vec<f64>, Vec<f64>) = pairs.map(|(x, y)| (number(x), number(y))).unzip();
        for (names, all) in [(["x", "cx", "x1", "x2"], &mut xs), (["y", "cy", "y1", "y2"], &mut ys)] {
            all.extend(names.iter().flat_map(|name| attribute(line, name)).map(number));
        }
        count += xs.len();
        assert!(
            xs.iter().all(|x| (0.0..=width).contains(x)) && ys.iter().all(|y| (0.0..=height).contains(y)),
            "{line}"
        );
    }
    assert!(count > 20);
}

fn attribute<'a>(line: &'a str, name: &str) -> Vec<&'a str> {
    let start = format!(" {name}=\"");
    line.split(&start).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

const BLUE: &str = "#0072B2";
const VERMILION: &str = "#D55E00";
/// Their darker shades: 0.55 of each part.
const DARK: [&str; 2] = ["#003E61", "#753300"];

/// Two tags, which take turns, in positions and truth. Tag 10 errs by 0.3 and 0.4 m: RMSE 0.354; tag 9 by 0.1 m.
const TWO_TAGS: [(&str, &str); 2] = [
    ("t.csv", "epoch,t_s,x_m,y_m,tag\n0,0,1,1,10\n1,0.5,5,5,9\n2,1,2,1,10\n3,1.5,5,7,9\n"),
    (
        "p.csv",
        "epoch,t_s,method,x_m,y_m,tag\n0,0,track,1,1.3,10\n1,0.5,track,5.1,5,9\n2,1,track,2,1.4,10\n3,1.5,track,5.1,7,9\n",
    ),
];

#[test]
fn every_tag_has_a_colour_a_name_figures_and_a_truth() {
    let folder = Folder::with(&TWO_TAGS);
    let svg = svg(&folder, "plot --positions p.csv --truth t.csv");
    // Tags are in the order of their numbers, and so are their colours.
    let names: Vec<usize> = [">\n9\n<", ">\n10\n<"].iter().filter_map(|name| svg.find(name)).collect();
    assert!(names.len() == 2 && names[0] < names[1], "{names:?}");
    for text in
        ["2 tags by track", "0.354", "0.100", "1.5 s, from 0.0 to 1.5 s", "p.csv", "horizontal error (x, y), metres"]
    {
        assert!(svg.contains(text), "{text}");
    }
    // On the map two positions each, and one in the legend.
    assert_eq!(elements(&svg, "circle", &[&format!("fill=\"{BLUE}\"")]).len(), 3);
    assert_eq!(elements(&svg, "circle", &[&format!("fill=\"{VERMILION}\"")]).len(), 3);
    for colour in DARK {
        let lines = elements(&svg, "polyline", &[&format!("stroke=\"{colour}\"")]);
        assert_eq!(lines.len(), 1, "{colour}");
        assert_eq!(attribute(lines[0], "points")[0].split_whitespace().count(), 2);
    }
    assert_inside(&svg);
}

#[test]
fn positions_of_one_tag_have_a_colour_a_method() {
    let folder = Folder::with(&FILES);
    let methods = "epoch,method,x_m,y_m\n0,engine,1,1\n0,posterior,2,2\n0,gp-walk,3,3\n";
    folder.write("m.csv", methods.as_bytes());
    let svg = svg(&folder, "plot --positions m.csv");
    for colour in [BLUE, VERMILION, "#009E73"] {
        assert_eq!(elements(&svg, "circle", &[&format!("fill=\"{colour}\"")]).len(), 2, "{colour}");
    }
}

#[test]
fn dwells_are_crosses_with_a_line_to_each_estimate() {
    let folder = Folder::with(&[
        ("t.csv", "epoch,x_m,y_m\na,1,1\nb,5,1\nc,1,5\n"),
        ("p.csv", "epoch,method,x_m,y_m\na,gp,2,1\nb,gp,5,2\nc,gp,1,4\na,knn,1,2\nb,knn,6,1\nc,knn,,\n"),
    ]);
    let svg = svg(&folder, "plot --positions p.csv --truth t.csv");
    // Three crosses on the map and one in the legend, of two strokes each; five estimates, each with its line.
    let ink = elements(&svg, "line", &["stroke=\"#282828\""]);
    assert_eq!(ink.len(), 8, "{ink:#?}");
    let to_estimates = elements(&svg, "polyline", &["opacity=\"0.55\""]);
    assert_eq!(to_estimates.len(), 5, "{to_estimates:#?}");
    // No line from one point to the next: nothing else is drawn in ink.
    assert_eq!(elements(&svg, "polyline", &["stroke=\"#282828\""]).len(), 0);
    assert!(svg.contains("truth, with a line to each estimate"));
}

#[test]
fn errors_in_space_are_named_and_the_greatest_one_is_on_the_curve() {
    let positions = "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m\n\
                     0,0,track,1,1,1,0.1,0.1,0.1\n1,1,track,2,2,21,0.1,0.1,0.1\n2,2,track,3,3,1.1,0.1,0.1,0.1\n";
    let truth = "epoch,t_s,x_m,y_m,z_m\n0,0,1,1,1.1\n1,1,2,2,1\n2,2,3,3,1\n";
    let folder = Folder::with(&[("p.csv", positions), ("t.csv", truth)]);
    let svg = svg(&folder, "plot --positions p.csv --truth t.csv");
    // Errors of 0.1, 20 and 0.1 m: the axis is logarithmic and has ticks up to 20 m.
    for text in ["3-D error (x, y, z), metres, logarithmic", "20.000", "\n0.1\n", "\n10\n"] {
        assert!(svg.contains(text), "{text}");
    }
}

#[test]
fn an_ellipse_follows_the_covariance() {
    // Variances of 1 m² and a covariance of 0.99 m²: the ellipse is nearly its diagonal, from lower left to upper
    // right.
    let positions = "epoch,method,x_m,y_m,sigma_x_m,sigma_y_m,cov_xy_m2\n0,robust,5,5,1,1,0.99\n";
    let anchors = "anchor,x_m,y_m\na,0,0\nb,10,0\nc,10,10\n";
    let folder = Folder::with(&[("p.csv", positions), ("a.csv", anchors)]);
    let svg = svg(&folder, "plot --positions p.csv --anchors a.csv");
    assert!(svg.contains("2 σ, of some positions") && !svg.contains("along x and y"));
    let area = elements(&svg, "polygon", &[&format!("fill=\"{BLUE}\""), "opacity=\"0.06\""]);
    let points = attribute(area[0], "points")[0].split_whitespace().filter_map(|pair| pair.split_once(','));
    let points: Vec<(f64, f64)> = points.map(|(x, y)| (x.parse().expect("x"), y.parse().expect("y"))).collect();
    let count = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |sum, at| (sum.0 + at.0 / count, sum.1 + at.1 / count));
    let [xy, xx] = points
        .iter()
        .fold([0.0; 2], |[xy, xx], at| [xy + (at.0 - mean.0) * (at.1 - mean.1), xx + (at.0 - mean.0).powi(2)]);
    // On paper y goes down.
    assert!((xy / xx + 0.99).abs() < 0.02, "{}", xy / xx);
}

#[test]
fn a_tag_at_rest_is_shown_enlarged() {
    let rows: String =
        (0..50).map(|k| format!("{k},{k},track,{},{},9\n", 5.0 + 0.001 * f64::from(k % 7), 5.02)).collect();
    let truth: String = (0..50).map(|k| format!("{k},{k},5,5\n")).collect();
    let anchors = "anchor,x_m,y_m\na,0,0\nb,10,0\nc,10,10\n";
    let folder = Folder::with(&[
        ("p.csv", &format!("epoch,t_s,method,x_m,y_m,z_m\n{rows}")),
        ("t.csv", &format!("epoch,t_s,x_m,y_m\n{truth}")),
        ("a.csv", anchors),
    ]);
    let svg = svg(&folder, "plot --positions p.csv --truth t.csv --anchors a.csv");
    assert!(svg.contains("Enlarged") && svg.contains("the box on the map is shown enlarged"));
    assert_inside(&svg);
}

#[test]
fn numbers_make_a_picture_however_large_or_are_refused_with_their_bound() {
    let long = "n".repeat(20_000);
    let cases = [
        format!("0,0,{long},1,1,0.1,0.1,0.2,{long}\n1,1e11,lls,2,2,,,1e7,b\n"),
        "0,-1e308,a,1e308,-1e308,1e308,1e308,1e308,x\n1,1e308,a,-1e308,1e308,1e-300,1e-300,0,x\n2,2,a,1,1,1,1,0,x\n"
            .to_owned(),
        "0,0,a,1e17,1e17,0,0,0,x\n1,1,a,1e17,1e17,0,0,0,x\n".to_owned(),
        "0,-1e11,a,1e7,-1e7,1e7,1e7,1e7,x\n1,1e11,a,-1e7,1e7,1e-300,1e-300,0,x\n2,2,a,1,1,1,1,0,x\n".to_owned(),
        "0,0,a,3,3,0,0,0,x\n1,1,a,3,3,0,0,0,y\n2,2,a,3,3,1e200,1,1e200,y\n".to_owned(),
        "0,0,a,5e-324,5e-324,5e-324,5e-324,5e-324,x\n1,1,b,-5e-324,0,1,1,0.5,x\n".to_owned(),
        "0,0,a,9999999,0,1,1,1,x\n1,1,a,-9999999,1e-9,1,1,1,x\n2,2,b,0,0,1,1,1e-12,x\n".to_owned(),
    ];
    let mut pictures = 0;
    for rows in cases {
        let positions = format!("epoch,t_s,method,x_m,y_m,sigma_x_m,sigma_y_m,error_m,tag\n{rows}");
        let folder = Folder::with(&[
            ("p.csv", &positions),
            ("t.csv", "epoch,t_s,x_m,y_m,tag\n0,0,1,1,x\n1,1,1e7,1e7,x\n2,2,-1e7,0,x\n3,3,2,2,x\n"),
            ("a.csv", "anchor,x_m,y_m\na,0,0\nb,1e7,0\n"),
            ("w.csv", "x1_m,y1_m,x2_m,y2_m\n0,0,1e7,1e7\n-1e7,0,1e7,0\n0,0,0,0\n"),
        ]);
        for more in ["", " --truth t.csv --anchors a.csv --walls w.csv"] {
            let run = folder.run(&format!("plot --positions p.csv{more} --out picture.svg"));
            match run.code {
                Some(0) => {
                    pictures += 1;
                    assert_inside(&String::from_utf8(folder.read("picture.svg")).expect("text"));
                }
                code => assert!(code == Some(2) && run.stderr.contains(" is not within ±"), "{run:?}"),
            }
        }
    }
    assert_eq!(pictures, 8, "three of the seven files have numbers beyond all bounds");
}

#[test]
fn a_long_recording_makes_a_small_picture_that_keeps_the_outermost_positions() {
    // Positions everywhere in a room, and a truth that never goes the same way twice.
    let at = |k: u32, seed: u32| f64::from(k.wrapping_mul(seed) >> 12) / f64::from(1_u32 << 20) * 10.0;
    let row = |k: u32| format!("{k},{k},track,{:.4},{:.4}\n", at(k, 2_654_435_769), at(k, 1_597_334_677));
    let rows: String = (0..40_000).map(row).chain(["40000,40000,track,12.5,5\n".to_owned()]).collect();
    let truth: String =
        (0..40_000_u32).map(|k| format!("{k},{k},{:.4},{:.4}\n", at(k, 3_266_489_917), at(k, 668_265_263))).collect();
    let folder = Folder::with(&[
        ("p.csv", &format!("epoch,t_s,method,x_m,y_m\n{rows}")),
        ("t.csv", &format!("epoch,t_s,x_m,y_m\n{truth}")),
    ]);
    let svg = svg(&folder, "plot --positions p.csv --truth t.csv");
    assert!(svg.len() < 3_000_000, "{} bytes", svg.len());
    let dots = elements(&svg, "circle", &[&format!("fill=\"{BLUE}\"")]);
    assert!((2000..10_000).contains(&dots.len()), "{}", dots.len());
    // The position outside of the room is the rightmost, by a quarter of the room's width.
    let mut xs: Vec<f64> = dots.iter().map(|dot| attribute(dot, "cx")[0].parse().expect("a number")).collect();
    xs.retain(|x| *x < 8.0 * 740.0);
    xs.sort_by(f64::total_cmp);
    let [first, before, last] = [xs[0], xs[xs.len() - 2], xs[xs.len() - 1]];
    assert!(((last - first) / (before - first) - 1.25).abs() < 0.01, "{first} {before} {last}");
    assert!(svg.contains("40001") && svg.contains("positions that others would cover are not drawn"));
}

#[test]
fn a_folder_is_a_picture_by_two_words() {
    let folder = Folder::with(&[]);
    folder.run("example --out .").ok();
    folder.write("walls.csv", b"x_m,y_m\n0,0\n6,0\n6,8\n");
    assert_eq!(folder.run("plot .").ok().stderr, "picture: ./picture.png\n");
    assert_eq!(folder.read("picture.png")[..4], *b"\x89PNG");
    // The track of the ranges. With positions, these; flags replace files.
    let track = svg(&folder, "plot .");
    assert!(track.contains("track of ./ranges.csv") && track.contains("walls") && track.contains("anchors"));
    folder.write("positions.csv", b"epoch,method,x_m,y_m\n0,robust,1,1\n");
    assert!(svg(&folder, "plot .").contains("./positions.csv"));
    folder.write("other.csv", b"epoch,method,x_m,y_m\n0,robust,1,1\n");
    assert!(svg(&folder, "plot . --positions other.csv").contains("other.csv"));
    let run = folder.run("plot walls.csv");
    assert_eq!(
        (run.code, run.stderr.as_str()),
        (Some(2), "walls.csv: this is no folder; a recording is a folder with anchors.csv and ranges.csv\n")
    );
}

#[test]
fn a_plan_lies_beneath_at_its_scale() {
    let folder = Folder::with(&FILES);
    folder.run("plot --positions positions.csv --out plan.png").ok();
    let arguments = "plot --positions positions.csv --anchors anchors.csv --plan plan.png --plan-scale 0.01";
    let svg = svg(&folder, &format!("{arguments} --plan-corner=-1,0.5"));
    let image = svg.find("<image ").expect("an image");
    assert!(image < svg.find("<polyline").expect("the map") && svg.contains("data:image/png;base64,iVBOR"));
    folder.run(&format!("{arguments} --out with.png")).ok();
    let whole = folder.read("plan.png");
    folder.write("half.png", &whole[..whole.len() / 2]);
    for (more, said) in [
        ("--plan half.png --plan-scale 1", "half.png: the image is damaged: "),
        ("--plan anchors.csv --plan-scale 1", "anchors.csv: it is neither a PNG nor a JPEG image\n"),
        ("--plan plan.png --plan-scale 0", "--plan-scale"),
        ("--plan plan.png", "--plan-scale"),
    ] {
        let run = folder.run(&format!("plot --positions positions.csv {more} --out no.svg"));
        assert!(run.code == Some(2) && run.stderr.contains(said), "{run:?}");
    }
}

#[test]
fn commands_draw_each_tag_of_a_recording() {
    let folder = Folder::with(&[]);
    folder.run("simulate --tags 2 --seconds 1 --out run --plot simulated.svg").ok();
    folder.run("track run --plot tracked.svg").ok();
    folder.run("solve run --plot solved.svg").ok();
    for (picture, said) in
        [("simulated.svg", "2 tags by track"), ("tracked.svg", "2 tags by track"), ("solved.svg", "2 tags by robust")]
    {
        let svg = String::from_utf8(folder.read(picture)).expect("text");
        for text in [said, "\n0x1001\n", "\n0x1002\n", BLUE, VERMILION, DARK[0], DARK[1]] {
            assert!(svg.contains(text), "{picture}: {text}");
        }
        assert_inside(&svg);
    }
}

#[test]
fn beacons_are_beacons_and_each_method_has_a_colour() {
    let levels = |point: &str, at: [f64; 2]| -> String {
        let beacons = [("b1", [0.0, 0.0]), ("b2", [6.0, 0.0]), ("b3", [3.0, 5.0])];
        let row = |(name, [x, y]): (&str, [f64; 2])| {
            let rssi = -59.0 - 20.0 * (at[0] - x).hypot(at[1] - y).log10();
            format!("{point},{},{},{name},{rssi:.0},0.1\n", at[0], at[1])
        };
        beacons.into_iter().map(row).collect()
    };
    let rows = levels("p", [2.0, 1.0]) + &levels("q", [4.0, 2.0]);
    let folder = Folder::with(&[
        ("b.csv", "beacon,x_m,y_m,rssi_1m_dbm,path_loss_exponent\nb1,0,0,-59,2\nb2,6,0,-59,2\nb3,3,5,-59,2\n"),
        ("targets.csv", &format!("point,x_m,y_m,beacon,rssi_dbm,t_s\n{rows}")),
    ]);
    folder.run("ble solve --beacons b.csv --rssi targets.csv --plot picture.svg").ok();
    let svg = String::from_utf8(folder.read("picture.svg")).expect("text");
    assert!(svg.contains("\nbeacons\n") && !svg.contains("\nanchors\n") && svg.contains("targets.csv"));
    let methods = ["weighted-linear", "nonlinear", "posterior", "particle-filter", "engine"];
    for (method, colour) in methods.iter().zip([BLUE, VERMILION, "#009E73", "#CC79A7", "#BE8200"]) {
        assert!(svg.contains(method));
        // A mark in the legend; estimates are marks, too.
        assert!(!elements(&svg, "circle", &[&format!("fill=\"{colour}\"")]).is_empty(), "{method}");
    }
    assert_inside(&svg);
}
