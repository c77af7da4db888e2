//! Roll, pitch and heading of a body whose axes point forward, left and up.
//!
//! ```text
//! R = Rz(yaw) Ry(pitch) Rx(roll)     heading = 90° − yaw, clockwise from north
//! ```

use std::f64::consts::PI;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion};

/// A unit quaternion of what crossed the bus (w, x, y, z); `None` when it is none.
pub(super) fn unit_quaternion([w, x, y, z]: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    // An estimate is unit to rounding; what is this short is no rotation.
    const SHORTEST: f64 = 0.5;
    UnitQuaternion::try_new(Quaternion::new(w, x, y, z), SHORTEST)
}

/// Roll, pitch (both in (−π, π]) and heading (in [0, 2π)), rad, of a rotation from body to some East-North-Up axes.
pub(super) fn roll_pitch_heading(r_enu_body: &Matrix3<f64>) -> [f64; 3] {
    let roll = r_enu_body[(2, 1)].atan2(r_enu_body[(2, 2)]);
    let pitch = (-r_enu_body[(2, 0)]).atan2(r_enu_body[(2, 1)].hypot(r_enu_body[(2, 2)]));
    let heading = r_enu_body[(0, 0)].atan2(r_enu_body[(1, 0)]);
    [roll, pitch, heading.rem_euclid(2.0 * PI)]
}

/// The same angle in [−π, π).
pub(super) fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(2.0 * PI) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angles_of_the_method_are_found() {
        // Golden numbers of the method: Rz(.7) Ry(-.2) Rx(.1).
        let q = unit_quaternion([0.931800735822, 0.0809043958089, -0.0766114556571, 0.345445440442]).expect("unit");
        let [roll, pitch, heading] = roll_pitch_heading(q.to_rotation_matrix().matrix());
        assert!((roll - 0.1).abs() < 1e-9 && (pitch + 0.2).abs() < 1e-9, "{roll} {pitch}");
        assert!((heading.to_degrees() - 49.8929543408).abs() < 1e-8, "{}", heading.to_degrees());
    }

    #[test]
    fn a_difference_over_north_is_small() {
        let difference = wrapped(0.1_f64.to_radians() - 359.9_f64.to_radians());
        assert!((difference.to_degrees() - 0.2).abs() < 1e-9, "{}", difference.to_degrees());
    }

    #[test]
    fn what_is_no_rotation_is_refused() {
        assert!(unit_quaternion([0.0; 4]).is_none());
        assert!(unit_quaternion([f64::NAN; 4]).is_none());
    }
}
