//! Values for tests.

use shared_types::{Header, Mode, NavEstimate, Time};

/// A good estimate at (1, 2, 3) m with sigmas of a metre.
pub(crate) fn estimate(t: f64) -> NavEstimate {
    let unit_cov = [1.0, 0.0, 0.0, 1.0, 0.0, 1.0];
    NavEstimate {
        header: Header::at(Time::from_seconds(t)),
        solution: 5,
        t_keyframe: 0,
        position_enu: [1.0, 2.0, 3.0],
        velocity_enu: [0.5, 0.0, 0.0],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: unit_cov,
        velocity_cov: unit_cov,
        attitude_cov: unit_cov,
        sigma_rpy: [0.1; 3],
        lat_lon_h: [36.0, 127.0, 0.0],
        aiding_age: [f64::INFINITY; 5],
        mode: Mode::Ok as u32,
        reserved: 0,
    }
}
