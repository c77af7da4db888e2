//! The newest keyframe as the estimator sees it, with its covariance.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::header::Header;
use crate::layout::message;
use crate::reject::REJECT_REASONS;

/// What an estimator did with one sensor's measurements since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "ipc", derive(ZeroCopySend))]
#[repr(C)]
pub struct SensorCounts {
    /// Became factors.
    pub used: u64,
    /// Refused, by [`crate::RejectReason`].
    pub rejected: [u64; REJECT_REASONS.len()],
}

impl SensorCounts {
    /// All refusals.
    pub fn rejected_total(&self) -> u64 {
        self.rejected.iter().sum()
    }
}

/// How far the solution can be trusted, by what the solver met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum SolutionStatus {
    /// Converged.
    Converged = 0,
    /// The iteration limit came first; the state is the best found.
    NotConverged = 1,
    /// The step was damped or the matrix was mended; the state is the last good one moved by the IMU.
    Damped = 2,
    /// The ranges agreed with each other against the state: the last inertial increment was loosened to let them in.
    Loosened = 3,
    /// Several sensors contradict the inertial ones together: their biases are let loose, and the state is not to be trusted.
    Inconsistent = 4,
}

impl SolutionStatus {
    /// The status of that number, as it crosses the bus.
    pub fn from_index(index: u32) -> Option<SolutionStatus> {
        const ALL: [SolutionStatus; 5] = [
            SolutionStatus::Converged,
            SolutionStatus::NotConverged,
            SolutionStatus::Damped,
            SolutionStatus::Loosened,
            SolutionStatus::Inconsistent,
        ];
        ALL.get(index as usize).copied()
    }
}

message! {
    /// State and covariance at the newest keyframe.
    ///
    /// Error order of the covariance: position (ENU), velocity (ENU), attitude (body, right perturbation),
    /// accelerometer bias, gyroscope bias.
    Solution, "ilns.Solution.4", schema 4 {
        /// Sender, order and times; `t_valid` equals `t_keyframe`.
        header: Header,
        /// Counts solutions since the estimation began; estimates name it.
        id: u64,
        /// Data time of the keyframe, ns.
        t_keyframe: i64,
        /// Origin of the frame: latitude, longitude in degrees, ellipsoidal height in m.
        origin: [f64; 3],
        /// IMU position, m.
        position_enu: [f64; 3],
        /// Velocity, m/s.
        velocity_enu: [f64; 3],
        /// Body to ENU, Hamilton (w, x, y, z).
        q_enu_body: [f64; 4],
        /// Accelerometer bias, m/s².
        accel_bias: [f64; 3],
        /// Gyroscope bias, rad/s.
        gyro_bias: [f64; 3],
        /// Covariance of the 15 error coordinates.
        covariance: [[f64; 15]; 15],
        /// Data time of the newest used measurement per [`crate::AIDING`] sensor, ns; `i64::MIN` = never.
        t_last_used: [i64; 5],
        /// Per sensor, in the order of [`crate::SENSORS`].
        counts: [SensorCounts; 7],
        /// How much too late each [`crate::AIDING`] sensor's stamps are taken to be, s.
        time_offset: [f64; 5],
        /// 1-sigma of that, s; 0 while nothing speaks against the stamps, or nobody asks.
        time_offset_sigma: [f64; 5],
        /// What each of [`crate::CALIBRATIONS`] is found to be off by, in its SI unit.
        calibration: [f64; 2],
        /// 1-sigma of that; 0 while nothing speaks against the configured value, or nobody asks.
        calibration_sigma: [f64; 2],
        /// Half the robust sum of squares of the measurements in the window: about half of what they count.
        cost: f64,
        /// Keyframes in the window.
        keyframes: u32,
        /// Iterations of this solve.
        iterations: u32,
        /// States linearised in this solve.
        linearised: u32,
        /// [`SolutionStatus`] as a number.
        status: u32,
        /// CPU time of the solve, ns; stamped by the caller, 0 where nobody measured.
        solve_ns: u64,
    }
}

impl Solution {
    /// Of nothing: level at the origin, its covariance zero, no measurement ever used.
    pub fn empty() -> Solution {
        Solution {
            header: Header::default(),
            id: 0,
            t_keyframe: 0,
            origin: [0.0; 3],
            position_enu: [0.0; 3],
            velocity_enu: [0.0; 3],
            q_enu_body: [1.0, 0.0, 0.0, 0.0],
            accel_bias: [0.0; 3],
            gyro_bias: [0.0; 3],
            covariance: [[0.0; 15]; 15],
            t_last_used: [i64::MIN; 5],
            counts: [SensorCounts::default(); 7],
            time_offset: [0.0; 5],
            time_offset_sigma: [0.0; 5],
            calibration: [0.0; 2],
            calibration_sigma: [0.0; 2],
            cost: 0.0,
            keyframes: 0,
            iterations: 0,
            linearised: 0,
            status: 0,
            solve_ns: 0,
        }
    }
}
