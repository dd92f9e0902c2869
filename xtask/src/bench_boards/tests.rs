//! The steps with outputs of `baliza` as boards would give them.

use std::fs;

use super::*;

/// Answers a command by the first output whose beginning of words fits.
struct Fake {
    outputs: Vec<(&'static str, Result<String, &'static str>)>,
    asked: Vec<String>,
}

impl Fake {
    fn new(outputs: Vec<(&'static str, Result<String, &'static str>)>) -> Self {
        Self { outputs, asked: Vec::new() }
    }
}

impl Commands for Fake {
    fn run(&mut self, words: &[String]) -> Result<String> {
        let line = words.join(" ");
        self.asked.push(line.clone());
        let found = self.outputs.iter().find(|(begins, _)| line.starts_with(begins));
        let (_, output) = found.with_context(|| format!("nobody answers {line}"))?;
        output.clone().map_err(anyhow::Error::msg)
    }
}

/// A folder with this number of anchors at probes, and a tag at a serial port.
fn desk(name: &str, anchors: usize) -> Desk {
    let folder = std::env::temp_dir().join(format!("baliza-desk-{name}-{}", std::process::id()));
    fs::create_dir_all(&folder).expect("a folder");
    fs::write(folder.join("site.toml"), "").expect("a site");
    for at in 1..=anchors {
        let text =
            format!("node = \"anchor-{at}\"\nboard = \"dwm1001\"\nrole = \"anchor\"\nprobe = \"1366:1015:{at}\"\n");
        fs::write(folder.join(format!("anchor-{at}.toml")), text).expect("a board");
    }
    let tag = "node = \"tag-1\"\nboard = \"esp32c3\"\nrole = \"tag\"\nport = \"/dev/ttyACM0\"\nwiring = \"10 cm\"\n";
    fs::write(folder.join("tag.toml"), tag).expect("a board");
    let desk = Desk::read(&folder).expect("a desk");
    fs::remove_dir_all(&folder).expect("a folder");
    desk
}

fn verdict(number: u8, desk: &Desk, outputs: Vec<(&'static str, Result<String, &'static str>)>) -> StepVerdict {
    let step = STEPS.iter().find(|step| step.number == number).expect("a step");
    step.check(desk, &mut Fake::new(outputs))
}

fn state(t_s: f64, state: &str) -> String {
    format!("{{\"type\":\"state\",\"t_s\":{t_s},\"state\":\"{state}\"}}\n")
}

/// Rounds of a tag: one each `period_s`, every `short`-th with three anchors instead of four.
fn rounds(count: u32, period_s: f64, short: u32) -> String {
    let round = |at: u32| {
        let used = if at.is_multiple_of(short) { 3 } else { 4 };
        format!("{{\"type\":\"fix\",\"t_s\":{},\"used\":{used}}}\n", f64::from(at) * period_s)
    };
    (0..count).map(round).collect()
}

#[test]
fn steps_are_numbered_as_in_the_document() {
    let document = fs::read_to_string(crate::root().join("docs/use/hardware.md"));
    let document = document.expect("the document of the steps");
    for (step, number) in STEPS.iter().zip(1..) {
        assert_eq!(step.number, number);
        let row = format!("| {number} | ");
        let line = document.lines().find(|line| line.starts_with(&row)).unwrap_or_else(|| panic!("no step {number}"));
        let first = step.what.split(',').next().unwrap_or_default();
        assert!(line.contains(first), "step {number} is {line}, not {first}");
    }
}

#[test]
fn flashing_goes_board_by_board_and_wants_a_hello() {
    let desk = desk("flash", 1);
    let hello = || ("monitor", Ok("{\"type\":\"hello\",\"t_s\":0.001}\n".to_owned()));
    let mut fake = Fake::new(vec![("flash", Ok(String::new())), hello()]);
    assert_eq!(STEPS[0].check(&desk, &mut fake), StepVerdict::Passed("2 boards".to_owned()));
    let asked: Vec<&str> = fake.asked.iter().map(|line| line.split(' ').next().unwrap_or_default()).collect();
    assert_eq!(asked, ["flash", "monitor", "flash", "monitor"]);
    assert!(fake.asked[0].contains("--node anchor-1") && fake.asked[0].contains("--probe 1366:1015:1"));
    assert!(fake.asked[3].contains("--serial /dev/ttyACM0") && !fake.asked[3].contains("--reset"));
    let mute = verdict(1, &desk, vec![("flash", Ok(String::new())), ("monitor", Ok(String::new()))]);
    assert_eq!(mute, StepVerdict::Failed("board 1 says nothing: no hello in 3 s".to_owned()));
    let locked = verdict(1, &desk, vec![("flash", Err("cannot attach to the chip"))]);
    assert_eq!(locked, StepVerdict::Failed("cannot attach to the chip".to_owned()));
}

