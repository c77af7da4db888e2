//! The ends that a port holds, as trait objects: the layer is generic down to its last line, and whoever names one of its types
//! compiles (and drops) it anew. Here it is compiled once, for all; a call through a table costs a message a nanosecond.

use core::fmt::Debug;
use std::time::Duration;

use iceoryx2::node::Node;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::{Notifier, NotifierNotifyError};
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::{ConnectionFailure, UpdateConnections};
use iceoryx2::port::{ReceiveError, SendError};
use iceoryx2::prelude::ipc;
use iceoryx2_bb_posix::file_descriptor_set::{FileDescriptorSet, FileDescriptorSetWaitError, FileEvent};
use shared_types::Payload;

/// Puts messages into the queues of a channel's readers.
pub(crate) trait Sends<T>: Debug {
    /// How many readers got it.
    fn send(&self, message: T) -> Result<usize, SendError>;
    /// Connects readers who came since.
    fn update(&self) -> Result<(), ConnectionFailure>;
}

/// Takes messages out of a reader's queue.
pub(crate) trait Receives<T>: Debug {
    /// The oldest one.
    fn take(&self) -> Result<Option<T>, ReceiveError>;
}

/// Wakes a reader.
pub(crate) trait Rings: Debug {
    fn ring(&self) -> Result<usize, NotifierNotifyError>;
}

/// Sleeps until rung.
pub(crate) trait Listens: Debug {
    /// How often it was rung, from now or before, until `limit` at most.
    fn listen(&self, limit: Duration) -> Result<u64, ListenerWaitError>;
    /// How often it was rung so far.
    fn look(&self) -> Result<u64, ListenerWaitError>;
    /// Sleeps until it is rung, or has been and nobody looked, until `limit` at most, which is kept to the microsecond.
    fn sleep(&self, sleeper: &FileDescriptorSet, limit: Duration) -> Result<(), FileDescriptorSetWaitError>;
}

/// Keeps a process's node.
pub(crate) trait Holds: Debug {
    fn node(&self) -> &Node<ipc::Service>;
}

impl<T: Payload + Copy + Debug + 'static> Sends<T> for Publisher<ipc::Service, T, ()> {
    fn send(&self, message: T) -> Result<usize, SendError> {
        self.send_copy(message)
    }

    fn update(&self) -> Result<(), ConnectionFailure> {
        self.update_connections()
    }
}

impl<T: Payload + Copy + Debug + 'static> Receives<T> for Subscriber<ipc::Service, T, ()> {
    fn take(&self) -> Result<Option<T>, ReceiveError> {
        Ok(self.receive()?.map(|sample| *sample))
    }
}

impl Rings for Notifier<ipc::Service> {
    fn ring(&self) -> Result<usize, NotifierNotifyError> {
        self.notify()
    }
}

impl Listens for Listener<ipc::Service> {
    fn listen(&self, limit: Duration) -> Result<u64, ListenerWaitError> {
        self.timed_wait(|_| {}, limit)
    }

    fn look(&self) -> Result<u64, ListenerWaitError> {
        self.try_wait(|_| {})
    }

    fn sleep(&self, sleeper: &FileDescriptorSet, limit: Duration) -> Result<(), FileDescriptorSetWaitError> {
        match sleeper.add(self) {
            Ok(_while_it_sleeps) => sleeper.timed_wait(limit, FileEvent::Read, |_| {}).map(|_| ()),
            // It is the only one in there, and there is room; if there were not, a time-out that is late is better than one that hears nothing.
            Err(_) => {
                let _ = self.listen(limit);
                Ok(())
            }
        }
    }
}

impl Holds for Node<ipc::Service> {
    fn node(&self) -> &Node<ipc::Service> {
        self
    }
}
