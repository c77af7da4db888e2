//! What a perfect IMU feels: derived in inertial axes, from the motion alone.
//!
//! The inertial frame is taken to coincide with the Earth's axes (ECEF) at the instant; r is the position from the Earth's
//! centre, Ω the Earth's rate, all in those axes:
//!
//! ```text
//! r̈_inertial  = a + 2Ω×v + Ω×(Ω×r)                 r = r(t) seen from the turning Earth, v and a its derivatives there
//! gravitation = g + Ω×(Ω×r)                        the plumb line's g contains −Ω×(Ω×r), the centrifugal part
//! f           = R_body_ecef (r̈_inertial − gravitation)
//! ω_ib        = ω_eb + R_body_ecef Ω               ω_eb: rate of the body against the Earth, body axes
//! ```
//!
//! Gyroscope and accelerometer read instantaneous values at t.

use nalgebra::{Matrix3, Vector3};
use nav_geometry::wgs84::EARTH_RATE;
use nav_geometry::{Geodetic, GravityModel, LocalFrame};

use crate::trajectory::Motion;

/// The turning, attracting Earth around the scenario's origin.
#[derive(Clone, Debug)]
pub(crate) struct Earth {
    pub(crate) frame: LocalFrame,
    gravity: GravityModel,
    /// Columns: east, north, up of the origin in ECEF.
    r_ecef_enu: Matrix3<f64>,
}

/// A reading without errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TrueImu {
    /// rad/s.
    pub(crate) gyro_body: Vector3<f64>,
    /// m/s².
    pub(crate) accel_body: Vector3<f64>,
}

impl Earth {
    /// Around an origin given in degrees and m.
    pub(crate) fn around(origin_deg: [f64; 3]) -> Earth {
        let [lat_deg, lon_deg, height] = origin_deg;
        let origin = Geodetic::from_degrees(lat_deg, lon_deg, height);
        let frame = LocalFrame::new(origin);
        let (sin_lat, cos_lat) = origin.latitude.sin_cos();
        let (sin_lon, cos_lon) = origin.longitude.sin_cos();
        let up = Vector3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
        let east = Vector3::new(-sin_lon, cos_lon, 0.0);
        let r_ecef_enu = Matrix3::from_columns(&[east, up.cross(&east), up]);
        // Free air: the water's own attraction is left out, as the log format's golden data do.
        Earth { frame, gravity: GravityModel::new(frame, None), r_ecef_enu }
    }

    /// What a perfect IMU feels in that motion.
    pub(crate) fn imu(&self, motion: &Motion) -> TrueImu {
        let earth_rate = Vector3::z() * EARTH_RATE;
        let position_ecef = self.frame.to_ecef(&motion.position_enu);
        let velocity_ecef = self.r_ecef_enu * motion.velocity_enu;
        let acceleration_ecef = self.r_ecef_enu * motion.acceleration_enu;
        let centripetal = earth_rate.cross(&earth_rate.cross(&position_ecef));
        let acceleration_inertial = acceleration_ecef + 2.0 * earth_rate.cross(&velocity_ecef) + centripetal;
        let gravitation = self.gravitation_ecef(&motion.position_enu, &position_ecef);
        let r_body_ecef = (self.r_ecef_enu * motion.r_enu_body.matrix()).transpose();
        TrueImu {
            gyro_body: motion.rate_enu_body + r_body_ecef * earth_rate,
            accel_body: r_body_ecef * (acceleration_inertial - gravitation),
        }
    }

    /// Attraction of the Earth's mass alone, ECEF axes, m/s².
    fn gravitation_ecef(&self, position_enu: &Vector3<f64>, position_ecef: &Vector3<f64>) -> Vector3<f64> {
        let earth_rate = Vector3::z() * EARTH_RATE;
        self.r_ecef_enu * self.gravity.at(position_enu) + earth_rate.cross(&earth_rate.cross(position_ecef))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn at_rest_and_level_the_accelerometer_feels_gravity_upwards_and_the_gyroscope_the_earth() {
        let earth = Earth::around([36.38, 127.36, 0.0]);
        let still = Motion {
            position_enu: Vector3::zeros(),
            velocity_enu: Vector3::zeros(),
            acceleration_enu: Vector3::zeros(),
            r_enu_body: Rotation3::identity(),
            rate_enu_body: Vector3::zeros(),
        };
        let imu = earth.imu(&still);
        let gravity = nav_geometry::normal_gravity(36.38_f64.to_radians(), 0.0);
        // The vertical of a point found through ECEF is good to 3e-13 rad.
        assert!((imu.accel_body - Vector3::z() * gravity).norm() < 1e-11, "{}", imu.accel_body);
        let latitude = 36.38_f64.to_radians();
        let expected = Vector3::new(0.0, latitude.cos(), latitude.sin()) * EARTH_RATE;
        assert!((imu.gyro_body - expected).norm() < 1e-18, "{}", imu.gyro_body);
    }

    #[test]
    fn a_body_that_rests_in_inertial_space_and_falls_freely_feels_nothing() {
        // Seen from the Earth it moves with −Ω×r and accelerates with −2Ω×v − Ω×(Ω×r) + gravitation = −2Ω×v + g.
        let earth = Earth::around([36.38, 127.36, 0.0]);
        let rate_enu = earth.frame.earth_rate_enu();
        let centre_enu = earth.r_ecef_enu.tr_mul(&earth.frame.to_ecef(&Vector3::zeros()));
        let velocity_enu = -rate_enu.cross(&centre_enu);
        let falling = Motion {
            position_enu: Vector3::zeros(),
            velocity_enu,
            acceleration_enu: earth.gravity.at(&Vector3::zeros()) - 2.0 * rate_enu.cross(&velocity_enu),
            r_enu_body: Rotation3::identity(),
            rate_enu_body: -rate_enu,
        };
        let imu = earth.imu(&falling);
        assert!(imu.accel_body.norm() < 1e-14 && imu.gyro_body.norm() < 1e-18, "{imu:?}");
    }
}
