//! Systematic errors beside the chain: columns of which the solution itself knows nothing.
//!
//! For each error alone, say stamps of a sensor that are too late by τ: what would the window say τ is? The normal equations gain a
//! column F and a corner S (the arrow of §4.4 of the method), swept along with the chain:
//!
//! ```text
//! f_k = F_k − ρ Y_{k−1}ᵀ z_{k−1}    z_k = L_k⁻¹ f_k    S_k = S_own + ρ² S_{k−1} − z_kᵀz_k    s_k = s_own + ρ s_{k−1} − z_kᵀy_k
//! τ̂ = s_n / S_n,   σ_τ² = 1 / S_n,   ∂x_n/∂τ = −L_n⁻ᵀ z_n
//! ```
//!
//! Under the hypothesis that every stamp is right τ̂ has mean 0 and exactly that variance, whatever the motion: a direction
//! in which τ cannot be told from the state (the range along a straight course) has no information in S_n. The alternative
//! that is tested is an offset that has grown to τ by now, τ e^{−(t_n − t)/T}: ρ = e^{−(t_k − t_{k−1})/T}. So an offset that
//! appears in mid-mission is not weighed against the hours before it. There are two T: the short one sees a step soon,
//! the long one sees what only a whole turn tells.

use nalgebra::{SMatrix, SVector};
use shared_types::Duration;

use crate::chain::Link;
use crate::kernels::{Block, BlockVector, add_product_transposed, add_times_transposed};
use crate::rows::{DIM, Slopes};
use crate::systematic::ERRORS;

/// How many memories.
pub const TERMS: usize = 2;
/// T, s.
const MEMORIES: [f64; TERMS] = [15.0, 60.0];
/// Columns: the errors of one memory, then those of the next.
pub const WIDTH: usize = TERMS * ERRORS;

/// e^{−dt/T} of one memory.
pub fn fading(dt: Duration, term: usize) -> f64 {
    (-dt.as_seconds() / MEMORIES[term]).exp()
}

/// e^{−dt/T} of each memory.
pub fn fadings(dt: Duration) -> [f64; TERMS] {
    core::array::from_fn(|term| fading(dt, term))
}

/// That of each column.
#[inline(always)]
fn faded_columns(dt: Duration) -> [f64; WIDTH] {
    let faded = fadings(dt);
    core::array::from_fn(|column| faded[column / ERRORS])
}

/// What has faded to less than this is nothing. A sensor that is heard no more leaves numbers that halve for hours until they are
/// subnormal, and then each product with one of them takes a hundred times as long.
const NEGLIGIBLE: f64 = 1e-100;

/// Nothing in the place of what is negligible.
#[inline(always)]
pub fn or_nothing(value: f64) -> f64 {
    if value.abs() < NEGLIGIBLE { 0.0 } else { value }
}

pub fn column_of(error: usize, term: usize) -> usize {
    term * ERRORS + error
}

/// The columns at one keyframe, everything before it eliminated.
#[derive(Clone, Debug)]
pub struct Columns {
    /// z transposed, one row a column of the arrow.
    z_transposed: SMatrix<f64, WIDTH, DIM>,
    /// S of each alone.
    information: SVector<f64, WIDTH>,
    right: SVector<f64, WIDTH>,
}

impl Default for Columns {
    fn default() -> Self {
        Columns { z_transposed: SMatrix::zeros(), information: SVector::zeros(), right: SVector::zeros() }
    }
}

/// What marginalised keyframes say of the errors, at the oldest.
#[derive(Clone, Debug)]
pub struct ColumnPrior {
    /// f transposed.
    f_transposed: SMatrix<f64, WIDTH, DIM>,
    /// S, each column with each: one error that is taken out changes what the others look like.
    information: SMatrix<f64, WIDTH, WIDTH>,
    right: SVector<f64, WIDTH>,
}

impl Default for ColumnPrior {
    fn default() -> Self {
        ColumnPrior { f_transposed: SMatrix::zeros(), information: SMatrix::zeros(), right: SVector::zeros() }
    }
}