#[test]
fn a_record_must_be_read_back() {
    let desk = desk("record", 1);
    let read = |text: &str| verdict(2, &desk, vec![("provision --read", Ok(text.to_owned()))]);
    assert_eq!(read("{\"results\":[{\"role\":\"anchor\"}]}"), StepVerdict::Passed("1 records".to_owned()));
    assert!(matches!(read("{\"error\":{\"message\":\"empty\"}}"), StepVerdict::Failed(why) if why.contains("empty")));
}

#[test]
fn an_anchor_coordinates_in_time_and_its_radio_does_not_fail() {
    let desk = desk("first", 2);
    let first = |text: String| verdict(4, &desk, vec![("monitor", Ok(text))]);
    assert_eq!(first(state(0.41, "coordinating")), StepVerdict::Passed("coordinating after 0.41 s".to_owned()));
    assert!(matches!(first(state(0.9, "coordinating")), StepVerdict::Failed(why) if why.contains("not 0.6 s")));
    assert!(matches!(first(state(0.2, "radio-failed")), StepVerdict::Failed(why) if why.contains("wiring")));
    let second = verdict(6, &desk, vec![("monitor", Ok(state(0.8, "synchronised")))]);
    assert_eq!(second, StepVerdict::Passed("synchronised after 0.80 s".to_owned()));
}

#[test]
fn rate_and_late_starts_have_limits() {
    let desk = desk("speed", 2);
    let speed = |period_s| verdict(7, &desk, vec![("monitor", Ok(rounds(1000, period_s, 1000)))]);
    // One each 2.5 ms.
    assert_eq!(speed(0.0025), StepVerdict::Passed("400 rounds a second".to_owned()));
    assert!(matches!(speed(0.005), StepVerdict::Failed(why) if why.starts_with("200 rounds a second, not 350")));
    let late = |late: u32| {
        let counters = format!("{}{{\"type\":\"counters\",\"t_s\":9,\"late\":{late}}}\n", rounds(1000, 0.01, 1000));
        verdict(8, &desk, vec![("monitor", Ok(counters))])
    };
    assert_eq!(late(4), StepVerdict::Passed("0.40 % late".to_owned()));
    assert_eq!(late(20), StepVerdict::Failed("2.00 % of rounds late".to_owned()));
}

#[test]
fn ranges_at_five_metres_have_a_mean_and_a_deviation() {
    let desk = desk("ranges", 1);
    let ranges = |count: usize, mean: f64| {
        // Half of them 3 cm too long and half too short: a deviation of 3 cm.
        let range = |at: usize| mean + if at.is_multiple_of(2) { 0.03 } else { -0.03 };
        let lines = (0..count).map(|at| format!("{{\"type\":\"range\",\"t_s\":1,\"range_m\":{}}}\n", range(at)));
        verdict(9, &desk, vec![("monitor", Ok(lines.collect()))])
    };
    assert_eq!(ranges(1000, 5.1), StepVerdict::Passed("1000 ranges, mean 5.100 m, deviation 3.0 cm".to_owned()));
    assert!(matches!(ranges(1000, 5.4), StepVerdict::Failed(why) if why.contains("antenna delays")));
    assert!(matches!(ranges(10, 5.0), StepVerdict::Failed(why) if why.contains("fewer than 1000")));
}

#[test]
fn a_network_needs_its_anchors_and_whole_rounds() {
    let desk_of_four = desk("network", 4);
    let network = |short| verdict(10, &desk_of_four, vec![("monitor", Ok(rounds(1000, 0.0025, short)))]);
    // Every fiftieth round is short of an anchor: 98 %. Every tenth: 90 %.
    assert!(
        matches!(network(50), StepVerdict::Passed(figures) if figures.starts_with("all 4 anchors in 98.0 % of rounds"))
    );
    assert!(matches!(network(10), StepVerdict::Failed(why) if why.contains("90.0 %")));
    let left_out = verdict(10, &desk("small", 2), vec![]);
    assert_eq!(left_out, StepVerdict::LeftOut("4 anchors are needed, 2 are here".to_owned()));
}

#[test]
fn a_dry_run_lists_commands_and_a_report_has_a_row_a_step() {
    let desk = desk("plan", 1);
    let steps: Vec<&BenchStep> = STEPS.iter().collect();
    let plan = plan(&desk, &steps);
    assert!(plan.contains("- tag-1: Tag on esp32c3, at /dev/ttyACM0; 10 cm"), "{plan}");
    assert!(plan.contains("    baliza provision --read --json --board dwm1001 --probe 1366:1015:1\n"), "{plan}");
    assert!(plan.contains("left out: 4 anchors are needed, 1 are here"), "{plan}");
    let verdicts = go(&desk, &steps, &mut Fake::new(vec![]), |_| ());
    let report = report(&desk, &verdicts);
    assert_eq!(report.lines().filter(|line| line.starts_with("| ")).count(), 1 + STEPS.len());
    assert!(report.contains("FAILED: nobody answers flash"), "{report}");
}
