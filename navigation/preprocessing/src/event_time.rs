//! In which order are readings of several channels taken up?
//!
//! Channels deliver in any interleaving, a replay in another than the live run. So aiding readings wait until the IMU has
//! passed their `t_valid` by `keyframes.settle`, and are then taken up by
//!
//! ```text
//! (t_valid, sensor in the order buoys gnss dvl mcp ps lbl, buoy, order within the channel)
//! ```
//!
//! The same readings then give the same measurements whatever the interleaving, as long as none is later than the settle
//! time. A later one is taken up at the next IMU sample.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use shared_types::{RawReading, Sensor, Time};

/// Readings that wait at most: half a minute of all aiding sensors while the IMU is silent.
const CAPACITY: usize = 4096;

/// Aiding readings that the IMU has not passed yet.
#[derive(Clone, Debug)]
pub(crate) struct EventTime {
    waiting: BinaryHeap<Reverse<Entry>>,
    arrivals: u64,
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    reading: RawReading,
    arrival: u64,
}

impl Entry {
    fn key(&self) -> (Time, u32, u32, u64) {
        let (rank, buoy) = match &self.reading {
            RawReading::Imu(_) => (0, 0),
            RawReading::Buoy(fix) => (1, fix.buoy),
            RawReading::Gnss(_) => (2, 0),
            RawReading::Dvl(_) => (3, 0),
            RawReading::Mcp(_) => (4, 0),
            RawReading::Ps(_) => (5, 0),
            RawReading::Lbl(range) => (6, range.buoy),
        };
        (self.reading.t_valid(), rank, buoy, self.arrival)
    }
}

impl PartialEq for Entry {
    fn eq(&self, other: &Entry) -> bool {
        self.key() == other.key()
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Entry) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Entry) -> Ordering {
        self.key().cmp(&other.key())
    }
}

impl EventTime {
    pub(crate) fn new() -> EventTime {
        EventTime { waiting: BinaryHeap::with_capacity(CAPACITY + 1), arrivals: 0 }
    }

    /// Takes a reading in; where there is no room left, the earliest of all comes back.
    #[must_use]
    pub(crate) fn push(&mut self, reading: &RawReading) -> Option<RawReading> {
        self.waiting.push(Reverse(Entry { reading: *reading, arrival: self.arrivals }));
        self.arrivals += 1;
        if self.waiting.len() > CAPACITY { self.pop() } else { None }
    }

    /// `t_valid` of the next reading.
    pub(crate) fn t_next(&self) -> Option<Time> {
        self.waiting.peek().map(|Reverse(entry)| entry.reading.t_valid())
    }

    /// The next reading.
    pub(crate) fn pop(&mut self) -> Option<RawReading> {
        self.waiting.pop().map(|Reverse(entry)| entry.reading)
    }

    /// How many of a sensor wait.
    pub(crate) fn held(&self, sensor: Sensor) -> usize {
        self.waiting.iter().filter(|Reverse(entry)| entry.reading.sensor() == sensor).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{dvl, gnss, lbl, ps};

    #[test]
    fn readings_come_out_by_time_then_sensor_then_buoy() {
        let mut event_time = EventTime::new();
        let in_order = [ps(0.9, 1.0), gnss(1.0, 0.0), dvl(1.0, 0.1), ps(1.0, 1.0), lbl(1.0, 1, 5.0), lbl(1.0, 2, 5.0)];
        for index in [4, 2, 5, 0, 3, 1] {
            assert!(event_time.push(&in_order[index]).is_none());
        }
        assert_eq!(event_time.t_next(), Some(Time::from_seconds(0.9)));
        for reading in in_order {
            assert_eq!(event_time.pop(), Some(reading));
        }
        assert_eq!(event_time.pop(), None);
    }

    #[test]
    fn when_full_the_earliest_makes_room() {
        let mut event_time = EventTime::new();
        for index in 0..CAPACITY {
            assert!(event_time.push(&dvl(index as f64, 0.1)).is_none());
        }
        assert_eq!(event_time.push(&dvl(0.5, 0.1)), Some(dvl(0.0, 0.1)));
        assert_eq!(event_time.held(Sensor::Dvl), CAPACITY);
    }
}
