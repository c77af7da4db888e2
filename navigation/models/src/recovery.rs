//! When the sensors agree with each other against the state.
//!
//! A gate protects the state from outliers; when the state itself is wrong (an IMU that clipped, a glitch that no noise
//! density knows) the same gate refuses every good range, the error grows faster than the covariance, and nothing ever
//! comes back. Outliers of several buoys do not agree on a place; good ranges do. So when whole epochs have been refused in a
//! row, the newest epoch is asked for the position that fits it best: if it fits within its own sigmas, the inertial
//! increment of the closing interval is loosened by as much as the state is off, the gates see a covariance that covers the
//! truth, and the published sigmas say so.

use nalgebra::{Matrix4, Vector3, Vector4};
use shared_types::{Config, Duration, ImuNoise, Measurement, Reading, Time};

use crate::anchored::Pose;
use crate::preintegration::Preintegration;
use crate::robust::chi2_999;
use crate::sensors::LblModel;
use crate::state::NavState;

/// A measurement as it came, and what is in it.
pub type Checked = (Measurement, Reading);

/// Whole epochs refused in a row before the state is suspected: one may agree with itself by chance, two hardly do.
pub const SUSPICIOUS_EPOCHS: u32 = 2;
/// Ranges further from the keyframe than this are not evaluated at its state.
pub const NEAR_KEYFRAME: Duration = Duration(200_000_000);
/// Nothing is known of the horizontal position: 1-sigma of the fit's prior, m.
const HORIZONTAL_PRIOR: f64 = 1e4;
/// Gauss-Newton steps of the fit; from kilometres off, five reach the millimetre.
const FIT_STEPS: usize = 8;
/// The loosened increment's 1-sigma in attitude, rad: three degrees, what sharp turns were seen to leave.
const ATTITUDE: f64 = 0.05;
/// Smallest 1-sigma in position, m, and velocity, m/s, that is worth loosening by.
const POSITION_MIN: f64 = 0.3;
const VELOCITY_MIN: f64 = 0.1;

/// 1-sigmas to add to the increment of the closing interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loosening {
    /// m.
    pub position: f64,
    /// m/s.
    pub velocity: f64,
    /// rad.
    pub attitude: f64,
    /// Of the change of the accelerometer bias, m/s².
    pub accel_bias: f64,
    /// Of the change of the gyroscope bias, rad/s.
    pub gyro_bias: f64,
}

impl Loosening {
    /// Nothing is loosened.
    pub const NONE: Loosening =
        Loosening { position: 0.0, velocity: 0.0, attitude: 0.0, accel_bias: 0.0, gyro_bias: 0.0 };

    /// Of a state that is `shift` m beside the place on which ranges have agreed for so long.
    pub(crate) fn by(shift: f64, refused_for: Duration) -> Loosening {
        Loosening {
            position: shift.max(POSITION_MIN),
            velocity: (2.0 * shift / refused_for.as_seconds().max(1.0)).max(VELOCITY_MIN),
            attitude: ATTITUDE,
            ..Loosening::NONE
        }
    }

    /// Adds it to an increment.
    pub fn apply(&self, increment: &mut Preintegration) {
        increment.loosen(self.position, self.velocity, self.attitude);
        increment.loosen_biases(self.accel_bias, self.gyro_bias);
    }
}

/// By how much to loosen, if the epoch at the keyframe `t` agrees with itself on another place than `predicted`.
///
/// `height_sigma`: how well the height is known, m. `refused_for`: since when epochs are refused.
pub fn loosening(
    pending: &[Checked],
    t: Time,
    predicted: &NavState,
    height_sigma: f64,
    refused_for: Duration,
    config: &Config,
) -> Option<Loosening> {
    let ranges = || {
        pending.iter().filter_map(|(measurement, reading)| match *reading {
            Reading::Lbl { range, buoy_enu, buoy_sigma, .. }
                if measurement.t_keyframe() == t && (measurement.t_valid() - t).abs() <= NEAR_KEYFRAME =>
            {
                Some(LblModel::new(range, buoy_enu, buoy_sigma, &config.vehicle.lbl))
            }
            _ => None,
        })
    };
    let sigma = |model: &LblModel| config.vehicle.lbl.sigma.hypot(model.buoy_sigma);
    let ranges = ranges().map(|model| (model, sigma(&model)));
    let place = agreed(ranges, predicted, height_sigma, config.navigator.lbl_common_offset_sigma)?;
    Some(Loosening::by(place.shift.xy().norm(), refused_for))
}

