//! The station's page, store and API: the committed build of the page, its tests in a browser, the store's tests
//! against a real PostgreSQL, which is killed under load in the end, positions on maps, and requests that are made at
//! random.

pub mod bench;
mod fuzz;
mod load;
mod maps;
mod outage;
mod server;

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use crate::{root, succeed, test_programs};

/// The environment variable by which the tests of the store find a PostgreSQL.
const POSTGRES: &str = "BALIZA_TEST_POSTGRES";
/// The environment variable by which the tests of the page find the program.
const BALIZA: &str = "BALIZA";
/// A server that was killed is tried to be started again for this time: what it leaves must end first.
const AGAIN: Duration = Duration::from_secs(30);
/// Where Debian puts the programs of each version of PostgreSQL.
const POSTGRES_PROGRAMS: &str = "/usr/lib/postgresql";
/// The user that owns the server where the chore is run by root, as whom it refuses to run.
const POSTGRES_USER: &str = "postgres";

/// Requests of all checks together, where no number is asked for: one round as each role, about a minute.
const FUZZ: u32 = 3000;

/// The arguments of `cargo xtask station`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only make this number of requests at random.
    #[arg(long, value_name = "REQUESTS")]
    fuzz: Option<u32>,
    /// Only kill the database of a station that runs.
    #[arg(long, conflicts_with = "fuzz")]
    outage: bool,
    /// Only read what the station sends to maps.
    #[arg(long, conflicts_with_all = ["fuzz", "outage"])]
    maps: bool,
}

/// Builds the page and tests it, then tests the store and the API.
///
/// # Errors
/// A program is missing, the committed build of the page is not what its sources give, or a test fails.
pub fn run(arguments: &Arguments) -> Result<()> {
    if let Some(requests) = arguments.fuzz {
        return fuzz::run(requests);
    }
    if arguments.outage {
        return outage::survived(&Postgres::start()?);
    }
    if arguments.maps {
        return maps::run();
    }
    page()?;
    store()?;
    maps::run()?;
    fuzz::run(FUZZ)
}

/// Builds the page from its sources, compares it with the committed build, and runs its tests.
fn page() -> Result<()> {
    let web = root().join("station/web");
    let npm = |arguments: &[&str]| succeed(Command::new("npm").args(arguments).current_dir(&web));
    npm(&["ci", "--no-audit", "--no-fund"]).context("npm is needed (apt-get install nodejs npm)")?;
    npm(&["run", "build"])?;
    let changed = Command::new("git").args(["status", "--porcelain", "--", "dist"]).current_dir(&web).output()?;
    if !changed.status.success() || !changed.stdout.is_empty() {
        let files = String::from_utf8_lossy(&changed.stdout);
        bail!("station/web/dist is not what its sources give: commit what `npm run build` has made\n{files}");
    }
    succeed(Command::new("npm").arg("test").current_dir(&web).env(BALIZA, server::program()?))
}

/// Runs the tests of the station with a PostgreSQL of their own, which is killed in the end.
fn store() -> Result<()> {
    let server = Postgres::start()?;
    for tests in test_programs::all()?.iter().filter(|program| program.is_of("station")) {
        println!("{}", tests.name);
        succeed(tests.command().env(POSTGRES, server.url()))?;
    }
    outage::survived(&server)
}

/// A PostgreSQL on loopback with an empty database, which is stopped and deleted in the end.
struct Postgres {
    programs: PathBuf,
    folder: PathBuf,
    port: u16,
}

impl Postgres {
    fn start() -> Result<Self> {
        let programs = programs().context("PostgreSQL is needed (apt-get install postgresql)")?;
        let folder = std::env::temp_dir().join(format!("baliza-postgres-{}", std::process::id()));
        let port = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr()).context("no free port")?.port();
        fs::create_dir(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
        let server = Self { programs, folder, port };
        if is_root() {
            succeed(Command::new("chown").arg(POSTGRES_USER).arg(&server.folder))?;
        }
        let data = server.data();
        succeed(server.program("initdb").args(["--auth=trust", "--no-sync", "--username=postgres", "-D"]).arg(&data))?;
        server.serve()?;
        Ok(server)
    }

    /// Starts the server on its data.
    fn serve(&self) -> Result<()> {
        let options = format!("-p {} -c listen_addresses=127.0.0.1 -k {}", self.port, self.folder.display());
        let log = self.folder.join("log");
        let mut start = self.program("pg_ctl");
        succeed(start.args(["start", "--wait", "-D"]).arg(self.data()).arg("-l").arg(log).args(["-o", &options]))
    }

    /// Ends the server without any warning (SIGKILL); its children end with it.
    fn kill(&self) -> Result<()> {
        let file = self.data().join("postmaster.pid");
        let text = fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
        let pid = text.lines().next().with_context(|| format!("{}: no process", file.display()))?;
        succeed(Command::new("kill").args(["-KILL", pid]))
    }

    /// Starts the server again after a kill.
    fn serve_again(&self) -> Result<()> {
        let begun = Instant::now();
        loop {
            match self.serve() {
                Err(_) if begun.elapsed() < AGAIN => {}
                started => return started,
            }
        }
    }

    fn url(&self) -> String {
        format!("postgres://postgres@127.0.0.1:{}/postgres", self.port)
    }

    fn data(&self) -> PathBuf {
        self.folder.join("data")
    }

    /// One of the server's programs, as a user who may run it.
    fn program(&self, name: &str) -> Command {
        let program = self.programs.join(name);
        let mut command = if is_root() {
            let mut command = Command::new("runuser");
            command.args(["-u", POSTGRES_USER, "--"]).arg(program);
            command
        } else {
            Command::new(program)
        };
        command.current_dir(&self.folder);
        command
    }
}

impl Drop for Postgres {
    fn drop(&mut self) {
        // Nothing is lost with it, and there is nobody to tell.
        let _ = self.program("pg_ctl").args(["stop", "-m", "immediate", "-D"]).arg(self.data()).status();
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// The folder of the newest version.
fn programs() -> Option<PathBuf> {
    let versions = fs::read_dir(Path::new(POSTGRES_PROGRAMS)).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    versions.map(|version| version.join("bin")).filter(|bin| bin.join("initdb").is_file()).max()
}

/// Whether this is run by root.
fn is_root() -> bool {
    let user = Command::new("id").arg("-u").output();
    user.is_ok_and(|user| user.stdout == b"0\n")
}
