//! What every message carries: who sent it, in which order, and the two times that are never mixed.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::time::Time;

/// The first field of every message.
///
/// `t_valid` is **data time** ([`Time`]); `t_arrival`, `t_published` and `origin_t_arrival` are CLOCK_MONOTONIC
/// nanoseconds and serve latency only: they never reach the estimator. A gap in (`source`, `epoch`, `sequence`) is a
/// loss, a new `epoch` is a restart of the sender.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[repr(C)]
pub struct Header {
    /// Counts the sender's messages on this channel, from 0.
    pub sequence: u64,
    /// Start counter of the sender.
    pub epoch: u32,
    /// Number of the sender among those of its channel.
    pub source: u16,
    /// Version of the message's schema.
    pub schema: u16,
    /// Data time at which the content holds, ns.
    pub t_valid: i64,
    /// Monotonic time at which the instrument's reading reached its driver, ns.
    pub t_arrival: i64,
    /// Monotonic time of publication, ns; stamped by the bus.
    pub t_published: i64,
    /// Sequence of the reading that this message answers to (an estimate names its IMU sample).
    pub origin_sequence: u64,
    /// `t_arrival` of that reading, ns.
    pub origin_t_arrival: i64,
}

impl Header {
    /// A header that says only when its content holds.
    pub fn at(t_valid: Time) -> Header {
        Header { t_valid: t_valid.0, ..Header::default() }
    }
}

/// What shared memory asks of a type; nothing unless the feature `ipc` is on.
#[cfg(feature = "ipc")]
pub use iceoryx2::prelude::ZeroCopySend as Payload;

/// What shared memory asks of a type; nothing unless the feature `ipc` is on.
#[cfg(not(feature = "ipc"))]
pub trait Payload {}

#[cfg(not(feature = "ipc"))]
impl<T> Payload for T {}

/// A type that may cross the bus.
pub trait Message: Payload + Copy + core::fmt::Debug + 'static {
    /// Name under which the bus knows the type.
    const TYPE_NAME: &'static str;
    /// Version, raised whenever the meaning of a field changes.
    const SCHEMA: u16;
    /// Hash of names, types and offsets of the fields.
    const LAYOUT: u64;
    /// The header.
    fn header(&self) -> &Header;
    /// The header, to be stamped by the sender.
    fn header_mut(&mut self) -> &mut Header;
    /// Data time at which the content holds.
    fn t_valid(&self) -> Time {
        Time(self.header().t_valid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ImuSample, Measurement, NavEstimate};

    #[test]
    fn layouts_of_different_messages_differ() {
        assert_ne!(ImuSample::LAYOUT, NavEstimate::LAYOUT);
    }

    #[test]
    fn a_measurement_fits_four_cache_lines() {
        assert!(size_of::<Measurement>() <= 256, "{}", size_of::<Measurement>());
        assert_eq!(size_of::<Header>(), 56);
    }
}
