//! The program's manners: version, help, shells, manual pages, colours, and how much it says.

use std::process::Command;

use crate::support::{Folder, root};

#[test]
fn the_version_names_the_commit_of_the_repository() {
    let git = Command::new("git").arg("-C").arg(root()).args(["rev-parse", "HEAD"]).output();
    let commit = git.ok().filter(|output| output.status.success() && root().join(".git").exists());
    let commit = commit.map(|output| String::from_utf8(output.stdout).expect("a commit"));
    let run = Folder::with(&[]).run("--version").ok();
    let version = env!("CARGO_PKG_VERSION");
    match commit {
        Some(commit) => assert_eq!(run.stdout, format!("baliza {version} ({})\n", &commit[..12])),
        None => assert!(run.stdout.starts_with(&format!("baliza {version}")), "{run:?}"),
    }
}

#[test]
fn help_lists_the_commands_in_groups() {
    let help = Folder::with(&[]).run("--help").ok().stdout;
    let titles: Vec<_> = help.lines().filter_map(|line| line.strip_suffix(':')).collect();
    let expected = ["Simulate", "Set up a site", "Run", "Analyse", "Research", "This program", "Options"];
    assert_eq!(titles, expected);
    let analyse = help.split("\n\n").find(|group| group.starts_with("Analyse:")).expect("the group");
    let commands: Vec<_> = analyse.lines().skip(1).filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(commands, ["solve", "track", "check", "ble", "classify-rooms", "plot"]);
}

#[test]
fn an_error_in_the_arguments_names_the_help_of_its_command() {
    let folder = Folder::with(&[]);
    for (arguments, help) in [
        ("solve --method none", "; see baliza solve --help\n"),
        ("ble solve --no-such-flag", "; see baliza ble solve --help\n"),
        ("--quiet track --dims 4", "; see baliza track --help\n"),
        ("nosuch", "; see baliza --help\n"),
    ] {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stdout.as_str(), run.stderr.lines().count()), (Some(2), "", 1), "{run:?}");
        assert!(run.stderr.ends_with(help), "{run:?}");
    }
}

#[test]
fn quiet_leaves_errors_only_and_verbose_adds_version_and_files() {
    let folder = Folder::with(&[]);
    folder.run("example --out .").ok();
    let solve = "solve --anchors anchors.csv --ranges ranges.csv --truth truth.csv --out positions.csv";
    let usual = folder.run(solve).ok();
    assert!(!usual.stderr.is_empty());
    for quiet in [format!("{solve} --quiet"), format!("-q {solve}")] {
        let run = folder.run(&quiet).ok();
        assert_eq!((run.stdout.as_str(), run.stderr.as_str()), ("", ""));
    }
    let wrong = folder.run("-q solve --anchors nosuch --ranges ranges.csv");
    assert_eq!((wrong.code, wrong.stderr.starts_with("nosuch: cannot open it: ")), (Some(2), true), "{wrong:?}");

    let verbose = folder.run(&format!("{solve} -v")).ok();
    let version = folder.run("--version").stdout;
    assert!(verbose.stderr.starts_with(&version), "{verbose:?}");
    for file in ["anchors.csv", "ranges.csv", "truth.csv"] {
        assert!(verbose.stderr.lines().any(|line| line == format!("reading {file}")), "{verbose:?}");
    }
    assert!(verbose.stderr.ends_with(&usual.stderr), "{verbose:?}");
    assert_eq!(folder.run(&format!("{solve} -q -v")).code, Some(2));
}

#[test]
fn completions_know_commands_and_flags() {
    let folder = Folder::with(&[]);
    for shell in ["bash", "zsh", "fish"] {
        let script = folder.run(&format!("completions {shell}")).ok().stdout;
        assert!(script.contains("classify-rooms") && script.contains("height-m"), "{shell}");
    }
    assert_eq!(folder.run("completions tcsh").code, Some(2));
    // The shell itself reads the script, where it is there.
    folder.write("baliza.bash", folder.run("completions bash").stdout.as_bytes());
    let line =
        "source baliza.bash && COMP_WORDS=(baliza cla) COMP_CWORD=1 && _baliza baliza cla baliza && echo $COMPREPLY";
    if let Ok(bash) = Command::new("bash").args(["-c", line]).current_dir(folder.path("")).output() {
        assert_eq!(String::from_utf8_lossy(&bash.stdout), "classify-rooms\n");
    }
}

#[test]
fn there_is_a_manual_page_for_each_command() {
    let folder = Folder::with(&[]);
    folder.run("man --out pages").ok();
    for (page, said) in
        [("baliza", "baliza\\-solve(1)"), ("baliza-solve", "\\-\\-ranges"), ("baliza-ble-solve", "\\-\\-beacons")]
    {
        let text = String::from_utf8(folder.read(&format!("pages/{page}.1"))).expect("UTF-8");
        assert!(text.contains(".TH") && text.contains(said), "{page}: {text}");
    }
    let again = folder.read("pages/baliza.1");
    folder.run("man --out pages").ok();
    assert_eq!(folder.read("pages/baliza.1"), again);
    let refused = folder.run("man --out pages/baliza.1");
    assert_eq!((refused.code, refused.stderr.as_str()), (Some(2), "--out: pages/baliza.1 is no folder\n"));
}

#[cfg(unix)]
#[test]
fn help_is_in_colours_on_a_terminal_that_can_show_them() {
    use std::io::Read;
    use std::process::Stdio;

    use serialport::{SerialPort, TTYPort};

    let folder = Folder::with(&[]);
    let is_coloured = |variable: &str, value: &str| {
        let (mut ours, theirs) = TTYPort::pair().expect("a pseudo terminal");
        let terminal = std::fs::File::options().write(true).open(theirs.name().expect("a name")).expect("opened");
        let mut command = folder.command("--help");
        command.env_clear().env("TERM", "xterm").env(variable, value).stdout(Stdio::from(terminal));
        assert!(command.status().expect("baliza runs").success());
        let mut text = [0; 512];
        let length = ours.read(&mut text).expect("the help");
        text[..length].contains(&0x1B)
    };
    assert!(is_coloured("TERM", "xterm"));
    assert!(!is_coloured("TERM", "dumb"));
    assert!(!is_coloured("NO_COLOR", "1"));
}
