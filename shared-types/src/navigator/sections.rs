//! The file's shape: every key of `navigator.toml` with its default, which stands beside its reason.

use serde::{Deserialize, Serialize};

use super::{AnchorMethod, EstimatorKind};
use crate::vehicle::Vehicle;

/// The file's shape.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Sections {
    pub(super) estimator: EstimatorKind,
    pub(super) fgo: FgoSection,
    pub(super) kalman: KalmanSection,
    pub(super) keyframes: KeyframeSection,
    pub(super) imu: ImuSection,
    pub(super) lbl: LblSection,
    pub(super) buoys: BuoysSection,
    pub(super) gnss: GnssSection,
    pub(super) dvl: DvlSection,
    pub(super) mcp: McpSection,
    pub(super) ps: PsSection,
    pub(super) world: WorldSection,
    pub(super) propagator: PropagatorSection,
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
        pub(super) struct $name { $( $(#[doc = $reason])* pub(super) $field: $type, )* }
        impl Default for $name {
            fn default() -> Self { $name { $( $field: $default, )* } }
        }
    };
}

/// Kernel names in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum KernelName {
    None,
    Huber,
    Cauchy,
    AdaptiveCauchy,
}

/// What is asked of a sensor's time offset, in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum TimeOffsetName {
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
    /// A wrong sound speed is found where the geometry shows it; one that is right pays nothing for that.
    calibrate: bool = true;
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
    /// A scale that is off from the start is found; but a lock on a layer that moves along may be taken for an error of the
    /// scale, and is then not survived as well.
    calibrate: bool = false;
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
