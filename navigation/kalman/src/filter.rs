//! The equations of one filter: an error-state extended Kalman filter on the 15 error coordinates.
//!
//! ```text
//! predict   x ← transport(x, preintegration),   P ← F P Fᵀ + Q            (whole stretches, not IMU steps: the same, cheaper)
//! update    K = P jᵀ/(j P jᵀ + 1),   δ ← δ − K(c + j δ),   P ← (I − K j) P (I − K j)ᵀ + K Kᵀ      row by row
//! reset     x ← x ⊞ δ,   P ← G P Gᵀ,   G = diag(I, I, J_r(δθ), I, I)
//! ```
//!
//! Rows are whitened, so that each has unit noise and comes alone: the rows of one measurement are decorrelated by their
//! whitening, ranges that share an offset by [`mod@crate::common_offset`]. All rows of a group are linearised at one state, which
//! makes the sequence equal to the update with all at once.
//!
//! **Iterated**: the group is linearised anew at x̄ ⊞ δ and folded into the *prior* again, with J·G(δ) for its Jacobian; that is
//! Gauss-Newton on the cost of one state.
//!
//! **About another's state**: a local filter of a federated one may hold its estimate as an offset from the state that all have
//! in common. It is linearised there, moves its offset and leaves the state alone.

use nalgebra::ArrayStorage;
use nav_geometry::so3;
use nav_models::kernels::{Block, BlockVector, add_product_transposed, dot};
use nav_models::prediction::predict_covariance;
use nav_models::preintegration::Preintegration;
use nav_models::recovery::Loosening;
use nav_models::row::Row;
use nav_models::state::{ATTITUDE, ERROR_DIM, NavState, POSITION, VELOCITY};
use nav_models::transport::{transport, transport_jacobians};
use nav_models::wide;
use nav_models::world::WorldModel;

/// Steps smaller than this end the iteration: m and m/s, rad. Far below the sigma of any sensor.
const STEP_LENGTH: f64 = 1e-6;
const STEP_ANGLE: f64 = 1e-9;

/// A step that left the numbers; the filter stands as before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Diverged;

/// State and covariance.
#[derive(Clone, Copy, Debug)]
pub struct Filter {
    /// Where it is linearised: the estimate, unless there is an offset.
    pub state: NavState,
    /// Of the error coordinates at `state`.
    pub covariance: Block<ERROR_DIM>,
    /// Where the estimate lies from `state`; `None` if it is the estimate.
    pub offset: Option<BlockVector<ERROR_DIM>>,
}

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Linearised {
    /// How often the group was linearised.
    pub passes: u32,
    /// The last step was small, or only one was asked for.
    pub converged: bool,
    /// Half the weighted sum of squares of the rows before the update, and after.
    pub cost: [f64; 2],
}

impl Filter {
    /// That stands at its own estimate.
    pub fn new(state: NavState, covariance: Block<ERROR_DIM>) -> Filter {
        Filter { state, covariance, offset: None }
    }

    /// Where the estimate lies from `state`.
    pub(crate) fn mean(&self) -> BlockVector<ERROR_DIM> {
        self.offset.unwrap_or_else(BlockVector::zeros)
    }

    /// Carries the filter over an increment that begins at its state. `share` is the part of the information about the
    /// motion that is this filter's: its noise is divided by it.
    ///
    /// # Errors
    /// [`Diverged`].
    pub fn predict(&mut self, increment: &Preintegration, share: f64, world: &WorldModel) -> Result<(), Diverged> {
        let state = transport(&self.state, increment, world);
        let covariance = if share == 1.0 {
            predict_covariance(&self.covariance, &self.state, increment, world)
        } else {
            predict_covariance(&(self.covariance * share), &self.state, increment, world) / share
        };
        let offset = self.offset.map(|offset| {
            let mut carried = offset;
            let moved = transport_jacobians(&self.state, increment, world).state * offset;
            carried.fixed_rows_mut::<9>(0).copy_from(&moved);
            carried
        });
        self.replace(Filter { state, covariance, offset })
    }

    /// Folds a group of measurements in. `linearise` writes their rows at the state it is given; it is called again, up to
    /// `iterations` times, as long as the state moves. Rows count by their weights.
    ///
    /// # Errors
    /// [`Diverged`].
    pub fn update(
        &mut self,
        iterations: usize,
        mut linearise: impl FnMut(&NavState, &mut Vec<Row>),
        rows: &mut Vec<Row>,
    ) -> Result<Linearised, Diverged> {
        let mut done = Linearised::default();
        let prior = self.mean();
        let iterations = if self.offset.is_some() { 1 } else { iterations.max(1) };
        let (mut delta, mut covariance) = (BlockVector::<ERROR_DIM>::zeros(), self.covariance);
        for pass in 1..=iterations {
            rows.clear();
            linearise(&self.state.retract(&delta), rows);
            into_chart(rows, &delta);
            if pass == 1 {
                done.cost[0] = cost(rows, &prior);
            }
            let before = delta;
            (delta, covariance) = wide!(fold(&prior, &self.covariance, rows));
            done.passes += 1;
            if is_small(&(delta - before)) {
                done.converged = true;
                break;
            }
        }
        done.converged |= iterations == 1;
        done.cost[1] = cost(rows, &delta);
        if self.offset.is_some() {
            self.replace(Filter { state: self.state, covariance, offset: Some(delta) })?;
        } else {
            let turn = so3::right_jacobian(&delta.fixed_rows::<3>(ATTITUDE).into_owned());
            self.replace(Filter::new(self.state.retract(&delta), in_new_chart(&covariance, &turn)))?;
        }
        Ok(done)
    }

