//! The names of nodes in files. A node that is called by its short address may be `0x0102` in one file and `258` in
//! another.

use std::borrow::Cow;

use wire::telemetry::Address;

/// The name by which a node is compared: short addresses are spelled alike, other names are as they are.
pub fn spelled(name: &str) -> Cow<'_, str> {
    name.parse::<Address>().map_or(Cow::Borrowed(name), |address| Cow::Owned(address.to_string()))
}
