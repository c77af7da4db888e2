//! The numeric differentiator against which every Jacobian of the house is held.
//!
//! Five-point central differences: `f'(0) ≈ [8(f(h) − f(−h)) − (f(2h) − f(−2h))]/(12h)`, error h⁴f⁗′/30. With steps near
//! 1e-3 both truncation and rounding stay far below what a wrong sign or a forgotten term leaves.

use nalgebra::{SMatrix, SVector};

/// ∂f/∂δ at δ = 0, column by column, with the same `step` in every coordinate.
pub fn numeric_jacobian<const ROWS: usize, const COLUMNS: usize>(
    step: f64,
    f: impl Fn(&SVector<f64, COLUMNS>) -> SVector<f64, ROWS>,
) -> SMatrix<f64, ROWS, COLUMNS> {
    let mut jacobian = SMatrix::<f64, ROWS, COLUMNS>::zeros();
    for column in 0..COLUMNS {
        let at = |multiple: f64| {
            let mut delta = SVector::<f64, COLUMNS>::zeros();
            delta[column] = multiple * step;
            f(&delta)
        };
        let near = at(1.0) - at(-1.0);
        let far = at(2.0) - at(-2.0);
        jacobian.set_column(column, &((near * 8.0 - far) / (12.0 * step)));
    }
    jacobian
}

/// Panics, naming the worst entry, unless `analytic` and `numeric` agree within `tolerance` (absolute, relaxed in
/// proportion for entries above 1).
///
/// # Panics
/// When an entry differs by more.
#[track_caller]
pub fn assert_jacobians_agree<const ROWS: usize, const COLUMNS: usize>(
    analytic: &SMatrix<f64, ROWS, COLUMNS>,
    numeric: &SMatrix<f64, ROWS, COLUMNS>,
    tolerance: f64,
) {
    let mut worst = (0.0, 0, 0);
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            let (a, n) = (analytic[(row, column)], numeric[(row, column)]);
            let error = (a - n).abs() / n.abs().max(1.0);
            // A NaN on either side is the worst of all.
            if error.is_nan() || error > worst.0 {
                worst = (if error.is_nan() { f64::INFINITY } else { error }, row, column);
            }
        }
    }
    let (error, row, column) = worst;
    assert!(
        error <= tolerance,
        "entry ({row}, {column}): analytic {}, numeric {}, error {error:e} > {tolerance:e}",
        analytic[(row, column)],
        numeric[(row, column)],
    );
}

/// `Σ cos(i + 2j)·A_ij` and the Frobenius norm: together they catch a transposed, mis-signed or misplaced entry of a matrix
/// whose golden values are too many to write down.
pub fn fingerprint<const ROWS: usize, const COLUMNS: usize>(matrix: &SMatrix<f64, ROWS, COLUMNS>) -> (f64, f64) {
    let mut sum = 0.0;
    for row in 0..ROWS {
        for column in 0..COLUMNS {
            sum += ((row + 2 * column) as f64).cos() * matrix[(row, column)];
        }
    }
    (sum, matrix.norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2, Vector3};

    #[test]
    fn the_derivative_of_a_function_of_two_blocks_is_found() {
        // f(x, y, z) = (sin(x)·y, z³ + x·z) at (0.3, −2, 1.5)
        let at = Vector3::new(0.3_f64, -2.0, 1.5);
        let numeric = numeric_jacobian(1e-3, |d: &Vector3<f64>| {
            let p = at + d;
            Vector2::new(p.x.sin() * p.y, p.z.powi(3) + p.x * p.z)
        });
        let known = nalgebra::Matrix2x3::new(at.x.cos() * at.y, at.x.sin(), 0.0, at.z, 0.0, 3.0 * at.z * at.z + at.x);
        assert_jacobians_agree(&known, &numeric, 1e-11);
    }

    #[test]
    #[should_panic(expected = "entry (1, 0)")]
    fn a_wrong_entry_is_named() {
        let right = Matrix2::new(1.0, 2.0, 3.0, 4.0);
        let wrong = Matrix2::new(1.0, 2.0, -3.0, 4.0);
        assert_jacobians_agree(&wrong, &right, 1e-9);
    }

    #[test]
    #[should_panic(expected = "analytic NaN")]
    fn not_a_number_is_no_agreement() {
        assert_jacobians_agree(&Matrix2::repeat(f64::NAN), &Matrix2::zeros(), 1e-9);
    }

    #[test]
    fn a_fingerprint_tells_a_matrix_from_its_transpose() {
        let matrix = Matrix2::new(1.0, 2.0, 3.0, 4.0);
        let (sum, norm) = fingerprint(&matrix);
        assert!((norm - 30.0_f64.sqrt()).abs() < 1e-15);
        assert!((sum - fingerprint(&matrix.transpose()).0).abs() > 0.1);
    }
}
