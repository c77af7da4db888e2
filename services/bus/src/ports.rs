//! Opening a port of whichever type. Every type of the channel table is compiled here, in this crate alone: for each of them the
//! layer is seconds of work for the compiler, and a dozen crates open ports.

use core::any::{Any, TypeId};

use shared_types::{Channel, ChannelSpec, ChannelVisitor, Message, visit_channels};

use crate::bus::Bus;
use crate::error::BusError;

/// Which end of a channel.
#[derive(Clone, Copy, Debug)]
pub(crate) enum End {
    Sending,
    /// With so many of the newest messages.
    Receiving {
        history: usize,
    },
}

/// Opens one end of the channel, as the `Publisher<T>` or `Subscriber<T>` of the type that `carries` stands for.
pub(crate) fn open(bus: &Bus, spec: ChannelSpec, carries: TypeId, end: End) -> Result<Box<dyn Any>, BusError> {
    let mut opening = Opening { bus, spec, carries, end, port: None };
    visit_channels(&mut opening)?;
    Ok(opening.port.expect("only the table makes channels, so that it holds the type of each"))
}

struct Opening<'a> {
    bus: &'a Bus,
    spec: ChannelSpec,
    carries: TypeId,
    end: End,
    port: Option<Box<dyn Any>>,
}

impl ChannelVisitor for Opening<'_> {
    type Error = BusError;

    fn visit<T: Message>(&mut self, channel: &Channel<T>) -> Result<(), BusError> {
        // Two channels may carry one type; which of them is meant stands in `spec`.
        if self.port.is_some() || TypeId::of::<T>() != self.carries {
            return Ok(());
        }
        let mut meant = *channel;
        meant.spec = self.spec;
        self.port = Some(match self.end {
            End::Sending => Box::new(self.bus.open_publisher(&meant)?),
            End::Receiving { history } => Box::new(self.bus.open_subscriber(&meant, history)?),
        });
        Ok(())
    }
}
