//! What every estimator is to its caller: measurements in, solutions out, no clock and no thread of its own.

use shared_types::{Measurement, MeasurementError, Solution, Time};

/// How hard an estimator may work at a keyframe. Decided by the caller, who sees the queue and the clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Effort {
    /// To convergence.
    #[default]
    Full,
    /// One pass.
    Reduced,
    /// Take the keyframe in and solve with the next one.
    Hold,
}

/// Measurements in arrival order in, a [`Solution`] out at a keyframe.
pub trait Estimator {
    /// Takes one measurement. At a keyframe it solves, as hard as `effort` allows.
    ///
    /// # Errors
    /// [`EstimatorError`]; the measurement is then left out and the estimator stands as before.
    fn ingest(&mut self, measurement: &Measurement, effort: Effort) -> Result<Option<Solution>, EstimatorError>;
}

/// A measurement that an estimator cannot take.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EstimatorError {
    /// Not a measurement.
    #[error(transparent)]
    Malformed(#[from] MeasurementError),
    /// IMU samples and keyframes must move forward in time.
    #[error("{what} at {t} s is not later than the last one at {last} s")]
    TimeRunsBackwards {
        /// IMU sample or keyframe.
        what: &'static str,
        /// Of the last one.
        last: Time,
        /// Of this one.
        t: Time,
    },
    /// A matrix that must be positive definite is not, and damping did not mend it.
    #[error("no solution at the keyframe at {t} s: {reason}")]
    Unsolvable {
        /// Of the keyframe.
        t: Time,
        /// Which matrix.
        reason: &'static str,
    },
}
