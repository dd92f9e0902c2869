//! Sign-in by OpenID Connect: a person who is known to a provider gets a role.
//!
//! This is the authorization code flow with PKCE (OpenID Connect Core 1.0, section 3.1; RFC 7636). [`Oidc::begin`]
//! gives the address at the provider to which the browser goes. The provider sends the browser back with a code, from
//! which [`Oidc::finish`] gets an ID token, and from that the [`User`]. The token must be signed by a key of the
//! provider, and be of this issuer, for this client, for this sign-in (nonce), and not expired.
//!
//! | module | what is in it |
//! |---|---|
//! | `settings` | what a person configures |
//! | `begun` | sign-ins that are begun and not finished |
//! | `user` | claims to name and role |
//!
//! What the provider says of itself (addresses, keys) is read when the station starts, then each hour, and when a
//! token is signed by a key that is not known. A provider that is away is tried again; nothing else waits for it.

mod begun;
mod settings;
mod user;

use std::error::Error;
use std::fmt;
use std::sync::Arc;
use std::time::{Duration, Instant};

use http_body_util::{BodyExt, Full, Limited};
use hyper::header::{HeaderValue, USER_AGENT};
use openidconnect::core::{
    CoreAuthenticationFlow, CoreClient, CoreClientAuthMethod, CoreErrorResponseType, CoreGenderClaim, CoreIdToken,
    CoreJwsSigningAlgorithm,
};
use openidconnect::{
    AccessToken, AuthType, AuthorizationCode, ClaimsVerificationError, ClientId, ClientSecret, CsrfToken,
    EndpointMaybeSet, EndpointNotSet, EndpointSet, HttpRequest, HttpResponse, IssuerUrl, LogoutRequest, Nonce,
    OAuth2TokenResponse, PkceCodeChallenge, PkceCodeVerifier, PostLogoutRedirectUrl, ProviderMetadataWithLogout,
    RedirectUrl, RequestTokenError, Scope, SubjectIdentifier, TokenResponse,
};
use tokio::sync::Mutex;
use tokio::time::timeout;
use url::Url;

use self::begun::{Begun, SignIn};
pub use self::settings::{OidcError, OidcSettings, Patience};
use self::user::{Claims, Given, Mapping};
pub use self::user::{Roles, User};
use crate::net::client::{self, last_cause};
use crate::net::lock;

/// The greatest answer of a provider, bytes.
const ANSWER: usize = 1 << 20;
/// Who asks.
const AGENT: &str = concat!("baliza/", env!("CARGO_PKG_VERSION"));
/// The route to which the provider sends the browser back.
pub const CALLBACK: &str = "/oidc/callback";
/// The route that sends the browser to the provider.
pub const LOGIN: &str = "/oidc/login";
/// Signatures by a private key of the provider. Those by the client's secret are not taken: who has it could sign.
const ALGORITHMS: [CoreJwsSigningAlgorithm; 9] = [
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha256,
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha384,
    CoreJwsSigningAlgorithm::RsaSsaPkcs1V15Sha512,
    CoreJwsSigningAlgorithm::RsaSsaPssSha256,
    CoreJwsSigningAlgorithm::RsaSsaPssSha384,
    CoreJwsSigningAlgorithm::RsaSsaPssSha512,
    CoreJwsSigningAlgorithm::EcdsaP256Sha256,
    CoreJwsSigningAlgorithm::EcdsaP384Sha384,
    CoreJwsSigningAlgorithm::EdDsa,
];

/// Why a person is not signed in. The log has more.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The provider does not answer.
    Away,
    /// The sign-in was not begun in this browser, is finished already, or took too long.
    Unknown,
    /// The person or the provider has refused.
    Denied,
    /// What the provider answers cannot be used or trusted.
    Distrusted,
    /// The person has no role here.
    NoRole,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Away => "the provider of sign-ins does not answer: try again later",
            Self::Unknown => "this sign-in has ended, took too long, or was begun in another browser: sign in again",
            Self::Denied => "the provider has refused the sign-in",
            Self::Distrusted => "the provider's answer cannot be trusted: the station's log says why",
            Self::NoRole => "you are known, but have no role at this station: ask the person who runs it",
        })
    }
}

