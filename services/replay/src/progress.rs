//! How far a replay has come, on standard error, in place, and only for a person at a terminal.

use std::io::{self, IsTerminal, Write};
use std::time::{Duration, Instant};

use shared_types::Time;

/// Redrawn at most so often.
const EVERY: Duration = Duration::from_millis(200);
/// The clock is asked once in so many calls: it costs more than the call.
const CALLS: u32 = 256;

/// One line, redrawn.
#[derive(Debug)]
pub struct Progress {
    shown: bool,
    started: Instant,
    drawn: Instant,
    first: Option<Time>,
    calls: u32,
}

impl Progress {
    /// Shown if standard error is a terminal.
    pub fn new() -> Progress {
        let now = Instant::now();
        Progress { shown: io::stderr().is_terminal(), started: now, drawn: now, first: None, calls: 0 }
    }

    /// The replay has come to `t`.
    pub fn at(&mut self, t: Time) {
        let first = *self.first.get_or_insert(t);
        self.calls = (self.calls + 1) % CALLS;
        if !self.shown || self.calls != 0 || self.drawn.elapsed() < EVERY {
            return;
        }
        self.drawn = Instant::now();
        let data = (t - first).as_seconds();
        let speed = data / self.started.elapsed().as_secs_f64();
        // A terminal that went away is no reason to stop.
        let _ = write!(io::stderr(), "\r\x1b[K{data:.0} s of data, {speed:.0} times real time");
    }

    /// Clears the line.
    pub fn done(&mut self) {
        if self.shown {
            let _ = write!(io::stderr(), "\r\x1b[K");
        }
    }
}

impl Default for Progress {
    fn default() -> Self {
        Progress::new()
    }
}
