//! Whitened, robustly weighted rows of the sensors tied to one keyframe.
//!
//! A row is r̃ + j̃ᵀ δ with unit variance, δ the keyframe's step from its linearisation point. Rows are kept, so that
//! weights can be refreshed and costs told without evaluating a sensor model again.
//!
//! Ranges of one epoch that share an unknown offset d ~ N(0, σ_d²) are one group with the information matrix
//! `W = Σ⁻¹ − Σ⁻¹1 1ᵀΣ⁻¹ / (σ_d⁻² + 1ᵀΣ⁻¹1)` (§3.2 of the method): the sum over rows less a rank-one part.
//! σ_d = 0 makes them single rows, σ_d = ∞ is identical to range differences against any reference buoy.

use nalgebra::{SMatrix, SVector, Vector3};
pub use nav_models::row::{Row, SLOTS};
pub use nav_models::state::ERROR_DIM as DIM;
use nav_models::state::POSITION;
use shared_types::Kernel;

use crate::columns::{TERMS, column_of};
use crate::kernels::{BAND, Block, BlockVector, mirror_lower};
use crate::moorings::MooringColumns;
use crate::robust::{Losses, credited_weight};
use crate::systematic::{ERRORS, errors_of};

/// Rows that are weighted together or share an offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Group {
    /// One measurement: its rows bear one weight.
    Single {
        /// Robust kernel.
        kernel: Kernel,
    },
    /// Ranges with a common unknown offset of this 1-sigma, m; each row bears its own weight.
    CommonOffset {
        /// Robust kernel.
        kernel: Kernel,
        /// 1-sigma of the offset, m; may be infinite.
        sigma: f64,
    },
}

#[derive(Clone, Copy, Debug)]
struct Span {
    first: usize,
    end: usize,
    group: Group,
    /// Place of the sensor in [`shared_types::AIDING`].
    sensor: usize,
}

/// The [systematic errors](crate::systematic) g in the normal equations of one keyframe: [JᵀWJ, F; Fᵀ, S] and the right side
/// of g.
#[derive(Clone, Copy, Debug)]
pub struct Slopes {
    /// F = JᵀWd of each.
    pub coupling: [BlockVector<DIM>; ERRORS],
    /// S = dᵀWd of each with each.
    pub information: SMatrix<f64, ERRORS, ERRORS>,
    /// −dᵀWr of each.
    pub right: [f64; ERRORS],
}

impl Default for Slopes {
    fn default() -> Self {
        Slopes { coupling: [BlockVector::zeros(); ERRORS], information: SMatrix::zeros(), right: [0.0; ERRORS] }
    }
}

/// All rows tied to one keyframe.
#[derive(Clone, Debug, Default)]
pub struct Rows {
    rows: Vec<Row>,
    spans: Vec<Span>,
    /// Largest slope of a row along each coordinate.
    steepest: BlockVector<DIM>,
}

