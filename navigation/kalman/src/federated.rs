//! One local filter a sensor, fused (§6 of the method): FKF-ILNS plus.
//!
//! ```text
//! share      P_i = P/β_i,  Q_i = Q/β_i,  Σβ_i = 1            over the sensors that are switched on
//! local      predict; update with its own sensor alone
//! fuse       P⁻¹ = ΣP_i⁻¹,   δ = P ΣP_i⁻¹ (x_i ⊟ x̄),   x = x̄ ⊞ δ,   P ← G P Gᵀ           x̄: what they said together last, carried on
//! ```
//!
//! **With reset** the locals begin anew from the fused state after every instant at which one has heard its sensor. Between
//! two of them they are copies but for their shares, and predict as one. This is the centralised filter, but for gates and
//! kernels: a local sees its own wider covariance.
//!
//! **Without reset** β shares the first covariance and the noise of the motion, and then each local goes its own way: what one
//! has heard never reaches another, and a fault stays where it is. All are linearised at the fused state: a local whose sensor
//! does not tell of position drifts by kilometres, as an unaided IMU does, and models linearised out there are wrong by more
//! than the others' sigmas (a depth by the curvature of the Earth). So a local holds its estimate as an offset δ_i from
//! the common state, is a linear filter about it, and only the common state moves:
//!
//! ```text
//! x̄ ← x̄ ⊞ δ,   δ_i ← G (δ_i − δ),   P_i ← G P_i Gᵀ
//! ```

use nav_geometry::so3;
use nav_models::kernels::{Block, BlockVector, add_times_transposed, cholesky, inverse_from_cholesky};
use nav_models::recovery::Loosening;
use nav_models::state::{ATTITUDE, ERROR_DIM, NavState};
use nav_models::wide;
use shared_types::{AIDING, Config};

use crate::bank::{Bank, Stretch};
use crate::filter::{Diverged, Filter, in_new_chart};

/// A local filter for each aiding sensor.
#[derive(Clone, Copy, Debug)]
pub struct Federated {
    locals: [Filter; AIDING.len()],
    /// β; 0 for a sensor that is switched off, whose local is none.
    shares: [f64; AIDING.len()],
    is_reset: bool,
    /// What they say together.
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
        let fused = Filter::new(*state, *covariance);
        let mut bank = Federated { locals: [fused; AIDING.len()], shares, is_reset: kalman.reset, fused };
        bank.share_out();
        if !kalman.reset {
            bank.locals.iter_mut().for_each(|local| local.offset = Some(BlockVector::zeros()));
        }
        bank
    }

    fn predict(&mut self, stretch: &Stretch<'_>) -> Result<(), Diverged> {
        let NavState { accel_bias, gyro_bias, .. } = self.fused.state;
        let Stretch { from, to, history, imu, world } = *stretch;
        let increment = history.integrate(from, to, &accel_bias, &gyro_bias, imu).ok_or(Diverged)?;
        let mut carried = *self;
        carried.fused.predict(&increment, 1.0, world)?;
        if self.is_reset {
            carried.share_out();
        } else {
            for (local, &share) in carried.locals.iter_mut().zip(&self.shares) {
                if share > 0.0 {
                    local.predict(&increment, share, world)?;
                }
            }
        }
        *self = carried;
        Ok(())
    }

    fn local(&mut self, place: usize) -> &mut Filter {
        &mut self.locals[place]
    }

    fn fuse(&mut self) -> Result<(), Diverged> {
        let fused = self.together();
        if self.is_reset {
            let (delta, covariance) = fused.unwrap_or((BlockVector::zeros(), self.fused.covariance));
            let moved = self.move_to(&delta, &covariance);
            self.share_out();
            fused.and(moved)
        } else {
            let (delta, covariance) = fused?;
            self.move_to(&delta, &covariance)
        }
    }

    fn loosen(&mut self, by: &Loosening) {
        self.fused.loosen(by);
        if self.is_reset {
            self.share_out();
        } else {
            self.locals.iter_mut().for_each(|local| local.loosen(by));
        }
    }

    fn published(&self) -> Filter {
        // Carried on apart, the locals are less sure together than the fused state would be.
        match (self.is_reset, self.together()) {
            (false, Ok((delta, covariance))) => {
                let turn = so3::right_jacobian(&delta.fixed_rows::<3>(ATTITUDE).into_owned());
                Filter::new(self.fused.state.retract(&delta), in_new_chart(&covariance, &turn))
            }
            _ => self.fused,
        }
    }
}

impl Federated {
    /// Every local begins anew from the fused state.
    fn share_out(&mut self) {
        let Filter { state, covariance, .. } = self.fused;
        for (local, &share) in self.locals.iter_mut().zip(&self.shares) {
            if share > 0.0 {
                *local = Filter::new(state, covariance / share);
            }
        }
    }

    /// Puts the fused state, and the locals that are linearised at it, at a step δ from where they stand.
    fn move_to(&mut self, delta: &BlockVector<ERROR_DIM>, covariance: &Block<ERROR_DIM>) -> Result<(), Diverged> {
        let turn = so3::right_jacobian(&delta.fixed_rows::<3>(ATTITUDE).into_owned());
        let state = self.fused.state.retract(delta);
        let mut moved = *self;
        moved.fused.replace(Filter::new(state, in_new_chart(covariance, &turn)))?;
        for local in &mut moved.locals {
            if let Some(offset) = local.offset {
                let mut offset = offset - delta;
                let attitude = turn * offset.fixed_rows::<3>(ATTITUDE);
                offset.fixed_rows_mut::<3>(ATTITUDE).copy_from(&attitude);
                let covariance = in_new_chart(&local.covariance, &turn);
                local.replace(Filter { state, covariance, offset: Some(offset) })?;
            }
        }
        *self = moved;
        Ok(())
    }

    /// What the locals say together: a step from the fused state, and its covariance.
    fn together(&self) -> Result<(BlockVector<ERROR_DIM>, Block<ERROR_DIM>), Diverged> {
        let mut information = Block::<ERROR_DIM>::zeros();
        let mut right = BlockVector::<ERROR_DIM>::zeros();
        for (local, &share) in self.locals.iter().zip(&self.shares) {
            if share > 0.0 {
                let off = local.offset.unwrap_or_else(|| local.state.local(&self.fused.state));
                let own = if local.offset.is_some() {
                    local.covariance
                } else {
                    let turn = so3::right_jacobian_inverse(&off.fixed_rows::<3>(ATTITUDE).into_owned());
                    in_new_chart(&local.covariance, &turn)
                };
                let own = wide!(inverse(&own))?;
                add_times_transposed(&mut right, &own, &off, 1.0);
                information += own;
            }
        }
        let covariance = wide!(inverse(&information))?;
        let mut delta = BlockVector::<ERROR_DIM>::zeros();
        add_times_transposed(&mut delta, &covariance, &right, 1.0);
        Ok((delta, covariance))
    }
}

#[inline(always)]
fn inverse(matrix: &Block<ERROR_DIM>) -> Result<Block<ERROR_DIM>, Diverged> {
    Ok(inverse_from_cholesky(&cholesky(matrix).map_err(|_| Diverged)?))
}
