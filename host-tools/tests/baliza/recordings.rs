//! Replays of recordings that are not part of the project. An independent implementation measured each error limit
//! before this project began.

use crate::support::replay;

#[test]
fn the_default_method_reaches_its_accuracy_on_recorded_ranges() {
    replay("solve", [0.095, 0.095, 0.087, 0.125], |_, _| {});
}
