//! The channels of this process.

use ilns_bus::{Bus, BusError, Publisher, Subscriber};
use shared_types::{
    BuoyFix, Channel, DvlVelocity, FrameOrigin, GnssFix, Heartbeat, ImuSample, LblRange, McpHeading, Measurement,
    Message, PsDepth, RawReading, Sensor, SensorHealth, channel,
};

/// Every sensor's channel.
pub(crate) struct Inputs {
    imu: Subscriber<ImuSample>,
    lbl: Subscriber<LblRange>,
    gnss: Subscriber<GnssFix>,
    dvl: Subscriber<DvlVelocity>,
    mcp: Subscriber<McpHeading>,
    ps: Subscriber<PsDepth>,
    buoys: Subscriber<BuoyFix>,
}

impl Inputs {
    pub(crate) fn open(bus: &Bus) -> Result<Inputs, BusError> {
        Ok(Inputs {
            imu: bus.subscriber(&channel::IMU)?,
            lbl: bus.subscriber(&channel::LBL)?,
            gnss: bus.subscriber(&channel::GNSS)?,
            dvl: bus.subscriber(&channel::DVL)?,
            mcp: bus.subscriber(&channel::MCP)?,
            ps: bus.subscriber(&channel::PS)?,
            buoys: bus.subscriber(&channel::BUOYS)?,
        })
    }

    /// Empties all queues, the IMU's last: its samples close what waits for the other sensors, which therefore have to be
    /// in first however long this process was held up.
    pub(crate) fn drain(&mut self, take: &mut impl FnMut(&RawReading)) {
        drain(&mut self.buoys, &channel::BUOYS, RawReading::Buoy, take);
        drain(&mut self.gnss, &channel::GNSS, RawReading::Gnss, take);
        drain(&mut self.dvl, &channel::DVL, RawReading::Dvl, take);
        drain(&mut self.mcp, &channel::MCP, RawReading::Mcp, take);
        drain(&mut self.ps, &channel::PS, RawReading::Ps, take);
        drain(&mut self.lbl, &channel::LBL, RawReading::Lbl, take);
        drain(&mut self.imu, &channel::IMU, RawReading::Imu, take);
    }

    /// Writes into each sensor's account what its channel has lost.
    pub(crate) fn count_losses(&self, health: &mut [SensorHealth; 7]) {
        for (sensor, lost) in [
            (Sensor::Imu, self.imu.lost()),
            (Sensor::Lbl, self.lbl.lost()),
            (Sensor::Gnss, self.gnss.lost()),
            (Sensor::Dvl, self.dvl.lost()),
            (Sensor::Mcp, self.mcp.lost()),
            (Sensor::Ps, self.ps.lost()),
            (Sensor::Buoys, self.buoys.lost()),
        ] {
            health[sensor.index()].lost = lost;
        }
    }
}

/// A queue's length at most, so that a driver that never pauses cannot hold up the others.
fn drain<T: Message>(
    subscriber: &mut Subscriber<T>,
    channel: &Channel<T>,
    wrap: impl Fn(T) -> RawReading,
    take: &mut impl FnMut(&RawReading),
) {
    for _ in 0..channel.spec.queue {
        match subscriber.receive() {
            Some(reading) => take(&wrap(reading)),
            None => return,
        }
    }
}

/// What this process says.
pub(crate) struct Outputs {
    pub(crate) measurements: Publisher<Measurement>,
    pub(crate) frame_origin: Publisher<FrameOrigin>,
    pub(crate) health: Publisher<Heartbeat>,
}

impl Outputs {
    pub(crate) fn open(bus: &Bus) -> Result<Outputs, BusError> {
        Ok(Outputs {
            measurements: bus.publisher(&channel::MEASUREMENTS)?,
            frame_origin: bus.publisher(&channel::FRAME_ORIGIN)?,
            health: bus.publisher(&channel::HEALTH)?,
        })
    }
}
