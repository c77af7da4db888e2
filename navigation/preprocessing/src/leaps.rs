//! Can an IMU's numbers change as fast as that?
//!
//! No vehicle changes its specific force by one and a half g, or its rate by a hundred degrees a second, within a sample and for
//! long: that would be a metre a second in a tenth of one. What does is a knock on the housing, an instrument at a rail that nobody
//! configured, or one that was turned round, whose gravity points elsewhere from one sample to the next (F3, F5). Such samples
//! are refused for as long as they last, and the gap is bridged from the last sample before them.
//!
//! Which side of the leap is the wrong one? **The shorter run.** One wild sample at the beginning yields to the second that is
//! otherwise; after a mission of an hour the instrument must insist for five minutes.

use shared_types::{Duration, ImuSample, Time};

/// Norm of a change of specific force, m/s², and of rate, rad/s, between two samples that count. The logs of three ROVs, a
/// rover and a car hold 2.4 and 0.15 at the most, a simulated vehicle less; gravity turned round is 19.6.
const LEAP_ACCEL: f64 = 15.0;
const LEAP_RATE: f64 = 2.0;
/// The longest run that is weighed, in samples: five minutes at 200 Hz.
pub(crate) const LONGEST: u32 = 60_000;

/// The last sample that was no leap, and the runs on both sides.
#[derive(Clone, Debug)]
pub(crate) struct Leaps {
    /// Samples further apart than this are not compared: much can happen meanwhile.
    gap: Duration,
    reference: Option<ImuSample>,
    t_heard: Time,
    believed: u32,
    refused: u32,
}

impl Leaps {
    /// Nothing heard yet.
    pub(crate) fn new(gap: Duration) -> Leaps {
        Leaps { gap, reference: None, t_heard: Time::MIN, believed: 0, refused: 0 }
    }

    /// Takes the sample at `t` in, later than its predecessors: whether it lies beyond a leap.
    pub(crate) fn is_leap(&mut self, t: Time, sample: &ImuSample) -> bool {
        let is_silent = self.reference.is_none_or(|_| t - self.t_heard > self.gap);
        self.t_heard = t;
        let is_far = self.reference.is_some_and(|reference| {
            distance(&sample.accel_body, &reference.accel_body) > LEAP_ACCEL
                || distance(&sample.gyro_body, &reference.gyro_body) > LEAP_RATE
        });
        // A silence excuses the first leap of a run, and does not end one.
        if is_far && !(is_silent && self.refused == 0) {
            self.refused += 1;
            if self.refused <= self.believed.min(LONGEST) {
                return true;
            }
            self.believed = 0;
        }
        self.reference = Some(*sample);
        self.believed = self.believed.saturating_add(1);
        self.refused = 0;
        false
    }
}

fn distance(one: &[f64; 3], other: &[f64; 3]) -> f64 {
    one.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::imu;

    const GAP: Duration = Duration(20_000_000);

    /// A hundred samples at rest, and the time of the next.
    fn begun() -> (Leaps, f64) {
        let mut leaps = Leaps::new(GAP);
        for step in 0..100 {
            assert!(!push(&mut leaps, f64::from(step) * 0.005, [0.0; 3], [0.0, 0.0, 9.8]));
        }
        (leaps, 0.5)
    }

    fn push(leaps: &mut Leaps, t: f64, gyro_body: [f64; 3], accel_body: [f64; 3]) -> bool {
        let sample = ImuSample { gyro_body, accel_body, ..imu(t) };
        leaps.is_leap(Time::from_seconds(t), &sample)
    }

    #[test]
    fn a_knock_is_refused_and_what_comes_after_it_is_not() {
        let (mut leaps, t) = begun();
        assert!(push(&mut leaps, t, [0.0; 3], [20.0, -20.0, 30.0]));
        assert!(!push(&mut leaps, t + 0.005, [0.0; 3], [0.1, 0.0, 9.7]));
        assert!(push(&mut leaps, t + 0.01, [0.0, 0.0, 2.1], [0.1, 0.0, 9.7]));
    }

    #[test]
    fn rails_that_change_sides_are_refused_as_long_as_they_last() {
        let (mut leaps, t) = begun();
        for step in 0..60 {
            let side = if step % 3 == 0 { -1.0 } else { 1.0 };
            assert!(
                push(&mut leaps, t + f64::from(step) * 0.005, [8.7 * side; 3], [78.0 * side, 78.0, 78.0]),
                "{step}"
            );
        }
        assert!(!push(&mut leaps, t + 0.3, [0.0; 3], [0.0, 0.0, 9.8]));
    }

    #[test]
    fn of_two_runs_the_longer_one_is_believed() {
        let (mut leaps, t) = begun();
        let turned =
            |leaps: &mut Leaps, step: i32| push(leaps, t + f64::from(step) * 0.005, [0.0; 3], [0.0, 0.0, -9.8]);
        assert!((0..100).all(|step| turned(&mut leaps, step)));
        assert!((100..200).all(|step| !turned(&mut leaps, step)));
        let mut leaps = Leaps::new(GAP);
        assert!(!push(&mut leaps, 0.0, [0.0; 3], [100.0; 3]), "nothing speaks against the first");
        assert!(push(&mut leaps, 0.005, [0.0; 3], [0.0, 0.0, 9.8]));
        assert!(!push(&mut leaps, 0.01, [0.0; 3], [0.0, 0.0, 9.8]));
    }

    #[test]
    fn after_a_silence_anything_may_be_and_a_silence_excuses_no_run_of_leaps() {
        let (mut leaps, t) = begun();
        assert!(!push(&mut leaps, t + 0.1, [0.0; 3], [0.0, 0.0, 60.0]));
        let (mut leaps, t) = begun();
        assert!(push(&mut leaps, t, [0.0; 3], [0.0, 0.0, 60.0]));
        assert!(push(&mut leaps, t + 0.1, [0.0; 3], [0.0, 0.0, 60.0]));
    }
}
