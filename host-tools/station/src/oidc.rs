//! The file of `--oidc`: the provider of sign-ins, and what its users may do.

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use station_core::oidc::{Oidc, OidcSettings, Patience, Roles};

use recording::UserError;
use recording::read_text;

/// The lengths that a session may have, hours.
const SESSION_H: std::ops::RangeInclusive<u64> = 1..=720;

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    issuer: String,
    client_id: String,
    client_secret: Option<String>,
    client_secret_file: Option<PathBuf>,
    public_url: String,
    #[serde(default = "profile")]
    scopes: Vec<String>,
    #[serde(default = "groups")]
    claim: String,
    roles: Roles,
    ca: Option<PathBuf>,
    #[serde(default = "half_a_day")]
    session_h: u64,
    #[serde(default)]
    end_session: bool,
}

fn profile() -> Vec<String> {
    vec!["profile".to_owned()]
}

fn groups() -> String {
    "groups".to_owned()
}

fn half_a_day() -> u64 {
    12
}

/// Reads the file. Those that `client_secret_file` and `ca` name are beside it.
///
/// # Errors
/// A file cannot be read, others may read the secret, or something in it is wrong.
pub fn read_oidc(file: &Path) -> Result<Oidc, UserError> {
    let wrong = |what: String| UserError::file(file, what);
    let text = read_text(file)?;
    let read: File = toml::from_str(&text).map_err(|error| {
        UserError::secret_toml(file, &text, &error, "a provider has issuer, client_id, public_url and [roles]")
    })?;
    let beside = |named: &Path| file.parent().unwrap_or(Path::new("")).join(named);
    let client_secret = match (read.client_secret, read.client_secret_file) {
        (Some(_), Some(_)) => {
            return Err(wrong("client_secret and client_secret_file: one of them is enough".to_owned()));
        }
        (Some(secret), None) => {
            check_private(file)?;
            Some(secret)
        }
        (None, Some(named)) => {
            let named = beside(&named);
            let secret = read_text(&named)?.trim_end_matches(['\r', '\n']).to_owned();
            check_private(&named)?;
            if secret.is_empty() {
                return Err(UserError::file(&named, "it is empty: it has the client's secret at the provider"));
            }
            Some(secret)
        }
        (None, None) => None,
    };
    if !SESSION_H.contains(&read.session_h) {
        return Err(wrong(format!("session_h: {} is not between 1 and 720 hours", read.session_h)));
    }
    let settings = OidcSettings {
        issuer: read.issuer,
        client_id: read.client_id,
        client_secret,
        public_url: read.public_url,
        scopes: read.scopes,
        claim: read.claim,
        roles: read.roles,
        ca: read.ca.as_deref().map(beside),
        session: Duration::from_secs(3600 * read.session_h),
        end_session: read.end_session,
    };
    Oidc::new(settings, Patience::default()).map_err(|error| wrong(error.to_string()))
}

/// Whether only the owner and the group may read a file with a secret. What systemd hands over belongs to a group.
fn check_private(file: &Path) -> Result<(), UserError> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let read =
            std::fs::metadata(file).map_err(|error| UserError::file(file, format!("cannot read it: {error}")))?;
        if read.permissions().mode() & 0o007 != 0 {
            let what = "everyone on this computer may read the client's secret in it: chmod o= takes that away";
            return Err(UserError::file(file, what));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const PROVIDER: &str = "issuer = \"https://id.example.org/realms/house\"\nclient_id = \"baliza\"\n\
                            public_url = \"https://station.example.org\"\n";
    const ROLES: &str = "[roles]\nview = [\"staff\"]\nadminister = [\"admins\"]\n";

    /// Reads the text from a file with this mode.
    fn read(text: &str, mode: u32) -> Result<Oidc, UserError> {
        let folder = tempfile::tempdir().expect("a folder");
        let put = |name: &str, text: &str| {
            let file = folder.path().join(name);
            std::fs::write(&file, text).expect("written");
            #[cfg(unix)]
            {
                use std::os::unix::fs::PermissionsExt;
                std::fs::set_permissions(&file, std::fs::Permissions::from_mode(mode)).expect("a mode");
            }
            file
        };
        put("secret", "private\n");
        put("empty", "\n");
        read_oidc(&put("oidc.toml", text))
    }

    #[test]
    fn a_provider_has_defaults_and_its_secret_is_in_the_file_or_beside_it() {
        let oidc = read(&format!("{PROVIDER}{ROLES}"), 0o644).expect("no secret: everyone may read it");
        assert_eq!(oidc.login_url(), "https://station.example.org/oidc/login");
        assert_eq!(oidc.session(), Duration::from_secs(12 * 3600));
        for mode in [0o600, 0o640] {
            assert!(read(&format!("{PROVIDER}client_secret = \"private\"\n{ROLES}"), mode).is_ok());
            assert!(read(&format!("{PROVIDER}client_secret_file = \"secret\"\n{ROLES}"), mode).is_ok());
        }
        let all = "client_secret = \"private\"\nscopes = [\"groups\", \"email\"]\nclaim = \"a.b\"\nsession_h = 1\n\
                   end_session = true\n";
        assert_eq!(read(&format!("{PROVIDER}{all}{ROLES}"), 0o600).expect("all").session().as_secs(), 3600);
    }

    #[test]
    fn wrong_files_are_refused_with_what_to_do_and_without_their_secrets() {
        let with = |line: &str| format!("{PROVIDER}{line}\n{ROLES}");
        for (text, mode, expected) in [
            (String::new(), 0o600, "missing field `issuer`"),
            (PROVIDER.to_owned(), 0o600, "missing field `roles`"),
            (format!("{PROVIDER}[roles]\n"), 0o600, "no value gives a role"),
            (format!("{PROVIDER}[roles]\nview = [\"all\"]\noperate = [\"all\"]\n"), 0o600, "\"all\" is there twice"),
            (format!("{PROVIDER}[roles]\nroot = [\"all\"]\n"), 0o600, "administer"),
            (with("client_secret = \"private\""), 0o644, "chmod o="),
            (with("client_secret_file = \"secret\""), 0o644, "chmod o="),
            (with("client_secret_file = \"missing\""), 0o600, "missing: cannot open it"),
            (with("client_secret_file = \"empty\""), 0o600, "empty"),
            (with("client_secret = \"private\"\nclient_secret_file = \"secret\""), 0o600, "one of them"),
            (with("client_secret = private"), 0o600, ":4: "),
            (with("ca = \"missing.pem\""), 0o600, "missing.pem: cannot read it"),
            (with("session_h = 0"), 0o600, "session_h"),
            (with("").replace("https://id", "http://id"), 0o600, "without https"),
            (with("").replace("https://id", "id"), 0o600, "issuer: it is no address"),
            (with("").replace("station.example.org", "station.example.org/map"), 0o600, "public_url: "),
            (with("").replace("https://station", "ftp://station"), 0o600, "public_url: it must begin"),
            (with("").replace("\"baliza\"", "\"\""), 0o600, "client_id is empty"),
        ] {
            if cfg!(not(unix)) && expected.starts_with("chmod") {
                continue;
            }
            let error = read(&text, mode).expect_err(&text).to_string();
            assert!(error.contains(expected) && !error.contains("private"), "{error}");
        }
    }
}
