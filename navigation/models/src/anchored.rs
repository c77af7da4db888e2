//! A reading taken off the keyframes, tied to one of them: the paper's FBPF as one mechanism for every sensor (§3.1).
//!
//! ```text
//! y_j = transport(x_k),  r = h(y_j) − z,  H = ∂h/∂(p_j, v_j, θ_j),  H_b = direct ∂h/∂b_g (DVL alone)
//! J = H·T_j + [0 … H_b]         Λ = R_z + Q P15 Qᵀ,   Q = [H L | 0 H_b]
//! ```
//!
//! The paper weighs with R_z alone. The increment from the keyframe to the reading is itself noisy: with good sensors or a
//! long offset its share of Λ matters, and without it the estimate is overconfident.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use crate::anchor::Anchor;
use crate::blocks::{block_of, times, transposed_times};
use crate::preintegration::{ImuPoint, Increment, NoiseRows, Piece};
use crate::state::{ATTITUDE, ERROR_DIM, GYRO_BIAS, NavState, POSITION, VELOCITY};
use crate::transport::Carried;
use crate::world::WorldModel;

/// What a sensor sees of the state at its own time. `ROWS` residuals; no model whitens, weighs or gates.
pub trait SensorModel<const ROWS: usize> {
    /// Whether its Jacobian has columns other than those of the attitude: nothing else of the way to a heading's own time needs to be
    /// carried back to the keyframe.
    const SEES_MOTION: bool = true;

    /// The reading held against `pose`. All at once, since the parts share most of their work.
    fn see(&self, pose: &Pose, world: &WorldModel) -> Seen<ROWS>;

    /// ∂residual/∂g of the sensor's [`shared_types::Calibration`], zero if it has none; `residual` is that of the reading.
    fn calibration_jacobian(&self, _residual: &SVector<f64, ROWS>) -> SVector<f64, ROWS> {
        SVector::zeros()
    }

    /// ∂residual/∂b_g other than through the transport, ROWS × 3; `None` where the sensor does not look at the gyroscope.
    fn gyro_bias_jacobian(&self) -> Option<SMatrix<f64, ROWS, 3>> {
        None
    }
}

/// The state at the time of a reading, as far as sensors look at it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// m.
    pub position_enu: Vector3<f64>,
    /// m/s.
    pub velocity_enu: Vector3<f64>,
    /// R.
    pub r_enu_body: Matrix3<f64>,
    /// rad/s.
    pub gyro_bias: Vector3<f64>,
}

impl From<&Anchor> for Pose {
    fn from(Anchor { state, r_enu_body, .. }: &Anchor) -> Pose {
        Pose {
            position_enu: state.position_enu,
            velocity_enu: state.velocity_enu,
            r_enu_body: *r_enu_body,
            gyro_bias: state.gyro_bias,
        }
    }
}

impl From<&NavState> for Pose {
    fn from(state: &NavState) -> Pose {
        Pose {
            position_enu: state.position_enu,
            velocity_enu: state.velocity_enu,
            r_enu_body: state.r_enu_body(),
            gyro_bias: state.gyro_bias,
        }
    }
}

/// A reading held against a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen<const ROWS: usize> {
    /// Predicted minus measured.
    pub residual: SVector<f64, ROWS>,
    /// H = ∂residual/∂(δp, δv, δθ) at the time of the reading.
    pub jacobian: SMatrix<f64, ROWS, 9>,
    /// R_z, covariance of the reading itself. The pose enters where the model's geometry scales it.
    pub covariance: SMatrix<f64, ROWS, ROWS>,
}

/// A reading as a factor on the keyframe that it is tied to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchored<const ROWS: usize> {
    /// Predicted minus measured.
    pub residual: SVector<f64, ROWS>,
    /// With respect to the 15 error coordinates of the keyframe.
    pub jacobian: SMatrix<f64, ROWS, ERROR_DIM>,
    /// R_z, the reading's own covariance.
    pub covariance: SMatrix<f64, ROWS, ROWS>,
    /// Q: how it feels the noise of the increment.
    pub noise_rows: NoiseRows<ROWS>,
    /// Gravity on the way to the reading, m/s²; `None` at the keyframe.
    gravity_enu: Option<Vector3<f64>>,
}

