//! Channels as typed ports over shared memory: the only crate that calls iceoryx2.
//!
//! One process [owns](Owner) a prefix: it locks it, wipes what a dead owner left, creates every channel of the table and
//! keeps them open. All others [join](Bus::join), which only ever opens: a process that dies while it creates something
//! would leave the prefix unusable for ever.
//!
//! The shared memory costs a microsecond, the wake-up twenty: a [`Publisher`] rings only the [bells](Reader) of those who
//! must be woken, everybody else drains on a timer of his own.

mod bare;
mod bells;
mod bus;
mod error;
mod layer;
mod owner;
mod ports;
mod prefix;
mod publisher;
mod settings;
mod subscriber;
mod waiter;

pub use bare::{BARE_BYTES, BareMessage, BareReceiver, BareSender};
pub use bells::Reader;
pub use bus::Bus;
pub use error::BusError;
pub use owner::Owner;
pub use prefix::Prefix;
pub use publisher::{Published, Publisher};
pub use subscriber::{Losses, Subscriber};
pub use waiter::{WAIT, Waiter};
