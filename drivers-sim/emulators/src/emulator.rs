//! The loop of an emulator: sleep until a reading is due, send it, say how it goes.

use std::rc::Rc;

use ilns_bus::{Bus, Publisher};
use ilns_runtime::{HeartbeatBuilder, Shutdown, StartClock, monotonic_now};
use shared_types::{Heartbeat, Message, ProcessState, Sensor, Time};

use crate::source::{Due, Readings, SourceError};

/// One emulator at work.
pub(crate) struct Emulator<T: Message> {
    pub(crate) bus: Rc<Bus>,
    pub(crate) readings: Readings<T>,
    pub(crate) publisher: Publisher<T>,
    pub(crate) health: Publisher<Heartbeat>,
    pub(crate) heartbeat: HeartbeatBuilder,
    pub(crate) clock: StartClock,
    pub(crate) shutdown: Shutdown,
    /// No reading later than this is sent.
    pub(crate) until: Time,
    /// Whose readings; `None` for the truth.
    pub(crate) sensor: Option<Sensor>,
}

impl<T: Message> Emulator<T> {
    /// Sends every reading when it is due. What was due before the start of the run, or of a restarted emulator, is left
    /// out, but for what `holds` (a moored buoy holds for ever, and the channel's history died with the last sender).
    pub(crate) fn run(mut self, restarted: bool, holds: impl Fn(&T) -> bool) -> Result<(), SourceError> {
        self.heartbeat.state = ProcessState::Running;
        let since = if restarted { monotonic_now() } else { self.clock.mono };
        let mut upcoming = self.skip(since, holds)?;
        while let Some(reading) = upcoming {
            // Made ahead, while nobody waits for it.
            let following = self.next()?;
            if !self.wait_until(self.due(&reading)) {
                return Ok(());
            }
            self.send(reading.reading);
            // Readings of one instant, or readings that came due together at a high rate, are announced once.
            if following.is_none_or(|following| self.due(&following) > monotonic_now()) {
                self.publisher.ring();
            }
            upcoming = following;
        }
        self.publisher.ring();
        self.heartbeat.state = ProcessState::Finished;
        self.tell();
        tracing::info!(channel = T::TYPE_NAME, sent = self.publisher.published(), "the source is at its end");
        self.wait_until(i64::MAX);
        Ok(())
    }

    /// The first reading that is due at `since` or later.
    fn skip(&mut self, since: i64, holds: impl Fn(&T) -> bool) -> Result<Option<Due<T>>, SourceError> {
        let mut skipped = 0_u64;
        let first = loop {
            match self.next()? {
                Some(reading) if self.due(&reading) < since && !self.shutdown.requested() => {
                    if holds(&reading.reading) {
                        self.send(reading.reading);
                    } else {
                        skipped += 1;
                    }
                }
                other => break other,
            }
        };
        if skipped > 0 {
            tracing::info!(channel = T::TYPE_NAME, skipped, "readings from before the start are left out");
        }
        Ok(first)
    }

    fn next(&mut self) -> Result<Option<Due<T>>, SourceError> {
        let reading = self.readings.next().transpose()?;
        Ok(reading.filter(|reading| reading.t <= self.until))
    }

    /// When it is due, monotonic ns.
    fn due(&self, reading: &Due<T>) -> i64 {
        self.clock.monotonic_of(reading.t)
    }

    fn send(&mut self, mut reading: T) {
        let t_valid = reading.t_valid();
        reading.header_mut().t_arrival = monotonic_now();
        let published = self.publisher.publish_quietly(reading);
        if published.refused > 0 && self.heartbeat.dropped == 0 {
            tracing::warn!(channel = T::TYPE_NAME, "a reader's queue is full; refusals are counted in the heartbeat");
        }
        self.heartbeat.dropped = self.publisher.dropped();
        self.heartbeat.handled += 1;
        if let Some(sensor) = self.sensor {
            self.heartbeat.reading(sensor, t_valid);
        }
    }

    /// Sleeps until `mono`, telling how it goes; false when the process is to stop, or its channels are gone.
    fn wait_until(&mut self, mono: i64) -> bool {
        while !self.shutdown.requested() {
            if monotonic_now() >= self.heartbeat.next_beat() {
                if self.bus.check_owner().is_err() {
                    break;
                }
                self.tell();
            }
            let wake = mono.min(self.heartbeat.next_beat());
            if !self.shutdown.sleep_until(wake) {
                break;
            }
            if wake == mono {
                return true;
            }
        }
        self.heartbeat.state = ProcessState::Stopping;
        self.health.publish(self.heartbeat.build());
        false
    }

