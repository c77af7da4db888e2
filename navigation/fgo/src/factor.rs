//! A measurement tied to a keyframe, and its whitened rows.
//!
//! `models` says what a sensor sees and how a keyframe's state is carried to the reading's own time; here the two meet,
//! are whitened once (the inflated covariance is frozen after the first evaluation, §3.1 of the method) and become rows.

use nalgebra::SMatrix;
use nav_models::anchor::Anchor;
use nav_models::anchored::{Anchored, Pose, SensorModel};
use nav_models::preintegration::{ImuPoint, Increment, Piece};
pub use nav_models::row::MeasuredRows;
use nav_models::row::{ROWS_MAX, SLOTS, Unusable, inverse_root, whiten_columns};
pub use nav_models::sensors::Model;
use nav_models::world::WorldModel;
use shared_types::{Kernel, Sensor, Time};

use crate::rows::{DIM, Group, Rows};

/// One measurement tied to a keyframe.
#[derive(Clone, Copy, Debug)]
pub struct Factor {
    /// Data time at which it was valid.
    pub t: Time,
    /// What was measured.
    pub model: Model,
    /// From the keyframe to that time; `None` at the keyframe itself.
    pub increment: Option<Increment>,
    /// Robust kernel.
    pub kernel: Kernel,
    /// LBL epoch; 0 for others.
    pub epoch: u32,
    /// 1-sigma of the offset that the ranges of an epoch share, m.
    pub offset_sigma: f64,
    /// Number of the buoy; 0 for others.
    pub buoy: u32,
    /// Its place among the [moored](crate::moorings) ones whose positions are not exact.
    pub mooring: Option<u8>,
    /// L⁻¹ with Λ = LLᵀ, from [`Factor::whiten`] on; the upper left corner counts.
    whitening: SMatrix<f64, ROWS_MAX, ROWS_MAX>,
    /// Whitened change with its systematic errors, as [`nav_models::row::Row::slopes`]; frozen with the whitening.
    slopes: SMatrix<f64, ROWS_MAX, SLOTS>,
}

/// How a reading may be systematically wrong.
#[derive(Clone, Copy, Debug)]
pub struct Doubts {
    /// The IMU sample at the reading; `None` where nobody asks whether its stamp is right.
    pub point: Option<ImuPoint>,
    /// 1-sigma of each error, as [`nav_models::row::SLOTS`] counts them, that its covariance has to cover.
    pub sigmas: [f64; SLOTS],
}

/// A reading that is not whitened. Rows that the sensor does not have are zero, of unit variance: they say nothing.
#[derive(Clone, Copy, Debug)]
pub struct Parts {
    /// Predicted minus measured, and beside it the Jacobian on the keyframe.
    pub rows: SMatrix<f64, ROWS_MAX, { 1 + DIM }>,
    /// Q: how it feels the increment's noise.
    pub noise_rows: SMatrix<f64, ROWS_MAX, DIM>,
    /// R_z.
    pub covariance: SMatrix<f64, ROWS_MAX, ROWS_MAX>,
}

impl Parts {
    fn of<const ROWS: usize>(anchored: &Anchored<ROWS>) -> Parts {
        let mut parts = Parts { rows: SMatrix::zeros(), noise_rows: SMatrix::zeros(), covariance: SMatrix::identity() };
        parts.rows.fixed_view_mut::<ROWS, 1>(0, 0).copy_from(&anchored.residual);
        parts.rows.fixed_view_mut::<ROWS, DIM>(0, 1).copy_from(&anchored.jacobian);
        parts.noise_rows.fixed_rows_mut::<ROWS>(0).copy_from(&anchored.noise_rows.whole());
        parts.covariance.fixed_view_mut::<ROWS, ROWS>(0, 0).copy_from(&anchored.covariance);
        parts
    }
}

impl Factor {
    /// A measurement at `t`.
    pub fn new(t: Time, model: Model, increment: Option<Increment>, kernel: Kernel) -> Factor {
        Factor {
            t,
            model,
            increment,
            kernel,
            epoch: 0,
            offset_sigma: 0.0,
            buoy: 0,
            mooring: None,
            whitening: SMatrix::zeros(),
            slopes: SMatrix::zeros(),
        }
    }

    /// Makes a used one the measurement of [`Factor::new`] at the keyframe itself. Its whitening is that of before until
    /// [`Factor::whiten`].
    pub fn renew(&mut self, t: Time, model: Model, kernel: Kernel) {
        (self.t, self.model, self.kernel) = (t, model, kernel);
        (self.increment, self.mooring) = (None, None);
        (self.epoch, self.buoy, self.offset_sigma) = (0, 0, 0.0);
    }

    /// Makes it one range of an epoch.
    pub fn join_epoch(&mut self, epoch: u32, buoy: u32, offset_sigma: f64) {
        (self.epoch, self.buoy, self.offset_sigma) = (epoch, buoy, offset_sigma);
    }

