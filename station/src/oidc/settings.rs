//! What a person configures: the provider, and what its users may do.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use url::Url;

use super::user::Roles;
use crate::net::client::ClientError;
use crate::net::is_loopback_name;

/// The provider, and what its users may do.
#[derive(Clone)]
pub struct OidcSettings {
    /// The provider, exactly as it writes its own name: `https://…`.
    pub issuer: String,
    /// The station's name at the provider.
    pub client_id: String,
    /// The station's secret at the provider; None: a public client, with PKCE alone.
    pub client_secret: Option<String>,
    /// The station's own address, as browsers see it.
    pub public_url: String,
    /// Scopes to ask for besides `openid`.
    pub scopes: Vec<String>,
    /// The claim that names groups or roles: its name, or a path with points.
    pub claim: String,
    /// Which values of the claim give which role.
    pub roles: Roles,
    /// PEM with the authorities that the provider's certificate may be from, in place of those of the system.
    pub ca: Option<PathBuf>,
    /// A session ends after this time: what the provider says of the person may have changed.
    pub session: Duration,
    /// Whether who logs out of the station is logged out of the provider as well, where the provider can do that.
    pub end_session: bool,
}

impl fmt::Debug for OidcSettings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OidcSettings").field("issuer", &self.issuer).finish_non_exhaustive()
    }
}

/// How long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// A person has this time at the provider.
    pub sign_in: Duration,
    /// A request to the provider has this time until its answer.
    pub request: Duration,
    /// A provider that does not answer is not asked again before this.
    pub pause: Duration,
    /// One that did not answer at the start is asked again after this.
    pub again: Duration,
    /// What the provider says of itself is read again after this.
    pub renewal: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            sign_in: Duration::from_secs(600),
            request: Duration::from_secs(10),
            pause: Duration::from_secs(2),
            again: Duration::from_secs(15),
            renewal: Duration::from_secs(3600),
        }
    }
}

/// The settings cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OidcError {
    /// The issuer is no address.
    #[error("issuer: {0}; it is an address such as https://id.example.org/realms/house, as the provider writes it")]
    Issuer(&'static str),
    /// The client has no name.
    #[error("client_id is empty: it is the station's name at the provider")]
    ClientId,
    /// The station's address is none.
    #[error("public_url: {0}; it is the station's address in browsers, such as https://station.example.org")]
    PublicUrl(&'static str),
    /// Nobody could sign in.
    #[error("roles: no value gives a role; for example administer = [\"baliza-admins\"]")]
    NoRoles,
    /// A value has two roles.
    #[error("roles: {0:?} is there twice")]
    Twice(String),
    /// No server's certificate could be checked.
    #[error(transparent)]
    Client(ClientError),
}

impl OidcSettings {
    /// Checks what can be checked without the provider; the addresses of the issuer and of the station.
    pub(super) fn addresses(&self) -> Result<(Url, Url), OidcError> {
        let issuer = address(&self.issuer).map_err(OidcError::Issuer)?;
        if issuer.scheme() == "http" && !issuer.host_str().is_some_and(is_loopback_name) {
            return Err(OidcError::Issuer("without https, anyone in between could sign in as anyone"));
        }
        let public_url = address(&self.public_url).map_err(OidcError::PublicUrl)?;
        if public_url.path() != "/" {
            return Err(OidcError::PublicUrl("the station must be at the root of its host, without a path"));
        }
        if self.client_id.is_empty() {
            return Err(OidcError::ClientId);
        }
        Ok((issuer, public_url))
    }
}

/// The address of a host.
fn address(text: &str) -> Result<Url, &'static str> {
    let url: Url = text.parse().map_err(|_| "it is no address")?;
    if !matches!(url.scheme(), "http" | "https") {
        return Err("it must begin with https:// or http://");
    }
    if !url.username().is_empty() || url.password().is_some() || url.query().is_some() || url.fragment().is_some() {
        return Err("it has more than host, port and path");
    }
    Ok(url)
}
