//! The navigation frame: East-North-Up tangent plane of WGS-84 at a fixed origin.
//!
//! ```text
//! p_enu = C(φ₀, λ₀)(X − X₀),   C = [−sλ, cλ, 0;  −sφcλ, −sφsλ, cφ;  cφcλ, cφsλ, sφ]
//! ```
//!
//! The frame is flat and the Earth is not: the vertical tilts by 1/R per metre and the height of a point 5 km away is
//! 2 m above its `up` coordinate. So height, vertical and local axes at a point go through ECEF exactly; they cost a few
//! square roots and no trigonometric function.

use nalgebra::{Matrix3, Vector3};

use crate::wgs84::{EARTH_RATE, Geodetic, Normal};

/// East-North-Up frame, fixed to the Earth at its origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFrame {
    origin: Geodetic,
    origin_ecef: Vector3<f64>,
    r_enu_ecef: Matrix3<f64>,
}

/// The ellipsoid seen from a point: vertical, height and sine of latitude, found together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Unit normal of the ellipsoid through the point, ENU axes of the origin.
    pub up_enu: Vector3<f64>,
    /// Above the ellipsoid, m.
    pub height: f64,
    /// Sine of the geodetic latitude.
    pub sin_latitude: f64,
}

/// Rotation from ECEF to the ENU axes of a place given by sines and cosines.
#[inline]
fn enu_from_ecef(sin_lat: f64, cos_lat: f64, sin_lon: f64, cos_lon: f64) -> Matrix3<f64> {
    Matrix3::new(
        -sin_lon,
        cos_lon,
        0.0,
        -sin_lat * cos_lon,
        -sin_lat * sin_lon,
        cos_lat,
        cos_lat * cos_lon,
        cos_lat * sin_lon,
        sin_lat,
    )
}

impl LocalFrame {
    /// The frame with that origin.
    pub fn new(origin: Geodetic) -> LocalFrame {
        let (sin_lat, cos_lat) = origin.latitude.sin_cos();
        let (sin_lon, cos_lon) = origin.longitude.sin_cos();
        LocalFrame {
            origin,
            origin_ecef: origin.to_ecef(),
            r_enu_ecef: enu_from_ecef(sin_lat, cos_lat, sin_lon, cos_lon),
        }
    }

    /// Its origin.
    pub fn origin(&self) -> Geodetic {
        self.origin
    }

    /// ENU position of a geodetic point, m.
    pub fn to_enu(&self, point: &Geodetic) -> Vector3<f64> {
        self.r_enu_ecef * (point.to_ecef() - self.origin_ecef)
    }

    /// Geodetic coordinates of an ENU position (m).
    pub fn to_geodetic(&self, position_enu: &Vector3<f64>) -> Geodetic {
        Geodetic::from_ecef(&self.to_ecef(position_enu))
    }

    /// ECEF position of an ENU position, m.
    #[inline]
    pub fn to_ecef(&self, position_enu: &Vector3<f64>) -> Vector3<f64> {
        self.origin_ecef + self.r_enu_ecef.tr_mul(position_enu)
    }

    /// Vertical, height and latitude at an ENU position, in one go.
    #[inline]
    pub fn surface_point(&self, position_enu: &Vector3<f64>) -> SurfacePoint {
        let normal = Normal::at(&self.to_ecef(position_enu));
        SurfacePoint { up_enu: self.r_enu_ecef * normal.up_ecef(), height: normal.height, sin_latitude: normal.sin_lat }
    }

    /// Unit normal of the ellipsoid through an ENU position, in the ENU axes of the origin.
    #[inline]
    pub fn up_at(&self, position_enu: &Vector3<f64>) -> Vector3<f64> {
        self.surface_point(position_enu).up_enu
    }

    /// Ellipsoidal height of an ENU position, m. Differs from its `up` coordinate by d²/2R.
    #[inline]
    pub fn height_at(&self, position_enu: &Vector3<f64>) -> f64 {
        self.surface_point(position_enu).height
    }

    /// C_loc: rotates vectors given along local east, north, up at an ENU position to the ENU axes of the origin.
    #[inline]
    pub fn local_axes_at(&self, position_enu: &Vector3<f64>) -> Matrix3<f64> {
        let normal = Normal::at(&self.to_ecef(position_enu));
        let r_local_ecef = enu_from_ecef(normal.sin_lat, normal.cos_lat, normal.sin_lon, normal.cos_lon);
        self.r_enu_ecef * r_local_ecef.transpose()
    }

