//! IMU preintegration over a signed time, with bias Jacobians and covariance (§2.1, §2.2 of the method).
//!
//! ```text
//! θ  = (½(ω̃ᵢ + ω̃ᵢ₊₁) − b̂_g)·dt          γ' = γ·Exp(θ)
//! f̄  = ½(γ aᵢ + γ' aᵢ₊₁)                 aᵢ = f̃ᵢ − b̂_a
//! α' = α + β dt + ½ f̄ dt²                β' = β + f̄ dt
//! ```
//!
//! The midpoint rule takes the same average whichever way time runs: with negative `dt` the same code is the backward
//! preintegration and the exact inverse of the forward one. (The paper's Euler form takes the sample before the interval
//! one way and the one after it the other way: its two directions are no inverses, and it is a thousand times coarser.)
//! Earth rate and gravity are not in here: [`mod@crate::transport`] adds them exactly.

mod covariance;
mod piece;
mod pieces;
#[cfg(test)]
mod tests;

use std::ops::{Deref, DerefMut};

use nalgebra::{Matrix3, SMatrix, Vector3};
use nav_geometry::so3;
use shared_types::ImuNoise;

use crate::blocks::{product, times};
use crate::gaps::Inflation;
use crate::wide;
use covariance::{CovarianceBlocks, StepModel};
pub use piece::{NoiseRows, Piece, Turned};

/// Bias changes that move an increment further than this, in rad and m/s, are beyond the first-order correction.
const REINTEGRATE_ANGLE: f64 = 1e-3;
const REINTEGRATE_VELOCITY: f64 = 5e-2;

/// A gap is bridged in so many steps along the line between its ends.
///
/// White noise that is one number over a step moves velocity and position together: the covariance of an interval that is nothing
/// but one step has no inverse, and where rounding makes it one, a keyframe after a gap is known to fractions of a millimetre. In so
/// many steps velocity and position part as white noise parts them, to one in n².
const BRIDGE_STEPS: u32 = 16;

/// What the IMU says at one instant, biases included.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImuPoint {
    /// Angular rate, rad/s.
    pub gyro_body: Vector3<f64>,
    /// Specific force, m/s².
    pub accel_body: Vector3<f64>,
}

impl ImuPoint {
    /// On the straight line from `first` (`fraction` 0) to `second` (1).
    #[inline]
    pub fn interpolate(first: &ImuPoint, second: &ImuPoint, fraction: f64) -> ImuPoint {
        ImuPoint {
            gyro_body: first.gyro_body + (second.gyro_body - first.gyro_body) * fraction,
            accel_body: first.accel_body + (second.accel_body - first.accel_body) * fraction,
        }
    }
}

/// ∂(α, β, φ)/∂(b_a, b_g) by blocks; φ does not depend on b_a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BiasJacobian {
    pub(crate) alpha_accel: Matrix3<f64>,
    pub(crate) alpha_gyro: Matrix3<f64>,
    pub(crate) beta_accel: Matrix3<f64>,
    pub(crate) beta_gyro: Matrix3<f64>,
    pub(crate) phi_gyro: Matrix3<f64>,
}

impl BiasJacobian {
    fn zeros() -> BiasJacobian {
        let zero = Matrix3::zeros();
        BiasJacobian { alpha_accel: zero, alpha_gyro: zero, beta_accel: zero, beta_gyro: zero, phi_gyro: zero }
    }
}

/// What IMU samples between two instants say, and how it depends on the biases: all that carries a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Increment {
    /// Signed length, s; negative when time ran backward.
    pub dt_total: f64,
    /// ∫(T−s)γf ds, m, axes of the body at the start.
    pub alpha: Vector3<f64>,
    /// ∫γf ds, m/s, axes of the body at the start.
    pub beta: Vector3<f64>,
    /// Rotation from the body at the end to the body at the start (Earth rate not removed).
    pub gamma: Matrix3<f64>,
    /// Accelerometer bias that was removed, m/s².
    pub accel_bias: Vector3<f64>,
    /// Gyroscope bias that was removed, rad/s.
    pub gyro_bias: Vector3<f64>,
    pub(crate) bias_jacobian: BiasJacobian,
}

/// An increment and its covariance. It reads as the [`Increment`] that it is; whoever keeps one for its mean alone keeps
/// that, which is a third of the memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preintegration {
    /// The increment itself.
    pub increment: Increment,
    pub(crate) blocks: CovarianceBlocks,
}

impl Deref for Preintegration {
    type Target = Increment;

    fn deref(&self) -> &Increment {
        &self.increment
    }
}

impl DerefMut for Preintegration {
    fn deref_mut(&mut self) -> &mut Increment {
        &mut self.increment
    }
}

