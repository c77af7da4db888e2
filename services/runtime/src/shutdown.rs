//! The wish to stop, and sleeping until something is due or stopping is wished.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rustix::io::Errno;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};

use crate::clock::monotonic_now;
use crate::error::RuntimeError;

/// Longest uninterrupted sleep, ns: the signal may reach another thread than the one that sleeps.
const NAP: i64 = 50_000_000;

/// Set by SIGTERM, SIGINT and SIGHUP (the terminal is gone), or by hand.
#[derive(Clone, Debug, Default)]
pub struct Shutdown(Arc<AtomicBool>);

impl Shutdown {
    /// Catches the three signals from now on. A limit on the size of files (`LimitFSIZE=`) is from now on an error of the write that
    /// meets it, as a full disk is, and not the end of the process.
    ///
    /// # Errors
    /// [`RuntimeError::Signals`] when the operating system refuses.
    pub fn on_signals() -> Result<Shutdown, RuntimeError> {
        let shutdown = Shutdown::default();
        for signal in [SIGTERM, SIGINT, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&shutdown.0)).map_err(RuntimeError::Signals)?;
        }
        signal_hook::flag::register(SIGXFSZ, Arc::default()).map_err(RuntimeError::Signals)?;
        Ok(shutdown)
    }

    /// Whether the process is to stop.
    pub fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Stop from within.
    pub fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Sleeps until the monotonic time `mono` (ns); false if the process is to stop.
    pub fn sleep_until(&self, mono: i64) -> bool {
        while !self.requested() {
            let wake = mono.min(monotonic_now() + NAP);
            let time = Timespec { tv_sec: wake.div_euclid(1_000_000_000), tv_nsec: wake.rem_euclid(1_000_000_000) };
            match clock_nanosleep_absolute(ClockId::Monotonic, &time) {
                Ok(()) if wake == mono => return !self.requested(),
                Ok(()) | Err(Errno::INTR) => {}
                // Only a time that is none is refused: it is past.
                Err(_) => return !self.requested(),
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sleeping_ends_at_its_time_or_at_once_when_stopping() {
        let shutdown = Shutdown::default();
        let due = monotonic_now() + 3_000_000;
        assert!(shutdown.sleep_until(due));
        assert!(monotonic_now() >= due);
        shutdown.request();
        assert!(!shutdown.sleep_until(i64::MAX));
    }
}
