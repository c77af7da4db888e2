//! The last solution and what came after it, for an estimator that takes the place of another under way.

use std::collections::VecDeque;

use shared_types::{AIDING, CALIBRATIONS, Config, Duration, Measurement, Sensor, Solution};

/// Measurements that are kept: some seconds of a fast IMU. Of more than that since the last solution the oldest are left out.
const KEPT: usize = 8_192;

/// Inertial samples before a keyframe that tell its own instant.
const AROUND_KEYFRAME: Duration = Duration(50_000_000);

/// See the module.
pub(crate) struct Recent {
    last: Option<Solution>,
    since: VecDeque<Measurement>,
}

impl Recent {
    pub(crate) fn new() -> Recent {
        Recent { last: None, since: VecDeque::with_capacity(KEPT) }
    }

    pub(crate) fn hear(&mut self, measurement: &Measurement) {
        if self.since.len() == KEPT {
            self.since.pop_front();
        }
        self.since.push_back(*measurement);
    }

    /// What the solution covers is no longer needed.
    pub(crate) fn solved(&mut self, solution: &Solution) {
        let t_keyframe = solution.t_keyframe;
        let is_needed = |measurement: &Measurement| {
            let t = measurement.header.t_valid;
            t > t_keyframe || measurement.sensor() == Some(Sensor::Imu) && t > t_keyframe - AROUND_KEYFRAME.0
        };
        self.since.retain(is_needed);
        self.last = Some(*solution);
    }

    /// What an estimator under `next` may stand on, if anything: the errors that were found of instruments which are others now are
    /// forgotten.
    pub(crate) fn stand(&self, before: &Config, next: &Config) -> Option<Solution> {
        let mut solution = self.last?;
        for (place, sensor) in AIDING.into_iter().enumerate() {
            if is_another(sensor, before, next) {
                // No number is none that anybody stands on.
                solution.time_offset[place] = f64::NAN;
                for calibration in CALIBRATIONS.into_iter().filter(|calibration| calibration.sensor() == sensor) {
                    solution.calibration[calibration.index()] = f64::NAN;
                }
            }
        }
        Some(solution)
    }

    /// What the next estimator has to hear before anything else, in the order in which it came.
    pub(crate) fn take(&mut self) -> impl DoubleEndedIterator<Item = Measurement> {
        self.since.drain(..)
    }
}

/// Whether the facts of an instrument, or how its stamps and scale are taken, have changed.
fn is_another(sensor: Sensor, before: &Config, next: &Config) -> bool {
    let (old, new) = (&before.vehicle, &next.vehicle);
    let facts = match sensor {
        Sensor::Lbl => old.lbl != new.lbl,
        Sensor::Gnss => old.gnss != new.gnss,
        Sensor::Dvl => old.dvl != new.dvl,
        Sensor::Mcp => old.mcp != new.mcp,
        Sensor::Ps => old.ps != new.ps,
        Sensor::Imu | Sensor::Buoys => false,
    };
    facts || before.navigator.sensor(sensor) != next.navigator.sensor(sensor)
}

#[cfg(test)]
mod tests {
    use shared_types::{Reading, Time};

    use super::*;

    fn imu(t: i64) -> Measurement {
        Measurement::new(Time(t), Time(t), &Reading::Imu { gyro_body: [0.0; 3], accel_body: [0.0; 3] })
    }

    #[test]
    fn what_a_solution_covers_is_left_out_but_for_the_samples_around_its_keyframe() {
        let mut recent = Recent::new();
        let period = 5_000_000;
        (0..400).for_each(|index| recent.hear(&imu(index * period)));
        recent.hear(&Measurement::new(Time(900_000_000), Time(1_000_000_000), &Reading::Ps { depth: 1.0 }));
        recent.hear(&Measurement::new(Time(1_100_000_000), Time(1_000_000_000), &Reading::Ps { depth: 2.0 }));
        recent.solved(&Solution { t_keyframe: 1_000_000_000, ..Solution::empty() });
        let left: Vec<i64> = recent.take().map(|measurement| measurement.header.t_valid).collect();
        assert_eq!(left.first(), Some(&955_000_000));
        assert_eq!(left.last(), Some(&1_100_000_000));
        assert_eq!(left.len(), 400 - 191 + 1);
    }

    #[test]
    fn what_was_found_of_an_instrument_that_is_another_is_forgotten_and_of_no_other() {
        let load = |set: &str| Config::load(&[], &[set.to_owned()]).expect("valid");
        let mut recent = Recent::new();
        assert_eq!(recent.stand(&Config::default(), &load("dvl.sigma=0.5")), None);
        recent.solved(&Solution { time_offset: [0.1; 5], calibration: [0.01; 2], ..Solution::empty() });
        let stands = recent.stand(&Config::default(), &load("dvl.mounting_rpy=[0, 0, 90]")).expect("there is one");
        let dvl = AIDING.iter().position(|&sensor| sensor == Sensor::Dvl).expect("it is one");
        for place in 0..AIDING.len() {
            assert_eq!(stands.time_offset[place].is_nan(), place == dvl, "{place}");
        }
        assert_eq!(stands.calibration.map(f64::is_nan), [false, true]);
    }
}
