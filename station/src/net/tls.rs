//! TLS: the files of a certificate and its key to encrypted connections.
//!
//! The files are read again when their content changes, so that a renewed certificate needs no restart: connections
//! that are open keep the old one, those that follow get the new one. Files that are wrong then are logged, and the
//! certificate stays.
//!
//! There is no `Strict-Transport-Security` in the answers: it would count for every port of the host, where other
//! services may be reached by HTTP only, and browsers would no longer offer to accept a certificate of one's own.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use sha2::{Digest, Sha256};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{self, ServerConfig};
use tokio_rustls::server::TlsStream;
use x509_cert::Certificate;
use x509_cert::der::Decode;
use x509_cert::time::Time;

use super::lock;
use crate::Utc;

/// The greatest file of a certificate or a key, bytes.
const LARGEST: u64 = 1 << 20;
/// The first byte of a TLS connection: a record of the handshake (RFC 8446, section 5.1).
const HANDSHAKE: u8 = 22;
/// What a client of plain HTTP has sent is read for this time, so that it gets its answer.
const LINGER: Duration = Duration::from_secs(1);

/// A certificate with its key cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", file.display())]
pub struct TlsError {
    /// The file that is wrong.
    pub file: PathBuf,
    /// What is wrong with it.
    pub cause: TlsCause,
}

/// What is wrong with a file of TLS.
#[derive(Debug, thiserror::Error)]
pub enum TlsCause {
    /// It cannot be read.
    #[error("cannot read it: {0}")]
    Read(io::Error),
    /// It is larger than any certificate.
    #[error("it is larger than 1 MiB: is it the right file?")]
    TooLarge,
    /// It has no certificate.
    #[error("there is no certificate in it: PEM is needed, with the line -----BEGIN CERTIFICATE-----")]
    NoCertificate,
    /// It has no private key.
    #[error(
        "there is no private key in it: PEM is needed, with the line -----BEGIN PRIVATE KEY-----; \
         one with a password cannot be used"
    )]
    NoKey,
    /// Its PEM is cut or damaged.
    #[error("its PEM is cut or damaged")]
    Pem,
    /// The key is that of another certificate.
    #[error("this key does not belong to the certificate")]
    OtherKey,
    /// The TLS library refuses it.
    #[error("{0}")]
    Refused(rustls::Error),
}

/// A certificate and its key, read from files.
#[derive(Debug)]
pub struct Tls {
    certificate: PathBuf,
    key: PathBuf,
    current: Mutex<Current>,
}

/// What was read last.
#[derive(Clone, Debug)]
struct Current {
    config: Arc<ServerConfig>,
    /// SHA-256 of both files.
    content: [u8; 32],
    /// From when and until when the certificate is valid, where it says so.
    validity: Option<[Utc; 2]>,
}

impl Tls {
    /// Reads the certificate with those of its issuers (PEM, its own first), and its key (PEM, without a password).
    ///
    /// # Errors
    /// A file cannot be read, is no PEM, or they do not belong together.
    pub fn read(certificate: &Path, key: &Path) -> Result<Self, TlsError> {
        let current = Current::of(certificate, key, &read(certificate)?, &read(key)?)?;
        Ok(Self { certificate: certificate.to_owned(), key: key.to_owned(), current: Mutex::new(current) })
    }

    /// Reads the files again. Returns whether there is something new in them.
    ///
    /// # Errors
    /// As those of [`Tls::read`]; the certificate stays.
    fn renew(&self) -> Result<bool, TlsError> {
        let (certificate, key) = (read(&self.certificate)?, read(&self.key)?);
        if lock(&self.current).content == digest(&certificate, &key) {
            return Ok(false);
        }
        let new = Current::of(&self.certificate, &self.key, &certificate, &key)?;
        *lock(&self.current) = new;
        Ok(true)
    }

    /// Reads the files again whenever this time has passed, and logs what comes of it.
    pub(crate) async fn keep_renewed(self: Arc<Self>, every: Duration) {
        // Each is logged once.
        let (mut failure, mut warning) = (None, None);
        loop {
            let new = lock(&self.current).warning(Utc::now());
            if new != warning {
                if let Some(new) = &new {
                    log::warn!("{}: {new}", self.certificate.display());
                }
                warning = new;
            }
            tokio::time::sleep(every).await;
            let tls = self.clone();
            // Files may be on a disk that sleeps.
            match tokio::task::spawn_blocking(move || tls.renew()).await {
                Ok(Ok(is_new)) => {
                    if is_new {
                        log::info!("{}: new connections get the new certificate", self.certificate.display());
                    }
                    failure = None;
                }
                Ok(Err(error)) => {
                    let new = error.to_string();
                    if failure.as_ref() != Some(&new) {
                        log::error!("{new}; the certificate from before stays in use");
                    }
                    failure = Some(new);
                }
                Err(error) => log::error!("the certificate cannot be read again: {error}"),
            }
        }
    }

    /// Makes an encrypted connection of one that was accepted. A client of plain HTTP gets `plain_answer`.
    pub(crate) async fn accept(&self, mut stream: TcpStream, plain_answer: &str) -> io::Result<TlsStream<TcpStream>> {
        let mut first = [0];
        if stream.peek(&mut first).await? == 1 && first != [HANDSHAKE] {
            if first[0].is_ascii_alphabetic() {
                refuse_plain(&mut stream, plain_answer).await?;
            }
            return Err(io::Error::new(io::ErrorKind::InvalidData, "the client does not begin with TLS"));
        }
        let config = lock(&self.current).config.clone();
        TlsAcceptor::from(config).accept(stream).await
    }
}

