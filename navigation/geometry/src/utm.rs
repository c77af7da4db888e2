//! Universal Transverse Mercator to geodetic: the frame in which surveyors and public data sets give positions.
//!
//! ```text
//! ξ = N/(k₀A)    η = (E − 500 km)/(k₀A)    ξ' = ξ − Σ β_j sin 2jξ cosh 2jη    η' = η − Σ β_j cos 2jξ sinh 2jη
//! λ − λ₀ = atan2(sinh η', cos ξ')    sin χ = sin ξ' / cosh η'  (conformal latitude)    A = a(1 + n²/4 + n⁴/64)/(1 + n)
//! ```
//!
//! Krüger's series to n⁴ (Karney, "Transverse Mercator with an accuracy of a few nanometers", 2011, eq. (11) and (36)): within a zone
//! better than a micrometre. Heights pass through.

use crate::wgs84::{ECCENTRICITY_SQUARED, Geodetic, SEMI_MAJOR_AXIS};

/// Scale on the central meridian.
const SCALE: f64 = 0.9996;
/// Easting of the central meridian, m.
const FALSE_EASTING: f64 = 500_000.0;
/// Northing of the equator on the southern hemisphere, m.
const FALSE_NORTHING: f64 = 10_000_000.0;

/// A zone of six degrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UtmZone {
    /// 1 to 60; zone 31 begins at Greenwich.
    pub number: u8,
    /// Northern hemisphere.
    pub is_north: bool,
}

impl UtmZone {
    /// Of the central meridian, rad.
    pub fn central_meridian(&self) -> f64 {
        (f64::from(self.number) * 6.0 - 183.0).to_radians()
    }

    /// The point at that easting and northing (m) and height (m).
    pub fn to_geodetic(&self, easting: f64, northing: f64, height: f64) -> Geodetic {
        let eccentricity = ECCENTRICITY_SQUARED.sqrt();
        // Third flattening, from e² = 4n/(1+n)².
        let minor_over_major = (1.0 - ECCENTRICITY_SQUARED).sqrt();
        let n = (1.0 - minor_over_major) / (1.0 + minor_over_major);
        let rectifying_radius = SEMI_MAJOR_AXIS / (1.0 + n) * (1.0 + n.powi(2) / 4.0 + n.powi(4) / 64.0);
        let false_northing = if self.is_north { 0.0 } else { FALSE_NORTHING };
        let xi = (northing - false_northing) / (SCALE * rectifying_radius);
        let eta = (easting - FALSE_EASTING) / (SCALE * rectifying_radius);
        let beta = [
            n / 2.0 - 2.0 / 3.0 * n.powi(2) + 37.0 / 96.0 * n.powi(3) - n.powi(4) / 360.0,
            n.powi(2) / 48.0 + n.powi(3) / 15.0 - 437.0 / 1440.0 * n.powi(4),
            17.0 / 480.0 * n.powi(3) - 37.0 / 840.0 * n.powi(4),
            4397.0 / 161_280.0 * n.powi(4),
        ];
        let (mut xi_sphere, mut eta_sphere) = (xi, eta);
        for (index, beta) in beta.iter().enumerate() {
            let twice = 2.0 * (index + 1) as f64;
            xi_sphere -= beta * (twice * xi).sin() * (twice * eta).cosh();
            eta_sphere -= beta * (twice * xi).cos() * (twice * eta).sinh();
        }
        let longitude = self.central_meridian() + eta_sphere.sinh().atan2(xi_sphere.cos());
        let conformal = (xi_sphere.sin() / eta_sphere.cosh()).asin();
        Geodetic::new(latitude_of(conformal, eccentricity), longitude, height)
    }

    /// Azimuth of grid north from true north, rad, clockwise: a grid vector (x, y) points at atan2(x, y) plus it.
    ///
    /// tan γ = tan(λ − λ₀) sin φ of the sphere; within a zone the ellipsoid adds less than 1e-7 rad.
    pub fn convergence(&self, point: &Geodetic) -> f64 {
        ((point.longitude - self.central_meridian()).tan() * point.latitude.sin()).atan()
    }
}

/// Geodetic latitude of a conformal one: tanh⁻¹ sin φ − e tanh⁻¹(e sin φ) = tanh⁻¹ sin χ, by fixed-point iteration.
fn latitude_of(conformal: f64, eccentricity: f64) -> f64 {
    // Each step gains a factor of e² = 1/150: eight are beyond rounding.
    let isometric = conformal.sin().atanh();
    (0..8).fold(conformal, |latitude, _| {
        (isometric + eccentricity * (eccentricity * latitude.sin()).atanh()).tanh().asin()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wgs84::{meridian_radius, prime_vertical_radius};

    const KAIST: UtmZone = UtmZone { number: 52, is_north: true };

    /// A transverse Mercator projection is the one conformal map that is true to scale, but for k₀, along its meridian.
    #[test]
    fn the_central_meridian_is_the_arc_of_the_ellipse() {
        let latitude = KAIST.to_geodetic(FALSE_EASTING, 4_026_000.0, 0.0).latitude;
        let steps = 20_000;
        let width = latitude / f64::from(steps);
        // Midpoint rule: (M'' h² L)/24 is far below a micrometre.
        let arc: f64 = (0..steps).map(|i| meridian_radius((f64::from(i) + 0.5) * width) * width).sum();
        assert!((arc * SCALE - 4_026_000.0).abs() < 1e-4, "{arc}");
        assert_eq!(KAIST.to_geodetic(FALSE_EASTING, 1e6, 0.0).longitude, 129_f64.to_radians());
    }

    #[test]
    fn the_map_is_conformal_and_turned_by_the_convergence() {
        for (easting, northing) in [(350_000.0, 4_026_000.0), (700_000.0, 5_500_000.0), (480_000.0, 300_000.0)] {
            let at = |east: f64, north: f64| KAIST.to_geodetic(easting + east, northing + north, 0.0);
            let centre = at(0.0, 0.0);
            // Metres to east and north that a grid step of 2 m covers.
            let step = |east: f64, north: f64| {
                let (from, to) = (at(-east, -north), at(east, north));
                let parallel = prime_vertical_radius(centre.latitude) * centre.latitude.cos();
                [
                    (to.longitude - from.longitude) * parallel,
                    (to.latitude - from.latitude) * meridian_radius(centre.latitude),
                ]
            };
            let ([a, b], [c, d]) = (step(1.0, 0.0), step(0.0, 1.0));
            assert!((a - d).abs() < 1e-6 && (b + c).abs() < 1e-6, "not conformal: {a} {b} {c} {d}");
            let convergence = c.atan2(d);
            assert!((convergence - KAIST.convergence(&centre)).abs() < 1e-6, "{convergence}");
        }
    }

    #[test]
    fn south_of_the_equator_northings_count_from_ten_thousand_kilometres() {
        let north = KAIST.to_geodetic(400_000.0, 1e6, 3.0);
        let south = UtmZone { is_north: false, ..KAIST }.to_geodetic(400_000.0, 9e6, 3.0);
        assert!((north.latitude + south.latitude).abs() < 1e-15 && north.longitude == south.longitude);
        assert_eq!(south.height, 3.0);
    }
}
