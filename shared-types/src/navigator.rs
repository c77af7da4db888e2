//! Choices of the navigator: estimator, window, kernels, gates. Facts of the vehicle stand in `vehicle.rs`.
//!
//! `navigator/sections.rs` has every key as the file says it, with its default and the reason for that; `navigator/checks.rs` makes one
//! of the other. `ilns run --print-config` shows the effective whole.

mod checks;
mod sections;

use serde::{Deserialize, Serialize};

use crate::sensor::Sensor;
use crate::time::Duration;

pub(crate) use sections::Sections;

/// Checked choices, SI units.
#[derive(Clone, Debug, PartialEq)]
pub struct Navigator {
    /// Which estimator runs.
    pub estimator: EstimatorKind,
    /// The sliding window.
    pub fgo: FgoConfig,
    /// The filters.
    pub kalman: KalmanConfig,
    /// When keyframes are made and how readings are tied to them.
    pub keyframes: KeyframeConfig,
    /// What counts as an IMU sample.
    pub imu: ImuGateConfig,
    /// The aiding sensors, in the order of [`crate::AIDING`].
    pub sensors: [SensorConfig; 5],
    /// 1-sigma of the offset common to all ranges of an epoch, m: 0 = raw ranges, infinite = differences.
    pub lbl_common_offset_sigma: f64,
    /// Ranges beyond are refused, m.
    pub lbl_max_range: f64,
    /// A drifting buoy's position is held this long.
    pub buoy_max_age: Duration,
    /// Satellite fixes are refused while the vehicle is deeper, m.
    pub gnss_max_depth: f64,
    /// Velocities beyond are refused, m/s.
    pub dvl_max_speed: f64,
    /// Depths beyond are refused, m.
    pub ps_max_depth: f64,
    /// Water's own attraction weakens the gravity gradient below the surface (§0 of the method).
    pub gravity_in_water: bool,
    /// Model the Earth's rotation; off only for comparisons.
    pub earth_rotation: bool,
    /// The published estimate.
    pub propagator: PropagatorConfig,
}

/// Estimators by name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EstimatorKind {
    /// Sliding-window factor graph.
    Fgo,
    /// Error-state extended Kalman filter.
    Ekf,
    /// Federated Kalman filter: one local filter a sensor.
    Fkf,
}

impl EstimatorKind {
    /// The word in configuration and tables.
    pub const fn name(self) -> &'static str {
        match self {
            EstimatorKind::Fgo => "fgo",
            EstimatorKind::Ekf => "ekf",
            EstimatorKind::Fkf => "fkf",
        }
    }

    /// Whether it takes each reading at the reading's own time, so that none is tied to a keyframe.
    pub const fn is_filter(self) -> bool {
        matches!(self, EstimatorKind::Ekf | EstimatorKind::Fkf)
    }
}

/// How a reading off the keyframes is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AnchorMethod {
    /// Position-focused: as if it had been taken at the keyframe. For comparison only.
    Pf,
    /// Forward preintegration from the keyframe before it.
    Fpf,
    /// Forward or backward preintegration from the nearer keyframe.
    Fbpf,
    /// Forward preintegration from the keyframe before it, as one factor with the samples of that interval: what both owe
    /// to the same IMU noise is counted once (§3.8 of the method). Time offsets are not estimated then. Chosen by itself where
    /// the IMU is so noisy that a Doppler velocity would be lost on the way to a keyframe.
    Joint,
    /// To none: passed on at once. What filters ask for, and they alone.
    AtOnce,
}

impl AnchorMethod {
    /// The word in configuration.
    pub const fn name(self) -> &'static str {
        match self {
            AnchorMethod::Pf => "pf",
            AnchorMethod::Fpf => "fpf",
            AnchorMethod::Fbpf => "fbpf",
            AnchorMethod::Joint => "joint",
            AnchorMethod::AtOnce => "at_once",
        }
    }
}