impl Rows {
    /// Removes every row; keeps the memory.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.spans.clear();
        self.steepest = BlockVector::zeros();
    }

    /// Appends a group of the sensor at this place in [`shared_types::AIDING`].
    pub fn push(&mut self, sensor: usize, group: Group, rows: &[Row]) {
        self.open(sensor, group);
        self.extend(rows);
        self.close();
    }

    /// Begins a group, to be filled with [`Rows::extend`] and ended with [`Rows::close`].
    pub fn open(&mut self, sensor: usize, group: Group) {
        self.spans.push(Span { first: self.rows.len(), end: self.rows.len(), group, sensor });
    }

    /// Adds rows to the group that was begun.
    pub fn extend(&mut self, rows: &[Row]) {
        self.rows.extend_from_slice(rows);
        for row in rows {
            for i in 0..DIM {
                self.steepest[i] = self.steepest[i].max(row.jacobian[i].abs());
            }
        }
    }

    /// The most by which a change of the step can change a whitened residual, in sigmas.
    #[inline(always)]
    pub fn most_felt(&self, change: &BlockVector<DIM>) -> f64 {
        (0..DIM).map(|i| self.steepest[i] * change[i].abs()).sum()
    }

    /// Ends the group that was begun; one without rows vanishes.
    pub fn close(&mut self) {
        if let Some(span) = self.spans.last_mut() {
            span.end = self.rows.len();
            if span.end == span.first {
                self.spans.pop();
            }
        }
    }

    /// Adds the normal equations of all rows: `information` += JᵀWJ, `right` −= JᵀWr.
    #[inline(always)]
    pub fn assemble(&self, information: &mut Block<DIM>, right: &mut BlockVector<DIM>) {
        add_gram(information, &self.rows);
        for row in &self.rows {
            add_scaled(right, &row.jacobian, -row.weight * row.residual);
        }
        for span in &self.spans {
            if let Group::CommonOffset { sigma, .. } = span.group {
                self.subtract_offset(span, sigma, information, right);
            }
        }
    }

    #[inline(always)]
    fn subtract_offset(&self, span: &Span, sigma: f64, information: &mut Block<DIM>, right: &mut BlockVector<DIM>) {
        let (direction, mean, total) = offset_of(&self.rows[span.first..span.end], sigma);
        add_outer(information, &direction, &direction, -1.0 / total);
        add_scaled(right, &direction, mean / total);
    }

    /// The normal equations' part of each [systematic error](crate::systematic).
    #[inline(always)]
    pub fn assemble_slopes(&self) -> Slopes {
        let mut slopes = Slopes::default();
        for span in &self.spans {
            let rows = &self.rows[span.first..span.end];
            let errors = errors_of(span.sensor);
            for row in rows {
                for &(slot, error) in errors {
                    let weighted = row.weight * row.slopes[slot];
                    add_scaled(&mut slopes.coupling[error], &row.jacobian, weighted);
                    slopes.right[error] -= weighted * row.residual;
                    for &(other_slot, other) in errors {
                        slopes.information[(other, error)] += weighted * row.slopes[other_slot];
                    }
                }
            }
            if let Group::CommonOffset { sigma, .. } = span.group {
                subtract_offset_of_slopes(rows, sigma, errors, &mut slopes);
            }
        }
        slopes
    }

    /// Adds −JᵀWj_p of each moored buoy, what the normal equations have of its position, and −dᵀWj_p beside it, d being the slopes of each
    /// [systematic error](crate::systematic).
    #[inline(always)]
    pub fn assemble_moorings(&self, columns: &mut MooringColumns) {
        for span in &self.spans {
            let rows = &self.rows[span.first..span.end];
            let moored = || rows.iter().filter_map(|row| Some((row, row.mooring?)));
            let errors = errors_of(span.sensor);
            let mut add = |row: &Row, place, direction: &BlockVector<DIM>, slopes: &[f64; SLOTS], scale: f64| {
                let column = columns.of(place);
                add_outer(&mut column.by_range, &by_position(row), direction, scale);
                for &(slot, error) in errors {
                    for term in 0..TERMS {
                        let mut crossed = column.crossed.row_mut(column_of(error, term));
                        crossed += by_position(row).transpose() * (scale * slopes[slot]);
                    }
                }
            };
            for (row, place) in moored() {
                add(row, place, &row.jacobian, &row.slopes, -row.weight);
            }
            if let Group::CommonOffset { sigma, .. } = span.group
                && moored().next().is_some()
            {
                let (direction, _, total) = offset_of(rows, sigma);
                let slopes = shared_slopes(rows);
                for (row, place) in moored() {
                    add(row, place, &direction, &slopes, row.weight * row.inverse_sigma / total);
                }
            }
        }
    }

    /// Takes robust weights from the residuals after a step δ. A measurement whose weight would change by no more than
    /// `tolerance` keeps the one it has. Returns whether any changed, and half the robust sum of squares after the step.
    #[inline(always)]
    pub fn refresh_weights(&mut self, delta: &BlockVector<DIM>, tolerance: f64) -> (bool, f64) {
        let (mut changed, mut losses) = (false, Losses::default());
        for index in 0..self.spans.len() {
            let span = self.spans[index];
            match span.group {
                Group::Single { kernel } => {
                    let rows = &mut self.rows[span.first..span.end];
                    let mut s = 0.0;
                    for row in rows.iter() {
                        s += row.after(delta).powi(2);
                    }
                    losses.add(kernel, rows.len(), s);
                    let new = credited_weight(kernel, rows.len(), s);
                    if (new - rows[0].weight).abs() > tolerance {
                        rows.iter_mut().for_each(|row| row.weight = new);
                        changed = true;
                    }
                }
                Group::CommonOffset { kernel, sigma } => {
                    let offset = self.offset(&span, sigma, delta);
                    for row in &mut self.rows[span.first..span.end] {
                        let whitened = row.after(delta) - offset * row.inverse_sigma;
                        losses.add(kernel, 1, whitened * whitened);
                        let new = credited_weight(kernel, 1, whitened * whitened);
                        if (new - row.weight).abs() > tolerance {
                            row.weight = new;
                            changed = true;
                        }
                    }
                    losses.add(Kernel::None, 1, (offset / sigma).powi(2));
                }
            }
        }
        (changed, 0.5 * losses.sum())
    }

    /// d̂ of a group after a step δ, m.
    #[inline(always)]
    fn offset(&self, span: &Span, sigma: f64, delta: &BlockVector<DIM>) -> f64 {
        let (mut mean, mut total) = (0.0, 1.0 / (sigma * sigma));
        for row in &self.rows[span.first..span.end] {
            let share = row.weight * row.inverse_sigma;
            mean += share * row.after(delta);
            total += share * row.inverse_sigma;
        }
        if total > 0.0 { mean / total } else { 0.0 }
    }

    /// How many groups there are.
    pub fn groups(&self) -> usize {
        self.spans.len()
    }

    /// Half the robust sum of squares after a step δ.
    #[inline(always)]
    pub fn cost(&self, delta: &BlockVector<DIM>) -> f64 {
        self.cost_from(0, delta)
    }

    /// That of the groups from this one on.
    #[inline(always)]
    pub fn cost_from(&self, group: usize, delta: &BlockVector<DIM>) -> f64 {
        let mut losses = Losses::default();
        for span in &self.spans[group..] {
            let rows = &self.rows[span.first..span.end];
            match span.group {
                Group::Single { kernel } => {
                    let mut s = 0.0;
                    for row in rows {
                        s += row.after(delta).powi(2);
                    }
                    losses.add(kernel, rows.len(), s);
                }
                Group::CommonOffset { kernel, sigma } => {
                    let offset = self.offset(span, sigma, delta);
                    for row in rows {
                        losses.add(kernel, 1, (row.after(delta) - offset * row.inverse_sigma).powi(2));
                    }
                    losses.add(Kernel::None, 1, (offset / sigma).powi(2));
                }
            }
        }
        0.5 * losses.sum()
    }
}

