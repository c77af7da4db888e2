//! Where the vehicle is, at IMU rate.

#[cfg(feature = "ipc")]
use iceoryx2::prelude::ZeroCopySend;

use crate::header::Header;
use crate::layout::message;

/// What the estimate may be trusted for. Ordered from the start of a run to its worst.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u32)]
pub enum Mode {
    /// No solution yet.
    Initialising = 0,
    /// Position aiding is current.
    Ok = 1,
    /// It goes on, but not as asked: an aiding sensor is missing, a solve was damped or skipped, the IMU had a gap.
    Degraded = 2,
    /// No position aiding: the error grows as the covariance says.
    DeadReckoning = 3,
    /// Do not steer by it: no IMU data, or no solution for too long.
    Invalid = 4,
}

impl Mode {
    /// Every mode in the order of its number.
    pub const ALL: [Mode; 5] = [Mode::Initialising, Mode::Ok, Mode::Degraded, Mode::DeadReckoning, Mode::Invalid];

    /// The word on screens and in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Mode::Initialising => "INITIALISING",
            Mode::Ok => "OK",
            Mode::Degraded => "DEGRADED",
            Mode::DeadReckoning => "DEAD_RECKONING",
            Mode::Invalid => "INVALID",
        }
    }

    /// The mode of that number, as it crosses the bus.
    pub fn from_index(index: u32) -> Option<Mode> {
        Mode::ALL.get(index as usize).copied()
    }
}

impl core::fmt::Display for Mode {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.pad(self.name())
    }
}

message! {
    /// The published estimate.
    NavEstimate, "ilns.NavEstimate.1", schema 1 {
        /// Sender, order and times; `t_valid` is that of the IMU sample, `origin_*` name it.
        header: Header,
        /// `id` of the solution that it stands on: with the IMU samples since, it is reproduced exactly.
        solution: u64,
        /// Keyframe of that solution, data time in ns.
        t_keyframe: i64,
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
        /// Covariance of position, m²: ee, en, eu, nn, nu, uu.
        position_cov: [f64; 6],
        /// Covariance of velocity, m²/s²: same order.
        velocity_cov: [f64; 6],
        /// Covariance of attitude, rad², small rotations about body x, y, z: same order.
        attitude_cov: [f64; 6],
        /// 1-sigma of attitude about body x, body y and the up axis, rad.
        sigma_rpy: [f64; 3],
        /// Latitude, longitude in degrees, ellipsoidal height in m.
        lat_lon_h: [f64; 3],
        /// Age of the newest used measurement per [`crate::AIDING`] sensor, s; infinite = never.
        aiding_age: [f64; 5],
        /// [`Mode`] as a number.
        mode: u32,
        /// Reserved, 0: keeps the size a multiple of eight.
        reserved: u32,
    }
}

impl NavEstimate {
    /// The mode; an unknown number counts as [`Mode::Invalid`].
    pub fn mode(&self) -> Mode {
        Mode::from_index(self.mode).unwrap_or(Mode::Invalid)
    }
}
