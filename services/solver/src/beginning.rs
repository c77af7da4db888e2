//! What a solver begins from: the last solution of the one before, the last place known before the machine was started anew, or
//! the data alone.

use ilns_recording::{CheckpointError, Kept, LogError};
use ilns_runtime::{ProcessArgs, monotonic_now};
use nav_pipeline::{ChosenEstimator, LastKnown};
use shared_types::{Config, Duration, FrameOrigin, Measurement, Sensor, Solution, Time};
use tracing::{info, warn};

use crate::keeper::Places;

/// An estimator, and what it is still to be told.
pub(crate) struct Beginning {
    pub(crate) estimator: ChosenEstimator,
    waiting: Option<OfBefore>,
    /// What it was told of before the machine was started anew.
    last_known: Option<LastKnown>,
}

/// A solution of before the machine was started anew. How old it is on the clock of the readings, the first of them tells.
struct OfBefore {
    kept: Kept,
    /// When that was its age, monotonic ns.
    mono: i64,
    /// Seconds of data time per second.
    rate: f64,
}

impl Beginning {
    /// An estimator that stands on the last solution of the one before, if there is one that can be stood on.
    ///
    /// Where there is none although the run was under way (restarted, or a file was left), the state that the configuration gives
    /// for its beginning is not that of now: it is forgotten, and the first state told from the data and from what was kept.
    pub(crate) fn find(places: &Places, config: &Config, process: &ProcessArgs) -> Beginning {
        let last = places.last_solution(config);
        let mut is_under_way = process.epoch > 0 || !matches!(last, Ok(None));
        match last {
            Ok(None) => {}
            Ok(Some(solution)) => {
                let mut estimator = ChosenEstimator::new(config);
                if estimator.resume(&solution) {
                    let t_keyframe = Time(solution.t_keyframe);
                    info!(solution = solution.id, %t_keyframe, "taking up from the last solution");
                    return Beginning { estimator, waiting: None, last_known: None };
                }
                warn!(solution = solution.id, "the last solution holds no valid state; initialising anew");
            }
            Err(error) => warn!(%error, "the last solution cannot be taken up; initialising anew"),
        }
        let kept = places.kept_solution(config).unwrap_or_else(|error| {
            warn!(%error, "the solution kept for a restart of the machine cannot be taken up; initialising anew");
            is_under_way |= !is_of_another_mission(&error);
            None
        });
        is_under_way |= kept.is_some();
        let mut config = config.clone();
        if is_under_way {
            config.vehicle.initial.forget_state();
        }
        let rate = process.start.map_or(1.0, |start| start.rate);
        let waiting = kept.map(|kept| OfBefore { kept, mono: monotonic_now(), rate });
        Beginning { estimator: ChosenEstimator::new(&config), waiting, last_known: None }
    }

    /// An estimator under another configuration takes the place of this one, on the last solution where there is one.
    pub(crate) fn go_on_under(&mut self, next: &Config, stand: Option<&Solution>, origin: Option<&FrameOrigin>) {
        let mut estimator = ChosenEstimator::new(next);
        let stands = stand.is_some_and(|solution| estimator.resume(solution));
        if !stands {
            // Nothing was solved yet, or nothing valid: it begins as this one would have begun.
            origin.inspect(|origin| estimator.set_origin(origin));
            self.last_known.inspect(|last| estimator.remember(last));
        }
        info!(stands, "another configuration is in force");
        self.estimator = estimator;
    }

    /// Hears what comes, until the first inertial sample has told which data time it is.
    pub(crate) fn hear(&mut self, measurement: &Measurement) {
        if self.waiting.is_none() || measurement.sensor() != Some(Sensor::Imu) {
            return;
        }
        let Some(before) = self.waiting.take() else { return };
        let id = before.kept.solution.id;
        let t = before.t_on_the_clock_of(measurement);
        match LastKnown::of(&before.kept.solution, t) {
            Some(last) => {
                let age_s = (measurement.t_valid() - t).as_seconds();
                warn!(solution = id, age_s, "the machine was started anew: beginning from the last place kept");
                self.estimator.remember(&last);
                self.last_known = Some(last);
            }
            None => warn!(solution = id, "the solution kept for a restart of the machine holds no valid state"),
        }
    }
}

/// Whether what was kept is refused because the run that wrote it was over: it is old, or somebody has been at the vehicle since. Where
/// it is damaged, or nothing tells its age, it may be of this one.
fn is_of_another_mission(error: &LogError) -> bool {
    use CheckpointError::{Configuration, Stale, Version};
    matches!(error, LogError::Checkpoint { reason: Stale { .. } | Configuration | Version, .. })
}

impl OfBefore {
    /// When its solution held, on the clock of the readings.
    fn t_on_the_clock_of(&self, sample: &Measurement) -> Time {
        // A sample without an arrival is as old as it is.
        let mono = if sample.header.t_arrival > 0 { sample.header.t_arrival } else { self.mono };
        let age = (self.kept.age + (mono - self.mono)).max(0);
        sample.t_valid() - Duration((age as f64 * self.rate) as i64)
    }
}

#[cfg(test)]
mod tests {
    use shared_types::Reading;

    use super::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn what_cannot_be_taken_up_is_of_another_mission_only_where_that_is_known() {
        let refused = |reason| is_of_another_mission(&LogError::Checkpoint { file: "kept".into(), reason });
        assert!(refused(CheckpointError::Stale { age_s: 301, most_s: 300 }) && refused(CheckpointError::Configuration));
        assert!(!refused(CheckpointError::Damaged) && !refused(CheckpointError::ClockRanBackwards { ahead_s: 5 }));
    }

    #[test]
    fn the_age_of_a_kept_solution_is_counted_back_from_the_first_sample_at_the_rate_of_data_time() {
        let kept = Kept { solution: Solution::empty(), age: 20 * SECOND };
        let before = OfBefore { kept, mono: 100 * SECOND, rate: 2.0 };
        let mut sample = Measurement::new(
            Time(500 * SECOND),
            Time(500 * SECOND),
            &Reading::Imu { gyro_body: [0.0; 3], accel_body: [0.0; 3] },
        );
        // The driver came three seconds after this process.
        sample.header.t_arrival = 103 * SECOND;
        assert_eq!(before.t_on_the_clock_of(&sample), Time((500 - 46) * SECOND));
        sample.header.t_arrival = 0;
        assert_eq!(before.t_on_the_clock_of(&sample), Time((500 - 40) * SECOND));
    }
}
