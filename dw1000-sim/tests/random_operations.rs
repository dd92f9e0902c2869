//! Whatever hosts do to their chips, nothing panics.

// Its `main` has no use here.
#[allow(dead_code)]
#[path = "../examples/random_operations.rs"]
mod random_operations;

#[test]
fn random_operations_never_panic() {
    let totals = random_operations::run(1_000_000, 1, |_, _| {});
    assert!(totals.operations >= 1_000_000);
    // They do something: frames leave and come through.
    assert!(totals.sent > 10_000 && totals.received > 1_000, "{totals:?}");
}
