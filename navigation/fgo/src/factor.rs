//! A measurement tied to a keyframe, and its whitened rows.
//!
//! `models` says what a sensor sees and how a keyframe's state is carried to the reading's own time; here the two meet,
//! are whitened once (the inflated covariance is frozen after the first evaluation, §3.1 of the method) and become rows.

use nalgebra::{Cholesky, SMatrix, SVector};
use nav_models::anchored::{Anchored, SensorModel};
use nav_models::preintegration::Preintegration;
use nav_models::sensors::{DvlModel, GnssModel, LblModel, McpModel, PsModel};
use nav_models::state::NavState;
use nav_models::world::WorldModel;
use shared_types::{Kernel, Sensor, Time};

use crate::kernels::BlockVector;
use crate::rows::{DIM, Group, Row, Rows};

/// Rows of the largest measurement.
pub const ROWS_MAX: usize = 3;

/// What was measured.
#[derive(Clone, Copy, Debug)]
pub enum Model {
    /// One slant range.
    Lbl(LblModel),
    /// Antenna position.
    Gnss(GnssModel),
    /// Velocity of the DVL.
    Dvl(DvlModel),
    /// Heading.
    Mcp(McpModel),
    /// Depth.
    Ps(PsModel),
}

/// One measurement tied to a keyframe.
#[derive(Clone, Copy, Debug)]
pub struct Factor {
    /// Data time at which it was valid.
    pub t: Time,
    /// What was measured.
    pub model: Model,
    /// From the keyframe to that time; `None` at the keyframe itself.
    pub increment: Option<Preintegration>,
    /// Robust kernel.
    pub kernel: Kernel,
    /// LBL epoch; 0 for others.
    pub epoch: u32,
    /// 1-sigma of the offset that the ranges of an epoch share, m.
    pub offset_sigma: f64,
    /// Number of the buoy; 0 for others.
    pub buoy: u32,
    /// L⁻¹ with Λ = LLᵀ, once evaluated; the upper left corner counts.
    whitening: Option<SMatrix<f64, ROWS_MAX, ROWS_MAX>>,
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

impl MeasuredRows {
    /// The rows in use.
    pub fn as_slice(&self) -> &[Row] {
        &self.rows[..self.count]
    }

    /// The rows in use.
    pub fn as_mut_slice(&mut self) -> &mut [Row] {
        &mut self.rows[..self.count]
    }
}

const NO_ROW: Row = Row {
    jacobian: BlockVector::<DIM>::from_array_storage(nalgebra::ArrayStorage([[0.0; DIM]])),
    residual: 0.0,
    inverse_sigma: 0.0,
    weight: 1.0,
};

impl Factor {
    /// A measurement at `t`.
    pub fn new(t: Time, model: Model, increment: Option<Preintegration>, kernel: Kernel) -> Factor {
        Factor { t, model, increment, kernel, epoch: 0, offset_sigma: 0.0, buoy: 0, whitening: None }
    }

    /// The same as one range of an epoch.
    #[must_use]
    pub fn of_epoch(mut self, epoch: u32, buoy: u32, offset_sigma: f64) -> Factor {
        (self.epoch, self.buoy, self.offset_sigma) = (epoch, buoy, offset_sigma);
        self
    }

    /// Whose measurement.
    pub fn sensor(&self) -> Sensor {
        match self.model {
            Model::Lbl(_) => Sensor::Lbl,
            Model::Gnss(_) => Sensor::Gnss,
            Model::Dvl(_) => Sensor::Dvl,
            Model::Mcp(_) => Sensor::Mcp,
            Model::Ps(_) => Sensor::Ps,
        }
    }

    /// Whether it shares an offset with other ranges.
    pub fn shares_offset(&self) -> bool {
        matches!(self.model, Model::Lbl(_)) && self.offset_sigma > 0.0
    }

