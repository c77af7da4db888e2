//! The first state that agrees best with readings taken at times of their own: least squares, linearised anew at each step.
//!
//! ```text
//! min  ‖x ⊟ x₀‖²_P₀ + Σ ‖h(transport(x, t_j)) − z_j‖²_Λj        Λ_j = R_z + Q P15 Qᵀ
//! ```
//!
//! A fix of a second ago, taken for where the vehicle is now, is wrong by a second's way, which is fifty of its sigmas; a depth
//! of a tenth of a second ago while it sinks by five. So each reading is carried over the samples to the keyframe by the factor
//! that the estimators have, and position, velocity and attitude come out with their correlations. The offset that the ranges
//! of an epoch share is summed out: with `D = diag(1/σ²)` they weigh `D − D11ᵀD/(σ_d⁻² + 1ᵀD1)`.

use nalgebra::{Cholesky, SVector};
use shared_types::{Config, Reading, Time};

use super::Covariance;
use crate::anchor::Anchor;
use crate::anchored::{Anchored, SensorModel};
use crate::imu_history::{ImuHistory, ImuModel};
use crate::preintegration::{Piece, Preintegration};
use crate::row::{MeasuredRows, inverse_root};
use crate::sensors::{GyroAt, Model};
use crate::state::{ERROR_DIM, NavState};
use crate::world::WorldModel;

/// A few degrees of tilt and some metres need three steps; more than this is no convergence.
const ITERATIONS: usize = 10;
/// Norm of a step, in the units of the state, that is none.
const CONVERGED: f64 = 1e-6;

/// A reading and what is the same at every linearisation.
struct Tied {
    model: Model,
    /// From the keyframe to the reading; backwards, as a rule.
    increment: Preintegration,
}

/// A keyframe and what is known around it.
pub(super) struct Adjustment<'a> {
    samples: &'a ImuHistory,
    imu: &'a ImuModel,
    config: &'a Config,
    world: &'a WorldModel,
    t_keyframe: Time,
    first: NavState,
    tied: Vec<Tied>,
}

impl<'a> Adjustment<'a> {
    /// Around `first`, the guess at the keyframe, which the samples have to reach.
    pub(super) fn around(
        first: &NavState,
        t_keyframe: Time,
        samples: &'a ImuHistory,
        (imu, config, world): (&'a ImuModel, &'a Config, &'a WorldModel),
    ) -> Adjustment<'a> {
        Adjustment { samples, imu, config, world, t_keyframe, first: *first, tied: Vec::new() }
    }

    /// Takes a reading in; whether the samples reach to it and its sensor can say anything of such a state.
    pub(super) fn take(&mut self, t: Time, reading: &Reading) -> bool {
        let gyro = || {
            let dt_imu = self.samples.sampling_period_at(t).as_seconds();
            self.samples.at(t).map(|point| GyroAt { gyro_body: point.gyro_body, dt_imu })
        };
        Model::of(reading, &self.config.vehicle, &self.first, self.world, gyro).is_ok_and(|model| self.tie(t, model))
    }

    /// The same with its model made.
    pub(super) fn tie(&mut self, t: Time, model: Model) -> bool {
        let (accel_bias, gyro_bias) = (&self.first.accel_bias, &self.first.gyro_bias);
        let increment = self.samples.integrate(self.t_keyframe, t, accel_bias, gyro_bias, self.imu);
        self.tied.extend(increment.map(|increment| Tied { model, increment }));
        increment.is_some()
    }

    /// The state and its covariance, with that of `first` before it. `None` if it does not converge.
    pub(super) fn solve(&self, covariance: &Covariance) -> Option<(NavState, Covariance)> {
        let prior = Cholesky::new(*covariance)?.inverse();
        let mut state = self.first;
        for _ in 0..ITERATIONS {
            let mut normal = prior;
            let mut gradient = prior * state.local(&self.first);
            self.add(&state, &mut normal, &mut gradient)?;
            let normal = Cholesky::new(normal)?;
            let step = -normal.solve(&gradient);
            if !step.iter().all(|x| x.is_finite()) {
                return None;
            }
            state = state.retract(&step);
            if step.norm() < CONVERGED {
                let covariance = normal.inverse();
                return Some((state, (covariance + covariance.transpose()) * 0.5));
            }
        }
        None
    }

    /// JᵀWJ and JᵀWr of all readings at `state`.
    fn add(&self, state: &NavState, normal: &mut Covariance, gradient: &mut SVector<f64, ERROR_DIM>) -> Option<()> {
        let offset_sigma = self.config.navigator.lbl_common_offset_sigma;
        // 1ᵀD1, 1ᵀDJ and 1ᵀDr of the ranges.
        let (mut weight, mut by_offset, mut shared) = (0.0, SVector::<f64, ERROR_DIM>::zeros(), 0.0);
        let from = Anchor::new(state, self.world);
        for tied in &self.tied {
            let measured = tied.rows(&from, self.world)?;
            for row in measured.as_slice() {
                *normal += row.jacobian * row.jacobian.transpose();
                *gradient += row.jacobian * row.residual;
                if matches!(tied.model, Model::Lbl(_)) {
                    weight += row.inverse_sigma * row.inverse_sigma;
                    by_offset += row.jacobian * row.inverse_sigma;
                    shared += row.residual * row.inverse_sigma;
                }
            }
        }
        if weight > 0.0 && offset_sigma > 0.0 {
            let share = 1.0 / (offset_sigma.powi(-2) + weight);
            *normal -= by_offset * by_offset.transpose() * share;
            *gradient -= by_offset * (shared * share);
        }
        Some(())
    }
}

impl Tied {
    fn rows(&self, from: &Anchor, world: &WorldModel) -> Option<MeasuredRows> {
        match &self.model {
            Model::Lbl(model) => self.whitened(model, from, world),
            Model::Gnss(model) => self.whitened(model, from, world),
            Model::Dvl(model) => self.whitened(model, from, world),
            Model::Mcp(model) => self.whitened(model, from, world),
            Model::Ps(model) => self.whitened(model, from, world),
        }
    }

    fn whitened<const ROWS: usize>(
        &self,
        model: &impl SensorModel<ROWS>,
        from: &Anchor,
        world: &WorldModel,
    ) -> Option<MeasuredRows> {
        let anchored = Anchored::new(model, from, &self.increment, world);
        let whitening = inverse_root(&anchored.inflated_covariance(&Piece::Forward(&self.increment)))?;
        MeasuredRows::whitened(&anchored, &whitening, &nalgebra::SMatrix::zeros()).ok()
    }
}
