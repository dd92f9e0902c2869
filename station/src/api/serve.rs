//! Connections to requests, until the station stops.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::http::StatusCode;
use axum::{Extension, Router};
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

use super::access::{Access, Peer};
use super::problem::Problem;
use super::{App, Station, router, stopped};
use crate::net::limits::Connection;
use crate::net::write_timeout::WriteTimeout;

/// Requests that run when the station stops have this time to end.
const END: Duration = Duration::from_secs(10);
/// The greatest head of a request, bytes.
const HEAD: usize = 32 * 1024;

/// Serves the API until `stop` is done, and then until the requests that run are answered. WebSockets and
/// event streams are closed.
///
/// # Errors
/// [`io::ErrorKind::InvalidInput`]: [`Access::Open`] at an address that is not a loopback one.
pub async fn serve(listener: TcpListener, app: App, stop: impl Future) -> io::Result<()> {
    let address = listener.local_addr()?;
    if app.access == Access::Open && !address.ip().to_canonical().is_loopback() {
        let detail = format!("{address} can be reached from other hosts: tokens are needed, or a loopback address");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, detail));
    }
    let station = Arc::new(Station::new(app));
    let router = router(station.clone());
    let renewal = station.app.tls.clone().map(|tls| tokio::spawn(tls.keep_renewed(station.app.limits.renewal)));
    let search = station.app.oidc.clone().map(|oidc| tokio::spawn(oidc.keep_found()));
    let mut running = JoinSet::new();
    tokio::pin!(stop);
    loop {
        let accepted = tokio::select! {
            _ = &mut stop => break,
            Some(_) = running.join_next() => continue,
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((stream, peer)) => match station.connections.open(peer.ip(), station.app.proxies.has(peer.ip())) {
                Some(connection) => {
                    running.spawn(talk(station.clone(), router.clone(), stream, peer, connection));
                }
                None => log::warn!("{peer}: too many connections"),
            },
            // Of one connection, or there are no more files: those that end make room.
            Err(error) => {
                log::warn!("a connection cannot be accepted: {error}");
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
    }
    drop(listener);
    for task in renewal.into_iter().chain(search) {
        task.abort();
    }
    station.stop.send_replace(true);
    if tokio::time::timeout(END, station.connections.closed()).await.is_err() {
        log::warn!("{} connections are cut", station.connections.open_now());
    }
    Ok(())
}

async fn talk(station: Arc<Station>, router: Router, stream: TcpStream, peer: SocketAddr, connection: Connection) {
    // Positions are small and shall arrive at once.
    if let Err(error) = stream.set_nodelay(true) {
        log::debug!("{peer}: {error}");
    }
    let Some(tls) = &station.app.tls else { return answer(&station, router, stream, peer, connection).await };
    let (mut stop, plain_answer) = (station.stop.subscribe(), plain_answer());
    let greeted = tokio::select! {
        greeted = tokio::time::timeout(station.app.limits.handshake, tls.accept(stream, &plain_answer)) => greeted,
        () = stopped(&mut stop) => return,
    };
    match greeted {
        Ok(Ok(stream)) => answer(&station, router, stream, peer, connection).await,
        Ok(Err(error)) => log::debug!("{peer}: {error}"),
        Err(_) => log::debug!("{peer}: the handshake took too long"),
    }
}

/// The answer to a request that came without TLS.
fn plain_answer() -> String {
    let problem = Problem::new(StatusCode::BAD_REQUEST, "this port speaks TLS: the address begins with https://");
    let body = serde_json::to_string(&problem).unwrap_or_default();
    format!(
        "HTTP/1.1 400 Bad Request\r\nContent-Type: application/problem+json\r\nContent-Length: {}\r\n\
         Connection: close\r\n\r\n{body}",
        body.len()
    )
}

/// Answers the requests of a connection.
async fn answer<S>(station: &Station, router: Router, stream: S, peer: SocketAddr, connection: Connection)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let limits = &station.app.limits;
    let stream = TokioIo::new(WriteTimeout::new(stream, limits.write));
    let router = router.layer(Extension(Peer(peer))).layer(Extension(connection));
    let talk = hyper::server::conn::http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(limits.head)
        .max_buf_size(HEAD)
        .serve_connection(stream, TowerToHyperService::new(router))
        .with_upgrades();
    tokio::pin!(talk);
    let mut stop = station.stop.subscribe();
    let ended = tokio::select! {
        ended = talk.as_mut() => ended,
        () = stopped(&mut stop) => {
            talk.as_mut().graceful_shutdown();
            talk.await
        }
    };
    if let Err(error) = ended {
        log::debug!("{peer}: {error}");
    }
}
