//! A node with Wi-Fi: its settings by `baliza provision`, its own sending task over a real socket, and a real station that
//! is killed on the way.

use std::cell::RefCell;
use std::future::{Future, poll_fn};
use std::net::{SocketAddr, UdpSocket};
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

use embedded_hal_async::delay::DelayNs;
use firmware_gateway::{DatagramSocket, Gateway, GatewayIdentity};
use station_core::Utc;
use wire::config::wifi_of;
use wire::datagram::MAX_DATAGRAM;
use wire::telemetry::{MAX_FRAME, TagAnswer, encode};
use wire::to_node::FrameReader;
use wire::uwb::native::Answer;

use crate::forward::{LossyNetwork, datagrams};
use crate::serve::Station;
use crate::support::{Folder, Run};

/// A tag on an ESP32-C3 with Wi-Fi.
const SITE: &str = r#"
[network]
pan = 0xBA12
region = "eu"

[wifi]
ssid = "hall"
password = "correct horse"
station = "STATION"
gateways = "gateways.toml"

[[node]]
name = "tag-1"
role = "tag"
board = "esp32c3"
address = 0x1001
wifi = true
"#;

/// A delay by the computer's clock.
#[derive(Clone)]
struct Pause;

impl DelayNs for Pause {
    async fn delay_ns(&mut self, ns: u32) {
        let end = Instant::now() + Duration::from_nanos(ns.into());
        poll_fn(|_| if Instant::now() >= end { Poll::Ready(()) } else { Poll::Pending }).await;
    }
}

struct Socket {
    socket: UdpSocket,
    to: SocketAddr,
}

impl DatagramSocket for Socket {
    async fn send(&mut self, datagram: &[u8]) {
        let _ = self.socket.send_to(datagram, self.to);
    }

    async fn receive(&mut self, into: &mut [u8; MAX_DATAGRAM]) -> usize {
        // A station that is not there is an error that tells nothing.
        poll_fn(|_| self.socket.recv(into).map_or(Poll::Pending, Poll::Ready)).await
    }
}

/// What the sending task of a node has come to.
#[derive(Default)]
struct Node {
    /// Whether the station read what was sent: once at least, and at the end.
    was_read: AtomicBool,
    is_read: AtomicBool,
    /// All is sent, and taken.
    is_done: AtomicBool,
    is_over: AtomicBool,
}

