//! Increments put together, taken apart and turned round, without touching samples again (§2.3).
//!
//! For k → j → e, with `Φ` and `Ψ` of the first and second piece:
//!
//! ```text
//! α_ke = α_kj + β_kj T + γ_kj α_je     β_ke = β_kj + γ_kj β_je     γ_ke = γ_kj γ_je       T = T_je, signed
//! Φ = [I  IT  −γ_kj[α_je]×;  0  I  −γ_kj[β_je]×;  0  0  γ_jeᵀ]      Ψ = diag(γ_kj, γ_kj, I)
//! D_ke = Φ D_kj + Ψ D_je        P_ke = Φ15 P_kj Φ15ᵀ + Ψ15 P_je Ψ15ᵀ,   Φ15 = [Φ  ΨD_je; 0  I]
//! ```
//!
//! The quotient solves this for j → e. The reversal `V` is that of §2.3; the walk of the biases is kept in it too: the
//! forward error is counted from the bias at the start, the backward one from the bias at the end, hence
//! `ξ_b = V(ξ_f − D_f w)` with `w` the change of the biases.

use nalgebra::{Matrix3, SMatrix, Vector3};

use nav_geometry::so3::skew;

use crate::blocks::{product, product_with_skew, skew_product, times};

use super::covariance::{CovarianceBlocks, symmetric};
use super::{BiasJacobian, Increment, Preintegration};

/// Φ and ΨD_je of a composition, by the blocks that are neither zero nor identity.
struct Carry {
    /// T of the second piece.
    dt: f64,
    /// −γ_kj[α_je]×.
    alpha_by_phi: Matrix3<f64>,
    /// −γ_kj[β_je]×.
    beta_by_phi: Matrix3<f64>,
    /// γ_jeᵀ.
    phi_by_phi: Matrix3<f64>,
    /// ΨD_je.
    bias: BiasJacobian,
}

impl Carry {
    /// Over a second piece with this time and mean, after a first with this γ; ΨD of the second is left empty.
    fn of(gamma_kj: &Matrix3<f64>, dt: f64, alpha: &Vector3<f64>, beta: &Vector3<f64>, gamma: &Matrix3<f64>) -> Carry {
        Carry {
            dt,
            alpha_by_phi: -product_with_skew(gamma_kj, alpha),
            beta_by_phi: -product_with_skew(gamma_kj, beta),
            phi_by_phi: gamma.transpose(),
            bias: BiasJacobian::zeros(),
        }
    }