#[inline(always)]
fn subtract_offset_of_slopes(rows: &[Row], sigma: f64, errors: &[(usize, usize)], slopes: &mut Slopes) {
    let mut total = 1.0 / (sigma * sigma);
    let mut mean = 0.0;
    for row in rows {
        let share = row.weight * row.inverse_sigma;
        total += share * row.inverse_sigma;
        mean += share * row.residual;
    }
    let mean_slopes = shared_slopes(rows);
    for &(slot, error) in errors {
        let mean_slope = mean_slopes[slot] / total;
        for row in rows {
            add_scaled(&mut slopes.coupling[error], &row.jacobian, -row.weight * row.inverse_sigma * mean_slope);
        }
        slopes.right[error] += mean_slope * mean;
        for &(other_slot, other) in errors {
            slopes.information[(other, error)] -= mean_slope * mean_slopes[other_slot];
        }
    }
}

/// target += Σ w j jᵀ of a symmetric target.
#[inline(always)]
fn add_gram(target: &mut Block<DIM>, rows: &[Row]) {
    const { assert!(DIM <= 4 * BAND, "bands are written out") }
    add_gram_band::<0>(target, rows);
    add_gram_band::<{ BAND }>(target, rows);
    add_gram_band::<{ 2 * BAND }>(target, rows);
    add_gram_band::<{ 3 * BAND }>(target, rows);
    mirror_lower(target);
}

