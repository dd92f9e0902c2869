//! The station's page and store: the committed build of the page, its tests in a browser, and the store's tests against
//! a real PostgreSQL.

use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::{root, succeed};

/// The environment variable by which the tests of the store find a PostgreSQL.
const POSTGRES: &str = "BALIZA_TEST_POSTGRES";
/// Where Debian puts the programs of each version of PostgreSQL.
const POSTGRES_PROGRAMS: &str = "/usr/lib/postgresql";
/// The user that owns the server where the chore is run by root, as whom it refuses to run.
const POSTGRES_USER: &str = "postgres";

/// Builds the page and tests it, then tests the store.
///
/// # Errors
/// A program is missing, the committed build of the page is not what its sources give, or a test fails.
pub fn run() -> Result<()> {
    page()?;
    store()
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
    npm(&["test"])
}

/// Runs the tests of the station with a PostgreSQL of their own.
fn store() -> Result<()> {
    let server = Postgres::start()?;
    let mut tests = Command::new("cargo");
    succeed(tests.args(["test", "--package", "baliza-station"]).env(POSTGRES, server.url()).current_dir(root()))
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
        let options = format!("-p {port} -c listen_addresses=127.0.0.1 -k {}", server.folder.display());
        let log = server.folder.join("log");
        succeed(
            server
                .program("pg_ctl")
                .args(["start", "--wait", "-D"])
                .arg(&data)
                .arg("-l")
                .arg(log)
                .args(["-o", &options]),
        )?;
        Ok(server)
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