    /// Φ15 P Φ15ᵀ.
    fn covariance(&self, p: &CovarianceBlocks) -> CovarianceBlocks {
        let d = &self.bias;
        // Rows of Φ15 P, then columns: each new error is a sum over (α, β, φ, b_a, b_g) of the first piece.
        let phi_gyro = self.phi_by_phi * p.phi_gyro + d.phi_gyro * p.gyro_walk;
        let beta_accel = p.beta_accel + d.beta_accel * p.accel_walk;
        let beta_gyro = p.beta_gyro + self.beta_by_phi * p.phi_gyro + d.beta_gyro * p.gyro_walk;
        let alpha_accel = p.alpha_accel + p.beta_accel * self.dt + d.alpha_accel * p.accel_walk;
        let alpha_gyro =
            p.alpha_gyro + p.beta_gyro * self.dt + self.alpha_by_phi * p.phi_gyro + d.alpha_gyro * p.gyro_walk;

        let new_phi_phi = self.phi_by_phi * p.phi_phi + d.phi_gyro * p.phi_gyro.transpose();
        let new_beta_phi = p.beta_phi + self.beta_by_phi * p.phi_phi + d.beta_gyro * p.phi_gyro.transpose();
        let new_alpha_phi =
            p.alpha_phi + p.beta_phi * self.dt + self.alpha_by_phi * p.phi_phi + d.alpha_gyro * p.phi_gyro.transpose();
        let new_beta_beta = p.beta_beta
            + self.beta_by_phi * p.beta_phi.transpose()
            + d.beta_accel * p.beta_accel.transpose()
            + d.beta_gyro * p.beta_gyro.transpose();
        let new_alpha_beta = p.alpha_beta
            + p.beta_beta * self.dt
            + self.alpha_by_phi * p.beta_phi.transpose()
            + d.alpha_accel * p.beta_accel.transpose()
            + d.alpha_gyro * p.beta_gyro.transpose();
        let new_alpha_alpha = p.alpha_alpha
            + p.alpha_beta.transpose() * self.dt
            + self.alpha_by_phi * p.alpha_phi.transpose()
            + d.alpha_accel * p.alpha_accel.transpose()
            + d.alpha_gyro * p.alpha_gyro.transpose();

        CovarianceBlocks {
            alpha_alpha: new_alpha_alpha
                + new_alpha_beta * self.dt
                + new_alpha_phi * self.alpha_by_phi.transpose()
                + alpha_accel * d.alpha_accel.transpose()
                + alpha_gyro * d.alpha_gyro.transpose(),
            alpha_beta: new_alpha_beta
                + new_alpha_phi * self.beta_by_phi.transpose()
                + alpha_accel * d.beta_accel.transpose()
                + alpha_gyro * d.beta_gyro.transpose(),
            alpha_phi: new_alpha_phi * self.phi_by_phi.transpose() + alpha_gyro * d.phi_gyro.transpose(),
            beta_beta: new_beta_beta
                + new_beta_phi * self.beta_by_phi.transpose()
                + beta_accel * d.beta_accel.transpose()
                + beta_gyro * d.beta_gyro.transpose(),
            beta_phi: new_beta_phi * self.phi_by_phi.transpose() + beta_gyro * d.phi_gyro.transpose(),
            phi_phi: new_phi_phi * self.phi_by_phi.transpose() + phi_gyro * d.phi_gyro.transpose(),
            alpha_accel,
            alpha_gyro,
            beta_accel,
            beta_gyro,
            phi_gyro,
            accel_walk: p.accel_walk,
            gyro_walk: p.gyro_walk,
        }
    }

    /// Φ D.
    fn jacobian(&self, d: &BiasJacobian) -> BiasJacobian {
        BiasJacobian {
            alpha_accel: d.alpha_accel + d.beta_accel * self.dt,
            alpha_gyro: d.alpha_gyro + d.beta_gyro * self.dt + product(&self.alpha_by_phi, &d.phi_gyro),
            beta_accel: d.beta_accel,
            beta_gyro: d.beta_gyro + product(&self.beta_by_phi, &d.phi_gyro),
            phi_gyro: product(&self.phi_by_phi, &d.phi_gyro),
        }
    }
}

impl BiasJacobian {
    /// diag(R, R, I)·D.
    fn rotated(&self, r: &Matrix3<f64>) -> BiasJacobian {
        BiasJacobian {
            alpha_accel: product(r, &self.alpha_accel),
            alpha_gyro: product(r, &self.alpha_gyro),
            beta_accel: product(r, &self.beta_accel),
            beta_gyro: product(r, &self.beta_gyro),
            phi_gyro: self.phi_gyro,
        }
    }

    fn zip(&self, other: &BiasJacobian, f: impl Fn(&Matrix3<f64>, &Matrix3<f64>) -> Matrix3<f64>) -> BiasJacobian {
        BiasJacobian {
            alpha_accel: f(&self.alpha_accel, &other.alpha_accel),
            alpha_gyro: f(&self.alpha_gyro, &other.alpha_gyro),
            beta_accel: f(&self.beta_accel, &other.beta_accel),
            beta_gyro: f(&self.beta_gyro, &other.beta_gyro),
            phi_gyro: f(&self.phi_gyro, &other.phi_gyro),
        }
    }
}

impl CovarianceBlocks {
    /// diag(R, R, I, I, I)·P·diag(…)ᵀ.
    fn rotated(&self, r: &Matrix3<f64>) -> CovarianceBlocks {
        let r_transposed = r.transpose();
        CovarianceBlocks {
            alpha_alpha: r * self.alpha_alpha * r_transposed,
            alpha_beta: r * self.alpha_beta * r_transposed,
            alpha_phi: r * self.alpha_phi,
            beta_beta: r * self.beta_beta * r_transposed,
            beta_phi: r * self.beta_phi,
            phi_phi: self.phi_phi,
            alpha_accel: r * self.alpha_accel,
            alpha_gyro: r * self.alpha_gyro,
            beta_accel: r * self.beta_accel,
            beta_gyro: r * self.beta_gyro,
            phi_gyro: self.phi_gyro,
            accel_walk: self.accel_walk,
            gyro_walk: self.gyro_walk,
        }
    }

