//! The channels of this process.

use ilns_bus::{Bus, BusError, Subscriber};
use shared_types::{
    BuoyFix, Channel, FrameOrigin, GnssFix, Heartbeat, KeyframeReport, LblRange, Message, NavEstimate, Solution, Truth,
    channel,
};

use crate::foxglove::Foxglove;
use crate::model::Model;

/// Everything that the monitor listens to.
pub(crate) struct Inputs {
    estimate: Subscriber<NavEstimate>,
    solution: Subscriber<Solution>,
    diagnostics: Subscriber<KeyframeReport>,
    frame_origin: Subscriber<FrameOrigin>,
    buoys: Subscriber<BuoyFix>,
    lbl: Subscriber<LblRange>,
    gnss: Subscriber<GnssFix>,
    truth: Subscriber<Truth>,
    health: Subscriber<Heartbeat>,
}

impl Inputs {
    pub(crate) fn open(bus: &Bus) -> Result<Inputs, BusError> {
        Ok(Inputs {
            estimate: bus.subscriber(&channel::ESTIMATE)?,
            solution: bus.subscriber(&channel::SOLUTION)?,
            diagnostics: bus.subscriber(&channel::DIAGNOSTICS)?,
            frame_origin: bus.subscriber(&channel::FRAME_ORIGIN)?,
            buoys: bus.subscriber(&channel::BUOYS)?,
            lbl: bus.subscriber(&channel::LBL)?,
            gnss: bus.subscriber(&channel::GNSS)?,
            truth: bus.subscriber(&channel::TRUTH)?,
            health: bus.subscriber(&channel::HEALTH)?,
        })
    }

    /// Folds everything that waits into `model` and shows it to `live`; how many messages that were.
    pub(crate) fn drain(&mut self, model: &mut Model, live: &mut Foxglove) -> u64 {
        drain(&mut self.frame_origin, &channel::FRAME_ORIGIN, |message| {
            model.frame_origin(message);
            live.frame_origin(message);
        }) + drain(&mut self.buoys, &channel::BUOYS, |message| {
            model.buoy(message);
            live.buoy(message);
        }) + drain(&mut self.lbl, &channel::LBL, |message| {
            model.lbl(message);
            live.lbl(message);
        }) + drain(&mut self.gnss, &channel::GNSS, |message| {
            model.gnss(message);
            live.gnss(message);
        }) + drain(&mut self.truth, &channel::TRUTH, |message| {
            model.truth(message);
            live.truth(message);
        }) + drain(&mut self.solution, &channel::SOLUTION, |message| model.solution(message))
            + drain(&mut self.diagnostics, &channel::DIAGNOSTICS, |message| {
                model.diagnostics(message);
                live.diagnostics(message);
            })
            + drain(&mut self.estimate, &channel::ESTIMATE, |message| {
                model.estimate(message);
                live.estimate(message);
            })
            + drain(&mut self.health, &channel::HEALTH, |message| {
                model.heartbeat(message);
                live.heartbeat(message);
            })
    }
}

/// A queue's length at most, so that a sender that never pauses cannot hold up the others.
fn drain<T: Message>(subscriber: &mut Subscriber<T>, channel: &Channel<T>, mut fold: impl FnMut(&T)) -> u64 {
    let mut folded = 0;
    while folded < channel.spec.queue as u64
        && let Some(message) = subscriber.receive()
    {
        fold(&message);
        folded += 1;
    }
    folded
}
