//! What a process says of itself, twice a second: CPU, memory, counts and latency distributions.

use std::fs::File;
use std::os::unix::fs::FileExt;

use rustix::param::page_size;
use rustix::time::ClockId;
use shared_types::{Header, Heartbeat, Process, ProcessState, Sensor, SensorHealth, Time};

use crate::clock::{monotonic_now, nanoseconds};
use crate::latency::Latency;
use crate::notify::Notify;

/// Between two heartbeats, ns.
pub const BEAT: i64 = 500_000_000;

/// Keeps a process's own account and makes heartbeats of it.
#[derive(Debug)]
pub struct HeartbeatBuilder {
    process: Process,
    restarts: u32,
    next_beat: i64,
    /// Kept open: opening it anew would allocate in somebody's loop.
    statm: Option<File>,
    notify: Notify,
    /// Where the process stands.
    pub state: ProcessState,
    /// Messages that it published and no queue took; of the recorder, those that are not in the record.
    pub dropped: u64,
    /// Messages that it handled.
    pub handled: u64,
    /// Per sensor, in the order of [`shared_types::SENSORS`].
    pub sensors: [SensorHealth; 7],
    /// From publication to receipt on its main input.
    pub hop_in: Latency,
    /// From the origin's arrival to its own publication.
    pub end_to_end: Latency,
    /// Time of its main piece of work.
    pub work: Latency,
}

impl HeartbeatBuilder {
    /// A process that has done nothing yet; `epoch` is its start counter.
    pub fn new(process: Process, epoch: u32) -> HeartbeatBuilder {
        HeartbeatBuilder {
            process,
            restarts: epoch,
            next_beat: i64::MIN,
            statm: File::open("/proc/self/statm").ok(),
            notify: Notify::from_environment(),
            state: ProcessState::Starting,
            dropped: 0,
            handled: 0,
            sensors: [SensorHealth::NONE; 7],
            hop_in: Latency::new(),
            end_to_end: Latency::new(),
            work: Latency::new(),
        }
    }

    /// Counts a message received on the main input.
    pub fn received(&mut self, header: &Header) {
        self.received_at(header, monotonic_now());
    }

    /// As [`HeartbeatBuilder::received`], where the monotonic time of receipt is known already.
    pub fn received_at(&mut self, header: &Header, mono: i64) {
        self.handled += 1;
        self.hop_in.record(mono - header.t_published);
    }

    /// Counts a reading of a sensor, received or sent.
    pub fn reading(&mut self, sensor: Sensor, t_valid: Time) {
        let health = &mut self.sensors[sensor.index()];
        health.received += 1;
        health.t_newest = health.t_newest.max(t_valid.0);
    }

    /// The heartbeat that is due at the monotonic time `now`, if one is. The first is due at once, and a change of state
    /// needs [`HeartbeatBuilder::build`].
    pub fn beat(&mut self, now: i64) -> Option<Heartbeat> {
        if now < self.next_beat {
            return None;
        }
        self.rest(now);
        Some(self.build())
    }

    /// The next heartbeat is due one period after the monotonic time `now`. Called from a process's loop, it also tells the
    /// service manager that the loop goes round.
    pub fn rest(&mut self, now: i64) {
        self.next_beat = now + BEAT;
        self.notify.progress();
    }

    /// When the next heartbeat is due, monotonic ns.
    pub fn next_beat(&self) -> i64 {
        self.next_beat
    }

    /// A heartbeat now.
    pub fn build(&self) -> Heartbeat {
        Heartbeat {
            header: Header { t_arrival: monotonic_now(), ..Header::default() },
            process: self.process as u32,
            state: self.state as u32,
            pid: std::process::id(),
            restarts: self.restarts,
            cpu_ns: nanoseconds(ClockId::ProcessCPUTime) as u64,
            resident_bytes: self.resident_bytes(),
            dropped: self.dropped,
            handled: self.handled,
            sensors: self.sensors,
            hop_in: self.hop_in.brief(),
            end_to_end: self.end_to_end.brief(),
            work: self.work.brief(),
        }
    }

    /// 0 where the system does not tell.
    fn resident_bytes(&self) -> u64 {
        // Seven numbers of pages; the second is what is resident.
        let mut text = [0; 128];
        let length = self.statm.as_ref().and_then(|statm| statm.read_at(&mut text, 0).ok()).unwrap_or(0);
        let text = core::str::from_utf8(&text[..length]).unwrap_or_default();
        let pages: u64 = text.split_whitespace().nth(1).and_then(|pages| pages.parse().ok()).unwrap_or(0);
        pages * page_size() as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_heartbeat_tells_what_was_counted() {
        let mut builder = HeartbeatBuilder::new(Process::Propagator, 2);
        builder.state = ProcessState::Running;
        for ns in [1_000, 2_000, 3_000, 100_000] {
            builder.work.record(ns);
        }
        builder.reading(Sensor::Imu, Time(7));
        builder.reading(Sensor::Imu, Time(5));
        let beat = builder.build();
        assert_eq!((beat.process, beat.state, beat.restarts), (11, 1, 2));
        assert_eq!(beat.sensors[0].received, 2);
        assert_eq!(beat.sensors[0].t_newest, 7);
        assert_eq!((beat.work.count, beat.hop_in.count), (4, 0));
        assert!((1_980..=2_020).contains(&beat.work.p50_ns), "{}", beat.work.p50_ns);
        assert!((99_000..=101_000).contains(&beat.work.max_ns), "{}", beat.work.max_ns);
        assert!(beat.resident_bytes > 100_000 && beat.cpu_ns > 0);
    }

    #[test]
    fn the_first_beat_is_due_at_once_and_the_next_after_its_period() {
        let mut builder = HeartbeatBuilder::new(Process::Solver, 0);
        assert!(builder.beat(1_000).is_some());
        assert!(builder.beat(1_000 + BEAT - 1).is_none());
        assert!(builder.beat(1_000 + BEAT).is_some());
    }
}
