//! Covariance of an increment, kept by its 3 × 3 blocks.
//!
//! One step of the recursion is, for the errors, with the force error `f` in the middle (§2.2):
//!
//! ```text
//! f  = F_φ φ + F_a b̃_a + F_g b̃_g          b̃ = bias change so far + white noise of the step
//! α' = α + dt β + ½dt² f,   β' = β + dt f,   φ' = Exp(θ)ᵀφ − J_r dt b̃_g
//! ```
//!
//! so all of `[A B; 0 I] P [A B; 0 I]ᵀ + B N Bᵀ` follows from the covariances of `f`: some twenty products of 3 × 3 blocks in
//! place of two of 15 × 15. The bias changes are independent of each other and equal in all axes (two numbers), and φ
//! never meets b_a.

use nalgebra::{Matrix3, SMatrix};

use super::BiasJacobian;
use crate::blocks::{product, product_transposed};

/// One step of the recursion, linearised.
pub(super) struct StepModel {
    pub(super) dt: f64,
    /// F_φ.
    pub(super) force_by_phi: Matrix3<f64>,
    /// F_g.
    pub(super) force_by_gyro: Matrix3<f64>,
    /// F_a.
    pub(super) force_by_accel: Matrix3<f64>,
    /// Exp(θ)ᵀ.
    pub(super) turn_transposed: Matrix3<f64>,
    /// −J_r(θ)·dt.
    pub(super) phi_by_gyro: Matrix3<f64>,
}

impl StepModel {
    /// D ← A D + B.
    #[inline(always)]
    pub(super) fn step_jacobian(&self, d: &mut BiasJacobian) {
        let (dt, half_dt_squared) = (self.dt, 0.5 * self.dt * self.dt);
        let force_gyro = product(&self.force_by_phi, &d.phi_gyro) + self.force_by_gyro;
        d.alpha_accel += d.beta_accel * dt + self.force_by_accel * half_dt_squared;
        d.alpha_gyro += d.beta_gyro * dt + force_gyro * half_dt_squared;
        d.beta_accel += self.force_by_accel * dt;
        d.beta_gyro += force_gyro * dt;
        d.phi_gyro = product(&self.turn_transposed, &d.phi_gyro) + self.phi_by_gyro;
    }
}

/// P15 by blocks; `accel` and `gyro` are the changes of the biases over the run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CovarianceBlocks {
    pub(crate) alpha_alpha: Matrix3<f64>,
    pub(crate) alpha_beta: Matrix3<f64>,
    pub(crate) alpha_phi: Matrix3<f64>,
    pub(crate) beta_beta: Matrix3<f64>,
    pub(crate) beta_phi: Matrix3<f64>,
    pub(crate) phi_phi: Matrix3<f64>,
    pub(crate) alpha_accel: Matrix3<f64>,
    pub(crate) alpha_gyro: Matrix3<f64>,
    pub(crate) beta_accel: Matrix3<f64>,
    pub(crate) beta_gyro: Matrix3<f64>,
    pub(crate) phi_gyro: Matrix3<f64>,
    /// Variance per axis.
    pub(crate) accel_walk: f64,
    /// Variance per axis.
    pub(crate) gyro_walk: f64,
}

impl CovarianceBlocks {
    pub(crate) fn zeros() -> CovarianceBlocks {
        let zero = Matrix3::zeros();
        CovarianceBlocks {
            alpha_alpha: zero,
            alpha_beta: zero,
            alpha_phi: zero,
            beta_beta: zero,
            beta_phi: zero,
            phi_phi: zero,
            alpha_accel: zero,
            alpha_gyro: zero,
            beta_accel: zero,
            beta_gyro: zero,
            phi_gyro: zero,
            accel_walk: 0.0,
            gyro_walk: 0.0,
        }
    }

