//! Measurements between two keyframes as one factor with the samples of that interval (§3.8 of the method).
//!
//! A reading at t_j is reached from keyframe k through the samples up to t_j, and the same samples are in the IMU factor: the
//! errors of both are correlated, ξ_kj being a part of ξ_ke. Stacked, all readings of the interval over r_imu, their covariance is
//!
//! ```text
//! r_j  carries  n_j − Q_j ξ_kj       Cov(r_j, r_j') = Q_j P_kj Φ15_{j→j'}ᵀ Q_j'ᵀ    (+ R_z if j = j')
//! r_imu carries +ξ_ke                Cov(r_imu, r_j) = −Φ15_{j→e} P_kj Q_jᵀ
//! ```
//!
//! It is never formed. Its Cholesky factor, readings first in their order and r_imu last, is a filter on ξ, which is carried as an
//! affine function X (1; δ_k) of the step of keyframe k, and by how much M its covariance has shrunk:
//!
//! ```text
//! k        X = 0,  M = 0
//! j → j'   X ← Φ15 X,  M ← Φ15 M Φ15ᵀ                                   covariance of ξ_kj:  P = P_kj − M
//! j        S = R_z/w + Q P Qᵀ = L Lᵀ,  [r J]~ = L⁻¹([r J] + Q X)         rows on x_k alone
//!          X ← X − P Qᵀ L⁻ᵀ [r J]~,  M ← M + P Qᵀ S⁻¹ Q P
//! e        r_imu − X (1; δ_k) with covariance P_ke − M                    the interval's rows on (x_k, x_{k+1})
//! ```
//!
//! So the factor costs as much as its readings, and the chain stays block-tridiagonal. It equals states inserted at every t_j
//! and eliminated again.
//!
//! **Robust weights** w scale R_z of their reading, and only that: the samples are not less true for a reading that is. They
//! follow from the reading's own squared norm under R_z + Q P_kj Qᵀ, as they do everywhere else.
//!
//! What is not in here, and is tied to keyframe k as ever: readings at a keyframe, which owe nothing to samples; readings outside
//! the interval; ranges off the keyframes that share an offset. Time offsets are not estimated in this form
//! (the columns of `columns.rs` know nothing of the interval): stamps are taken as they are given.

use nalgebra::SMatrix;
use nav_models::preintegration::{Increment, Preintegration};
use nav_models::row::inverse_root;
use nav_models::state::NavState;
use nav_models::world::WorldModel;
use shared_types::{Kernel, Time};

use crate::factor::{Factor, MeasuredRows};
use crate::interval::{ImuHistory, ImuModel};
use crate::kernels::{Block, BlockVector};
use crate::robust::{Losses, weight};
use crate::rows::DIM;

/// A weight below this leaves its reading out.
const WEIGHT_MIN: f64 = 1e-12;

/// The measurements of one interval, in order of time.
#[derive(Clone, Debug, Default)]
pub struct Between {
    readings: Vec<Reading>,
    /// Some have come since the prefixes were made.
    is_stale: bool,
}

#[derive(Clone, Debug)]
struct Reading {
    factor: Factor,
    /// From the keyframe to it; `None` before [`Between::prepare`].
    prefix: Option<Preintegration>,
    /// Its rows under R_z + Q P_kj Qᵀ, for its weight; `None` while it says nothing.
    rows: Option<MeasuredRows>,
    weight: f64,
}

/// What the measurements of an interval say of its keyframe, and of the error of its increment.
#[derive(Clone, Debug)]
pub struct Known {
    /// Σ JᵀS⁻¹J on the earlier keyframe.
    pub information: Block<DIM>,
    /// −Σ JᵀS⁻¹r.
    pub right: BlockVector<DIM>,
    /// ½ Σ rᵀS⁻¹r.
    pub cost: f64,
    /// X at the end: ξ_ke as seen, and its Jacobian on the earlier keyframe.
    pub error: SMatrix<f64, DIM, { 1 + DIM }>,
    /// L⁻¹ with P_ke − M = LLᵀ; `None` if rounding has made it singular.
    pub whitener: Option<Block<DIM>>,
}

impl Between {
    /// Forgets all; keeps the memory.
    pub fn clear(&mut self) {
        self.readings.clear();
        self.is_stale = false;
    }

    /// Takes in a measurement with its rows at the keyframe's linearisation point, weights set.
    pub fn push(&mut self, factor: &Factor, rows: &MeasuredRows) {
        let slot = self.readings.partition_point(|earlier| earlier.factor.t <= factor.t);
        let weight = rows.as_slice().first().map_or(1.0, |row| row.weight);
        self.readings.insert(slot, Reading { factor: *factor, prefix: None, rows: Some(*rows), weight });
        self.is_stale = true;
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.readings.is_empty()
    }

    /// The measurements.
    pub fn factors(&self) -> impl Iterator<Item = &Factor> {
        self.readings.iter().map(|reading| &reading.factor)
    }

