//! One local filter a sensor, fused (§6 of the method): FKF-ILNS plus.
//!
//! ```text
//! share      P_i = P/β_i,  Q_i = Q/β_i,  Σβ_i = 1            over the sensors that are switched on
//! local      predict; update with its own sensor alone
//! fuse       P⁻¹ = ΣP_i⁻¹,   δ = P ΣP_i⁻¹ (x_i ⊟ x̄),   x = x̄ ⊞ δ,   P ← G P Gᵀ
//! ```
//!
//! **With reset** the locals begin anew from the fused state after every instant at which one has heard its sensor. Between
//! two of them they are copies but for their shares, and predict as one. This is the centralised filter, but for gates and
//! kernels: a local sees its own wider covariance.
//!
//! **Without reset** β shares the first covariance and the noise of the motion, and then each local goes its own way: what one
//! has heard never reaches another, a fault stays where it is, and what is published is their sum at the keyframe. A local whose
//! sensor does not tell of position drifts as an unaided IMU does, and the fusion hears that in its covariance. x̄ is the
//! local that is surest of its position; what the others say is carried to its chart by J_r⁻¹.

use nav_geometry::so3;
use nav_models::kernels::{Block, BlockVector, add_times_transposed, cholesky, inverse_from_cholesky};
use nav_models::recovery::Loosening;
use nav_models::state::{ATTITUDE, ERROR_DIM, NavState, POSITION};
use nav_models::wide;
use shared_types::{AIDING, Config};

use crate::bank::{Bank, Stretch, predict};
use crate::filter::{Diverged, Filter, in_new_chart};

/// A local filter for each aiding sensor.
#[derive(Clone, Copy, Debug)]
pub struct Federated {
    locals: [Filter; AIDING.len()],
    /// β; 0 for a sensor that is switched off, whose local is none.
    shares: [f64; AIDING.len()],
    is_reset: bool,
    /// With reset: what the locals have begun from.
    fused: Filter,
}

impl Bank for Federated {
    fn start(config: &Config, state: &NavState, covariance: &Block<ERROR_DIM>) -> Federated {
        let kalman = &config.navigator.kalman;
        let mut shares = [0.0; AIDING.len()];
        for (place, share) in shares.iter_mut().enumerate() {
            if config.navigator.sensors[place].enabled {
                *share = kalman.shares[place];
            }
        }
        let total: f64 = shares.iter().sum();
        if total > 0.0 {
            shares.iter_mut().for_each(|share| *share /= total);
        } else {
            // Nobody is heard: one local that dead-reckons.
            shares[0] = 1.0;
        }
        let fused = Filter { state: *state, covariance: *covariance };
        let mut bank = Federated { locals: [fused; AIDING.len()], shares, is_reset: kalman.reset, fused };
        bank.share_out(&fused);
        bank
    }

    fn predict(&mut self, stretch: &Stretch<'_>) -> Result<(), Diverged> {
        if self.is_reset {
            let mut fused = self.fused;
            predict(&mut fused, stretch, 1.0)?;
            self.share_out(&fused);
            return Ok(());
        }
        let mut carried = *self;
        if carried.predict_each(stretch).is_err() {
            // One has left the numbers, as an unaided IMU may in hours: all begin anew from what they say together.
            carried = *self;
            carried.share_out(&self.published());
            carried.predict_each(stretch)?;
        }
        *self = carried;
        Ok(())
    }

    fn local(&mut self, place: usize) -> &mut Filter {
        &mut self.locals[place]
    }

    fn fuse(&mut self) -> Result<(), Diverged> {
        if self.is_reset {
            let fused = self.together(&self.fused.state);
            let begun_from = self.fused;
            self.share_out(fused.as_ref().unwrap_or(&begun_from));
            fused.map(|_| ())
        } else {
            Ok(())
        }
    }

    fn loosen(&mut self, by: &Loosening) {
        if self.is_reset {
            let mut fused = self.fused;
            fused.loosen(by);
            self.share_out(&fused);
        } else {
            self.locals.iter_mut().for_each(|local| local.loosen(by));
        }
    }

    fn published(&self) -> Filter {
        if self.is_reset {
            return self.fused;
        }
        let surest = self.surest();
        self.together(&surest.state).unwrap_or(*surest)
    }
}

impl Federated {
    fn predict_each(&mut self, stretch: &Stretch<'_>) -> Result<(), Diverged> {
        for (local, &share) in self.locals.iter_mut().zip(&self.shares) {
            if share > 0.0 {
                predict(local, stretch, share)?;
            }
        }
        Ok(())
    }

    /// Every local begins anew from `fused`.
    fn share_out(&mut self, fused: &Filter) {
        self.fused = *fused;
        for (local, &share) in self.locals.iter_mut().zip(&self.shares) {
            if share > 0.0 {
                *local = Filter { state: fused.state, covariance: fused.covariance / share };
            }
        }
    }

    /// The local that is surest of its position.
    fn surest(&self) -> &Filter {
        let variance =
            |local: &Filter| (POSITION..POSITION + 3).map(|axis| local.covariance[(axis, axis)]).sum::<f64>();
        let on = self.locals.iter().zip(&self.shares).filter(|(_, share)| **share > 0.0).map(|(local, _)| local);
        on.min_by(|a, b| variance(a).total_cmp(&variance(b))).unwrap_or(&self.fused)
    }

    /// What the locals say together, in the chart at `reference`.
    fn together(&self, reference: &NavState) -> Result<Filter, Diverged> {
        let mut information = Block::<ERROR_DIM>::zeros();
        let mut right = BlockVector::<ERROR_DIM>::zeros();
        for (local, &share) in self.locals.iter().zip(&self.shares) {
            if share > 0.0 {
                let off = local.state.local(reference);
                let turn = so3::right_jacobian_inverse(&off.fixed_rows::<3>(ATTITUDE).into_owned());
                let own = wide(|| inverse(&in_new_chart(&local.covariance, &turn)))?;
                add_times_transposed(&mut right, &own, &off, 1.0);
                information += own;
            }
        }
        let covariance = wide(|| inverse(&information))?;
        let mut delta = BlockVector::<ERROR_DIM>::zeros();
        add_times_transposed(&mut delta, &covariance, &right, 1.0);
        let turn = so3::right_jacobian(&delta.fixed_rows::<3>(ATTITUDE).into_owned());
        let mut fused = self.fused;
        fused.replace(reference.retract(&delta), in_new_chart(&covariance, &turn))?;
        Ok(fused)
    }
}

#[inline(always)]
fn inverse(matrix: &Block<ERROR_DIM>) -> Result<Block<ERROR_DIM>, Diverged> {
    Ok(inverse_from_cholesky(&cholesky(matrix).map_err(|_| Diverged)?))
}
