//! Sleeping until something has been sent.

use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::prelude::ipc;

use crate::layer::Listens;

/// Longest sleep. A ring can be lost or merged with another, and a wish to stop rings nobody: whoever wakes drains all his
/// channels, rung or not.
pub const WAIT: Duration = Duration::from_millis(50);

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

    /// Sleeps until rung, for [`WAIT`] at most; true if rung. Drain every channel after it in either case.
    pub fn wait(&self) -> bool {
        self.wait_for(WAIT)
    }

    /// As [`Waiter::wait`], with another limit.
    pub fn wait_for(&self, limit: Duration) -> bool {
        let Some(listener) = &self.listener else {
            std::hint::spin_loop();
            return true;
        };
        match listener.listen(limit) {
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
