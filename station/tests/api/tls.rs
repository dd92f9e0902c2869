//! Encrypted connections, with a client of rustls and certificates made here.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::StreamExt;
use http_body_util::{BodyExt, Full};
use hyper::body::Bytes;
use hyper::client::conn::http1::{SendRequest, handshake};
use hyper::{Method, Request, header};
use hyper_util::rt::TokioIo;
use rcgen::{CertifiedKey, KeyPair, generate_simple_self_signed};
use serde_json::{Value, json};
use station_core::api::{Access, RequestLimits, Tls, TlsCause, Token, UserRole};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::version::{TLS12, TLS13};
use tokio_rustls::rustls::{ClientConfig, RootCertStore, SupportedProtocolVersion, crypto::ring};

use crate::api::client::{PATIENCE, Station, generous, station_with};

/// The files of a certificate and its key.
struct Files {
    folder: tempfile::TempDir,
}

impl Files {
    /// Files with a new certificate for `localhost`.
    fn new() -> (Self, CertificateDer<'static>) {
        let files = Self { folder: tempfile::tempdir().unwrap() };
        let certificate = files.renew();
        (files, certificate)
    }

    fn certificate(&self) -> PathBuf {
        self.folder.path().join("certificate.pem")
    }

    fn key(&self) -> PathBuf {
        self.folder.path().join("key.pem")
    }

    /// Replaces certificate and key.
    fn renew(&self) -> CertificateDer<'static> {
        let CertifiedKey { cert, signing_key } = generate_simple_self_signed(["localhost".to_owned()]).unwrap();
        std::fs::write(self.certificate(), cert.pem()).unwrap();
        std::fs::write(self.key(), signing_key.serialize_pem()).unwrap();
        cert.der().clone()
    }

    fn read(&self) -> Arc<Tls> {
        Arc::new(Tls::read(&self.certificate(), &self.key()).unwrap())
    }
}

/// A station with TLS, the files of its certificate, and the certificate.
async fn encrypted(limits: RequestLimits) -> (Station, Files, CertificateDer<'static>) {
    let (files, certificate) = Files::new();
    let access = Access::Tokens(vec![Token::new("ana", UserRole::View, "secret")]);
    let station = station_with(access, limits, Some(files.read())).await;
    (station, files, certificate)
}