impl Current {
    fn of(certificate_file: &Path, key_file: &Path, certificate: &[u8], key: &[u8]) -> Result<Self, TlsError> {
        let wrong = |file: &Path, cause| TlsError { file: file.to_owned(), cause };
        let content = digest(certificate, key);
        let chain = certificates(certificate).map_err(|cause| wrong(certificate_file, cause))?;
        let validity = chain.first().and_then(|own| Certificate::from_der(own).ok()).map(|own| {
            let validity = own.tbs_certificate().validity();
            [utc(validity.not_before), utc(validity.not_after)]
        });
        let key = PrivateKeyDer::from_pem_slice(key).map_err(|error| {
            wrong(key_file, if matches!(error, pem::Error::NoItemsFound) { TlsCause::NoKey } else { TlsCause::Pem })
        })?;
        let refused = |error| match error {
            rustls::Error::InconsistentKeys(_) => wrong(key_file, TlsCause::OtherKey),
            rustls::Error::InvalidCertificate(_) => wrong(certificate_file, TlsCause::Refused(error)),
            error => wrong(key_file, TlsCause::Refused(error)),
        };
        let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .and_then(|builder| builder.with_no_client_auth().with_single_cert(chain, key))
            .map_err(refused)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(Self { config: Arc::new(config), content, validity })
    }

    /// What is wrong with the certificate now.
    fn warning(&self, now: Utc) -> Option<String> {
        let [from, to] = self.validity?;
        if now < from {
            return Some(format!("the certificate is not valid before {from}: is the clock right?"));
        }
        (now > to).then(|| format!("the certificate expired on {to}: clients refuse it"))
    }
}

/// The certificates in a file, of which there is at least one.
///
/// # Errors
/// The file cannot be read, or is no PEM.
pub fn read_certificates(file: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    certificates(&read(file)?).map_err(|cause| TlsError { file: file.to_owned(), cause })
}

fn certificates(pem: &[u8]) -> Result<Vec<CertificateDer<'static>>, TlsCause> {
    // What the parser says may have a part of the file in it.
    let chain = CertificateDer::pem_slice_iter(pem).collect::<Result<Vec<_>, _>>().map_err(|_| TlsCause::Pem)?;
    if chain.is_empty() { Err(TlsCause::NoCertificate) } else { Ok(chain) }
}

fn read(file: &Path) -> Result<Vec<u8>, TlsError> {
    let wrong = |cause| TlsError { file: file.to_owned(), cause };
    let mut bytes = Vec::new();
    let opened = File::open(file).and_then(|opened| opened.take(LARGEST + 1).read_to_end(&mut bytes));
    match opened {
        Ok(length) if length as u64 <= LARGEST => Ok(bytes),
        Ok(_) => Err(wrong(TlsCause::TooLarge)),
        Err(error) => Err(wrong(TlsCause::Read(error))),
    }
}

fn digest(certificate: &[u8], key: &[u8]) -> [u8; 32] {
    let parts = [certificate, key].map(|part| <[u8; 32]>::from(Sha256::digest(part)));
    Sha256::digest(parts.concat()).into()
}

fn utc(time: Time) -> Utc {
    Utc::clamped(i64::try_from(time.to_unix_duration().as_micros()).unwrap_or(i64::MAX))
}

/// Answers a request that came without TLS.
async fn refuse_plain(stream: &mut TcpStream, answer: &str) -> io::Result<()> {
    stream.write_all(answer.as_bytes()).await?;
    stream.shutdown().await?;
    // Closed with something unread, the connection would be reset, and the answer lost.
    let mut rest = [0; 1024];
    let drain = async { while stream.read(&mut rest).await.is_ok_and(|count| count > 0) {} };
    // Who goes on sending is cut.
    let _ = tokio::time::timeout(LINGER, drain).await;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_certificate_is_warned_of_before_and_after_it_is_valid() {
        let key = rcgen::KeyPair::generate().unwrap();
        let mut parameters = rcgen::CertificateParams::new(["localhost".to_owned()]).unwrap();
        parameters.not_before = rcgen::date_time_ymd(2024, 3, 1);
        parameters.not_after = rcgen::date_time_ymd(2025, 3, 1);
        let certificate = parameters.self_signed(&key).unwrap();
        let [file, key_file] = ["certificate.pem", "key.pem"].map(Path::new);
        let (certificate, key) = (certificate.pem(), key.serialize_pem());
        let current = Current::of(file, key_file, certificate.as_bytes(), key.as_bytes()).unwrap();
        let warning = |time: &str| current.warning(time.parse().unwrap()).unwrap_or_default();
        assert!(warning("2024-02-29T23:59:59Z").contains("not valid before 2024-03-01T00:00:00Z"));
        assert_eq!([warning("2024-03-01T00:00:00Z"), warning("2025-03-01T00:00:00Z")], ["", ""]);
        assert!(warning("2025-03-01T00:00:01Z").contains("expired on 2025-03-01T00:00:00Z"));
    }
}
