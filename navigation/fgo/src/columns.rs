//! Time offsets beside the chain: columns of which the solution itself knows nothing.
//!
//! For each sensor alone: if its stamps were too late by τ, what would the window say τ is? The normal equations gain a
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

use nav_models::wide;
use shared_types::{AIDING, Duration};

use crate::chain::Link;
use crate::kernels::{Block, BlockVector, add_times_transposed, dot};
use crate::rows::{DIM, Slope};

/// How many memories.
pub const TERMS: usize = 2;
/// T, s.
const MEMORIES: [f64; TERMS] = [15.0, 60.0];

/// e^{−dt/T} of one memory.
pub fn fading(dt: Duration, term: usize) -> f64 {
    (-dt.as_seconds() / MEMORIES[term]).exp()
}

/// e^{−dt/T} of each memory.
pub fn fadings(dt: Duration) -> [f64; TERMS] {
    core::array::from_fn(|term| fading(dt, term))
}

/// One sensor's columns at one keyframe, everything before it eliminated.
#[derive(Clone, Copy, Debug, Default)]
struct Column {
    z: [BlockVector<DIM>; TERMS],
    /// S by two memories.
    information: [[f64; TERMS]; TERMS],
    right: [f64; TERMS],
}

/// The columns of all sensors at one keyframe.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    columns: [Column; AIDING.len()],
}

/// What marginalised keyframes say of the offsets, at the oldest: as [`Column`], but with f in place of z.
#[derive(Clone, Debug, Default)]
pub struct ColumnPrior {
    columns: [Column; AIDING.len()],
}

impl Columns {
    /// Sweeps the columns of a swept `link`, whose own parts are `own`, after the prior or after those of the link before
    /// and the time from it.
    #[inline(always)]
    pub fn sweep(&mut self, link: &Link<DIM>, own: &[Slope; AIDING.len()], before: Before<'_>) {
        let faded = match before {
            Before::Prior(_) => [1.0; TERMS],
            Before::Link(_, _, dt) => fadings(dt),
        };
        for (sensor, column) in self.columns.iter_mut().enumerate() {
            let own = &own[sensor];
            let mut swept = Column {
                z: [own.coupling; TERMS],
                information: [[own.information; TERMS]; TERMS],
                right: [own.right; TERMS],
            };
            let earlier = match before {
                Before::Prior(prior) => {
                    let earlier = &prior.columns[sensor];
                    for term in 0..TERMS {
                        swept.z[term] += earlier.z[term];
                    }
                    earlier
                }
                Before::Link(columns, link_before, _) => {
                    let earlier = &columns.columns[sensor];
                    for term in 0..TERMS {
                        link_before.carry_column(&earlier.z[term], faded[term], &mut swept.z[term]);
                    }
                    earlier
                }
            };
            for term in 0..TERMS {
                link.solve_column(&mut swept.z[term]);
                swept.right[term] += faded[term] * earlier.right[term] - dot(&swept.z[term], link.swept_right());
            }
            for (term, other) in pairs() {
                swept.information[term][other] += faded[term] * faded[other] * earlier.information[term][other]
                    - dot(&swept.z[term], &swept.z[other]);
            }
            *column = swept;
        }
    }

    /// What this link, the oldest, leaves on the next when it is marginalised, `dt` later.
    pub fn marginal(&self, link: &Link<DIM>, dt: Duration) -> ColumnPrior {
        let faded = fadings(dt);
        let mut prior = ColumnPrior::default();
        for (left, column) in prior.columns.iter_mut().zip(&self.columns) {
            for term in 0..TERMS {
                wide(|| link.carry_column(&column.z[term], faded[term], &mut left.z[term]));
                left.right[term] = faded[term] * column.right[term];
            }
            for (term, other) in pairs() {
                left.information[term][other] = faded[term] * faded[other] * column.information[term][other];
            }
        }
        prior
    }

    /// What each memory says of a sensor when this is the newest keyframe.
    pub fn of(&self, sensor: usize) -> [OffsetScore; TERMS] {
        let column = &self.columns[sensor];
        core::array::from_fn(|term| OffsetScore {
            information: column.information[term][term],
            right: column.right[term],
        })
    }

    /// ∂x_n/∂τ when `link` is the newest: how far the state is off per s of a sensor's offset.
    pub fn state_by_offset(&self, link: &Link<DIM>, sensor: usize, term: usize) -> BlockVector<DIM> {
        let mut by_offset = -self.columns[sensor].z[term];
        link.solve_column_back(&mut by_offset);
        by_offset
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

/// What is known of an offset: its information, 1/s², and the right side; their quotient is the offset, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct OffsetScore {
    /// 1/s².
    pub information: f64,
    /// 1/s.
    pub right: f64,
}

impl ColumnPrior {
    /// Expresses it at another linearisation point of its keyframe, `step` away, with M of the prior itself.
    pub fn carry(&mut self, step: &BlockVector<DIM>, m: &Block<DIM>) {
        for column in &mut self.columns {
            for term in 0..TERMS {
                column.right[term] -= dot(&column.z[term], step);
                column.z[term] = m.transpose() * column.z[term];
            }
        }
    }