    /// Integrates up to every measurement at the biases of `whole`, if some have come or those have changed. Returns whether.
    /// A stretch whose samples are no longer held keeps what it has.
    pub fn prepare(&mut self, t_keyframe: Time, whole: &Increment, history: &ImuHistory, imu: &ImuModel) -> bool {
        let is_at_other_biases = |prefix: &Preintegration| {
            prefix.accel_bias != whole.accel_bias || prefix.gyro_bias != whole.gyro_bias
        };
        self.is_stale |=
            self.readings.iter().any(|reading| reading.prefix.as_ref().is_some_and(is_at_other_biases));
        if !core::mem::take(&mut self.is_stale) {
            return false;
        }
        let ends = self.readings.iter_mut().map(|reading| (reading.factor.t, reading));
        let biases = (&whole.accel_bias, &whole.gyro_bias);
        // What the history does not reach keeps its prefix.
        let _ = history.prefixes(t_keyframe, ends, biases, imu, |reading, prefix| {
            reading.factor.increment = Some(prefix.increment);
            reading.prefix = Some(*prefix);
        });
        true
    }

    /// Evaluates every measurement anew, for its weight.
    pub fn linearise(&mut self, linearised: &NavState, world: &WorldModel) {
        for reading in &mut self.readings {
            reading.rows = reading.factor.rows(linearised, world).ok();
        }
    }

    /// Takes robust weights from the residuals after a step δ, where they differ by more than `tolerance`. Returns whether any
    /// did.
    pub fn refresh_weights(&mut self, delta: &BlockVector<DIM>, tolerance: f64) -> bool {
        let mut changed = false;
        for reading in self.readings.iter_mut().filter(|reading| reading.factor.kernel != Kernel::None) {
            let Some(s) = reading.squared_norm(delta) else { continue };
            let new = weight(reading.factor.kernel, s);
            if (new - reading.weight).abs() > tolerance {
                reading.weight = new;
                changed = true;
            }
        }
        changed
    }

    /// How much half the robust sum of squares after a step δ lies above the weighted one, which the interval's normal
    /// equations hold: ½ Σ (ρ(s) − w s).
    pub fn robust_surplus(&self, delta: &BlockVector<DIM>) -> f64 {
        let (mut losses, mut weighted) = (Losses::default(), 0.0);
        for reading in self.readings.iter().filter(|reading| reading.factor.kernel != Kernel::None) {
            if let Some(s) = reading.squared_norm(delta) {
                losses.add(reading.factor.kernel, s);
                weighted += reading.weight * s;
            }
        }
        0.5 * (losses.sum() - weighted)
    }

    /// What they say of keyframe k at `linearised`, and of the error of the increment `whole` from it. `None` if there are none.
    #[inline(always)]
    pub fn eliminate(&self, linearised: &NavState, whole: &Preintegration, world: &WorldModel) -> Option<Known> {
        let mut known = Known {
            information: Block::zeros(),
            right: BlockVector::zeros(),
            cost: 0.0,
            error: SMatrix::zeros(),
            whitener: None,
        };
        let mut shrunk = Block::<DIM>::zeros();
        let mut last: Option<&Increment> = None;
        for reading in &self.readings {
            let (Some(prefix), Some(_)) = (&reading.prefix, &reading.rows) else { continue };
            if reading.weight < WEIGHT_MIN {
                continue;
            }
            if let Some(last) = last {
                carry(&Increment::error_carry(last, prefix), &mut known.error, &mut shrunk);
            }
            last = Some(&prefix.increment);
            let parts = reading.factor.parts(linearised, &prefix.increment, world);
            let seen = (prefix.covariance() - shrunk) * parts.noise_rows.transpose();
            let covariance = parts.covariance / reading.weight + parts.noise_rows * seen;
            let Some(whitening) = inverse_root(&((covariance + covariance.transpose()) * 0.5)) else { continue };
            let white = whitening * (parts.rows + parts.noise_rows * known.error);
            let gain = seen * whitening.transpose();
            known.error -= gain * white;
            shrunk += gain * gain.transpose();
            let (residual, jacobian) = (white.fixed_columns::<1>(0), white.fixed_columns::<DIM>(1));
            known.information += jacobian.transpose() * jacobian;
            known.right -= jacobian.transpose() * residual;
            known.cost += 0.5 * residual.norm_squared();
        }
        carry(&Increment::error_carry(last?, whole), &mut known.error, &mut shrunk);
        known.whitener = inverse_root(&(whole.covariance() - shrunk));
        Some(known)
    }
}

impl Reading {
    /// s of its kernel after a step δ.
    fn squared_norm(&self, delta: &BlockVector<DIM>) -> Option<f64> {
        Some(self.rows.as_ref()?.as_slice().iter().map(|row| row.after(delta).powi(2)).sum())
    }
}

/// X ← Φ15 X, M ← Φ15 M Φ15ᵀ.
#[inline(always)]
fn carry(phi: &Block<DIM>, error: &mut SMatrix<f64, DIM, { 1 + DIM }>, shrunk: &mut Block<DIM>) {
    *error = phi * *error;
    *shrunk = phi * *shrunk * phi.transpose();
}
