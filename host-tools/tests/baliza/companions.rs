//! Programs of their own behind the one name: `baliza serve` starts `baliza-station`, found beside `baliza` or on the path.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use crate::support::{Folder, Run};

/// A folder with `baliza` alone, and how it is run there: nothing else is beside it or on the path.
fn alone() -> Folder {
    let folder = Folder::with(&[]);
    fs::copy(crate::PROGRAM, folder.path("baliza")).expect("a copy of the program");
    folder
}

fn run(folder: &Folder, arguments: &str) -> Run {
    let mut command = std::process::Command::new(folder.path("baliza"));
    command.args(arguments.split_whitespace()).current_dir(folder.path("")).env("PATH", folder.path("on-path"));
    let output = command.stdin(std::process::Stdio::null()).output().expect("baliza runs");
    let text = |bytes| String::from_utf8(bytes).expect("UTF-8");
    Run { code: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
}

/// A program that prints its arguments and ends with 7.
fn program(file: &Path) {
    fs::write(file, "#!/bin/sh\necho \"$0: $@\"\nexit 7\n").expect("a script");
    fs::set_permissions(file, fs::Permissions::from_mode(0o755)).expect("executable");
}

#[test]
fn a_missing_program_is_named_with_the_one_command_that_installs_it() {
    let folder = alone();
    for (arguments, name, source) in [
        ("serve --simulate", "baliza-station", "host-tools/station"),
        ("live", "baliza-station", "host-tools/station"),
        ("station backup --out b", "baliza-station", "host-tools/station"),
        ("bench thesis", "baliza-bench", "qa/bench"),
        ("monitor", "baliza-probe", "host-tools/probe"),
        ("provision --read --board dwm1001", "baliza-probe", "host-tools/probe"),
    ] {
        let ran = run(&folder, arguments);
        let said = format!("the program {name} is not here: cargo install --path {source}\n");
        assert_eq!((ran.code, ran.stdout.as_str()), (Some(1), ""), "{arguments}: {ran:?}");
        assert!(ran.stderr.ends_with(&said) && ran.stderr.lines().count() == 1, "{arguments}: {ran:?}");
    }
}

#[test]
fn a_command_of_another_program_gets_its_arguments_and_gives_its_exit_code() {
    let folder = alone();
    fs::create_dir(folder.path("on-path")).expect("a folder");
    program(&folder.path("on-path/baliza-station"));
    let ran = run(&folder, "-q serve --listen 127.0.0.1:0 --simulate");
    assert_eq!(ran.code, Some(7), "{ran:?}");
    assert!(ran.stdout.ends_with("on-path/baliza-station: -q serve --listen 127.0.0.1:0 --simulate\n"), "{ran:?}");
    // What is beside the program comes first.
    program(&folder.path("baliza-station"));
    let ran = run(&folder, "help live");
    assert!(ran.stdout.ends_with("/baliza-station: live --help\n") && !ran.stdout.contains("on-path"), "{ran:?}");
    program(&folder.path("baliza-probe"));
    let ran = run(&folder, "monitor --chip nRF52832_xxAA");
    assert!(ran.stdout.ends_with("/baliza-probe: monitor --chip nRF52832_xxAA\n"), "{ran:?}");
}

#[test]
fn completions_have_the_arguments_that_the_other_programs_describe() {
    let folder = alone();
    let without = run(&folder, "completions bash").ok().stdout;
    assert!(without.contains("serve") && !without.contains("--listen"), "names only");
    let described = r#"[{"name":"serve","about":"Serve","long_about":null,"after_help":null,"aliases":[],"arguments":[
        {"id":"listen","long":"listen","short":null,"help":"Where","long_help":null,"heading":null,"values":["ADDRESS"],
         "possible":[],"defaults":["127.0.0.1:8080"],"takes_values":true,"is_path":false,"is_required":false,
         "is_repeated":false}],"commands":[]},
        {"name":"live","about":"Live","long_about":null,"after_help":null,"aliases":[],"arguments":[],"commands":[]},
        {"name":"forward","about":"Send","long_about":null,"after_help":null,"aliases":[],"arguments":[],"commands":[]},
        {"name":"station","about":"Store","long_about":null,"after_help":null,"aliases":[],"arguments":[],"commands":[]}]"#;
    folder.write("described.json", described.as_bytes());
    program(&folder.path("baliza-station"));
    let script = format!("#!/bin/sh\nexec /bin/cat {}\n", folder.path("described.json").display());
    fs::write(folder.path("baliza-station"), script).expect("a script");
    let with = run(&folder, "completions bash").ok().stdout;
    assert!(with.contains("--listen"), "{with}");
}
