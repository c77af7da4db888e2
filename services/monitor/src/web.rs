//! The view for a browser: a page, a stream of events and the past, served by a thread of its own.
//!
//! ```text
//! monitor's loop -- looks, a bounded queue that is never waited for --> page's thread -- HTTP --> browsers
//! ```
//!
//! The thread that drains shared memory never waits for a browser: a look that the queue does not take is left out, a
//! browser that is too slow misses events and asks for the history again. Nothing that comes in over HTTP reaches anything
//! but this thread, and there is no verb that changes something.

mod address;
mod assets;
mod guard;
mod hub;
mod metrics;
mod routes;
mod serve;

use std::io;
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use tokio::sync::mpsc;
use tracing::{error, warn};

pub use address::{WebAddress, WebArgs, WebError, listen};
pub(crate) use assets::one_file;
use guard::Guard;
use hub::Hub;
pub(crate) use hub::Look;

use crate::snapshot::Snapshot;

/// Looks that may wait for the page's thread: some three seconds.
const WAITING: usize = 32;

/// The page of a live run. Dropped, it is gone.
#[derive(Debug)]
pub(crate) struct Page {
    looks: Option<mpsc::Sender<Look>>,
    thread: Option<JoinHandle<()>>,
    address: SocketAddr,
    left_out: u64,
}

impl Page {
    /// Serves the page at `listener`.
    pub(crate) fn open(listener: TcpListener, token: Option<String>, snapshot: Snapshot) -> Result<Page, WebError> {
        let address = listener.local_addr().map_err(WebError::Thread)?;
        let (looks, queue) = mpsc::channel(WAITING);
        let hub = Arc::new(Hub::live(snapshot));
        let serve = move || {
            if let Err(error) = serve_looks(listener, Guard { token }, hub, queue) {
                error!(%error, "the page is not served any more");
            }
        };
        let thread = thread::Builder::new().name("web".to_owned()).spawn(serve).map_err(WebError::Thread)?;
        Ok(Page { looks: Some(looks), thread: Some(thread), address, left_out: 0 })
    }

    /// Where it is.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Shows a look. Never waits.
    pub(crate) fn show(&mut self, look: Look) {
        let Some(looks) = &self.looks else { return };
        match looks.try_send(look) {
            Ok(()) => {}
            Err(mpsc::error::TrySendError::Full(_)) => {
                if self.left_out == 0 {
                    warn!("the page's thread does not keep up; it misses looks");
                }
                self.left_out += 1;
            }
            // It has said why.
            Err(mpsc::error::TrySendError::Closed(_)) => self.looks = None,
        }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.looks = None;
        if let Some(thread) = self.thread.take() {
            // A panic there has been printed.
            let _ = thread.join();
        }
    }
}

fn serve_looks(listener: TcpListener, guard: Guard, hub: Arc<Hub>, mut looks: mpsc::Receiver<Look>) -> io::Result<()> {
    let router = routes::router(Arc::clone(&hub), guard);
    runtime()?.block_on(async move {
        let fold = async {
            while let Some(look) = looks.recv().await {
                hub.fold(look);
            }
        };
        tokio::select! {
            served = serve::serve(listener, router) => served,
            () = fold => Ok(()),
        }
    })
}

/// Serves a finished run, whose history is `json` and whose end is `snapshot`, until `is_over`.
pub(crate) fn serve_finished(
    listener: TcpListener,
    token: Option<String>,
    json: String,
    snapshot: Snapshot,
    mut is_over: impl FnMut() -> bool,
) -> io::Result<()> {
    const LOOK: std::time::Duration = std::time::Duration::from_millis(100);
    let router = routes::router(Arc::new(Hub::finished(json, snapshot)), Guard { token });
    runtime()?.block_on(async move {
        let until_over = async {
            while !is_over() {
                tokio::time::sleep(LOOK).await;
            }
        };
        tokio::select! {
            served = serve::serve(listener, router) => served,
            () = until_over => Ok(()),
        }
    })
}

fn runtime() -> io::Result<tokio::runtime::Runtime> {
    tokio::runtime::Builder::new_current_thread().enable_all().build()
}
