//! Buoys that do not lie where they are said to: columns beside the chain, for the covariance alone.
//!
//! The position of a moored buoy comes of a survey, and what that is off by, b ~ N(0, σ_B² I), is the same in each of its ranges.
//! Ranges by the hundred average their own noise away and leave b, so a covariance that takes σ_B for noise grows sure of a place
//! that it does not know. b is not estimated here but considered (Schmidt): rows are weighted as ever, with σ_B among
//! their noise, and what b has made of the state stands beside the chain (§4.4 of the method),
//!
//! ```text
//! F_k = −JᵀW j_p      Z_k = L_k⁻¹(F_k − Y_{k−1}ᵀZ_{k−1})      V_n = ∂x_n/∂b = −L_n⁻ᵀZ_n      V_k = −L_k⁻ᵀ(Z_k + Y_k V_{k+1})
//! C ← C + σ_B² Σ VVᵀ
//! ```
//!
//! j_p being a row's derivative by position: a range feels its buoy as it feels the vehicle, with the other sign. The buoy of a
//! track has errors of its own in every fix, and these are noise.
//!
//! Buoys that lie elsewhere look like late stamps or like another speed of sound, and would be taken for them. So each column g of
//! the [systematic errors](crate::columns), which fade by ρ, is crossed with these, and its score is in doubt by
//!
//! ```text
//! X_k = −gᵀW j_p + ρ X_{k−1} − z_gᵀZ_k      Var(s_n) = S_n + σ_B² Σ XXᵀ
//! ```

use nalgebra::SMatrix;
use shared_types::{Config, Duration};

use crate::chain::Link;
use crate::columns::{Columns, WIDTH, column_of, fadings, or_nothing};
use crate::kernels::{Block, add_gram_transposed, add_product_transposed};
use crate::rows::DIM;
use crate::systematic::ERRORS;

/// Buoys whose positions are considered; those of more are noise only.
pub const MOORINGS_MAX: usize = 32;

/// Coordinates of a position.
const AXES: usize = 3;

/// Z_k transposed of one buoy, F_k transposed in a prior.
pub type ByRange = SMatrix<f64, AXES, DIM>;

/// V of one buoy: how far a state is off per metre of its buoy's position.
type ByPosition = SMatrix<f64, DIM, AXES>;

/// What one buoy has to do with a keyframe.
#[derive(Clone, Copy, Debug, Default)]
pub struct Column {
    /// Z_k, transposed.
    pub by_range: ByRange,
    /// X_k with the column of each systematic error.
    pub crossed: SMatrix<f64, WIDTH, AXES>,
}

/// Which buoys are moored, in the order in which they were heard.
#[derive(Clone, Debug)]
pub struct Moorings {
    sigma: f64,
    buoys: Vec<u32>,
}

impl Moorings {
    /// None heard yet.
    pub fn new(config: &Config) -> Moorings {
        Moorings { sigma: config.vehicle.lbl.buoy_sigma, buoys: Vec::with_capacity(MOORINGS_MAX) }
    }

    /// Place of a moored buoy among them; `None` where its position is exact, or there are too many.
    pub fn place(&mut self, buoy: u32) -> Option<u8> {
        if self.sigma <= 0.0 {
            return None;
        }
        if let Some(at) = self.buoys.iter().position(|&known| known == buoy) {
            return u8::try_from(at).ok();
        }
        if self.buoys.len() == MOORINGS_MAX {
            return None;
        }
        self.buoys.push(buoy);
        u8::try_from(self.buoys.len() - 1).ok()
    }
}

/// The columns at one keyframe, everything before it eliminated; one for each buoy that has been heard by then.
#[derive(Clone, Debug, Default)]
pub struct MooringColumns(Vec<Column>);

/// What stands before a keyframe.
#[derive(Clone, Copy, Debug)]
pub enum Before<'a> {
    /// It is the oldest, and this is what marginalised keyframes have left on it.
    Prior(&'a MooringColumns),
    /// Another, that much earlier.
    Link(&'a MooringColumns, &'a Link<DIM>, Duration),
}

impl MooringColumns {
    /// With room for as many as there may be, so that no buoy heard later asks for memory.
    pub fn reserve(&mut self) {
        self.0.reserve_exact(MOORINGS_MAX.saturating_sub(self.0.len()));
    }

