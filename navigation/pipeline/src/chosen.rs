//! Estimators by name.

use nav_fgo::{FgoEstimator, Smoothed};
use nav_geometry::Geodetic;
use nav_models::estimator::{Effort, Estimator, EstimatorError};
use shared_types::{
    AIDING, Config, EstimatorKind, FrameOrigin, KeyframeReport, Measurement, NavEstimate, SensorCounts, Solution,
};

/// The estimator that the configuration names.
#[derive(Clone, Debug)]
pub enum ChosenEstimator {
    /// Sliding-window factor graph.
    Fgo(Box<FgoEstimator>),
}

impl ChosenEstimator {
    /// As `estimator` says.
    pub fn new(config: &Config) -> ChosenEstimator {
        match config.navigator.estimator {
            EstimatorKind::Fgo => ChosenEstimator::Fgo(Box::new(FgoEstimator::new(config))),
        }
    }

    /// Fixes the frame; later calls change nothing.
    pub fn set_origin(&mut self, origin: &FrameOrigin) {
        let origin = Geodetic::from_degrees(origin.lat_deg, origin.lon_deg, origin.height);
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.set_origin(origin),
        }
    }

    /// Takes up from the last solution of an earlier run; `false` if it holds no valid state.
    pub fn resume(&mut self, solution: &Solution) -> bool {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.resume(solution),
        }
    }

    /// The trajectory given all that the window holds; see [`FgoEstimator::smooth`].
    pub fn smooth(&mut self, max_passes: u32) -> Option<Smoothed> {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.smooth(max_passes),
        }
    }

    /// Shows a smoothed trajectory at every IMU sample.
    pub fn along(&self, smoothed: &Smoothed, show: impl FnMut(&NavEstimate)) {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.along(smoothed, show),
        }
    }

    /// What the newest keyframe holds.
    pub fn report(&self) -> &KeyframeReport {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.report(),
        }
    }

    /// How much too late each [`shared_types::AIDING`] sensor's stamps are taken to be, and the sigmas of that, s.
    pub fn time_offsets(&self) -> ([f64; AIDING.len()], [f64; AIDING.len()]) {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.time_offsets(),
        }
    }

    /// Used and refused measurements, in the order of [`shared_types::SENSORS`].
    pub fn counts(&self) -> &[SensorCounts] {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.counts(),
        }
    }
}

impl Estimator for ChosenEstimator {
    fn ingest(&mut self, measurement: &Measurement, effort: Effort) -> Result<Option<Solution>, EstimatorError> {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.ingest(measurement, effort),
        }
    }
}