    /// Degrees of freedom of a test on it.
    pub fn components(&self) -> usize {
        match &self.model {
            Model::Gnss(model) => model.components(),
            Model::Dvl(_) => 3,
            Model::Lbl(_) | Model::Mcp(_) | Model::Ps(_) => 1,
        }
    }

    /// Its whitened rows at a linearisation point of its keyframe.
    ///
    /// # Errors
    /// [`Unusable`]: the covariance is singular or a number is not finite.
    pub fn rows(&mut self, linearised: &NavState, world: &WorldModel) -> Result<MeasuredRows, Unusable> {
        match self.model {
            Model::Lbl(model) => self.rows_of(&model, linearised, world),
            Model::Gnss(model) => self.rows_of(&model, linearised, world),
            Model::Dvl(model) => self.rows_of(&model, linearised, world),
            Model::Mcp(model) => self.rows_of(&model, linearised, world),
            Model::Ps(model) => self.rows_of(&model, linearised, world),
        }
    }

    fn rows_of<const ROWS: usize>(
        &mut self,
        model: &impl SensorModel<ROWS>,
        linearised: &NavState,
        world: &WorldModel,
    ) -> Result<MeasuredRows, Unusable> {
        let anchored = match &self.increment {
            Some(increment) => Anchored::new(model, linearised, linearised, increment, world),
            None => Anchored::at_keyframe(model, linearised, linearised, world),
        };
        let whitening = match &self.whitening {
            Some(frozen) => frozen.fixed_view::<ROWS, ROWS>(0, 0).into_owned(),
            None => {
                let whitening = inverse_root(&anchored.covariance).ok_or(Unusable)?;
                let mut frozen = SMatrix::<f64, ROWS_MAX, ROWS_MAX>::zeros();
                frozen.fixed_view_mut::<ROWS, ROWS>(0, 0).copy_from(&whitening);
                self.whitening = Some(frozen);
                whitening
            }
        };
        let residual: SVector<f64, ROWS> = whitening * anchored.residual;
        let jacobian: SMatrix<f64, ROWS, DIM> = whitening * anchored.jacobian;
        if !residual.iter().chain(jacobian.iter()).all(|x| x.is_finite()) {
            return Err(Unusable);
        }
        let mut measured = MeasuredRows { rows: [NO_ROW; ROWS_MAX], count: ROWS };
        for (index, row) in measured.rows[..ROWS].iter_mut().enumerate() {
            row.jacobian = jacobian.row(index).transpose();
            row.residual = residual[index];
            row.inverse_sigma = whitening[(index, index)];
        }
        Ok(measured)
    }

    /// Evaluates the first group of `factors` anew and appends its rows. Returns how many factors the group has.
    pub fn push_rows(factors: &mut [Factor], linearised: &NavState, world: &WorldModel, rows: &mut Rows) -> usize {
        let Some(first) = factors.first().copied() else { return 0 };
        let members = if first.shares_offset() {
            factors.iter().take_while(|other| other.shares_offset() && other.epoch == first.epoch).count()
        } else {
            1
        };
        rows.open(first.group());
        for factor in &mut factors[..members] {
            // A factor that was usable once and no longer is (a heading near the vertical) says nothing meanwhile.
            if let Ok(measured) = factor.rows(linearised, world) {
                rows.extend(measured.as_slice());
            }
        }
        rows.close();
        members
    }

    /// How its rows are weighted.
    pub fn group(&self) -> Group {
        if self.shares_offset() {
            Group::CommonOffset { kernel: self.kernel, sigma: self.offset_sigma }
        } else {
            Group::Single { kernel: self.kernel }
        }
    }
}

/// L⁻¹ with Λ = LLᵀ.
fn inverse_root<const ROWS: usize>(covariance: &SMatrix<f64, ROWS, ROWS>) -> Option<SMatrix<f64, ROWS, ROWS>> {
    let l = Cholesky::new(*covariance)?.l();
    let mut inverse = SMatrix::<f64, ROWS, ROWS>::identity();
    l.solve_lower_triangular_mut(&mut inverse).then_some(inverse)
}
