//! The promises of the repository have their places, and a changed constant of the filter is noticed.

use std::path::Path;

use anyhow::{Context, Result};
use positioning_core::engine;
use serde_json::{Value, json};
use sim::scenario::{Inspection, Scenario, Simulation};

use super::*;

#[test]
fn every_promise_has_its_place_and_its_way() {
    let promises = Promises::read().expect("promises.toml");
    let read = |path: &Path| fs::read_to_string(root().join(path)).expect("a document");
    // Tables that are only printed, and whole pages.
    let unmarked = |name: &str| extract::of(name, "").is_none() || name == "tour" || name == "chip";
    for table in &promises.tables {
        let page = read(promises.path(&table.document).expect("in [documents]"));
        let missing = document::table(&page, &table.name).is_err() && !unmarked(&table.name);
        assert!(!missing, "{} has no place for {}", table.document, table.name);
        if let TableWay::Code(name) = &table.way {
            assert!(ways::is_there(name), "{} is made by {name}, which is not there", table.name);
        }
    }
    for figure in &promises.figures {
        let (Some(document), Some(sentence)) = (&figure.document, &figure.sentence) else { continue };
        let page = read(promises.path(document).expect("in [documents]"));
        sentences::find(&page, sentence).unwrap_or_else(|error| panic!("{document} {error}"));
    }
}

#[test]
fn quick_promises_take_two_minutes_at_most() {
    let promises = Promises::read().expect("promises.toml");
    let tables = promises.tables.iter().filter(|table| table.quick).map(|table| table.seconds);
    let figures = promises.figures.iter().filter(|figure| figure.quick).map(|figure| figure.seconds);
    assert!(tables.chain(figures).sum::<u32>() <= 120);
}

#[test]
fn the_list_of_checks_is_that_of_ci() {
    let promises = Promises::read().expect("promises.toml");
    let table = promises.tables.iter().find(|table| table.name == "checks").expect("a promise");
    let book = Book {
        promises: &promises,
        files: Files::of_repository(),
        runner: &BuiltBaliza,
        quick: true,
        keeps_speed: false,
    };
    assert_eq!(book.check(&Promise::Tables(table)).expect("a list"), []);
}

/// `baliza simulate --tags N --anchors N --seconds S` in this process, with other settings of the tags' engines.
struct InProcess {
    tune: fn(&mut engine::Settings<f32>),
}

impl Runner for InProcess {
    fn results(&self, arguments: &str) -> Result<Vec<Value>> {
        let words: Vec<&str> = arguments.split(' ').collect();
        let value = |flag: &str| -> Result<f64> {
            let at = words.iter().position(|word| *word == flag).with_context(|| format!("no {flag}"))?;
            Ok(words[at + 1].parse()?)
        };
        let mut scenario = Scenario::rooms(value("--anchors")? as usize, value("--tags")? as usize);
        scenario.seconds = value("--seconds")?;
        let seconds = scenario.seconds;
        let mut simulation = Simulation::inspected(scenario, &Inspection::tuned(self.tune));
        simulation.run_until(seconds);
        let summary = simulation.summary();
        let (rate, p50, nees) = (summary.fixes_per_s, summary.p50_m, summary.nees);
        Ok(vec![json!({ "fixes_per_s": rate, "p50_m": p50, "nees": nees })])
    }
}

const FILE_OF_TEST: &str = "figure = [{ name = \"alone\", run = \"simulate --tags 1 --anchors 6 --seconds 4\", \
     document = \"page\", sentence = \"with a NEES of {nees:2}\", seconds = 1 }]\n\
     [documents]\npage = \"page.md\"\n\
     [[table]]\nname = \"room\"\ndocument = \"page\"\nseconds = 1\nfirst = \"case\"\n\
     columns = [{ title = \"rate\", cell = \"{fixes_per_s:0}\" }, { title = \"P50\", cell = \"{p50_m:4}\" }, \
     { title = \"NEES\", cell = \"{nees:3}\" }]\n\
     rows = [{ title = \"four\", run = \"simulate --tags 1 --anchors 4 --seconds 4\" }]\n\
     [[reach]]\ntable = \"room\"\nrow = \"four\"\ncolumn = \"rate\"\nat_least = 100\n";
const PAGE: &str = "A room\n\n<!-- made: room -->\n<!-- end: room -->\n\nSix anchors, with a\nNEES of 0.00 in all.\n";

/// The lines of all failures of the file above.
fn failures(book: &Book) -> Vec<String> {
    let Promises { tables, figures, .. } = book.promises;
    let all = tables.iter().map(Promise::Tables).chain(figures.iter().map(Promise::Figure));
    all.flat_map(|promise| book.check(&promise).expect("a run")).map(|failure| failure.to_string()).collect()
}

#[test]
fn a_tenth_more_noise_in_the_filter_breaks_promises() {
    let promises = Promises::parse(FILE_OF_TEST).expect("a file");
    let mut files = Files::default();
    files.write(Path::new("page.md"), PAGE).expect("a page");
    let as_it_is = InProcess { tune: |_| () };
    let mut book = Book { promises: &promises, files, runner: &as_it_is, quick: true, keeps_speed: false };
    assert!(!failures(&book).is_empty(), "an empty page holds");
    assert_eq!(book.remake(&Promise::Tables(&promises.tables[0])).expect("a run"), []);
    assert_eq!(book.remake(&Promise::Figure(&promises.figures[0])).expect("a run"), []);
    assert_eq!(failures(&book), Vec::<String>::new());
    // The deviation that the filter expects of a direct link's error.
    let noisier = InProcess { tune: |settings| settings.filter.noise.direct_sigma *= 1.1 };
    let lines = failures(&Book { runner: &noisier, ..book });
    assert!(lines.iter().any(|line| line.starts_with("page.md, room, four, NEES: promised ")), "{lines:#?}");
    assert!(lines.iter().any(|line| line.starts_with("page.md, alone: promised ")), "{lines:#?}");
    assert!(lines.iter().all(|line| line.contains("cargo xtask promises ")), "{lines:#?}");
}

#[test]
fn a_missed_reach_is_a_failure_even_where_the_page_says_so() {
    let promises = Promises::parse(&FILE_OF_TEST.replace("at_least = 100", "at_least = 2000")).expect("a file");
    let mut files = Files::default();
    files.write(Path::new("page.md"), PAGE).expect("a page");
    let mut book =
        Book { promises: &promises, files, runner: &InProcess { tune: |_| () }, quick: true, keeps_speed: false };
    let missed = book.remake(&Promise::Tables(&promises.tables[0])).expect("a run");
    let [line] = &missed.iter().map(ToString::to_string).collect::<Vec<_>>()[..] else { panic!("{missed:?}") };
    assert!(line.starts_with("room, four, rate: measured ") && line.contains("must be at least 2000"), "{line}");
    let missed = book.check(&Promise::Tables(&promises.tables[0])).expect("a run");
    assert_eq!(missed.iter().map(ToString::to_string).collect::<Vec<_>>(), std::slice::from_ref(line));
}