/// The lower triangle of some columns: each stays in registers while all rows pass.
#[inline(always)]
fn add_gram_band<const FROM: usize>(target: &mut Block<DIM>, rows: &[Row]) {
    for j in FROM..DIM.min(FROM + BAND) {
        let mut column = target.data.0[j];
        for row in rows {
            let v = &row.jacobian.data.0[0];
            let factor = row.weight * v[j];
            for i in FROM..DIM {
                column[i] += v[i] * factor;
            }
        }
        target.data.0[j] = column;
    }
}

/// JᵀΣ⁻¹1, 1ᵀΣ⁻¹r and σ_d⁻² + 1ᵀΣ⁻¹1 of rows that share an offset.
#[inline(always)]
fn offset_of(rows: &[Row], sigma: f64) -> (BlockVector<DIM>, f64, f64) {
    let mut direction = BlockVector::<DIM>::zeros();
    let (mut mean, mut total) = (0.0, 1.0 / (sigma * sigma));
    for row in rows {
        let share = row.weight * row.inverse_sigma;
        add_scaled(&mut direction, &row.jacobian, share);
        mean += share * row.residual;
        total += share * row.inverse_sigma;
    }
    (direction, mean, total)
}

/// 1ᵀΣ⁻¹d of rows that share an offset.
#[inline(always)]
fn shared_slopes(rows: &[Row]) -> [f64; SLOTS] {
    let mut sums = [0.0; SLOTS];
    for row in rows {
        for (sum, slope) in sums.iter_mut().zip(row.slopes) {
            *sum += row.weight * row.inverse_sigma * slope;
        }
    }
    sums
}

/// j_p.
fn by_position(row: &Row) -> Vector3<f64> {
    row.jacobian.fixed_rows::<3>(POSITION).into_owned()
}

/// target += scale · a bᵀ
#[inline(always)]
fn add_outer<const ROWS: usize>(
    target: &mut SMatrix<f64, ROWS, DIM>,
    a: &SVector<f64, ROWS>,
    b: &BlockVector<DIM>,
    scale: f64,
) {
    let a = &a.data.0[0];
    for j in 0..DIM {
        let factor = scale * b[j];
        let column = &mut target.data.0[j];
        for i in 0..ROWS {
            column[i] += a[i] * factor;
        }
    }
}

