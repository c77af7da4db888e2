//! Choices of the navigator: estimator, window, kernels, gates. Facts of the vehicle stand in `vehicle.rs`.
//!
//! Every key has its default here, beside its reason; `ilns run --print-config` shows the effective whole.

use serde::{Deserialize, Serialize};

use crate::config::{Problem, non_negative, positive};
use crate::sensor::Sensor;
use crate::time::Duration;
use crate::vehicle::Vehicle;

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

/// The file's shape.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Sections {
    estimator: EstimatorKind,
    fgo: FgoSection,
    kalman: KalmanSection,
    keyframes: KeyframeSection,
    imu: ImuSection,
    lbl: LblSection,
    buoys: BuoysSection,
    gnss: GnssSection,
    dvl: DvlSection,
    mcp: McpSection,
    ps: PsSection,
    world: WorldSection,
    propagator: PropagatorSection,
}

impl Default for Sections {
    fn default() -> Self {
        Sections {
            estimator: EstimatorKind::Fgo,
            fgo: FgoSection::default(),
            kalman: KalmanSection::default(),
            keyframes: KeyframeSection::default(),
            imu: ImuSection::default(),
            lbl: LblSection::default(),
            buoys: BuoysSection::default(),
            gnss: GnssSection::default(),
            dvl: DvlSection::default(),
            mcp: McpSection::default(),
            ps: PsSection::default(),
            world: WorldSection::default(),
            propagator: PropagatorSection::default(),
        }
    }
}

