//! `baliza forward`: nodes at one computer and the station at another, with losses, a station that is killed, and keys.

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, UdpSocket};
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{JoinHandle, spawn};
use std::time::Duration;

use serde_json::Value;
use station_core::Utc;

use crate::serve::Station;
use crate::support::{Folder, Run};

/// A network between a gateway and a station: it loses every seventh datagram in each direction.
pub struct LossyNetwork {
    pub address: SocketAddr,
    station: Arc<Mutex<Option<SocketAddr>>>,
    is_over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl LossyNetwork {
    pub fn start() -> Self {
        let [front, back] = [(); 2].map(|()| {
            let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
            socket.set_read_timeout(Some(Duration::from_millis(5))).expect("a timeout");
            socket
        });
        let address = front.local_addr().expect("an address");
        let (station, is_over) = (Arc::new(Mutex::new(None)), Arc::new(AtomicBool::new(false)));
        let (to, over) = (Arc::clone(&station), Arc::clone(&is_over));
        let thread = spawn(move || {
            let (mut gateway, mut passed, mut bytes) = (None, [0_u32; 2], [0; 2048]);
            let mut is_lost = |way: usize| {
                passed[way] += 1;
                passed[way].is_multiple_of(7)
            };
            let mut receive = |socket: &UdpSocket| match socket.recv_from(&mut bytes) {
                Ok((length, from)) => Some((bytes[..length].to_vec(), from)),
                // A station that is not there yet, or no more.
                Err(error) if matches!(error.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset) => None,
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => None,
                Err(error) => panic!("{error}"),
            };
            while !over.load(Ordering::Relaxed) {
                while let Some((datagram, from)) = receive(&front) {
                    gateway = Some(from);
                    let station = *to.lock().expect("no panic");
                    if let Some(station) = station.filter(|_| !is_lost(0)) {
                        let _ = back.send_to(&datagram, station);
                    }
                }
                while let Some((receipt, _)) = receive(&back) {
                    if let Some(gateway) = gateway.filter(|_| !is_lost(1)) {
                        let _ = front.send_to(&receipt, gateway);
                    }
                }
            }
        });
        Self { address, station, is_over, thread: Some(thread) }
    }

    pub fn lead_to(&self, station: SocketAddr) {
        *self.station.lock().expect("no panic") = Some(station);
    }
}

impl Drop for LossyNetwork {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(std::thread::panicking() || ended.is_some_and(|ended| ended.is_ok()));
    }
}

/// Where a station receives datagrams.
pub fn datagrams(station: &Station) -> SocketAddr {
    let line = station.said().lines().find_map(|line| line.strip_prefix("datagrams: udp:")).expect("an address");
    line.parse().expect("an address")
}

fn forward(folder: &Folder, arguments: &str) -> Child {
    let mut command = folder.command(&format!("forward {arguments}"));
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("baliza runs")
}

/// What a program said until its end.
fn said(mut child: Child) -> String {
    let mut said = String::new();
    child.stderr.take().expect("piped").read_to_string(&mut said).expect("text");
    let status = child.wait().expect("it ends");
    assert!(status.success(), "{said}");
    said
}

/// Time, seconds, and x, metres, of the positions of a tag in a recording.
fn recorded(folder: &Folder, tag: &str) -> Vec<[f64; 2]> {
    let stdout = String::from_utf8(folder.read("run/positions.csv")).expect("UTF-8");
    let rows = Run { code: Some(0), stdout, stderr: String::new() };
    let rows = rows.column("tag").into_iter().zip(rows.numbers("t_s").into_iter().zip(rows.numbers("x_m")));
    rows.filter(|(of, (_, x_m))| *of == tag && x_m.is_finite()).map(|(_, (t_s, x_m))| [t_s, x_m]).collect()
}

