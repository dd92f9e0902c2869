//! A provider of OpenID Connect that signs whatever a test asks for, forgeries among it.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::routing::{get, post};
use axum::{Json, Router};
use base64::Engine;
use base64::engine::general_purpose::{STANDARD, URL_SAFE_NO_PAD};
use hmac::{Hmac, KeyInit, Mac};
use ring::rand::SystemRandom;
use ring::signature::{ECDSA_P256_SHA256_FIXED_SIGNING, EcdsaKeyPair, KeyPair};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use url::Url;

/// The station's name and secret at the provider.
pub const CLIENT: (&str, &str) = ("baliza", "client-secret");

/// How a token is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Forgery {
    /// Signed by another key with the same name.
    OtherKey,
    /// Signed by a key that is not the provider's.
    UnknownKey,
    /// Not signed at all (`alg` is `none`).
    Unsigned,
    /// Signed with the client's secret, which is no key of the provider.
    Secret,
    /// Changed after it was signed.
    Changed,
    Expired,
    OtherAudience,
    OtherIssuer,
    OtherNonce,
    /// There is an access token only.
    Missing,
    /// It is no token.
    Garbage,
}

/// All of them.
pub const FORGERIES: [Forgery; 11] = [
    Forgery::OtherKey,
    Forgery::UnknownKey,
    Forgery::Unsigned,
    Forgery::Secret,
    Forgery::Changed,
    Forgery::Expired,
    Forgery::OtherAudience,
    Forgery::OtherIssuer,
    Forgery::OtherNonce,
    Forgery::Missing,
    Forgery::Garbage,
];

struct Inner {
    issuer: String,
    key: (EcdsaKeyPair, &'static str),
    /// What tokens say besides what they must.
    claims: Value,
    /// The answer of the UserInfo endpoint.
    user_info: Value,
    forgery: Option<Forgery>,
    /// The nonce and the challenge of the sign-in that was begun last.
    begun: (String, String),
    token_status: StatusCode,
    delay: Duration,
    /// How often the keys were read.
    keys_read: u32,
}

/// The provider.
#[derive(Clone)]
pub struct Provider {
    pub issuer: String,
    inner: Arc<Mutex<Inner>>,
}

fn key() -> EcdsaKeyPair {
    let random = SystemRandom::new();
    let key = EcdsaKeyPair::generate_pkcs8(&ECDSA_P256_SHA256_FIXED_SIGNING, &random).unwrap();
    EcdsaKeyPair::from_pkcs8(&ECDSA_P256_SHA256_FIXED_SIGNING, key.as_ref(), &random).unwrap()
}

fn encoded(value: &Value) -> String {
    URL_SAFE_NO_PAD.encode(value.to_string())
}

/// A JSON Web Signature in its compact form (RFC 7515, section 3.1) with ES256.
fn signed(key: &EcdsaKeyPair, kid: &str, claims: &Value) -> String {
    let text = format!("{}.{}", encoded(&json!({"alg": "ES256", "kid": kid, "typ": "JWT"})), encoded(claims));
    let signature = key.sign(&SystemRandom::new(), text.as_bytes()).unwrap();
    format!("{text}.{}", URL_SAFE_NO_PAD.encode(signature))
}

impl Inner {
    fn token(&self) -> Option<String> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs();
        let mut claims = json!({"iss": self.issuer, "sub": "248289761001", "aud": CLIENT.0, "iat": now, "exp": now + 60,
            "nonce": self.begun.0});
        claims.as_object_mut().unwrap().extend(self.claims.as_object().unwrap().clone());
        let (key, kid) = (&self.key.0, self.key.1);
        Some(match self.forgery {
            None => signed(key, kid, &claims),
            Some(Forgery::OtherKey) => signed(&self::key(), kid, &claims),
            Some(Forgery::UnknownKey) => signed(&self::key(), "unknown", &claims),
            Some(Forgery::Unsigned) => format!("{}.{}.", encoded(&json!({"alg": "none"})), encoded(&claims)),
            Some(Forgery::Secret) => {
                let text = format!("{}.{}", encoded(&json!({"alg": "HS256"})), encoded(&claims));
                let code = Hmac::<Sha256>::new_from_slice(CLIENT.1.as_bytes()).unwrap();
                let code = code.chain_update(&text).finalize().into_bytes();
                format!("{text}.{}", URL_SAFE_NO_PAD.encode(code))
            }
            Some(Forgery::Changed) => {
                let token = signed(key, kid, &claims);
                let mut parts = token.split('.');
                let (head, signature) = (parts.next().unwrap(), parts.nth(1).unwrap());
                claims["groups"] = json!(["admins"]);
                format!("{head}.{}.{signature}", encoded(&claims))
            }
            Some(Forgery::Expired) => {
                claims["exp"] = json!(now - 1);
                signed(key, kid, &claims)
            }
            Some(Forgery::OtherAudience) => {
                claims["aud"] = json!("shop");
                signed(key, kid, &claims)
            }
            Some(Forgery::OtherIssuer) => {
                claims["iss"] = json!("https://id.example.org");
                signed(key, kid, &claims)
            }
            Some(Forgery::OtherNonce) => {
                claims["nonce"] = json!("of another sign-in");
                signed(key, kid, &claims)
            }
            Some(Forgery::Missing) => return None,
            Some(Forgery::Garbage) => "a.b".to_owned(),
        })
    }
}

