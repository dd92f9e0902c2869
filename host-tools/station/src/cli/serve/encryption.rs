//! `--tls-cert` and `--tls-key`: encrypted connections.

use std::path::PathBuf;
use std::sync::Arc;

use recording::UserError;
use station_core::api::Tls;

/// The files of TLS.
#[derive(clap::Args)]
pub struct Encryption {
    /// Serve HTTPS with this certificate, its own first and then those of its issuers: PEM, such as certbot's
    /// fullchain.pem. It is read again when it changes
    #[arg(long, value_name = "FILE", requires = "tls_key")]
    tls_cert: Option<PathBuf>,
    /// The certificate's private key: PEM without a password, such as certbot's privkey.pem
    #[arg(long, value_name = "FILE", requires = "tls_cert")]
    tls_key: Option<PathBuf>,
}

impl Encryption {
    /// Reads the files; `None` where connections are not encrypted.
    ///
    /// # Errors
    /// A file is wrong.
    pub fn read(&self) -> Result<Option<Arc<Tls>>, UserError> {
        let (Some(certificate), Some(key)) = (&self.tls_cert, &self.tls_key) else { return Ok(None) };
        let tls = Tls::read(certificate, key).map_err(|error| UserError::file(&error.file, error.cause.to_string()))?;
        Ok(Some(Arc::new(tls)))
    }
}