#[test]
fn all_of_two_tags_arrives_with_its_times_over_a_bad_network_and_a_kill() {
    let folder = Folder::with(&[]);
    folder.run("simulate --tags 2 --seconds 5 --rate 10 --fidelity air --out run --quiet").ok();
    let network = LossyNetwork::start();
    let mut station = Station::start(&folder, "--store tags.db udp:127.0.0.1:0");
    network.lead_to(datagrams(&station));
    let gateway = forward(&folder, &format!("run --to {} --queue waiting", network.address));
    let path = |tag: &str| format!("/api/v1/tags/{tag}/positions?site=site&limit=1000");
    station.wait(&path("0x1001"), |history| history.as_array().is_some_and(|rows| rows.len() > 5));
    station.kill();
    let station = Station::start(&folder, "--store tags.db udp:127.0.0.1:0");
    network.lead_to(datagrams(&station));
    let mut all_said = said(gateway);
    for _ in 0..20 {
        if !all_said.contains("bytes wait in waiting") {
            break;
        }
        // Without sources it sends what waits.
        all_said = said(forward(&folder, &format!("- --to {} --queue waiting", network.address)));
    }
    assert!(!all_said.contains("bytes wait"), "{all_said}");
    for tag in ["0x1001", "0x1002"] {
        let expected = recorded(&folder, tag);
        assert!(expected.len() > 20, "{tag}: {}", expected.len());
        let all = |history: &Value| history.as_array().is_some_and(|rows| rows.len() >= expected.len());
        let history = station.wait(&path(tag), all);
        let rows: Vec<_> = history.as_array().expect("a list").iter().rev().collect();
        assert_eq!(rows.len(), expected.len(), "{tag}");
        let time = |row: &Value| row["t"].as_str().and_then(|t| t.parse::<Utc>().ok()).expect("a time");
        let begin = time(rows[0]);
        for (row, [t_s, x_m]) in rows.iter().zip(&expected) {
            assert!((row["x_m"].as_f64().expect("a number") - x_m).abs() < 1.5e-3, "{row}");
            // The file is played at its pace: a busy machine reads it late, and the node's clock says how much.
            let late_s = time(row).since(begin).as_secs_f64() - (t_s - expected[0][0]);
            assert!(late_s.abs() < 0.5, "{late_s} s");
        }
    }
}

#[test]
fn a_key_is_made_and_another_one_is_refused() {
    let folder = Folder::with(&[]);
    folder.run("simulate --tags 1 --seconds 1 --rate 10 --fidelity air --out run --quiet").ok();
    // Nobody listens there, and nobody has this name.
    for to in ["127.0.0.1:9", "no-station.invalid:9"] {
        let run = said(forward(&folder, &format!("- --to {to} --key gateway.toml --queue waiting")));
        let is_first = to.starts_with('1');
        assert_eq!(run.contains("made a key") && run.contains("--gateways"), is_first, "{run}");
    }
    folder.run("forward - --to station").refused("such as station.local:7000");
    let other = String::from_utf8(folder.read("gateway.toml")).expect("UTF-8").replace("key = \"", "key = \"00");
    let (head, secret) = other.split_once("key = \"").expect("a key");
    folder.write("other.toml", format!("{head}key = \"{}\"\n", &secret[..64]).as_bytes());
    let mut station = Station::start(&folder, "--store tags.db --gateways gateway.toml udp:127.0.0.1:0");
    let to = datagrams(&station);
    let refused = said(forward(&folder, &format!("run --to {to} --key other.toml --queue other")));
    assert!(refused.contains("bytes wait in other"), "{refused}");
    let noted = station.wait_for_line("refused so far");
    assert!(noted.contains("has another key than --gateways gives its gateway"), "{noted}");
    let taken = said(forward(&folder, &format!("run --to {to} --key gateway.toml --queue waiting")));
    assert!(!taken.contains("bytes wait"), "{taken}");
    let tags = station.wait("/api/v1/tags", |tags| tags.as_array().is_some_and(|tags| !tags.is_empty()));
    assert_eq!(tags.as_array().expect("a list").len(), 1);
}
