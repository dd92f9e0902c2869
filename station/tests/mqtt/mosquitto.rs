//! A mosquitto of a test's own, and a client that sees all of it: the programs of Debian's packages `mosquitto` and
//! `mosquitto-clients`.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;

use port::Port;

#[path = "../shared/port.rs"]
pub mod port;

/// The longest wait for anything.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// Where mosquitto is; none where it is not installed, which is only allowed outside of CI.
pub fn program() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::env::split_paths(&path).chain([PathBuf::from("/usr/sbin")]);
    let found = folders.map(|folder| folder.join("mosquitto")).find(|file| file.is_file());
    if found.is_none() {
        assert!(std::env::var_os("CI").is_none(), "mosquitto is needed: .ci/setup installs it");
        eprintln!("not tested: there is no mosquitto (apt-get install mosquitto mosquitto-clients)");
    }
    found
}

/// A broker, which is killed in the end.
pub struct Mosquitto {
    program: PathBuf,
    folder: tempfile::TempDir,
    pub port: u16,
    /// Keeps the port while the broker is away.
    _held: Port,
    child: Child,
    /// What its clients need beside host and port.
    access: Vec<String>,
}

impl Mosquitto {
    /// A broker for everyone on loopback; none where mosquitto is not installed.
    pub fn start() -> Option<Self> {
        Self::with("allow_anonymous true\n", &[], &[])
    }

    /// A broker for one user.
    pub fn with_user(user: &str, password: &str) -> Option<Self> {
        let program = program()?;
        let file = tempfile::NamedTempFile::new().expect("a file");
        let mut passwd = Command::new("mosquitto_passwd");
        passwd.args(["-b", "-c"]).arg(file.path()).args([user, password]);
        assert!(passwd.status().expect("mosquitto_passwd runs").success(), "{}", program.display());
        let passwords = fs::read(file.path()).expect("its file");
        let access = ["-u", user, "-P", password];
        Self::with("allow_anonymous false\npassword_file FOLDER/passwords\n", &[("passwords", &passwords)], &access)
    }

    /// A broker with these lines in its configuration, in which FOLDER has these files.
    pub fn with(lines: &str, files: &[(&str, &[u8])], access: &[&str]) -> Option<Self> {
        let program = program()?;
        let folder = tempfile::tempdir().expect("a folder");
        for (name, bytes) in files {
            fs::write(folder.path().join(name), bytes).expect("a file");
        }
        let held = Port::free();
        let port = held.address.port();
        let lines = lines.replace("FOLDER", folder.path().to_str().expect("UTF-8"));
        // As root, it would become a user who cannot read the folder.
        let text = format!("user root\nlistener {port} 127.0.0.1\n{lines}");
        fs::write(folder.path().join("mosquitto.conf"), text).expect("a file");
        let child = spawn(&program, folder.path());
        let broker = Self {
            program,
            folder,
            port,
            _held: held,
            child,
            access: access.iter().map(ToString::to_string).collect(),
        };
        broker.wait_until_it_listens();
        Some(broker)
    }

    fn wait_until_it_listens(&self) {
        let begun = Instant::now();
        while TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(begun.elapsed() < PATIENCE, "mosquitto does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// The folder of its files.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Ends it with SIGKILL.
    pub fn kill(&mut self) {
        self.child.kill().expect("SIGKILL");
        self.child.wait().expect("it ends");
    }

    /// Starts it again at its port, without anything that it knew.
    pub fn start_again(&mut self) {
        self.child = spawn(&self.program, self.folder.path());
        self.wait_until_it_listens();
    }

    /// Sends it a signal.
    pub fn signal(&self, signal: &str) {
        let kill = Command::new("kill").arg(signal).arg(self.child.id().to_string()).status();
        assert!(kill.expect("kill runs").success());
    }

    /// A program of the clients.
    pub fn client(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.args(["-h", "127.0.0.1", "-p", &self.port.to_string()]).args(&self.access);
        command
    }

    /// Publishes a message.
    pub fn publish(&self, topic: &str, payload: &str, more: &[&str]) {
        let mut publish = self.client("mosquitto_pub");
        assert!(publish.args(["-t", topic, "-m", payload]).args(more).status().expect("it runs").success());
    }

    /// Sees all messages from now on, and the retained ones.
    pub fn listen(&self) -> Listener {
        let mut command = self.client("mosquitto_sub");
        command.args(["-q", "1", "-t", "#", "-F", "%r %t %p"]).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().expect("mosquitto_sub runs (apt-get install mosquitto-clients)");
        let seen = Arc::new(Mutex::new(Vec::new()));
        let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        let into = Arc::clone(&seen);
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let mut parts = line.splitn(3, ' ');
                let mut part = || parts.next().unwrap_or_default().to_owned();
                let (retained, topic, payload) = (part() == "1", part(), part());
                into.lock().expect("no panic").push(Seen { retained, topic, payload });
            }
        });
        Listener { child, seen }
    }
}

fn spawn(program: &Path, folder: &Path) -> Child {
    let mut command = Command::new(program);
    command.arg("-c").arg(folder.join("mosquitto.conf")).stdout(Stdio::null()).stderr(Stdio::null());
    command.spawn().expect("mosquitto runs")
}

impl Drop for Mosquitto {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A message.
#[derive(Clone, Debug)]
pub struct Seen {
    /// The broker had it before.
    pub retained: bool,
    pub topic: String,
    pub payload: String,
}

impl Seen {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.payload).unwrap_or_else(|error| panic!("{self:?}: {error}"))
    }
}

/// A client that sees all messages.
pub struct Listener {
    child: Child,
    seen: Arc<Mutex<Vec<Seen>>>,
}

impl Listener {
    /// What it has seen.
    pub fn seen(&self) -> Vec<Seen> {
        self.seen.lock().expect("no panic").clone()
    }

    /// What it has seen of a topic.
    pub fn of(&self, topic: &str) -> Vec<Seen> {
        self.seen().into_iter().filter(|seen| seen.topic == topic).collect()
    }

    /// The first message that is as it should be.
    pub fn wait(&self, what: &str, is_right: impl Fn(&Seen) -> bool) -> Seen {
        let begun = Instant::now();
        loop {
            if let Some(seen) = self.seen().into_iter().find(&is_right) {
                return seen;
            }
            assert!(begun.elapsed() < PATIENCE, "{what} does not come: {:#?}", self.seen());
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// The first message of a topic.
    pub fn first(&self, topic: &str) -> Seen {
        self.wait(topic, |seen| seen.topic == topic)
    }

    /// Forgets what it has seen.
    pub fn forget(&self) {
        self.seen.lock().expect("no panic").clear();
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
