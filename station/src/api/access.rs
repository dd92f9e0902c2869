//! Who may do what: a request to the person or program that makes it, and a refusal where it may not.
//!
//! A session begins with a token (`health`) or with a sign-in at a provider (`sign_in`).
//!
//! The least role of a route stands in its description (`security`), and is read from the document: what is described
//! is what is enforced. A route without any is refused.

use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use axum::http::{HeaderMap, Method, StatusCode, Uri, header};
use url::Url;

use super::problem::Problem;
pub use crate::model::UserRole;
use crate::net::limits::{Buckets, RequestLimits};
use crate::net::{is_loopback, lock, make_room, same, sha256};

/// Who may use the station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Access {
    /// Everyone who reaches it, which must be by a loopback address.
    Open,
    /// Who has one of these tokens, or has signed in at the provider, where there is one.
    Tokens(Vec<Token>),
}

/// A secret that gives someone a role. Only its hash is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Token {
    /// Who has it, for the log.
    pub name: String,
    /// What it allows.
    pub role: UserRole,
    /// SHA-256 of the secret.
    pub sha256: [u8; 32],
}

impl Token {
    /// A token of this secret.
    pub fn new(name: impl Into<String>, role: UserRole, secret: &str) -> Self {
        Self { name: name.into(), role, sha256: sha256(secret) }
    }
}

/// The person or program that makes a request.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Principal {
    /// The token's name, or `oidc:` and the name that the provider tells; None: no tokens are asked for.
    pub name: Option<String>,
    /// What they may do.
    pub role: UserRole,
    /// Until when, at most; None: no end is known.
    pub until: Option<Instant>,
}

/// The least role that a route asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequiredRole {
    /// Nothing: who asks is not looked at.
    Nothing,
    /// Nothing, but the route wants to know who asks.
    Known,
    /// At least this role.
    Role(UserRole),
}

/// The name of the session's cookie.
const COOKIE: &str = "baliza_session";
/// A session that is not used for this time ends; one of a sign-in, at a fixed time as well.
const SESSION: Duration = Duration::from_secs(12 * 3600);
/// Sessions at once. One more replaces the one that was used longest ago.
const SESSIONS: usize = 1_000;

/// Decides who may do what: sessions, and the rates of those who try.
#[derive(Debug)]
pub struct AccessControl {
    access: Access,
    /// Cookies are only for encrypted connections.
    secure: bool,
    /// By SHA-256 of the cookie's value.
    sessions: Mutex<HashMap<[u8; 32], Session>>,
    wrong_tokens: Buckets,
    sign_ins: Buckets,
    writes: Buckets,
}

#[derive(Debug)]
struct Session {
    who: Principal,
    used: Instant,
    /// Where a browser ends the session of the provider of sign-ins.
    end_session: Option<Url>,
}

impl Session {
    fn is_over(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.used) >= SESSION || self.who.until.is_some_and(|end| now >= end)
    }
}

impl AccessControl {
    /// The access state without sessions.
    pub fn new(access: Access, secure: bool, limits: &RequestLimits) -> Self {
        Self {
            access,
            secure,
            sessions: Mutex::default(),
            wrong_tokens: Buckets::new(limits.wrong_tokens_per_s, limits.wrong_tokens_at_once),
            sign_ins: Buckets::new(limits.sign_ins_per_s, limits.sign_ins_at_once),
            writes: Buckets::new(limits.writes_per_s, limits.writes_at_once),
        }
    }

    /// Whether tokens are asked for.
    pub fn asks_for_tokens(&self) -> bool {
        match self.access {
            Access::Open => false,
            Access::Tokens(_) => true,
        }
    }

