//! The view for Foxglove, live: what a recording's MCAP holds (but for readings that only a recorder hears), as it is published.
//!
//! Foxglove's own server is behind the cargo feature `foxglove`, as it brings some forty crates; without it, asking for it is an
//! error that says so. It only listens: no capability by which a client could change something is offered.

#[cfg(not(feature = "foxglove"))]
mod absent;
#[cfg(feature = "foxglove")]
mod server;

use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr, TcpListener};

use shared_types::{
    BuoyFix, FrameOrigin, GnssFix, Heartbeat, KeyframeReport, LblRange, NavEstimate, RawReading, Truth,
};

#[cfg(not(feature = "foxglove"))]
use absent::Server;
#[cfg(feature = "foxglove")]
use server::Server;

use crate::web::WebAddress;

/// Port that Foxglove proposes; the next free one is taken when something listens there already.
const USUAL_PORT: u16 = 8765;

/// Ports that are tried.
const TRIES: u16 = 100;

/// The command line's share of it.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub struct FoxgloveArgs {
    /// Serve Foxglove live (ws://127.0.0.1:8765 or the next free port, or exactly where told; loopback only). In builds with the
    /// feature `foxglove`.
    #[arg(long, value_name = "ADDR:PORT", num_args = 0..=1, default_missing_value = "auto")]
    pub foxglove: Option<WebAddress>,
}

/// Why Foxglove cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum FoxgloveError {
    /// Built without it.
    #[error(
        "this build cannot serve Foxglove (build it by `cargo build --release --features foxglove`, or open the recording.mcap of `ilns run --out DIR`)"
    )]
    NotBuiltIn,
    /// Anybody on the network could look.
    #[error(
        "{address} can be reached from other machines, and Foxglove's protocol knows no token: serve it at 127.0.0.1 and reach it by `ssh -L {port}:127.0.0.1:{port} VEHICLE`", port = address.port()
    )]
    NotLoopback {
        /// Where.
        address: SocketAddr,
    },
    /// The port is taken.
    #[error(
        "Foxglove cannot be served at {address}: something listens there already (choose another with `--foxglove ADDR:PORT`, or leave the address out for the next free port)"
    )]
    InUse {
        /// Where.
        address: SocketAddr,
    },
    /// No free port.
    #[error("no port from {first} to {last} is free for Foxglove (name one with `--foxglove ADDR:PORT`)")]
    NoFreePort {
        /// First that was tried.
        first: u16,
        /// Last that was tried.
        last: u16,
    },
    /// Not an address of this machine, a privileged port, ...
    #[error("Foxglove cannot be served at {address}")]
    Bind {
        /// Where.
        address: SocketAddr,
        /// Why.
        source: std::io::Error,
    },
    /// No thread for it, or its server's own reasons.
    #[error("Foxglove's server cannot be started: {0}")]
    Server(String),
}

impl FoxgloveArgs {
    /// Where it is to be served, if at all: a port that is free now.
    ///
    /// # Errors
    /// [`FoxgloveError`]; asked for at all, it can be served or an error says why not.
    pub fn settle(&self) -> Result<Option<SocketAddr>, FoxgloveError> {
        match self.foxglove {
            None => Ok(None),
            Some(_) if cfg!(not(feature = "foxglove")) => Err(FoxgloveError::NotBuiltIn),
            Some(WebAddress::At(address)) if !address.ip().is_loopback() => Err(FoxgloveError::NotLoopback { address }),
            Some(WebAddress::At(address)) => try_bind(address).map(Some),
            Some(WebAddress::Auto) => next_free().map(Some),
        }
    }
}

fn next_free() -> Result<SocketAddr, FoxgloveError> {
    let last = USUAL_PORT + TRIES - 1;
    for port in USUAL_PORT..=last {
        match try_bind(SocketAddr::new(Ipv4Addr::LOCALHOST.into(), port)) {
            Err(FoxgloveError::InUse { .. }) => {}
            found => return found,
        }
    }
    Err(FoxgloveError::NoFreePort { first: USUAL_PORT, last })
}

