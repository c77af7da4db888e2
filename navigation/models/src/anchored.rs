//! A reading taken off the keyframes, tied to one of them: the paper's FBPF as one mechanism for every sensor (§3.1).
//!
//! ```text
//! y_j = transport(x_k),  r = h(y_j) − z,  H = ∂h/∂(p_j, v_j, θ_j),  H_b = direct ∂h/∂b_g (DVL alone)
//! J = H·T_j + [0 … H_b]         Λ = R_z + Q P15 Qᵀ,   Q = [H L | 0 H_b]
//! ```
//!
//! The paper weighs with R_z alone. The increment from the keyframe to the reading is itself noisy: with good sensors or a
//! long offset its share of Λ matters, and without it the estimate is overconfident.

use nalgebra::{SMatrix, SVector};

use crate::preintegration::Preintegration;
use crate::state::{ERROR_DIM, GYRO_BIAS, NavState};
use crate::transport::{TransportJacobians, transport, transport_jacobians};
use crate::world::WorldModel;

/// What a sensor sees of the state at its own time. `ROWS` residuals; no model whitens, weighs or gates.
pub trait SensorModel<const ROWS: usize> {
    /// Predicted minus measured.
    fn residual(&self, state: &NavState, world: &WorldModel) -> SVector<f64, ROWS>;

    /// H = ∂residual/∂(δp, δv, δθ) at the time of the reading, ROWS × 9.
    fn jacobian(&self, state: &NavState, world: &WorldModel) -> SMatrix<f64, ROWS, 9>;

    /// ∂residual/∂b_g other than through the transport, ROWS × 3; `None` where the sensor does not look at the gyroscope.
    fn gyro_bias_jacobian(&self) -> Option<SMatrix<f64, ROWS, 3>> {
        None
    }

    /// R_z, covariance of the reading itself. The state enters where the model's geometry scales it.
    fn covariance(&self, state: &NavState, world: &WorldModel) -> SMatrix<f64, ROWS, ROWS>;
}

/// A reading as a factor on the keyframe that it is tied to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchored<const ROWS: usize> {
    /// Predicted minus measured.
    pub residual: SVector<f64, ROWS>,
    /// With respect to the 15 error coordinates of the keyframe.
    pub jacobian: SMatrix<f64, ROWS, ERROR_DIM>,
    /// Λ: the reading's own covariance and that of the increment.
    pub covariance: SMatrix<f64, ROWS, ROWS>,
}

impl<const ROWS: usize> Anchored<ROWS> {
    /// The factor of a reading at the end of `increment`, which begins at the keyframe `state`. Residual and covariance
    /// belong to `state`, the Jacobian to `linearisation` (the same state, or the first estimate of it).
    pub fn new(
        model: &impl SensorModel<ROWS>,
        state: &NavState,
        linearisation: &NavState,
        increment: &Preintegration,
        world: &WorldModel,
    ) -> Anchored<ROWS> {
        let at_reading = transport(state, increment, world);
        let residual = model.residual(&at_reading, world);
        let r_z = model.covariance(&at_reading, world);
        let linearised_at_reading =
            if linearisation == state { at_reading } else { transport(linearisation, increment, world) };
        let h = model.jacobian(&linearised_at_reading, world);
        let jacobians = transport_jacobians(linearisation, increment, world);
        let (jacobian, covariance) = compose(&h, model.gyro_bias_jacobian().as_ref(), &r_z, &jacobians, increment);
        Anchored { residual, jacobian, covariance }
    }

    /// The factor of a reading taken at the keyframe itself.
    pub fn at_keyframe(
        model: &impl SensorModel<ROWS>,
        state: &NavState,
        linearisation: &NavState,
        world: &WorldModel,
    ) -> Anchored<ROWS> {
        let h = model.jacobian(linearisation, world);
        let mut jacobian = SMatrix::<f64, ROWS, ERROR_DIM>::zeros();
        jacobian.fixed_columns_mut::<9>(0).copy_from(&h);
        if let Some(direct) = model.gyro_bias_jacobian() {
            jacobian.fixed_columns_mut::<3>(GYRO_BIAS).copy_from(&direct);
        }
        Anchored { residual: model.residual(state, world), jacobian, covariance: model.covariance(state, world) }
    }
}

/// J (ROWS × 15) and Λ (ROWS × ROWS) of the module's equations.
#[inline]
pub fn compose<const ROWS: usize>(
    h: &SMatrix<f64, ROWS, 9>,
    gyro_bias_jacobian: Option<&SMatrix<f64, ROWS, 3>>,
    r_z: &SMatrix<f64, ROWS, ROWS>,
    transport: &TransportJacobians,
    increment: &Preintegration,
) -> (SMatrix<f64, ROWS, ERROR_DIM>, SMatrix<f64, ROWS, ROWS>) {
    let mut jacobian = h * transport.state;
    let q = h * transport.increment;
    let mut covariance = r_z + q * increment.increment_covariance() * q.transpose();
    if let Some(direct) = gyro_bias_jacobian {
        let mut columns = jacobian.fixed_columns_mut::<3>(GYRO_BIAS);
        columns += direct;
        let cross = q * increment.cross_covariance().fixed_columns::<3>(3) * direct.transpose();
        let [_, gyro_walk] = increment.bias_walk();
        covariance += cross + cross.transpose() + direct * direct.transpose() * gyro_walk;
    }
    (jacobian, (covariance + covariance.transpose()) * 0.5)
}
