//! The estimate at the time of a truth row.
//!
//! The truth comes at 10 Hz or so, estimates at the rate of the IMU: the estimate is carried to the truth's time between its
//! two neighbours, position, velocity and sigmas by a straight line, attitude by the shortest turn. At 200 Hz and
//! 1 m/s² the line is wrong by a·dt²/8 = 3 µm, far below any error that is to be measured; interpolating the truth over its
//! own 100 ms would cost a thousand times as much. Neighbours further apart than [`MAX_SPACING`] bound a gap: a truth row
//! in it has no estimate, and is counted as missed. An estimate at the very time of the truth counts as it is.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use shared_types::{Duration, NavEstimate, Time};

/// Neighbouring estimates further apart are not interpolated between: ten periods of a 200 Hz IMU.
pub const MAX_SPACING: Duration = Duration(50_000_000);

/// What an estimate says and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EstimatePoint {
    /// Data time.
    pub t: Time,
    /// m.
    pub position_enu: Vector3<f64>,
    /// m/s.
    pub velocity_enu: Vector3<f64>,
    /// Body to ENU.
    pub q_enu_body: UnitQuaternion<f64>,
    /// 1-sigma per axis, m.
    pub sigma_position_enu: Vector3<f64>,
    /// 1-sigma per axis, m/s; NaN = not known.
    pub sigma_velocity_enu: Vector3<f64>,
    /// 1-sigma about body x, body y and the up axis, rad.
    pub sigma_rpy: Vector3<f64>,
}

impl From<&NavEstimate> for EstimatePoint {
    fn from(estimate: &NavEstimate) -> EstimatePoint {
        // Diagonal of ee, en, eu, nn, nu, uu.
        let diagonal = |cov: &[f64; 6]| Vector3::new(cov[0].sqrt(), cov[3].sqrt(), cov[5].sqrt());
        EstimatePoint {
            t: Time(estimate.header.t_valid),
            position_enu: estimate.position_enu.into(),
            velocity_enu: estimate.velocity_enu.into(),
            q_enu_body: unit_quaternion(estimate.q_enu_body),
            sigma_position_enu: diagonal(&estimate.position_cov),
            sigma_velocity_enu: diagonal(&estimate.velocity_cov),
            sigma_rpy: estimate.sigma_rpy.into(),
        }
    }
}

/// From Hamilton (w, x, y, z); rounding in files is taken out.
pub(crate) fn unit_quaternion([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

impl EstimatePoint {
    /// Body to ENU from Hamilton (w, x, y, z), normalised.
    pub fn attitude(q_enu_body: [f64; 4]) -> UnitQuaternion<f64> {
        unit_quaternion(q_enu_body)
    }

    /// The estimate at `t` between `self` and `next`; `None` across a gap.
    pub(crate) fn at(&self, next: &EstimatePoint, t: Time) -> Option<EstimatePoint> {
        if t == self.t {
            return Some(*self);
        }
        if t == next.t {
            return Some(*next);
        }
        if next.t - self.t > MAX_SPACING {
            return None;
        }
        let share = (t - self.t).as_seconds() / (next.t - self.t).as_seconds();
        let turn = self.q_enu_body.inverse() * next.q_enu_body;
        Some(EstimatePoint {
            t,
            position_enu: self.position_enu.lerp(&next.position_enu, share),
            velocity_enu: self.velocity_enu.lerp(&next.velocity_enu, share),
            q_enu_body: self.q_enu_body * UnitQuaternion::from_scaled_axis(turn.scaled_axis() * share),
            sigma_position_enu: self.sigma_position_enu.lerp(&next.sigma_position_enu, share),
            sigma_velocity_enu: self.sigma_velocity_enu.lerp(&next.sigma_velocity_enu, share),
            sigma_rpy: self.sigma_rpy.lerp(&next.sigma_rpy, share),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    fn point(nanos: i64, east: f64, yaw: f64) -> EstimatePoint {
        EstimatePoint {
            t: Time(nanos),
            position_enu: Vector3::new(east, 0.0, 0.0),
            velocity_enu: Vector3::new(0.0, east, 0.0),
            q_enu_body: UnitQuaternion::from_euler_angles(0.0, 0.0, yaw),
            sigma_position_enu: Vector3::repeat(1.0 + east),
            sigma_velocity_enu: Vector3::repeat(f64::NAN),
            sigma_rpy: Vector3::repeat(0.1),
        }
    }

    #[test]
    fn a_quarter_of_the_way_is_a_quarter_of_the_motion() {
        let between = point(0, 0.0, 0.0).at(&point(40_000_000, 2.0, FRAC_PI_2), Time(10_000_000)).expect("no gap");
        assert!((between.position_enu.x - 0.5).abs() < 1e-15);
        assert!((between.velocity_enu.y - 0.5).abs() < 1e-15);
        assert!((between.q_enu_body.euler_angles().2 - FRAC_PI_2 / 4.0).abs() < 1e-15);
        assert!((between.sigma_position_enu.x - 1.5).abs() < 1e-15);
        assert!(between.sigma_velocity_enu.x.is_nan());
    }

    #[test]
    fn attitude_takes_the_shorter_way_whichever_sign_the_quaternion_has() {
        let negated = EstimatePoint {
            q_enu_body: UnitQuaternion::new_unchecked(-point(0, 0.0, 0.2).q_enu_body.into_inner()),
            ..point(10_000_000, 0.0, 0.0)
        };
        let between = point(0, 0.0, 0.0).at(&negated, Time(5_000_000)).expect("no gap");
        assert!((between.q_enu_body.euler_angles().2 - 0.1).abs() < 1e-15);
    }

    #[test]
    fn a_gap_is_not_bridged_but_its_ends_count() {
        let (before, after) = (point(0, 0.0, 0.0), point(50_000_001, 1.0, 0.0));
        assert_eq!(before.at(&after, Time(25_000_000)), None);
        assert_eq!(before.at(&after, after.t).map(|p| p.position_enu.x), Some(1.0));
        assert_eq!(before.at(&after, before.t).map(|p| p.position_enu.x), Some(0.0));
    }
}
