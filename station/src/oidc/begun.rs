//! Sign-ins that are begun and not finished: each state once, for some time, and not more of them than a bound.

use std::collections::HashMap;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use openidconnect::Nonce;

use crate::net::{lock, make_room, sha256};

/// Sign-ins at once. One more replaces the one that was begun first.
const MOST: usize = 1_000;

/// What a sign-in must be finished with.
#[derive(Debug)]
pub struct SignIn {
    /// Is in the ID token.
    pub(super) nonce: Nonce,
    /// The secret of PKCE.
    pub(super) verifier: String,
}

/// The sign-ins, by SHA-256 of their states.
#[derive(Debug)]
pub(super) struct Begun {
    limit: Duration,
    sign_ins: Mutex<HashMap<[u8; 32], (SignIn, Instant)>>,
}

impl Begun {
    /// A list without sign-ins; each may take this time.
    pub fn new(limit: Duration) -> Self {
        Self { limit, sign_ins: Mutex::default() }
    }

    pub fn add(&self, state: &str, sign_in: SignIn, now: Instant) {
        let mut sign_ins = lock(&self.sign_ins);
        sign_ins.retain(|_, (_, at)| now.saturating_duration_since(*at) < self.limit);
        make_room(&mut sign_ins, MOST, |(_, at)| *at);
        sign_ins.insert(sha256(state), (sign_in, now));
    }

    /// The sign-in of a state, which is finished by that.
    pub fn take(&self, state: &str, now: Instant) -> Option<SignIn> {
        let (sign_in, at) = lock(&self.sign_ins).remove(&sha256(state))?;
        (now.saturating_duration_since(at) < self.limit).then_some(sign_in)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sign_in() -> SignIn {
        SignIn { nonce: Nonce::new("n".to_owned()), verifier: "v".to_owned() }
    }

    #[test]
    fn a_state_can_be_used_once_and_not_after_its_time() {
        let begun = Begun::new(Duration::from_secs(600));
        let start = Instant::now();
        begun.add("one", sign_in(), start);
        begun.add("late", sign_in(), start);
        assert!(begun.take("other", start).is_none());
        assert!(begun.take("one", start + Duration::from_secs(599)).is_some());
        assert!(begun.take("one", start + Duration::from_secs(599)).is_none());
        assert!(begun.take("late", start + Duration::from_secs(600)).is_none());
    }

    #[test]
    fn a_flood_of_sign_ins_does_not_fill_the_memory_and_replaces_the_oldest() {
        let begun = Begun::new(Duration::from_secs(600));
        let start = Instant::now();
        for number in 0..3_000u32 {
            begun.add(&number.to_string(), sign_in(), start + Duration::from_millis(number.into()));
        }
        let now = start + Duration::from_secs(3);
        assert_eq!(lock(&begun.sign_ins).len(), MOST);
        // 2,000 of 3,000 were replaced.
        assert!(begun.take("1999", now).is_none());
        assert!(begun.take("2000", now).is_some());
    }
}
