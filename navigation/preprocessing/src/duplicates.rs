//! Did exactly this reading come before?
//!
//! Late packets are sent twice, and a batch after a silence repeats what was already heard (F12). A reading is a
//! duplicate when sensor, `t_valid` and every reported number agree to the bit; two different ranges of one buoy at one
//! instant are two measurements.

use shared_types::{RawReading, SENSORS, Time};

/// Readings remembered per sensor: at least ten seconds of the fastest aiding sensor (25 Hz), a minute of four buoys.
const MEMORY: usize = 256;

/// What makes a reading itself.
type Content = (Time, [u64; 6]);

/// The newest readings of each sensor.
#[derive(Clone, Debug)]
pub(crate) struct Duplicates {
    seen: [Memory; SENSORS.len()],
}

#[derive(Clone, Debug)]
struct Memory {
    ring: Vec<Content>,
    next: usize,
}

impl Duplicates {
    pub(crate) fn new() -> Duplicates {
        Duplicates { seen: std::array::from_fn(|_| Memory { ring: Vec::with_capacity(MEMORY), next: 0 }) }
    }

    /// Whether the reading came before; remembers it if not.
    pub(crate) fn contains_or_insert(&mut self, reading: &RawReading) -> bool {
        let content = (reading.t_valid(), numbers(reading).map(f64::to_bits));
        let memory = &mut self.seen[reading.sensor().index()];
        if memory.ring.contains(&content) {
            return true;
        }
        if memory.ring.len() < MEMORY {
            memory.ring.push(content);
        } else {
            memory.ring[memory.next] = content;
            memory.next = (memory.next + 1) % MEMORY;
        }
        false
    }
}

/// Everything that the instrument reported, header and epoch count aside.
fn numbers(reading: &RawReading) -> [f64; 6] {
    match reading {
        RawReading::Imu(r) => {
            let ([wx, wy, wz], [fx, fy, fz]) = (r.gyro_body, r.accel_body);
            [wx, wy, wz, fx, fy, fz]
        }
        RawReading::Buoy(r) => [f64::from(r.buoy), f64::from(r.moored), r.lat_deg, r.lon_deg, r.height, 0.0],
        RawReading::Gnss(r) => {
            let [east, north, up] = r.sigma_enu;
            [r.lat_deg, r.lon_deg, r.height, east, north, up]
        }
        RawReading::Dvl(r) => {
            let [x, y, z] = r.velocity_dvl;
            [x, y, z, 0.0, 0.0, 0.0]
        }
        RawReading::Mcp(r) => [r.heading_deg, 0.0, 0.0, 0.0, 0.0, 0.0],
        RawReading::Ps(r) => [r.depth, 0.0, 0.0, 0.0, 0.0, 0.0],
        RawReading::Lbl(r) => [f64::from(r.buoy), r.range, 0.0, 0.0, 0.0, 0.0],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{dvl, lbl};

    #[test]
    fn the_same_row_twice_is_one_reading() {
        let mut duplicates = Duplicates::new();
        assert!(!duplicates.contains_or_insert(&dvl(1.0, 0.5)));
        assert!(duplicates.contains_or_insert(&dvl(1.0, 0.5)));
        assert!(!duplicates.contains_or_insert(&dvl(1.1, 0.5)), "the same number at another time is another reading");
    }

    #[test]
    fn two_ranges_of_one_buoy_at_one_instant_are_two_measurements() {
        let mut duplicates = Duplicates::new();
        assert!(!duplicates.contains_or_insert(&lbl(1.0, 3, 100.0)));
        assert!(!duplicates.contains_or_insert(&lbl(1.0, 3, 101.0)));
        assert!(!duplicates.contains_or_insert(&lbl(1.0, 4, 100.0)));
        assert!(duplicates.contains_or_insert(&lbl(1.0, 3, 100.0)));
    }

    #[test]
    fn a_repeated_nan_is_a_duplicate_too() {
        let mut duplicates = Duplicates::new();
        assert!(!duplicates.contains_or_insert(&dvl(1.0, f64::NAN)));
        assert!(duplicates.contains_or_insert(&dvl(1.0, f64::NAN)));
    }

    #[test]
    fn the_memory_forgets_the_oldest_first() {
        let mut duplicates = Duplicates::new();
        for index in 0..=MEMORY {
            assert!(!duplicates.contains_or_insert(&dvl(index as f64, 0.5)));
        }
        assert!(duplicates.contains_or_insert(&dvl(1.0, 0.5)));
        assert!(!duplicates.contains_or_insert(&dvl(0.0, 0.5)));
    }
}
