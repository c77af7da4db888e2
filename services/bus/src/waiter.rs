//! Sleeping until something has been sent.

use std::time::Duration;

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::prelude::ipc;
use iceoryx2_bb_posix::file_descriptor_set::FileDescriptorSet;

use crate::layer::Listens;

/// Longest sleep. A ring can be lost or merged with another, and a wish to stop rings nobody: whoever wakes drains all his
/// channels, rung or not.
pub const WAIT: Duration = Duration::from_millis(50);

/// Sleeps until its reader is rung, or, for a reader that has a core to itself, does not sleep.
#[derive(Debug)]
pub struct Waiter {
    /// None: nobody rings, and the reader looks without end.
    listener: Option<Box<dyn Listens>>,
    /// For a sleep whose end matters: a time-out of the listener itself is counted in the kernel's ticks (4 ms at 250 Hz) and rounded
    /// up twice.
    sleeper: FileDescriptorSet,
}

impl Waiter {
    pub(crate) fn new(listener: Listener<ipc::Service>) -> Waiter {
        Waiter { listener: Some(Box::new(listener)), sleeper: FileDescriptorSet::new() }
    }

    /// Never sleeps. Senders need not ring such a reader, which saves them 7 to 9 µs too.
    pub fn polling() -> Waiter {
        Waiter { listener: None, sleeper: FileDescriptorSet::new() }
    }

    /// Sleeps until rung, for about [`WAIT`] at most; true if rung. Drain every channel after it in either case.
    pub fn wait(&self) -> bool {
        self.hear(|listener| listener.listen(WAIT))
    }

    /// As [`Waiter::wait`], with a limit that is kept: it may return earlier, unrung, and never returns later than the scheduler
    /// makes it.
    pub fn wait_for(&self, limit: Duration) -> bool {
        self.hear(|listener| {
            if let Err(error) = listener.sleep(&self.sleeper, limit) {
                cut_short(&error);
            }
            listener.look()
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
                cut_short(&error);
                false
            }
        }
    }
}

/// A signal ends a wait early, which is what the caller wants; anything else must not spin.
fn cut_short(error: &dyn std::fmt::Debug) {
    tracing::debug!(?error, "a wait was cut short");
    std::thread::sleep(Duration::from_millis(1));
}
