//! Judging a measurement before it enters: innovation, gate, first weight (§3.3, §4.2 of the method).
//!
//! Everything is in units of the measurement's own sigma: rows are whitened by Λ, so the innovation covariance is
//! S = J̃ C J̃ᵀ + I. After an outage C has grown, and S with it: a gate on Λ alone would refuse a returning sensor for ever.

use nalgebra::{Cholesky, SMatrix, SVector};
use shared_types::{Kernel, Sensor, Time};

use crate::kernels::{Block, BlockVector, add_times_transposed, dot};
use crate::robust::{gate_threshold, weight};
use crate::row::{Row, SLOTS};
use crate::state::ERROR_DIM as DIM;

/// A range longer than predicted by more sigmas than this is multipath; one shorter may be a little further off (§3.3).
const RANGE_TOO_LONG: f64 = 4.0;
const RANGE_TOO_SHORT: f64 = 5.0;
/// After so many refusals in a row the sensor is admitted, by its kernel only, until a measurement passes.
const REFUSALS_IN_A_ROW: u32 = 5;

/// A measurement against its prediction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Innovation {
    /// Predicted minus measured in sigmas of S, row by row.
    pub whitened: [f64; 3],
    /// Squared normalised innovation.
    pub nis: f64,
    /// tr(J̃ C J̃ᵀ): how much of S is the state's own uncertainty, against the number of rows.
    pub state_share: f64,
    /// How the reading's systematic errors change it, each row by row in the same units.
    pub slopes: [[f64; 3]; SLOTS],
}

/// Whether a range is, by its innovation in sigmas.
pub(crate) fn is_range_probable(whitened: f64) -> bool {
    (-RANGE_TOO_LONG..=RANGE_TOO_SHORT).contains(&whitened)
}

impl Innovation {
    /// Of rows at a step δ from their linearisation point, with the covariance of that state.
    #[inline(always)]
    pub fn of(rows: &[Row], delta: &BlockVector<DIM>, covariance: &Block<DIM>) -> Innovation {
        let count = rows.len();
        if let [row] = rows {
            return Innovation::of_one(row, delta, covariance);
        }
        let mut s = SMatrix::<f64, 3, 3>::identity();
        let mut innovation = SVector::<f64, 3>::zeros();
        let mut slopes = SMatrix::<f64, 3, SLOTS>::zeros();
        let mut state_share = 0.0;
        for (i, row) in rows.iter().enumerate() {
            innovation[i] = row.after(delta);
            for (slot, slope) in row.slopes.into_iter().enumerate() {
                slopes[(i, slot)] = slope;
            }
            let mut projected = BlockVector::zeros();
            add_times_transposed(&mut projected, covariance, &row.jacobian, 1.0);
            for (j, other) in rows.iter().enumerate().take(i + 1) {
                let value = dot(&other.jacobian, &projected);
                s[(i, j)] += value;
                if i != j {
                    s[(j, i)] += value;
                } else {
                    state_share += value;
                }
            }
        }
        let mut whitened = innovation;
        if let Some(cholesky) = Cholesky::new(s) {
            cholesky.l_dirty().solve_lower_triangular_mut(&mut whitened);
            cholesky.l_dirty().solve_lower_triangular_mut(&mut slopes);
        }
        let nis = whitened.rows(0, count).norm_squared();
        Innovation { whitened: whitened.into(), nis, state_share, slopes: slopes.into() }
    }

    #[inline(always)]
    fn of_one(row: &Row, delta: &BlockVector<DIM>, covariance: &Block<DIM>) -> Innovation {
        let mut projected = BlockVector::zeros();
        add_times_transposed(&mut projected, covariance, &row.jacobian, 1.0);
        let state_share = dot(&row.jacobian, &projected);
        let s = 1.0 + state_share;
        // Where rounding has left less than nothing of S there is no scale: in sigmas of the reading itself, as for several rows.
        let scale = if s > 0.0 { 1.0 / s.sqrt() } else { 1.0 };
        let whitened = row.after(delta) * scale;
        Innovation {
            whitened: [whitened, 0.0, 0.0],
            nis: whitened * whitened,
            state_share,
            slopes: row.slopes.map(|slope| [slope * scale, 0.0, 0.0]),
        }
    }

