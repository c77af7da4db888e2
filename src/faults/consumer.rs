//! A plain consumer of the estimates, which also hears how the processes are.

use std::any::Any;
use std::collections::BTreeMap;
use std::time::Duration;

use ilns_bus::{Bus, BusError, Prefix, Reader, Subscriber, Waiter};
use shared_types::{
    Channel, ChannelVisitor, Heartbeat, Message, Mode, NavEstimate, Process, ProcessState, Solution, Truth, channel,
    visit_channels,
};

use super::figures::{Observer, is_valid};

/// Who published, and when (monotonic ns).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Word {
    pub(super) pid: u32,
    pub(super) published: i64,
    /// Messages that it has lost so far.
    pub(super) dropped: u64,
}

/// The newest of everything.
#[derive(Debug, Default)]
pub(super) struct News {
    /// Each process's own heartbeat from its loop.
    pub(super) beats: BTreeMap<Process, Word>,
    /// Publication of the newest valid estimate and the start counter of its propagator.
    pub(super) valid: Option<(i64, u32)>,
    /// Publication of the first estimate of whatever mode since this was last emptied.
    pub(super) first: Option<i64>,
    /// Publication of the first INVALID estimate since this was last emptied.
    pub(super) invalid: Option<i64>,
    /// Publication of the newest solution.
    pub(super) solution: Option<i64>,
    /// Data time of the newest estimate, ns.
    pub(super) t_valid: i64,
    /// The supervisor has given somebody up.
    pub(super) given_up: bool,
}

/// Ports of a consumer. To be dropped before its set's supervisor is started anew.
pub(super) struct Consumer {
    bus: Bus,
    waiter: Waiter,
    estimates: Subscriber<NavEstimate>,
    truths: Subscriber<Truth>,
    solutions: Subscriber<Solution>,
    health: Subscriber<Heartbeat>,
}

impl Consumer {
    pub(super) fn join(prefix: &Prefix) -> Result<Consumer, BusError> {
        let bus = Bus::join(prefix, Process::Monitor, 0)?;
        Ok(Consumer {
            waiter: bus.waiter(Reader::Vehicle)?,
            estimates: bus.subscriber_since(&channel::ESTIMATE, 0)?,
            truths: bus.subscriber_since(&channel::TRUTH, 0)?,
            solutions: bus.subscriber_since(&channel::SOLUTION, 0)?,
            health: bus.subscriber(&channel::HEALTH)?,
            bus,
        })
    }

    /// Sleeps until an estimate comes or `limit` is over, and takes in everything that has come.
    pub(super) fn listen(&mut self, limit: Duration, observer: &mut Observer, news: &mut News) {
        self.waiter.wait_for(limit);
        while let Some(estimate) = self.estimates.receive() {
            let published = estimate.header.t_published;
            news.t_valid = estimate.header.t_valid;
            news.first.get_or_insert(published);
            if is_valid(&estimate) {
                news.valid = Some((published, estimate.header.epoch));
            } else if estimate.mode() == Mode::Invalid {
                news.invalid.get_or_insert(published);
            }
            observer.estimate(&estimate);
        }
        while let Some(truth) = self.truths.receive() {
            observer.truth(&truth);
        }
        while let Some(solution) = self.solutions.receive() {
            news.solution = Some(solution.header.t_published);
            observer.solution(&solution);
        }
        while let Some(beat) = self.health.receive() {
            let Some(process) = Process::from_index(beat.process) else { continue };
            let state = ProcessState::from_index(beat.state);
            if u32::from(beat.header.source) != beat.process {
                news.given_up |= state == Some(ProcessState::Failed);
            } else if matches!(state, Some(ProcessState::Running | ProcessState::Finished)) {
                let published = beat.header.t_published;
                news.beats.insert(process, Word { pid: beat.pid, published, dropped: beat.dropped });
            }
        }
    }

    /// A reader of every channel, which holds its places until it is dropped and never reads.
    pub(super) fn silent_reader(&self) -> Result<SilentReader<'_>, BusError> {
        let mut reader = SilentReader { bus: &self.bus, ports: Vec::new() };
        visit_channels(&mut reader)?;
        Ok(reader)
    }
}

/// See [`Consumer::silent_reader`].
pub(super) struct SilentReader<'a> {
    bus: &'a Bus,
    ports: Vec<Box<dyn Any>>,
}

impl ChannelVisitor for SilentReader<'_> {
    type Error = BusError;

    fn visit<T: Message>(&mut self, channel: &Channel<T>) -> Result<(), BusError> {
        self.ports.push(Box::new(self.bus.subscriber(channel)?));
        Ok(())
    }
}
