//! The client for requests that the station makes itself: to receivers of webhooks, and to the provider of sign-ins.

use std::error::Error;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use http_body_util::Full;
use hyper::body::Bytes;
use hyper_rustls::{ConfigBuilderExt, HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::{self, ClientConfig, RootCertStore};

use super::tls::{TlsError, read_certificates};

/// A connection has this time to be made.
const CONNECT: Duration = Duration::from_secs(5);
/// A connection that is not used for this time is closed.
const IDLE: Duration = Duration::from_secs(30);

/// Makes requests by HTTP 1.1, with TLS where the address says so. Redirects are not followed.
pub(crate) type Client = legacy::Client<HttpsConnector<HttpConnector>, Full<Bytes>>;

/// There are no authorities that could vouch for a server.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The file of authorities is wrong.
    #[error("ca: {0}")]
    Ca(TlsError),
    /// A certificate of an authority cannot be used.
    #[error("ca: {0}")]
    Authority(rustls::Error),
    /// The system has no authorities.
    #[error("the system's authorities cannot be read: {0}; install ca-certificates, or name a file as ca")]
    NoAuthorities(io::Error),
}

/// A client that trusts the authorities of a PEM file, else those of the system. Those are needed for `https` only.
pub(crate) fn client(is_https: bool, ca: Option<&Path>) -> Result<Client, ClientError> {
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(ClientError::Authority)?;
    let mut own = RootCertStore::empty();
    let config = match ca {
        None if is_https => config.with_native_roots().map_err(ClientError::NoAuthorities)?,
        None => config.with_root_certificates(own),
        Some(ca) => {
            for certificate in read_certificates(ca).map_err(ClientError::Ca)? {
                own.add(certificate).map_err(ClientError::Authority)?;
            }
            config.with_root_certificates(own)
        }
    };
    let mut connector = HttpConnector::new();
    connector.enforce_http(false);
    connector.set_nodelay(true);
    connector.set_connect_timeout(Some(CONNECT));
    let connector = HttpsConnectorBuilder::new()
        .with_tls_config(config.with_no_client_auth())
        .https_or_http()
        .enable_http1()
        .wrap_connector(connector);
    let client = legacy::Client::builder(TokioExecutor::new())
        .pool_timer(TokioTimer::new())
        .pool_idle_timeout(IDLE)
        .pool_max_idle_per_host(1)
        .build(connector);
    Ok(client)
}

/// The last cause of an error, which tells something: connection refused, unknown issuer …
pub(crate) fn last_cause<'a>(error: &'a (dyn Error + 'static)) -> &'a (dyn Error + 'static) {
    let mut cause = error;
    while let Some(next) = cause.source() {
        cause = next;
    }
    cause
}