impl Provider {
    /// Starts one. People are in the group `staff`.
    pub async fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let provider = Self::at(listener.local_addr().unwrap());
        provider.serve(listener);
        provider
    }

    /// One for this address, which does not answer yet.
    pub fn at(address: SocketAddr) -> Self {
        let issuer = format!("http://{address}");
        let inner = Inner {
            issuer: issuer.clone(),
            key: (key(), "first"),
            claims: json!({"preferred_username": "ana", "groups": ["staff"]}),
            user_info: json!({"sub": "248289761001"}),
            forgery: None,
            begun: Default::default(),
            token_status: StatusCode::OK,
            delay: Duration::ZERO,
            keys_read: 0,
        };
        Self { issuer, inner: Arc::new(Mutex::new(inner)) }
    }

    pub fn serve(&self, listener: TcpListener) -> JoinHandle<()> {
        let router = Router::new()
            .route("/.well-known/openid-configuration", get(metadata))
            .route("/keys", get(keys))
            .route("/token", post(token))
            .route("/me", get(user_info))
            .with_state(self.clone());
        tokio::spawn(async move { axum::serve(listener, router).await.unwrap() })
    }

    fn with<T>(&self, action: impl FnOnce(&mut Inner) -> T) -> T {
        action(&mut self.inner.lock().unwrap())
    }

    /// What the next tokens say.
    pub fn claim(&self, claims: Value) {
        self.with(|inner| inner.claims = claims);
    }

    /// What the address for user information says.
    pub fn tell(&self, user_info: Value) {
        self.with(|inner| inner.user_info = user_info);
    }

    pub fn forge(&self, forgery: Option<Forgery>) {
        self.with(|inner| inner.forgery = forgery);
    }

    /// Signs with a new key from now on. How often the keys were read before.
    pub fn rotate(&self) -> u32 {
        self.with(|inner| {
            inner.key = (key(), "second");
            inner.keys_read
        })
    }

    pub fn keys_read(&self) -> u32 {
        self.with(|inner| inner.keys_read)
    }

    /// Says that it is another one.
    pub fn rename(&self, issuer: &str) {
        self.with(|inner| inner.issuer = issuer.to_owned());
    }

    /// Answers at the token's address with this status.
    pub fn fail(&self, status: StatusCode) {
        self.with(|inner| inner.token_status = status);
    }

    /// Answers at the token's address after this time.
    pub fn wait(&self, delay: Duration) {
        self.with(|inner| inner.delay = delay);
    }

    /// The person signs in at the address that a station has sent them to. Returns the state.
    pub fn visit(&self, location: &str) -> String {
        let url: Url = location.parse().unwrap();
        assert!(location.starts_with(&format!("{}/authorize?", self.issuer)), "{location}");
        let get = |name: &str| {
            let found = url.query_pairs().find(|(key, _)| key == name);
            found.unwrap_or_else(|| panic!("{name}: {location}")).1.into_owned()
        };
        assert_eq!([get("response_type"), get("client_id"), get("code_challenge_method")], ["code", CLIENT.0, "S256"]);
        assert_eq!(get("redirect_uri"), "http://station.localhost/oidc/callback");
        assert_eq!(get("scope"), "openid profile");
        let state = get("state");
        self.with(|inner| inner.begun = (get("nonce"), get("code_challenge")));
        state
    }
}

