//! The bare hop that latencies are held against: the shared memory layer alone, with one event and none of the channels'
//! stamps, counts and policies.

use std::time::Duration;

use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::{event, publish_subscribe};
use shared_types::ImuSample;

use crate::bus::Bus;
use crate::error::BusError;
use crate::layer::{Listens, Receives, Rings, Sends};
use crate::settings::service_name;

const SERVICE: &str = "reference/hop";
const BELL: &str = "reference/bell";

/// Bytes of a bare message: those of an IMU sample.
pub const BARE_BYTES: usize = size_of::<ImuSample>();

/// What crosses a bare hop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
pub struct BareMessage {
    /// Counts the sender's messages, from 0.
    pub sequence: u64,
    /// CLOCK_MONOTONIC when it was sent, ns.
    pub t_published: i64,
    rest: [u8; BARE_BYTES - 16],
}

impl BareMessage {
    /// A message of the right size.
    pub fn new(sequence: u64, t_published: i64) -> BareMessage {
        BareMessage { sequence, t_published, rest: [0; BARE_BYTES - 16] }
    }

    /// As it goes through a pipe or socket: both numbers little endian, then zeros.
    pub fn to_bytes(self) -> [u8; BARE_BYTES] {
        let mut bytes = [0; BARE_BYTES];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.t_published.to_le_bytes());
        bytes
    }

    /// The reverse of [`BareMessage::to_bytes`].
    pub fn from_bytes(bytes: &[u8; BARE_BYTES]) -> BareMessage {
        let word = |at: usize| core::array::from_fn(|index| bytes[at + index]);
        BareMessage::new(u64::from_le_bytes(word(0)), i64::from_le_bytes(word(8)))
    }
}

/// The services of the bare hop, held open by the owner of the prefix.
#[derive(Debug)]
pub(crate) struct BareServices {
    _hop: publish_subscribe::PortFactory<ipc::Service, BareMessage, ()>,
    _bell: event::PortFactory<ipc::Service>,
}

impl BareServices {
    pub(crate) fn create(node: &Node<ipc::Service>) -> Result<BareServices, BusError> {
        let hop = node
            .service_builder(&service_name(SERVICE)?)
            .publish_subscribe::<BareMessage>()
            .subscriber_max_buffer_size(64)
            .create()
            .map_err(|error| BusError::layer("create channel", SERVICE, error))?;
        let bell = node
            .service_builder(&service_name(BELL)?)
            .event()
            .create()
            .map_err(|error| BusError::layer("create event", BELL, error))?;
        Ok(BareServices { _hop: hop, _bell: bell })
    }
}

/// The sending end.
#[derive(Debug)]
pub struct BareSender {
    port: Box<dyn Sends<BareMessage>>,
    notifier: Box<dyn Rings>,
}

/// The receiving end.
#[derive(Debug)]
pub struct BareReceiver {
    port: Box<dyn Receives<BareMessage>>,
    listener: Box<dyn Listens>,
}

impl BareSender {
    /// Sends and notifies; false when the layer refuses.
    pub fn send(&self, message: BareMessage) -> bool {
        self.port.send(message).is_ok() && self.notifier.ring().is_ok()
    }
}

impl BareReceiver {
    /// Sleeps until notified, for `limit` at most.
    pub fn wait_for(&self, limit: Duration) {
        if self.listener.listen(limit).is_err() {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// The oldest waiting message.
    pub fn receive(&self) -> Option<BareMessage> {
        self.port.take().ok().flatten()
    }
}

impl Bus {
    fn bare_hop(&self) -> Result<publish_subscribe::PortFactory<ipc::Service, BareMessage, ()>, BusError> {
        self.node()
            .service_builder(&service_name(SERVICE)?)
            .publish_subscribe::<BareMessage>()
            .open()
            .map_err(|error| BusError::layer("open channel", SERVICE, error))
    }

    fn bare_bell(&self) -> Result<event::PortFactory<ipc::Service>, BusError> {
        self.node()
            .service_builder(&service_name(BELL)?)
            .event()
            .open()
            .map_err(|error| BusError::layer("open event", BELL, error))
    }

    /// The sending end of the bare hop, once the owner has [offered](crate::Owner::offer_bare_hop) it.
    ///
    /// # Errors
    /// [`BusError::Layer`].
    pub fn bare_sender(&self) -> Result<BareSender, BusError> {
        let fault = |reason: &dyn core::fmt::Debug| BusError::layer("send on channel", SERVICE, reason);
        let port = self.bare_hop()?.publisher_builder().create().map_err(|e| fault(&e))?;
        let notifier = self.bare_bell()?.notifier_builder().create().map_err(|e| fault(&e))?;
        Ok(BareSender { port: Box::new(port), notifier: Box::new(notifier) })
    }

    /// The receiving end of the bare hop.
    ///
    /// # Errors
    /// [`BusError::Layer`].
    pub fn bare_receiver(&self) -> Result<BareReceiver, BusError> {
        let fault = |reason: &dyn core::fmt::Debug| BusError::layer("listen on channel", SERVICE, reason);
        let port = self.bare_hop()?.subscriber_builder().create().map_err(|e| fault(&e))?;
        let listener = self.bare_bell()?.listener_builder().create().map_err(|e| fault(&e))?;
        Ok(BareReceiver { port: Box::new(port), listener: Box::new(listener) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bare_message_has_the_size_of_an_imu_sample_and_survives_its_bytes() {
        assert_eq!(size_of::<BareMessage>(), BARE_BYTES);
        let message = BareMessage::new(0x0123_4567_89ab_cdef, -7);
        assert_eq!(BareMessage::from_bytes(&message.to_bytes()), message);
    }
}