    /// Whose measurement.
    pub fn sensor(&self) -> Sensor {
        self.model.sensor()
    }

    /// Place of that sensor in [`shared_types::AIDING`].
    pub fn place(&self) -> usize {
        self.model.place()
    }

    /// Whether it shares an offset with other ranges.
    pub fn shares_offset(&self) -> bool {
        matches!(self.model, Model::Lbl(_)) && self.offset_sigma > 0.0
    }

    /// Degrees of freedom of a test on it.
    pub fn components(&self) -> usize {
        self.model.components()
    }

    /// Whitens it by its own noise and that of `piece`, from its keyframe to its time (`None` at the keyframe itself), for
    /// as long as it lives; `rows` become its own. Its covariance covers `doubts`.
    ///
    /// # Errors
    /// [`Unusable`]: the covariance is singular or a number is not finite.
    pub fn whiten(
        &mut self,
        from: &Anchor,
        piece: Option<&Piece<'_>>,
        doubts: Option<&Doubts>,
        world: &WorldModel,
        rows: &mut MeasuredRows,
    ) -> Result<(), Unusable> {
        match self.model {
            Model::Lbl(model) => self.whiten_as(&model, from, piece, doubts, world, rows),
            Model::Gnss(model) => self.whiten_as(&model, from, piece, doubts, world, rows),
            Model::Dvl(model) => self.whiten_as(&model, from, piece, doubts, world, rows),
            Model::Mcp(model) => self.whiten_as(&model, from, piece, doubts, world, rows),
            Model::Ps(model) => self.whiten_as(&model, from, piece, doubts, world, rows),
        }
    }

    fn whiten_as<const ROWS: usize>(
        &mut self,
        model: &impl SensorModel<ROWS>,
        from: &Anchor,
        piece: Option<&Piece<'_>>,
        doubts: Option<&Doubts>,
        world: &WorldModel,
        rows: &mut MeasuredRows,
    ) -> Result<(), Unusable> {
        let anchored = self.anchored(model, from, world);
        let mut covariance = piece.map_or(anchored.covariance, |piece| anchored.inflated_covariance(piece));
        let mut slopes = SMatrix::<f64, ROWS, SLOTS>::zeros();
        if let Some(doubts) = doubts {
            if let Some(point) = &doubts.point {
                slopes.set_column(0, &-anchored.rate(from, self.increment.as_ref(), point, world));
            }
            slopes.set_column(1, &model.calibration_jacobian(&anchored.residual));
            for (slope, sigma) in slopes.column_iter().zip(doubts.sigmas) {
                if sigma > 0.0 {
                    covariance += slope * slope.transpose() * (sigma * sigma);
                }
            }
        }
        let whitening = inverse_root(&covariance).ok_or(Unusable)?;
        let slopes = whiten_columns(&whitening, &slopes);
        self.whitening.fixed_view_mut::<ROWS, ROWS>(0, 0).copy_from(&whitening);
        self.slopes.fixed_rows_mut::<ROWS>(0).copy_from(&slopes);
        self.give(rows, &anchored, &whitening, &slopes)
    }

    /// Puts it at another time, at the end of another increment from its keyframe. Its whitening stays.
    pub fn move_to(&mut self, t: Time, increment: Increment, point: &ImuPoint) {
        self.t = t;
        self.increment = Some(increment);
        if let Model::Dvl(model) = &mut self.model {
            model.gyro_body = point.gyro_body;
        }
    }

    /// Its rows with its keyframe at another linearisation point.
    ///
    /// # Errors
    /// [`Unusable`]: a number is not finite.
    pub fn rows(&self, from: &Anchor, world: &WorldModel) -> Result<MeasuredRows, Unusable> {
        match self.model {
            Model::Lbl(model) => self.whitened(&self.anchored(&model, from, world)),
            Model::Gnss(model) => self.whitened(&self.anchored(&model, from, world)),
            Model::Dvl(model) => self.whitened(&self.anchored(&model, from, world)),
            Model::Mcp(model) => self.whitened(&self.anchored(&model, from, world)),
            Model::Ps(model) => self.whitened(&self.anchored(&model, from, world)),
        }
    }

    /// What it says at the end of the increment from its keyframe, its own noise and that of the increment apart.
    pub fn parts(&self, from: &Anchor, increment: &Increment, world: &WorldModel) -> Parts {
        match self.model {
            Model::Lbl(model) => Parts::of(&Anchored::new(&model, from, increment, world)),
            Model::Gnss(model) => Parts::of(&Anchored::new(&model, from, increment, world)),
            Model::Dvl(model) => Parts::of(&Anchored::new(&model, from, increment, world)),
            Model::Mcp(model) => Parts::of(&Anchored::new(&model, from, increment, world)),
            Model::Ps(model) => Parts::of(&Anchored::new(&model, from, increment, world)),
        }
    }

