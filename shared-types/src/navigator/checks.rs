//! From the file's keys to checked choices; a complaint names the key, what it says and what it may say.

use super::sections::{KalmanSection, KernelName, Sections, TimeOffsetName};
use super::{
    AnchorMethod, FgoConfig, ImuGateConfig, KalmanConfig, Kernel, KeyframeConfig, Navigator, PropagatorConfig,
    SensorConfig, TimeOffset,
};
use crate::config::{Problem, non_negative, positive};
use crate::time::Duration;

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
    calibrate: bool,
}

/// The sensor's keys out of its section.
macro_rules! sensor_keys {
    ($name:literal, $section:expr, $calibrate:expr) => {
        SensorKeys {
            names: [concat!($name, ".kernel_width"), concat!($name, ".time_offset_value")],
            enabled: $section.enabled,
            kernel: $section.kernel,
            width: $section.kernel_width,
            gate: $section.gate,
            time_offset: $section.time_offset,
            value: $section.time_offset_value,
            calibrate: $calibrate,
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
    Ok(SensorConfig { enabled: keys.enabled, kernel, gate: keys.gate, time_offset, calibrate: keys.calibrate })
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
                sensor(&sensor_keys!("lbl", file.lbl, file.lbl.calibrate))?,
                sensor(&sensor_keys!("gnss", file.gnss, false))?,
                sensor(&sensor_keys!("dvl", file.dvl, file.dvl.calibrate))?,
                sensor(&sensor_keys!("mcp", file.mcp, false))?,
                sensor(&sensor_keys!("ps", file.ps, false))?,
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
