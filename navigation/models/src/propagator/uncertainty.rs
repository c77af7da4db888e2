//! Covariance of position, velocity and attitude at the newest sample.
//!
//! The 3 × 3 diagonal blocks of `T_j C T_jᵀ + L P Lᵀ` (§2.6 of the method), row of blocks by row of blocks. The increment ran
//! at the biases of the solution, so its corrections are zero and J_r(c) = I.

use nalgebra::{Matrix3, SMatrix};
use nav_geometry::so3;

use crate::blocks::{
    block_of, product, product_transposed, product_with_skew, sandwich, skew_product, times, transposed_product,
};
use crate::preintegration::Preintegration;
use crate::state::{ACCEL_BIAS, ATTITUDE, ERROR_DIM, GYRO_BIAS, POSITION, VELOCITY};
use crate::wide;
use crate::world::WorldModel;

/// Diagonal blocks of the covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Uncertainty {
    /// m², ENU.
    pub(super) position: Matrix3<f64>,
    /// m²/s², ENU.
    pub(super) velocity: Matrix3<f64>,
    /// rad², body axes.
    pub(super) attitude: Matrix3<f64>,
}

/// A row of blocks of T_j, written as the columns that multiply C: 15 × 3.
type Row = SMatrix<f64, ERROR_DIM, 3>;

impl Uncertainty {
    pub(super) fn carried(
        covariance: &SMatrix<f64, ERROR_DIM, ERROR_DIM>,
        r_enu_body: &Matrix3<f64>,
        increment: &Preintegration,
        world: &WorldModel,
    ) -> Uncertainty {
        let dt = increment.dt_total;
        let turn_back = so3::exp(&(world.earth_rate_enu * -dt));
        let turning = |block: &Matrix3<f64>| skew_product(&world.earth_rate_enu, block);
        let k = product(&turn_back, r_enu_body);
        let d = &increment.bias_jacobian;
        let p = &increment.blocks;

        let by_velocity = turn_back * dt;
        let by_attitude = -product_with_skew(&k, &increment.alpha);
        let by_accel = product(&k, &d.alpha_accel);
        let by_gyro = product(&k, &d.alpha_gyro);
        let mut position_row = Row::zeros();
        let mut put = |at: usize, block: Matrix3<f64>| {
            position_row.fixed_rows_mut::<3>(at).copy_from(&block.transpose());
        };
        put(POSITION, Matrix3::identity());
        put(VELOCITY, by_velocity);
        put(ATTITUDE, by_attitude);
        put(ACCEL_BIAS, by_accel);
        put(GYRO_BIAS, by_gyro);

        let mut velocity_row = Row::zeros();
        let mut put = |at: usize, block: Matrix3<f64>| {
            velocity_row.fixed_rows_mut::<3>(at).copy_from(&block.transpose());
        };
        put(VELOCITY, turn_back - turning(&by_velocity));
        put(ATTITUDE, -product_with_skew(&k, &increment.beta) - turning(&by_attitude));
        put(ACCEL_BIAS, product(&k, &d.beta_accel) - turning(&by_accel));
        put(GYRO_BIAS, product(&k, &d.beta_gyro) - turning(&by_gyro));

        // L: position noise Kα, velocity noise Kβ − [ω]×Kα.
        let seen = |block: &Matrix3<f64>| product_transposed(&product(&k, block), &k);
        let position_noise = seen(&p.alpha_alpha);
        let mixed_noise = turning(&seen(&p.alpha_beta));
        let turned_noise = turning(&turning(&position_noise).transpose()).transpose();
        let velocity_noise = seen(&p.beta_beta) - mixed_noise - mixed_noise.transpose() + turned_noise;

        let attitude_block = block_of(covariance, ATTITUDE, ATTITUDE);
        let attitude_gyro = block_of(covariance, ATTITUDE, GYRO_BIAS);
        let gyro_block = block_of(covariance, GYRO_BIAS, GYRO_BIAS);
        let mixed = product_transposed(&transposed_product(&increment.gamma, &attitude_gyro), &d.phi_gyro);
        let attitude = product(&transposed_product(&increment.gamma, &attitude_block), &increment.gamma)
            + mixed
            + mixed.transpose()
            + product_transposed(&product(&d.phi_gyro, &gyro_block), &d.phi_gyro)
            + p.phi_phi;
        Uncertainty {
            position: wide!(sandwich(&position_row, covariance)) + position_noise,
            velocity: wide!(sandwich(&velocity_row, covariance)) + velocity_noise,
            attitude,
        }
    }

    /// 1-sigma about body x, body y and the up axis, rad.
    pub(super) fn sigma_rpy(&self, r_enu_body: &Matrix3<f64>) -> [f64; 3] {
        let up_body = r_enu_body.row(2).transpose();
        let about_up = up_body.dot(&times(&self.attitude, &up_body));
        [self.attitude[(0, 0)], self.attitude[(1, 1)], about_up].map(|variance| variance.max(0.0).sqrt())
    }

    pub(super) fn is_finite(&self) -> bool {
        [&self.position, &self.velocity, &self.attitude].iter().all(|block| block.iter().all(|x| x.is_finite()))
    }
}

/// ee, en, eu, nn, nu, uu.
pub(super) fn upper_triangle(matrix: &Matrix3<f64>) -> [f64; 6] {
    [matrix[(0, 0)], matrix[(0, 1)], matrix[(0, 2)], matrix[(1, 1)], matrix[(1, 2)], matrix[(2, 2)]]
}
