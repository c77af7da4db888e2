//! Dense kernels on small square blocks, const-generic in the block size.
//!
//! Every loop runs down columns of column-major blocks, so that the compiler vectorises it without reassociating sums:
//! the result is the same bits at every vector width that has the same fused multiply-add. `nalgebra`'s own products go
//! through a general matrix multiplication at these sizes; on this shape these are twice as fast (`benches/chain.rs`).

use nalgebra::{SMatrix, SVector};

/// A square block of the normal matrix.
pub type Block<const N: usize> = SMatrix<f64, N, N>;
/// A block row of the right side.
pub type BlockVector<const N: usize> = SVector<f64, N>;

/// Pivots below this share of the original diagonal entry are lost to rounding: the direction carries no information.
const PIVOT_FLOOR: f64 = 1e-13;

/// A diagonal block that is not positive definite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotPositiveDefinite {
    /// Row of the failing pivot.
    pub row: usize,
}

/// Columns that are worked on from the same row down: triangles are cut into steps of so many, which a vector holds.
pub const BAND: usize = 4;

/// Lower Cholesky factor of a symmetric block, of which only the lower triangle is read. The strict upper triangle of
/// the result is zero.
///
/// As L D Lᵀ first, columns scaled by √D at the end and all at once: roots need not be waited for one after another.
///
/// # Errors
/// [`NotPositiveDefinite`] at the first pivot that is not safely positive; NaN counts as not positive.
#[inline(always)]
pub fn cholesky<const N: usize>(block: &Block<N>) -> Result<Block<N>, NotPositiveDefinite> {
    const { assert!(N <= 4 * BAND, "bands are written out") }
    let mut columns = [[0.0; N]; N];
    let mut inverse_pivots = [0.0; N];
    eliminate_band::<N, 0>(block, &mut columns, &mut inverse_pivots)?;
    eliminate_band::<N, { BAND }>(block, &mut columns, &mut inverse_pivots)?;
    eliminate_band::<N, { 2 * BAND }>(block, &mut columns, &mut inverse_pivots)?;
    eliminate_band::<N, { 3 * BAND }>(block, &mut columns, &mut inverse_pivots)?;
    let scales = inverse_pivots.map(f64::sqrt);
    for j in 0..N {
        for i in 0..N {
            columns[j][i] = if i < j { 0.0 } else { columns[j][i] * scales[j] };
        }
    }
    Ok(Block::from_array_storage(nalgebra::ArrayStorage(columns)))
}

/// The columns of L D from `FROM` on, as many as a band has, down from row `FROM`.
#[inline(always)]
fn eliminate_band<const N: usize, const FROM: usize>(
    block: &Block<N>,
    columns: &mut [[f64; N]; N],
    inverse_pivots: &mut [f64; N],
) -> Result<(), NotPositiveDefinite> {
    for j in FROM..N.min(FROM + BAND) {
        let mut column = block.data.0[j];
        for k in 0..j {
            let factor = columns[k][j] * inverse_pivots[k];
            for i in FROM..N {
                column[i] -= columns[k][i] * factor;
            }
        }
        let pivot = column[j];
        // The negated comparison also catches NaN.
        if !(pivot > PIVOT_FLOOR * block[(j, j)].abs() && pivot > 0.0 && pivot.is_finite()) {
            return Err(NotPositiveDefinite { row: j });
        }
        inverse_pivots[j] = 1.0 / pivot;
        columns[j] = column;
    }
    Ok(())
}

/// 1/L_jj.
#[inline(always)]
pub fn inverse_diagonal<const N: usize>(l: &Block<N>) -> [f64; N] {
    core::array::from_fn::<f64, N, _>(|j| l.data.0[j][j]).map(|pivot| 1.0 / pivot)
}

/// Solves L X = B in place, given and returned transposed: column j of `bt` is row j of B.
#[inline(always)]
pub fn solve_lower_transposed<const N: usize, const M: usize>(l: &Block<N>, bt: &mut SMatrix<f64, M, N>) {
    let inverse = inverse_diagonal(l);
    let x = &mut bt.data.0;
    for i in 0..N {
        let mut row = x[i];
        for j in 0..i {
            let factor = l.data.0[j][i];
            for m in 0..M {
                row[m] -= x[j][m] * factor;
            }
        }
        for m in 0..M {
            row[m] *= inverse[i];
        }
        x[i] = row;
    }
}

