//! Connections: so many at a time, a head within seconds, and no client that takes nothing holds memory.

use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustix::net::sockopt::{set_socket_send_buffer_size, set_tcp_user_timeout};
use tokio::net::TcpStream;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tracing::debug;

/// Connections at one time; further ones are told to come later.
const CONNECTIONS: usize = 400;

/// A request's head must be there after this.
const HEAD: Duration = Duration::from_secs(10);

/// A client that takes nothing for so long is cut off, ms.
const TAKES_NOTHING: u32 = 30_000;

/// What waits for one client in this process, and in the kernel, bytes.
const BUFFER: usize = 64 * 1024;

const FULL: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nRetry-After: 5\r\nConnection: close\r\nContent-Type: text/plain\r\n\
    Content-Length: 48\r\n\r\ntoo many connections at one time; try again soon";

/// Answers whoever connects, until it is dropped.
pub(super) async fn serve(listener: TcpListener, router: Router) -> io::Result<()> {
    listener.set_nonblocking(true)?;
    let listener = tokio::net::TcpListener::from_std(listener)?;
    let permits = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) => {
                // Out of file descriptors, or the client is gone already: neither ends the page.
                debug!(%error, "a connection was not accepted");
                tokio::time::sleep(Duration::from_millis(100)).await;
                continue;
            }
        };
        match Arc::clone(&permits).try_acquire_owned() {
            Ok(permit) => drop(tokio::spawn(connection(stream, router.clone(), permit))),
            Err(_) => drop(tokio::spawn(turn_away(stream))),
        }
    }
}

async fn connection(stream: TcpStream, router: Router, _permit: OwnedSemaphorePermit) {
    // Each is a courtesy: where the system knows it not, the rest still bounds what a client can hold.
    let _ = stream.set_nodelay(true);
    let _ = set_tcp_user_timeout(&stream, TAKES_NOTHING);
    let _ = set_socket_send_buffer_size(&stream, BUFFER);
    let served = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD)
        .max_buf_size(BUFFER)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .await;
    if let Err(error) = served {
        debug!(%error, "a connection ended early");
    }
}

async fn turn_away(stream: TcpStream) {
    // It may be gone already. A connection closed before its request was read would take the answer with it.
    let _ = stream.try_write(FULL);
    if let Ok(Ok(())) = tokio::time::timeout(Duration::from_secs(1), stream.readable()).await {
        let _ = stream.try_read(&mut [0; 4096]);
    }
}
