//! The block-tridiagonal chain: one link per keyframe, coupled to the next only.
//!
//! ```text
//! for k = 0..n−1:  D_k = L_k L_kᵀ   Y_k = L_k⁻¹ O_k   y_k = L_k⁻¹ b_k   D_{k+1} −= Y_kᵀ Y_k   b_{k+1} −= Y_kᵀ y_k
//! D_n = L_n L_nᵀ                     δ_n = D_n⁻¹ b_n  for k = n−1..0: δ_k = L_k⁻ᵀ (y_k − Y_k δ_{k+1})
//! ```
//!
//! §4.3 of the method. A link keeps its factors, so that only what follows a change is swept again. Off-diagonal blocks
//! are held transposed, which is the layout that the kernels want.

use nalgebra::SMatrix;

use crate::kernels::{
    Block, BlockVector, NotPositiveDefinite, add_gram_lower, add_gram_transposed, add_product_transposed,
    add_times_transposed, cholesky, inverse_diagonal, inverse_from_cholesky, solve_lower, solve_lower_transposed,
    solve_upper,
};

/// One keyframe's part of the normal equations and of their factorisation.
#[derive(Clone, Debug)]
pub struct Link<const N: usize> {
    /// Diagonal block D_k: everything that touches this keyframe, prior included.
    pub diagonal: Block<N>,
    /// Off-diagonal block to the next keyframe, transposed: O_kᵀ.
    pub next_transposed: Block<N>,
    /// Right side b_k, the negative gradient.
    pub right: BlockVector<N>,
    /// Cholesky factor L_k of the swept diagonal block.
    factor: Block<N>,
    /// L_kᵀ and the inverse of its diagonal: a link is substituted many times for each time that it is swept.
    factor_transposed: Block<N>,
    inverse_diagonal: [f64; N],
    /// Y_k, and transposed.
    y_block: Block<N>,
    y_transposed: Block<N>,
    /// y_k.
    y: BlockVector<N>,
}

impl<const N: usize> Default for Link<N> {
    fn default() -> Self {
        Link {
            diagonal: Block::zeros(),
            next_transposed: Block::zeros(),
            right: BlockVector::zeros(),
            factor: Block::identity(),
            factor_transposed: Block::identity(),
            inverse_diagonal: [1.0; N],
            y_block: Block::zeros(),
            y_transposed: Block::zeros(),
            y: BlockVector::zeros(),
        }
    }
}

/// What marginalising a link leaves on its successor: ½ δᵀ Λ δ − ηᵀ δ.
#[derive(Clone, Debug, PartialEq)]
pub struct Marginal<const N: usize> {
    /// Information Λ that is *subtracted from* the successor's own part (−Y ᵀY).
    pub information: Block<N>,
    /// Right side that is added (−Yᵀ y).
    pub right: BlockVector<N>,
}

impl<const N: usize> Link<N> {
    /// Factorises this link after its predecessor, if it has one. `damping` is added to the diagonal in shares of it.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`]: the information up to here does not determine this keyframe.
    #[inline(always)]
    pub fn sweep(&mut self, previous: Option<&Link<N>>, damping: f64) -> Result<(), NotPositiveDefinite> {
        let mut swept = self.diagonal;
        let mut right = self.right;
        if damping > 0.0 {
            for i in 0..N {
                swept[(i, i)] *= 1.0 + damping;
            }
        }
        if let Some(previous) = previous {
            add_gram_lower(&mut swept, &previous.y_transposed, -1.0);
            add_times_transposed(&mut right, &previous.y_transposed, &previous.y, -1.0);
        }
        self.factor = cholesky(&swept)?;
        self.factor_transposed = self.factor.transpose();
        self.inverse_diagonal = inverse_diagonal(&self.factor);
        self.y_transposed = self.next_transposed;
        solve_lower_transposed(&self.factor, &mut self.y_transposed);
        self.y_block = self.y_transposed.transpose();
        solve_lower(&self.factor, &mut right);
        self.y = right;
        Ok(())
    }

    /// δ_k, given that of the next keyframe (`None` for the newest).
    #[inline(always)]
    pub fn substitute(&self, next: Option<&BlockVector<N>>) -> BlockVector<N> {
        let mut delta = self.y;
        if let Some(next) = next {
            add_times_transposed(&mut delta, &self.y_block, next, -1.0);
        }
        self.solve_back(&mut delta);
        delta
    }

