//! Sending: stamp, hand over, ring. Never blocks.
//!
//! The layer takes a handle of a few words from the heap for each message and gives it back in the same call, without a
//! system call or lock; nothing else is allocated (`tests/allocations.rs`).

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use iceoryx2::port::BackpressureAction;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::prelude::{BackpressureStrategy, ipc};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use rustix::time::{ClockId, clock_gettime};
use shared_types::Message;

use crate::layer::{Rings, Sends};

/// What became of one message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Published {
    /// Its sequence number.
    pub sequence: u64,
    /// Readers that got it.
    pub delivered: usize,
    /// Readers whose queue was full.
    pub refused: usize,
}

/// A reader's bell, rung at every so many messages.
#[derive(Debug)]
pub(crate) struct Bell {
    notifier: Box<dyn Rings>,
    every: u32,
    unannounced: u32,
}

impl Bell {
    pub(crate) fn new(notifier: Notifier<ipc::Service>, every: u32) -> Bell {
        Bell { notifier: Box::new(notifier), every, unannounced: 0 }
    }

    fn ring(&mut self) {
        if self.unannounced < self.every {
            return;
        }
        self.unannounced = 0;
        if let Err(error) = self.notifier.ring() {
            // The reader looks after its queue every 50 ms anyway.
            tracing::debug!(?error, "a reader was not rung");
        }
    }
}

/// The sending port of a channel.
#[derive(Debug)]
pub struct Publisher<T: Message> {
    port: Box<dyn Sends<T>>,
    bells: Vec<Bell>,
    source: u16,
    epoch: u32,
    sequence: u64,
    refusals: Arc<AtomicU64>,
}

impl<T: Message> Publisher<T> {
    pub(crate) fn new(
        factory: &PortFactory<ipc::Service, T, ()>,
        bells: Vec<Bell>,
        source: u16,
        epoch: u32,
    ) -> Result<Publisher<T>, PublisherCreateError> {
        let refusals = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&refusals);
        let port = factory
            .publisher_builder()
            .max_loaned_samples(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .set_backpressure_handler(move |_| {
                count.fetch_add(1, Ordering::Relaxed);
                BackpressureAction::DiscardData
            })
            .create()?;
        Ok(Publisher { port: Box::new(port), bells, source, epoch, sequence: 0, refusals })
    }

    /// Stamps sequence, epoch, source, schema and time of publication, sends, and rings those who wait for the channel.
    ///
    /// Never blocks: a reader whose queue is full does not get it (or loses its oldest, as the channel's policy says). That
    /// the numbers in it are finite is the caller's care.
    pub fn publish(&mut self, message: T) -> Published {
        let published = self.publish_quietly(message);
        self.ring();
        published
    }

    /// As [`Publisher::publish`], but rings nobody: more follows at once, or nobody needs it soon.
    pub fn publish_quietly(&mut self, mut message: T) -> Published {
        let sequence = self.sequence;
        self.sequence += 1;
        let header = message.header_mut();
        header.sequence = sequence;
        header.epoch = self.epoch;
        header.source = self.source;
        header.schema = T::SCHEMA;
        header.t_published = monotonic_now();
        for bell in &mut self.bells {
            bell.unannounced += 1;
        }
        let before = self.dropped();
        let delivered = self.port.send(message).unwrap_or_else(|error| {
            tracing::error!(channel = T::TYPE_NAME, sequence, ?error, "a message was not sent");
            self.refusals.fetch_add(1, Ordering::Relaxed);
            0
        });
        Published { sequence, delivered, refused: (self.dropped() - before) as usize }
    }

    /// Rings those who wait for what was published quietly.
    pub fn ring(&mut self) {
        self.bells.iter_mut().for_each(Bell::ring);
    }

    /// Lets readers who came since the last message have the channel's history. A sender on a latched channel calls this a
    /// few times a second, with its heartbeat.
    pub fn update(&self) {
        if let Err(error) = self.port.update() {
            tracing::warn!(channel = T::TYPE_NAME, ?error, "a new reader could not be connected");
        }
    }

    /// Messages refused by full queues since the start, one for each reader that missed one.
    pub fn dropped(&self) -> u64 {
        self.refusals.load(Ordering::Relaxed)
    }

    /// Messages published since the start.
    pub fn published(&self) -> u64 {
        self.sequence
    }
}

/// CLOCK_MONOTONIC, ns.
pub(crate) fn monotonic_now() -> i64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}