/// Where a browser goes to sign in.
#[derive(Clone, Debug)]
pub struct Begin {
    /// The address at the provider.
    pub url: Url,
    /// The sign-in's secret, which the browser keeps in a cookie meanwhile.
    pub state: String,
}

/// A person who has signed in.
#[derive(Clone, Debug)]
pub struct SignedIn {
    /// The person.
    pub user: User,
    /// Where a browser ends the session of the provider; None: nowhere.
    pub end_session: Option<Url>,
}

/// What a request to the provider has come to, if not to an answer.
#[derive(Debug, thiserror::Error)]
enum RequestError {
    #[error("no connection")]
    Connection(#[from] hyper_util::client::legacy::Error),
    #[error("the answer was not read: {0}")]
    Body(Box<dyn Error + Send + Sync>),
    #[error("no answer within {} s", .0.as_secs_f64())]
    Slow(Duration),
}

/// What the provider says of itself, and since when this is known.
struct Found {
    metadata: ProviderMetadataWithLogout,
    at: Instant,
}

type Client =
    CoreClient<EndpointSet, EndpointNotSet, EndpointNotSet, EndpointNotSet, EndpointMaybeSet, EndpointMaybeSet>;

/// Signs people in.
pub struct Oidc {
    settings: OidcSettings,
    patience: Patience,
    issuer: IssuerUrl,
    public_url: Url,
    redirect: RedirectUrl,
    mapping: Mapping,
    http: client::Client,
    begun: Begun,
    known: std::sync::Mutex<Option<Arc<Found>>>,
    /// Held while the provider is asked. When it was asked in vain, if that is so.
    search: Mutex<Option<Instant>>,
}

impl fmt::Debug for Oidc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Oidc").field("settings", &self.settings).finish_non_exhaustive()
    }
}

impl Oidc {
    /// Checks the settings. The provider is not asked yet.
    ///
    /// # Errors
    /// Addresses, roles or certificates are wrong.
    pub fn new(settings: OidcSettings, patience: Patience) -> Result<Self, OidcError> {
        let (issuer, public_url) = settings.addresses()?;
        let mapping = Mapping::of(&settings.claim, &settings.roles)?;
        let redirect = public_url.join(CALLBACK).map_err(|_| OidcError::PublicUrl("it is no address"))?;
        let http = client::client(issuer.scheme() == "https", settings.ca.as_deref()).map_err(OidcError::Client)?;
        // The text as it is: its comparison with what the provider says is one of texts.
        let issuer = IssuerUrl::new(settings.issuer.clone()).map_err(|_| OidcError::Issuer("it is no address"))?;
        let redirect = RedirectUrl::from_url(redirect);
        let begun = Begun::new(patience.sign_in);
        let (known, search) = Default::default();
        Ok(Self { settings, patience, issuer, public_url, redirect, mapping, http, begun, known, search })
    }

    /// Where a browser begins to sign in.
    pub fn login_url(&self) -> String {
        format!("{}{LOGIN}", self.public_url.as_str().trim_end_matches('/'))
    }

    /// Whether browsers reach the station by TLS.
    pub fn is_encrypted(&self) -> bool {
        self.public_url.scheme() == "https"
    }

    /// The provider's name.
    pub fn issuer(&self) -> &str {
        self.issuer.as_str()
    }

    /// A session ends after this time.
    pub fn session(&self) -> Duration {
        self.settings.session
    }

    /// A person has this time at the provider.
    pub fn sign_in_time(&self) -> Duration {
        self.patience.sign_in
    }

    /// Reads what the provider says of itself, again and again, and says in the log whether it answers.
    pub async fn keep_found(self: Arc<Self>) {
        loop {
            let pause = match self.found(Some(Instant::now())).await {
                Ok(_) => self.patience.renewal,
                Err(_) => self.patience.again,
            };
            tokio::time::sleep(pause).await;
        }
    }

