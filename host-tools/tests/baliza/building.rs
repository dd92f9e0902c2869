//! What is known of the building: `[area]` and `height_sigma_m` of a site, and the flags of `solve` and `track`.

use crate::support::Folder;

const SITE: &str = "[area]\nx_m = [0, 6]\ny_m = [0, 4.5]\n\
    [[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 3.4]\n[[node]]\nrole = \"anchor\"\nposition_m = [6, 0, 3.6]\n\
    [[node]]\nrole = \"anchor\"\nposition_m = [3, 4, 3.4]\n\
    [[node]]\nrole = \"tag\"\nheight_m = 1.0\nheight_sigma_m = 0.3\nrate_hz = 10\n[simulation]\nseconds = 5\n";

#[test]
fn a_recording_keeps_what_the_site_knows_of_the_building() {
    let folder = Folder::with(&[("site.toml", SITE)]);
    folder.run("simulate --site site.toml --out room").ok();
    let settings = String::from_utf8(folder.read("room/recording.toml")).expect("text");
    assert!(
        settings.contains("height_m = 1.0\nheight_sigma_m = 0.3\narea_m = [[0.0, 0.0], [6.0, 4.5]]\n"),
        "{settings}"
    );
    let sigma_m = |arguments: &str| {
        folder.run(&format!("{arguments} --out out.csv")).ok();
        let text = String::from_utf8(folder.read("out.csv")).expect("text");
        let rows = crate::support::Run { code: Some(0), stdout: text, stderr: String::new() };
        let sigmas: Vec<f64> = rows.numbers("sigma_x_m").into_iter().filter(|sigma| sigma.is_finite()).collect();
        sigmas.iter().sum::<f64>() / sigmas.len() as f64
    };
    for command in ["solve", "track"] {
        let [by_folder, by_flags, exact] = ["", " --height-m 1 --height-sigma-m 0.3", " --height-m 1"]
            .map(|flags| sigma_m(&format!("{command} room{flags}")));
        assert_eq!(by_folder, by_flags, "{command}");
        assert!(by_folder > 1.1 * exact, "{command}: {by_folder} {exact}");
    }
}

#[test]
fn a_deviation_belongs_to_a_height() {
    let folder = Folder::with(&[("site.toml", SITE)]);
    folder.run("simulate --site site.toml --out room").ok();
    for (flags, said) in [
        ("--dims 3 --height-sigma-m 0.3", "--height-sigma-m: only with --dims 2 --height-m Z"),
        (
            "--height-sigma-m 4",
            "invalid value '4' for '--height-sigma-m <SIGMA>': it must be from 0 to 1: beyond, use --dims 3",
        ),
        ("--height-m 1 --height-sigma-m -1", "invalid value '-1' for '--height-sigma-m <SIGMA>'"),
        ("--height-from-truth --height-sigma-m 0.3", "--height-from-truth"),
    ] {
        let run = folder.run(&format!("track room {flags}"));
        assert_eq!((run.code, run.stderr.lines().count()), (Some(2), 1), "{run:?}");
        assert!(run.stderr.contains(said), "{flags}: {run:?}");
    }
    folder.write("room/recording.toml", b"dims = 2\nheight_m = 1.0\nheight_sigma_m = -1.0\n");
    let run = folder.run("track room");
    assert_eq!(
        (run.code, run.stderr.as_str()),
        (Some(2), "room/recording.toml: height_sigma_m is -1; it must be 0 to 1\n")
    );
}
