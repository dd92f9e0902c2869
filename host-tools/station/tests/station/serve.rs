//! `baliza serve`: the station with a simulation and with recordings.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use station_core::Utc;

use crate::support::{Folder, PATIENCE, root};

/// A running station, which is killed in the end.
pub struct Station {
    child: Child,
    /// `127.0.0.1:PORT`.
    address: String,
    /// What it said before it listened.
    said: String,
    stderr: BufReader<std::process::ChildStderr>,
}

impl Station {
    pub fn start(folder: &Folder, arguments: &str) -> Self {
        let mut command = folder.command(&format!("serve --listen 127.0.0.1:0 {arguments}"));
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("baliza runs");
        let mut stderr = BufReader::new(child.stderr.take().expect("piped"));
        let mut said = String::new();
        let address = loop {
            let mut line = String::new();
            assert!(stderr.read_line(&mut line).expect("text") > 0, "it ended: {said}");
            if let Some((scheme, address)) =
                line.trim().strip_prefix("listening on ").and_then(|to| to.split_once("://"))
            {
                assert_eq!(scheme, if arguments.contains("--tls-cert") { "https" } else { "http" });
                break address.to_owned();
            }
            said += &line;
        };
        Self { child, address, said, stderr }
    }

    /// `127.0.0.1:PORT`.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// What it said before it listened.
    pub fn said(&self) -> &str {
        &self.said
    }

    /// The status and the body of an answer.
    fn get(&self, path: &str) -> (u16, String) {
        let mut connection = TcpStream::connect(&self.address).expect("it listens");
        connection.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        write!(connection, "GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n", self.address).expect("sent");
        let mut text = String::new();
        connection.read_to_string(&mut text).expect("an answer");
        let (head, body) = text.split_once("\r\n\r\n").expect("a head");
        let status = head.split_whitespace().nth(1).and_then(|status| status.parse().ok()).expect("a status");
        (status, body.to_owned())
    }

    pub fn json(&self, path: &str) -> Value {
        let (status, body) = self.get(path);
        assert_eq!(status, 200, "{path}: {body}");
        serde_json::from_str(&body).unwrap_or_else(|error| panic!("{path}: {error}: {body}"))
    }

    /// Sends a JSON document, or nothing, and asserts that it is taken.
    pub fn send(&self, method: &str, path: &str, body: &str) {
        let url = format!("http://{}{path}", self.address);
        let mut curl = Command::new("curl");
        curl.args(["--silent", "--fail", "--output", "/dev/null", "--request", method]);
        if !body.is_empty() {
            curl.args(["--json", body]);
        }
        assert!(curl.arg(&url).status().expect("curl runs").success(), "{method} {path} {body}");
    }

    /// Asks until the answer is as it should be.
    pub fn wait(&self, path: &str, is_right: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let answer = self.json(path);
            if is_right(&answer) {
                return answer;
            }
            assert!(begun.elapsed() < PATIENCE, "{path}: {answer}");
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// Waits for a line on standard error that has this text, since it listens. Returns all lines up to it.
    pub fn wait_for_line(&mut self, text: &str) -> String {
        let mut said = String::new();
        loop {
            let mut line = String::new();
            assert!(self.stderr.read_line(&mut line).expect("text") > 0, "it ended without {text:?}: {said}");
            said += &line;
            if line.contains(text) {
                return said;
            }
        }
    }

    /// Ends it with SIGKILL.
    pub fn kill(&mut self) {
        self.child.kill().expect("SIGKILL");
    }

    /// Ends it as `kill` does. Returns the exit code and what it said since it listens.
    pub fn stop(mut self) -> (Option<i32>, String) {
        let killed = Command::new("kill").arg(self.child.id().to_string()).status().expect("kill runs");
        assert!(killed.success());
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).expect("text");
        (self.child.wait().expect("it ends").code(), said)
    }
}