impl Columns {
    /// Sweeps the columns of a swept `link`, whose own parts are `own`, after the prior or after those of the link before
    /// and the time from it.
    #[inline(always)]
    pub fn sweep(&mut self, link: &Link<DIM>, own: &Slopes, before: Before<'_>) {
        match before {
            Before::Prior(prior) => {
                self.z_transposed = prior.f_transposed;
                self.information = prior.information.diagonal();
                self.right = prior.right;
            }
            Before::Link(columns, link_before, dt) => {
                let faded = faded_columns(dt);
                self.z_transposed = columns.carried(&faded, link_before);
                for column in 0..WIDTH {
                    self.information[column] = or_nothing(faded[column] * faded[column] * columns.information[column]);
                    self.right[column] = or_nothing(faded[column] * columns.right[column]);
                }
            }
        }
        for column in 0..WIDTH {
            let error = column % ERRORS;
            for coordinate in 0..DIM {
                self.z_transposed[(column, coordinate)] += own.coupling[error][coordinate];
            }
            self.information[column] += own.information[(error, error)];
            self.right[column] += own.right[error];
        }
        link.solve_columns(&mut self.z_transposed);
        add_times_transposed(&mut self.right, &self.z_transposed, link.swept_right(), -1.0);
        for z in &self.z_transposed.data.0 {
            for column in 0..WIDTH {
                self.information[column] -= z[column] * z[column];
            }
        }
    }

    /// f on the next keyframe: −ρ Yᵀz.
    #[inline(always)]
    fn carried(&self, faded: &[f64; WIDTH], link: &Link<DIM>) -> SMatrix<f64, WIDTH, DIM> {
        let mut z_transposed = self.z_transposed;
        for z in &mut z_transposed.data.0 {
            for column in 0..WIDTH {
                z[column] *= faded[column];
            }
        }
        let mut f_transposed = SMatrix::zeros();
        add_product_transposed(&mut f_transposed, &z_transposed, link.y_transposed(), -1.0);
        for f in &mut f_transposed.data.0 {
            for column in 0..WIDTH {
                f[column] = or_nothing(f[column]);
            }
        }
        f_transposed
    }

    /// What this link, the oldest, leaves on the next when it is marginalised, `dt` later; `before` stood before it, and `own`
    /// are its own parts, as in its last sweep.
    #[inline(always)]
    pub fn marginal(&self, link: &Link<DIM>, dt: Duration, own: &Slopes, before: &ColumnPrior) -> ColumnPrior {
        let faded = faded_columns(dt);
        let mut information = before.information;
        for column in 0..WIDTH {
            let mut sums = information.data.0[column];
            for other in 0..WIDTH {
                sums[other] += own.information[(other % ERRORS, column % ERRORS)];
            }
            for z in &self.z_transposed.data.0 {
                for other in 0..WIDTH {
                    sums[other] -= z[other] * z[column];
                }
            }
            for other in 0..WIDTH {
                sums[other] = or_nothing(sums[other] * (faded[other] * faded[column]));
            }
            information.data.0[column] = sums;
        }
        ColumnPrior {
            f_transposed: self.carried(&faded, link),
            information,
            right: SVector::from_fn(|column, _| or_nothing(faded[column] * self.right[column])),
        }
    }

    /// −zᵀz of each with columns that do not fade, given transposed: what eliminating the state leaves between them.
    #[inline(always)]
    pub fn crossed<const M: usize>(&self, z_transposed: &SMatrix<f64, M, DIM>) -> SMatrix<f64, WIDTH, M> {
        let mut crossed = SMatrix::zeros();
        add_product_transposed(&mut crossed, &self.z_transposed, z_transposed, -1.0);
        crossed
    }

    /// What each memory says of an error when this is the newest keyframe.
    pub fn of(&self, error: usize) -> [Score; TERMS] {
        core::array::from_fn(|term| {
            let column = column_of(error, term);
            Score { information: self.information[column], right: self.right[column] }
        })
    }

