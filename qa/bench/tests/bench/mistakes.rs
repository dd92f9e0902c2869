//! Drawn mistakes are named.

use crate::support::Folder;

#[test]
fn most_drawn_mistakes_are_named_and_sound_recordings_are_not() {
    let results = Folder::with(&[]).run("bench mistakes --recordings 1 --sound 6 --json").ok().json();
    let named = |mistake: &str| {
        results.as_array().expect("a list").iter().find(|row| row["mistake"] == mistake).expect("a row")["named"]
            .as_u64()
    };
    // 95 % of 36.
    assert!(named("all") >= Some(34), "{results}");
    assert_eq!(named("none"), Some(0), "{results}");
}