#[inline(always)]
fn add_scaled(target: &mut BlockVector<DIM>, v: &BlockVector<DIM>, scale: f64) {
    for i in 0..DIM {
        target.data.0[0][i] += v.data.0[0][i] * scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    const SIGMAS: [f64; 4] = [0.3, 0.3, 0.4, 0.5];

    fn epoch() -> (DMatrix<f64>, DVector<f64>, Vec<Row>) {
        let jacobian = DMatrix::from_fn(4, DIM, |i, j| ((i * 15 + j) as f64 * 0.7).sin());
        let residual = DVector::from_vec(vec![0.1, -2.0, 1.0, -0.4]);
        let rows = (0..4)
            .map(|i| Row {
                jacobian: BlockVector::from_iterator(jacobian.row(i).iter().map(|x| x / SIGMAS[i])),
                residual: residual[i] / SIGMAS[i],
                inverse_sigma: 1.0 / SIGMAS[i],
                weight: 1.0,
                slopes: [(i as f64 - 1.3) / SIGMAS[i], 0.0],
                mooring: [Some(0), Some(2), Some(0), None][i],
            })
            .collect();
        (jacobian, residual, rows)
    }

    /// The same through the full covariance Σ + σ_d² 11ᵀ.
    fn dense(sigma_d: f64) -> (DMatrix<f64>, DVector<f64>) {
        let (jacobian, residual, _) = epoch();
        let covariance =
            DMatrix::from_fn(4, 4, |i, j| sigma_d * sigma_d + if i == j { SIGMAS[i] * SIGMAS[i] } else { 0.0 });
        // By Cholesky: the closed form of a 4 × 4 inverse cancels when the offset is large.
        let information = covariance.cholesky().expect("positive definite").inverse();
        (jacobian.transpose() * &information * &jacobian, -(jacobian.transpose() * information * residual))
    }

    fn assembled(group: Group) -> (Block<DIM>, BlockVector<DIM>) {
        let (_, _, rows) = epoch();
        let mut block = Rows::default();
        block.push(0, group, &rows);
        let (mut information, mut right) = (Block::zeros(), BlockVector::zeros());
        block.assemble(&mut information, &mut right);
        (information, right)
    }

    #[test]
    fn no_residual_changes_by_more_than_is_felt_at_most() {
        let (_, _, epoch) = epoch();
        let mut rows = Rows::default();
        rows.push(0, Group::Single { kernel: Kernel::None }, &epoch);
        for seed in 0..20 {
            let change = BlockVector::from_fn(|i, _| ((seed * 31 + i * 7) as f64).sin() * 0.01);
            let most = rows.most_felt(&change);
            let changes = epoch.iter().map(|row| (row.after(&change) - row.residual).abs());
            let felt = changes.fold(0.0, f64::max);
            assert!(felt <= most, "{felt} {most}");
        }
    }

    #[test]
    fn a_common_offset_equals_its_full_covariance() {
        for sigma in [0.2, 3.0, 50.0] {
            let (information, right) = assembled(Group::CommonOffset { kernel: Kernel::None, sigma });
            let (expected, expected_right) = dense(sigma);
            // The dense inverse loses (σ_d/σ)² in digits.
            let tolerance = 1e-14 * (1.0 + (sigma / 0.3).powi(2)) * expected.amax();
            let (off, off_right) = ((information - expected).amax(), (right - expected_right).amax());
            assert!(off < tolerance, "sigma {sigma}: {off} {tolerance}");
            assert!(off_right < tolerance, "sigma {sigma}: {off_right} {tolerance}");
        }
    }

    #[test]
    fn the_slopes_are_those_of_the_full_covariance() {
        let sigma = 0.8;
        let (_, _, rows) = epoch();
        let mut block = Rows::default();
        block.push(2, Group::CommonOffset { kernel: Kernel::None, sigma }, &rows);
        let slopes = block.assemble_slopes();
        let (jacobian, residual, _) = epoch();
        let d = DVector::from_fn(4, |i, _| i as f64 - 1.3);
        let covariance =
            DMatrix::from_fn(4, 4, |i, j| sigma * sigma + if i == j { SIGMAS[i] * SIGMAS[i] } else { 0.0 });
        let w = covariance.cholesky().expect("positive definite").inverse();
        assert!((slopes.coupling[2] - jacobian.transpose() * &w * &d).amax() < 1e-11);
        assert!((slopes.information[(2, 2)] - d.dot(&(&w * &d))).abs() < 1e-11);
        assert!((slopes.right[2] + d.dot(&(&w * residual))).abs() < 1e-11);
    }

    #[test]
    fn the_columns_of_moorings_are_those_of_the_full_covariance() {
        let (jacobian, _, rows) = epoch();
        for sigma in [0.0, 0.8] {
            let mut block = Rows::default();
            let kernel = Kernel::None;
            match sigma {
                0.0 => rows.iter().for_each(|row| block.push(0, Group::Single { kernel }, &[*row])),
                _ => block.push(0, Group::CommonOffset { kernel, sigma }, &rows),
            }
            let mut columns = MooringColumns::default();
            block.assemble_moorings(&mut columns);
            let covariance =
                DMatrix::from_fn(4, 4, |i, j| sigma * sigma + if i == j { SIGMAS[i] * SIGMAS[i] } else { 0.0 });
            let w = covariance.cholesky().expect("positive definite").inverse();
            for place in 0..3 {
                // The buoy moves the ranges to it, against the vehicle.
                let of_buoy = DMatrix::from_fn(4, 3, |i, axis| match rows[i].mooring {
                    Some(of) if of == place => -jacobian[(i, POSITION + axis)],
                    _ => 0.0,
                });
                let column = columns.of(place);
                let expected = (jacobian.transpose() * &w * &of_buoy).transpose();
                assert!((column.by_range - expected).amax() < 1e-11, "buoy {place}, offset {sigma}");
                let d = DVector::from_fn(4, |i, _| i as f64 - 1.3);
                let expected = d.transpose() * &w * of_buoy;
                for term in 0..TERMS {
                    let crossed = column.crossed.row(column_of(0, term)).into_owned();
                    assert!((crossed - &expected).amax() < 1e-11, "buoy {place}, offset {sigma}");
                }
            }
        }
    }

    #[test]
    fn an_unknown_offset_equals_differences_against_any_buoy() {
        let (information, right) = assembled(Group::CommonOffset { kernel: Kernel::None, sigma: f64::INFINITY });
        let (jacobian, residual, _) = epoch();
        for reference in 0..4 {
            let others: Vec<usize> = (0..4).filter(|&i| i != reference).collect();
            let difference = DMatrix::from_fn(3, 4, |i, j| {
                f64::from(i8::from(others[i] == j)) - f64::from(i8::from(j == reference))
            });
            let sigma = DMatrix::from_diagonal(&DVector::from_iterator(4, SIGMAS.iter().map(|s| s * s)));
            let w = (&difference * sigma * difference.transpose()).try_inverse().expect("regular");
            let (dj, dr) = (&difference * &jacobian, &difference * &residual);
            assert!((information - dj.transpose() * &w * &dj).amax() < 1e-10, "reference {reference}");
            assert!((right + dj.transpose() * &w * &dr).amax() < 1e-10, "reference {reference}");
        }
    }

    #[test]
    fn one_range_with_an_unknown_offset_says_nothing() {
        let (_, _, rows) = epoch();
        let mut block = Rows::default();
        block.push(0, Group::CommonOffset { kernel: Kernel::None, sigma: f64::INFINITY }, &rows[..1]);
        let (mut information, mut right) = (Block::zeros(), BlockVector::zeros());
        block.assemble(&mut information, &mut right);
        assert!(information.amax() < 1e-12 && right.amax() < 1e-12);
    }

    #[test]
    fn the_right_side_is_the_downhill_slope_of_the_cost() {
        let (_, _, rows) = epoch();
        let mut block = Rows::default();
        block.push(0, Group::Single { kernel: Kernel::Huber(1.345) }, &rows[..3]);
        block.push(0, Group::Single { kernel: Kernel::Cauchy(2.0) }, &rows[3..]);
        block.push(0, Group::CommonOffset { kernel: Kernel::None, sigma: 1.0 }, &rows);
        block.refresh_weights(&BlockVector::zeros(), 0.0);
        let (mut information, mut right) = (Block::zeros(), BlockVector::zeros());
        block.assemble(&mut information, &mut right);
        for i in 0..DIM {
            let mut step = BlockVector::zeros();
            step[i] = 1e-6;
            let slope = (block.cost(&step) - block.cost(&-step)) / 2e-6;
            assert!((slope + right[i]).abs() < 1e-6 * (1.0 + slope.abs()), "coordinate {i}: {slope} {}", right[i]);
        }
    }

    #[test]
    fn an_outlier_among_ranges_loses_its_own_weight_only() {
        let (_, _, mut rows) = epoch();
        for row in &mut rows {
            row.residual = 0.0;
        }
        rows[2].residual = -200.0;
        let mut block = Rows::default();
        block.push(0, Group::CommonOffset { kernel: Kernel::Cauchy(2.0), sigma: f64::INFINITY }, &rows);
        for _ in 0..20 {
            block.refresh_weights(&BlockVector::zeros(), 0.0);
        }
        let weights: Vec<f64> = block.rows.iter().map(|row| row.weight).collect();
        assert!(weights[2] < 1e-3 && weights[0] > 0.99 && weights[1] > 0.99 && weights[3] > 0.99, "{weights:?}");
    }
}