    /// The first two columns of [`LocalFrame::local_axes_at`]: east and north at an ENU position.
    #[inline]
    pub fn east_and_north_at(&self, position_enu: &Vector3<f64>) -> [Vector3<f64>; 2] {
        let Normal { sin_lat, cos_lat, sin_lon, cos_lon, .. } = Normal::at(&self.to_ecef(position_enu));
        let east = Vector3::new(-sin_lon, cos_lon, 0.0);
        let north = Vector3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat);
        [self.r_enu_ecef * east, self.r_enu_ecef * north]
    }

    /// Rate of the Earth, rad/s, constant in a frame fixed to the Earth: Ω(0, cos φ₀, sin φ₀).
    pub fn earth_rate_enu(&self) -> Vector3<f64> {
        self.r_enu_ecef.column(2) * EARTH_RATE
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn frame() -> LocalFrame {
        LocalFrame::new(Geodetic::from_degrees(36.38, 127.36, 0.0))
    }

    #[test]
    fn golden_numbers_of_the_method_are_met() {
        let rate = Vector3::new(0.0, 5.87088828073e-5, 4.32522970123e-5);
        assert_relative_eq!(frame().earth_rate_enu(), rate, epsilon = 1e-15);
        let point = Geodetic::from_degrees(36.3925, 127.3412, -42.5);
        let golden = Vector3::new(-1686.62671326, 1387.23205233, -42.8740848241);
        assert_relative_eq!(frame().to_enu(&point), golden, epsilon = 2e-8);
        let back = frame().to_geodetic(&frame().to_enu(&point));
        let error = (back.to_ecef() - point.to_ecef()).norm();
        assert!(error < 6e-9, "{error:e} m");
        let position_enu = Vector3::new(1234.5, -2345.6, -78.9);
        let [lat_deg, lon_deg, height] = frame().to_geodetic(&position_enu).to_degrees();
        assert_relative_eq!(lat_deg, 36.3588609147, epsilon = 1e-10);
        assert_relative_eq!(lon_deg, 127.373754519, epsilon = 1e-9);
        assert_relative_eq!(height, -78.3479851417, epsilon = 1e-8);
        let up = Vector3::new(0.000193326358895, -0.000368932866293, 0.999999913257);
        assert_relative_eq!(frame().up_at(&position_enu), up, epsilon = 1e-12);
    }

    #[test]
    fn what_the_hot_paths_say_is_what_the_geodetic_point_says() {
        for (lat_deg, lon_deg) in [(36.38, 127.36), (-89.9, -179.99), (89.99, 10.0), (0.0, 180.0)] {
            let frame = LocalFrame::new(Geodetic::from_degrees(lat_deg, lon_deg, 12.0));
            for position_enu in [Vector3::new(0.0, 0.0, 0.0), Vector3::new(12e3, -20e3, -6e3)] {
                let point = frame.to_geodetic(&position_enu);
                assert_relative_eq!(frame.height_at(&position_enu), point.height, epsilon = 1e-9);
                let higher = Geodetic { height: point.height + 1.0, ..point };
                let up = frame.to_enu(&higher) - frame.to_enu(&point);
                assert_relative_eq!(frame.up_at(&position_enu), up, epsilon = 1e-8);
                let axes = frame.local_axes_at(&position_enu);
                assert_relative_eq!(axes.column(2).into_owned(), frame.up_at(&position_enu), epsilon = 1e-15);
                assert_relative_eq!(axes.transpose() * axes, Matrix3::identity(), epsilon = 1e-14);
                let [east, north] = frame.east_and_north_at(&position_enu);
                assert_relative_eq!(axes.column(0).into_owned(), east, epsilon = 1e-15);
                assert_relative_eq!(axes.column(1).into_owned(), north, epsilon = 1e-15);
                let norther = Geodetic { latitude: point.latitude + 1e-7, ..point };
                let north = (frame.to_enu(&norther) - frame.to_enu(&point)).normalize();
                assert_relative_eq!(axes.column(1).into_owned(), north, epsilon = 1e-6);
            }
        }
    }

    #[test]
    fn height_grows_with_the_square_of_the_distance() {
        let height = frame().height_at(&Vector3::new(5_000.0, 0.0, 0.0));
        assert!((height - 1.957).abs() < 0.01, "{height} m");
    }
}