    /// One step; `accel_noise` and `gyro_noise` are the variances of the white noise averaged over it. The walk of the
    /// biases during the step is added by the caller, afterwards.
    #[inline(always)]
    pub(super) fn step(&mut self, model: &StepModel, accel_noise: f64, gyro_noise: f64) {
        let StepModel { dt, force_by_phi, force_by_gyro, force_by_accel, turn_transposed, phi_by_gyro } = model;
        let (dt, half) = (*dt, 0.5 * dt * dt);
        let turn = turn_transposed.transpose();

        // Of f with what was there before the step.
        let f_alpha = product_transposed(force_by_phi, &self.alpha_phi)
            + product_transposed(force_by_accel, &self.alpha_accel)
            + product_transposed(force_by_gyro, &self.alpha_gyro);
        let f_beta = product_transposed(force_by_phi, &self.beta_phi)
            + product_transposed(force_by_accel, &self.beta_accel)
            + product_transposed(force_by_gyro, &self.beta_gyro);
        let f_phi = product(force_by_phi, &self.phi_phi) + product_transposed(force_by_gyro, &self.phi_gyro);
        let phi_to_f_gyro = product(force_by_phi, &self.phi_gyro);
        let f_accel = force_by_accel * self.accel_walk;
        let f_gyro = phi_to_f_gyro + force_by_gyro * self.gyro_walk;
        let f_noisy_accel = force_by_accel * (self.accel_walk + accel_noise);
        let f_noisy_gyro = phi_to_f_gyro + force_by_gyro * (self.gyro_walk + gyro_noise);
        let f_f = product_transposed(&f_phi, force_by_phi)
            + product_transposed(&f_noisy_accel, force_by_accel)
            + product_transposed(&f_noisy_gyro, force_by_gyro);

        // Of the new φ with the rest.
        let alpha_new_phi = product(&self.alpha_phi, &turn) + product_transposed(&self.alpha_gyro, phi_by_gyro);
        let beta_new_phi = product(&self.beta_phi, &turn) + product_transposed(&self.beta_gyro, phi_by_gyro);
        let f_new_phi = product(&f_phi, &turn) + product_transposed(&f_noisy_gyro, phi_by_gyro);
        let turned_phi_gyro = product(turn_transposed, &self.phi_gyro);
        let new_phi_phi = product(turn_transposed, &self.phi_phi) + product_transposed(phi_by_gyro, &self.phi_gyro);
        let new_phi_noisy_gyro = turned_phi_gyro + phi_by_gyro * (self.gyro_walk + gyro_noise);
        self.phi_phi = product(&new_phi_phi, &turn) + product_transposed(&new_phi_noisy_gyro, phi_by_gyro);

        // Old β before β, old α before α.
        let alpha_f = f_alpha.transpose();
        let beta_f = f_beta.transpose();
        let alpha_beta_dt = self.alpha_beta * dt;
        let alpha_f_plus = (alpha_f + beta_f * dt) * half;
        self.alpha_alpha += alpha_beta_dt
            + alpha_beta_dt.transpose()
            + self.beta_beta * (dt * dt)
            + alpha_f_plus
            + alpha_f_plus.transpose()
            + f_f * (half * half);
        self.alpha_beta += self.beta_beta * dt + (alpha_f + beta_f * dt) * dt + f_beta * half + f_f * (half * dt);
        self.beta_beta += (f_beta + beta_f) * dt + f_f * (dt * dt);
        self.alpha_phi = alpha_new_phi + beta_new_phi * dt + f_new_phi * half;
        self.beta_phi = beta_new_phi + f_new_phi * dt;
        self.alpha_accel += self.beta_accel * dt + f_accel * half;
        self.alpha_gyro += self.beta_gyro * dt + f_gyro * half;
        self.beta_accel += f_accel * dt;
        self.beta_gyro += f_gyro * dt;
        self.phi_gyro = turned_phi_gyro + phi_by_gyro * self.gyro_walk;
    }

    pub(crate) fn assemble_increment(&self) -> SMatrix<f64, 9, 9> {
        let mut p = SMatrix::<f64, 9, 9>::zeros();
        let mut put = |row: usize, column: usize, block: &Matrix3<f64>| {
            p.fixed_view_mut::<3, 3>(row, column).copy_from(block);
            if row != column {
                p.fixed_view_mut::<3, 3>(column, row).copy_from(&block.transpose());
            }
        };
        put(0, 0, &symmetric(&self.alpha_alpha));
        put(0, 3, &self.alpha_beta);
        put(0, 6, &self.alpha_phi);
        put(3, 3, &symmetric(&self.beta_beta));
        put(3, 6, &self.beta_phi);
        put(6, 6, &symmetric(&self.phi_phi));
        p
    }

    pub(crate) fn assemble_cross(&self) -> SMatrix<f64, 9, 6> {
        let mut cross = SMatrix::<f64, 9, 6>::zeros();
        cross.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.alpha_accel);
        cross.fixed_view_mut::<3, 3>(0, 3).copy_from(&self.alpha_gyro);
        cross.fixed_view_mut::<3, 3>(3, 0).copy_from(&self.beta_accel);
        cross.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.beta_gyro);
        cross.fixed_view_mut::<3, 3>(6, 3).copy_from(&self.phi_gyro);
        cross
    }

    pub(crate) fn assemble(&self) -> SMatrix<f64, 15, 15> {
        let mut p = SMatrix::<f64, 15, 15>::zeros();
        let cross = self.assemble_cross();
        p.fixed_view_mut::<9, 9>(0, 0).copy_from(&self.assemble_increment());
        p.fixed_view_mut::<9, 6>(0, 9).copy_from(&cross);
        p.fixed_view_mut::<6, 9>(9, 0).copy_from(&cross.transpose());
        for axis in 0..3 {
            p[(9 + axis, 9 + axis)] = self.accel_walk;
            p[(12 + axis, 12 + axis)] = self.gyro_walk;
        }
        p
    }
}

/// ½(M + Mᵀ): rounding leaves the diagonal blocks a little unsymmetric.
#[inline]
pub(crate) fn symmetric(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    (matrix + matrix.transpose()) * 0.5
}