    /// A heartbeat, and the channel's history for readers who came since.
    fn tell(&mut self) {
        self.publisher.update();
        self.heartbeat.rest(monotonic_now());
        self.health.publish(self.heartbeat.build());
    }
}

#[cfg(test)]
mod tests {
    use ilns_bus::{Owner, Prefix, Subscriber};
    use shared_types::{BuoyFix, Channel, Duration, Header, Process, PsDepth, channel};

    use super::*;

    /// Runs an emulator on `readings` until it has finished, and gives back what a reader on the channel heard.
    fn heard<T: Message + Send>(
        test: &str,
        channel: &Channel<T>,
        readings: Vec<T>,
        clock: StartClock,
        restarted: bool,
        holds: fn(&T) -> bool,
    ) -> Vec<T> {
        let prefix = Prefix::new(&format!("e{}-{test}", std::process::id())).expect("short enough");
        let owner = Owner::take(&prefix).expect("free");
        let mut subscriber: Subscriber<T> = owner.bus().subscriber(channel).expect("room");
        let mut beats = owner.bus().subscriber(&channel::HEALTH).expect("room");
        let shutdown = Shutdown::default();
        let stop = shutdown.clone();
        let (channel, there) = (*channel, prefix.clone());
        let at_work = std::thread::spawn(move || {
            let bus = Rc::new(Bus::join(&there, Process::EmulatorPs, 0).expect("owned"));
            let emulator = Emulator {
                bus: Rc::clone(&bus),
                readings: Box::new(readings.into_iter().map(|reading| Ok(Due::when_valid(reading)))),
                publisher: bus.publisher(&channel).expect("room"),
                health: bus.publisher(&channel::HEALTH).expect("room"),
                heartbeat: HeartbeatBuilder::new(Process::EmulatorPs, 0),
                clock,
                shutdown,
                until: clock.data + Duration::from_seconds(1.0),
                sensor: Some(Sensor::Ps),
            };
            emulator.run(restarted, holds).expect("the readings are good");
        });
        let deadline = monotonic_now() + 10_000_000_000;
        let mut messages = Vec::new();
        let mut finished = false;
        while !finished {
            assert!(monotonic_now() < deadline, "it did not finish within 10 s");
            finished = std::iter::from_fn(|| beats.receive()).any(|beat| beat.state == ProcessState::Finished as u32);
            messages.extend(std::iter::from_fn(|| subscriber.receive()));
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        stop.request();
        at_work.join().expect("it ran well");
        assert_eq!(subscriber.lost(), 0);
        drop((subscriber, beats));
        owner.close();
        messages
    }

    fn depth(seconds: f64) -> PsDepth {
        PsDepth { header: Header::at(Time::from_seconds(seconds)), depth: seconds }
    }

    fn buoy(buoy: u32, moored: u32, seconds: f64) -> BuoyFix {
        let header = Header::at(Time::from_seconds(seconds));
        BuoyFix { header, buoy, moored, lat_deg: 0.0, lon_deg: 0.0, height: 0.0 }
    }

    #[test]
    fn readings_are_sent_in_order_and_never_before_they_are_due() {
        let clock = StartClock { data: Time(0), mono: monotonic_now() + 20_000_000, rate: 4.0 };
        let readings = vec![depth(-5.0), depth(0.0), depth(0.1), depth(0.1), depth(0.4), depth(1.5)];
        let heard = heard("due", &channel::PS, readings, clock, false, |_| false);
        // What was before the start and what is after the end is left out.
        assert_eq!(heard.iter().map(|reading| reading.depth).collect::<Vec<f64>>(), [0.0, 0.1, 0.1, 0.4]);
        for reading in heard {
            assert!(reading.header.t_arrival >= clock.monotonic_of(reading.t_valid()), "{reading:?}");
            assert!(reading.header.t_published >= reading.header.t_arrival, "{reading:?}");
        }
    }

    #[test]
    fn a_restarted_emulator_skips_to_now_but_repeats_what_holds_for_ever() {
        // Half a second of the run is over.
        let clock = StartClock { data: Time(0), mono: monotonic_now() - 500_000_000, rate: 1.0 };
        let readings = vec![buoy(1, 1, 0.0), buoy(2, 0, 0.1), buoy(3, 1, 0.2), buoy(2, 0, 0.9)];
        let heard = heard("again", &channel::BUOYS, readings, clock, true, |fix| fix.moored == 1);
        assert_eq!(heard.iter().map(|fix| fix.buoy).collect::<Vec<u32>>(), [1, 3, 2]);
    }
}