/// A place on which ranges agree.
pub(crate) struct Place {
    /// From the state, m.
    pub(crate) shift: Vector3<f64>,
    /// Ranges beyond those that tell the place.
    pub(crate) redundancy: usize,
}

/// The place on which ranges agree within their sigmas; `None` where they do not, or where there are too few to say so. With
/// `offset_sigma` they share an unknown offset.
pub(crate) fn agreed(
    ranges: impl Iterator<Item = (LblModel, f64)> + Clone,
    predicted: &NavState,
    height_sigma: f64,
    offset_sigma: f64,
) -> Option<Place> {
    // Two unknowns of the place, one of the offset; the height comes from its prior.
    let unknowns = if offset_sigma > 0.0 { 3 } else { 2 };
    let count = ranges.clone().count();
    let redundancy = count.checked_sub(unknowns).filter(|&redundancy| redundancy > 0)?;
    let at_state = Vector3::zeros();
    // Far outside the buoys all directions are one, and a step from there goes anywhere.
    let buoys = ranges.clone().map(|(model, _)| model.buoy_enu).sum::<Vector3<f64>>() / count as f64;
    let among_buoys = (buoys - predicted.position_enu).xy().push(0.0);
    [at_state, among_buoys].into_iter().find_map(|start| {
        let (shift, chi2) = fit(ranges.clone(), predicted, &start, height_sigma, offset_sigma)?;
        (chi2 <= chi2_999(redundancy)).then_some(Place { shift, redundancy })
    })
}

/// Where ranges see the vehicle, from `predicted`, m, and the sum of squares that is left, found from `start`.
fn fit(
    ranges: impl Iterator<Item = (LblModel, f64)> + Clone,
    predicted: &NavState,
    start: &Vector3<f64>,
    height_sigma: f64,
    offset_sigma: f64,
) -> Option<(Vector3<f64>, f64)> {
    let mut fitted = *predicted;
    fitted.position_enu += start;
    let mut offset = 0.0;
    let mut chi2 = f64::INFINITY;
    for step in 0..=FIT_STEPS {
        let moved = fitted.position_enu - predicted.position_enu;
        let prior = Vector4::new(
            HORIZONTAL_PRIOR.powi(-2),
            HORIZONTAL_PRIOR.powi(-2),
            height_sigma.max(1e-3).powi(-2),
            // σ_d = 0 keeps the offset where it is, σ_d = ∞ leaves it free.
            if offset_sigma > 0.0 { offset_sigma.powi(-2).max(1e-12) } else { 1e12 },
        );
        let at = Vector4::new(moved.x, moved.y, moved.z, offset);
        let mut normal = Matrix4::from_diagonal(&prior);
        let mut right = -prior.component_mul(&at);
        chi2 = prior.component_mul(&at).dot(&at);
        for (model, sigma) in ranges.clone() {
            let (distance, u) = model.distance_and_direction(&Pose::from(&fitted));
            let residual = (distance + offset - model.range) / sigma;
            let row = Vector4::new(u.x, u.y, u.z, 1.0) / sigma;
            normal += row * row.transpose();
            right -= row * residual;
            chi2 += residual * residual;
        }
        if step == FIT_STEPS {
            break;
        }
        let delta = normal.cholesky()?.solve(&right);
        fitted.position_enu += delta.xyz();
        offset += delta.w;
    }
    Some((fitted.position_enu - predicted.position_enu, chi2))
}

