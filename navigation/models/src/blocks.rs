//! Products of small matrices, written out for the code that runs at every IMU sample.
//!
//! The general product of the linear algebra library goes through slices and strides; these are loops of constant
//! length over whole columns, which the compiler unrolls.

use crate::kernels::dot_of;
use nalgebra::{ArrayStorage, Matrix3, SMatrix, SVector, Vector3};

/// Evaluates an expression with the widest instructions of the processor that it meets, chosen at run time. Sums keep their
/// order and nothing is fused, so the result is the same to the bit whatever is chosen.
///
/// Only what is inlined is compiled for those instructions: functions that are called in it have to be `#[inline(always)]`.
/// It is a macro so that the closure, which the compiler likes to leave outside, is.
#[macro_export]
macro_rules! wide {
    ($op:expr) => {
        $crate::dispatch(
            #[inline(always)]
            || $op,
        )
    };
}

/// What [`wide!`] is made of.
#[doc(hidden)]
#[inline(always)]
pub fn dispatch<R>(op: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(op)
}

/// `a·b`.
#[inline(always)]
pub(crate) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b) = (&a.data.0, &b.data.0);
    let mut c = Matrix3::zeros();
    for column in 0..3 {
        for row in 0..3 {
            c.data.0[column][row] = a[0][row] * b[column][0] + a[1][row] * b[column][1] + a[2][row] * b[column][2];
        }
    }
    c
}

/// `a·bᵀ`.
#[inline(always)]
pub(crate) fn product_transposed(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b) = (&a.data.0, &b.data.0);
    let mut c = Matrix3::zeros();
    for column in 0..3 {
        for row in 0..3 {
            c.data.0[column][row] = a[0][row] * b[0][column] + a[1][row] * b[1][column] + a[2][row] * b[2][column];
        }
    }
    c
}

/// `aᵀ·b`.
#[inline(always)]
pub(crate) fn transposed_product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let (a, b) = (&a.data.0, &b.data.0);
    let mut c = Matrix3::zeros();
    for column in 0..3 {
        for row in 0..3 {
            c.data.0[column][row] = a[row][0] * b[column][0] + a[row][1] * b[column][1] + a[row][2] * b[column][2];
        }
    }
    c
}

/// The block of `a` whose first element is at `row`, `column`.
#[inline(always)]
pub(crate) fn block_of<const R: usize, const C: usize, const M: usize, const N: usize>(
    a: &SMatrix<f64, M, N>,
    row: usize,
    column: usize,
) -> SMatrix<f64, R, C> {
    let mut block = SMatrix::zeros();
    for (to, from) in block.data.0.iter_mut().zip(&a.data.0[column..column + C]) {
        to.copy_from_slice(&from[row..row + R]);
    }
    block
}

/// `a·v`.
#[inline(always)]
pub(crate) fn times<const R: usize, const C: usize>(a: &SMatrix<f64, R, C>, v: &SVector<f64, C>) -> SVector<f64, R> {
    let (a, v) = (&a.data.0, &v.data.0[0]);
    let mut sum = [0.0; R];
    for row in 0..R {
        sum[row] = a[0][row] * v[0];
    }
    for column in 1..C {
        for row in 0..R {
            sum[row] += a[column][row] * v[column];
        }
    }
    SVector::from_array_storage(ArrayStorage([sum]))
}

/// `aᵀ·v`.
#[inline(always)]
pub(crate) fn transposed_times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let (a, v) = (&a.data.0, &v.data.0[0]);
    let dot = |column: usize| a[column][0] * v[0] + a[column][1] * v[1] + a[column][2] * v[2];
    Vector3::new(dot(0), dot(1), dot(2))
}

/// `a·[v]×`.
#[inline(always)]
pub(crate) fn product_with_skew(a: &Matrix3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
    let a = &a.data.0;
    let mut c = Matrix3::zeros();
    for row in 0..3 {
        c.data.0[0][row] = a[1][row] * v.z - a[2][row] * v.y;
        c.data.0[1][row] = a[2][row] * v.x - a[0][row] * v.z;
        c.data.0[2][row] = a[0][row] * v.y - a[1][row] * v.x;
    }
    c
}

/// `[v]×·a`.
#[inline(always)]
pub(crate) fn skew_product(v: &Vector3<f64>, a: &Matrix3<f64>) -> Matrix3<f64> {
    let mut c = Matrix3::zeros();
    for column in 0..3 {
        let [x, y, z] = a.data.0[column];
        c.data.0[column] = [v.y * z - v.z * y, v.z * x - v.x * z, v.x * y - v.y * x];
    }
    c
}

/// `rᵀ·C·r` of a symmetric C and three columns r.
#[inline(always)]
pub(crate) fn sandwich<const N: usize>(r: &SMatrix<f64, N, 3>, c: &SMatrix<f64, N, N>) -> Matrix3<f64> {
    let (r_columns, c_columns) = (&r.data.0, &c.data.0);
    let mut result = Matrix3::zeros();
    for right in 0..3 {
        let mut product = [0.0; N];
        for column in 0..N {
            let factor = r_columns[right][column];
            for row in 0..N {
                product[row] += c_columns[column][row] * factor;
            }
        }
        for left in 0..=right {
            let sum = dot_of(&r_columns[left], &product);
            result[(left, right)] = sum;
            result[(right, left)] = sum;
        }
    }
    result
}