async fn metadata(State(provider): State<Provider>) -> Json<Value> {
    let issuer = provider.with(|inner| inner.issuer.clone());
    let base = &provider.issuer;
    Json(json!({
        "issuer": issuer, "authorization_endpoint": format!("{base}/authorize"),
        "token_endpoint": format!("{base}/token"), "userinfo_endpoint": format!("{base}/me"),
        "jwks_uri": format!("{base}/keys"), "end_session_endpoint": format!("{base}/end"),
        "response_types_supported": ["code"],
        // It says that it signs in any way: the station must not take all of them.
        "subject_types_supported": ["public"],
        "id_token_signing_alg_values_supported": ["ES256", "RS256", "HS256", "none"],
    }))
}

async fn keys(State(provider): State<Provider>) -> Json<Value> {
    Json(provider.with(|inner| {
        inner.keys_read += 1;
        // An uncompressed point: 4, x, y (SEC 1, section 2.3.3).
        let point = inner.key.0.public_key().as_ref();
        let [x, y] = [&point[1..33], &point[33..]].map(|number| URL_SAFE_NO_PAD.encode(number));
        let kid = inner.key.1;
        json!({"keys": [{"kty": "EC", "crv": "P-256", "use": "sig", "alg": "ES256", "kid": kid, "x": x, "y": y}]})
    }))
}

async fn token(State(provider): State<Provider>, headers: HeaderMap, body: String) -> (StatusCode, Json<Value>) {
    let form: Vec<_> = url::form_urlencoded::parse(body.as_bytes()).into_owned().collect();
    let get = |name: &str| form.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str());
    let basic = format!("Basic {}", STANDARD.encode(format!("{}:{}", CLIENT.0, CLIENT.1)));
    if headers[header::AUTHORIZATION] != basic {
        return (StatusCode::UNAUTHORIZED, Json(json!({"error": "invalid_client"})));
    }
    tokio::time::sleep(provider.with(|inner| inner.delay)).await;
    provider.with(|inner| {
        // RFC 7636, section 4.6.
        let challenge = URL_SAFE_NO_PAD.encode(Sha256::digest(get("code_verifier").unwrap_or_default()));
        if get("grant_type") != Some("authorization_code")
            || get("code") != Some("a-code")
            || challenge != inner.begun.1
        {
            return (StatusCode::BAD_REQUEST, Json(json!({"error": "invalid_grant"})));
        }
        let mut answer = json!({"access_token": "an-access-token", "token_type": "Bearer"});
        if let Some(token) = inner.token() {
            answer["id_token"] = json!(token);
        }
        (inner.token_status, Json(answer))
    })
}

async fn user_info(State(provider): State<Provider>, headers: HeaderMap) -> (StatusCode, Json<Value>) {
    if headers[header::AUTHORIZATION] != "Bearer an-access-token" {
        return (StatusCode::UNAUTHORIZED, Json(Value::Null));
    }
    (StatusCode::OK, Json(provider.with(|inner| inner.user_info.clone())))
}