    /// Y_kᵀ of the last sweep.
    #[inline(always)]
    pub fn y_transposed(&self) -> &Block<N> {
        &self.y_transposed
    }

    /// y_k = L_k⁻¹ b_k of the last sweep.
    #[inline(always)]
    pub fn swept_right(&self) -> &BlockVector<N> {
        &self.y
    }

    /// x ← L_k⁻ᵀ x.
    #[inline(always)]
    pub fn solve_back(&self, x: &mut BlockVector<N>) {
        solve_upper(&self.factor_transposed, &self.inverse_diagonal, x);
    }

    /// X ← L_k⁻¹ X of columns that stand beside the chain, given and returned transposed.
    #[inline(always)]
    pub fn solve_columns<const M: usize>(&self, x_transposed: &mut SMatrix<f64, M, N>) {
        solve_lower_transposed(&self.factor, x_transposed);
    }

    /// What remains on the next keyframe when this one, the oldest, is marginalised.
    #[inline(always)]
    pub fn marginal(&self) -> Marginal<N> {
        let mut information = Block::zeros();
        add_gram_transposed(&mut information, &self.y_transposed, -1.0);
        let mut right = BlockVector::zeros();
        add_times_transposed(&mut right, &self.y_transposed, &self.y, -1.0);
        Marginal { information, right }
    }

    /// Covariance of this keyframe as the newest of the chain: everything before it marginalised.
    #[inline(always)]
    pub fn covariance(&self) -> Block<N> {
        inverse_from_cholesky(&self.factor)
    }