    /// Nothing is known to depend on any buoy.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Column of the buoy at this place, made if it is the first of its ranges here.
    pub fn of(&mut self, place: u8) -> &mut Column {
        let place = usize::from(place);
        if self.0.len() <= place {
            self.0.resize(place + 1, Column::default());
        }
        &mut self.0[place]
    }

    /// Sweeps after what stands before. `self` holds the F of the keyframe itself; `link` and `errors` are swept.
    #[inline(always)]
    pub fn sweep(&mut self, link: &Link<DIM>, errors: &Columns, before: Before<'_>) {
        match before {
            Before::Prior(prior) => self.add(prior),
            Before::Link(columns, link_before, dt) => self.add_carried(columns, link_before, dt),
        }
        for column in &mut self.0 {
            link.solve_columns(&mut column.by_range);
            column.crossed += errors.crossed(&column.by_range);
        }
    }

    fn add(&mut self, prior: &MooringColumns) {
        for (place, left) in prior.0.iter().enumerate() {
            let own = self.of(place as u8);
            own.by_range += left.by_range;
            own.crossed += left.crossed;
        }
    }

    #[inline(always)]
    fn add_carried(&mut self, before: &MooringColumns, link: &Link<DIM>, dt: Duration) {
        let faded = fadings(dt);
        for (place, left) in before.0.iter().enumerate() {
            let own = self.of(place as u8);
            add_product_transposed(&mut own.by_range, &left.by_range, link.y_transposed(), -1.0);
            for axis in 0..AXES {
                for column in 0..WIDTH {
                    own.crossed[(column, axis)] += faded[column / ERRORS] * left.crossed[(column, axis)];
                }
            }
        }
    }

    /// What `oldest` leaves on the next keyframe, `dt` later, when it is marginalised, in place of what was left on itself.
    #[inline(always)]
    pub fn take_marginal(&mut self, oldest: &MooringColumns, link: &Link<DIM>, dt: Duration) {
        self.clear();
        self.add_carried(oldest, link, dt);
        for column in &mut self.0 {
            column.by_range.apply(|value| *value = or_nothing(*value));
            column.crossed.apply(|value| *value = or_nothing(*value));
        }
    }

    /// Expresses a prior at another linearisation point of its keyframe, with M of the states' prior.
    pub fn carry(&mut self, m: &Block<DIM>) {
        for column in &mut self.0 {
            column.by_range *= m;
        }
    }

    /// ΣXXᵀ of a systematic error in one memory, when this is the newest keyframe: by how much the right side of its
    /// score varies with the positions of the buoys, per σ_B².
    pub fn variance_of(&self, error: usize, term: usize) -> f64 {
        self.0.iter().map(|column| column.crossed.row(column_of(error, term)).norm_squared()).sum()
    }

    /// V_k in place of V_{k+1}; V_n in place of nothing, where `link` is the newest keyframe.
    #[inline(always)]
    pub fn carry_back(&self, link: &Link<DIM>, states: &mut StatesByPosition) {
        states.count = states.count.max(self.0.len());
        for (place, by_position) in states.by_position[..states.count].iter_mut().enumerate() {
            let mut carried = self.0.get(place).map_or(ByPosition::zeros(), |column| -column.by_range.transpose());
            carried -= link.y_transposed().tr_mul(by_position);
            for axis in 0..AXES {
                let mut column = carried.column(axis).into_owned();
                link.solve_back(&mut column);
                by_position.set_column(axis, &column);
            }
        }
    }
}

/// V of every buoy at one keyframe.
#[derive(Clone, Debug)]
pub struct StatesByPosition {
    by_position: [ByPosition; MOORINGS_MAX],
    count: usize,
}

impl Default for StatesByPosition {
    fn default() -> Self {
        StatesByPosition { by_position: [ByPosition::zeros(); MOORINGS_MAX], count: 0 }
    }
}

