//! The channels of this process.

use ilns_bus::{Bus, BusError, Publisher, Subscriber};
use shared_types::{FrameOrigin, Heartbeat, KeyframeReport, Measurement, NavEstimate, Solution, channel};

/// What it listens to.
pub(crate) struct Inputs {
    pub(crate) measurements: Subscriber<Measurement>,
    pub(crate) frame_origin: Subscriber<FrameOrigin>,
}

/// What it says.
pub(crate) struct Outputs {
    pub(crate) solution: Publisher<Solution>,
    pub(crate) diagnostics: Publisher<KeyframeReport>,
    pub(crate) lagged: Publisher<NavEstimate>,
    pub(crate) health: Publisher<Heartbeat>,
}

impl Inputs {
    pub(crate) fn open(bus: &Bus) -> Result<Inputs, BusError> {
        Ok(Inputs {
            measurements: bus.subscriber(&channel::MEASUREMENTS)?,
            frame_origin: bus.subscriber(&channel::FRAME_ORIGIN)?,
        })
    }
}

impl Outputs {
    pub(crate) fn open(bus: &Bus) -> Result<Outputs, BusError> {
        Ok(Outputs {
            solution: bus.publisher(&channel::SOLUTION)?,
            diagnostics: bus.publisher(&channel::DIAGNOSTICS)?,
            lagged: bus.publisher(&channel::LAGGED)?,
            health: bus.publisher(&channel::HEALTH)?,
        })
    }
}
