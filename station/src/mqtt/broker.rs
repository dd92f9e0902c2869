//! The address of a broker, and who one is there.

use std::fmt;
use std::time::Duration;

use rumqttc::tokio_rustls::rustls::pki_types::CertificateDer;
use rumqttc::tokio_rustls::rustls::pki_types::pem::PemObject as _;
use rumqttc::{Broker as Address, MqttOptions, TlsConfiguration, Transport};
use url::{Host, Url};

/// The greatest packet that the broker may send, bytes.
const INCOMING: u32 = 64 * 1024;
/// A connection without packets for 1.5 times this long is lost, seconds.
pub(super) const KEEP_ALIVE_S: u16 = 10;
/// A connection that is not there after this time fails.
const CONNECT: Duration = Duration::from_secs(5);

/// What is wrong with the address of a broker. No text here has the password.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoBroker {
    /// Another form.
    #[error("a broker is mqtt://HOST, mqtt://USER@HOST:PORT, or mqtts://HOST for TLS")]
    Form,
    /// A path or a query.
    #[error("the address of a broker ends with host and port")]
    Path,
    /// The certificates of TLS are for names.
    #[error("with mqtts, the host is a name or an IPv4 address")]
    Name,
    /// An authority without TLS.
    #[error("an authority (CA) is for TLS alone: the address begins with mqtts://")]
    NoTls,
    /// The text of the authority.
    #[error("this is no certificate in PEM (-----BEGIN CERTIFICATE-----)")]
    Certificate,
    /// The system's authorities.
    #[error("the certificates of this computer cannot be read ({0}); give the authority's own")]
    System(String),
}

/// A broker.
#[derive(Clone)]
pub struct Broker {
    host: String,
    port: u16,
    user: Option<String>,
    password: Option<String>,
    tls: Option<TlsConfiguration>,
}

impl Broker {
    /// A broker by its address, `mqtt://USER:PASSWORD@HOST:PORT` or `mqtts://…`. `password` comes before that of the
    /// address. `authority` is the text of a PEM file with certificates; without it, `mqtts` trusts the authorities of
    /// the system.
    ///
    /// # Errors
    /// Something of it is wrong.
    pub fn new(url: &str, password: Option<String>, authority: Option<&[u8]>) -> Result<Self, NoBroker> {
        let url = Url::parse(url).map_err(|_| NoBroker::Form)?;
        let is_tls = match url.scheme() {
            "mqtt" => false,
            "mqtts" => true,
            _ => return Err(NoBroker::Form),
        };
        if !matches!(url.path(), "" | "/") || url.query().is_some() || url.fragment().is_some() {
            return Err(NoBroker::Path);
        }
        let host = match url.host().ok_or(NoBroker::Form)? {
            Host::Ipv6(_) if is_tls => return Err(NoBroker::Name),
            Host::Ipv6(address) => format!("[{address}]"),
            Host::Ipv4(address) => address.to_string(),
            Host::Domain("") => return Err(NoBroker::Form),
            Host::Domain(name) => name.to_owned(),
        };
        let decoded = |text: &str| percent_encoding::percent_decode_str(text).decode_utf8_lossy().into_owned();
        let tls = match (is_tls, authority) {
            (false, None) => None,
            (false, Some(_)) => return Err(NoBroker::NoTls),
            (true, Some(pem)) => Some(own_authority(pem)?),
            (true, None) => {
                Some(TlsConfiguration::try_default_rustls().map_err(|error| NoBroker::System(error.to_string()))?)
            }
        };
        Ok(Self {
            host,
            port: url.port().unwrap_or(if is_tls { 8883 } else { 1883 }),
            user: Some(decoded(url.username())).filter(|user| !user.is_empty()),
            password: password.or_else(|| url.password().map(decoded)),
            tls,
        })
    }

    /// Who one is there.
    pub(super) fn user(&self) -> Option<&str> {
        self.user.as_deref()
    }

    /// What a connection needs.
    pub(super) fn options(&self, client: &str) -> MqttOptions {
        let mut options = MqttOptions::new(client, Address::tcp(self.host.clone(), self.port));
        options.set_keep_alive(KEEP_ALIVE_S).set_connect_timeout(CONNECT).set_clean_start(true);
        options.set_max_packet_size(Some(INCOMING));
        // Each of them replaces what was set before.
        match (&self.user, &self.password) {
            (Some(user), Some(password)) => options.set_credentials(user.clone(), password.clone()),
            (Some(user), None) => options.set_username(user.clone()),
            (None, Some(password)) => options.set_password(password.clone()),
            (None, None) => &mut options,
        };
        if let Some(tls) = &self.tls {
            options.set_transport(Transport::tls_with_config(tls.clone()));
        }
        options
    }
}

/// Without the password.
impl fmt::Display for Broker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.host, self.port)
    }
}

impl fmt::Debug for Broker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Broker({self})")
    }
}

/// Trusts the certificates of a PEM text alone.
fn own_authority(pem: &[u8]) -> Result<TlsConfiguration, NoBroker> {
    let certificates: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(pem).collect();
    if certificates.map_err(|_| NoBroker::Certificate)?.is_empty() {
        return Err(NoBroker::Certificate);
    }
    Ok(TlsConfiguration::Simple { ca: pem.to_vec(), alpn: None, client_auth: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn broker(url: &str) -> Result<Broker, NoBroker> {
        Broker::new(url, None, None)
    }

    #[test]
    fn an_address_has_the_ports_of_mqtt_where_it_names_none() {
        // IANA: 1883, and 8883 for TLS.
        assert_eq!(broker("mqtt://broker").expect("an address").to_string(), "broker:1883");
        assert_eq!(broker("mqtt://me:s%40cret@192.0.2.7:1884/").expect("an address").to_string(), "192.0.2.7:1884");
        assert_eq!(broker("mqtt://[::1]").expect("an address").to_string(), "[::1]:1883");
    }

    #[test]
    fn user_and_password_are_decoded_and_the_password_of_a_file_comes_first() {
        let of_url = broker("mqtt://m%C3%AD:s%40cret@broker").expect("an address");
        assert_eq!((of_url.user(), of_url.password.as_deref()), (Some("mí"), Some("s@cret")));
        let of_file = Broker::new("mqtt://me:old@broker", Some("new".to_owned()), None).expect("an address");
        assert_eq!(of_file.password.as_deref(), Some("new"));
        assert!(!format!("{of_url:?} {of_url}").contains("s@cret"));
    }

    #[test]
    fn wrong_addresses_are_refused_without_the_password() {
        for (url, wrong) in [
            ("broker", NoBroker::Form),
            ("http://me:secret@broker", NoBroker::Form),
            ("mqtt://", NoBroker::Form),
            ("mqtt://me:secret@broker/topic", NoBroker::Path),
            ("mqtts://[::1]", NoBroker::Name),
        ] {
            let error = broker(url).expect_err(url);
            assert!(!error.to_string().contains("secret"), "{error}");
            assert_eq!(error, wrong, "{url}");
        }
        let pem = |url: &str, text: &str| Broker::new(url, None, Some(text.as_bytes())).map(|_| ());
        assert_eq!(pem("mqtt://broker", "any"), Err(NoBroker::NoTls));
        assert_eq!(pem("mqtts://broker", "no certificate"), Err(NoBroker::Certificate));
    }
}