/// Satellite fixes in a row that no sigma explains, and for how long, before they overrule the state; only where no range
/// speaks for it. A jump of the receiver at surfacing is over sooner, as a rule.
const SUSPICIOUS_FIXES: u32 = 5;
const SUSPICIOUS_FOR: Duration = Duration(5_000_000_000);

/// The same by satellite fixes that disagree with the state for long: `count` in a row since `since`.
pub fn loosening_by_fixes(
    pending: &[Checked],
    predicted: &NavState,
    t: Time,
    (count, since): (u32, Option<Time>),
) -> Option<Loosening> {
    let refused_for = t - since.filter(|_| count >= SUSPICIOUS_FIXES)?;
    if refused_for < SUSPICIOUS_FOR {
        return None;
    }
    let fix = pending.iter().rev().find_map(|(_, reading)| match *reading {
        Reading::Gnss { antenna_enu, .. } => Some(Vector3::from(antenna_enu)),
        _ => None,
    })?;
    let shift = (fix - predicted.position_enu).norm();
    Some(Loosening {
        position: shift.max(POSITION_MIN),
        velocity: (2.0 * shift / refused_for.as_seconds()).max(VELOCITY_MIN),
        attitude: ATTITUDE,
        ..Loosening::NONE
    })
}

/// Attitude that a state gives way by which ranges see elsewhere although each passes: a degree, rad.
const ATTITUDE_ASTRAY: f64 = 0.02;
/// In so many seconds it went astray.
const ASTRAY_IN: f64 = 5.0;

/// The same where ranges or fixes, each of which passes, together see the vehicle `shift` m beside the state (`pull.rs`): whatever
/// leads it astray, a Doppler log that reads too much or a gyroscope that drifts, goes on, and the state is not as sure as it says.
pub fn loosening_by_shift(shift: f64, noise: &ImuNoise) -> Loosening {
    Loosening {
        position: shift,
        velocity: shift / ASTRAY_IN,
        attitude: ATTITUDE_ASTRAY,
        accel_bias: noise.accel_bias_sigma.min(ACCEL_LEAP_MAX),
        gyro_bias: noise.gyro_bias_sigma.min(GYRO_LEAP_MAX),
    }
}

/// By how many of its sigmas at the beginning a bias may have leapt …
const BIAS_LEAP: f64 = 20.0;
/// … and by no more than this, m/s² and rad/s: twenty sigmas of an instrument whose biases are hardly known are no leap but a
/// course that is made up anew.
const ACCEL_LEAP_MAX: f64 = 0.03;
const GYRO_LEAP_MAX: f64 = 1e-3;
/// Biases that have been let loose are given so long to settle.
const BIASES_SETTLE: Duration = Duration(20_000_000_000);