impl StatesByPosition {
    /// Adds σ_B² Σ VVᵀ to the covariance of the keyframe.
    #[inline(always)]
    pub fn cover(&self, sigma: f64, covariance: &mut Block<DIM>) {
        for by_position in &self.by_position[..self.count] {
            add_gram_transposed(covariance, by_position, sigma * sigma);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, SVector};

    use crate::columns::{self, ColumnPrior, TERMS, fading};
    use crate::kernels::BlockVector;
    use crate::rows::Slopes;

    const LINKS: usize = 5;
    const BUOYS: usize = 2;
    const SECOND: Duration = Duration(1_000_000_000);
    /// A systematic error.
    const ERROR: usize = 1;

    fn noise(seed: usize) -> f64 {
        ((seed as f64 * 12.9898).sin() * 43758.5453).fract()
    }

    /// F of a buoy at a keyframe; the second is heard from the third keyframe on.
    fn coupling(k: usize, buoy: usize) -> Option<ByRange> {
        (buoy == 0 || k >= 2).then(|| ByRange::from_fn(|axis, i| noise(9 + 170 * k + 3 * i + axis + 5000 * buoy)))
    }

    /// −dᵀWj_p of a buoy and of the error.
    fn crossed(k: usize, buoy: usize) -> SVector<f64, AXES> {
        SVector::from_fn(|axis, _| if buoy == 0 || k >= 2 { noise(31 + 7 * k + axis + 900 * buoy) } else { 0.0 })
    }

    fn slopes(k: usize) -> Slopes {
        let mut slopes = Slopes::default();
        slopes.coupling[ERROR] = BlockVector::from_fn(|i, _| 3.0 * noise(9 + 17 * k + i));
        slopes
    }

    fn chain() -> Vec<Link<DIM>> {
        (0..LINKS)
            .map(|k| {
                let raw = Block::<DIM>::from_fn(|i, j| noise(1 + k * 1000 + i * 15 + j));
                let mut link = Link::default();
                link.diagonal = raw * raw.transpose() + Block::identity() * 20.0;
                link.right = BlockVector::from_fn(|i, _| noise(77 + k * 31 + i));
                if k + 1 < LINKS {
                    link.next_transposed = Block::from_fn(|i, j| noise(500 + k * 999 + i + 15 * j));
                }
                link
            })
            .collect()
    }

    /// Everything at once: −H⁻¹F, and X of the error by memory.
    fn dense(links: &[Link<DIM>]) -> (DMatrix<f64>, [DMatrix<f64>; TERMS]) {
        let n = DIM * LINKS;
        let (mut matrix, mut couplings) = (DMatrix::zeros(n, n), DMatrix::zeros(n, BUOYS * AXES));
        for (k, link) in links.iter().enumerate() {
            matrix.view_mut((k * DIM, k * DIM), (DIM, DIM)).copy_from(&link.diagonal);
            if k + 1 < LINKS {
                matrix.view_mut(((k + 1) * DIM, k * DIM), (DIM, DIM)).copy_from(&link.next_transposed);
                matrix.view_mut((k * DIM, (k + 1) * DIM), (DIM, DIM)).copy_from(&link.next_transposed.transpose());
            }
            for buoy in 0..BUOYS {
                if let Some(column) = coupling(k, buoy) {
                    couplings.view_mut((k * DIM, buoy * AXES), (DIM, AXES)).copy_from(&column.transpose());
                }
            }
        }
        let by_position = -(matrix.try_inverse().expect("regular") * couplings);
        let crossed = core::array::from_fn(|term| {
            let mut sum = DMatrix::zeros(1, BUOYS * AXES);
            for k in 0..LINKS {
                let share = fading(Duration(SECOND.0 * (LINKS - 1 - k) as i64), term);
                let by_state = slopes(k).coupling[ERROR].transpose() * by_position.rows(k * DIM, DIM);
                let own = DMatrix::from_fn(1, BUOYS * AXES, |_, j| crossed(k, j / AXES)[j % AXES]);
                sum += (by_state + own) * share;
            }
            sum
        });
        (by_position, crossed)
    }

    struct Swept {
        columns: Vec<Columns>,
        moorings: Vec<MooringColumns>,
    }

    /// Sweeps links from `first` on, what came before them being in the priors.
    fn sweep(links: &mut [Link<DIM>], first: usize, (of_errors, prior): (&ColumnPrior, &MooringColumns)) -> Swept {
        let mut swept =
            Swept { columns: vec![Columns::default(); LINKS], moorings: vec![MooringColumns::default(); LINKS] };
        for k in first..LINKS {
            let (before, rest) = links.split_at_mut(k);
            rest[0].sweep(before.last().filter(|_| k > first), 0.0).expect("positive definite");
            let before_errors = match k > first {
                true => columns::Before::Link(&swept.columns[k - 1], &before[k - 1], SECOND),
                false => columns::Before::Prior(of_errors),
            };
            let mut errors = Columns::default();
            errors.sweep(&rest[0], &slopes(k), before_errors);
            let mut own = MooringColumns::default();
            for buoy in 0..BUOYS {
                if let Some(by_range) = coupling(k, buoy) {
                    let column = own.of(buoy as u8);
                    column.by_range += by_range;
                    for term in 0..TERMS {
                        let mut row = column.crossed.row_mut(column_of(ERROR, term));
                        row += crossed(k, buoy).transpose();
                    }
                }
            }
            let before = match k > first {
                true => Before::Link(&swept.moorings[k - 1], &before[k - 1], SECOND),
                false => Before::Prior(prior),
            };
            own.sweep(&rest[0], &errors, before);
            (swept.columns[k], swept.moorings[k]) = (errors, own);
        }
        swept
    }

    #[track_caller]
    fn assert_equals_dense(
        links: &[Link<DIM>],
        swept: &Swept,
        (dense, crossed): &(DMatrix<f64>, [DMatrix<f64>; TERMS]),
        first: usize,
    ) {
        let mut states = StatesByPosition::default();
        for k in (first..LINKS).rev() {
            swept.moorings[k].carry_back(&links[k], &mut states);
            let expected = dense.view((k * DIM, 0), (DIM, BUOYS * AXES));
            for buoy in 0..BUOYS {
                let expected = expected.columns(buoy * AXES, AXES);
                assert!((states.by_position[buoy] - expected).amax() < 1e-12, "keyframe {k}, buoy {buoy}");
            }
            let mut covered = Block::identity();
            states.cover(0.3, &mut covered);
            assert!((covered - Block::identity() - expected * expected.transpose() * 0.09).amax() < 1e-12);
        }
        for (term, expected) in crossed.iter().enumerate() {
            let variance = swept.moorings[LINKS - 1].variance_of(ERROR, term);
            assert!((variance - expected.norm_squared()).abs() < 1e-10, "{variance} {}", expected.norm_squared());
        }
    }

    #[test]
    fn states_and_scores_depend_on_the_buoys_as_the_dense_solution_does() {
        let mut links = chain();
        let dense = dense(&links);
        let swept = sweep(&mut links, 0, (&ColumnPrior::default(), &MooringColumns::default()));
        assert_equals_dense(&links, &swept, &dense, 0);
    }

    #[test]
    fn marginalising_keyframes_forgets_nothing_of_a_buoy() {
        let mut links = chain();
        let dense = dense(&links);
        let swept = sweep(&mut links, 0, (&ColumnPrior::default(), &MooringColumns::default()));
        let mut prior = MooringColumns::default();
        prior.take_marginal(&swept.moorings[1], &links[1], SECOND);
        let of_errors = (0..=1).fold(ColumnPrior::default(), |before, k| {
            swept.columns[k].marginal(&links[k], SECOND, &slopes(k), &before)
        });
        let marginal = links[1].marginal();
        links[2].diagonal += marginal.information;
        links[2].right += marginal.right;
        let swept = sweep(&mut links, 2, (&of_errors, &prior));
        assert_equals_dense(&links, &swept, &dense, 2);
    }

    #[test]
    fn a_buoy_has_one_place_and_an_exact_or_supernumerary_one_none() {
        let mut config = Config::default();
        assert_eq!(Moorings::new(&config).place(7), None);
        config.vehicle.lbl.buoy_sigma = 0.5;
        let mut moorings = Moorings::new(&config);
        for buoy in [7, 3, 7] {
            assert_eq!(moorings.place(buoy), Some(u8::from(buoy == 3)));
        }
        for buoy in 100..130 {
            assert!(moorings.place(buoy).is_some());
        }
        assert_eq!((moorings.place(130), moorings.place(3)), (None, Some(1)));
    }
}