    /// Whether a request may have reached this host by a name or from a page of someone else.
    ///
    /// Without tokens, a page of another site could rebind its name to the loopback address (DNS rebinding): the host
    /// that the browser means must be a loopback one. A page of another site can also send some requests without being
    /// able to read the answer, and can open WebSockets: the origin must be this host.
    pub fn check_origin(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Result<(), Problem> {
        let host = headers.get(header::HOST).and_then(|host| host.to_str().ok());
        if !self.asks_for_tokens() {
            let other = uri.authority().is_some_and(|authority| !is_loopback(authority.as_str()));
            if other || !host.is_some_and(is_loopback) {
                let detail = "without tokens, the station answers to localhost and to loopback addresses only";
                return Err(Problem::new(StatusCode::MISDIRECTED_REQUEST, detail));
            }
        }
        if method.is_safe() && !headers.contains_key(header::UPGRADE) {
            return Ok(());
        }
        match headers.get(header::ORIGIN).map(|origin| origin.to_str().ok().and_then(authority_of_origin)) {
            // Not a browser: only browsers send cookies without being asked.
            None if headers.contains_key(header::AUTHORIZATION) || cookie(headers, COOKIE).is_none() => Ok(()),
            Some(Some(origin)) if host.is_some_and(|host| host.eq_ignore_ascii_case(origin)) => Ok(()),
            _ => Err(Problem::new(StatusCode::FORBIDDEN, "the request comes from a page of another host")),
        }
    }

    /// Who makes a request; None: nobody says so.
    pub fn who(&self, headers: &HeaderMap, client: IpAddr) -> Result<Option<Principal>, Problem> {
        if !self.asks_for_tokens() {
            return Ok(Some(Principal { name: None, role: UserRole::Administer, until: None }));
        }
        if let Some(given) = headers.get(header::AUTHORIZATION) {
            let given = given.to_str().ok().and_then(|given| given.split_once(' '));
            let secret = given.filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"));
            return self.who_has(secret.map_or("", |(_, secret)| secret.trim()), client).map(Some);
        }
        let Some(id) = cookie(headers, COOKIE) else { return Ok(None) };
        let mut sessions = lock(&self.sessions);
        let (id, now) = (sha256(id), Instant::now());
        match sessions.get_mut(&id) {
            Some(session) if !session.is_over(now) => {
                session.used = now;
                Ok(Some(session.who.clone()))
            }
            Some(_) => {
                sessions.remove(&id);
                Ok(None)
            }
            None => Ok(None),
        }
    }

    /// Who has this secret. An address that tries too many wrong ones must wait.
    pub fn who_has(&self, secret: &str, client: IpAddr) -> Result<Principal, Problem> {
        let too_many = |wait_s| Problem::too_many("wrong tokens", wait_s);
        self.wrong_tokens.check(client, Instant::now()).map_err(too_many)?;
        let Access::Tokens(tokens) = &self.access else {
            return Ok(Principal { name: None, role: UserRole::Administer, until: None });
        };
        let hash = sha256(secret);
        // All are compared, each in full: the time tells nothing.
        let found =
            tokens.iter().fold(None, |found, token| if same(&token.sha256, &hash) { Some(token) } else { found });
        match found {
            Some(token) => Ok(Principal { name: Some(token.name.clone()), role: token.role, until: None }),
            None => {
                log::warn!(target: "audit", "{client} a wrong token");
                self.wrong(client)?;
                Err(Problem::new(StatusCode::UNAUTHORIZED, "the token is wrong"))
            }
        }
    }

    /// Counts a wrong token, or an end of a sign-in that nobody has begun.
    pub fn wrong(&self, client: IpAddr) -> Result<(), Problem> {
        self.wrong_tokens.take(client, Instant::now()).map_err(|wait_s| Problem::too_many("wrong tokens", wait_s))
    }

    /// Whether this address may begin a further sign-in.
    pub fn check_sign_in(&self, client: IpAddr) -> Result<(), Problem> {
        self.sign_ins.take(client, Instant::now()).map_err(|wait_s| Problem::too_many("sign-ins", wait_s))
    }

    /// Whether this address may make a further request that changes something.
    pub fn check_rate(&self, client: IpAddr) -> Result<(), Problem> {
        self.writes.take(client, Instant::now()).map_err(|wait_s| Problem::too_many("requests", wait_s))
    }

    /// Begins a session; the value of its `Set-Cookie`. At its end, a browser goes to `end_session`, if that is known.
    pub fn log_in(&self, who: Principal, end_session: Option<Url>) -> Result<String, Problem> {
        let mut random = [0; 32];
        getrandom::fill(&mut random).map_err(|error| {
            log::error!("no random numbers: {error}");
            Problem::new(StatusCode::SERVICE_UNAVAILABLE, "the host has no random numbers")
        })?;
        let id: String = random.iter().map(|byte| format!("{byte:02x}")).collect();
        let (mut sessions, now) = (lock(&self.sessions), Instant::now());
        sessions.retain(|_, session| !session.is_over(now));
        make_room(&mut sessions, SESSIONS, |session| session.used);
        let age = who.until.map_or(SESSION, |until| until.saturating_duration_since(now));
        sessions.insert(sha256(&id), Session { who, used: now, end_session });
        Ok(self.set_cookie(&id, age))
    }

    /// Ends a request's session; the value of `Set-Cookie` that deletes the cookie, and where a browser ends the
    /// session of the provider of sign-ins.
    pub fn log_out(&self, headers: &HeaderMap) -> (String, Option<Url>) {
        let session = cookie(headers, COOKIE).and_then(|id| lock(&self.sessions).remove(&sha256(id)));
        (self.set_cookie("", Duration::ZERO), session.and_then(|session| session.end_session))
    }

    /// The end of a cookie's attributes, where it is only for encrypted connections.
    pub fn secure(&self) -> &'static str {
        if self.secure { "; Secure" } else { "" }
    }