    /// `self + sign·other`.
    fn plus(&self, other: &CovarianceBlocks, sign: f64) -> CovarianceBlocks {
        CovarianceBlocks {
            alpha_alpha: self.alpha_alpha + other.alpha_alpha * sign,
            alpha_beta: self.alpha_beta + other.alpha_beta * sign,
            alpha_phi: self.alpha_phi + other.alpha_phi * sign,
            beta_beta: self.beta_beta + other.beta_beta * sign,
            beta_phi: self.beta_phi + other.beta_phi * sign,
            phi_phi: self.phi_phi + other.phi_phi * sign,
            alpha_accel: self.alpha_accel + other.alpha_accel * sign,
            alpha_gyro: self.alpha_gyro + other.alpha_gyro * sign,
            beta_accel: self.beta_accel + other.beta_accel * sign,
            beta_gyro: self.beta_gyro + other.beta_gyro * sign,
            phi_gyro: self.phi_gyro + other.phi_gyro * sign,
            accel_walk: self.accel_walk + other.accel_walk * sign,
            gyro_walk: self.gyro_walk + other.gyro_walk * sign,
        }
    }

    /// The same errors counted from the bias at the end: of `(ξ − D w, w)`.
    fn counted_from_the_end(&self, d: &BiasJacobian) -> CovarianceBlocks {
        let alpha_accel = self.alpha_accel - d.alpha_accel * self.accel_walk;
        let alpha_gyro = self.alpha_gyro - d.alpha_gyro * self.gyro_walk;
        let beta_accel = self.beta_accel - d.beta_accel * self.accel_walk;
        let beta_gyro = self.beta_gyro - d.beta_gyro * self.gyro_walk;
        let phi_gyro = self.phi_gyro - d.phi_gyro * self.gyro_walk;
        // Cov(ξ−Dw, ξ'−D'w) = Cov(ξ, ξ') − D Cov(w, ξ') − Cov(ξ−Dw, w) D'ᵀ
        CovarianceBlocks {
            alpha_alpha: self.alpha_alpha
                - d.alpha_accel * self.alpha_accel.transpose()
                - d.alpha_gyro * self.alpha_gyro.transpose()
                - alpha_accel * d.alpha_accel.transpose()
                - alpha_gyro * d.alpha_gyro.transpose(),
            alpha_beta: self.alpha_beta
                - d.alpha_accel * self.beta_accel.transpose()
                - d.alpha_gyro * self.beta_gyro.transpose()
                - alpha_accel * d.beta_accel.transpose()
                - alpha_gyro * d.beta_gyro.transpose(),
            alpha_phi: self.alpha_phi - d.alpha_gyro * self.phi_gyro.transpose() - alpha_gyro * d.phi_gyro.transpose(),
            beta_beta: self.beta_beta
                - d.beta_accel * self.beta_accel.transpose()
                - d.beta_gyro * self.beta_gyro.transpose()
                - beta_accel * d.beta_accel.transpose()
                - beta_gyro * d.beta_gyro.transpose(),
            beta_phi: self.beta_phi - d.beta_gyro * self.phi_gyro.transpose() - beta_gyro * d.phi_gyro.transpose(),
            phi_phi: self.phi_phi - d.phi_gyro * self.phi_gyro.transpose() - phi_gyro * d.phi_gyro.transpose(),
            alpha_accel,
            alpha_gyro,
            beta_accel,
            beta_gyro,
            phi_gyro,
            accel_walk: self.accel_walk,
            gyro_walk: self.gyro_walk,
        }
    }
}

