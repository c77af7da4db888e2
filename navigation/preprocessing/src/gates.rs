//! Is the content possible, and what is it in SI units?
//!
//! One function a sensor: the raw reading as the instrument said it, to the [`Reading`] that an estimator takes (degrees
//! become radians here), or the reason why not. Gates that need a position or another sensor stand in `preprocessor.rs`.

use shared_types::{DvlVelocity, GnssFix, LblRange, McpHeading, Navigator, PsDepth, Reading, RejectReason, Vehicle};

/// Waves and tides lift a port above the mean surface, and a car climbs hills with its "depth" negative; no higher, m.
const DEPTH_MIN: f64 = -100.0;

/// Heights of a fix, m: below the deepest trench, above any aircraft.
const HEIGHTS: std::ops::RangeInclusive<f64> = -12_000.0..=20_000.0;

/// A sigma below is a claim that no receiver can make, m.
const SIGMA_FLOOR: f64 = 1.0e-3;

/// A sigma beyond says nothing, and its square would spoil the scaling, m.
const SIGMA_CEILING: f64 = 1.0e5;

/// A satellite fix, checked, still geodetic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fix {
    /// Degrees.
    pub(crate) lat_deg: f64,
    /// Degrees.
    pub(crate) lon_deg: f64,
    /// Ellipsoidal height, m, where it was reported.
    pub(crate) height: Option<f64>,
    /// 1-sigma, m; infinite = not reported.
    pub(crate) sigma_enu: [f64; 3],
    /// A reported sigma was impossible and the configured one stands in its place.
    pub(crate) sigma_substituted: bool,
}

/// Latitude and longitude must be there; height and sigmas may be missing.
pub(crate) fn gnss(raw: &GnssFix, vehicle: &Vehicle) -> Result<Fix, RejectReason> {
    if !raw.lat_deg.is_finite() || !raw.lon_deg.is_finite() || raw.height.is_infinite() {
        return Err(RejectReason::NotFinite);
    }
    let height = Some(raw.height).filter(|height| !height.is_nan());
    if raw.lat_deg.abs() > 90.0 || raw.lon_deg.abs() > 360.0 || height.is_some_and(|height| !HEIGHTS.contains(&height))
    {
        return Err(RejectReason::OutOfRange);
    }
    let mut sigma_enu = raw.sigma_enu;
    let mut sigma_substituted = false;
    for (sigma, configured) in sigma_enu.iter_mut().zip(vehicle.gnss.sigma_enu) {
        if sigma.is_nan() {
            *sigma = configured;
        } else if *sigma < SIGMA_FLOOR.min(configured) {
            *sigma = configured;
            sigma_substituted = true;
        }
    }
    if height.is_none() || sigma_enu[2] > SIGMA_CEILING {
        sigma_enu[2] = f64::INFINITY;
    }
    if sigma_enu[..2].iter().any(|&sigma| sigma > SIGMA_CEILING) {
        return Err(RejectReason::OutOfRange);
    }
    Ok(Fix { lat_deg: raw.lat_deg, lon_deg: raw.lon_deg, height, sigma_enu, sigma_substituted })
}

/// All three components, each within what the instrument measures.
pub(crate) fn dvl(raw: &DvlVelocity, navigator: &Navigator) -> Result<Reading, RejectReason> {
    if !raw.velocity_dvl.iter().all(|value| value.is_finite()) {
        return Err(RejectReason::NotFinite);
    }
    if raw.velocity_dvl.iter().any(|value| value.abs() > navigator.dvl_max_speed) {
        return Err(RejectReason::OutOfRange);
    }
    Ok(Reading::Dvl { velocity_dvl: raw.velocity_dvl })
}

/// A heading of one turn either way; the declination is added.
pub(crate) fn mcp(raw: &McpHeading, vehicle: &Vehicle) -> Result<Reading, RejectReason> {
    if !raw.heading_deg.is_finite() {
        return Err(RejectReason::NotFinite);
    }
    if raw.heading_deg.abs() > 360.0 {
        return Err(RejectReason::OutOfRange);
    }
    Ok(Reading::Mcp { heading: raw.heading_deg.to_radians() + vehicle.mcp.declination })
}

/// A depth between the wave crests and the configured limit.
pub(crate) fn ps(raw: &PsDepth, navigator: &Navigator) -> Result<Reading, RejectReason> {
    if !raw.depth.is_finite() {
        return Err(RejectReason::NotFinite);
    }
    if raw.depth < DEPTH_MIN || raw.depth > navigator.ps_max_depth {
        return Err(RejectReason::OutOfRange);
    }
    Ok(Reading::Ps { depth: raw.depth })
}

