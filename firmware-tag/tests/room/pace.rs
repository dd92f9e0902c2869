//! A tag that lies still ranges seldom, and ranges often again as soon as it is carried on.

use small_air::room;
use wire::config::{Role, Solver, Tag};
use wire::telemetry::Message;

use super::live;

#[test]
fn a_tag_at_rest_goes_to_its_still_rate_and_back_when_it_is_carried_on() {
    let mut record = room::record(Solver::Track);
    let Role::Tag(tag) = record.role else { panic!("the room's record is a tag's") };
    record.role = Role::Tag(Tag { still_rate_chz: Some(200), report_ranges: false, ..tag });
    let (told, _) = live(record, 15_000_000, room::lazy_tag);
    let rounds_s: Vec<f64> = told
        .iter()
        .filter_map(|message| if let Message::Fix(fix) = message { Some(fix.t_us as f64 / 1e6) } else { None })
        .collect();
    let rounds = |from: f64, to: f64| rounds_s.iter().filter(|t_s| (from..to).contains(*t_s)).count();
    // Twenty rounds a second. Five seconds later, and half a second for the grant of other slots, two rounds a second.
    assert!((38..=42).contains(&rounds(2.0, 4.0)), "{}", rounds(2.0, 4.0));
    assert!((5..=9).contains(&rounds(7.0, 10.0)), "{}", rounds(7.0, 10.0));
    // The first round after ten seconds comes within half a second. At 0.8 m/s it finds the tag two standard deviations
    // (0.3 m) away, or the next round does. A request for slots takes three superframes to the coordinator and back,
    // perhaps one more, and its grant is valid four superframes later: 12.3 s at the latest.
    assert!((54..=63).contains(&rounds(12.0, 15.0)), "{}", rounds(12.0, 15.0));
}