/// A section with its defaults: `field: type = default;`, each with the reason.
macro_rules! section {
    ($name:ident { $( $(#[doc = $reason:literal])* $field:ident : $type:ty = $default:expr; )* }) => {
        #[derive(Clone, Debug, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        struct $name { $( $(#[doc = $reason])* $field: $type, )* }
        impl Default for $name {
            fn default() -> Self { $name { $( $field: $default, )* } }
        }
    };
}

/// Kernel names in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum KernelName {
    None,
    Huber,
    Cauchy,
    AdaptiveCauchy,
}

/// What is asked of a sensor's time offset, in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum TimeOffsetName {
    Off,
    Fixed,
    Estimated,
}

section!(FgoSection {
    /// The paper's SW = 20.
    window: usize = 20;
    /// One pass is the rule (§4.3); more are for starts and surprises.
    max_iterations: usize = 4;
    /// Consistent through outages (§4.3).
    fej: bool = true;
    /// `estimate_lagged.csv` and the channel `nav/lagged`: each keyframe once more, a window later.
    fixed_lag: bool = false;
});
section!(KalmanSection {
    /// One is the usual filter; more linearisations are for comparison, and for starts far off.
    iterations: usize = 1;
    /// As long as the smoother's window: s.
    horizon: f64 = 20.0;
    /// With it a federated filter is the centralised one; without, its locals stand apart.
    reset: bool = true;
    /// Equal shares, as in the literature.
    share_lbl: f64 = 1.0;
    share_gnss: f64 = 1.0;
    share_dvl: f64 = 1.0;
    share_mcp: f64 = 1.0;
    share_ps: f64 = 1.0;
});
section!(KeyframeSection {
    /// 1.25 times the expected LBL period of 1 s: a timer of the period itself races the ping (§4.1).
    max_age: f64 = 1.25;
    /// An LBL epoch closer than that to a keyframe is tied to it (§4.1).
    min_spacing: f64 = 0.2;
    /// The paper's contribution, and the only unbiased choice.
    anchor: AnchorMethod = AnchorMethod::Fbpf;
    /// Longer than the spread of arrival of sensors that are valid at one instant, short beside a second.
    settle: f64 = 0.05;
});
section!(ImuSection {
    /// 2000 deg/s: full scale of the usual instruments.
    max_rate: f64 = 35.0;
    /// 16 g, likewise.
    max_accel: f64 = 157.0;
    /// Two periods of a 100 Hz instrument.
    gap: f64 = 0.02;
    /// Beyond half a second a straight line between two samples says nothing (§5).
    long_gap: f64 = 0.5;
});
section!(LblSection {
    enabled: bool = true;
    kernel: KernelName = KernelName::Cauchy;
    /// Chosen over four hostile seeds (§4.2).
    kernel_width: f64 = 2.0;
    gate: bool = true;
    /// How late its stamps are is found where the motion shows it; one that is right pays nothing for that.
    time_offset: TimeOffsetName = TimeOffsetName::Estimated;
    /// The fixed value, or the first guess, s.
    time_offset_value: f64 = 0.0;
    /// 0: raw ranges; `inf`: differences as in the paper.
    common_offset_sigma: f64 = 0.0;
    /// Beyond the reach of acoustic positioning.
    max_range: f64 = 15000.0;
});
section!(BuoysSection {
    /// Of the log format.
    max_age: f64 = 30.0;
});
section!(GnssSection {
    enabled: bool = true;
    /// Fixes that are wrong for a while, by multipath at surfacing or by spoofing, lose all weight beside ranges and
    /// velocities; under Huber each pulls for ever (20 m for 15 s: 8 times the error, against 1.06).
    kernel: KernelName = KernelName::Cauchy;
    kernel_width: f64 = 2.385;
    /// A 99.9 % gate refused a quarter of good fixes when other stamps were late (§4.2).
    gate: bool = false;
    time_offset: TimeOffsetName = TimeOffsetName::Estimated;
    time_offset_value: f64 = 0.0;
    /// An antenna that deep hears nothing; the fix is an error.
    max_depth: f64 = 2.0;
});
section!(DvlSection {
    enabled: bool = true;
    kernel: KernelName = KernelName::AdaptiveCauchy;
    kernel_width: f64 = 2.385;
    gate: bool = true;
    time_offset: TimeOffsetName = TimeOffsetName::Estimated;
    time_offset_value: f64 = 0.0;
    /// Faster than instruments measure; high enough for a car's odometer.
    max_speed: f64 = 60.0;
});
section!(McpSection {
    enabled: bool = true;
    /// A magnetic disturbance lasts: 20 deg for a minute under Huber make 21 times the error, against 1.04.
    kernel: KernelName = KernelName::Cauchy;
    kernel_width: f64 = 2.385;
    gate: bool = false;
    time_offset: TimeOffsetName = TimeOffsetName::Estimated;
    time_offset_value: f64 = 0.0;
});
section!(PsSection {
    enabled: bool = true;
    kernel: KernelName = KernelName::Huber;
    kernel_width: f64 = 1.345;
    /// A port that leaps, clogs or feels waves is off by what Huber lets pull for ever; where velocities or fixes agree with the
    /// state it is refused, and the height held by those.
    gate: bool = true;
    time_offset: TimeOffsetName = TimeOffsetName::Estimated;
    time_offset_value: f64 = 0.0;
    /// Full ocean depth.
    max_depth: f64 = 12000.0;
});
section!(WorldSection {
    /// Free air is what logs are simulated with; on for real dives below some 300 m (§0).
    gravity_in_water: bool = false;
    earth_rotation: bool = true;
});
section!(PropagatorSection {
    /// Three LBL periods.
    position_timeout: f64 = 2.5;
    aiding_timeout: f64 = 3.0;
    solution_timeout: f64 = 3.0;
    /// Wider than any use of the position.
    max_position_sigma: f64 = 1.0e4;
});

fn seconds(key: &'static str, value: f64) -> Result<Duration, Problem> {
    Ok(Duration::from_seconds(positive(key, value)?))
}

/// The keys that every sensor's section has, as the file says them.
struct SensorKeys {
    /// Names for a complaint: of the kernel's width and of the offset's value.
    names: [&'static str; 2],
    enabled: bool,
    kernel: KernelName,
    width: f64,
    gate: bool,
    time_offset: TimeOffsetName,
    value: f64,
}

/// The sensor's keys out of its section.
macro_rules! sensor_keys {
    ($name:literal, $section:expr) => {
        SensorKeys {
            names: [concat!($name, ".kernel_width"), concat!($name, ".time_offset_value")],
            enabled: $section.enabled,
            kernel: $section.kernel,
            width: $section.kernel_width,
            gate: $section.gate,
            time_offset: $section.time_offset,
            value: $section.time_offset_value,
        }
    };
}

fn sensor(keys: &SensorKeys) -> Result<SensorConfig, Problem> {
    /// Beyond that a stamp is not late but of another clock, s.
    const LARGEST_OFFSET: f64 = 1.0;
    let width = positive(keys.names[0], keys.width)?;
    let kernel = match keys.kernel {
        KernelName::None => Kernel::None,
        KernelName::Huber => Kernel::Huber(width),
        KernelName::Cauchy => Kernel::Cauchy(width),
        KernelName::AdaptiveCauchy => Kernel::AdaptiveCauchy(width),
    };
    let value = keys.value;
    if value.is_nan() || value.abs() > LARGEST_OFFSET {
        return Err(Problem::new(keys.names[1], format!("{value} s"), "-1 to 1 s"));
    }
    let time_offset = match keys.time_offset {
        TimeOffsetName::Off => TimeOffset::Off,
        TimeOffsetName::Fixed => TimeOffset::Fixed(value),
        TimeOffsetName::Estimated => TimeOffset::Estimated(value),
    };
    Ok(SensorConfig { enabled: keys.enabled, kernel, gate: keys.gate, time_offset })
}

fn kalman(section: &KalmanSection) -> Result<KalmanConfig, Problem> {
    if !(1..=20).contains(&section.iterations) {
        return Err(Problem::new("kalman.iterations", section.iterations.to_string(), "1 to 20"));
    }
    let horizon = seconds("kalman.horizon", section.horizon)?;
    if horizon > Duration::from_seconds(600.0) {
        return Err(Problem::new("kalman.horizon", format!("{} s", section.horizon), "at most 600 s"));
    }
    Ok(KalmanConfig {
        iterations: section.iterations,
        horizon,
        reset: section.reset,
        shares: [
            positive("kalman.share_lbl", section.share_lbl)?,
            positive("kalman.share_gnss", section.share_gnss)?,
            positive("kalman.share_dvl", section.share_dvl)?,
            positive("kalman.share_mcp", section.share_mcp)?,
            positive("kalman.share_ps", section.share_ps)?,
        ],
    })
}

impl Sections {
    /// Fills in how readings are tied where that was left open. A filter ties none to a keyframe. Nor should a smoother one by
    /// one where the samples in between would drown it: over a quarter of the keyframes' distance, the mean way to the
    /// nearer one, an IMU may be noisier than the Doppler log.
    pub(crate) fn settle(&mut self, vehicle: &Vehicle, is_anchor_given: bool) {
        let on_the_way = vehicle.imu.accel_noise_density * (0.25 * self.keyframes.max_age).sqrt();
        if self.estimator.is_filter() {
            if self.keyframes.anchor == AnchorMethod::Fbpf {
                self.keyframes.anchor = AnchorMethod::AtOnce;
            }
        } else if !is_anchor_given && self.dvl.enabled && on_the_way > vehicle.dvl.sigma {
            self.keyframes.anchor = AnchorMethod::Joint;
        }
    }
}

impl TryFrom<&Sections> for Navigator {
    type Error = Problem;

    fn try_from(file: &Sections) -> Result<Navigator, Problem> {
        if !(2..=500).contains(&file.fgo.window) {
            return Err(Problem::new("fgo.window", file.fgo.window.to_string(), "2 to 500 keyframe intervals"));
        }
        if !(1..=100).contains(&file.fgo.max_iterations) {
            return Err(Problem::new("fgo.max_iterations", file.fgo.max_iterations.to_string(), "1 to 100"));
        }
        if file.estimator.is_filter() != (file.keyframes.anchor == AnchorMethod::AtOnce) {
            let expected = if file.estimator.is_filter() {
                "at_once with a filter, which takes each reading at its own time (leave it out)"
            } else {
                "fbpf, joint, fpf or pf with estimator fgo"
            };
            return Err(Problem::new("keyframes.anchor", file.keyframes.anchor.name().to_owned(), expected));
        }
        let keyframes = KeyframeConfig {
            max_age: seconds("keyframes.max_age", file.keyframes.max_age)?,
            min_spacing: seconds("keyframes.min_spacing", file.keyframes.min_spacing)?,
            anchor: file.keyframes.anchor,
            settle: Duration::from_seconds(non_negative("keyframes.settle", file.keyframes.settle)?),
        };
        if keyframes.min_spacing >= keyframes.max_age {
            return Err(Problem::new(
                "keyframes.min_spacing",
                format!("{} s", file.keyframes.min_spacing),
                "less than `keyframes.max_age`",
            ));
        }
        if keyframes.max_age > Duration::from_seconds(5.0) {
            return Err(Problem::new(
                "keyframes.max_age",
                format!("{} s", file.keyframes.max_age),
                "at most 5 s: an interval's samples are kept whole",
            ));
        }
        // Infinity is meant here: it asks for range differences.
        let offset = file.lbl.common_offset_sigma;
        if offset.is_nan() || offset < 0.0 {
            return Err(Problem::new(
                "lbl.common_offset_sigma",
                offset.to_string(),
                "0, a positive number of m, or inf",
            ));
        }
        Ok(Navigator {
            estimator: file.estimator,
            fgo: FgoConfig {
                window: file.fgo.window,
                max_iterations: file.fgo.max_iterations,
                fej: file.fgo.fej,
                fixed_lag: file.fgo.fixed_lag,
            },
            kalman: kalman(&file.kalman)?,
            keyframes,
            imu: ImuGateConfig {
                max_rate: positive("imu.max_rate", file.imu.max_rate)?,
                max_accel: positive("imu.max_accel", file.imu.max_accel)?,
                gap: seconds("imu.gap", file.imu.gap)?,
                long_gap: seconds("imu.long_gap", file.imu.long_gap)?,
            },
            sensors: [
                sensor(&sensor_keys!("lbl", file.lbl))?,
                sensor(&sensor_keys!("gnss", file.gnss))?,
                sensor(&sensor_keys!("dvl", file.dvl))?,
                sensor(&sensor_keys!("mcp", file.mcp))?,
                sensor(&sensor_keys!("ps", file.ps))?,
            ],
            lbl_common_offset_sigma: offset,
            lbl_max_range: positive("lbl.max_range", file.lbl.max_range)?,
            buoy_max_age: seconds("buoys.max_age", file.buoys.max_age)?,
            gnss_max_depth: positive("gnss.max_depth", file.gnss.max_depth)?,
            dvl_max_speed: positive("dvl.max_speed", file.dvl.max_speed)?,
            ps_max_depth: positive("ps.max_depth", file.ps.max_depth)?,
            gravity_in_water: file.world.gravity_in_water,
            earth_rotation: file.world.earth_rotation,
            propagator: PropagatorConfig {
                position_timeout: seconds("propagator.position_timeout", file.propagator.position_timeout)?,
                aiding_timeout: seconds("propagator.aiding_timeout", file.propagator.aiding_timeout)?,
                solution_timeout: seconds("propagator.solution_timeout", file.propagator.solution_timeout)?,
                max_position_sigma: positive("propagator.max_position_sigma", file.propagator.max_position_sigma)?,
            },
        })
    }
}

impl Default for Navigator {
    fn default() -> Self {
        Navigator::try_from(&Sections::default()).expect("the documented defaults are valid")
    }
}