    fn anchored<const ROWS: usize>(
        &self,
        model: &impl SensorModel<ROWS>,
        from: &Anchor,
        world: &WorldModel,
    ) -> Anchored<ROWS> {
        match &self.increment {
            Some(increment) => Anchored::new(model, from, increment, world),
            None => Anchored::at_keyframe(model, &Pose::from(from), world),
        }
    }

    fn whitened<const ROWS: usize>(&self, anchored: &Anchored<ROWS>) -> Result<MeasuredRows, Unusable> {
        let mut rows = MeasuredRows::default();
        let whitening = self.whitening.fixed_view::<ROWS, ROWS>(0, 0).into_owned();
        self.give(&mut rows, anchored, &whitening, &self.slopes.fixed_rows::<ROWS>(0).into_owned())?;
        Ok(rows)
    }

    fn give<const ROWS: usize>(
        &self,
        rows: &mut MeasuredRows,
        anchored: &Anchored<ROWS>,
        whitening: &SMatrix<f64, ROWS, ROWS>,
        slopes: &SMatrix<f64, ROWS, SLOTS>,
    ) -> Result<(), Unusable> {
        rows.fill(anchored, whitening, slopes)?;
        rows.as_mut_slice().iter_mut().for_each(|row| row.mooring = self.mooring);
        Ok(())
    }

    /// Evaluates the first group of `factors` anew and appends its rows. Returns how many factors the group has.
    pub fn push_rows(factors: &[Factor], from: &Anchor, world: &WorldModel, rows: &mut Rows) -> usize {
        let Some(first) = factors.first() else { return 0 };
        let members = if first.shares_offset() {
            factors.iter().take_while(|other| other.shares_offset() && other.epoch == first.epoch).count()
        } else {
            1
        };
        rows.open(first.place(), first.group());
        for factor in &factors[..members] {
            // A factor that was usable once and no longer is (a heading near the vertical) says nothing meanwhile.
            if let Ok(measured) = factor.rows(from, world) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::{Block, BlockVector};
    use approx::assert_relative_eq;
    use nalgebra::{Quaternion, UnitQuaternion, Vector3};
    use nav_geometry::Geodetic;
    use nav_models::sensors::LblModel;
    use nav_models::state::NavState;
    use shared_types::{Config, Lbl};

    /// The epoch of §8.6 of the method at x_k of §8.4: cost and normal matrix.
    fn golden_epoch(offset_sigma: f64) -> (f64, Block<DIM>) {
        let world = WorldModel::new(Geodetic::from_degrees(36.38, 127.36, 0.0), &Config::default());
        let mut state = NavState::identity();
        state.position_enu = Vector3::new(120.0, -340.0, -55.0);
        state.q_enu_body = UnitQuaternion::new_normalize(Quaternion::new(0.9, 0.1, -0.05, 0.42));
        let from = Anchor::new(&state, &world);
        let buoys = [[0.0, -500.0, 0.0], [-400.0, 0.0, 0.0], [-200.0, 1000.0, 0.0], [200.0, 500.0, 0.0]];
        let ranges = [207.6, 625.9, 1377.7, 845.8];
        let mut factors = Vec::new();
        for (index, sigma) in [0.3, 0.3, 0.4, 0.5].into_iter().enumerate() {
            let lbl = Lbl { sigma, lever_arm_body: [0.4, -0.15, 0.25], reference_buoy: 1, buoy_sigma: 0.0 };
            let model = Model::Lbl(LblModel::new(ranges[index], buoys[index], 0.0, &lbl));
            let mut factor = Factor::new(Time(0), model, None, Kernel::None);
            factor.join_epoch(1, index as u32, offset_sigma);
            factor.whiten(&from, None, None, &world, &mut MeasuredRows::default()).expect("regular");
            factors.push(factor);
        }
        let mut rows = Rows::default();
        let mut pushed = 0;
        while pushed < factors.len() {
            pushed += Factor::push_rows(&factors[pushed..], &from, &world, &mut rows);
        }
        let (mut information, mut right) = (Block::zeros(), BlockVector::zeros());
        rows.assemble(&mut information, &mut right);
        (rows.cost(&BlockVector::zeros()), information)
    }

    #[test]
    fn raw_and_differenced_ranges_meet_the_golden_numbers_of_the_method() {
        // The method gives sums of squares, a cost is half of one.
        assert_relative_eq!(2.0 * golden_epoch(0.0).0, 50.6070419433, max_relative = 1e-8);
        let (cost, information) = golden_epoch(f64::INFINITY);
        assert_relative_eq!(2.0 * cost, 42.2256825493, max_relative = 1e-8);
        let golden = [
            (0, 0, 3.16088907327),
            (0, 1, 2.77392176646),
            (0, 2, -0.26406330932),
            (1, 1, 18.007640609),
            (1, 2, -2.2506629617),
            (2, 2, 0.284662358024),
        ];
        for (row, column, expected) in golden {
            assert_relative_eq!(information[(row, column)], expected, max_relative = 1e-9);
        }
    }
}