/// An increment moved to other biases to first order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrectedIncrement {
    /// m.
    pub alpha: Vector3<f64>,
    /// m/s.
    pub beta: Vector3<f64>,
    /// γ̂·Exp(c).
    pub gamma: Matrix3<f64>,
    /// The rotation vector that corrected γ, rad.
    pub c: Vector3<f64>,
    /// J_r(c).
    pub right_jacobian: Matrix3<f64>,
}

impl Increment {
    /// That of no time, at no biases.
    fn none() -> Increment {
        Preintegration::new(Vector3::zeros(), Vector3::zeros()).increment
    }

    /// The increment at other biases, to first order.
    #[inline]
    pub fn corrected(&self, accel_bias: &Vector3<f64>, gyro_bias: &Vector3<f64>) -> CorrectedIncrement {
        let accel_change = accel_bias - self.accel_bias;
        let gyro_change = gyro_bias - self.gyro_bias;
        let d = &self.bias_jacobian;
        let c = times(&d.phi_gyro, &gyro_change);
        let (turn, right_jacobian) = so3::exp_and_right_jacobian(&c);
        CorrectedIncrement {
            alpha: self.alpha + times(&d.alpha_accel, &accel_change) + times(&d.alpha_gyro, &gyro_change),
            beta: self.beta + times(&d.beta_accel, &accel_change) + times(&d.beta_gyro, &gyro_change),
            gamma: product(&self.gamma, &turn),
            c,
            right_jacobian,
        }
    }

    /// Whether these biases are too far from those of the run for [`Increment::corrected`]: 1 mrad or 5 cm/s.
    pub fn needs_reintegration(&self, accel_bias: &Vector3<f64>, gyro_bias: &Vector3<f64>) -> bool {
        let span = self.dt_total.abs();
        (gyro_bias - self.gyro_bias).norm() * span > REINTEGRATE_ANGLE
            || (accel_bias - self.accel_bias).norm() * span > REINTEGRATE_VELOCITY
    }

    /// D = ∂(α, β, φ)/∂(b_a, b_g), 9 × 6.
    pub fn jacobian(&self) -> SMatrix<f64, 9, 6> {
        let d = &self.bias_jacobian;
        let mut jacobian = SMatrix::<f64, 9, 6>::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&d.alpha_accel);
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&d.alpha_gyro);
        jacobian.fixed_view_mut::<3, 3>(3, 0).copy_from(&d.beta_accel);
        jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&d.beta_gyro);
        jacobian.fixed_view_mut::<3, 3>(6, 3).copy_from(&d.phi_gyro);
        jacobian
    }
}

impl Preintegration {
    /// The empty increment, to be grown with samples from which these biases are removed.
    pub fn new(accel_bias: Vector3<f64>, gyro_bias: Vector3<f64>) -> Preintegration {
        let increment = Increment {
            dt_total: 0.0,
            alpha: Vector3::zeros(),
            beta: Vector3::zeros(),
            gamma: Matrix3::identity(),
            accel_bias,
            gyro_bias,
            bias_jacobian: BiasJacobian::zeros(),
        };
        Preintegration { increment, blocks: CovarianceBlocks::zeros() }
    }

    /// Adds the stretch from `first` to `second`, `dt_signed` seconds later (negative: earlier), with bias Jacobians and
    /// covariance. `inflation` is of the white noise densities: [`Inflation::NONE`], or more to bridge a gap.
    #[inline]
    pub fn step(
        &mut self,
        noise: &ImuNoise,
        dt_signed: f64,
        first: &ImuPoint,
        second: &ImuPoint,
        inflation: Inflation,
    ) {
        if dt_signed == 0.0 {
            return;
        }
        if inflation == Inflation::NONE {
            wide!(self.step_wide(noise, dt_signed, first, second, inflation));
        } else {
            self.bridge(noise, dt_signed, first, second, inflation);
        }
    }

    fn bridge(&mut self, noise: &ImuNoise, dt: f64, first: &ImuPoint, second: &ImuPoint, inflation: Inflation) {
        let at = |step: u32| ImuPoint::interpolate(first, second, f64::from(step) / f64::from(BRIDGE_STEPS));
        for step in 0..BRIDGE_STEPS {
            let (from, to) = (at(step), at(step + 1));
            wide!(self.step_wide(noise, dt / f64::from(BRIDGE_STEPS), &from, &to, inflation));
        }
    }