fn try_bind(address: SocketAddr) -> Result<SocketAddr, FoxgloveError> {
    let bound = TcpListener::bind(address).and_then(|listener| listener.local_addr());
    bound.map_err(|source| match source.kind() {
        ErrorKind::AddrInUse => FoxgloveError::InUse { address },
        _ => FoxgloveError::Bind { address, source },
    })
}

/// Shows messages to Foxglove, if it is served.
#[derive(Debug, Default)]
pub(crate) struct Foxglove(Option<Server>);

impl Foxglove {
    /// Serves it where `args` say, if they do, under the name of the set.
    pub(crate) fn open(args: &FoxgloveArgs, set: &str) -> Result<Foxglove, FoxgloveError> {
        let server = args.settle()?.map(|address| Server::open(address, set)).transpose()?;
        Ok(Foxglove(server))
    }

    /// Where it is.
    pub(crate) fn address(&self) -> Option<SocketAddr> {
        self.0.as_ref().map(Server::address)
    }

    pub(crate) fn frame_origin(&mut self, origin: &FrameOrigin) {
        if let Some(server) = &mut self.0 {
            server.origin([origin.lat_deg, origin.lon_deg, origin.height]);
        }
    }

    pub(crate) fn buoy(&mut self, fix: &BuoyFix) {
        self.reading(|| RawReading::Buoy(*fix));
    }

    pub(crate) fn lbl(&mut self, range: &LblRange) {
        self.reading(|| RawReading::Lbl(*range));
    }

    pub(crate) fn gnss(&mut self, fix: &GnssFix) {
        self.reading(|| RawReading::Gnss(*fix));
    }

    fn reading(&mut self, reading: impl FnOnce() -> RawReading) {
        if let Some(server) = &mut self.0 {
            server.reading(&reading());
        }
    }

    pub(crate) fn truth(&mut self, truth: &Truth) {
        if let Some(server) = &mut self.0 {
            server.truth(truth);
        }
    }

    pub(crate) fn diagnostics(&mut self, report: &KeyframeReport) {
        if let Some(server) = &mut self.0 {
            server.report(report);
        }
    }

    pub(crate) fn estimate(&mut self, estimate: &NavEstimate) {
        if let Some(server) = &mut self.0 {
            server.estimate(estimate);
        }
    }

    pub(crate) fn heartbeat(&mut self, beat: &Heartbeat) {
        if let Some(server) = &mut self.0 {
            server.heartbeat(beat);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settle(text: &str) -> Result<Option<SocketAddr>, FoxgloveError> {
        FoxgloveArgs { foxglove: Some(text.parse().expect("an address")) }.settle()
    }

    #[test]
    fn what_was_not_asked_for_is_not_served() {
        assert!(matches!(FoxgloveArgs::default().settle(), Ok(None)));
        assert_eq!(Foxglove::default().address(), None);
    }

    #[cfg(not(feature = "foxglove"))]
    #[test]
    fn a_build_without_it_says_how_to_have_it() {
        let error = settle("auto").expect_err("not built in").to_string();
        assert!(error.contains("--features foxglove") && error.contains("recording.mcap"), "{error}");
    }

    #[cfg(feature = "foxglove")]
    #[test]
    fn only_this_machine_is_served_and_a_port_in_use_is_named_with_the_mend() {
        let error = settle("0.0.0.0:8765").expect_err("everybody").to_string();
        assert!(error.contains("ssh -L 8765:127.0.0.1:8765"), "{error}");
        let listener = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let address = listener.local_addr().expect("bound");
        let error = settle(&address.to_string()).expect_err("in use").to_string();
        assert!(error.contains(&address.to_string()) && error.contains("--foxglove ADDR:PORT"), "{error}");
        assert!(settle("auto").expect("one of a hundred is free").is_some());
    }
}
