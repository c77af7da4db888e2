//! Satellite positions (GNSS): the antenna in the local frame (§3.4 of the method).
//!
//! ```text
//! residual = p + R l − antenna                                                    [m], 3 rows
//! H = [I | 0 | −R[l]×],   R_z = C_loc diag(σe², σn², σu²) C_locᵀ
//! ```
//!
//! The paper has neither lever arm nor curvature. The reported sigmas are along east, north and up **at the fix**; C_loc
//! turns them to the axes of the origin. When a component was not reported (infinite sigma) the rows are taken along those
//! local axes instead, and the missing one is a row of zeros with unit variance: it says nothing and weighs nothing.

use nalgebra::{Matrix3, SMatrix, Vector3};
use shared_types::Gnss;

use crate::anchored::{Pose, Seen, SensorModel};
use crate::blocks::{product, product_with_skew};
use crate::state::{ATTITUDE, POSITION};
use crate::world::WorldModel;

/// One fix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssModel {
    /// Measured antenna position, m, ENU through ECEF.
    pub antenna_enu: Vector3<f64>,
    /// From the IMU to the antenna, m.
    pub lever_arm_body: Vector3<f64>,
    /// Turns the ENU difference to the rows; the identity when all three components are there.
    r_rows_enu: Matrix3<f64>,
    covariance: Matrix3<f64>,
    components: usize,
}

impl GnssModel {
    /// A fix with its 1-sigmas along local east, north, up; an infinite one marks a component that was not reported.
    pub fn new(antenna_enu: [f64; 3], sigma_enu: [f64; 3], gnss: &Gnss, world: &WorldModel) -> GnssModel {
        let antenna_enu = Vector3::from(antenna_enu);
        let lever_arm_body = Vector3::from(gnss.lever_arm_body);
        let r_enu_local = world.frame.local_axes_at(&antenna_enu);
        let variance = Vector3::from(sigma_enu.map(|sigma| sigma * sigma));
        let components = sigma_enu.iter().filter(|sigma| sigma.is_finite()).count();
        let (r_rows_enu, covariance) = if components == 3 {
            (Matrix3::identity(), r_enu_local * Matrix3::from_diagonal(&variance) * r_enu_local.transpose())
        } else {
            let reported = variance.map(|v| if v.is_finite() { 1.0 } else { 0.0 });
            let along_rows = variance.map(|v| if v.is_finite() { v } else { 1.0 });
            (Matrix3::from_diagonal(&reported) * r_enu_local.transpose(), Matrix3::from_diagonal(&along_rows))
        };
        GnssModel { antenna_enu, lever_arm_body, r_rows_enu, covariance, components }
    }

    /// How many components were reported: the degrees of freedom of a test on the residual.
    pub fn components(&self) -> usize {
        self.components
    }
}

impl SensorModel<3> for GnssModel {
    fn see(&self, pose: &Pose, _world: &WorldModel) -> Seen<3> {
        let antenna_enu = pose.position_enu + pose.r_enu_body * self.lever_arm_body;
        let mut jacobian = SMatrix::<f64, 3, 9>::zeros();
        jacobian.fixed_columns_mut::<3>(POSITION).copy_from(&self.r_rows_enu);
        let by_attitude = -product_with_skew(&product(&self.r_rows_enu, &pose.r_enu_body), &self.lever_arm_body);
        jacobian.fixed_columns_mut::<3>(ATTITUDE).copy_from(&by_attitude);
        Seen { residual: self.r_rows_enu * (antenna_enu - self.antenna_enu), jacobian, covariance: self.covariance }
    }
}
