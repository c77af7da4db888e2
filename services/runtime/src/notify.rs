//! What a service manager is told: that the process is ready, and that it makes progress.
//!
//! The protocol of `sd_notify(3)`: one datagram to the socket that the environment names. It is spoken here, on a socket that
//! is connected once, because the libraries for it open a socket and build a string at each word, and a loop may not allocate.

use std::ffi::OsString;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};

/// A line to the service manager, if one listens.
#[derive(Debug, Default)]
pub(crate) struct Notify {
    socket: Option<UnixDatagram>,
    is_ready: bool,
}

impl Notify {
    /// To whoever started this process, if he asked to be told.
    pub(crate) fn from_environment() -> Notify {
        Notify::to(std::env::var_os("NOTIFY_SOCKET"))
    }

    fn to(address: Option<OsString>) -> Notify {
        let connect = |address: OsString| -> std::io::Result<UnixDatagram> {
            let socket = UnixDatagram::unbound()?;
            // `@` stands for the abstract name space.
            let address = match address.as_bytes() {
                [b'@', name @ ..] => SocketAddr::from_abstract_name(name)?,
                path => SocketAddr::from_pathname(std::ffi::OsStr::from_bytes(path))?,
            };
            socket.connect_addr(&address)?;
            // A manager that does not listen must not hold up a loop.
            socket.set_nonblocking(true)?;
            Ok(socket)
        };
        let socket = address.and_then(|address| {
            connect(address).inspect_err(|error| tracing::warn!(%error, "the service manager cannot be told")).ok()
        });
        Notify { socket, is_ready: false }
    }

    /// The process is in its loop and has come round once more.
    pub(crate) fn progress(&mut self) {
        let word: &[u8] = if self.is_ready { b"WATCHDOG=1" } else { b"READY=1" };
        if let Some(socket) = &self.socket {
            // A word that is refused is followed by another half a second later.
            self.is_ready |= socket.send(word).is_ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manager_hears_first_that_it_is_ready_and_then_of_progress() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("notify");
        let manager = UnixDatagram::bind(&path).expect("a socket");
        let mut notify = Notify::to(Some(path.into()));
        let mut heard = || {
            notify.progress();
            let mut word = [0; 64];
            let length = manager.recv(&mut word).expect("it was sent");
            String::from_utf8_lossy(&word[..length]).into_owned()
        };
        assert_eq!([heard(), heard(), heard()], ["READY=1", "WATCHDOG=1", "WATCHDOG=1"]);
    }

    #[test]
    fn without_a_manager_nobody_is_told_and_nothing_fails() {
        Notify::to(None).progress();
        Notify::to(Some("/no/such/socket".into())).progress();
    }
}