/// Robust kernel of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kernel {
    /// Least squares.
    None,
    /// weight min(1, k/√s), s the squared whitened norm.
    Huber(f64),
    /// weight 1/(1 + s/c²).
    Cauchy(f64),
    /// Cauchy of this width, narrowed to 1 while the share of improbable innovations is high (§4.2).
    AdaptiveCauchy(f64),
}

/// Whether a sensor's stamps are believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TimeOffset {
    /// They are.
    Off,
    /// They are too late by this much, s.
    Fixed(f64),
    /// That is the first guess, s; what the motion shows is taken instead.
    Estimated(f64),
}

impl TimeOffset {
    /// The same without estimating it.
    #[must_use]
    pub fn as_given(self) -> TimeOffset {
        match self {
            TimeOffset::Estimated(first) if first != 0.0 => TimeOffset::Fixed(first),
            TimeOffset::Estimated(_) => TimeOffset::Off,
            given => given,
        }
    }
}

/// The sliding window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FgoConfig {
    /// IMU intervals in the window (keyframes − 1), 2 to 500.
    pub window: usize,
    /// Passes per keyframe at most.
    pub max_iterations: usize,
    /// First-estimates Jacobians of the state that carries the prior.
    pub fej: bool,
    /// Whether each keyframe is shown once more as it leaves the window.
    pub fixed_lag: bool,
}

/// The Kalman filters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KalmanConfig {
    /// Linearisations per update: 1 is the extended filter, more the iterated one.
    pub iterations: usize,
    /// How far back a late reading is still taken up, by rolling back.
    pub horizon: Duration,
    /// Federated: whether the local filters begin anew from the fused state after each fusion.
    pub reset: bool,
    /// Federated: what share of the information each aiding sensor's local filter gets, in the order of [`crate::AIDING`], in
    /// proportion to each other.
    pub shares: [f64; 5],
}

/// When keyframes are made and how readings are tied to them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyframeConfig {
    /// Age of the last keyframe at which one is made without a ping.
    pub max_age: Duration,
    /// No two keyframes are closer.
    pub min_spacing: Duration,
    /// How readings are tied.
    pub anchor: AnchorMethod,
    /// Readings wait this much of data time for those of other sensors, so that the order of arrival does not matter.
    pub settle: Duration,
}

/// What counts as an IMU sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuGateConfig {
    /// Largest rate of an axis, rad/s.
    pub max_rate: f64,
    /// Largest specific force of an axis, m/s².
    pub max_accel: f64,
    /// A longer step between samples is a gap: reported, bridged with inflated noise.
    pub gap: Duration,
    /// A longer one ends the interval with a keyframe.
    pub long_gap: Duration,
}

/// One aiding sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorConfig {
    /// Off: its readings are counted and not used.
    pub enabled: bool,
    /// Robust kernel.
    pub kernel: Kernel,
    /// Chi-square gate on the innovation, 99.9 %.
    pub gate: bool,
    /// How late its stamps are.
    pub time_offset: TimeOffset,
    /// Whether its [`crate::Calibration`]s are looked for.
    pub calibrate: bool,
}

/// The published estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PropagatorConfig {
    /// Without LBL or GNSS for longer the mode is DEAD_RECKONING.
    pub position_timeout: Duration,
    /// An aiding sensor that was used and then is missing for longer makes the mode DEGRADED.
    pub aiding_timeout: Duration,
    /// A solution older than this makes the mode DEGRADED.
    pub solution_timeout: Duration,
    /// A horizontal 1-sigma beyond this makes the mode INVALID, m.
    pub max_position_sigma: f64,
}

impl Navigator {
    /// Configuration of an aiding sensor; IMU and buoys have none.
    pub fn sensor(&self, sensor: Sensor) -> Option<&SensorConfig> {
        crate::AIDING.iter().position(|&aiding| aiding == sensor).map(|index| &self.sensors[index])
    }

    /// Whether readings of this sensor are used. IMU and buoys always are.
    pub fn is_enabled(&self, sensor: Sensor) -> bool {
        self.sensor(sensor).is_none_or(|config| config.enabled)
    }
}
impl Default for Navigator {
    fn default() -> Self {
        Navigator::try_from(&Sections::default()).expect("the documented defaults are valid")
    }
}