    /// Covariance of this keyframe given that of the next: C_k = L⁻ᵀ (I + Y C Yᵀ) L⁻¹.
    #[inline(always)]
    pub fn covariance_before(&self, next: &Block<N>) -> Block<N> {
        // L⁻ᵀ as the columns of L⁻¹, and X = L⁻ᵀ Y.
        let mut inverse_transposed = Block::<N>::identity();
        solve_lower_transposed(&self.factor, &mut inverse_transposed);
        let mut x = Block::<N>::zeros();
        add_product_transposed(&mut x, &inverse_transposed, &self.y_transposed, 1.0);
        let mut carried = Block::<N>::zeros();
        add_product_transposed(&mut carried, &x, next, 1.0);
        let mut covariance = Block::<N>::zeros();
        add_gram_transposed(&mut covariance, &inverse_transposed, 1.0);
        add_product_transposed(&mut covariance, &carried, &x, 1.0);
        covariance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::linalg::solvers::Solve;
    use nalgebra::DMatrix;
    use nav_models::wide;

    const N: usize = 15;
    const LINKS: usize = 7;

    /// A chain with random couplings, its dense matrix and right side.
    fn chain() -> (Vec<Link<N>>, DMatrix<f64>, Vec<f64>) {
        let noise = |seed: usize| ((seed as f64 * 12.9898).sin() * 43758.5453).fract();
        let mut dense = DMatrix::zeros(N * LINKS, N * LINKS);
        let mut links = vec![Link::<N>::default(); LINKS];
        for k in 0..LINKS {
            let raw = Block::<N>::from_fn(|i, j| noise(1 + k * 1000 + i * 15 + j));
            links[k].diagonal = raw * raw.transpose() + Block::identity() * 20.0;
            links[k].right = BlockVector::from_fn(|i, _| noise(77 + k * 31 + i));
            if k + 1 < LINKS {
                links[k].next_transposed = Block::from_fn(|i, j| noise(500 + k * 999 + i + 15 * j));
                let next = links[k].next_transposed;
                dense.view_mut(((k + 1) * N, k * N), (N, N)).copy_from(&next);
                dense.view_mut((k * N, (k + 1) * N), (N, N)).copy_from(&next.transpose());
            }
            dense.view_mut((k * N, k * N), (N, N)).copy_from(&links[k].diagonal);
        }
        let right = links.iter().flat_map(|link| link.right.iter().copied()).collect();
        (links, dense, right)
    }

    fn sweep(links: &mut [Link<N>], from: usize) {
        for k in from..links.len() {
            let (before, rest) = links.split_at_mut(k);
            rest[0].sweep(before.last(), 0.0).expect("positive definite");
        }
    }

    fn substitute(links: &[Link<N>]) -> Vec<f64> {
        let mut deltas = vec![BlockVector::<N>::zeros(); links.len()];
        let mut next: Option<BlockVector<N>> = None;
        for k in (0..links.len()).rev() {
            deltas[k] = links[k].substitute(next.as_ref());
            next = Some(deltas[k]);
        }
        deltas.iter().flat_map(|d| d.iter().copied().collect::<Vec<_>>()).collect()
    }

    fn oracle(dense: &DMatrix<f64>, right: &[f64]) -> Vec<f64> {
        let matrix = faer::Mat::from_fn(dense.nrows(), dense.ncols(), |i, j| dense[(i, j)]);
        let b = faer::Mat::from_fn(right.len(), 1, |i, _| right[i]);
        let x = matrix.llt(faer::Side::Lower).expect("positive definite").solve(&b);
        (0..right.len()).map(|i| x[(i, 0)]).collect()
    }

    #[test]
    fn the_chain_solves_what_a_dense_solver_solves() {
        let (mut links, dense, right) = chain();
        sweep(&mut links, 0);
        for (ours, theirs) in substitute(&links).iter().zip(oracle(&dense, &right)) {
            assert!((ours - theirs).abs() < 1e-12, "{ours} {theirs}");
        }
    }

    #[test]
    fn a_sweep_from_the_changed_link_equals_a_whole_one() {
        let (mut links, mut dense, mut right) = chain();
        sweep(&mut links, 0);
        links[4].diagonal[(3, 3)] += 2.0;
        links[4].right[5] -= 1.0;
        dense[(4 * N + 3, 4 * N + 3)] += 2.0;
        right[4 * N + 5] -= 1.0;
        sweep(&mut links, 4);
        for (ours, theirs) in substitute(&links).iter().zip(oracle(&dense, &right)) {
            assert!((ours - theirs).abs() < 1e-12, "{ours} {theirs}");
        }
    }

    #[test]
    fn marginalising_the_oldest_changes_no_other_solution() {
        let (mut links, _, _) = chain();
        sweep(&mut links, 0);
        let whole = substitute(&links);
        let Marginal { information, right } = links[0].marginal();
        let mut rest = links.split_off(1);
        rest[0].diagonal += information;
        rest[0].right += right;
        sweep(&mut rest, 0);
        for (ours, theirs) in substitute(&rest).iter().zip(&whole[N..]) {
            assert!((ours - theirs).abs() < 1e-12, "{ours} {theirs}");
        }
    }

    #[test]
    fn covariances_are_the_blocks_of_the_dense_inverse() {
        let (mut links, dense, _) = chain();
        sweep(&mut links, 0);
        let inverse = dense.try_inverse().expect("regular");
        let mut covariance = links[LINKS - 1].covariance();
        for k in (0..LINKS).rev() {
            if k + 1 < LINKS {
                covariance = links[k].covariance_before(&covariance);
            }
            let block = inverse.view((k * N, k * N), (N, N));
            assert!((covariance - block).amax() < 1e-12, "link {k}");
        }
    }

    #[test]
    fn the_same_bits_with_and_without_wide_instructions() {
        let (mut narrow, _, _) = chain();
        let mut wider = narrow.clone();
        for k in 0..LINKS {
            let (before, rest) = narrow.split_at_mut(k);
            rest[0].sweep(before.last(), 0.0).expect("positive definite");
            let (before, rest) = wider.split_at_mut(k);
            wide!(rest[0].sweep(before.last(), 0.0)).expect("positive definite");
            assert_eq!(bits(&rest[0].factor), bits(&narrow[k].factor), "link {k}");
            assert_eq!(bits(&rest[0].y_transposed), bits(&narrow[k].y_transposed), "link {k}");
        }
        let next = narrow[LINKS - 1].substitute(None);
        let (step, wide_step) =
            (narrow[LINKS - 2].substitute(Some(&next)), wide!(wider[LINKS - 2].substitute(Some(&next))));
        assert_eq!(bits(&step), bits(&wide_step));
        let last = &narrow[LINKS - 1];
        assert_eq!(bits(&last.covariance()), bits(&wide!(last.covariance())));
    }

    fn bits<const R: usize, const C: usize>(matrix: &SMatrix<f64, R, C>) -> Vec<u64> {
        matrix.iter().map(|value| value.to_bits()).collect()
    }
}
