//! Sleeping until something has been sent.

use std::time::Duration;

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::prelude::ipc;

use crate::layer::Listens;

/// Longest sleep. A ring can be lost or merged with another, and a wish to stop rings nobody: whoever wakes drains all his
/// channels, rung or not.
pub const WAIT: Duration = Duration::from_millis(50);

/// What a time-out of the listener may be late by: the kernel counts that of a socket in its ticks (4 ms at 250 Hz), and rounds up
/// twice. 13 ms asked for were 20 ms slept.
const TICKS: Duration = Duration::from_millis(8);

/// So the last of a sleep whose end matters is slept in naps, whose clock is exact. A ring is heard at the end of one.
const NAP: Duration = Duration::from_micros(200);

/// Sleeps until its reader is rung, or, for a reader that has a core to itself, does not sleep.
#[derive(Debug)]
pub struct Waiter {
    /// None: nobody rings, and the reader looks without end.
    listener: Option<Box<dyn Listens>>,
}

impl Waiter {
    pub(crate) fn new(listener: Listener<ipc::Service>) -> Waiter {
        Waiter { listener: Some(Box::new(listener)) }
    }

    /// Never sleeps. Senders need not ring such a reader, which saves them 7 to 9 µs too.
    pub fn polling() -> Waiter {
        Waiter { listener: None }
    }

    /// Sleeps until rung, for about [`WAIT`] at most; true if rung. Drain every channel after it in either case.
    pub fn wait(&self) -> bool {
        self.hear(|listener| listener.listen(WAIT))
    }

    /// As [`Waiter::wait`], with a limit that is kept: it may return earlier, unrung, and never returns later than the scheduler
    /// makes it.
    pub fn wait_for(&self, limit: Duration) -> bool {
        self.hear(|listener| match limit.saturating_sub(TICKS) {
            Duration::ZERO => {
                std::thread::sleep(limit.min(NAP));
                listener.look()
            }
            surely => listener.listen(surely),
        })
    }

    fn hear(&self, listen: impl FnOnce(&dyn Listens) -> Result<u64, ListenerWaitError>) -> bool {
        let Some(listener) = &self.listener else {
            std::hint::spin_loop();
            return true;
        };
        match listen(listener.as_ref()) {
            Ok(rings) => rings > 0,
            Err(error) => {
                // A signal ends the wait early, which is what the caller wants; anything else must not spin.
                tracing::debug!(%error, "wait was cut short");
                std::thread::sleep(Duration::from_millis(1));
                false
            }
        }
    }
}
