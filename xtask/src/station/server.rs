//! A running `baliza serve`, as a user starts it.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use serde_json::Value;

use crate::{cargo, root, succeed, target_directory};

/// The longest wait for anything.
const PATIENCE: Duration = Duration::from_secs(60);
/// The time between two questions.
const AGAIN: Duration = Duration::from_millis(50);

/// The station with all features. `BALIZA_BUILT` says that `cargo test` has built it.
///
/// # Errors
/// It cannot be built.
pub fn program() -> Result<PathBuf> {
    if std::env::var_os("BALIZA_BUILT").is_some() {
        return Ok(in_target("debug"));
    }
    built(&["--features", "foxglove"], "debug")
}

/// The station as users install it.
///
/// # Errors
/// It cannot be built.
pub fn optimised() -> Result<PathBuf> {
    built(&["--release"], "release")
}

fn built(arguments: &[&str], folder: &str) -> Result<PathBuf> {
    succeed(cargo().args(["build", "--package", "baliza-station"]).args(arguments).current_dir(root()))?;
    Ok(in_target(folder))
}

fn in_target(folder: &str) -> PathBuf {
    target_directory().join(folder).join("baliza-station").with_extension(std::env::consts::EXE_EXTENSION)
}

/// A station on a free port of loopback, which is killed in the end, with a folder that is deleted then.
pub struct Server {
    child: Child,
    /// `127.0.0.1:PORT`.
    pub address: String,
    folder: PathBuf,
}

impl Server {
    /// Starts it with these arguments besides the address, in a folder with this file.
    pub fn start(arguments: &[&str], file: (&str, &str)) -> Result<Self> {
        Self::run(&program()?, arguments, file)
    }

    /// The same with this program.
    pub fn run(program: &Path, arguments: &[&str], (file, text): (&str, &str)) -> Result<Self> {
        let folder = std::env::temp_dir().join(format!("baliza-station-{}", std::process::id()));
        fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        fs::write(folder.join(file), text).with_context(|| format!("cannot write {file}"))?;
        let mut command = Command::new(program);
        command.args(["serve", "--listen", "127.0.0.1:0"]).args(arguments).current_dir(&folder);
        let mut child =
            command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().context("baliza does not start")?;
        let mut said = BufReader::new(child.stderr.take().context("no standard error")?);
        let mut line = String::new();
        let address = loop {
            if said.read_line(&mut line)? == 0 {
                bail!("baliza has ended: {line}");
            }
            if let Some((_, address)) = line.trim_end().split_once("listening on http://") {
                break address.to_owned();
            }
        };
        // Its log has a line for each change. Without a reader, the station would wait.
        thread::spawn(move || std::io::copy(&mut said, &mut std::io::sink()));
        Ok(Self { child, address, folder })
    }

    /// The number of its process.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Its standard input.
    pub fn input(&mut self) -> Result<ChildStdin> {
        self.child.stdin.take().context("its input is taken")
    }

    /// The status and the body of an answer.
    pub fn ask(&self, method: &str, path: &str, body: &str) -> Result<(u16, String)> {
        let mut connection = TcpStream::connect(&self.address).context("it does not listen")?;
        connection.set_read_timeout(Some(PATIENCE))?;
        let length = body.len();
        write!(
            connection,
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nContent-Type: application/json\r\n\
             Content-Length: {length}\r\n\r\n{body}",
            self.address
        )?;
        let mut text = String::new();
        connection.read_to_string(&mut text).with_context(|| format!("{path}: no answer"))?;
        let (head, body) = text.split_once("\r\n\r\n").with_context(|| format!("{path}: no head"))?;
        let status = head.split_whitespace().nth(1).and_then(|status| status.parse().ok());
        Ok((status.with_context(|| format!("{path}: no status"))?, body.to_owned()))
    }

    /// An object of the API; None: it is refused.
    pub fn json(&self, path: &str) -> Result<Option<Value>> {
        let (status, body) = self.ask("GET", path, "")?;
        (status == 200).then(|| serde_json::from_str(&body).with_context(|| format!("{path}: {body}"))).transpose()
    }

    /// Asks until there is an answer.
    pub fn wait<T>(&self, what: &str, ask: impl Fn(&Self) -> Result<Option<T>>) -> Result<T> {
        let begun = Instant::now();
        loop {
            if let Some(answer) = ask(self)? {
                return Ok(answer);
            }
            if begun.elapsed() > PATIENCE {
                bail!("{what}: not within {} s", PATIENCE.as_secs());
            }
            thread::sleep(AGAIN);
        }
    }

    /// Ends it as `kill` does: it must write everything, and say that all was well.
    pub fn stop(mut self) -> Result<()> {
        succeed(Command::new("kill").arg(self.child.id().to_string()))?;
        let status = self.child.wait()?;
        if !status.success() {
            bail!("baliza ended with {status}");
        }
        Ok(())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // It has ended already, or there is nobody to tell.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = fs::remove_dir_all(&self.folder);
    }
}
