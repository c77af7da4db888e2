//! Whitened rows: what one measurement says, in units of its own sigma.
//!
//! A row is r̃ + j̃ᵀ δ with unit variance, δ the step of a state from its linearisation point.

use nalgebra::{ArrayStorage, SMatrix, SVector};

use crate::anchored::Anchored;
use crate::blocks::{inverse_cholesky, times};
use crate::kernels::{BlockVector, dot};
use crate::state::ERROR_DIM;

/// Rows of the largest measurement.
pub const ROWS_MAX: usize = 3;

/// A reading's systematic errors: how late its stamp is, and its sensor's [`shared_types::Calibration`].
pub const SLOTS: usize = 2;

/// ∂r/∂g over σ for each systematic error g of a reading, per its unit. For a stamp that is too late: minus the residual's own
/// rate.
pub type Slopes = [f64; SLOTS];

/// One whitened row.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// ∂r/∂δ over σ.
    pub jacobian: BlockVector<ERROR_DIM>,
    /// r over σ, at the linearisation point.
    pub residual: f64,
    /// 1/σ: needed where rows share an offset.
    pub inverse_sigma: f64,
    /// Robust weight in use.
    pub weight: f64,
    /// How its sensor's systematic errors change it.
    pub slopes: Slopes,
    /// Which moored buoy it is a range to, where its position is not exact.
    pub mooring: Option<u8>,
}

impl Row {
    /// r̃ after a step δ.
    #[inline(always)]
    pub fn after(&self, delta: &BlockVector<ERROR_DIM>) -> f64 {
        self.residual + dot(&self.jacobian, delta)
    }
}

/// A covariance that cannot be inverted, or a prediction that is not a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unusable;

/// A measurement's rows, at most [`ROWS_MAX`] of them.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredRows {
    rows: [Row; ROWS_MAX],
    count: usize,
}

const NO_ROW: Row = Row {
    jacobian: BlockVector::<ERROR_DIM>::from_array_storage(ArrayStorage([[0.0; ERROR_DIM]])),
    residual: 0.0,
    inverse_sigma: 0.0,
    weight: 1.0,
    slopes: [0.0; SLOTS],
    mooring: None,
};

impl Default for MeasuredRows {
    /// None.
    fn default() -> MeasuredRows {
        MeasuredRows { rows: [NO_ROW; ROWS_MAX], count: 0 }
    }
}

impl MeasuredRows {
    /// The rows of a factor under `whitening`, L⁻¹ of its covariance LLᵀ; `slopes`, one column each, are whitened already.
    ///
    /// # Errors
    /// [`Unusable`]: a number is not finite.
    #[inline]
    pub fn whitened<const ROWS: usize>(
        anchored: &Anchored<ROWS>,
        whitening: &SMatrix<f64, ROWS, ROWS>,
        slopes: &SMatrix<f64, ROWS, SLOTS>,
    ) -> Result<MeasuredRows, Unusable> {
        let mut measured = MeasuredRows::default();
        measured.fill(anchored, whitening, slopes)?;
        Ok(measured)
    }

    /// [`MeasuredRows::whitened`] in their place: they take half a kilobyte.
    ///
    /// # Errors
    /// [`Unusable`]: a number is not finite; there are no rows then.
    #[inline]
    pub fn fill<const ROWS: usize>(
        &mut self,
        anchored: &Anchored<ROWS>,
        whitening: &SMatrix<f64, ROWS, ROWS>,
        slopes: &SMatrix<f64, ROWS, SLOTS>,
    ) -> Result<(), Unusable> {
        let residual = times(whitening, &anchored.residual);
        let jacobian = whiten_columns(whitening, &anchored.jacobian);
        // All of them: to stop at the first that is not would be a branch for each.
        let numbers = residual.as_slice().iter().chain(jacobian.as_slice()).chain(slopes.as_slice());
        if !numbers.fold(true, |all, x| all & x.is_finite()) {
            self.count = 0;
            return Err(Unusable);
        }
        self.count = ROWS;
        for (index, row) in self.rows[..ROWS].iter_mut().enumerate() {
            for (entry, column) in row.jacobian.iter_mut().zip(&jacobian.data.0) {
                *entry = column[index];
            }
            row.residual = residual[index];
            row.inverse_sigma = whitening[(index, index)];
            row.weight = 1.0;
            row.slopes = core::array::from_fn(|slot| slopes[(index, slot)]);
            row.mooring = None;
        }
        Ok(())
    }

    /// The rows in use.
    pub fn as_slice(&self) -> &[Row] {
        &self.rows[..self.count]
    }

    /// The rows in use.
    pub fn as_mut_slice(&mut self) -> &mut [Row] {
        &mut self.rows[..self.count]
    }
}

/// L⁻¹ times each column.
#[inline]
pub fn whiten_columns<const ROWS: usize, const COLUMNS: usize>(
    whitening: &SMatrix<f64, ROWS, ROWS>,
    columns: &SMatrix<f64, ROWS, COLUMNS>,
) -> SMatrix<f64, ROWS, COLUMNS> {
    let mut whitened = SMatrix::zeros();
    for (white, column) in whitened.data.0.iter_mut().zip(&columns.data.0) {
        *white = times(whitening, &SVector::from_array_storage(ArrayStorage([*column]))).data.0[0];
    }
    whitened
}

/// L⁻¹ with Λ = LLᵀ; `None` where Λ is singular.
#[inline]
pub fn inverse_root<const ROWS: usize>(covariance: &SMatrix<f64, ROWS, ROWS>) -> Option<SMatrix<f64, ROWS, ROWS>> {
    inverse_cholesky(covariance)
}