/// What is left of a diagonal element after the elimination of those before it, relative to what it was: less is rounding.
const PIVOT_FLOOR: f64 = 1e-13;

/// L⁻¹ of `P = LLᵀ`, lower triangular; `None` unless P is safely positive definite: a singular one that passes by rounding would
/// give a certainty of a billionth part of what is known. Reads the lower triangle of P alone.
#[inline]
pub(crate) fn inverse_cholesky<const N: usize>(p: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    // Columns below the diagonal; right-looking, so that the inner loops run down whole columns.
    let mut l = p.data.0;
    let mut inverse_diagonal = [0.0; N];
    for column in 0..N {
        let pivot = l[column][column];
        // A pivot that is no number is not positive either.
        if pivot.is_nan() || pivot <= PIVOT_FLOOR * p[(column, column)].abs() || pivot <= 0.0 || pivot.is_infinite() {
            return None;
        }
        let scale = 1.0 / pivot.sqrt();
        inverse_diagonal[column] = scale;
        for row in column..N {
            l[column][row] *= scale;
        }
        for later in column + 1..N {
            let factor = l[column][later];
            for row in later..N {
                l[later][row] -= l[column][row] * factor;
            }
        }
    }
    let mut inverse = [[0.0; N]; N];
    for column in 0..N {
        let mut x = [0.0; N];
        x[column] = 1.0;
        for row in column..N {
            let factor = x[row] * inverse_diagonal[row];
            x[row] = factor;
            for below in row + 1..N {
                x[below] -= l[row][below] * factor;
            }
        }
        inverse[column] = x;
    }
    let inverse = SMatrix::<f64, N, N>::from_array_storage(nalgebra::ArrayStorage(inverse));
    inverse.iter().all(|x| x.is_finite()).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nav_geometry::so3::skew;

    #[cfg(target_arch = "x86_64")]
    #[test]
    fn a_processor_with_avx2_is_used_as_one() {
        let has_it = std::arch::is_x86_feature_detected!("avx2")
            && std::arch::is_x86_feature_detected!("fma")
            && std::arch::is_x86_feature_detected!("bmi2")
            && std::arch::is_x86_feature_detected!("lzcnt");
        // A build of `pulp` without its instruction sets does not know this name.
        assert_eq!(matches!(pulp::Arch::new(), pulp::Arch::V3(_)), has_it);
    }

    #[test]
    fn written_out_products_are_the_products() {
        let a = Matrix3::from_fn(|row, column| ((row * 5 + column * 3) as f64).sin());
        let b = Matrix3::from_fn(|row, column| ((row * 2 + column * 7) as f64).cos());
        assert_relative_eq!(product(&a, &b), a * b, epsilon = 1e-15);
        assert_relative_eq!(product_transposed(&a, &b), a * b.transpose(), epsilon = 1e-15);
        assert_relative_eq!(transposed_product(&a, &b), a.transpose() * b, epsilon = 1e-15);
        let v = Vector3::new(0.3, -1.2, 0.7);
        assert_relative_eq!(product_with_skew(&a, &v), a * skew(&v), epsilon = 1e-15);
        assert_relative_eq!(skew_product(&v, &a), skew(&v) * a, epsilon = 1e-15);
        assert_relative_eq!(times(&a, &v), a * v, epsilon = 1e-15);
        assert_relative_eq!(transposed_times(&a, &v), a.transpose() * v, epsilon = 1e-15);
        let wide = SMatrix::<f64, 4, 7>::from_fn(|row, column| (row * 10 + column) as f64);
        assert_eq!(block_of::<2, 3, 4, 7>(&wide, 1, 3), wide.fixed_view::<2, 3>(1, 3).into_owned());
        let r = SMatrix::<f64, 5, 3>::from_fn(|row, column| ((row * 3 + column) as f64).sin());
        let root = SMatrix::<f64, 5, 5>::from_fn(|row, column| ((row * 11 + column * 4) as f64).cos());
        let c = root * root.transpose();
        assert_relative_eq!(sandwich(&r, &c), r.transpose() * c * r, epsilon = 1e-14);
    }

    #[test]
    fn an_inverse_root_whitens_and_an_indefinite_matrix_has_none() {
        let root = SMatrix::<f64, 5, 5>::from_fn(|row, column| ((row * 11 + column * 4) as f64).cos());
        let p = root * root.transpose() + SMatrix::identity();
        let w = inverse_cholesky(&p).expect("positive definite");
        assert_relative_eq!(w * p * w.transpose(), SMatrix::identity(), epsilon = 1e-13);
        assert_eq!(w.upper_triangle(), SMatrix::<f64, 5, 5>::from_diagonal(&w.diagonal()));
        assert_relative_eq!(w.transpose() * w * p, SMatrix::identity(), epsilon = 1e-12);
        let mut spoilt = p;
        spoilt[(3, 3)] = -1.0;
        assert_eq!(inverse_cholesky(&spoilt), None);
        spoilt[(3, 3)] = f64::NAN;
        assert_eq!(inverse_cholesky(&spoilt), None);
    }
}
