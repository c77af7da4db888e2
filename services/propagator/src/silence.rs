//! Since when has the IMU been silent, and is it time to say so again?
//!
//! Data time goes on from the last sample at the rate of the start triple. The limit holds on both clocks: a slowed-down
//! replay is not silent between two of its samples, and in a fast one a process that was not scheduled for 5 ms is not blind.
//! A slower instrument than 200 Hz is given four of its own periods, which are learned from its samples.

use shared_types::{Duration, Time};

/// INVALID is out four periods of a 200 Hz instrument after the last sample, ns.
#[cfg(test)]
const DECLARED: i64 = 20_000_000;
/// So the word falls earlier: by the shortest sleep, and by as much again for waking and publishing.
const LIMIT: i64 = 18_000_000;
/// The same in periods of a slower instrument, …
const LIMIT_PERIODS: f64 = 3.6;
/// … which are averaged over so many samples. A longer step than this is a gap and none of them, ns.
const PERIOD_MEMORY: f64 = 16.0;
const PERIOD_MAX: i64 = 100_000_000;
/// Shortest sleep, ns.
const SLEEP_AT_LEAST: i64 = 1_000_000;

/// Between two estimates without IMU, monotonic ns: enough to act upon, and an idle set uses no CPU.
const PERIOD: i64 = 50_000_000;

/// The last sample, and when to speak next.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Silence {
    rate: f64,
    last: Option<Heard>,
    /// Between two samples, ns of data time.
    period: f64,
}

#[derive(Clone, Copy, Debug)]
struct Heard {
    t: Time,
    mono: i64,
    next_word: i64,
}

impl Silence {
    /// `rate`: seconds of data time per second.
    pub(crate) fn new(rate: f64) -> Silence {
        Silence { rate, last: None, period: 0.0 }
    }

    /// A sample that counts, of data time `t`, was heard at the monotonic time `mono`.
    pub(crate) fn heard(&mut self, t: Time, mono: i64) {
        let step = self.last.map_or(0, |last| (t - last.t).0);
        if (1..=PERIOD_MAX).contains(&step) {
            self.period += (step as f64 - self.period) / PERIOD_MEMORY;
        }
        let patience = (LIMIT as f64).max(LIMIT_PERIODS * self.period);
        let limit = patience.max(patience / self.rate) as i64;
        self.last = Some(Heard { t, mono, next_word: mono + limit });
    }

    /// Data time now, where something has to be said without the IMU at the monotonic time `mono`.
    pub(crate) fn due(&mut self, mono: i64) -> Option<Time> {
        let last = self.last.as_mut()?;
        if mono < last.next_word {
            return None;
        }
        last.next_word = mono + PERIOD;
        Some(last.t + Duration(((mono - last.mono) as f64 * self.rate) as i64))
    }

    /// How long to sleep at most from the monotonic time `mono` on, so as not to be late, ns.
    pub(crate) fn patience(&self, mono: i64) -> i64 {
        self.last.map_or(PERIOD, |last| (last.next_word - mono).clamp(SLEEP_AT_LEAST, PERIOD))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn an_imu_that_never_spoke_is_not_silent() {
        assert_eq!(Silence::new(1.0).due(i64::MAX), None);
    }

    #[test]
    fn silence_is_declared_within_four_periods_and_then_twenty_times_a_second() {
        let mut silence = Silence::new(1.0);
        silence.heard(Time(7 * MS), 100 * MS);
        assert_eq!(silence.due(117 * MS), None);
        assert_eq!(silence.due(118 * MS), Some(Time(25 * MS)));
        assert_eq!(silence.due(167 * MS), None);
        assert_eq!(silence.due(168 * MS), Some(Time(75 * MS)));
        silence.heard(Time(80 * MS), 169 * MS);
        assert_eq!(silence.due(186 * MS), None);
    }

    #[test]
    fn a_slow_replay_is_not_silent_and_a_fast_one_is_given_the_same_patience() {
        let mut slow = Silence::new(0.1);
        slow.heard(Time(0), 0);
        assert_eq!(slow.due(179 * MS), None);
        assert_eq!(slow.due(180 * MS), Some(Time(18 * MS)));
        let mut fast = Silence::new(10.0);
        fast.heard(Time(0), 0);
        assert_eq!(fast.due(17 * MS), None);
        assert_eq!(fast.due(18 * MS), Some(Time(180 * MS)));
    }

    #[test]
    fn an_instrument_of_twenty_five_hertz_is_not_silent_between_its_samples() {
        let mut silence = Silence::new(1.0);
        // Until its period is known it may be called silent.
        (0..100).for_each(|sample| silence.heard(Time(40 * MS * sample), 40 * MS * sample));
        let last = 99 * 40 * MS;
        assert_eq!(silence.due(last + 119 * MS), None);
        assert!(silence.due(last + 160 * MS).is_some());
        silence.heard(Time(last + 5_000 * MS), last + 5_000 * MS);
        assert!(silence.due(last + 5_160 * MS).is_some(), "a gap is no period");
    }

    #[test]
    fn sleep_ends_in_time_for_the_next_word() {
        let mut silence = Silence::new(1.0);
        assert_eq!(silence.patience(0), PERIOD);
        silence.heard(Time(0), 0);
        assert_eq!(silence.patience(5 * MS), 13 * MS);
        assert_eq!(silence.patience(25 * MS), MS, "late already, but never a spinning loop");
    }

    #[test]
    fn whenever_the_driver_dies_silence_is_declared_within_four_periods_of_its_last_sample() {
        // Wherever within the sleep the last wake-up before the limit fell.
        for woken in (0..LIMIT).step_by(100_000) {
            let mut silence = Silence::new(1.0);
            silence.heard(Time(0), 0);
            let mut mono = woken;
            while silence.due(mono).is_none() {
                mono += silence.patience(mono);
            }
            assert!(mono <= DECLARED - SLEEP_AT_LEAST, "woken at {woken} ns, declared at {mono} ns");
        }
    }
}