    /// Begins a sign-in.
    ///
    /// # Errors
    /// The provider is away.
    pub async fn begin(&self) -> Result<Begin, Refusal> {
        let client = self.client(&self.found(None).await?.metadata);
        let (challenge, verifier) = PkceCodeChallenge::new_random_sha256();
        let scopes = self.settings.scopes.iter().cloned().map(Scope::new);
        let (url, state, nonce) = client
            .authorize_url(CoreAuthenticationFlow::AuthorizationCode, CsrfToken::new_random, Nonce::new_random)
            .add_scopes(scopes)
            .set_pkce_challenge(challenge)
            .url();
        let state = state.into_secret();
        self.begun.add(&state, SignIn { nonce, verifier: verifier.into_secret() }, Instant::now());
        Ok(Begin { url, state })
    }

    /// Ends a sign-in, with a code or not: its state cannot be used again.
    pub fn take(&self, state: &str) -> Option<SignIn> {
        self.begun.take(state, Instant::now())
    }

    /// Who has signed in.
    ///
    /// # Errors
    /// The provider is away, its answer cannot be trusted, or the person has no role.
    pub async fn finish(&self, sign_in: SignIn, code: String) -> Result<SignedIn, Refusal> {
        let SignIn { nonce, verifier } = sign_in;
        let found = self.found(None).await?;
        let client = self.client(&found.metadata);
        let distrusted = |error: &(dyn Error + 'static)| self.distrust(&with_cause(error));
        let request = client.exchange_code(AuthorizationCode::new(code)).map_err(|error| distrusted(&error))?;
        let request = request.set_pkce_verifier(PkceCodeVerifier::new(verifier));
        let tokens = request.request_async(&|request| self.send(request)).await.map_err(|error| match &error {
            RequestTokenError::Request(_) => {
                log::warn!("sign-in: {} does not answer: {}", self.issuer(), with_cause(&error));
                Refusal::Away
            }
            RequestTokenError::ServerResponse(answer) if *answer.error() == CoreErrorResponseType::InvalidClient => {
                self.distrust("it does not take client_id and client_secret")
            }
            RequestTokenError::ServerResponse(_) | RequestTokenError::Parse(..) | RequestTokenError::Other(_) => {
                distrusted(&error)
            }
        })?;
        let token = tokens.id_token().ok_or_else(|| self.distrust("there is no ID token"))?;
        let subject = match subject(&client, token, &nonce) {
            // The provider may sign with a new key.
            Err(ClaimsVerificationError::SignatureVerification(_)) => {
                let found = self.found(Some(found.at)).await?;
                subject(&self.client(&found.metadata), token, &nonce)
            }
            known => known,
        };
        let subject = subject.map_err(|error| distrusted(&error))?;
        let given = Given::of_token(&token.to_string()).ok_or_else(|| self.distrust("the ID token has no claims"))?;
        // Some providers have groups in their UserInfo only.
        let given = if self.mapping.is_in(&given) {
            given
        } else {
            given.and(self.ask(&client, tokens.access_token(), &subject).await)
        };
        let user = self.mapping.user(subject.as_str(), &given).ok_or_else(|| {
            let (subject, why) = (subject.as_str(), self.mapping.why(&given));
            log::warn!(target: "audit", "{subject:?} has signed in and has no role: {why}");
            Refusal::NoRole
        })?;
        Ok(SignedIn { user, end_session: self.end_session(&found.metadata, token) })
    }

    /// Where a browser ends the provider's session of this token, and is then sent back to the page (OpenID Connect
    /// RP-Initiated Logout 1.0, section 2).
    fn end_session(&self, metadata: &ProviderMetadataWithLogout, token: &CoreIdToken) -> Option<Url> {
        let endpoint = metadata.additional_metadata().end_session_endpoint.clone();
        let endpoint = endpoint.filter(|endpoint| endpoint.url().scheme() == self.issuer.url().scheme())?;
        let request = LogoutRequest::from(endpoint)
            .set_id_token_hint(token)
            .set_client_id(ClientId::new(self.settings.client_id.clone()))
            .set_post_logout_redirect_uri(PostLogoutRedirectUrl::from_url(self.public_url.clone()));
        self.settings.end_session.then(|| request.http_get_url())
    }

    /// The provider's UserInfo; nothing where it does not answer.
    async fn ask(&self, client: &Client, token: &AccessToken, subject: &SubjectIdentifier) -> Given {
        let Ok(request) = client.user_info(token.clone(), Some(subject.clone())) else { return Given::default() };
        let asked = request.request_async::<Claims, _, CoreGenderClaim>(&|request| self.send(request)).await;
        match asked {
            Ok(claims) => Given::of_value(serde_json::to_value(&claims).unwrap_or_default()),
            Err(error) => {
                log::warn!("sign-in: {} does not answer with the UserInfo: {}", self.issuer(), with_cause(&error));
                Given::default()
            }
        }
    }

    fn distrust(&self, why: &str) -> Refusal {
        log::error!("sign-in: the answer of {} cannot be used: {why}", self.issuer());
        Refusal::Distrusted
    }

    /// What the provider says of itself, where this is known since after `newer_than`; else it is asked.
    async fn found(&self, newer_than: Option<Instant>) -> Result<Arc<Found>, Refusal> {
        let known = || lock(&self.known).clone().filter(|found| newer_than.is_none_or(|than| found.at > than));
        if let Some(found) = known() {
            return Ok(found);
        }
        let mut failed = self.search.lock().await;
        // Another request may have asked meanwhile.
        if let Some(found) = known() {
            return Ok(found);
        }
        if failed.is_some_and(|at| at.elapsed() < self.patience.pause) {
            return Err(Refusal::Away);
        }
        match ProviderMetadataWithLogout::discover_async(self.issuer.clone(), &|request| self.send(request)).await {
            Ok(metadata) => {
                let found = Arc::new(Found { metadata, at: Instant::now() });
                let before = lock(&self.known).replace(found.clone());
                if before.is_none() || failed.is_some() {
                    log::info!("sign-in: {} answers", self.issuer());
                }
                *failed = None;
                Ok(found)
            }
            Err(error) => {
                if failed.is_none() {
                    let (issuer, why) = (self.issuer(), with_cause(&error));
                    log::error!("sign-in: {issuer} cannot be used: {why}; it is tried again");
                }
                *failed = Some(Instant::now());
                Err(Refusal::Away)
            }
        }
    }

    fn client(&self, metadata: &ProviderMetadataWithLogout) -> Client {
        let OidcSettings { client_id, client_secret, .. } = &self.settings;
        let secret = client_secret.clone().map(ClientSecret::new);
        let client = Client::from_provider_metadata(metadata.clone(), ClientId::new(client_id.clone()), secret);
        // Basic is what a provider takes that says nothing (OpenID Connect Discovery 1.0, section 3).
        let methods = metadata.token_endpoint_auth_methods_supported();
        let takes = |method| methods.is_none_or(|methods| methods.contains(&method));
        let way =
            if takes(CoreClientAuthMethod::ClientSecretBasic) { AuthType::BasicAuth } else { AuthType::RequestBody };
        client.set_auth_type(way).set_redirect_uri(self.redirect.clone())
    }

    /// Sends a request to the provider.
    fn send(
        &self,
        mut request: HttpRequest,
    ) -> impl Future<Output = Result<HttpResponse, RequestError>> + Send + 'static {
        let (http, limit) = (self.http.clone(), self.patience.request);
        request.headers_mut().insert(USER_AGENT, HeaderValue::from_static(AGENT));
        let answer = async move {
            let answer = http.request(request.map(Full::from)).await?;
            let (parts, body) = answer.into_parts();
            let body = Limited::new(body, ANSWER).collect().await.map_err(RequestError::Body)?;
            Ok(HttpResponse::from_parts(parts, body.to_bytes().into()))
        };
        async move { timeout(limit, answer).await.unwrap_or(Err(RequestError::Slow(limit))) }
    }
}

/// The subject of a token that is as it must be.
fn subject(client: &Client, token: &CoreIdToken, nonce: &Nonce) -> Result<SubjectIdentifier, ClaimsVerificationError> {
    let verifier = client.id_token_verifier().set_allowed_algs(ALGORITHMS);
    Ok(token.claims(&verifier, nonce)?.subject().clone())
}

/// An error with its last cause.
fn with_cause(error: &(dyn Error + 'static)) -> String {
    match (error.to_string(), last_cause(error).to_string()) {
        (text, cause) if text.contains(&cause) => text,
        (text, cause) => format!("{text}: {cause}"),
    }
}
