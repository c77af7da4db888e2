//! Ranges of one epoch that share an unknown offset d ~ N(0, σ_d²): rows made independent of each other (§3.2 of the method).
//!
//! The whitened rows are r̃ = J̃δ + u d + n with u_i = 1/σ_i. A Householder reflection H turns u into (∓|u|, 0, …, 0) and leaves
//! the unit noise what it is, so after it the first row alone meets d, with the variance 1 + σ_d²|u|²:
//!
//! ```text
//! σ_d = 0     raw ranges: nothing is to be done
//! finite      the first row is divided by √(1 + σ_d²|u|²)
//! σ_d = ∞     the first row says nothing and falls away: what is left are the differences of the paper, whatever the reference
//!             buoy, with their covariance DΣDᵀ
//! ```

use nalgebra::SVector;
use nav_models::row::Row;

/// Makes the rows of an epoch independent; their weights become part of them.
pub(crate) fn decorrelate(rows: &mut Vec<Row>, sigma: f64) {
    if sigma == 0.0 || rows.is_empty() {
        return;
    }
    for row in rows.iter_mut() {
        let root = row.weight.sqrt();
        row.jacobian *= root;
        row.residual *= root;
        row.inverse_sigma *= root;
        row.weight = 1.0;
    }
    let length = rows.iter().map(|row| row.inverse_sigma.powi(2)).sum::<f64>().sqrt();
    // Weights of zero: nothing is said, by d either.
    if length > 0.0 {
        reflect(rows, length);
    }
    if sigma.is_infinite() {
        rows.swap_remove(0);
    } else {
        let scale = 1.0 / (1.0 + (sigma * length).powi(2)).sqrt();
        rows[0].jacobian *= scale;
        rows[0].residual *= scale;
    }
}

/// rows ← (I − 2vvᵀ/vᵀv) rows, v = u + sign(u₀)|u| e₀; the sign keeps v from cancelling.
fn reflect(rows: &mut [Row], length: f64) {
    let first = rows[0].inverse_sigma + length;
    let square = length * length - rows[0].inverse_sigma.powi(2) + first * first;
    let of = |index: usize, row: &Row| if index == 0 { first } else { row.inverse_sigma };
    let (mut jacobian, mut residual) = (SVector::zeros(), 0.0);
    for (index, row) in rows.iter().enumerate() {
        jacobian += row.jacobian * of(index, row);
        residual += row.residual * of(index, row);
    }
    for (index, row) in rows.iter_mut().enumerate() {
        let share = 2.0 * of(index, row) / square;
        row.jacobian -= jacobian * share;
        row.residual -= residual * share;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    const SIGMAS: [f64; 4] = [0.3, 0.3, 0.4, 0.5];
    const DIM: usize = 15;

    fn epoch() -> (DMatrix<f64>, DVector<f64>, Vec<Row>) {
        let jacobian = DMatrix::from_fn(4, DIM, |i, j| ((i * DIM + j) as f64 * 0.7).sin());
        let residual = DVector::from_vec(vec![0.1, -2.0, 1.0, -0.4]);
        let rows = (0..4)
            .map(|i| Row {
                jacobian: SVector::from_iterator(jacobian.row(i).iter().map(|x| x / SIGMAS[i])),
                residual: residual[i] / SIGMAS[i],
                inverse_sigma: 1.0 / SIGMAS[i],
                weight: 1.0,
                slopes: Default::default(),
                mooring: None,
            })
            .collect();
        (jacobian, residual, rows)
    }

    /// JᵀWJ and JᵀWr of decorrelated rows.
    fn normal(sigma: f64, weights: [f64; 4]) -> (DMatrix<f64>, DVector<f64>) {
        let (_, _, mut rows) = epoch();
        rows.iter_mut().zip(weights).for_each(|(row, weight)| row.weight = weight);
        decorrelate(&mut rows, sigma);
        let (mut information, mut right) = (DMatrix::zeros(DIM, DIM), DVector::zeros(DIM));
        for row in &rows {
            let j = DVector::from_column_slice(row.jacobian.as_slice());
            information += &j * j.transpose() * row.weight;
            right += &j * (row.residual * row.weight);
        }
        (information, right)
    }

    #[test]
    fn an_unknown_offset_leaves_the_differences_against_any_buoy_with_their_covariance() {
        let weights = [1.0, 0.25, 1.0, 0.5];
        let (information, right) = normal(f64::INFINITY, weights);
        let (jacobian, residual, _) = epoch();
        for reference in 0..4 {
            let others: Vec<usize> = (0..4).filter(|&i| i != reference).collect();
            let d = DMatrix::from_fn(3, 4, |i, j| {
                f64::from(i8::from(others[i] == j)) - f64::from(i8::from(j == reference))
            });
            let variances = SIGMAS.iter().zip(weights).map(|(s, w)| s * s / w);
            let sigma = DMatrix::from_diagonal(&DVector::from_iterator(4, variances));
            let w = (&d * sigma * d.transpose()).try_inverse().expect("regular");
            let (dj, dr) = (&d * &jacobian, &d * &residual);
            assert!((&information - dj.transpose() * &w * &dj).amax() < 1e-10, "reference {reference}");
            assert!((&right - dj.transpose() * &w * &dr).amax() < 1e-10, "reference {reference}");
        }
    }

    #[test]
    fn a_finite_offset_equals_its_full_covariance() {
        for sigma in [0.2, 3.0, 50.0] {
            let (information, right) = normal(sigma, [1.0; 4]);
            let (jacobian, residual, _) = epoch();
            let covariance =
                DMatrix::from_fn(4, 4, |i, j| sigma * sigma + if i == j { SIGMAS[i] * SIGMAS[i] } else { 0.0 });
            let w = covariance.cholesky().expect("positive definite").inverse();
            // The dense inverse loses (σ_d/σ)² in digits.
            let tolerance = 1e-13 * (1.0 + (sigma / 0.3_f64).powi(2)) * information.amax();
            assert!((&information - jacobian.transpose() * &w * &jacobian).amax() < tolerance, "sigma {sigma}");
            assert!((&right - jacobian.transpose() * &w * &residual).amax() < tolerance, "sigma {sigma}");
        }
    }

    #[test]
    fn one_range_with_an_unknown_offset_says_nothing() {
        let (_, _, mut rows) = epoch();
        rows.truncate(1);
        decorrelate(&mut rows, f64::INFINITY);
        assert!(rows.is_empty());
    }
}
