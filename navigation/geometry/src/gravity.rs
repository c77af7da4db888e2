//! Normal gravity of WGS-84 at a position.
//!
//! ```text
//! g(p) = −γ(φ, h)·up(p)
//! γ(φ, 0) = γ_e (1 + k s²)/√(1 − e²s²),  s = sin φ                       (Somigliana)
//! γ(φ, h) = γ(φ, 0)[1 − (2/a)(1 + f + m − 2f s²)h + 3h²/a²]
//! ```
//!
//! It is the gravity that a plumb line feels: the centrifugal part is in it. A constant vector would be wrong by
//! 1.5e-3 m/s² one kilometre from the origin (the vertical tilts), more than a good accelerometer's bias. Below the
//! water surface the attraction of the water above weakens the gradient by 4πGρ: an option.

use nalgebra::Vector3;

use crate::local_frame::LocalFrame;
use crate::wgs84::{ECCENTRICITY_SQUARED, FLATTENING, SEMI_MAJOR_AXIS};

/// γ_e, normal gravity at the equator, m/s².
const EQUATORIAL_GRAVITY: f64 = 9.780_325_335_9;
/// γ_p, normal gravity at the poles, m/s².
const POLAR_GRAVITY: f64 = 9.832_184_937_8;
/// k = bγ_p/(aγ_e) − 1.
const SOMIGLIANA: f64 = (1.0 - FLATTENING) * POLAR_GRAVITY / EQUATORIAL_GRAVITY - 1.0;
/// m = ω²a²b/GM.
const CENTRIFUGAL_RATIO: f64 = 0.003_449_786_506_84;
/// 4πGρ of sea water at 1027 kg/m³, 1/s²: what the free-air gradient loses below the surface.
const WATER_GRADIENT: f64 = 8.61e-7;

/// γ(φ, h) from s² = sin²φ.
#[inline]
fn normal_gravity_from_sine_squared(s_squared: f64, height: f64) -> f64 {
    let on_ellipsoid =
        EQUATORIAL_GRAVITY * (1.0 + SOMIGLIANA * s_squared) / (1.0 - ECCENTRICITY_SQUARED * s_squared).sqrt();
    let ratio = height / SEMI_MAJOR_AXIS;
    let slope = 2.0 * (1.0 + FLATTENING + CENTRIFUGAL_RATIO - 2.0 * FLATTENING * s_squared);
    on_ellipsoid * (1.0 - ratio * (slope - 3.0 * ratio))
}

/// Normal gravity in free air, m/s², at a geodetic latitude (rad) and ellipsoidal height (m).
pub fn normal_gravity(latitude: f64, height: f64) -> f64 {
    let s = latitude.sin();
    normal_gravity_from_sine_squared(s * s, height)
}

/// Gravity as a function of position in a local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GravityModel {
    frame: LocalFrame,
    water_surface_height: Option<f64>,
}

impl GravityModel {
    /// Gravity around `frame`. With `water_surface_height` (ellipsoidal, m) the water above a point below it is taken into
    /// account; `None` is free air.
    pub fn new(frame: LocalFrame, water_surface_height: Option<f64>) -> GravityModel {
        GravityModel { frame, water_surface_height }
    }

    /// Gravity vector at an ENU position, m/s², ENU axes of the origin; points down.
    #[inline]
    pub fn at(&self, position_enu: &Vector3<f64>) -> Vector3<f64> {
        let point = self.frame.surface_point(position_enu);
        let mut gravity = normal_gravity_from_sine_squared(point.sin_latitude * point.sin_latitude, point.height);
        if let Some(surface) = self.water_surface_height
            && point.height < surface
        {
            gravity += WATER_GRADIENT * (point.height - surface);
        }
        point.up_enu * -gravity
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wgs84::Geodetic;
    use approx::assert_relative_eq;

    #[test]
    fn golden_numbers_of_the_method_are_met() {
        let table = [
            (0.0, [9.7803253359, 9.78063411218, 9.77723836651]),
            (30.0, [9.7932472692, 9.79355593863, 9.7901613693]),
            (36.38, [9.79851790871, 9.7988265345, 9.79543244567]),
            (45.0, [9.80619776934, 9.80650633147, 9.80311294352]),
            (60.0, [9.81917695307, 9.81948540744, 9.81609320594]),
            (90.0, [9.8321849378, 9.83249328394, 9.82910227397]),
        ];
        for (lat_deg, golden) in table {
            for (height, expected) in [0.0, -100.0, 1000.0].into_iter().zip(golden) {
                assert_relative_eq!(normal_gravity(f64::to_radians(lat_deg), height), expected, epsilon = 1e-10);
            }
        }
        assert_relative_eq!(SOMIGLIANA, 0.0019318526462, epsilon = 1e-12);
        let frame = LocalFrame::new(Geodetic::from_degrees(36.38, 127.36, 0.0));
        let golden = Vector3::new(-0.00189435500861, 0.00361507777366, -9.79874061208);
        let gravity = GravityModel::new(frame, None).at(&Vector3::new(1234.5, -2345.6, -78.9));
        assert_relative_eq!(gravity, golden, epsilon = 1e-10);
    }

    #[test]
    fn water_above_weakens_gravity_below_the_surface_only() {
        let frame = LocalFrame::new(Geodetic::from_degrees(36.38, 127.36, 0.0));
        let (air, water) = (GravityModel::new(frame, None), GravityModel::new(frame, Some(20.0)));
        let at = |up: f64| Vector3::new(0.0, 0.0, up);
        assert_eq!(air.at(&at(21.0)), water.at(&at(21.0)));
        // 88 µg one kilometre below the surface.
        let weaker = air.at(&at(-980.0)).norm() - water.at(&at(-980.0)).norm();
        assert_relative_eq!(weaker, 8.61e-4, epsilon = 1e-9);
    }
}