impl<const ROWS: usize> Anchored<ROWS> {
    /// The factor of a reading at the end of `increment`, which begins at the keyframe `from`.
    #[inline]
    pub fn new<M: SensorModel<ROWS>>(
        model: &M,
        from: &Anchor,
        increment: &Increment,
        world: &WorldModel,
    ) -> Anchored<ROWS> {
        let carried = Carried::new(from, increment, world);
        let seen = model.see(&carried.pose(&from.state), world);
        let (mut jacobian, by_increment) = carried.rows(&seen.jacobian, M::SEES_MOTION);
        let by_gyro = model.gyro_bias_jacobian();
        if let Some(direct) = &by_gyro {
            let mut columns = jacobian.fixed_columns_mut::<3>(GYRO_BIAS);
            columns += direct;
        }
        Anchored {
            residual: seen.residual,
            jacobian,
            covariance: seen.covariance,
            noise_rows: NoiseRows { by_increment, by_gyro, sees_motion: M::SEES_MOTION },
            gravity_enu: Some(carried.gravity_enu()),
        }
    }

    /// The factor of a reading taken at the keyframe itself, which is at `pose`.
    #[inline]
    pub fn at_keyframe(model: &impl SensorModel<ROWS>, pose: &Pose, world: &WorldModel) -> Anchored<ROWS> {
        let seen = model.see(pose, world);
        let mut jacobian = SMatrix::<f64, ROWS, ERROR_DIM>::zeros();
        jacobian.fixed_columns_mut::<9>(0).copy_from(&seen.jacobian);
        if let Some(direct) = model.gyro_bias_jacobian() {
            jacobian.fixed_columns_mut::<3>(GYRO_BIAS).copy_from(&direct);
        }
        Anchored {
            residual: seen.residual,
            jacobian,
            covariance: seen.covariance,
            noise_rows: NoiseRows { by_increment: SMatrix::zeros(), by_gyro: None, sees_motion: false },
            gravity_enu: None,
        }
    }

    /// How fast the residual changes if the reading is taken later, per s: `H (v, v̇, ω)` of the state at the reading.
    ///
    /// `from` is the keyframe, `increment` that of [`Anchored::new`] (`None` at the keyframe), `point` the IMU sample at
    /// the reading. The change of the lever arm's velocity is left out, and over the increment the Earth stands still.
    pub fn rate(
        &self,
        from: &Anchor,
        increment: Option<&Increment>,
        point: &ImuPoint,
        world: &WorldModel,
    ) -> SVector<f64, ROWS> {
        let Anchor { state, r_enu_body, .. } = from;
        let force = point.accel_body - state.accel_bias;
        let rate = point.gyro_body - state.gyro_bias - transposed_times(r_enu_body, &world.earth_rate_enu);
        let gravity = self.gravity_enu.unwrap_or(from.gravity_enu);
        let columns = |at: usize| block_of::<ROWS, 3, ROWS, ERROR_DIM>(&self.jacobian, 0, at);
        let Some(increment) = increment else {
            let acceleration = times(r_enu_body, &force) + gravity;
            return times(&columns(POSITION), &state.velocity_enu)
                + times(&columns(VELOCITY), &acceleration)
                + times(&columns(ATTITUDE), &rate);
        };
        let by_increment = |at: usize| block_of::<ROWS, 3, ROWS, 9>(&self.noise_rows.by_increment, 0, at);
        let velocity = state.velocity_enu + gravity * increment.dt_total + times(r_enu_body, &increment.beta);
        // In the axes of the keyframe's body, which the increment is written in.
        let acceleration: Vector3<f64> = times(&increment.gamma, &force) + transposed_times(r_enu_body, &gravity);
        times(&columns(POSITION), &velocity) + times(&by_increment(3), &acceleration) + times(&by_increment(6), &rate)
    }

    /// Λ = R_z + Q P15 Qᵀ: the reading's own covariance and that of the piece from the keyframe.
    #[inline]
    pub fn inflated_covariance(&self, piece: &Piece<'_>) -> SMatrix<f64, ROWS, ROWS> {
        let covariance = self.covariance + piece.noise(&self.noise_rows);
        (covariance + covariance.transpose()) * 0.5
    }
}