impl Increment {
    /// The increment j → e of a run, from its prefix k → j and the whole k → e.
    #[must_use]
    pub fn between_prefixes(prefix_kj: &Increment, whole_ke: &Increment) -> Increment {
        let dt = whole_ke.dt_total - prefix_kj.dt_total;
        let r_j_k = prefix_kj.gamma.transpose();
        let alpha = times(&r_j_k, &(whole_ke.alpha - prefix_kj.alpha - prefix_kj.beta * dt));
        let beta = times(&r_j_k, &(whole_ke.beta - prefix_kj.beta));
        let gamma = product(&r_j_k, &whole_ke.gamma);
        let carry = Carry::of(&prefix_kj.gamma, dt, &alpha, &beta, &gamma);
        let bias =
            whole_ke.bias_jacobian.zip(&carry.jacobian(&prefix_kj.bias_jacobian), |whole, carried| whole - carried);
        Increment {
            dt_total: dt,
            alpha,
            beta,
            gamma,
            accel_bias: whole_ke.accel_bias,
            gyro_bias: whole_ke.gyro_bias,
            bias_jacobian: bias.rotated(&r_j_k),
        }
    }

    /// Φ15: what becomes of the error (α, β, φ, b_a, b_g) of a prefix k → j in the whole k → e of the same run,
    /// `ξ_ke = Φ15 ξ_kj + Ψ15 ξ_je`.
    #[must_use]
    pub fn error_carry(prefix_kj: &Increment, whole_ke: &Increment) -> SMatrix<f64, 15, 15> {
        let rest = Increment::between_prefixes(prefix_kj, whole_ke);
        let carry = Carry::of(&prefix_kj.gamma, rest.dt_total, &rest.alpha, &rest.beta, &rest.gamma);
        let bias = rest.bias_jacobian.rotated(&prefix_kj.gamma);
        let mut phi = SMatrix::<f64, 15, 15>::identity();
        let mut put = |row: usize, column: usize, block: &Matrix3<f64>| {
            phi.fixed_view_mut::<3, 3>(row, column).copy_from(block);
        };
        put(0, 3, &Matrix3::from_diagonal_element(rest.dt_total));
        put(0, 6, &carry.alpha_by_phi);
        put(3, 6, &carry.beta_by_phi);
        put(6, 6, &carry.phi_by_phi);
        put(0, 9, &bias.alpha_accel);
        put(0, 12, &bias.alpha_gyro);
        put(3, 9, &bias.beta_accel);
        put(3, 12, &bias.beta_gyro);
        put(6, 12, &bias.phi_gyro);
        phi
    }

    /// The same stretch run the other way: of k → j the increment j → k, with `dt_total` negated.
    #[must_use]
    pub fn reversed(&self) -> Increment {
        let dt = self.dt_total;
        let r_end_start = self.gamma.transpose();
        let beta = -times(&r_end_start, &self.beta);
        let alpha = times(&r_end_start, &(self.beta * dt - self.alpha));
        let d = &self.bias_jacobian;
        let bias_jacobian = BiasJacobian {
            alpha_accel: product(&r_end_start, &(d.beta_accel * dt - d.alpha_accel)),
            alpha_gyro: product(&r_end_start, &(d.beta_gyro * dt - d.alpha_gyro)) + skew_product(&alpha, &d.phi_gyro),
            beta_accel: -product(&r_end_start, &d.beta_accel),
            beta_gyro: -product(&r_end_start, &d.beta_gyro) + skew_product(&beta, &d.phi_gyro),
            phi_gyro: -product(&self.gamma, &d.phi_gyro),
        };
        Increment {
            dt_total: -dt,
            alpha,
            beta,
            gamma: r_end_start,
            accel_bias: self.accel_bias,
            gyro_bias: self.gyro_bias,
            bias_jacobian,
        }
    }
}

impl Preintegration {
    /// `self` (k → j) followed by `next` (j → e): the increment k → e. Both at the same biases.
    #[must_use]
    pub fn compose(&self, next: &Preintegration) -> Preintegration {
        let dt = next.dt_total;
        let bias = next.bias_jacobian.rotated(&self.gamma);
        let carry = Carry { bias, ..Carry::of(&self.gamma, dt, &next.alpha, &next.beta, &next.gamma) };
        let increment = Increment {
            dt_total: self.dt_total + dt,
            alpha: self.alpha + self.beta * dt + self.gamma * next.alpha,
            beta: self.beta + self.gamma * next.beta,
            gamma: self.gamma * next.gamma,
            accel_bias: self.accel_bias,
            gyro_bias: self.gyro_bias,
            bias_jacobian: carry.jacobian(&self.bias_jacobian).zip(&bias, |a, b| a + b),
        };
        Preintegration {
            increment,
            blocks: carry.covariance(&self.blocks).plus(&next.blocks.rotated(&self.gamma), 1.0),
        }
    }