    /// The same for one range whose epoch's unknown offset is estimated as `offset` sigmas of that range.
    pub fn without_offset(mut self, offset: f64, s: f64) -> Innovation {
        self.whitened[0] -= offset / s;
        self.nis = self.whitened[0] * self.whitened[0];
        self
    }

    /// Whether a gate of 99.9 % lets it through; ranges are judged on two sides.
    pub fn passes(&self, sensor: Sensor, components: usize) -> bool {
        if sensor == Sensor::Lbl {
            return is_range_probable(self.whitened[0]);
        }
        // The negation refuses a NaN.
        self.nis <= gate_threshold(components)
    }

    /// What [`Innovation::passes`] lets through, in sigmas: of the whitened innovation of a range, else of the root of `nis`.
    pub fn gate(sensor: Sensor, components: usize) -> [f64; 2] {
        match sensor {
            Sensor::Lbl => [-RANGE_TOO_LONG, RANGE_TOO_SHORT],
            _ => [0.0, gate_threshold(components).sqrt()],
        }
    }

    /// The robust weight to begin with: by the innovation, since the residual after the update is not known yet.
    pub fn first_weight(&self, kernel: Kernel) -> f64 {
        weight(kernel, self.nis)
    }
}

/// Median of the values (which are reordered); `None` if there is none. The first guess of a common offset, before any weight.
pub fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    values.sort_unstable_by(f64::total_cmp);
    match values.len() {
        0 => None,
        n if n % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

/// Refusals in a row of one sensor, ranges by whole epochs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Refusals {
    in_a_row: u32,
    first: Option<Time>,
}

impl Refusals {
    /// A measurement (or an epoch) at `t` was refused as a whole, or passed.
    pub fn observe(&mut self, t: Time, passed: bool) {
        if passed {
            *self = Refusals::default();
        } else {
            self.in_a_row = self.in_a_row.saturating_add(1);
            self.first.get_or_insert(t);
        }
    }

    /// Whether the sensor has been refused for so long that the state may be what is wrong.
    pub fn admits_next(&self) -> bool {
        self.in_a_row >= REFUSALS_IN_A_ROW
    }

    /// How many, and since when.
    pub fn run(&self) -> (u32, Option<Time>) {
        (self.in_a_row, self.first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(at: usize, residual: f64) -> Row {
        let mut jacobian = BlockVector::zeros();
        jacobian[at] = 1.0;
        Row { jacobian, residual, inverse_sigma: 1.0, weight: 1.0, slopes: [0.0; SLOTS], mooring: None }
    }

    #[test]
    fn an_uncertain_state_makes_a_large_innovation_probable() {
        let rows = [row(0, 10.0), row(1, 0.0), row(2, 0.0)];
        let known = Innovation::of(&rows, &BlockVector::zeros(), &(Block::identity() * 1e-6));
        let lost = Innovation::of(&rows, &BlockVector::zeros(), &(Block::identity() * 100.0));
        assert!(!known.passes(Sensor::Gnss, 3) && lost.passes(Sensor::Gnss, 3));
        assert!((lost.nis - 100.0 / 101.0).abs() < 1e-12, "{}", lost.nis);
    }

    #[test]
    fn a_range_may_be_a_little_too_short_but_not_as_much_too_long() {
        let covariance = Block::zeros();
        let innovation = |r: f64| Innovation::of(&[row(0, r)], &BlockVector::zeros(), &covariance);
        assert!(innovation(4.5).passes(Sensor::Lbl, 1), "measured shorter than predicted");
        assert!(!innovation(-4.5).passes(Sensor::Lbl, 1), "measured longer than predicted");
    }

    #[test]
    fn the_median_stands_in_the_middle() {
        assert_eq!(median(&mut []), None);
        assert_eq!(median(&mut [3.0, -1.0, 2.0]), Some(2.0));
        assert_eq!(median(&mut [4.0, 1.0, 3.0, 2.0]), Some(2.5));
    }

    #[test]
    fn five_refusals_in_a_row_admit_the_next() {
        let mut refusals = Refusals::default();
        for _ in 0..5 {
            assert!(!refusals.admits_next());
            refusals.observe(Time(0), false);
        }
        assert!(refusals.admits_next());
        refusals.observe(Time(0), true);
        assert!(!refusals.admits_next());
    }
}
