//! Runs `baliza bench` as a user does.

mod accuracy;
mod figures;
mod mistakes;
#[allow(dead_code)]
#[path = "../../../../host-tools/tests/baliza/schema_check.rs"]
mod schema_check;
mod seeds;
#[allow(dead_code)]
#[path = "../../../../host-tools/tests/baliza/support.rs"]
mod support;
mod thesis;

/// The program. It has the commands of `baliza`, too.
const PROGRAM: &str = env!("CARGO_BIN_EXE_baliza-bench");
