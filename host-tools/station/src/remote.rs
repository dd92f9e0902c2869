//! The state of a running station, by its API.
//!
//! A request is one of HTTP/1.0 with a connection of its own, whose end is the end of the answer: no library is needed
//! for that. There is no TLS here; a tunnel of SSH leads to a station elsewhere.

use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::Path;
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use serde::de::DeserializeOwned;
use station_core::Utc;
use station_core::model::SiteMap;

use super::screen::Snapshot;
use recording::UserError;
use recording::read_text;

/// How long a station may take to answer.
const PATIENCE: Duration = Duration::from_secs(5);
/// The greatest answer, bytes: thousands of tags.
const GREATEST: u64 = 1 << 26;
/// The usual port of HTTP.
const PORT: u16 = 80;

/// A running station.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Remote {
    /// Host and, where it is given, port.
    authority: String,
    token: Option<String>,
}

impl FromStr for Remote {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("{text:?} is not http://HOST:PORT; with TLS or from elsewhere, ssh -L makes a tunnel");
        let authority = text.strip_prefix("http://").ok_or_else(wrong)?.trim_end_matches('/');
        let is_authority = |c: char| c.is_ascii_alphanumeric() || ".-_:[]".contains(c);
        if authority.is_empty() || !authority.chars().all(is_authority) {
            return Err(wrong());
        }
        Ok(Self { authority: authority.to_owned(), token: None })
    }
}

impl Remote {
    /// The same station, asked with the token in a file.
    ///
    /// # Errors
    /// The file cannot be read, or has something else.
    pub fn with_token(self, file: &Path) -> Result<Self, UserError> {
        let token = read_text(file)?.trim().to_owned();
        if token.is_empty() || !token.chars().all(|c| c.is_ascii_graphic()) {
            return Err(UserError::file(file, "a token is one word, on one line"));
        }
        Ok(Self { token: Some(token), ..self })
    }

    /// What the station knows now.
    ///
    /// # Errors
    /// It does not answer, or refuses.
    pub fn snapshot(&self) -> Result<Snapshot> {
        Ok(Snapshot {
            tags: self.get("/api/v1/tags")?,
            nodes: self.get("/api/v1/nodes")?,
            zones: self.get("/api/v1/rooms")?,
            now: Utc::now(),
        })
    }

    /// The sites with their walls.
    ///
    /// # Errors
    /// It does not answer, or refuses.
    pub fn sites(&self) -> Result<Vec<SiteMap>> {
        self.get("/scenarios")
    }

    fn get<T: DeserializeOwned>(&self, path: &str) -> Result<T> {
        let answer = self.ask(path).with_context(|| format!("no answer of http://{}", self.authority))?;
        let split = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n");
        let (head, body) = answer.split_at(split.with_context(|| format!("{} speaks no HTTP", self.authority))?);
        let status = String::from_utf8_lossy(head).split_whitespace().nth(1).map(str::to_owned);
        match status.as_deref() {
            Some("200") => {}
            Some("401" | "403") => bail!("{} wants a token: --token-file FILE", self.authority),
            other => bail!("{} answers {path} with {}", self.authority, other.unwrap_or("nothing")),
        }
        let body = body.get(4..).unwrap_or_default();
        serde_json::from_slice(body).with_context(|| format!("{} answers {path} with something else", self.authority))
    }

    fn ask(&self, path: &str) -> Result<Vec<u8>> {
        let has_port = self.authority.rsplit_once(':').is_some_and(|(_, port)| !port.contains(']'));
        let place = if has_port { self.authority.clone() } else { format!("{}:{PORT}", self.authority) };
        let addresses = place.to_socket_addrs()?;
        let mut connection = Err(anyhow::anyhow!("there is no such host"));
        for address in addresses {
            connection = TcpStream::connect_timeout(&address, PATIENCE).map_err(Into::into);
            if connection.is_ok() {
                break;
            }
        }
        let mut connection = connection?;
        connection.set_read_timeout(Some(PATIENCE))?;
        connection.set_write_timeout(Some(PATIENCE))?;
        let token = self.token.iter().map(|token| format!("Authorization: Bearer {token}\r\n")).collect::<String>();
        write!(connection, "GET {path} HTTP/1.0\r\nHost: {}\r\n{token}\r\n", self.authority)?;
        let mut answer = Vec::new();
        connection.take(GREATEST).read_to_end(&mut answer)?;
        Ok(answer)
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader};
    use std::net::TcpListener;
    use std::thread::{JoinHandle, spawn};

    use super::*;

    /// A server that gives one answer. Returns its station, and what it is asked.
    fn answering(answer: &'static str) -> (Remote, JoinHandle<Vec<String>>) {
        let server = TcpListener::bind("127.0.0.1:0").expect("a port");
        let remote = format!("http://{}/", server.local_addr().expect("an address")).parse().expect("a URL");
        let asked = spawn(move || {
            let (mut connection, _) = server.accept().expect("a client");
            let lines = BufReader::new(connection.try_clone().expect("a copy")).lines().map_while(Result::ok);
            let asked = lines.take_while(|line| !line.is_empty()).collect();
            connection.write_all(answer.as_bytes()).expect("taken");
            asked
        });
        (remote, asked)
    }

    #[test]
    fn the_token_goes_along_and_the_answer_is_read_to_its_end() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("token");
        std::fs::write(&file, "abc\n").expect("written");
        let (remote, asked) =
            answering("HTTP/1.0 200 OK\r\ncontent-type: application/json\r\n\r\n[{\"name\": \"hall\"}]");
        let sites = remote.with_token(&file).expect("a token").sites().expect("an answer");
        assert_eq!(sites, [SiteMap::new("hall")]);
        let asked = asked.join().expect("asked");
        assert_eq!(asked[0], "GET /scenarios HTTP/1.0");
        assert!(asked.contains(&"Authorization: Bearer abc".to_owned()), "{asked:?}");
        std::fs::write(&file, "a\r\nHost: b").expect("written");
        assert!("http://a".parse::<Remote>().expect("a URL").with_token(&file).is_err());
    }

    #[test]
    fn what_is_no_answer_of_a_station_is_told() {
        for (answer, expected) in [
            ("HTTP/1.0 401 Unauthorized\r\n\r\n", "--token-file"),
            ("HTTP/1.0 503 Service Unavailable\r\n\r\n", "503"),
            ("SSH-2.0-OpenSSH\r\n", "no HTTP"),
            ("HTTP/1.0 200 OK\r\n\r\n<html>", "something else"),
        ] {
            let error = format!("{:#}", answering(answer).0.sites().expect_err("none"));
            assert!(error.contains(expected), "{error}");
        }
        let closed = TcpListener::bind("127.0.0.1:0").and_then(|server| server.local_addr()).expect("a port");
        let error = format!("http://{closed}").parse::<Remote>().expect("a URL").sites().expect_err("none").to_string();
        assert!(error.contains(&closed.to_string()), "{error}");
        for wrong in ["https://a", "a:80", "http://", "http://a b", "http://a\r\nHost: c"] {
            assert!(wrong.parse::<Remote>().is_err(), "{wrong}");
        }
    }
}