/// Solves L x = b in place, for an L with nothing above its diagonal.
#[inline(always)]
pub fn solve_lower<const N: usize>(l: &Block<N>, b: &mut BlockVector<N>) {
    let mut rest = b.data.0[0];
    let x = &mut b.data.0[0];
    for j in 0..N {
        let value = rest[j] / l.data.0[j][j];
        x[j] = value;
        // Over whole columns: of what is solved already zeros are taken.
        for i in 0..N {
            rest[i] -= l.data.0[j][i] * value;
        }
    }
}

/// Solves Lᵀ x = b in place, for an L with nothing above its diagonal: given are Lᵀ and 1/L_jj.
///
/// By columns, as [`solve_lower`]: one unknown waits for a product and a difference of the last, not for a sum and a quotient.
#[inline(always)]
pub fn solve_upper<const N: usize>(l_transposed: &Block<N>, inverse_diagonal: &[f64; N], b: &mut BlockVector<N>) {
    let mut rest = b.data.0[0];
    let x = &mut b.data.0[0];
    for j in (0..N).rev() {
        let value = rest[j] * inverse_diagonal[j];
        x[j] = value;
        for i in 0..N {
            rest[i] -= l_transposed.data.0[j][i] * value;
        }
    }
}

/// target += sign · Xᵀ X for X given transposed (`xt`, one column per row of X) and a symmetric target.
#[inline(always)]
pub fn add_gram_transposed<const N: usize, const R: usize>(target: &mut Block<N>, xt: &SMatrix<f64, N, R>, sign: f64) {
    add_gram_lower(target, xt, sign);
    mirror_lower(target);
}

/// The same for whoever reads the lower triangle alone; what stands above it afterwards is no part of the result.
#[inline(always)]
pub fn add_gram_lower<const N: usize, const R: usize>(target: &mut Block<N>, xt: &SMatrix<f64, N, R>, sign: f64) {
    const { assert!(N <= 4 * BAND, "bands are written out") }
    add_gram_band::<N, R, 0>(target, xt, sign);
    add_gram_band::<N, R, { BAND }>(target, xt, sign);
    add_gram_band::<N, R, { 2 * BAND }>(target, xt, sign);
    add_gram_band::<N, R, { 3 * BAND }>(target, xt, sign);
}

#[inline(always)]
fn add_gram_band<const N: usize, const R: usize, const FROM: usize>(
    target: &mut Block<N>,
    xt: &SMatrix<f64, N, R>,
    sign: f64,
) {
    for m in FROM..N.min(FROM + BAND) {
        let mut column = target.data.0[m];
        for r in 0..R {
            let x = &xt.data.0[r];
            let factor = sign * x[m];
            for n in FROM..N {
                column[n] += x[n] * factor;
            }
        }
        target.data.0[m] = column;
    }
}

/// Puts above the diagonal what stands below it.
#[inline(always)]
pub fn mirror_lower<const N: usize>(block: &mut Block<N>) {
    for j in 1..N {
        for i in 0..j {
            block.data.0[j][i] = block.data.0[i][j];
        }
    }
}

/// target += sign · Aᵀ B for A and B given transposed: `at` is N × R, `bt` is M × R, so Aᵀ B = at · btᵀ.
#[inline(always)]
pub fn add_product_transposed<const N: usize, const M: usize, const R: usize>(
    target: &mut SMatrix<f64, N, M>,
    at: &SMatrix<f64, N, R>,
    bt: &SMatrix<f64, M, R>,
    sign: f64,
) {
    for m in 0..M {
        let mut column = target.data.0[m];
        for r in 0..R {
            let factor = sign * bt.data.0[r][m];
            let a = &at.data.0[r];
            for n in 0..N {
                column[n] += a[n] * factor;
            }
        }
        target.data.0[m] = column;
    }
}

/// target += sign · Xᵀ v for X given transposed.
#[inline(always)]
pub fn add_times_transposed<const N: usize, const R: usize>(
    target: &mut BlockVector<N>,
    xt: &SMatrix<f64, N, R>,
    v: &SVector<f64, R>,
    sign: f64,
) {
    let mut sum = target.data.0[0];
    for r in 0..R {
        let factor = sign * v.data.0[0][r];
        let x = &xt.data.0[r];
        for n in 0..N {
            sum[n] += x[n] * factor;
        }
    }
    target.data.0[0] = sum;
}

