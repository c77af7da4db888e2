//! Receiving: copy out, and count what is missing.

use iceoryx2::port::subscriber::Subscriber as Port;
use iceoryx2::prelude::ipc;
use shared_types::{Header, Message};

use crate::layer::Receives;

/// What a reader has missed since its start, told from the sequence numbers: the layer itself tells nobody.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Messages that were sent and not received.
    pub lost: u64,
    /// Messages that were received twice or out of order.
    pub duplicates: u64,
    /// Restarts of senders.
    pub restarts: u64,
}

/// Where the sequence of one sender stands.
#[derive(Clone, Copy, Debug)]
struct Sender {
    source: u16,
    epoch: u32,
    sequence: u64,
}

/// Follows the sequence numbers of every sender of a channel.
#[derive(Debug, Default)]
struct Account {
    senders: Vec<Sender>,
    losses: Losses,
}

impl Account {
    fn enter(&mut self, header: &Header) {
        let Some(sender) = self.senders.iter_mut().find(|sender| sender.source == header.source) else {
            // Whoever joins late has not lost what came before.
            self.senders.push(Sender { source: header.source, epoch: header.epoch, sequence: header.sequence });
            return;
        };
        // A sender started by hand may come back with its old epoch; its first message gives it away.
        let restarted = header.epoch != sender.epoch || (header.sequence == 0 && sender.sequence > 0);
        if restarted {
            self.losses.restarts += 1;
            self.losses.lost += header.sequence;
        } else if header.sequence > sender.sequence {
            self.losses.lost += header.sequence - sender.sequence - 1;
        } else {
            self.losses.duplicates += 1;
            return;
        }
        (sender.epoch, sender.sequence) = (header.epoch, header.sequence);
    }
}

/// The receiving port of a channel.
#[derive(Debug)]
pub struct Subscriber<T: Message> {
    port: Box<dyn Receives<T>>,
    channel: &'static str,
    account: Account,
    received: u64,
    broken: bool,
}

impl<T: Message> Subscriber<T> {
    pub(crate) fn new(port: Port<ipc::Service, T, ()>, channel: &'static str) -> Subscriber<T> {
        Subscriber { port: Box::new(port), channel, account: Account::default(), received: 0, broken: false }
    }

    /// The oldest waiting message, copied out; `None` when the queue is empty.
    pub fn receive(&mut self) -> Option<T> {
        match self.port.take() {
            Ok(message) => {
                self.broken = false;
                let message = message?;
                self.received += 1;
                self.account.enter(message.header());
                Some(message)
            }
            Err(error) => {
                if !self.broken {
                    tracing::error!(channel = self.channel, ?error, "a sender could not be heard");
                }
                self.broken = true;
                None
            }
        }
    }

    /// Empties the queue and gives its newest message.
    pub fn newest(&mut self) -> Option<T> {
        let mut newest = None;
        while let Some(message) = self.receive() {
            newest = Some(message);
        }
        newest
    }

    /// What was missed so far.
    pub fn losses(&self) -> Losses {
        self.account.losses
    }

    /// Messages missed so far.
    pub fn lost(&self) -> u64 {
        self.account.losses.lost
    }

    /// Messages received so far.
    pub fn received(&self) -> u64 {
        self.received
    }

    /// Name of the channel.
    pub fn channel(&self) -> &'static str {
        self.channel
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(stamps: &[(u16, u32, u64)]) -> Losses {
        let mut account = Account::default();
        for &(source, epoch, sequence) in stamps {
            account.enter(&Header { source, epoch, sequence, ..Header::default() });
        }
        account.losses
    }

    #[test]
    fn a_gap_is_a_loss_and_a_late_start_is_not() {
        assert_eq!(after(&[(1, 0, 7), (1, 0, 8), (1, 0, 12)]), Losses { lost: 3, ..Losses::default() });
    }

    #[test]
    fn a_new_epoch_is_a_restart_and_what_it_sent_before_is_lost() {
        assert_eq!(after(&[(1, 0, 7), (1, 1, 0), (1, 1, 1)]), Losses { restarts: 1, ..Losses::default() });
        assert_eq!(after(&[(1, 0, 7), (1, 1, 2)]), Losses { restarts: 1, lost: 2, ..Losses::default() });
        assert_eq!(after(&[(1, 0, 7), (1, 0, 0)]), Losses { restarts: 1, ..Losses::default() });
    }

    #[test]
    fn senders_are_counted_apart_and_a_repetition_is_a_duplicate() {
        assert_eq!(after(&[(1, 0, 3), (2, 0, 9), (1, 0, 4), (2, 0, 10)]), Losses::default());
        assert_eq!(after(&[(1, 0, 3), (1, 0, 3)]), Losses { duplicates: 1, ..Losses::default() });
    }
}
