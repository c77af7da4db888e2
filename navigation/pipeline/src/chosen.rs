//! Estimators by name.

use nav_fgo::{FgoEstimator, Smoothed};
use nav_geometry::Geodetic;
use nav_kalman::{Ekf, FederatedKf};
use nav_models::estimator::{Effort, Estimator, EstimatorError};
use nav_models::initialisation::LastKnown;
use shared_types::{
    AIDING, CALIBRATIONS, Config, EstimatorKind, FrameOrigin, KeyframeReport, Measurement, NavEstimate, SensorCounts,
    Solution,
};

/// The estimator that the configuration names.
#[derive(Clone, Debug)]
pub enum ChosenEstimator {
    /// Sliding-window factor graph.
    Fgo(Box<FgoEstimator>),
    /// Error-state extended Kalman filter.
    Ekf(Box<Ekf>),
    /// Federated Kalman filter.
    Fkf(Box<FederatedKf>),
}

/// The same of whichever it is.
macro_rules! whichever {
    ($chosen:expr, $estimator:ident => $result:expr) => {
        match $chosen {
            ChosenEstimator::Fgo($estimator) => $result,
            ChosenEstimator::Ekf($estimator) => $result,
            ChosenEstimator::Fkf($estimator) => $result,
        }
    };
}

impl ChosenEstimator {
    /// As `estimator` says.
    pub fn new(config: &Config) -> ChosenEstimator {
        match config.navigator.estimator {
            EstimatorKind::Fgo => ChosenEstimator::Fgo(Box::new(FgoEstimator::new(config))),
            EstimatorKind::Ekf => ChosenEstimator::Ekf(Box::new(Ekf::new(config))),
            EstimatorKind::Fkf => ChosenEstimator::Fkf(Box::new(FederatedKf::new(config))),
        }
    }

    /// Fixes the frame; later calls change nothing.
    pub fn set_origin(&mut self, origin: &FrameOrigin) {
        let origin = Geodetic::from_degrees(origin.lat_deg, origin.lon_deg, origin.height);
        whichever!(self, estimator => estimator.set_origin(origin));
    }

    /// Takes up from the last solution of an earlier run; `false` if it holds no valid state.
    pub fn resume(&mut self, solution: &Solution) -> bool {
        whichever!(self, estimator => estimator.resume(solution))
    }

    /// Tells a run that begins where the vehicle was before; see [`LastKnown`].
    pub fn remember(&mut self, last: &LastKnown) {
        whichever!(self, estimator => estimator.remember(last));
    }

    /// The trajectory given all that the window holds; see [`FgoEstimator::smooth`]. `None` of a filter, which keeps nothing.
    pub fn smooth(&mut self, max_passes: u32) -> Option<Smoothed> {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.smooth(max_passes),
            ChosenEstimator::Ekf(_) | ChosenEstimator::Fkf(_) => None,
        }
    }

    /// Where the vehicle was a window ago; see [`FgoEstimator::lagged`]. `None` of a filter.
    pub fn lagged(&self) -> Option<NavEstimate> {
        match self {
            ChosenEstimator::Fgo(fgo) => fgo.lagged(),
            ChosenEstimator::Ekf(_) | ChosenEstimator::Fkf(_) => None,
        }
    }

    /// Shows a smoothed trajectory at every IMU sample.
    pub fn along(&self, smoothed: &Smoothed, show: impl FnMut(&NavEstimate)) {
        if let ChosenEstimator::Fgo(fgo) = self {
            fgo.along(smoothed, show);
        }
    }

    /// What the newest keyframe holds.
    pub fn report(&self) -> &KeyframeReport {
        whichever!(self, estimator => estimator.report())
    }

    /// How much too late each [`shared_types::AIDING`] sensor's stamps are taken to be, and the sigmas of that, s.
    pub fn time_offsets(&self) -> ([f64; AIDING.len()], [f64; AIDING.len()]) {
        whichever!(self, estimator => estimator.time_offsets())
    }

    /// What each of [`CALIBRATIONS`] is found to be off by, and the sigmas of that; a filter does not ask.
    pub fn calibrations(&self) -> ([f64; CALIBRATIONS.len()], [f64; CALIBRATIONS.len()]) {
        match self {
            ChosenEstimator::Fgo(estimator) => estimator.calibrations(),
            _ => ([0.0; CALIBRATIONS.len()], [0.0; CALIBRATIONS.len()]),
        }
    }

    /// Used and refused measurements, in the order of [`shared_types::SENSORS`].
    pub fn counts(&self) -> &[SensorCounts] {
        whichever!(self, estimator => estimator.counts())
    }
}

impl Estimator for ChosenEstimator {
    fn ingest(&mut self, measurement: &Measurement, effort: Effort) -> Result<Option<Solution>, EstimatorError> {
        whichever!(self, estimator => estimator.ingest(measurement, effort))
    }
}
