//! Connections: what the API, sign-ins, webhooks and MQTT need of them, and nothing of the station's own matters.
//!
//! | module | what is in it |
//! |---|---|
//! | `client` | requests that the station makes itself |
//! | `limits` | what one client may use: rates and connections |
//! | `loopback` | whether a host is this computer |
//! | `proxies` | the address of a client behind a reverse proxy |
//! | `secrets` | hashes of secrets, and their comparison |
//! | `tls` | certificates and encrypted connections |
//! | `write_timeout` | a connection whose writes must go on |

pub(crate) mod client;
pub(crate) mod limits;
mod loopback;
pub(crate) mod proxies;
mod secrets;
pub(crate) mod tls;
pub(crate) mod write_timeout;

use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

pub use loopback::is_loopback_name;

pub(crate) use loopback::is_loopback;
pub(crate) use secrets::{same, sha256};

/// Removes the oldest entry of a map that has this many. One more can then be inserted.
pub fn make_room<K: Copy + Eq + Hash, V>(map: &mut HashMap<K, V>, most: usize, at: impl Fn(&V) -> Instant) {
    if map.len() >= most {
        let oldest = map.iter().min_by_key(|(_, value)| at(value)).map(|(key, _)| *key);
        oldest.and_then(|oldest| map.remove(&oldest));
    }
}

/// Locks; a panic of another holder does not matter, because each change of these maps is one step.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