    #[inline(always)]
    fn step_wide(&mut self, noise: &ImuNoise, dt: f64, first: &ImuPoint, second: &ImuPoint, inflation: Inflation) {
        let angle = self.angle(dt, first, second);
        let (turn, right_jacobian) = so3::exp_and_right_jacobian(&angle);
        let accel_first = first.accel_body - self.accel_bias;
        let accel_second = second.accel_body - self.accel_bias;
        let gamma_next = product(&self.gamma, &turn);

        let turned_force_second = product(&gamma_next, &so3::skew(&accel_second));
        let model = StepModel {
            dt,
            // γ'[a]×Exp(θ)ᵀ = γ'Exp(θ)ᵀ·[Exp(θ)a]× = γ·[Exp(θ)a]×
            force_by_phi: product(&self.gamma, &so3::skew(&(accel_first + times(&turn, &accel_second)))) * -0.5,
            force_by_gyro: product(&turned_force_second, &right_jacobian) * (0.5 * dt),
            force_by_accel: (self.gamma + gamma_next) * -0.5,
            turn_transposed: turn.transpose(),
            phi_by_gyro: right_jacobian * -dt,
        };
        self.blocks.step(
            &model,
            noise.accel_noise_density * noise.accel_noise_density * (inflation.force * inflation.force / dt.abs()),
            noise.gyro_noise_density * noise.gyro_noise_density * (inflation.rate * inflation.rate / dt.abs()),
        );
        self.blocks.accel_walk += dt.abs() * noise.accel_bias_random_walk * noise.accel_bias_random_walk;
        self.blocks.gyro_walk += dt.abs() * noise.gyro_bias_random_walk * noise.gyro_bias_random_walk;
        model.step_jacobian(&mut self.increment.bias_jacobian);
        self.step_to(dt, gamma_next, &accel_first, &accel_second);
    }

    /// [`Preintegration::step`] without bias Jacobians and covariance.
    #[inline]
    pub fn step_mean(&mut self, dt_signed: f64, first: &ImuPoint, second: &ImuPoint) {
        let gamma_next = product(&self.gamma, &so3::exp(&self.angle(dt_signed, first, second)));
        let accel_first = first.accel_body - self.accel_bias;
        let accel_second = second.accel_body - self.accel_bias;
        self.step_to(dt_signed, gamma_next, &accel_first, &accel_second);
    }

    #[inline]
    fn angle(&self, dt: f64, first: &ImuPoint, second: &ImuPoint) -> Vector3<f64> {
        ((first.gyro_body + second.gyro_body) * 0.5 - self.gyro_bias) * dt
    }

    #[inline]
    fn step_to(&mut self, dt: f64, gamma_next: Matrix3<f64>, accel_first: &Vector3<f64>, accel_second: &Vector3<f64>) {
        let increment = &mut self.increment;
        let mean_force = (times(&increment.gamma, accel_first) + times(&gamma_next, accel_second)) * 0.5;
        increment.alpha += increment.beta * dt + mean_force * (0.5 * dt * dt);
        increment.beta += mean_force * dt;
        increment.gamma = gamma_next;
        increment.dt_total += dt;
    }

    /// Admits that the samples are worse than their noise says: adds these 1-sigmas, the same along every axis, to
    /// position (m), velocity (m/s) and attitude (rad) of the increment.
    pub fn loosen(&mut self, position: f64, velocity: f64, attitude: f64) {
        self.blocks.alpha_alpha += Matrix3::from_diagonal_element(position * position);
        self.blocks.beta_beta += Matrix3::from_diagonal_element(velocity * velocity);
        self.blocks.phi_phi += Matrix3::from_diagonal_element(attitude * attitude);
    }

    /// Admits that the biases may have leapt: adds these 1-sigmas, m/s² and rad/s, to their change over the run.
    pub fn loosen_biases(&mut self, accel_bias: f64, gyro_bias: f64) {
        self.blocks.accel_walk += accel_bias * accel_bias;
        self.blocks.gyro_walk += gyro_bias * gyro_bias;
    }

    /// P15: covariance of (α, β, φ) and of the change of (b_a, b_g) over the run.
    pub fn covariance(&self) -> SMatrix<f64, 15, 15> {
        self.blocks.assemble()
    }

    /// The part of [`Preintegration::covariance`] that belongs to (α, β, φ).
    pub fn increment_covariance(&self) -> SMatrix<f64, 9, 9> {
        self.blocks.assemble_increment()
    }

    /// Covariance of (α, β, φ) with the change of (b_a, b_g), 9 × 6.
    pub fn cross_covariance(&self) -> SMatrix<f64, 9, 6> {
        self.blocks.assemble_cross()
    }

    /// Variance per axis of the change of accelerometer (m²/s⁴) and gyroscope bias (rad²/s²) over the run.
    pub fn bias_walk(&self) -> [f64; 2] {
        [self.blocks.accel_walk, self.blocks.gyro_walk]
    }
}
