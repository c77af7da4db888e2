//! A piece of an interval as a sensor needs it: the increment from a keyframe to a reading, and Q P15 Qᵀ of its noise.
//!
//! The piece from the later keyframe back to the reading, e → j, is the quotient of two prefixes turned round (§2.3). Its
//! covariance is never formed: the reading's rows Q are carried back through the reversal and the quotient instead,
//!
//! ```text
//! ξ_ej = V(ξ_je − D_je w_je),  w_ej = −w_je                                              reversal
//! Cov(Ψ15 ξ_je) = P_ke − Φ15 P_kj Φ15ᵀ                                                   quotient
//! s = [Q V,  −(Q V) D_je − Q_b],  u = s Ψ15⁻¹:   Q P_ej Qᵀ = u P_ke uᵀ − (uΦ15) P_kj (uΦ15)ᵀ
//! ```
//!
//! which costs some forty products of a matrix and a vector per row, in place of two hundred of matrices. In `uΦ15` the
//! bias columns cancel but for −Q_b.

use nalgebra::{SMatrix, Vector3};

use crate::blocks::{times, transposed_times};

use super::covariance::CovarianceBlocks;
use super::{Increment, Preintegration};

/// Q of a reading: how its rows feel the error of the increment (α, β, φ) and the change of the gyroscope bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseRows<const ROWS: usize> {
    /// Columns of α, β, φ.
    pub by_increment: SMatrix<f64, ROWS, 9>,
    /// Columns of the gyroscope bias; `None` where the sensor does not look at the gyroscope.
    pub by_gyro: Option<SMatrix<f64, ROWS, 3>>,
    /// Whether any of the columns of α and β is not zero.
    pub sees_motion: bool,
}

/// Columns by α, β, φ, accelerometer bias, gyroscope bias of one row.
type Parts = [Vector3<f64>; 5];

/// Room for what [`Piece::backward`] works out, a kilobyte: it is made where it stays.
#[derive(Clone, Copy, Debug)]
pub struct Turned {
    rest: Increment,
    back: Increment,
}

impl Default for Turned {
    fn default() -> Turned {
        Turned { rest: Increment::none(), back: Increment::none() }
    }
}

/// From a keyframe to a reading.
#[derive(Clone, Copy, Debug)]
pub enum Piece<'a> {
    /// From the earlier keyframe: a prefix of the interval as it stands.
    Forward(&'a Preintegration),
    /// From the later keyframe back.
    Backward {
        /// From the earlier keyframe to the reading.
        prefix: &'a Preintegration,
        /// From the earlier keyframe to the later.
        whole: &'a Preintegration,
        /// From the reading to the later keyframe, and back.
        turned: &'a Turned,
    },
}

impl<'a> Piece<'a> {
    /// The piece from the end of `whole` back to the end of `prefix`, both of one run.
    #[inline(always)]
    pub fn backward(prefix: &'a Preintegration, whole: &'a Preintegration, room: &'a mut Turned) -> Piece<'a> {
        room.rest = Increment::between_prefixes(prefix, whole);
        room.back = room.rest.reversed();
        Piece::Backward { prefix, whole, turned: room }
    }

    /// From the keyframe to the reading.
    pub fn increment(&self) -> &Increment {
        match self {
            Piece::Forward(prefix) => prefix,
            Piece::Backward { turned, .. } => &turned.back,
        }
    }

    /// Q P15 Qᵀ.
    #[inline]
    pub fn noise<const ROWS: usize>(&self, rows: &NoiseRows<ROWS>) -> SMatrix<f64, ROWS, ROWS> {
        if !rows.sees_motion && rows.by_gyro.is_none() {
            return self.noise_of_turns(rows);
        }
        let parts: [Parts; ROWS] = core::array::from_fn(|row| rows.parts(row));
        match self {
            Piece::Forward(prefix) => prefix.blocks.seen_by(&parts),
            Piece::Backward { prefix, whole, turned: Turned { rest, back } } => {
                let carried = parts.map(|row| carry_back(&row, prefix, rest, back));
                let through_whole = carried.map(|(by_whole, _)| by_whole);
                let through_prefix = carried.map(|(_, by_prefix)| by_prefix);
                whole.blocks.seen_by(&through_whole) - prefix.blocks.seen_by(&through_prefix)
            }
        }
    }
}

impl Piece<'_> {
    /// The same of rows that feel nothing but φ.
    #[inline]
    fn noise_of_turns<const ROWS: usize>(&self, rows: &NoiseRows<ROWS>) -> SMatrix<f64, ROWS, ROWS> {
        let by_phi = |row: usize| Vector3::from_fn(|axis, _| rows.by_increment[(row, 6 + axis)]);
        let turns: [Vector3<f64>; ROWS] = core::array::from_fn(by_phi);
        match self {
            Piece::Forward(prefix) => {
                let seen = turns.map(|phi| times(&prefix.blocks.phi_phi, &phi));
                SMatrix::from_fn(|left, right| turns[left].dot(&seen[right]))
            }
            Piece::Backward { prefix, whole, turned: Turned { rest, .. } } => {
                let carried = turns.map(|by_phi| {
                    let phi = -transposed_times(&rest.gamma, &by_phi);
                    let gyro = -transposed_times(&rest.bias_jacobian.phi_gyro, &phi);
                    [phi, gyro, times(&rest.gamma, &phi)]
                });
                let (whole, prefix) = (&whole.blocks, &prefix.blocks);
                let seen = carried.map(|[phi, gyro, through_prefix]| {
                    [
                        times(&whole.phi_phi, &phi) + times(&whole.phi_gyro, &gyro),
                        transposed_times(&whole.phi_gyro, &phi) + gyro * whole.gyro_walk,
                        times(&prefix.phi_phi, &through_prefix),
                    ]
                });
                SMatrix::from_fn(|left, right| {
                    let ([phi, gyro, through_prefix], [by_phi, by_gyro, of_prefix]) = (&carried[left], &seen[right]);
                    phi.dot(by_phi) + gyro.dot(by_gyro) - through_prefix.dot(of_prefix)
                })
            }
        }
    }
}