    /// Admits that the state is further off than its covariance says.
    pub fn loosen(&mut self, by: &Loosening) {
        for (at, sigma) in [(POSITION, by.position), (VELOCITY, by.velocity), (ATTITUDE, by.attitude)] {
            for axis in at..at + 3 {
                self.covariance[(axis, axis)] += sigma * sigma;
            }
        }
    }

    /// Becomes `new`, its covariance made symmetric, if that holds nothing but numbers.
    pub(crate) fn replace(&mut self, new: Filter) -> Result<(), Diverged> {
        let covariance = (new.covariance + new.covariance.transpose()) * 0.5;
        let is_covariance =
            (0..ERROR_DIM).all(|i| covariance[(i, i)] >= 0.0) && covariance.iter().all(|x| x.is_finite());
        if !new.state.is_finite() || !is_covariance || !new.mean().iter().all(|x| x.is_finite()) {
            return Err(Diverged);
        }
        *self = Filter { covariance, ..new };
        Ok(())
    }
}

/// From rows at x̄ ⊞ δ and its own error coordinates to rows on δ itself: J ← J·G(δ), r ← r − J δ.
fn into_chart(rows: &mut [Row], delta: &BlockVector<ERROR_DIM>) {
    let turn = so3::right_jacobian(&delta.fixed_rows::<3>(ATTITUDE).into_owned());
    for row in rows {
        let attitude = turn.tr_mul(&row.jacobian.fixed_rows::<3>(ATTITUDE));
        row.jacobian.fixed_rows_mut::<3>(ATTITUDE).copy_from(&attitude);
        row.residual -= dot(&row.jacobian, delta);
    }
}

/// G P Gᵀ.
pub(crate) fn in_new_chart(covariance: &Block<ERROR_DIM>, turn: &nalgebra::Matrix3<f64>) -> Block<ERROR_DIM> {
    let mut turned = *covariance;
    let rows = turn * covariance.fixed_rows::<3>(ATTITUDE);
    turned.fixed_rows_mut::<3>(ATTITUDE).copy_from(&rows);
    let columns = turned.fixed_columns::<3>(ATTITUDE) * turn.transpose();
    turned.fixed_columns_mut::<3>(ATTITUDE).copy_from(&columns);
    turned
}

/// Half the weighted sum of squares after a step δ.
fn cost(rows: &[Row], delta: &BlockVector<ERROR_DIM>) -> f64 {
    0.5 * rows.iter().map(|row| row.weight * row.after(delta).powi(2)).sum::<f64>()
}

/// δ and P given N(`mean`, `covariance`) and all rows.
#[inline(always)]
fn fold(
    mean: &BlockVector<ERROR_DIM>,
    covariance: &Block<ERROR_DIM>,
    rows: &[Row],
) -> (BlockVector<ERROR_DIM>, Block<ERROR_DIM>) {
    let (mut delta, mut covariance) = (*mean, *covariance);
    for row in rows {
        if row.weight > 0.0 {
            fold_row(&mut delta, &mut covariance, row);
        }
    }
    (delta, covariance)
}

/// One row. Joseph's form from left to right: M = P − K pᵀ, then M − (M jᵀ)Kᵀ + K Kᵀ; each a sum of outer products.
#[inline(always)]
fn fold_row(delta: &mut BlockVector<ERROR_DIM>, covariance: &mut Block<ERROR_DIM>, row: &Row) {
    let noise = 1.0 / row.weight;
    let seen = times_symmetric(covariance, &row.jacobian);
    let gain = seen * (1.0 / (dot(&row.jacobian, &seen) + noise));
    *delta -= gain * row.after(delta);
    subtract_outer(covariance, &gain, &seen);
    // The covariance is symmetric no longer: M jᵀ runs over its rows.
    let mut left = BlockVector::<ERROR_DIM>::zeros();
    for column in 0..ERROR_DIM {
        let factor = row.jacobian[column];
        for index in 0..ERROR_DIM {
            left.data.0[0][index] += covariance.data.0[column][index] * factor;
        }
    }
    subtract_outer(covariance, &(left - gain * noise), &gain);
}

/// P v of a symmetric P.
#[inline(always)]
fn times_symmetric(p: &Block<ERROR_DIM>, v: &BlockVector<ERROR_DIM>) -> BlockVector<ERROR_DIM> {
    let mut product = [0.0; ERROR_DIM];
    for column in 0..ERROR_DIM {
        let factor = v.data.0[0][column];
        for index in 0..ERROR_DIM {
            product[index] += p.data.0[column][index] * factor;
        }
    }
    BlockVector::from_array_storage(ArrayStorage([product]))
}

/// P −= a bᵀ.
#[inline(always)]
fn subtract_outer(p: &mut Block<ERROR_DIM>, a: &BlockVector<ERROR_DIM>, b: &BlockVector<ERROR_DIM>) {
    add_product_transposed(p, a, b, -1.0);
}

fn is_small(step: &BlockVector<ERROR_DIM>) -> bool {
    let length = |at: usize| step.fixed_rows::<3>(at).norm();
    length(POSITION) < STEP_LENGTH && length(VELOCITY) < STEP_LENGTH && length(ATTITUDE) < STEP_ANGLE
}
