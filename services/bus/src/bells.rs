//! Who is woken by what. A reader that sleeps has one bell, rung by every channel that it must not be late for.
//!
//! Ringing costs the sender 7 to 9 µs, so nobody is rung who can be late: the recorder and the monitor look after their
//! queues on a timer, and the preprocessor, which passes IMU samples on to a solver that works once per keyframe, is rung
//! only at every tenth of them.

use shared_types::channel;

/// A reader that sleeps until it is rung.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reader {
    /// Of the IMU and of solutions: the fast path.
    Propagator,
    /// Of every sensor.
    Preprocessor,
    /// Of measurements.
    Solver,
    /// Whoever steers by the estimates.
    Vehicle,
}

/// Rings a reader at every so many messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Ring {
    pub(crate) reader: Reader,
    pub(crate) every: u32,
}

impl Reader {
    pub(crate) const ALL: [Reader; 4] = [Reader::Propagator, Reader::Preprocessor, Reader::Solver, Reader::Vehicle];

    /// As in the channel table's list of readers.
    pub const fn name(self) -> &'static str {
        match self {
            Reader::Propagator => "propagator",
            Reader::Preprocessor => "preprocessor",
            Reader::Solver => "solver",
            Reader::Vehicle => "vehicle",
        }
    }

    /// Name of its event service.
    pub(crate) fn bell(self) -> String {
        format!("bell/{}", self.name())
    }
}

const fn at_each(reader: Reader) -> Ring {
    Ring { reader, every: 1 }
}

/// Whom a channel rings, the most urgent first.
pub(crate) fn rings(channel: &str) -> &'static [Ring] {
    const FAST_THEN_SLOW: &[Ring] = &[at_each(Reader::Propagator), Ring { reader: Reader::Preprocessor, every: 10 }];
    const TO_PREPROCESSOR: &[Ring] = &[at_each(Reader::Preprocessor)];
    const TO_SOLVER: &[Ring] = &[at_each(Reader::Solver)];
    const TO_PROPAGATOR: &[Ring] = &[at_each(Reader::Propagator)];
    const TO_VEHICLE: &[Ring] = &[at_each(Reader::Vehicle)];
    const AIDING: [&str; 6] = [
        channel::LBL.spec.name,
        channel::GNSS.spec.name,
        channel::DVL.spec.name,
        channel::MCP.spec.name,
        channel::PS.spec.name,
        channel::BUOYS.spec.name,
    ];
    if channel == channel::IMU.spec.name {
        FAST_THEN_SLOW
    } else if AIDING.contains(&channel) {
        TO_PREPROCESSOR
    } else if channel == channel::MEASUREMENTS.spec.name {
        TO_SOLVER
    } else if channel == channel::SOLUTION.spec.name {
        TO_PROPAGATOR
    } else if channel == channel::ESTIMATE.spec.name {
        TO_VEHICLE
    } else {
        &[]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::EVERY_CHANNEL;

    #[test]
    fn only_readers_of_a_channel_are_rung_by_it() {
        for spec in EVERY_CHANNEL {
            for ring in rings(spec.name) {
                assert!(spec.readers.contains(&ring.reader.name()), "{} rings {}", spec.name, ring.reader.name());
            }
        }
    }

    #[test]
    fn the_imu_driver_rings_the_propagator_first() {
        assert_eq!(rings("sensor/imu")[0], Ring { reader: Reader::Propagator, every: 1 });
    }

    #[test]
    fn every_reader_that_sleeps_is_rung_by_some_channel() {
        for reader in Reader::ALL {
            assert!(
                EVERY_CHANNEL.iter().any(|spec| rings(spec.name).iter().any(|ring| ring.reader == reader)),
                "{reader:?}"
            );
        }
    }
}