impl Drop for Station {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A recording of a tag, of this many seconds. Returns its positions as its file has them: x and y, metres.
pub fn recorded(folder: &Folder, seconds: u32) -> Vec<[f64; 2]> {
    folder.run(&format!("simulate --tags 1 --seconds {seconds} --rate 10 --fidelity air --out run --quiet")).ok();
    let positions = String::from_utf8(folder.read("run/positions.csv")).expect("UTF-8");
    let rows = crate::support::Run { code: Some(0), stdout: positions, stderr: String::new() };
    let (xs, ys) = (rows.numbers("x_m"), rows.numbers("y_m"));
    let positions: Vec<_> = xs.into_iter().zip(ys).map(|(x, y)| [x, y]).filter(|[x, _]| x.is_finite()).collect();
    assert!(positions.len() > 10, "{positions:?}");
    positions
}

/// Asserts that a station has these positions of the recorded tag, to a millimetre.
fn assert_history(station: &Station, positions: &[[f64; 2]]) {
    let path = "/api/v1/tags/0x1001/positions?site=site&limit=1000";
    let history = station.wait(path, |history| history.as_array().is_some_and(|rows| rows.len() >= positions.len()));
    let rows = history.as_array().expect("a list");
    assert_eq!(rows.len(), positions.len());
    for (row, [x, y]) in rows.iter().rev().zip(positions) {
        let error = |key: &str, is: f64| (row[key].as_f64().expect("a number") - is).abs();
        assert!(error("x_m", *x) < 1.5e-3 && error("y_m", *y) < 1.5e-3, "{row} is not at {x}, {y}");
    }
    let time = |row: &Value| row["t"].as_str().and_then(|t| t.parse::<Utc>().ok()).expect("a time");
    let times: Vec<_> = rows.iter().map(time).collect();
    assert!(times.is_sorted_by(|newer, older| newer > older), "{times:?}");
}

#[test]
fn a_simulation_is_on_the_map_and_its_history_survives_a_restart() {
    let folder = Folder::with(&[]);
    let station = Station::start(&folder, "--simulate --store tags.db");
    let is_live = |tags: &Value| {
        let tags = tags.as_array().expect("a list");
        tags.len() == 5 && tags.iter().all(|tag| tag["last_position"].is_object())
    };
    for tag in station.wait("/api/v1/tags", is_live).as_array().expect("a list") {
        let position = &tag["last_position"];
        let number = |key: &str| position[key].as_f64().expect("a number");
        // The room is 12 m by 8 m.
        assert!((-1.0..=13.0).contains(&number("x_m")) && (-1.0..=9.0).contains(&number("y_m")), "{position}");
        assert!(number("sigma_x_m") > 0.0 && number("sigma_x_m") < 1.0, "{position}");
        assert_eq!(position["site"], "simulation");
    }
    // Anchors are where the scenario has them, and ranges agree with positions to some decimetres.
    let has_residuals = |nodes: &Value| {
        let anchors = nodes.as_array().expect("a list").iter().filter(|node| node["role"] == "anchor");
        anchors.clone().count() == 6 && anchors.clone().all(|anchor| anchor["residual_mean_m"].is_number())
    };
    for anchor in station.wait("/api/v1/nodes", has_residuals).as_array().expect("a list") {
        assert!(anchor["residual_mean_m"].as_f64().expect("a number").abs() < 0.5, "{anchor}");
        assert!(anchor["position_m"].is_array(), "{anchor}");
    }
    let entered =
        station.wait("/api/v1/events?kind=entered", |events| events.as_array().is_some_and(|all| all.len() >= 5));
    assert!(entered.as_array().expect("a list").iter().all(|event| event["zone"] == "room 1"), "{entered}");
    let path = "/api/v1/tags/0x1001/positions?site=simulation&limit=10000";
    let before = station.wait(path, |history| history.as_array().is_some_and(|rows| rows.len() > 20));
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");

    let station = Station::start(&folder, "--store tags.db");
    let after = station.json(path);
    let after = after.as_array().expect("a list");
    let before = before.as_array().expect("a list");
    assert!(after.len() >= before.len() && before.iter().all(|row| after.contains(row)), "{before:?} {after:?}");
}

#[test]
fn messages_reach_a_simulated_tag_and_its_answers_come_back() {
    let folder = Folder::with(&[]);
    let station = Station::start(&folder, "--simulate");
    let tags = station.wait("/api/v1/tags", |tags| tags.as_array().is_some_and(|tags| !tags.is_empty()));
    let path = format!("/api/v1/tags/{}/messages", tags[0]["tag"].as_str().expect("an address"));
    // The light; data that no program takes; a rate, which a tag's own host may ask for.
    for content in [r#"{"identify_s": 30}"#, r#"{"data": "6F6B"}"#, r#"{"rate_hz": 2}"#] {
        station.send("POST", &path, &format!(r#"{{"content": {content}}}"#));
    }
    let is_over =
        |messages: &Value| messages.as_array().is_some_and(|all| all.iter().all(|of| of["state"] != "waiting"));
    let messages = station.wait(&path, is_over);
    let states: Vec<_> = messages.as_array().expect("a list").iter().map(|of| of["state"].as_str()).collect();
    assert_eq!(states, [Some("taken"), Some("unknown"), Some("taken")], "{messages}");
    assert_eq!(messages[2]["content"]["identify_s"], 30);
    // A tag that is not there.
    station.send("POST", "/api/v1/tags/0x7777/messages", r#"{"content": {"identify_s": 1}, "lasts_s": 600}"#);
    let waiting = station.json("/api/v1/tags/0x7777/messages");
    assert_eq!(waiting[0]["state"], "waiting");
    station.send("DELETE", &format!("/api/v1/tags/0x7777/messages/{}", waiting[0]["id"]), "");
    assert_eq!(station.json("/api/v1/tags/0x7777/messages")[0]["state"], "withdrawn");
}

#[test]
fn what_was_read_from_the_api_survives_a_kill() {
    let folder = Folder::with(&[]);
    let path = "/api/v1/tags/0x1001/positions?site=simulation&limit=10000";
    let mut seen: Vec<Value> = Vec::new();
    for _ in 0..3 {
        let mut station = Station::start(&folder, "--simulate --store tags.db");
        let fresh = seen.len() + 20;
        let history = station.wait(path, |history| history.as_array().is_some_and(|rows| rows.len() >= fresh));
        let history = history.as_array().expect("a list");
        assert!(seen.iter().all(|row| history.contains(row)), "{} rows were {}", history.len(), seen.len());
        seen.clone_from(history);
        station.kill();
    }
}

#[test]
fn a_recording_is_played_into_the_store() {
    let folder = Folder::with(&[]);
    let positions = recorded(&folder, 4);
    let station = Station::start(&folder, "run");
    assert_history(&station, &positions);
    assert!(folder.names().contains(&"baliza.db".to_owned()));
}

#[test]
fn all_tags_of_each_examples_folder_are_played() {
    let folder = Folder::with(&[]);
    let entries = std::fs::read_dir(root().join("examples")).expect("a folder").flatten().map(|entry| entry.path());
    let mut simulations: Vec<_> = entries
        .filter(|path| path.extension().is_some_and(|end| end == "toml"))
        // Their positions are those of a station, and not telemetry that is played.
        .filter(|path| !["blinks.toml", "scanners.toml"].iter().any(|name| path.ends_with(name)))
        .map(|path| (path.file_stem().expect("a name").display().to_string(), format!("--scenario {}", path.display())))
        .collect();
    assert!(simulations.len() > 10, "{simulations:?}");
    simulations.push(("three".to_owned(), "--tags 3 --anchors 4 --rate 10".to_owned()));
    let stations = simulations.iter().map(|(name, simulate)| {
        let run = folder.run(&format!("simulate {simulate} --seconds 2 --fidelity air --out {name} --quiet"));
        assert!(run.code == Some(0), "{name}: {run:?}");
        let positions = String::from_utf8(folder.read(&format!("{name}/positions.csv"))).expect("UTF-8");
        let rows = crate::support::Run { code: Some(0), stdout: positions, stderr: String::new() };
        let mut expected: BTreeMap<String, usize> = BTreeMap::new();
        for (tag, x_m) in rows.column("tag").into_iter().zip(rows.numbers("x_m")) {
            *expected.entry(tag.to_owned()).or_default() += usize::from(x_m.is_finite());
        }
        (Station::start(&folder, &format!("{name} --store {name}.db")), name, expected)
    });
    // They play at the same time.
    for (station, name, expected) in stations.collect::<Vec<_>>() {
        assert!(name != "three" || expected.len() == 3, "{expected:?}");
        for (tag, count) in expected.into_iter().filter(|(_, count)| *count > 0) {
            let path = format!("/api/v1/tags/{tag}/positions?site=site&limit=10000");
            station.wait(&path, |history| history.as_array().is_some_and(|rows| rows.len() == count));
        }
    }
}

/// Waits until a socket of this host has no datagrams that are not read. It holds a limited number, and loses the
/// others where its program has to wait for the processor.
fn wait_until_read(port: u16) {
    // Lines of Linux: `0: 0100007F:1F90 00000000:0000 07 00000000:00000300 …`, in hexadecimal; the last number shown is
    // the bytes that wait.
    let waits = |sockets: &str| {
        let words = sockets.lines().map(|line| line.split_whitespace().collect::<Vec<_>>());
        let here = format!(":{port:04X}");
        words.filter(|words| words.len() > 4 && words[1].ends_with(&here)).any(|words| !words[4].ends_with(":00000000"))
    };
    let begun = Instant::now();
    // Elsewhere, a pause has to do.
    std::thread::sleep(Duration::from_millis(1));
    while std::fs::read_to_string("/proc/net/udp").is_ok_and(|sockets| waits(&sockets)) {
        assert!(begun.elapsed() < PATIENCE, "the station does not read its datagrams");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn datagrams_of_two_gateways_are_streams_of_their_own() {
    use std::net::UdpSocket;

    let folder = Folder::with(&[]);
    let positions = recorded(&folder, 4);
    let bytes = folder.read("run/telemetry.bin");
    let station = Station::start(&folder, "udp:127.0.0.1:0");
    let address = station.said().lines().find_map(|line| line.strip_prefix("datagrams: udp:"));
    let free: SocketAddr =
        address.and_then(|address| address.parse().ok()).unwrap_or_else(|| panic!("{}", station.said()));
    // The other gateway's bytes are noise in between, and cut frames of the tag.
    let gateways = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").expect("a port"));
    for part in bytes.chunks(100) {
        for (gateway, part) in [(&gateways[0], part), (&gateways[1], &[0xA5; 64][..])] {
            gateway.send_to(part, free).expect("sent");
        }
        wait_until_read(free.port());
    }
    assert_history(&station, &positions);
}

#[test]
fn the_page_and_the_health_are_there_at_once() {
    let folder = Folder::with(&[]);
    let station = Station::start(&folder, "--simulate");
    let (status, page) = station.get("/");
    assert_eq!(status, 200);
    assert!(page.to_lowercase().starts_with("<!doctype html>"), "{page}");
    assert_eq!(station.get("/healthz").0, 200);
    assert_eq!(station.get("/no/such/route").0, 404);
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
    // The simulation's own store was temporary.
    assert_eq!(folder.names(), [""; 0]);
}

#[test]
fn the_requests_of_the_page_about_the_station_work_as_written() {
    let page = std::fs::read_to_string(root().join("docs/use/station/README.md")).expect("the page");
    let folder = Folder::with(&[]);
    let station = Station::start(&folder, "--simulate");
    station.wait("/api/v1/tags", |tags| {
        let is_first = |tag: &Value| tag["tag"] == "0x1001" && tag["last_position"].is_object();
        tags.as_array().is_some_and(|tags| tags.iter().any(is_first))
    });
    let requests: Vec<_> = page.lines().filter(|line| line.starts_with("curl ")).collect();
    assert!(requests.len() >= 10, "{requests:?}");
    for request in requests {
        let here = request.replace("127.0.0.1:8080", &station.address);
        let output = Command::new("sh").args(["-c", &here]).output().expect("a shell");
        assert!(output.status.success(), "{request}: {output:?}");
    }
}

#[test]
fn a_receiver_that_was_placed_is_there_after_a_restart() {
    let folder = Folder::with(&[]);
    for run in 0..2 {
        let station = Station::start(&folder, "");
        if run == 0 {
            let place = r#"{"role": "receiver", "position_m": [5.5, 2.4, 2.1], "rssi_1m_dbm": -61}"#;
            let url = format!("http://{}/api/v1/nodes/site/kitchen", station.address);
            let put = ["--silent", "--fail", "--request", "PUT", "--json", place, &url];
            assert!(Command::new("curl").args(put).status().expect("curl runs").success());
        }
        station.wait("/api/v1/nodes", |nodes| {
            nodes[0]["node"] == "kitchen" && nodes[0]["role"] == "receiver" && nodes[0]["rssi_1m_dbm"] == -61.0
        });
        let (code, said) = station.stop();
        assert_eq!(code, Some(0), "{said}");
    }
}

#[test]
fn changes_need_a_token_and_are_logged_with_its_name() {
    // FIPS 180-2, appendix B.1: the SHA-256 of "abc".
    let tokens = "[[token]]\nname = \"wall\"\nrole = \"operate\"\n\
                  sha256 = \"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad\"\n";
    let folder = Folder::with(&[("tokens.toml", tokens)]);
    let station = Station::start(&folder, "--tokens tokens.toml --quiet");
    let put = |token: &str| {
        let zone = r#"{"site": "site", "name": "hall", "kind": "room", "corners_m": [[0, 0], [4, 0], [4, 3]]}"#;
        let url = format!("http://{}/api/v1/rooms/site/hall", station.address);
        let mut curl = Command::new("curl");
        curl.args(["--silent", "--output", "/dev/null", "--write-out", "%{http_code}", "--request", "PUT"]);
        curl.args(["--json", zone, "--header", &format!("Authorization: Bearer {token}"), &url]);
        String::from_utf8(curl.output().expect("curl runs").stdout).expect("text")
    };
    assert_eq!(station.get("/api/v1/tags").0, 401);
    assert_eq!(put("abcd"), "401");
    assert!(put("abc").starts_with('2'), "{}", put("abc"));
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
    // A warning is there with --quiet too.
    assert!(said.contains("a wrong token"), "{said}");

    let station = Station::start(&folder, "--tokens tokens.toml");
    let url = format!("http://{}/api/v1/rooms/site/hall", station.address);
    let delete = ["--silent", "--fail", "--request", "DELETE", "--header", "Authorization: Bearer abc", &url];
    assert!(Command::new("curl").args(delete).status().expect("curl runs").success());
    let (_, said) = station.stop();
    assert!(said.contains("wall") && said.contains("DELETE /api/v1/rooms/site/hall"), "{said}");
}

#[test]
fn a_station_starts_without_its_provider_of_sign_ins_and_says_so() {
    // Nothing listens at port 1.
    let oidc = "issuer = \"http://127.0.0.1:1\"\nclient_id = \"baliza\"\npublic_url = \"http://127.0.0.1:2\"\n\
                [roles]\nview = [\"staff\"]\n";
    let folder = Folder::with(&[("oidc.toml", oidc)]);
    let station = Station::start(&folder, "--oidc oidc.toml --quiet");
    let (status, body) = station.get("/oidc/login");
    assert!(status == 503 && body.contains("try again later"), "{status}: {body}");
    assert_eq!(station.json("/api/v1/me")["sign_in"], "http://127.0.0.1:2/oidc/login");
    assert_eq!(station.get("/api/v1/tags").0, 401);
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("http://127.0.0.1:1 cannot be used") && said.contains("tried again"), "{said}");
}

#[test]
fn encrypted_connections_use_the_files_of_the_certificate() {
    let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).expect("a certificate");
    let folder = Folder::with(&[
        ("certificate.pem", &made.cert.pem()),
        ("key.pem", &made.signing_key.serialize_pem()),
        ("other.pem", &rcgen::KeyPair::generate().expect("a key").serialize_pem()),
    ]);
    let station = Station::start(&folder, "--simulate --tls-cert certificate.pem --tls-key key.pem");
    let (_, port) = station.address.rsplit_once(':').expect("a port");
    let page = Command::new("curl")
        .args(["--silent", "--fail", "--cacert"])
        .arg(folder.path("certificate.pem"))
        .args(["--resolve", &format!("localhost:{port}:127.0.0.1"), &format!("https://localhost:{port}/")])
        .output()
        .expect("curl runs");
    assert!(page.status.success() && page.stdout.to_ascii_lowercase().starts_with(b"<!doctype html>"), "{page:?}");
    let (status, problem) = station.get("/");
    assert!(status == 400 && problem.contains("https://"), "{status} {problem}");
    assert_eq!(station.stop().0, Some(0));

    for (arguments, expected) in [
        ("--tls-cert certificate.pem --tls-key other.pem", "other.pem: this key does not belong to the certificate"),
        ("--tls-cert missing.pem --tls-key key.pem", "missing.pem: cannot read it"),
        ("--tls-cert key.pem --tls-key key.pem", "key.pem: there is no certificate in it"),
        ("--tls-cert certificate.pem", "--tls-key"),
    ] {
        let run = folder.run(&format!("serve {arguments}"));
        assert_eq!(run.code, Some(2), "{arguments}: {run:?}");
        assert!(run.stderr.contains(expected), "{arguments}: {}", run.stderr);
    }
}

/// The head and the body of a request, which is answered with this status.
fn answer_request(receiver: &std::net::TcpListener, status: &str) -> (String, String) {
    let (stream, _) = receiver.accept().expect("a request");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    let mut reader = BufReader::new(stream);
    let (mut head, mut length) = (String::new(), 0);
    while !head.ends_with("\r\n\r\n") {
        let mut line = String::new();
        assert!(reader.read_line(&mut line).expect("text") > 0, "{head}");
        if let Some(bytes) = line.to_lowercase().strip_prefix("content-length:") {
            length = bytes.trim().parse().expect("a number");
        }
        head += &line;
    }
    let mut body = vec![0; length];
    reader.read_exact(&mut body).expect("the body");
    let answer = format!("HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    reader.get_mut().write_all(answer.as_bytes()).expect("sent");
    (head, String::from_utf8(body).expect("text"))
}

#[test]
fn events_go_to_webhooks_and_the_log_has_no_secrets() {
    let receiver = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = receiver.local_addr().expect("an address");
    let hook = format!(
        "[[webhook]]\nname = \"house\"\nurl = \"http://{address}/api/webhook/private\"\nkinds = [\"entered\"]\n\
         secret = \"whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\"\n"
    );
    let folder = Folder::with(&[("webhooks.toml", &hook)]);
    let station = Station::start(&folder, "--simulate --webhooks webhooks.toml");
    let (refused, first) = answer_request(&receiver, "503 Service Unavailable");
    let (head, again) = answer_request(&receiver, "204 No Content");
    let id = |head: &str| head.lines().find_map(|line| line.strip_prefix("webhook-id: ").map(str::to_owned));
    assert!(head.starts_with("POST /api/webhook/private HTTP/1.1\r\n"), "{head}");
    assert!(id(&head).is_some() && id(&head) == id(&refused) && first == again, "{refused}{head}");
    assert!(head.contains("\r\nwebhook-signature: v1,"), "{head}");
    let event: Value = serde_json::from_str(&again).expect("JSON");
    assert_eq!((&event["kind"], &event["zone"]), (&"entered".into(), &"room 1".into()));
    let (next, _) = answer_request(&receiver, "204 No Content");
    assert_ne!(id(&next), id(&head));
    let (_, metrics) = station.get("/metrics");
    assert!(metrics.contains("\nbaliza_webhook_failures_total{webhook=\"house\"} 1\n"), "{metrics}");
    // The other tags' events meet nobody; the station ends all the same.
    drop(receiver);
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("webhook \"house\": it answers 503"), "{said}");
    assert!(said.contains("it answers again"), "{said}");
    assert!(!said.contains("private") && !said.contains("MfKQ9"), "{said}");
}

#[test]
fn what_cannot_be_served_is_refused_before_the_station_starts() {
    let folder =
        Folder::with(&[("wrong.toml", "[[token]]\nname = 1\n"), ("store.txt", "this is no database, but a text")]);
    // The files of its site's models are not beside it.
    let scenario = std::fs::read(root().join("examples/fingerprints.toml")).expect("an example");
    folder.write("fingerprints.toml", &scenario);
    for (arguments, expected) in [
        ("--listen 0.0.0.0:0", "--tokens"),
        ("--listen somewhere", "ADDRESS:PORT is expected, such as 127.0.0.1:8080"),
        ("--listen 8765", "ADDRESS:PORT is expected, such as 127.0.0.1:8765"),
        ("missing.bin", "missing.bin"),
        ("serial:", "the port is missing"),
        ("udp:7000", "ADDRESS:PORT"),
        ("--tokens wrong.toml", "wrong.toml"),
        ("--oidc wrong.toml", "wrong.toml"),
        ("--oidc missing.toml", "missing.toml"),
        ("--trusted-proxy 10.0.0.0/33", "--trusted-proxy"),
        ("--webhooks wrong.toml", "wrong.toml"),
        ("--no-alarm entered", "--no-alarm"),
        ("--uncertain-m 0", "--uncertain-m"),
        ("--uncertain-rssi-m 0", "--uncertain-rssi-m"),
        ("--site missing.toml", "missing.toml"),
        ("--simulate missing.toml", "missing.toml"),
        ("--simulate fingerprints.toml", "fingerprints.toml:37: fingerprint_map: "),
    ] {
        folder.run(&format!("serve {arguments}")).refused(expected);
    }
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("an address");
    let gateway = std::net::UdpSocket::bind("127.0.0.1:0").expect("a port");
    let udp = gateway.local_addr().expect("an address");
    for (arguments, expected) in [
        (format!("udp:{udp}"), format!("cannot listen on udp:{udp}")),
        (format!("--simulate --listen {address}"), address.to_string()),
        ("--listen 127.0.0.1:0 --store store.txt".to_owned(), "store.txt".to_owned()),
        (
            "--listen 127.0.0.1:0 --store postgres://me:secret@127.0.0.1:1/tags".to_owned(),
            "127.0.0.1:1/tags".to_owned(),
        ),
    ] {
        let run = folder.run(&format!("serve {arguments}"));
        assert_eq!(run.code, Some(1), "{arguments}: {run:?}");
        assert!(run.stderr.contains(&expected) && !run.stderr.contains("secret"), "{arguments}: {}", run.stderr);
    }
    assert_eq!(folder.read("store.txt"), b"this is no database, but a text");
}
