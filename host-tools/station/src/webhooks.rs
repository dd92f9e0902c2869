//! The file of webhooks: where events go.

use std::path::Path;

use serde::Deserialize;
use station_core::webhooks::{Webhook, WebhookSettings};

use recording::UserError;
use recording::read_text;

/// The file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    webhook: Vec<WebhookSettings>,
}

/// Reads the hooks of a file: `[[webhook]]` with the keys of [`WebhookSettings`]. The file that `ca` names is beside it.
///
/// # Errors
/// The file cannot be read, or something in it is wrong.
pub fn read_webhooks(file: &Path) -> Result<Vec<Webhook>, UserError> {
    let wrong = |what: String| UserError::file(file, what);
    let text = read_text(file)?;
    let File { webhook } = toml::from_str(&text)
        .map_err(|error| UserError::secret_toml(file, &text, &error, "a hook is [[webhook]] with name and url"))?;
    let mut names: Vec<&str> = Vec::new();
    for WebhookSettings { name, .. } in &webhook {
        if names.contains(&name.as_str()) {
            return Err(wrong(format!("{name}: this name is there twice")));
        }
        names.push(name);
    }
    if webhook.is_empty() {
        return Err(wrong("there is no [[webhook]]".to_owned()));
    }
    let folder = file.parent().unwrap_or(Path::new(""));
    let hooks = webhook.into_iter().map(|settings| {
        let name = settings.name.clone();
        let ca = settings.ca.as_ref().map(|ca| folder.join(ca));
        Webhook::new(WebhookSettings { ca, ..settings }).map_err(|error| wrong(format!("{name}: {error}")))
    });
    hooks.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Webhook>, UserError> {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("webhooks.toml");
        std::fs::write(&file, text).expect("written");
        read_webhooks(&file)
    }

    const HOOK: &str = "[[webhook]]\nname = \"house\"\nurl = \"http://house.local:8123/api/webhook/private\"\n";

    #[test]
    fn a_hook_needs_a_name_and_an_address_and_takes_the_rest() {
        let all = "secret = \"whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\"\nkinds = [\"entered\", \"low-supply\"]\n\
                   sites = [\"site\"]\nzones = [\"dock\"]\nalarms_only = true\n";
        assert_eq!(read(HOOK).expect("a hook").len(), 1);
        assert_eq!(read(&format!("{HOOK}{all}")).expect("a hook").len(), 1);
    }

    #[test]
    fn wrong_files_are_refused_with_what_to_do_and_without_their_secrets() {
        for (text, expected) in [
            (String::new(), "missing field `webhook`"),
            ("webhook = []".to_owned(), "no [[webhook]]"),
            (HOOK.repeat(2), "twice"),
            (HOOK.replace("http:", "ftp:"), "https://example.org"),
            (format!("{HOOK}secret = \"private\"\n"), "openssl rand"),
            (format!("{HOOK}kinds = [\"exploded\"]\n"), "entered"),
            (format!("{HOOK}ca = \"missing.pem\"\n"), "missing.pem: cannot read it"),
            (format!("{HOOK}url = \"http://private\"\n"), ":4: "),
            (format!("{HOOK}private\n"), ":4: "),
        ] {
            let error = read(&text).expect_err(&text).to_string();
            assert!(error.contains(expected) && !error.contains("private"), "{error}");
        }
    }
}
