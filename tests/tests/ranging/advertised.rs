//! Positions that tags advertise by Bluetooth arrive at scanners, and ranging does not suffer.

use std::collections::HashMap;

use sim::scenario::{Record, Scenario, Simulation, Summary, What};
use wire::config::PollContent;
use wire::telemetry::{Fix, Message};

const SECONDS: f64 = 60.0;
const TAGS: [u16; 2] = [0x1001, 0x1002];
const SCANNERS: [u16; 2] = [0x3001, 0x3002];

fn run(change: impl FnOnce(&mut Scenario)) -> (Vec<Record>, Summary) {
    let mut scenario = Scenario::parse(include_str!("../../../examples/advertised.toml")).expect("the example");
    scenario.seconds = SECONDS;
    change(&mut scenario);
    let mut simulation = Simulation::new(scenario);
    (simulation.run_until(SECONDS), simulation.summary())
}

/// The tags' fixes, by tag and round, and what each scanner told of them; with their times.
type Received = (HashMap<(u16, u16), (f64, Fix)>, HashMap<u16, HashMap<(u16, u16), (f64, Fix)>>);

fn received(records: Vec<Record>) -> Received {
    let (mut fixes, mut told): Received = Default::default();
    for record in records {
        match record.what {
            What::Epoch(epoch) if epoch.fix.position_m().is_some() => {
                fixes.insert((record.node, epoch.fix.round), (record.t_s, epoch.fix));
            }
            What::Message(Message::TagFix(of)) if SCANNERS.contains(&record.node) => {
                let fix = of.fix().expect("a position");
                let by = told.entry(record.node).or_default();
                assert!(by.insert((of.tag, fix.round), (record.t_s, fix)).is_none(), "told twice: {of:?}");
            }
            _ => {}
        }
    }
    (fixes, told)
}

#[test]
fn scanners_tell_the_positions_that_tags_advertise_as_soon_as_they_are_found() {
    for key in [None, Some([7; 16])] {
        let (records, summary) = run(|scenario| scenario.beacon_key = key);
        let (fixes, told) = received(records);
        for (scanner, tag) in SCANNERS.into_iter().flat_map(|scanner| TAGS.map(|tag| (scanner, tag))) {
            let of_tag = |of: &&(u16, u16)| of.0 == tag;
            let (found, count) = (fixes.keys().filter(of_tag).count(), told[&scanner].keys().filter(of_tag).count());
            // It listens to one of three channels all the time, and goes to the next within an advertisement now and then.
            assert!(count as f64 > 0.9 * found as f64, "{scanner:#x} of {tag:#x}: {count} of {found}");
        }
        for (of, (t_s, fix)) in told.values().flatten() {
            let (found_s, found) = fixes[of];
            // Three pauses, and three times 0.4 ms on the air.
            assert!((0.0..0.005).contains(&(t_s - found_s)), "{of:?}: {found_s} s, {t_s} s");
            let ([x, y, _], [of_x, of_y, _]) = (fix.position_m().unwrap(), found.position_m().unwrap());
            assert!((x - of_x).abs() <= 0.0006 && (y - of_y).abs() <= 0.0006, "{fix:?} {found:?}");
        }
        // Anchors have no host here: these came by Bluetooth. In the simulation both scanners change channels at the same times.
        assert!(summary.uplink_share > Some(0.96) && summary.uplink_p99_s < Some(0.005), "{summary:?}");
    }
}

#[test]
fn a_tag_that_advertises_is_hardly_slower() {
    let rounds = |advertises: bool| {
        let (records, _) = run(|scenario| {
            scenario.tags.truncate(1);
            scenario.change_tags(|tag| {
                tag.rate_chz = None;
                tag.tells = if advertises { PollContent::Advertised } else { PollContent::Position };
            });
        });
        records.iter().filter(|record| matches!(record.what, What::Epoch(_))).count() as f64
    };
    let (silent, advertising) = (rounds(false), rounds(true));
    // Twenty times a second three channels of some 20 µs and a code of 60: 0.2 % of the processor, mostly in the background.
    assert!(advertising > 0.99 * silent, "{advertising} of {silent} rounds");
}

#[test]
fn advertising_once_a_second_draws_nine_microamperes() {
    for scanners in [2, 0] {
        let (_, summary) = run(|scenario| {
            scenario.tags.retain(|tag| tag.settings.record.sleep);
            scenario.scanners.truncate(scanners);
        });
        let currents = summary.tag_currents_ma.expect("they are simulated");
        // By hand: 3 · 0.516 ms · 5.3 mA = 8.2 µC and 0.75 µC for the crystal.
        assert!((0.0085..0.0095).contains(&currents.advertising), "{scanners} scanners: {currents:?}");
    }
}