/// aᵀb, summed in four strands, so that one addition need not wait for the last.
#[inline(always)]
pub fn dot<const N: usize>(a: &BlockVector<N>, b: &BlockVector<N>) -> f64 {
    dot_of(&a.data.0[0], &b.data.0[0])
}

#[inline(always)]
pub(crate) fn dot_of<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    const STRANDS: usize = 4;
    let mut strands = [0.0; STRANDS];
    let whole = N - N % STRANDS;
    for first in (0..whole).step_by(STRANDS) {
        for strand in 0..STRANDS {
            strands[strand] += a[first + strand] * b[first + strand];
        }
    }
    for i in whole..N {
        strands[i - whole] += a[i] * b[i];
    }
    (strands[0] + strands[1]) + (strands[2] + strands[3])
}

/// Inverse of L Lᵀ.
#[inline(always)]
pub fn inverse_from_cholesky<const N: usize>(l: &Block<N>) -> Block<N> {
    // Column j of `xt` is row j of L⁻¹; (L Lᵀ)⁻¹ = L⁻ᵀ L⁻¹ = Xᵀ X.
    let mut xt = Block::<N>::identity();
    solve_lower_transposed(l, &mut xt);
    let mut inverse = Block::<N>::zeros();
    add_gram_transposed(&mut inverse, &xt, 1.0);
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    type B = Block<15>;

    fn well_conditioned() -> B {
        let raw = B::from_fn(|i, j| ((i * 7 + j * 13 + 3) as f64).sin());
        raw * raw.transpose() + B::identity() * 0.5
    }

    #[test]
    fn cholesky_times_its_transpose_gives_the_block_back() {
        let block = well_conditioned();
        let l = cholesky(&block).expect("positive definite");
        assert!((l * l.transpose() - block).amax() < 1e-13 * block.amax());
        assert!((0..15).all(|j| (0..j).all(|i| l[(i, j)] == 0.0)));
    }

    #[test]
    fn triangular_solves_invert_the_factor() {
        let l = cholesky(&well_conditioned()).expect("positive definite");
        let b = BlockVector::<15>::from_fn(|i, _| i as f64 - 4.0);
        let mut x = b;
        solve_lower(&l, &mut x);
        assert!((l * x - b).amax() < 1e-12);
        let mut x = b;
        solve_upper(&l.transpose(), &inverse_diagonal(&l), &mut x);
        assert!((l.transpose() * x - b).amax() < 1e-12);
        let right = B::from_fn(|i, j| (i as f64 * 0.3 - j as f64).cos());
        let mut xt = right.transpose();
        solve_lower_transposed(&l, &mut xt);
        assert!((l * xt.transpose() - right).amax() < 1e-12);
    }

    #[test]
    fn products_agree_with_nalgebra() {
        let a = SMatrix::<f64, 3, 15>::from_fn(|i, j| (i as f64 + 1.3 * j as f64).sin());
        let b = SMatrix::<f64, 3, 15>::from_fn(|i, j| (2.0 * i as f64 - j as f64).cos());
        let mut target = B::identity();
        add_product_transposed(&mut target, &a.transpose(), &b.transpose(), -2.0);
        assert!((target - (B::identity() - a.transpose() * b * 2.0)).amax() < 1e-13);
        let v = SVector::<f64, 3>::new(1.0, -2.0, 0.5);
        let mut sum = BlockVector::<15>::zeros();
        add_times_transposed(&mut sum, &a.transpose(), &v, 1.0);
        assert!((sum - a.transpose() * v).amax() < 1e-13);
        let w = BlockVector::<15>::from_fn(|i, _| 0.3 * i as f64 - 1.0);
        assert!((dot(&sum, &w) - sum.dot(&w)).abs() < 1e-13);
    }

    #[test]
    fn the_inverse_is_the_inverse() {
        let block = well_conditioned();
        let inverse = inverse_from_cholesky(&cholesky(&block).expect("positive definite"));
        assert!((inverse * block - B::identity()).amax() < 1e-10);
    }

    #[test]
    fn a_direction_without_information_is_reported() {
        let mut block = well_conditioned();
        block.fill_row(9, 0.0);
        block.fill_column(9, 0.0);
        assert_eq!(cholesky(&block), Err(NotPositiveDefinite { row: 9 }));
        block[(2, 2)] = f64::NAN;
        assert_eq!(cholesky(&block), Err(NotPositiveDefinite { row: 2 }));
    }
}