    fn set_cookie(&self, id: &str, age: Duration) -> String {
        let secure = self.secure();
        format!("{COOKIE}={id}; Path=/; Max-Age={}; HttpOnly; SameSite=Strict{secure}", age.as_secs())
    }
}

/// The address at the other end of a connection.
#[derive(Clone, Copy, Debug)]
pub struct Peer(pub SocketAddr);

/// The address that makes a request, behind trusted proxies.
#[derive(Clone, Copy, Debug)]
pub struct Client(pub IpAddr);

/// A cookie's value.
pub fn cookie<'a>(headers: &'a HeaderMap, wanted: &str) -> Option<&'a str> {
    let values = headers.get_all(header::COOKIE).iter().filter_map(|value| value.to_str().ok());
    let mut pairs = values.flat_map(|value| value.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find(|(name, _)| *name == wanted).map(|(_, value)| value)
}

fn authority_of_origin(origin: &str) -> Option<&str> {
    origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_further_session_replaces_the_one_that_was_used_longest_ago() {
        let gate = AccessControl::new(Access::Tokens(Vec::new()), true, &RequestLimits::default());
        let who = Principal { name: Some("ana".into()), role: UserRole::View, until: None };
        let cookies: Vec<String> = (0..=SESSIONS).map(|_| gate.log_in(who.clone(), None).unwrap()).collect();
        assert!(cookies[0].ends_with("; HttpOnly; SameSite=Strict; Secure"));
        assert_eq!(known(&gate, &cookies[0]), None);
        assert_eq!([known(&gate, &cookies[1]), known(&gate, &cookies[SESSIONS])], [Some(who.clone()), Some(who)]);
    }

    fn known(gate: &AccessControl, cookie: &str) -> Option<Principal> {
        let mut headers = HeaderMap::new();
        headers.insert(header::COOKIE, cookie.split(';').next().unwrap().parse().unwrap());
        gate.who(&headers, IpAddr::from([192, 0, 2, 1])).unwrap()
    }

    #[test]
    fn a_session_with_a_lifetime_ends_even_if_it_is_used() {
        let gate = AccessControl::new(Access::Tokens(Vec::new()), false, &RequestLimits::default());
        let [short, long] = [Duration::from_secs(2), Duration::from_millis(3_600_900)].map(|lifetime| {
            let until = Some(Instant::now() + lifetime);
            Principal { name: Some("oidc:ana".into()), role: UserRole::View, until }
        });
        let [cookie, lasting] = [&short, &long].map(|who| gate.log_in(who.clone(), None).unwrap());
        assert!(lasting.contains("; Max-Age=3600; HttpOnly; SameSite=Strict"));
        assert_eq!(known(&gate, &cookie), Some(short));
        std::thread::sleep(Duration::from_millis(2_010));
        assert_eq!([known(&gate, &cookie), known(&gate, &lasting)], [None, Some(long)]);
    }
}