    /// ∂x_n/∂g when `link` is the newest: how far the state is off per unit of an error.
    pub fn state_by_error(&self, link: &Link<DIM>, error: usize, term: usize) -> BlockVector<DIM> {
        let mut by_error = -self.z_transposed.row(column_of(error, term)).transpose();
        link.solve_back(&mut by_error);
        by_error
    }
}

/// What stands before a keyframe.
#[derive(Clone, Copy, Debug)]
pub enum Before<'a> {
    /// It is the oldest.
    Prior(&'a ColumnPrior),
    /// Another, that much earlier.
    Link(&'a Columns, &'a Link<DIM>, Duration),
}

/// What is known of an error: its information, one over its unit squared, and the right side; their quotient is the error.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// One over the unit squared.
    pub information: f64,
    /// One over the unit.
    pub right: f64,
}

impl ColumnPrior {
    /// Expresses it at another linearisation point of its keyframe, `step` away, with M of the prior itself.
    pub fn carry(&mut self, step: &BlockVector<DIM>, m: &Block<DIM>) {
        add_times_transposed(&mut self.right, &self.f_transposed, step, -1.0);
        self.f_transposed *= m;
    }

    /// Takes an error of `by`, as one memory has it, out of the prior's readings; `right` is the right side of the states'
    /// prior.
    pub fn shift(&mut self, error: usize, term: usize, by: f64, right: &mut BlockVector<DIM>) {
        let column = column_of(error, term);
        *right -= self.f_transposed.row(column).transpose() * by;
        self.right -= self.information.column(column) * by;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use shared_types::Calibration;

    use crate::systematic::STAMPS;

    const LINKS: usize = 5;
    const SENSOR: usize = 2;
    /// A calibration of the same sensor.
    const OTHER: usize = STAMPS + Calibration::DvlScale.index();

    struct Chain {
        links: Vec<Link<DIM>>,
        columns: Vec<Columns>,
        own: Vec<Slopes>,
        times: [f64; LINKS],
    }

    fn noise(seed: usize) -> f64 {
        ((seed as f64 * 12.9898).sin() * 43758.5453).fract()
    }

    fn chain() -> Chain {
        let mut links = vec![Link::<DIM>::default(); LINKS];
        let mut own = vec![Slopes::default(); LINKS];
        for k in 0..LINKS {
            let raw = Block::<DIM>::from_fn(|i, j| noise(1 + k * 1000 + i * 15 + j));
            links[k].diagonal = raw * raw.transpose() + Block::identity() * 20.0;
            links[k].right = BlockVector::from_fn(|i, _| noise(77 + k * 31 + i));
            if k + 1 < LINKS {
                links[k].next_transposed = Block::from_fn(|i, j| noise(500 + k * 999 + i + 15 * j));
            }
            for (error, sign) in [(SENSOR, 1.0), (OTHER, -1.0)] {
                own[k].coupling[error] = BlockVector::from_fn(|i, _| 3.0 * noise(9 + 17 * k + i + 5 * error));
                own[k].information[(error, error)] = 40.0 + k as f64;
                own[k].right[error] = 5.0 * sign * noise(k + 3);
            }
            own[k].information[(SENSOR, OTHER)] = 3.0;
            own[k].information[(OTHER, SENSOR)] = 3.0;
        }
        Chain { links, columns: vec![Columns::default(); LINKS], own, times: [0.0, 1.0, 2.2, 3.1, 4.6] }
    }

    impl Chain {
        fn sweep(&mut self, first: usize, prior: &ColumnPrior) {
            for k in first..LINKS {
                let (before, rest) = self.links.split_at_mut(k);
                rest[0].sweep(before.last().filter(|_| k > first), 0.0).expect("positive definite");
                let (before_columns, columns) = self.columns.split_at_mut(k);
                let step = |from: usize| Duration::from_seconds(self.times[k] - self.times[from]);
                let before = match k > first {
                    true => Before::Link(&before_columns[k - 1], &before[k - 1], step(k - 1)),
                    false => Before::Prior(prior),
                };
                columns[0].sweep(&rest[0], &self.own[k], before);
            }
        }

        /// S of one error with another, each by its memory, through the dense matrix.
        fn dense_crossed(&self, one: (usize, usize), other: (usize, usize)) -> f64 {
            let (matrix, _) = self.dense_chain();
            let solved = matrix.try_inverse().expect("regular") * self.dense_coupling(other);
            let own: f64 = (0..LINKS)
                .map(|k| self.share(k, one.1) * self.share(k, other.1) * self.own[k].information[(one.0, other.0)])
                .sum();
            own - self.dense_coupling(one).dot(&solved)
        }

        fn share(&self, k: usize, term: usize) -> f64 {
            fading(Duration::from_seconds(self.times[LINKS - 1] - self.times[k]), term)
        }

        fn dense_coupling(&self, (error, term): (usize, usize)) -> DVector<f64> {
            let mut coupling = DVector::zeros(DIM * LINKS);
            for k in 0..LINKS {
                coupling.rows_mut(k * DIM, DIM).copy_from(&(self.own[k].coupling[error] * self.share(k, term)));
            }
            coupling
        }

        fn dense_chain(&self) -> (DMatrix<f64>, DVector<f64>) {
            let n = DIM * LINKS;
            let (mut matrix, mut right) = (DMatrix::zeros(n, n), DVector::zeros(n));
            for k in 0..LINKS {
                right.rows_mut(k * DIM, DIM).copy_from(&self.links[k].right);
                matrix.view_mut((k * DIM, k * DIM), (DIM, DIM)).copy_from(&self.links[k].diagonal);
                if k + 1 < LINKS {
                    let next = self.links[k].next_transposed;
                    matrix.view_mut(((k + 1) * DIM, k * DIM), (DIM, DIM)).copy_from(&next);
                    matrix.view_mut((k * DIM, (k + 1) * DIM), (DIM, DIM)).copy_from(&next.transpose());
                }
            }
            (matrix, right)
        }

        /// (S, s, ∂x_n/∂g) of one error alone, through the dense matrix.
        fn dense(&self, error: usize, term: usize) -> (f64, f64, DVector<f64>) {
            let (matrix, right) = self.dense_chain();
            let coupling = self.dense_coupling((error, term));
            let score: f64 = (0..LINKS).map(|k| self.share(k, term) * self.own[k].right[error]).sum();
            let inverse = matrix.try_inverse().expect("regular");
            let by_error = -(&inverse * &coupling);
            (
                self.dense_crossed((error, term), (error, term)),
                score - coupling.dot(&(inverse * right)),
                by_error.rows((LINKS - 1) * DIM, DIM).into_owned(),
            )
        }

        /// What is left of the links up to `last` on the next; on one of the same time behind the last of all.
        fn marginalised(&self, last: usize) -> ColumnPrior {
            (0..=last).fold(ColumnPrior::default(), |before, k| {
                let dt = self.times.get(k + 1).map_or(0.0, |next| next - self.times[k]);
                self.columns[k].marginal(&self.links[k], Duration::from_seconds(dt), &self.own[k], &before)
            })
        }

        #[track_caller]
        fn assert_equals_dense(&self) {
            for (error, term) in [(SENSOR, 0), (SENSOR, 1), (OTHER, 0), (OTHER, 1)] {
                let (information, right, by_error) = self.dense(error, term);
                let score = self.columns[LINKS - 1].of(error)[term];
                assert!((score.information - information).abs() < 1e-10, "{} {information}", score.information);
                assert!((score.right - right).abs() < 1e-11, "{} {right}", score.right);
                let ours = self.columns[LINKS - 1].state_by_error(&self.links[LINKS - 1], error, term);
                assert!((ours - by_error).amax() < 1e-12);
                for other in [(SENSOR, 0), (SENSOR, 1), (OTHER, 0), (OTHER, 1)] {
                    let crossed = self.dense_crossed((error, term), other);
                    let place = (column_of(error, term), column_of(other.0, other.1));
                    let ours = self.marginalised(LINKS - 1).information[place];
                    assert!((ours - crossed).abs() < 1e-10, "{place:?}: {ours} {crossed}");
                }
            }
        }
    }

    /// A swept chain, and the columns of its first link alone.
    fn heard_once() -> (Chain, Columns) {
        let mut chain = chain();
        chain.sweep(0, &ColumnPrior::default());
        let mut columns = Columns::default();
        columns.sweep(&chain.links[0], &chain.own[0], Before::Prior(&ColumnPrior::default()));
        (chain, columns)
    }

    /// A sensor that is heard once and never again: what it leaves fades to nothing, by way of no number that slows the arithmetic.
    #[test]
    fn what_nobody_speaks_of_any_more_fades_to_nothing() {
        let (Chain { links, own, .. }, mut columns) = heard_once();
        let mut prior = columns.marginal(&links[0], Duration::from_seconds(1.0), &own[0], &ColumnPrior::default());
        assert!(prior.f_transposed.amax() > 0.0 && prior.information.amax() > 0.0);
        let nothing = Slopes::default();
        for _ in 0..100_000 {
            columns.sweep(&links[0], &nothing, Before::Prior(&prior));
            prior = columns.marginal(&links[0], Duration::from_seconds(1.0), &nothing, &prior);
            let left = prior.f_transposed.iter().chain(&prior.information).chain(&prior.right);
            let seen = columns.z_transposed.iter().chain(&columns.information);
            assert!(left.chain(seen).all(|value| !value.is_subnormal()), "{prior:?}");
        }
        assert_eq!((prior.f_transposed.amax(), prior.information.amax(), prior.right.amax()), (0.0, 0.0, 0.0));
    }

    /// The same in a window that never forgets.
    #[test]
    fn they_fade_to_nothing_from_keyframe_to_keyframe_too() {
        let (Chain { links, .. }, mut columns) = heard_once();
        assert!(columns.z_transposed.amax() > 0.0 && columns.information.amax() > 0.0);
        let (nothing, dt) = (Slopes::default(), Duration::from_seconds(1.0));
        for _ in 0..100_000 {
            let before = columns.clone();
            columns.sweep(&links[0], &nothing, Before::Link(&before, &links[0], dt));
            let seen = columns.z_transposed.iter().chain(&columns.information).chain(&columns.right);
            assert!(seen.into_iter().all(|value| !value.is_subnormal()), "{columns:?}");
        }
        assert_eq!((columns.z_transposed.amax(), columns.information.amax(), columns.right.amax()), (0.0, 0.0, 0.0));
    }

    #[test]
    fn the_columns_say_what_the_dense_arrow_says() {
        let mut chain = chain();
        chain.sweep(0, &ColumnPrior::default());
        chain.assert_equals_dense();
    }

    #[test]
    fn marginalising_keyframes_loses_nothing_of_an_offset() {
        let mut chain = chain();
        chain.sweep(0, &ColumnPrior::default());
        let before = chain.columns[LINKS - 1].of(SENSOR);
        let marginal = chain.links[1].marginal();
        let prior = chain.marginalised(1);
        chain.links[2].diagonal += marginal.information;
        chain.links[2].right += marginal.right;
        chain.sweep(2, &prior);
        for (after, before) in chain.columns[LINKS - 1].of(SENSOR).iter().zip(before) {
            assert!((after.information - before.information).abs() < 1e-10);
            assert!((after.right - before.right).abs() < 1e-11);
        }
    }

    #[test]
    fn an_offset_taken_out_of_the_prior_is_gone_from_its_score() {
        let mut chain = chain();
        chain.sweep(0, &ColumnPrior::default());
        let term = 1;
        let mut prior = chain.marginalised(LINKS - 1);
        // As the prior of a last keyframe that has nothing of its own: τ̂ is s/S of its f and x.
        let before = prior.clone();
        let (column, other) = (column_of(SENSOR, term), column_of(SENSOR, 0));
        let found = before.right[column] / before.information[(column, column)];
        let mut right = BlockVector::zeros();
        prior.shift(SENSOR, term, found, &mut right);
        assert!(prior.right[column].abs() < 1e-12);
        assert!((right + before.f_transposed.row(column).transpose() * found).amax() < 1e-15);
        let expected = before.right[other] - before.information[(column, other)] * found;
        assert!((prior.right[other] - expected).abs() < 1e-15);
    }
}
