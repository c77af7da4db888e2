//! Sleeping until something has been sent.

use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::ipc;

/// Longest sleep. A ring can be lost or merged with another, and a wish to stop rings nobody: whoever wakes drains all his
/// channels, rung or not.
pub const WAIT: Duration = Duration::from_millis(50);

/// Sleeps until its reader is rung.
#[derive(Debug)]
pub struct Waiter {
    listener: Listener<ipc::Service>,
}

impl Waiter {
    pub(crate) fn new(listener: Listener<ipc::Service>) -> Waiter {
        Waiter { listener }
    }

    /// Sleeps until rung, for [`WAIT`] at most; true if rung. Drain every channel after it in either case.
    pub fn wait(&self) -> bool {
        self.wait_for(WAIT)
    }

    /// As [`Waiter::wait`], with another limit.
    pub fn wait_for(&self, limit: Duration) -> bool {
        match self.listener.timed_wait(|_| {}, limit) {
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
