//! What the estimate may be trusted for: a pure function of the solution, the time of the sample and the sigmas.

use shared_types::{AIDING, Duration, Mode, Sensor, Time};

use super::uncertainty::Uncertainty;
use super::{Base, Propagator};

impl Base {
    /// Since each aiding sensor's newest measurement in the solution, s; infinite = never.
    pub(super) fn aiding_age(&self, t: Time) -> [f64; 5] {
        self.t_last_used.map(|used| if used == i64::MIN { f64::INFINITY } else { (t - Time(used)).as_seconds() })
    }

    fn was_used_within(&self, sensor: Sensor, t: Time, limit: Duration) -> bool {
        AIDING
            .iter()
            .zip(self.t_last_used)
            .any(|(&aiding, used)| aiding == sensor && used != i64::MIN && t - Time(used) <= limit)
    }

    fn was_ever_used(&self, sensor: Sensor) -> bool {
        AIDING.iter().zip(self.t_last_used).any(|(&aiding, used)| aiding == sensor && used != i64::MIN)
    }
}

impl Propagator {
    pub(super) fn mode_at(&self, t: Time, base: &Base, uncertainty: &Uncertainty) -> Mode {
        let limits = &self.config.navigator.propagator;
        let position = &uncertainty.position;
        let horizontal_variance = position[(0, 0)].max(position[(1, 1)]);
        let is_within = horizontal_variance <= limits.max_position_sigma * limits.max_position_sigma;
        // A variance that is no number is not within either.
        if !is_within || !uncertainty.is_finite() || base.is_inconsistent {
            return Mode::Invalid;
        }
        let has_position_aiding = [Sensor::Lbl, Sensor::Gnss]
            .into_iter()
            .any(|sensor| base.was_used_within(sensor, t, limits.position_timeout));
        if !has_position_aiding {
            return Mode::DeadReckoning;
        }
        let is_missing = |sensor| base.was_ever_used(sensor) && !base.was_used_within(sensor, t, limits.aiding_timeout);
        let is_degraded = !base.is_converged
            || self.has_bridged_gap
            || t - base.t_keyframe > limits.solution_timeout
            || [Sensor::Dvl, Sensor::Mcp, Sensor::Ps].into_iter().any(is_missing);
        if is_degraded { Mode::Degraded } else { Mode::Ok }
    }
}
