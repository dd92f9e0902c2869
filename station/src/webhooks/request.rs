//! An event to a request, and its answer.
//!
//! The headers are those of Standard Webhooks: `webhook-id` is the same for each try of an event and no other event,
//! `webhook-timestamp` is the time of the try in seconds since 1970, and `webhook-signature` is `v1,` and the Base64 of
//! the HMAC-SHA256 of `id.timestamp.body`.

use std::fmt;
use std::time::Duration;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use hmac::{Hmac, KeyInit, Mac};
use http_body_util::{BodyExt, Full, Limited};
use hyper::body::Bytes;
use hyper::header::{CONTENT_TYPE, HeaderValue, RETRY_AFTER, USER_AGENT};
use hyper::{StatusCode, Uri};
use sha2::Sha256;

use super::WebhookSettings;
use crate::Utc;
use crate::model::StationEvent;
use crate::net::client::{Client, ClientError, client, last_cause};

/// An answer of at most this many bytes is read to its end, so that its connection can be used again …
const ANSWER: usize = 64 * 1024;
/// … within this time.
const ANSWER_TIME: Duration = Duration::from_secs(1);
/// The bytes of a secret.
const SECRET: std::ops::RangeInclusive<usize> = 24..=64;

/// The settings of a hook cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum WebhookError {
    /// The address is none.
    #[error("url: {0}; it is an address such as https://example.org/events")]
    Url(&'static str),
    /// The secret is none.
    #[error(
        "secret: it is whsec_ and the Base64 of 24 to 64 bytes, as `echo whsec_$(openssl rand -base64 32)` prints it"
    )]
    Secret,
    /// No server's certificate could be checked.
    #[error(transparent)]
    Client(ClientError),
}

/// An event did not arrive.
#[derive(Debug)]
pub(super) enum Failure {
    /// There is no connection, or it was lost.
    Connection(hyper_util::client::legacy::Error),
    /// There was no answer in this time.
    Slow(Duration),
    /// The answer is no success, and perhaps says when to try again.
    Status(StatusCode, Option<Duration>),
}

impl Failure {
    /// How long the receiver asks to wait.
    pub fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::Status(_, after) => *after,
            Self::Connection(_) | Self::Slow(_) => None,
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connection(error) => write!(f, "no connection: {}", last_cause(error)),
            Self::Slow(time) => write!(f, "no answer within {} s", time.as_secs_f64()),
            Self::Status(status, _) if status.is_redirection() => {
                write!(f, "it answers {status}: redirects are not followed, url must be the last address")
            }
            Self::Status(status, _) => write!(f, "it answers {status}"),
        }
    }
}

/// Makes the requests of a hook.
#[derive(Clone)]
pub(super) struct Requests {
    client: Client,
    uri: Uri,
    secret: Option<Vec<u8>>,
}

impl fmt::Debug for Requests {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Requests").finish_non_exhaustive()
    }
}

impl Requests {
    pub fn new(settings: &WebhookSettings) -> Result<Self, WebhookError> {
        let uri = address(&settings.url).map_err(WebhookError::Url)?;
        let secret = match &settings.secret {
            Some(secret) => Some(bytes_of(secret).ok_or(WebhookError::Secret)?),
            None => None,
        };
        let is_https = uri.scheme_str() == Some("https");
        let client = client(is_https, settings.ca.as_deref()).map_err(WebhookError::Client)?;
        Ok(Self { client, uri, secret })
    }

    /// Sends an event at this time.
    pub async fn send(&self, event: &StationEvent, now: Utc) -> Result<(), Failure> {
        let answer = self.client.request(self.request(event, now)).await.map_err(Failure::Connection)?;
        let status = answer.status();
        let after = answer.headers().get(RETRY_AFTER).and_then(|after| after.to_str().ok()?.trim().parse().ok());
        let rest = Limited::new(answer.into_body(), ANSWER).collect();
        // The status counts, whatever the rest is.
        let _ = tokio::time::timeout(ANSWER_TIME, rest).await;
        if status.is_success() { Ok(()) } else { Err(Failure::Status(status, after.map(Duration::from_secs))) }
    }

