//! Long-baseline acoustics (LBL): slant range from the transducer to a buoy (§3.2 of the method).
//!
//! ```text
//! d = p + R l − B,  ρ = |d|,  u = d/ρ,  residual = (1 + κ)ρ − range               [m], 1 row
//! H = (1 + κ)[uᵀ | 0 | −uᵀR[l]×],   ∂h/∂B = −(1 + κ)uᵀ,   ∂h/∂κ = ρ
//! ```
//!
//! κ = c_assumed/c_true − 1 is the error of the assumed sound speed. The paper differentiates through geodetic coordinates;
//! with position and buoys in one Cartesian frame the unit vector says it all. How the ranges of one
//! epoch are joined, raw or as differences, is the estimators' affair: they differ in what they keep of the common offset.

use nalgebra::{SMatrix, Vector1, Vector3};
use shared_types::Lbl;

use crate::anchored::{Pose, Seen, SensorModel};
use crate::blocks::{times, transposed_times};
use crate::state::{ATTITUDE, POSITION};
use crate::world::WorldModel;

/// One range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LblModel {
    /// Measured slant range, m.
    pub range: f64,
    /// Buoy at the emission instant, m.
    pub buoy_enu: Vector3<f64>,
    /// 1-sigma per axis of that position, m.
    pub buoy_sigma: f64,
    /// From the IMU to the transducer, m.
    pub lever_arm_body: Vector3<f64>,
    /// κ, relative error of the assumed sound speed; 0 unless it is estimated.
    pub range_scale: f64,
    /// 1-sigma of the range, m.
    pub sigma: f64,
}

impl LblModel {
    /// A range to a buoy at `buoy_enu`, known to `buoy_sigma` per axis, with the vehicle's sigma and lever arm.
    pub fn new(range: f64, buoy_enu: [f64; 3], buoy_sigma: f64, lbl: &Lbl) -> LblModel {
        LblModel {
            range,
            buoy_enu: Vector3::from(buoy_enu),
            buoy_sigma,
            lever_arm_body: Vector3::from(lbl.lever_arm_body),
            range_scale: 0.0,
            sigma: lbl.sigma,
        }
    }

    /// ρ and u: distance from the buoy to the transducer and its direction. On the buoy itself the direction is zero.
    pub fn distance_and_direction(&self, pose: &Pose) -> (f64, Vector3<f64>) {
        let from_buoy = pose.position_enu + times(&pose.r_enu_body, &self.lever_arm_body) - self.buoy_enu;
        let distance = from_buoy.norm();
        (distance, if distance > 0.0 { from_buoy / distance } else { Vector3::zeros() })
    }
}

impl SensorModel<1> for LblModel {
    /// R_z is σ² + uᵀΣ_B u, with the buoy's covariance equal in all axes.
    fn see(&self, pose: &Pose, _world: &WorldModel) -> Seen<1> {
        let (distance, direction) = self.distance_and_direction(pose);
        let by_position = direction * (1.0 + self.range_scale);
        let mut jacobian = SMatrix::<f64, 1, 9>::zeros();
        jacobian.fixed_columns_mut::<3>(POSITION).copy_from(&by_position.transpose());
        let by_attitude = self.lever_arm_body.cross(&transposed_times(&pose.r_enu_body, &by_position));
        jacobian.fixed_columns_mut::<3>(ATTITUDE).copy_from(&by_attitude.transpose());
        let buoy = (1.0 + self.range_scale) * self.buoy_sigma;
        Seen {
            residual: Vector1::new((1.0 + self.range_scale) * distance - self.range),
            jacobian,
            covariance: SMatrix::<f64, 1, 1>::new(self.sigma * self.sigma + buoy * buoy),
        }
    }

    /// κ: ρ.
    fn calibration_jacobian(&self, residual: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new((residual.x + self.range) / (1.0 + self.range_scale))
    }
}
