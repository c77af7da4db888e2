//! Every channel that is written down.

use ilns_bus::{Bus, BusError, Subscriber};
use ilns_runtime::HeartbeatBuilder;
use shared_types::{
    BuoyFix, DvlVelocity, FrameOrigin, GnssFix, Heartbeat, ImuSample, KeyframeReport, LblRange, McpHeading, Message,
    NavEstimate, PsDepth, RawReading, SENSORS, Sensor, Solution, Truth, channel,
};

/// All readers of this process.
pub(crate) struct Inputs {
    pub(crate) imu: Subscriber<ImuSample>,
    pub(crate) lbl: Subscriber<LblRange>,
    pub(crate) gnss: Subscriber<GnssFix>,
    pub(crate) dvl: Subscriber<DvlVelocity>,
    pub(crate) mcp: Subscriber<McpHeading>,
    pub(crate) ps: Subscriber<PsDepth>,
    pub(crate) buoys: Subscriber<BuoyFix>,
    pub(crate) truth: Subscriber<Truth>,
    pub(crate) estimates: Subscriber<NavEstimate>,
    pub(crate) solutions: Subscriber<Solution>,
    pub(crate) lagged: Subscriber<NavEstimate>,
    pub(crate) frame_origin: Subscriber<FrameOrigin>,
    pub(crate) health: Subscriber<Heartbeat>,
    pub(crate) diagnostics: Subscriber<KeyframeReport>,
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
            truth: bus.subscriber(&channel::TRUTH)?,
            estimates: bus.subscriber(&channel::ESTIMATE)?,
            solutions: bus.subscriber(&channel::SOLUTION)?,
            lagged: bus.subscriber(&channel::LAGGED)?,
            frame_origin: bus.subscriber(&channel::FRAME_ORIGIN)?,
            health: bus.subscriber(&channel::HEALTH)?,
            diagnostics: bus.subscriber(&channel::DIAGNOSTICS)?,
        })
    }

    /// Empties the queues of all sensors.
    pub(crate) fn readings(&mut self, take: &mut impl FnMut(&RawReading)) {
        drain(&mut self.imu, &mut |reading| take(&RawReading::Imu(reading)));
        drain(&mut self.lbl, &mut |reading| take(&RawReading::Lbl(reading)));
        drain(&mut self.gnss, &mut |reading| take(&RawReading::Gnss(reading)));
        drain(&mut self.dvl, &mut |reading| take(&RawReading::Dvl(reading)));
        drain(&mut self.mcp, &mut |reading| take(&RawReading::Mcp(reading)));
        drain(&mut self.ps, &mut |reading| take(&RawReading::Ps(reading)));
        drain(&mut self.buoys, &mut |reading| take(&RawReading::Buoy(reading)));
    }

    /// Readings that were sent and did not reach this process, in the order of [`SENSORS`].
    pub(crate) fn lost(&self) -> [u64; SENSORS.len()] {
        SENSORS.map(|sensor| match sensor {
            Sensor::Imu => self.imu.lost(),
            Sensor::Lbl => self.lbl.lost(),
            Sensor::Gnss => self.gnss.lost(),
            Sensor::Dvl => self.dvl.lost(),
            Sensor::Mcp => self.mcp.lost(),
            Sensor::Ps => self.ps.lost(),
            Sensor::Buoys => self.buoys.lost(),
        })
    }

    /// Everything that is missing in the record: readings, rows of the truth, estimates.
    fn lost_in_all(&self) -> u64 {
        self.lost().iter().sum::<u64>() + self.truth.lost() + self.estimates.lost()
    }

    /// Per sensor into the heartbeat; returns the sum of everything.
    pub(crate) fn count_losses(&self, heartbeat: &mut HeartbeatBuilder) -> u64 {
        for (health, lost) in heartbeat.sensors.iter_mut().zip(self.lost()) {
            health.lost = lost;
        }
        self.lost_in_all()
    }
}

/// Empties a queue.
fn drain<T: Message>(subscriber: &mut Subscriber<T>, take: &mut impl FnMut(T)) {
    while let Some(message) = subscriber.receive() {
        take(message);
    }
}
