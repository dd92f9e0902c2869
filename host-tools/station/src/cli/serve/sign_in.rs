//! The flags of `baliza serve` for who may use the station.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use crate::{read_oidc, read_tokens};
use recording::UserError;
use station_core::api::{Access, IpNetwork, Proxies};
use station_core::oidc::Oidc;

/// The flags.
#[derive(clap::Args)]
pub struct SignInArguments {
    /// Who may do what: a TOML file with a table `token` for each, as docs/use/station/README.md describes it
    #[arg(long, value_name = "FILE")]
    tokens: Option<PathBuf>,
    /// Let people sign in at a provider of OpenID Connect: a TOML file, as docs/use/station/network.md describes it
    #[arg(long, value_name = "FILE")]
    oidc: Option<PathBuf>,
    /// A reverse proxy in front of the station: the client's address is what it says in X-Forwarded-For or Forwarded.
    /// May be given for each of several
    #[arg(long, value_name = "IP[/BITS]")]
    trusted_proxy: Vec<IpNetwork>,
}

/// Who may use the station.
pub struct Users {
    pub access: Access,
    pub oidc: Option<Arc<Oidc>>,
    pub proxies: Proxies,
}

impl SignInArguments {
    /// Who may do what. Everyone may do everything where only this computer can reach the station, at `listen`.
    ///
    /// # Errors
    /// A file is wrong, or users would have no way to sign in.
    pub fn read(&self, listen: SocketAddr) -> Result<Users, UserError> {
        let oidc = self.oidc.as_deref().map(read_oidc).transpose()?.map(Arc::new);
        let access = match &self.tokens {
            Some(file) => read_tokens(file)?,
            None if oidc.is_some() => Access::Tokens(Vec::new()),
            None if listen.ip().is_loopback() => Access::Open,
            None => {
                let what =
                    format!("{listen} can be reached from other computers: give --tokens FILE or --oidc FILE as well");
                return Err(UserError::flag("--listen", what));
            }
        };
        Ok(Users { access, oidc, proxies: Proxies(self.trusted_proxy.clone()) })
    }
}