/// A distance, and not beyond the reach of sound.
pub(crate) fn lbl(raw: &LblRange, navigator: &Navigator) -> Result<f64, RejectReason> {
    if !raw.range.is_finite() {
        return Err(RejectReason::NotFinite);
    }
    if raw.range <= 0.0 || raw.range > navigator.lbl_max_range {
        return Err(RejectReason::OutOfRange);
    }
    Ok(raw.range)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test may fail where it stands")]
    use super::*;
    use crate::testing;
    use shared_types::{Header, RawReading, Time};

    fn fix() -> GnssFix {
        match testing::gnss(1.0, 0.0) {
            RawReading::Gnss(fix) => fix,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_fix_without_height_tells_nothing_of_up() {
        let checked = gnss(&GnssFix { height: f64::NAN, ..fix() }, &Vehicle::default()).unwrap();
        assert_eq!(checked.height, None);
        assert_eq!(checked.sigma_enu[2], f64::INFINITY);
        assert!(!checked.sigma_substituted);
    }

    #[test]
    fn missing_sigmas_are_the_configured_ones() {
        let checked = gnss(&GnssFix { sigma_enu: [f64::NAN; 3], ..fix() }, &Vehicle::default()).unwrap();
        assert_eq!(checked.sigma_enu, Vehicle::default().gnss.sigma_enu);
        assert!(!checked.sigma_substituted, "not reported is not absurd");
    }

    #[test]
    fn impossible_sigmas_are_replaced_and_noticed() {
        for sigma in [0.0, -1.0, f64::NEG_INFINITY, 1e-300] {
            let checked = gnss(&GnssFix { sigma_enu: [sigma, 1.0, 1.0], ..fix() }, &Vehicle::default()).unwrap();
            assert_eq!(checked.sigma_enu, [Vehicle::default().gnss.sigma_enu[0], 1.0, 1.0], "{sigma}");
            assert!(checked.sigma_substituted, "{sigma}");
        }
        for sigma in [f64::INFINITY, 1e300] {
            let refused = gnss(&GnssFix { sigma_enu: [1.0, sigma, 1.0], ..fix() }, &Vehicle::default());
            assert_eq!(refused, Err(RejectReason::OutOfRange), "{sigma}");
        }
    }

    #[test]
    fn a_fix_outside_the_globe_is_refused() {
        let vehicle = Vehicle::default();
        assert_eq!(gnss(&GnssFix { lat_deg: 90.1, ..fix() }, &vehicle), Err(RejectReason::OutOfRange));
        assert_eq!(gnss(&GnssFix { lon_deg: 361.0, ..fix() }, &vehicle), Err(RejectReason::OutOfRange));
        assert_eq!(gnss(&GnssFix { height: 1e9, ..fix() }, &vehicle), Err(RejectReason::OutOfRange));
        assert_eq!(gnss(&GnssFix { lat_deg: f64::NAN, ..fix() }, &vehicle), Err(RejectReason::NotFinite));
        assert!(gnss(&GnssFix { lat_deg: -90.0, lon_deg: 180.0, ..fix() }, &vehicle).is_ok());
    }

    #[test]
    fn a_velocity_with_one_hole_is_dropped_whole() {
        let raw = |velocity_dvl| DvlVelocity { header: Header::at(Time(0)), velocity_dvl };
        let navigator = Navigator::default();
        assert_eq!(dvl(&raw([1.0, f64::NAN, 0.0]), &navigator), Err(RejectReason::NotFinite));
        assert_eq!(dvl(&raw([1.0, -61.0, 0.0]), &navigator), Err(RejectReason::OutOfRange));
        assert_eq!(dvl(&raw([1.0, 0.1, 0.0]), &navigator), Ok(Reading::Dvl { velocity_dvl: [1.0, 0.1, 0.0] }));
    }

    #[test]
    fn a_heading_becomes_radians_from_true_north() {
        let mut vehicle = Vehicle::default();
        vehicle.mcp.declination = 0.1;
        let raw = |heading_deg| McpHeading { header: Header::at(Time(0)), heading_deg };
        let expected = std::f64::consts::FRAC_PI_2 + 0.1;
        assert_eq!(mcp(&raw(90.0), &vehicle), Ok(Reading::Mcp { heading: expected }));
        assert_eq!(mcp(&raw(400.0), &vehicle), Err(RejectReason::OutOfRange));
        assert_eq!(mcp(&raw(f64::INFINITY), &vehicle), Err(RejectReason::NotFinite));
    }

    #[test]
    fn a_depth_above_the_waves_or_below_the_floor_is_refused() {
        let raw = |depth| PsDepth { header: Header::at(Time(0)), depth };
        let navigator = Navigator::default();
        assert_eq!(ps(&raw(-1.5), &navigator), Ok(Reading::Ps { depth: -1.5 }));
        assert_eq!(ps(&raw(-101.0), &navigator), Err(RejectReason::OutOfRange));
        assert_eq!(ps(&raw(12_001.0), &navigator), Err(RejectReason::OutOfRange));
        assert_eq!(ps(&raw(f64::NAN), &navigator), Err(RejectReason::NotFinite));
    }

    #[test]
    fn a_range_is_positive_and_within_reach() {
        let raw = |range| LblRange { header: Header::at(Time(0)), buoy: 1, in_epoch: 0, range };
        let navigator = Navigator::default();
        assert_eq!(lbl(&raw(612.0), &navigator), Ok(612.0));
        for range in [0.0, -3.0, 15_001.0] {
            assert_eq!(lbl(&raw(range), &navigator), Err(RejectReason::OutOfRange), "{range}");
        }
        assert_eq!(lbl(&raw(f64::NAN), &navigator), Err(RejectReason::NotFinite));
    }
}