    fn request(&self, event: &StationEvent, now: Utc) -> hyper::Request<Full<Bytes>> {
        // The fields of an event are texts and numbers: they can be written.
        let body = serde_json::to_vec(event).unwrap_or_default();
        // Numbers begin again with a new store; times do not.
        let id = format!("{}-{}", event.id, event.t.us());
        let timestamp = now.us() / 1_000_000;
        let mut headers = vec![
            ("webhook-id", HeaderValue::try_from(id.clone())),
            ("webhook-timestamp", Ok(HeaderValue::from(timestamp))),
        ];
        if let Some(secret) = &self.secret {
            headers.push(("webhook-signature", HeaderValue::try_from(signature(secret, &id, timestamp, &body))));
        }
        let mut request = hyper::Request::new(Full::from(body));
        *request.method_mut() = hyper::Method::POST;
        *request.uri_mut() = self.uri.clone();
        let all = request.headers_mut();
        all.insert(CONTENT_TYPE, HeaderValue::from_static("application/json"));
        all.insert(USER_AGENT, HeaderValue::from_static(concat!("baliza/", env!("CARGO_PKG_VERSION"))));
        // Digits, hyphens and Base64 are values of headers.
        all.extend(
            headers
                .into_iter()
                .filter_map(|(name, value)| Some((hyper::header::HeaderName::from_static(name), value.ok()?))),
        );
        request
    }
}

/// The address of a hook.
fn address(text: &str) -> Result<Uri, &'static str> {
    let uri: Uri = text.parse().map_err(|_| "it is no address")?;
    if !matches!(uri.scheme_str(), Some("http" | "https")) {
        return Err("it must begin with http:// or https://");
    }
    match uri.authority() {
        Some(authority) if authority.as_str().contains('@') => Err("user and password are not sent: use secret"),
        Some(authority) if !authority.host().is_empty() => Ok(uri),
        Some(_) | None => Err("the host is missing"),
    }
}

/// The bytes of a secret.
fn bytes_of(secret: &str) -> Option<Vec<u8>> {
    let bytes = STANDARD.decode(secret.strip_prefix("whsec_")?).ok()?;
    SECRET.contains(&bytes.len()).then_some(bytes)
}

fn signature(secret: &[u8], id: &str, timestamp: i64, body: &[u8]) -> String {
    let signed = [format!("{id}.{timestamp}.").as_bytes(), body].concat();
    // A key of HMAC may have any length: there is no error.
    let code = Hmac::<Sha256>::new_from_slice(secret).map(|code| code.chain_update(signed).finalize().into_bytes());
    code.map(|code| format!("v1,{}", STANDARD.encode(code))).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The secret of the test of the reference library of Standard Webhooks.
    const REFERENCE: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

    #[test]
    fn a_signature_is_that_of_the_reference_library() {
        let secret = bytes_of(REFERENCE).unwrap();
        let signed = signature(&secret, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1_614_265_330, br#"{"test": 2432232314}"#);
        assert_eq!(signed, "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=");
    }

    #[test]
    fn addresses_and_secrets_that_cannot_be_used_are_refused() {
        for text in ["", "example.org/events", "ftp://example.org", "https://", "http://me:secret@example.org", "a b"] {
            assert!(address(text).is_err(), "{text}");
        }
        for text in ["http://homeassistant.local:8123/api/webhook/x", "https://[::1]/?a=b"] {
            assert!(address(text).is_ok(), "{text}");
        }
        // 18 bytes are too few; there is no prefix; that is no Base64.
        for text in ["whsec_MfKQ9r8GKYqrTwjUPD8ILPZI", &REFERENCE[6..], "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaS!"] {
            assert!(bytes_of(text).is_none(), "{text}");
        }
    }
}
