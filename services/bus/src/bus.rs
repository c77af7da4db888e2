//! A process's place on the bus: its node and its ports.

use core::any::TypeId;
use std::fs::{self, File};
use std::time::{Duration, Instant};

use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::PublishSubscribeOpenError;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use rustix::fs::fstat;
use shared_types::{Channel, Message, Process};

use crate::bells::{self, Reader};
use crate::error::BusError;
use crate::layer::Holds;
use crate::ports::{self, End};
use crate::prefix::Prefix;
use crate::publisher::{Bell, Publisher};
use crate::settings::{expected_layout, open_node, service_name};
use crate::subscriber::Subscriber;
use crate::waiter::Waiter;

/// How long a process waits for an owner that is just creating the channels.
const OWNER_PATIENCE: Duration = Duration::from_secs(2);

/// One process's place on the bus. Its ports belong to the thread that made them.
#[derive(Debug)]
pub struct Bus {
    node: Box<dyn Holds>,
    prefix: Prefix,
    process: Process,
    epoch: u32,
    /// What the owner leaves as long as the channels are his; kept open, so that looking at it costs no path and no memory.
    ready: Option<File>,
}

impl Bus {
    /// Joins the set that runs under `prefix`. What this process publishes bears `process` as its source and `epoch`, its
    /// start counter, so that readers can tell a restart from a loss.
    ///
    /// # Errors
    /// [`BusError::NotRunning`] when nobody owns the prefix.
    pub fn join(prefix: &Prefix, process: Process, epoch: u32) -> Result<Bus, BusError> {
        let deadline = Instant::now() + OWNER_PATIENCE;
        while !prefix.ready_file().exists() || !owner_lives(prefix) {
            if !owner_lives(prefix) || Instant::now() >= deadline {
                return Err(BusError::NotRunning { prefix: prefix.name().to_owned() });
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let path = prefix.ready_file();
        let ready = File::open(&path).map_err(BusError::io("open", path))?;
        Ok(Bus { ready: Some(ready), ..Bus::enter(prefix, process, epoch)? })
    }

    /// Whether the channels that this process has opened are still those of its prefix. An owner that was killed takes nothing along:
    /// the set goes on without it. The one that comes in its place makes every channel anew, and whoever does not join again then
    /// speaks to nobody. To be asked now and then, with the heartbeat.
    ///
    /// # Errors
    /// [`BusError::Replaced`] when they are not: the process is to end, and whoever restarts it brings it back.
    pub fn check_owner(&self) -> Result<(), BusError> {
        // A file without a name: the next owner, or an orderly end of this one, has removed it.
        let is_removed = |ready: &File| fstat(ready).is_ok_and(|found| found.st_nlink == 0);
        match &self.ready {
            Some(ready) if is_removed(ready) => Err(BusError::Replaced { prefix: self.prefix.name().to_owned() }),
            _ => Ok(()),
        }
    }

    /// Opens the node, whoever owns the prefix.
    pub(crate) fn enter(prefix: &Prefix, process: Process, epoch: u32) -> Result<Bus, BusError> {
        Ok(Bus { node: Box::new(open_node(prefix)?), prefix: prefix.clone(), process, epoch, ready: None })
    }

    /// Under which prefix.
    pub fn prefix(&self) -> &Prefix {
        &self.prefix
    }

    pub(crate) fn node(&self) -> &Node<ipc::Service> {
        self.node.node()
    }

    fn open<T: Message>(
        &self,
        channel: &Channel<T>,
    ) -> Result<publish_subscribe::PortFactory<ipc::Service, T, ()>, BusError> {
        let name = channel.spec.name;
        self.node()
            .service_builder(&service_name(name)?)
            .publish_subscribe::<T>()
            .open_with_attributes(&expected_layout(channel)?)
            .map_err(|error| match error {
                PublishSubscribeOpenError::IncompatibleAttributes | PublishSubscribeOpenError::IncompatibleTypes => {
                    BusError::OtherBuild { channel: name }
                }
                PublishSubscribeOpenError::DoesNotExist => {
                    BusError::NotRunning { prefix: self.prefix.name().to_owned() }
                }
                other => BusError::layer("open channel", name, other),
            })
    }

    fn open_bell(&self, reader: Reader) -> Result<event::PortFactory<ipc::Service>, BusError> {
        let name = reader.bell();
        self.node()
            .service_builder(&service_name(&name)?)
            .event()
            .open()
            .map_err(|error| BusError::layer("open event", &name, error))
    }

    /// A sending port; its channel's bells come with it.
    ///
    /// # Errors
    /// [`BusError::OtherBuild`] when the channel was created with another layout, [`BusError::Crowded`] when it has all its
    /// senders.
    pub fn publisher<T: Message>(&self, channel: &Channel<T>) -> Result<Publisher<T>, BusError> {
        let port = ports::open(self, channel.spec, TypeId::of::<T>(), End::Sending)?;
        Ok(*port.downcast().expect("opened for this type"))
    }

    pub(crate) fn open_publisher<T: Message>(&self, channel: &Channel<T>) -> Result<Publisher<T>, BusError> {
        let spec = &channel.spec;
        let bells = bells::rings(spec.name)
            .iter()
            .map(|&ring| {
                let notifier = self.open_bell(ring.reader)?.notifier_builder().create();
                let notifier = notifier.map_err(|e| BusError::layer("ring", ring.reader.name(), e))?;
                Ok(Bell::new(notifier, ring.every))
            })
            .collect::<Result<Vec<Bell>, BusError>>()?;
        Publisher::new(&self.open(channel)?, bells, self.process as u16, self.epoch).map_err(|error| match error {
            PublisherCreateError::ExceedsMaxSupportedPublishers => {
                BusError::Crowded { channel: spec.name, most: spec.publishers, ports: "sender(s)" }
            }
            other => BusError::layer("send on channel", spec.name, other),
        })
    }

    /// A receiving port, which is first given the channel's history (if it has one) at the sender's next message or
    /// [`Publisher::update`].
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn subscriber<T: Message>(&self, channel: &Channel<T>) -> Result<Subscriber<T>, BusError> {
        self.subscriber_since(channel, channel.spec.history)
    }

    /// As [`Bus::subscriber`], but with the newest `history` messages at most; 0: only what is sent from now on.
    ///
    /// # Errors
    /// As [`Bus::publisher`].
    pub fn subscriber_since<T: Message>(
        &self,
        channel: &Channel<T>,
        history: usize,
    ) -> Result<Subscriber<T>, BusError> {
        let end = End::Receiving { history: history.min(channel.spec.history) };
        let port = ports::open(self, channel.spec, TypeId::of::<T>(), end)?;
        Ok(*port.downcast().expect("opened for this type"))
    }

    pub(crate) fn open_subscriber<T: Message>(
        &self,
        channel: &Channel<T>,
        history: usize,
    ) -> Result<Subscriber<T>, BusError> {
        let spec = &channel.spec;
        let port = self.open(channel)?.subscriber_builder().history_request(history).create();
        let port = port.map_err(|error| match error {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                BusError::Crowded { channel: spec.name, most: spec.subscribers, ports: "readers" }
            }
            other => BusError::layer("listen on channel", spec.name, other),
        })?;
        Ok(Subscriber::new(port, spec.name))
    }

    /// What `reader` sleeps on ([`Waiter::polling`] if it does not sleep).
    ///
    /// # Errors
    /// [`BusError::Layer`] when its bell cannot be opened.
    pub fn waiter(&self, reader: Reader) -> Result<Waiter, BusError> {
        let listener = self.open_bell(reader)?.listener_builder().create();
        Ok(Waiter::new(listener.map_err(|e| BusError::layer("wait as", reader.name(), e))?))
    }
}

/// Whether the process that holds, or is about to take, the prefix lives.
fn owner_lives(prefix: &Prefix) -> bool {
    fs::read_to_string(prefix.lock_file())
        .ok()
        .and_then(|pid| pid.trim().parse::<u32>().ok())
        .is_some_and(|pid| fs::metadata(format!("/proc/{pid}")).is_ok())
}
