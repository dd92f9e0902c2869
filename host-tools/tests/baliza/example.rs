//! The example recording of the project, and the command of the README for it.

use std::fs;

use crate::support::{Folder, root};

#[test]
fn the_files_that_ship_are_those_that_the_command_makes() {
    let folder = Folder::with(&[]);
    folder.run("example --out made").ok();
    for name in ["anchors.csv", "ranges.csv", "truth.csv"] {
        let shipped = fs::read(root().join("examples/room").join(name)).expect("it ships");
        assert!(
            folder.read(&format!("made/{name}")) == shipped,
            "{name} differs: run `baliza example --out examples/room --force`"
        );
    }
}

#[test]
fn the_readme_s_command_prints_positions_and_says_where_the_picture_is() {
    let readme = fs::read_to_string(root().join("README.md")).expect("README.md");
    let begin = "cargo run --release -p host-tools --bin baliza -- solve ";
    let (_, command) = readme.split_once(begin).expect("the command is in the README");
    let command = format!("solve {command}");
    let command = command.split("```").next().expect("text").replace('\\', " ");
    let folder = Folder::with(&[]);
    let in_repository = |path: &str| root().join(path).display().to_string();
    let command = command.replace("examples/room", &in_repository("examples/room"));
    let run = folder.run(&command).ok();

    // 300 epochs, of which one has lost all ranges. Nine of ten ranges have an error of about 0.1 m, so half of the
    // positions are within 0.2 m.
    assert_eq!(run.column("epoch").len(), 299);
    let mut errors: Vec<f64> = run.numbers("error_m").into_iter().filter(|error| error.is_finite()).collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 290 && errors[errors.len() / 2] < 0.2, "{}", run.stderr);
    let picture = run.stderr.lines().find_map(|line| line.strip_prefix("picture: ")).expect("where the picture is");
    assert!(folder.path(picture).is_file(), "{picture}");
}