/// A connection of a client that trusts this certificate alone.
async fn greet(
    station: &Station,
    trusted: &CertificateDer<'static>,
    versions: &[&'static SupportedProtocolVersion],
) -> std::io::Result<TlsStream<TcpStream>> {
    let mut roots = RootCertStore::empty();
    roots.add(trusted.clone()).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(versions)
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let stream = TcpStream::connect(station.address).await?;
    let name = ServerName::try_from("localhost").unwrap();
    TlsConnector::from(Arc::new(config)).connect(name, stream).await
}

/// The same, for HTTP.
async fn connect(
    station: &Station,
    trusted: &CertificateDer<'static>,
    versions: &[&'static SupportedProtocolVersion],
) -> std::io::Result<SendRequest<Full<Bytes>>> {
    let stream = greet(station, trusted, versions).await?;
    let (sender, connection) = handshake(TokioIo::new(stream)).await.unwrap();
    tokio::spawn(connection);
    Ok(sender)
}

/// The status of `GET /healthz`.
async fn health(client: &mut SendRequest<Full<Bytes>>) -> u16 {
    let request = Request::builder().uri("/healthz").header(header::HOST, "localhost").body(Full::default()).unwrap();
    let (parts, body) = client.send_request(request).await.unwrap().into_parts();
    body.collect().await.unwrap();
    parts.status.as_u16()
}

/// What the station sends until it closes the connection.
async fn until_closed(stream: &mut TcpStream) -> Vec<u8> {
    let mut all = Vec::new();
    // An error: it was reset, which closes it as well.
    let _ = tokio::time::timeout(PATIENCE, stream.read_to_end(&mut all)).await.expect("closed in time");
    all
}

#[tokio::test]
async fn both_versions_of_tls_work_and_cookies_are_for_encrypted_connections_only() {
    let (station, _files, certificate) = encrypted(generous()).await;
    for version in [&TLS12, &TLS13] {
        let mut client = connect(&station, &certificate, &[version]).await.unwrap();
        assert_eq!([health(&mut client).await, health(&mut client).await], [200, 200]);
        let login = Request::builder()
            .method(Method::POST)
            .uri("/login")
            .header(header::HOST, "localhost")
            .header(header::CONTENT_TYPE, "application/json")
            .body(Full::from(json!({"token": "secret"}).to_string()))
            .unwrap();
        let answer = client.send_request(login).await.unwrap();
        let cookie = answer.headers()[header::SET_COOKIE].to_str().unwrap();
        assert!(cookie.ends_with("; HttpOnly; SameSite=Strict; Secure"), "{cookie}");
    }
}

#[tokio::test]
async fn positions_arrive_by_an_encrypted_websocket() {
    let (files, certificate) = Files::new();
    let station = station_with(Access::Open, generous(), Some(files.read())).await;
    let stream = greet(&station, &certificate, &[&TLS13]).await.unwrap();
    let (mut socket, _) = tokio_tungstenite::client_async("wss://localhost/api/v1/live", stream).await.unwrap();
    station.report_position("0x1001", 1.0, 2.0).await;
    let message = tokio::time::timeout(PATIENCE, socket.next()).await.unwrap().unwrap().unwrap();
    let position: Value = serde_json::from_str(message.to_text().unwrap()).unwrap();
    assert_eq!((&position["tag"], &position["x_m"]), (&json!("0x1001"), &json!(1.0)));
    drop(socket);
    let took = station.stop().await;
    assert!(took < Duration::from_secs(5), "{took:?}");
}

#[tokio::test]
async fn a_stranger_to_the_certificate_gets_no_connection() {
    let (station, _files, _) = encrypted(generous()).await;
    let (_, other) = Files::new();
    assert!(connect(&station, &other, &[&TLS13]).await.is_err());
}

#[tokio::test]
async fn plain_http_on_the_port_of_tls_is_told_what_to_do() {
    let (station, _files, _) = encrypted(generous()).await;
    let mut stream = TcpStream::connect(station.address).await.unwrap();
    // A body that nobody reads must not cost the answer.
    let request =
        format!("POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5000\r\n\r\n{}", "x".repeat(5000));
    stream.write_all(request.as_bytes()).await.unwrap();
    let answer = String::from_utf8(until_closed(&mut stream).await).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 400 ") && head.contains("application/problem+json"), "{head}");
    assert!(head.contains(&format!("Content-Length: {}\r\n", body.len())), "{head}");
    assert!(body.contains("https://"), "{body}");
}

#[tokio::test]
async fn garbage_and_silence_hold_nobody_up_and_are_closed() {
    // Nothing at all; the head of a record that never comes; a record that is no handshake; noise.
    let begins = [b"".as_slice(), &[22, 3, 1, 2, 0], &[22, 3, 1, 0, 4, 0xFF, 0xFF, 0xFF, 0xFF], &[0x80; 64]];
    let begun = async |station: &Station, times: usize| {
        let mut streams = Vec::new();
        for begin in begins.repeat(times) {
            let mut stream = TcpStream::connect(station.address).await.unwrap();
            stream.write_all(begin).await.unwrap();
            streams.push(stream);
        }
        streams
    };
    // The station waits an hour for each of them.
    let patient = RequestLimits { handshake: Duration::from_secs(3600), ..generous() };
    let (station, _files, certificate) = encrypted(patient).await;
    let _slow = begun(&station, 20).await;
    let served = async { health(&mut connect(&station, &certificate, &[&TLS13]).await.unwrap()).await };
    assert_eq!(tokio::time::timeout(PATIENCE, served).await.unwrap(), 200);

    let limits = RequestLimits { handshake: Duration::from_millis(600), ..generous() };
    let (station, _files, certificate) = encrypted(limits).await;
    let mut slow = begun(&station, 1).await;
    // A busy computer may take longer for its handshake than the station waits.
    let mut client = loop {
        if let Ok(client) = connect(&station, &certificate, &[&TLS13]).await {
            break client;
        }
    };
    assert_eq!(health(&mut client).await, 200);
    for stream in &mut slow {
        let answer = until_closed(stream).await;
        // Nothing, or an alert (RFC 8446, section 5.1: content type 21).
        assert!(answer.first().is_none_or(|first| *first == 21), "{answer:?}");
    }
    // The one that was there is still there.
    assert_eq!(health(&mut client).await, 200);
}

#[tokio::test]
async fn handshakes_that_are_not_over_count_as_connections() {
    let (station, _files, certificate) = encrypted(RequestLimits { connections_per_address: 2, ..generous() }).await;
    let held = [TcpStream::connect(station.address).await.unwrap(), TcpStream::connect(station.address).await.unwrap()];
    assert!(connect(&station, &certificate, &[&TLS13]).await.is_err());
    drop(held);
    let connected = async {
        loop {
            if let Ok(client) = connect(&station, &certificate, &[&TLS13]).await {
                break client;
            }
        }
    };
    let mut client = tokio::time::timeout(PATIENCE, connected).await.unwrap();
    assert_eq!(health(&mut client).await, 200);
}

#[tokio::test]
async fn a_renewed_certificate_is_for_new_connections_and_a_wrong_one_changes_nothing() {
    let limits = RequestLimits { renewal: Duration::from_millis(50), ..generous() };
    let (station, files, first) = encrypted(limits).await;
    let mut early = connect(&station, &first, &[&TLS13]).await.unwrap();
    assert_eq!(health(&mut early).await, 200);

    let second = files.renew();
    let start = Instant::now();
    let mut late = loop {
        if let Ok(client) = connect(&station, &second, &[&TLS13]).await {
            break client;
        }
        assert!(start.elapsed() < PATIENCE, "the new certificate is not used");
        tokio::time::sleep(Duration::from_millis(20)).await;
    };
    assert_eq!([health(&mut early).await, health(&mut late).await], [200, 200]);
    assert!(connect(&station, &first, &[&TLS13]).await.is_err());

    // Another key, half a file, no file.
    let damages: [&dyn Fn(); 3] = [
        &|| std::fs::write(files.key(), KeyPair::generate().unwrap().serialize_pem()).unwrap(),
        &|| std::fs::write(files.certificate(), "-----BEGIN CERTIFICATE-----\nMII").unwrap(),
        &|| std::fs::remove_file(files.certificate()).unwrap(),
    ];
    for damage in damages {
        damage();
        tokio::time::sleep(Duration::from_millis(250)).await;
        assert_eq!(health(&mut connect(&station, &second, &[&TLS13]).await.unwrap()).await, 200);
    }
    assert_eq!([health(&mut early).await, health(&mut late).await], [200, 200]);
    let took = station.stop().await;
    assert!(took < Duration::from_secs(5), "{took:?}");
}

#[test]
fn wrong_files_are_named_with_their_cause() {
    let (files, _) = Files::new();
    let [certificate, key] = [files.certificate(), files.key()].map(|file| std::fs::read_to_string(file).unwrap());
    let other = KeyPair::generate().unwrap().serialize_pem();
    let half = &certificate[..certificate.len() / 2];
    let encrypted = key.replace("PRIVATE KEY", "ENCRYPTED PRIVATE KEY");
    for (new_certificate, new_key, wrong, is_cause) in [
        (
            "",
            key.as_str(),
            "certificate.pem",
            (|cause| matches!(cause, TlsCause::NoCertificate)) as fn(&TlsCause) -> bool,
        ),
        (&key, &key, "certificate.pem", |cause| matches!(cause, TlsCause::NoCertificate)),
        (half, &key, "certificate.pem", |cause| matches!(cause, TlsCause::Pem)),
        ("-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n", &key, "certificate.pem", |cause| {
            matches!(cause, TlsCause::Refused(_))
        }),
        (&certificate, &other, "key.pem", |cause| matches!(cause, TlsCause::OtherKey)),
        (&certificate, &certificate, "key.pem", |cause| matches!(cause, TlsCause::NoKey)),
        (&certificate, &encrypted, "key.pem", |cause| matches!(cause, TlsCause::NoKey)),
        (&certificate, &"x".repeat(2 << 20), "key.pem", |cause| matches!(cause, TlsCause::TooLarge)),
    ] {
        std::fs::write(files.certificate(), new_certificate).unwrap();
        std::fs::write(files.key(), new_key).unwrap();
        let error = Tls::read(&files.certificate(), &files.key()).unwrap_err();
        assert!(error.file.ends_with(wrong) && is_cause(&error.cause), "{error}");
        assert!(error.to_string().contains(wrong), "{error}");
    }
    std::fs::remove_file(files.key()).unwrap();
    assert!(matches!(Tls::read(&files.certificate(), &files.key()).unwrap_err().cause, TlsCause::Read(_)));
}
