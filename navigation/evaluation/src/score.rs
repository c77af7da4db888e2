//! The figures of a run.

use serde::Serialize;
use shared_types::Time;

/// The part of a run that is scored; both ends belong to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// From here.
    pub from: Time,
    /// To here.
    pub to: Time,
}

impl Default for Window {
    /// Everything.
    fn default() -> Self {
        Window { from: Time::MIN, to: Time::MAX }
    }
}

impl Window {
    pub(crate) fn holds(&self, t: Time) -> bool {
        self.from <= t && t <= self.to
    }
}

/// Error statistics of a run: estimate − truth at the times of the truth.
///
/// Attitude errors are small rotations, q_estimate = q_truth ⊗ Exp(δθ): about body x, body y, and R·δθ about the up axis, as
/// `sroll, spitch, syaw` have them. `None` (in JSON `null`): the truth or the estimate does not report the quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Score {
    /// Truth rows that met an estimate.
    pub samples: u64,
    /// Truth rows between the first and the last estimate that met none: in a gap of the estimates.
    pub missed: u64,
    /// First and last pair, s of data time.
    pub t_first_s: f64,
    /// Last pair.
    pub t_last_s: f64,
    /// Between them, s.
    pub duration_s: f64,
    /// Path of the truth between the pairs, m.
    pub distance_m: f64,
    /// RMS of position per axis, m.
    pub rms_enu: [f64; 3],
    /// RMS of the horizontal position error, m: √(e² + n²).
    pub rms_horizontal: f64,
    /// RMS of the position error in space, m.
    pub rms_3d: f64,
    /// Largest position error per axis, m.
    pub max_enu: [f64; 3],
    /// Largest horizontal position error, m.
    pub max_horizontal: f64,
    /// RMS of velocity per axis, m/s.
    pub velocity_rms_enu: Option<[f64; 3]>,
    /// RMS of attitude about body x, body y, up, degrees.
    pub attitude_rms_deg: Option<[f64; 3]>,
    /// Largest attitude error about body x, body y, up, degrees.
    pub attitude_max_deg: Option<[f64; 3]>,
    /// Mean of (error/sigma)² of position per axis; 1 when the sigmas are honest.
    pub nees_enu: Option<[f64; 3]>,
    /// Mean of the sum of the three, correlations left out; 3 when the sigmas are honest.
    pub nees_position: Option<f64>,
    /// Mean of (error/sigma)² of velocity per axis.
    pub nees_velocity_enu: Option<[f64; 3]>,
    /// Mean of (error/sigma)² of attitude per axis.
    pub nees_attitude: Option<[f64; 3]>,
    /// Share of position errors within three sigmas, per axis.
    pub three_sigma_share_enu: Option<[f64; 3]>,
    /// Share of velocity errors within three sigmas, per axis.
    pub three_sigma_share_velocity_enu: Option<[f64; 3]>,
    /// Share of attitude errors within three sigmas, per axis.
    pub three_sigma_share_attitude: Option<[f64; 3]>,
    /// RMS position error in space after the best rigid motion, m: the trajectory's shape alone.
    pub ate_aligned: f64,
    /// Position error of the last pair, m.
    pub final_error_enu: [f64; 3],
    /// 1-sigma of the last pair, m.
    pub final_sigma_enu: [f64; 3],
}
