//! Are the inertial sensors to blame for what the others say?
//!
//! One sensor that begins to be off the state may itself be what is wrong. When two begin at the same time, what they have in
//! common is wrong: the state, and what carries it from one of their readings to the next (F4, F5). They say so within seconds,
//! long before a gate refuses either.
//!
//! What counts is the share of improbable innovations (beyond 95 %), of late and beside what it used to be: a sensor whose sigma is
//! too small on the whole mission says nothing new. A Doppler log alone proves nothing, however long it goes on: that it has locked on
//! fish looks the same as a drifting gyroscope.

use shared_types::{Duration, SENSORS, Sensor, Time};

/// Sensors that begin to doubt within this do so together: a heading that drifts shows in a compass at once, in a Doppler log when
/// the vehicle has gone the wrong way for a while.
const TOGETHER: Duration = Duration(8_000_000_000);
/// The same with a pressure sensor: it is alone with the height and drags it along where it errs, until the next one objects.
const TOGETHER_WITH_PRESSURE: Duration = Duration(3_000_000_000);

/// Shares of a sensor's readings that are improbable, of late and ever since.
#[derive(Clone, Copy, Debug)]
pub struct Doubt {
    lately: f64,
    usually: f64,
    since: Option<Time>,
}

impl Default for Doubt {
    fn default() -> Doubt {
        Doubt { lately: Self::EXPECTED, usually: Self::EXPECTED, since: None }
    }
}

impl Doubt {
    const EXPECTED: f64 = 0.05;
    /// Weight of one reading: a memory of twenty, and of a thousand.
    const LATELY: f64 = 0.05;
    const USUALLY: f64 = 1e-3;
    /// Share that is doubt, on top of so many times the usual one: nine improbable readings in a row are. The largest of a clean
    /// mission is half of it.
    const RAISED: f64 = 0.3;
    const TIMES: f64 = 2.0;

    /// Takes in whether a reading at `t` is improbable.
    pub fn observe(&mut self, t: Time, is_improbable: bool) {
        let value = f64::from(u8::from(is_improbable));
        self.lately += Self::LATELY * (value - self.lately);
        self.usually += Self::USUALLY * (value - self.usually);
        let is_raised = self.lately > Self::RAISED + Self::TIMES * self.usually;
        self.since = is_raised.then(|| self.since.unwrap_or(t));
    }
}

/// Whether two sensors are in doubt and began to be so together; in the order of [`SENSORS`].
pub fn is_shared(doubts: &[Doubt; SENSORS.len()]) -> bool {
    let since = || SENSORS.into_iter().zip(doubts).filter_map(|(sensor, doubt)| Some((sensor, doubt.since?)));
    since().enumerate().any(|(index, (one, since_one))| {
        since().skip(index + 1).any(|(other, since_other)| {
            let is_pressure = one == Sensor::Ps || other == Sensor::Ps;
            (since_one - since_other).abs() <= if is_pressure { TOGETHER_WITH_PRESSURE } else { TOGETHER }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After 200 readings at 5 Hz of which every twentieth is improbable, `bad` from `from` s on that all are.
    fn doubt(from: f64, bad: u32) -> Doubt {
        let mut doubt = Doubt::default();
        for reading in 0..200 {
            doubt.observe(Time(0), reading % 20 == 0);
        }
        for reading in 0..bad {
            doubt.observe(Time::from_seconds(from + 0.2 * f64::from(reading)), true);
        }
        doubt
    }

    fn shared(of: &[(Sensor, Doubt)]) -> bool {
        let mut doubts = [Doubt::default(); SENSORS.len()];
        of.iter().for_each(|&(sensor, doubt)| doubts[sensor.index()] = doubt);
        is_shared(&doubts)
    }

    #[test]
    fn two_that_begin_together_share_a_doubt_and_one_alone_has_none() {
        assert!(shared(&[(Sensor::Mcp, doubt(100.0, 12)), (Sensor::Dvl, doubt(105.0, 12))]));
        assert!(!shared(&[(Sensor::Mcp, doubt(100.0, 12)), (Sensor::Dvl, doubt(105.0, 3))]));
        assert!(!shared(&[(Sensor::Dvl, doubt(100.0, 200))]));
    }

    #[test]
    fn one_that_objects_long_after_the_other_has_been_dragged_along() {
        assert!(!shared(&[(Sensor::Mcp, doubt(100.0, 60)), (Sensor::Dvl, doubt(110.0, 40))]));
        assert!(!shared(&[(Sensor::Ps, doubt(100.0, 60)), (Sensor::Dvl, doubt(104.0, 40))]));
        assert!(shared(&[(Sensor::Ps, doubt(100.0, 60)), (Sensor::Dvl, doubt(102.0, 40))]));
    }

    #[test]
    fn a_sensor_that_has_always_been_off_says_nothing_new() {
        let mut always = Doubt::default();
        for reading in 0..5000 {
            always.observe(Time(0), reading % 3 != 0);
        }
        assert!(!shared(&[(Sensor::Lbl, always), (Sensor::Dvl, doubt(0.0, 12))]));
    }

    #[test]
    fn a_doubt_ends_when_the_readings_are_probable_again() {
        let (mut one, other) = (doubt(100.0, 20), doubt(100.0, 20));
        assert!(shared(&[(Sensor::Lbl, one), (Sensor::Dvl, other)]));
        (0..20).for_each(|reading| one.observe(Time::from_seconds(104.0 + 0.2 * f64::from(reading)), false));
        assert!(!shared(&[(Sensor::Lbl, one), (Sensor::Dvl, other)]));
    }
}