/// `u` and `uΦ15` of the module's equations.
#[inline]
fn carry_back(row: &Parts, prefix: &Increment, rest: &Increment, back: &Increment) -> (Parts, Parts) {
    let [by_alpha, by_beta, by_phi, _, by_gyro] = row;
    let (gamma, dt, d) = (&rest.gamma, rest.dt_total, &rest.bias_jacobian);
    // s = Q V, V = [−γᵀ γᵀT [α_b]×; 0 −γᵀ [β_b]×; 0 0 −γ]; columns, so transposed: qᵀ[a]× is q×a.
    let turned_alpha = times(gamma, by_alpha);
    let alpha = -turned_alpha;
    let beta = turned_alpha * dt - times(gamma, by_beta);
    let phi = by_alpha.cross(&back.alpha) + by_beta.cross(&back.beta) - transposed_times(gamma, by_phi);
    let accel = -(transposed_times(&d.alpha_accel, &alpha) + transposed_times(&d.beta_accel, &beta));
    let gyro = -(transposed_times(&d.alpha_gyro, &alpha)
        + transposed_times(&d.beta_gyro, &beta)
        + transposed_times(&d.phi_gyro, &phi))
        - by_gyro;
    let (u_alpha, u_beta) = (times(&prefix.gamma, &alpha), times(&prefix.gamma, &beta));
    let through_prefix = [
        u_alpha,
        u_alpha * dt + u_beta,
        rest.alpha.cross(&alpha) + rest.beta.cross(&beta) + times(gamma, &phi),
        Vector3::zeros(),
        -by_gyro,
    ];
    ([u_alpha, u_beta, phi, accel, gyro], through_prefix)
}

impl<const ROWS: usize> NoiseRows<ROWS> {
    /// Q by all 15 columns (α, β, φ, b_a, b_g).
    pub fn whole(&self) -> SMatrix<f64, ROWS, 15> {
        let mut q = SMatrix::<f64, ROWS, 15>::zeros();
        q.fixed_columns_mut::<9>(0).copy_from(&self.by_increment);
        if let Some(by_gyro) = &self.by_gyro {
            q.fixed_columns_mut::<3>(12).copy_from(by_gyro);
        }
        q
    }

    #[inline]
    fn parts(&self, row: usize) -> Parts {
        let part = |at: usize| Vector3::from_fn(|axis, _| self.by_increment[(row, at + axis)]);
        let gyro = self.by_gyro.map_or(Vector3::zeros(), |columns| Vector3::from_fn(|axis, _| columns[(row, axis)]));
        [part(0), part(3), part(6), Vector3::zeros(), gyro]
    }
}

impl CovarianceBlocks {
    /// U P15 Uᵀ.
    #[inline]
    fn seen_by<const ROWS: usize>(&self, rows: &[Parts; ROWS]) -> SMatrix<f64, ROWS, ROWS> {
        let mut seen = SMatrix::<f64, ROWS, ROWS>::zeros();
        for right in 0..ROWS {
            let product = self.times(&rows[right]);
            for left in 0..=right {
                let value: f64 = rows[left].iter().zip(&product).map(|(a, b)| a.dot(b)).sum();
                seen[(left, right)] = value;
                seen[(right, left)] = value;
            }
        }
        seen
    }

    /// P15 u.
    #[inline]
    fn times(&self, [alpha, beta, phi, accel, gyro]: &Parts) -> Parts {
        [
            times(&self.alpha_alpha, alpha)
                + times(&self.alpha_beta, beta)
                + times(&self.alpha_phi, phi)
                + times(&self.alpha_accel, accel)
                + times(&self.alpha_gyro, gyro),
            transposed_times(&self.alpha_beta, alpha)
                + times(&self.beta_beta, beta)
                + times(&self.beta_phi, phi)
                + times(&self.beta_accel, accel)
                + times(&self.beta_gyro, gyro),
            transposed_times(&self.alpha_phi, alpha)
                + transposed_times(&self.beta_phi, beta)
                + times(&self.phi_phi, phi)
                + times(&self.phi_gyro, gyro),
            transposed_times(&self.alpha_accel, alpha)
                + transposed_times(&self.beta_accel, beta)
                + accel * self.accel_walk,
            transposed_times(&self.alpha_gyro, alpha)
                + transposed_times(&self.beta_gyro, beta)
                + transposed_times(&self.phi_gyro, phi)
                + gyro * self.gyro_walk,
        ]
    }
}