/// The same where several sensors have begun to doubt the state and none says where it is instead (`doubt.rs`): a bias has leapt.
/// `None` while those that were let loose `since_last` ago still settle.
pub fn loosening_of_biases(since_last: Option<Duration>, noise: &ImuNoise) -> Option<Loosening> {
    if since_last.is_some_and(|since| since < BIASES_SETTLE) {
        return None;
    }
    Some(Loosening {
        position: POSITION_MIN,
        velocity: VELOCITY_MIN,
        attitude: ATTITUDE,
        accel_bias: (BIAS_LEAP * noise.accel_bias_sigma).min(ACCEL_LEAP_MAX),
        gyro_bias: (BIAS_LEAP * noise.gyro_bias_sigma).min(GYRO_LEAP_MAX),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Measurement;

    const BUOYS: [[f64; 3]; 4] = [[0.0, -500.0, 0.0], [-400.0, 0.0, 0.0], [-200.0, 1000.0, 0.0], [200.0, 500.0, 0.0]];

    fn epoch(at: Vector3<f64>, error: impl Fn(usize) -> f64) -> Vec<Checked> {
        BUOYS
            .iter()
            .enumerate()
            .map(|(index, &buoy_enu)| {
                let range = (at - Vector3::from(buoy_enu)).norm() + error(index);
                let reading =
                    Reading::Lbl { buoy: index as u32, epoch: 1, range, buoy_enu, buoy_sigma: 0.0, is_moored: true };
                (Measurement::new(Time(0), Time(0), &reading), reading)
            })
            .collect()
    }

    fn ask(pending: &[Checked], config: &Config) -> Option<Loosening> {
        let mut predicted = NavState::identity();
        predicted.position_enu = Vector3::new(0.0, 0.0, -50.0);
        loosening(pending, Time(0), &predicted, 0.01, Duration::from_seconds(4.0), config)
    }

    #[test]
    fn ranges_that_agree_on_another_place_loosen_by_the_way_there() {
        let pending = epoch(Vector3::new(30.0, -40.0, -50.0), |index| [0.2, -0.3, 0.1, 0.0][index]);
        let loosening = ask(&pending, &Config::default()).expect("they agree");
        assert!((loosening.position - 50.0).abs() < 1.0, "{loosening:?}");
        assert!((loosening.velocity - 25.0).abs() < 0.5, "{loosening:?}");
    }

    #[test]
    fn multipath_on_two_of_four_buoys_is_no_place() {
        let pending = epoch(Vector3::new(0.0, 0.0, -50.0), |index| [80.0, 0.0, 35.0, 0.0][index]);
        assert_eq!(ask(&pending, &Config::default()), None);
    }

    #[test]
    fn an_offset_common_to_all_is_no_place_for_raw_ranges_and_none_for_differences() {
        let late = epoch(Vector3::new(0.0, 0.0, -50.0), |_| 120.0);
        assert_eq!(ask(&late, &Config::default()), None);
        let sets = ["lbl.common_offset_sigma=inf".to_owned()];
        let differences = Config::load(&[], &sets).expect("valid");
        let loosening = ask(&late, &differences).expect("the place fits");
        assert!(loosening.position < 1.0, "{loosening:?}");
    }

    #[test]
    fn biases_are_let_loose_once_and_given_time_to_settle() {
        let noise = ImuNoise { gyro_bias_sigma: 1e-5, ..Config::default().vehicle.imu };
        let first = loosening_of_biases(None, &noise).expect("never before");
        assert_eq!((first.gyro_bias, first.accel_bias), (20.0 * 1e-5, 20.0 * noise.accel_bias_sigma));
        let hardly_known = ImuNoise { gyro_bias_sigma: 5e-3, accel_bias_sigma: 0.3, ..noise };
        let capped = loosening_of_biases(None, &hardly_known).expect("never before");
        assert_eq!((capped.gyro_bias, capped.accel_bias), (GYRO_LEAP_MAX, ACCEL_LEAP_MAX));
        assert_eq!(loosening_of_biases(Some(Duration::from_seconds(1.0)), &noise), None);
        assert_eq!(loosening_of_biases(Some(Duration::from_seconds(20.0)), &noise), Some(first));
    }

    #[test]
    fn a_shift_loosens_by_itself_and_the_biases_by_what_they_were_known_to() {
        let hardly_known = ImuNoise { gyro_bias_sigma: 5e-3, accel_bias_sigma: 0.01, ..Config::default().vehicle.imu };
        let loosening = loosening_by_shift(0.5, &hardly_known);
        assert_eq!((loosening.position, loosening.velocity), (0.5, 0.1));
        assert_eq!((loosening.accel_bias, loosening.gyro_bias), (0.01, GYRO_LEAP_MAX));
    }

    #[test]
    fn two_ranges_prove_nothing() {
        let pending = epoch(Vector3::new(30.0, -40.0, -50.0), |_| 0.0);
        assert_eq!(ask(&pending[..2], &Config::default()), None);
    }
}