impl Node {
    /// Runs the task, as a board does, with the telemetry of a recording at the pace of its node.
    fn run(&self, page: &[u8], telemetry: &[u8], network: SocketAddr) {
        let settings = wifi_of(page).expect("settings of Wi-Fi");
        assert_eq!((&*settings.ssid, &*settings.password), ("hall", "correct horse"));
        let gateway = RefCell::new(Gateway::<{ 64 << 10 }>::new(GatewayIdentity::of(&settings, 1, 0x1001), 77));
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
        socket.connect(network).expect("an address");
        socket.set_nonblocking(true).expect("a mode");
        let begin = Instant::now();
        let clock = || u64::try_from(begin.elapsed().as_micros()).expect("a short test");
        let mut link = Socket { socket, to: network };
        let mut task = pin!(firmware_gateway::run(&gateway, &mut link, Pause, clock));
        let mut frames = telemetry.split_inclusive(|byte| *byte == 0).map(|frame| {
            let mut decoder = wire::telemetry::Decoder::new();
            let message = frame.iter().find_map(|byte| decoder.feed(*byte)).and_then(Result::ok);
            (message.expect("a frame").t_us(), frame)
        });
        let mut next = frames.next();
        let mut messages = FrameReader::new();
        while !self.is_over.load(Ordering::Relaxed) {
            while let Some((_, frame)) = next.filter(|(t_us, _)| *t_us <= clock()) {
                gateway.borrow_mut().write(frame, clock());
                next = frames.next();
            }
            let mut byte = [0];
            while gateway.borrow_mut().read(&mut byte) > 0 {
                // As the tag at whose anchor this is would answer.
                let Some(message) = messages.feed(byte[0]) else { continue };
                let (t_us, number, code) = (clock(), message.data.number(), Answer::Taken as u8);
                let answer = TagAnswer { t_us, tag: message.tag, number, age_us: 0, code };
                gateway.borrow_mut().write(encode(&answer.into(), &mut [0; MAX_FRAME]), clock());
            }
            let polled = task.as_mut().poll(&mut Context::from_waker(Waker::noop()));
            assert!(polled.is_pending(), "the station was silent for half a minute");
            let is_read = gateway.borrow().is_read(clock());
            self.is_read.store(is_read, Ordering::Relaxed);
            self.was_read.fetch_or(is_read, Ordering::Relaxed);
            self.is_done.store(next.is_none() && gateway.borrow().is_empty(), Ordering::Relaxed);
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(gateway.borrow().lost(), 0);
    }
}

fn wait(what: &str, is_there: impl Fn() -> bool) {
    let begin = Instant::now();
    while !is_there() {
        assert!(begin.elapsed() < Duration::from_secs(60), "not within a minute: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

#[test]
fn telemetry_of_a_provisioned_node_arrives_over_a_bad_network_and_a_kill() {
    let folder = Folder::with(&[]);
    let network = LossyNetwork::start();
    folder.write("site.toml", SITE.replace("STATION", &network.address.to_string()).as_bytes());
    let made = folder.run("provision --config site.toml --out tag.bin").ok();
    assert!(made.stderr.contains("made keys in gateways.toml for tag-1"), "{}", made.stderr);
    folder.run("simulate --tags 1 --seconds 5 --rate 10 --fidelity air --out run --quiet").ok();
    let (page, telemetry) = (folder.read("tag.bin"), folder.read("run/telemetry.bin"));
    let mut station = Station::start(&folder, "--store tags.db --gateways gateways.toml udp:127.0.0.1:0");
    network.lead_to(datagrams(&station));
    let (node, to) = (&Node::default(), network.address);
    let path = "/api/v1/tags/0x1001/positions?site=site&limit=1000";
    let station = std::thread::scope(|scope| {
        scope.spawn(move || node.run(&page[..4096], &telemetry, to));
        let over = Over(node);
        station.wait(path, |history| history.as_array().is_some_and(|rows| rows.len() > 5));
        assert!(node.was_read.load(Ordering::Relaxed));
        station.kill();
        wait("the node notices it", || !node.is_read.load(Ordering::Relaxed));
        let station = Station::start(&folder, "--store tags.db --gateways gateways.toml udp:127.0.0.1:0");
        network.lead_to(datagrams(&station));
        wait("all is taken", || node.is_done.load(Ordering::Relaxed) && node.is_read.load(Ordering::Relaxed));
        let messages = "/api/v1/tags/0x1002/messages";
        station.send("POST", messages, r#"{"content": {"identify_s": 9}}"#);
        station.wait(messages, |messages| messages[0]["state"] == "taken");
        drop(over);
        station
    });
    let stdout = String::from_utf8(folder.read("run/positions.csv")).expect("UTF-8");
    let rows = Run { code: Some(0), stdout, stderr: String::new() };
    let expected: Vec<_> =
        rows.numbers("t_s").into_iter().zip(rows.numbers("x_m")).filter(|row| row.1.is_finite()).collect();
    assert!(expected.len() > 20, "{}", expected.len());
    let history = station.wait(path, |all| all.as_array().is_some_and(|rows| rows.len() >= expected.len()));
    let rows: Vec<_> = history.as_array().expect("a list").iter().rev().collect();
    assert_eq!(rows.len(), expected.len());
    let time = |row: &serde_json::Value| row["t"].as_str().and_then(|t| t.parse::<Utc>().ok()).expect("a time");
    for (row, (t_s, x_m)) in rows.iter().zip(&expected) {
        assert!((row["x_m"].as_f64().expect("a number") - x_m).abs() < 1.5e-3, "{row}");
        // The node has no calendar. On a busy machine its clock and the station's differ by the time of a datagram.
        let late_s = time(row).since(time(rows[0])).as_secs_f64() - (t_s - expected[0].0);
        assert!(late_s.abs() < 2.0, "{late_s} s");
        assert!(Utc::now().since(time(row)) < Duration::from_secs(300));
    }
}

/// Ends the node, also where the test fails.
struct Over<'n>(&'n Node);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.is_over.store(true, Ordering::Relaxed);
    }
}