    /// The piece j → e of a run, from its prefix k → j and the whole k → e.
    #[must_use]
    pub fn piece_from_prefixes(prefix_kj: &Preintegration, whole_ke: &Preintegration) -> Preintegration {
        let increment = Increment::between_prefixes(prefix_kj, whole_ke);
        let mut carry =
            Carry::of(&prefix_kj.gamma, increment.dt_total, &increment.alpha, &increment.beta, &increment.gamma);
        carry.bias = increment.bias_jacobian.rotated(&prefix_kj.gamma);
        let r_j_k = prefix_kj.gamma.transpose();
        let blocks = whole_ke.blocks.plus(&carry.covariance(&prefix_kj.blocks), -1.0).rotated(&r_j_k);
        Preintegration { increment, blocks }
    }

    /// The same stretch run the other way: of k → j the increment j → k, with `dt_total` negated.
    #[must_use]
    pub fn reversed(&self) -> Preintegration {
        let increment = self.increment.reversed();
        let (alpha_skew, beta_skew) = (skew(&increment.alpha), skew(&increment.beta));
        let counted = self.blocks.counted_from_the_end(&self.bias_jacobian);
        Preintegration { increment, blocks: counted.turned_round(self.dt_total, &self.gamma, &alpha_skew, &beta_skew) }
    }
}

impl CovarianceBlocks {
    /// V P Vᵀ with `V = [−γᵀ  γᵀT  [α_b]×;  0  −γᵀ  [β_b]×;  0  0  −γ]`, and the bias change negated.
    fn turned_round(
        &self,
        dt: f64,
        gamma: &Matrix3<f64>,
        alpha_skew: &Matrix3<f64>,
        beta_skew: &Matrix3<f64>,
    ) -> CovarianceBlocks {
        let p = self;
        let r = gamma.transpose();
        // Rows of V P.
        let alpha_row_alpha =
            r * (p.alpha_beta.transpose() * dt - p.alpha_alpha) + alpha_skew * p.alpha_phi.transpose();
        let alpha_row_beta = r * (p.beta_beta * dt - p.alpha_beta) + alpha_skew * p.beta_phi.transpose();
        let alpha_row_phi = r * (p.beta_phi * dt - p.alpha_phi) + alpha_skew * p.phi_phi;
        let beta_row_beta = beta_skew * p.beta_phi.transpose() - r * p.beta_beta;
        let beta_row_phi = beta_skew * p.phi_phi - r * p.beta_phi;
        let phi_row_phi = -(gamma * p.phi_phi);
        // Columns; Vᵀ has −γ, γT and −γᵀ where V has −γᵀ, γᵀT and −γ.
        let (alpha_skew_t, beta_skew_t) = (alpha_skew.transpose(), beta_skew.transpose());
        CovarianceBlocks {
            alpha_alpha: symmetric(&((alpha_row_beta * dt - alpha_row_alpha) * gamma + alpha_row_phi * alpha_skew_t)),
            alpha_beta: alpha_row_phi * beta_skew_t - alpha_row_beta * gamma,
            alpha_phi: -(alpha_row_phi * r),
            beta_beta: symmetric(&(beta_row_phi * beta_skew_t - beta_row_beta * gamma)),
            beta_phi: -(beta_row_phi * r),
            phi_phi: symmetric(&-(phi_row_phi * r)),
            alpha_accel: -(r * (p.beta_accel * dt - p.alpha_accel)),
            alpha_gyro: -(r * (p.beta_gyro * dt - p.alpha_gyro) + alpha_skew * p.phi_gyro),
            beta_accel: r * p.beta_accel,
            beta_gyro: r * p.beta_gyro - beta_skew * p.phi_gyro,
            phi_gyro: gamma * p.phi_gyro,
            accel_walk: p.accel_walk,
            gyro_walk: p.gyro_walk,
        }
    }
}