    /// Takes an offset of `by` s, as one memory has it, out of the prior's readings of a sensor; `right` is the right side
    /// of the states' prior.
    pub fn shift(&mut self, sensor: usize, term: usize, by: f64, right: &mut BlockVector<DIM>) {
        let column = &mut self.columns[sensor];
        *right -= column.z[term] * by;
        for other in 0..TERMS {
            column.right[other] -= column.information[other][term] * by;
        }
    }
}

fn pairs() -> impl Iterator<Item = (usize, usize)> {
    (0..TERMS).flat_map(|term| (0..TERMS).map(move |other| (term, other)))
}

impl Link<DIM> {
    /// target −= ρ Yᵀ z.
    #[inline(always)]
    fn carry_column(&self, z: &BlockVector<DIM>, fading: f64, target: &mut BlockVector<DIM>) {
        add_times_transposed(target, self.y_transposed(), z, -fading);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    const LINKS: usize = 5;
    const SENSOR: usize = 2;

    struct Chain {
        links: Vec<Link<DIM>>,
        columns: Vec<Columns>,
        own: Vec<[Slope; AIDING.len()]>,
        times: [f64; LINKS],
    }

    fn noise(seed: usize) -> f64 {
        ((seed as f64 * 12.9898).sin() * 43758.5453).fract()
    }

    fn chain() -> Chain {
        let mut links = vec![Link::<DIM>::default(); LINKS];
        let mut own = vec![[Slope::NONE; AIDING.len()]; LINKS];
        for k in 0..LINKS {
            let raw = Block::<DIM>::from_fn(|i, j| noise(1 + k * 1000 + i * 15 + j));
            links[k].diagonal = raw * raw.transpose() + Block::identity() * 20.0;
            links[k].right = BlockVector::from_fn(|i, _| noise(77 + k * 31 + i));
            if k + 1 < LINKS {
                links[k].next_transposed = Block::from_fn(|i, j| noise(500 + k * 999 + i + 15 * j));
            }
            own[k][SENSOR] = Slope {
                coupling: BlockVector::from_fn(|i, _| 3.0 * noise(9 + 17 * k + i)),
                information: 40.0 + k as f64,
                right: 5.0 * noise(k + 3),
            };
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

        /// (S, s, ∂x_n/∂τ) of the offset alone, through the dense matrix.
        fn dense(&self, term: usize) -> (f64, f64, DVector<f64>) {
            let n = DIM * LINKS;
            let mut matrix = DMatrix::zeros(n, n);
            let (mut right, mut coupling) = (DVector::zeros(n), DVector::zeros(n));
            let (mut information, mut score) = (0.0, 0.0);
            for k in 0..LINKS {
                matrix.view_mut((k * DIM, k * DIM), (DIM, DIM)).copy_from(&self.links[k].diagonal);
                if k + 1 < LINKS {
                    let next = self.links[k].next_transposed;
                    matrix.view_mut(((k + 1) * DIM, k * DIM), (DIM, DIM)).copy_from(&next);
                    matrix.view_mut((k * DIM, (k + 1) * DIM), (DIM, DIM)).copy_from(&next.transpose());
                }
                let share = fading(Duration::from_seconds(self.times[LINKS - 1] - self.times[k]), term);
                let own = &self.own[k][SENSOR];
                right.rows_mut(k * DIM, DIM).copy_from(&self.links[k].right);
                coupling.rows_mut(k * DIM, DIM).copy_from(&(own.coupling * share));
                information += share * share * own.information;
                score += share * own.right;
            }
            let inverse = matrix.try_inverse().expect("regular");
            let by_offset = -(&inverse * &coupling);
            (
                information + coupling.dot(&by_offset),
                score - coupling.dot(&(inverse * right)),
                by_offset.rows((LINKS - 1) * DIM, DIM).into_owned(),
            )
        }

        #[track_caller]
        fn assert_equals_dense(&self) {
            for term in 0..TERMS {
                let (information, right, by_offset) = self.dense(term);
                let score = self.columns[LINKS - 1].of(SENSOR)[term];
                assert!((score.information - information).abs() < 1e-10, "{} {information}", score.information);
                assert!((score.right - right).abs() < 1e-11, "{} {right}", score.right);
                let ours = self.columns[LINKS - 1].state_by_offset(&self.links[LINKS - 1], SENSOR, term);
                assert!((ours - by_offset).amax() < 1e-12);
            }
        }
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
        let prior = chain.columns[1].marginal(&chain.links[1], Duration::from_seconds(chain.times[2] - chain.times[1]));
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
        let mut prior = chain.columns[LINKS - 1].marginal(&chain.links[LINKS - 1], Duration::from_seconds(0.0));
        // As the prior of a last keyframe that has nothing of its own: τ̂ is s/S of its f and x.
        let column = prior.columns[SENSOR];
        let found = column.right[term] / column.information[term][term];
        let mut right = BlockVector::zeros();
        prior.shift(SENSOR, term, found, &mut right);
        assert!(prior.columns[SENSOR].right[term].abs() < 1e-12);
        assert!((right + column.z[term] * found).amax() < 1e-15);
        let other = column.right[0] - column.information[0][term] * found;
        assert!((prior.columns[SENSOR].right[0] - other).abs() < 1e-15);
    }
}
