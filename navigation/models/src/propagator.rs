//! The published estimate: the newest solution, carried over the IMU samples since its keyframe.
//!
//! ```text
//! x(t) = transport(x_k, preintegration(t_k → t)),     P(t) = T_j C_k T_jᵀ + L P L ᵀ
//! ```
//!
//! **The estimate at a sample depends on the solution and on the samples around and since its keyframe alone**, bit for bit,
//! whenever the solution arrived: a rebase runs again over the kept samples, from an interpolated start at the keyframe and
//! at the solution's biases, with the code that runs from sample to sample. So a live run can be repeated exactly from what
//! was recorded. A solution whose keyframe lies ahead of the samples waits for them.
//!
//! | mode | when (the worst that applies) |
//! |---|---|
//! | INITIALISING | no solution yet |
//! | OK | none of the below |
//! | DEGRADED | the solution is not converged or was damped, or is older than `solution_timeout`; DVL, MCP or PS was used and is missing for `aiding_timeout`; an IMU gap lies between keyframe and now |
//! | DEAD_RECKONING | neither LBL nor GNSS used within `position_timeout` |
//! | INVALID | horizontal sigma beyond `max_position_sigma`, no IMU data ([`Propagator::without_imu`]), none for more than 5 s since the keyframe, or several sensors contradict the inertial ones |
//!
//! LBL and GNSS stand in for each other: a vehicle that dives loses GNSS and one that surfaces leaves the net, and neither is
//! degraded by it. All ages are data time.

mod mode;
#[cfg(test)]
mod tests;
mod uncertainty;

use std::collections::VecDeque;

use nalgebra::{Matrix3, SMatrix, Vector3};
use nav_geometry::Geodetic;
use shared_types::{Config, Header, ImuSample, Mode, NavEstimate, Solution, SolutionStatus, Time};

use crate::anchor::Anchor;
use crate::gaps::{BLIND, Inflation, UNSEEN_ACCELERATION, UNSEEN_RATE};
use crate::preintegration::{ImuPoint, Preintegration};
use crate::state::{ERROR_DIM, NavState};
use crate::transport::transport_from;
use crate::world::WorldModel;
use uncertainty::{Uncertainty, upper_triangle};

/// IMU samples kept for a rebase: 20 s at 200 Hz.
const SAMPLES_KEPT: usize = 4096;
/// 1-sigma of what is not known at all before the first solution: m/s, rad.
const UNKNOWN_VELOCITY_SIGMA: f64 = 100.0;
const UNKNOWN_ATTITUDE_SIGMA: f64 = core::f64::consts::PI;

/// What the propagator cannot use. It goes on as if it had not been given.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PropagatorError {
    /// An IMU sample with a value that is no number.
    #[error("IMU sample at {t} s holds a value that is not finite")]
    NotFinite {
        /// Of the sample.
        t: Time,
    },
    /// An IMU sample before its predecessor.
    #[error("IMU sample at {t} s comes after the one at {last} s")]
    BackwardsTime {
        /// Of the last sample.
        last: Time,
        /// Of this one.
        t: Time,
    },
    /// A solution with a value that is no number, or an attitude that is no unit quaternion.
    #[error("solution {id} holds a value that is not finite or a quaternion that is not a unit one")]
    UnusableSolution {
        /// Of the solution.
        id: u64,
    },
    /// The samples since its keyframe are no longer kept.
    #[error("solution {id} with its keyframe at {t_keyframe} s is older than the IMU samples kept, from {oldest} s on")]
    SolutionTooOld {
        /// Of the solution.
        id: u64,
        /// Of its keyframe.
        t_keyframe: Time,
        /// Oldest sample kept.
        oldest: Time,
    },
}

#[derive(Clone, Copy, Debug)]
struct TimedPoint {
    t: Time,
    point: ImuPoint,
}

/// The solution that the estimate stands on.
#[derive(Clone, Debug)]
struct Base {
    solution: u64,
    t_keyframe: Time,
    anchor: Anchor,
    covariance: SMatrix<f64, ERROR_DIM, ERROR_DIM>,
    world: WorldModel,
    t_last_used: [i64; 5],
    is_converged: bool,
    is_inconsistent: bool,
}

/// Carries the newest solution to every IMU sample. See the module.
#[derive(Clone, Debug)]
pub struct Propagator {
    config: Config,
    samples: VecDeque<TimedPoint>,
    base: Option<Base>,
    /// Solution whose keyframe no sample has reached yet.
    waiting: Option<Base>,
    increment: Preintegration,
    has_bridged_gap: bool,
    /// Between keyframe and now lies a gap that nothing bridges.
    is_blind: bool,
    last: NavEstimate,
}

impl Propagator {
    /// With the IMU's noise, gaps, limits and the world of `config`.
    pub fn new(config: &Config) -> Propagator {
        let origin = config.vehicle.frame.origin_geodetic;
        Propagator {
            config: config.clone(),
            samples: VecDeque::with_capacity(SAMPLES_KEPT),
            base: None,
            waiting: None,
            increment: Preintegration::new(Vector3::zeros(), Vector3::zeros()),
            has_bridged_gap: false,
            is_blind: false,
            last: nothing_known(origin, config.navigator.propagator.max_position_sigma),
        }
    }

    /// Takes a solution; estimates stand on it from the next sample on (or from the first one after its keyframe).
    ///
    /// # Errors
    /// [`PropagatorError::UnusableSolution`] or [`PropagatorError::SolutionTooOld`]; the last solution then stays in use.
    pub fn rebase(&mut self, solution: &Solution) -> Result<(), PropagatorError> {
        let unusable = PropagatorError::UnusableSolution { id: solution.id };
        let (state, covariance) = NavState::from_solution(solution).ok_or(unusable)?;
        let [lat_deg, lon_deg, height] = solution.origin;
        if !solution.origin.iter().all(|x| x.is_finite()) {
            return Err(unusable);
        }
        let t_keyframe = Time(solution.t_keyframe);
        if let Some(oldest) = self.samples.front()
            && oldest.t - t_keyframe > BLIND
        {
            return Err(PropagatorError::SolutionTooOld { id: solution.id, t_keyframe, oldest: oldest.t });
        }
        let world = WorldModel::new(Geodetic::from_degrees(lat_deg, lon_deg, height), &self.config);
        let base = Base {
            solution: solution.id,
            t_keyframe,
            anchor: Anchor::new(&state, &world),
            covariance,
            world,
            t_last_used: solution.t_last_used,
            is_converged: SolutionStatus::from_index(solution.status) == Some(SolutionStatus::Converged),
            is_inconsistent: SolutionStatus::from_index(solution.status) == Some(SolutionStatus::Inconsistent),
        };
        if self.samples.back().is_some_and(|newest| newest.t >= t_keyframe) {
            self.stand_on(base);
            self.waiting = None;
        } else {
            self.waiting = Some(base);
        }
        Ok(())
    }

    /// Takes one IMU sample and says where the vehicle is at its time. `None` for a repetition of the last sample's time.
    ///
    /// # Errors
    /// [`PropagatorError::NotFinite`] or [`PropagatorError::BackwardsTime`]; the sample is left out.
    pub fn advance(&mut self, sample: &ImuSample) -> Result<Option<NavEstimate>, PropagatorError> {
        let t = Time(sample.header.t_valid);
        if !sample.gyro_body.iter().chain(&sample.accel_body).all(|x| x.is_finite()) {
            return Err(PropagatorError::NotFinite { t });
        }
        let previous = self.samples.back().copied();
        if let Some(previous) = previous {
            if t == previous.t {
                return Ok(None);
            }
            if t < previous.t {
                return Err(PropagatorError::BackwardsTime { last: previous.t, t });
            }
        }
        let next = TimedPoint {
            t,
            point: ImuPoint {
                gyro_body: Vector3::from(sample.gyro_body),
                accel_body: Vector3::from(sample.accel_body),
            },
        };
        if self.samples.len() == SAMPLES_KEPT {
            self.samples.pop_front();
        }
        self.samples.push_back(next);

        if self.waiting.as_ref().is_some_and(|base| base.t_keyframe <= t) {
            if let Some(base) = self.waiting.take() {
                self.stand_on(base);
            }
        } else {
            self.absorb(previous, &next);
        }
        let header = Header {
            origin_sequence: sample.header.sequence,
            origin_t_arrival: sample.header.t_arrival,
            ..Header::at(t)
        };
        if self.is_blind {
            let mut held = self.without_imu(t);
            held.header = header;
            return Ok(Some(held));
        }
        self.last = self.estimate(&self.increment, header);
        Ok(Some(self.last))
    }

    /// Goes through the motions of [`Propagator::advance`] as if the last sample were heard again `dt_s` later, and changes nothing:
    /// instructions and numbers are then near when the next one comes.
    pub fn rehearse(&self, dt_s: f64) -> Option<NavEstimate> {
        let TimedPoint { t, point } = *self.samples.back()?;
        self.base.as_ref()?;
        let mut increment = self.increment;
        increment.step(&self.config.vehicle.imu, dt_s, &point, &point, Inflation::NONE);
        Some(self.estimate(&increment, Header::at(t + shared_types::Duration::from_seconds(dt_s))))
    }

    /// The last estimate held to `now` (data time, from the caller's clock), with the sigmas of a vehicle that nobody sees;
    /// INVALID, or INITIALISING before the first solution.
    pub fn without_imu(&self, now: Time) -> NavEstimate {
        let mut held = self.last;
        let dt = (now - Time(held.header.t_valid)).as_seconds().max(0.0);
        held.header = Header::at(now);
        if self.base.is_none() {
            return held;
        }
        // Held in place: an error of the whole way that it may have gone meanwhile.
        let speed_squared: f64 = held.velocity_enu.iter().map(|v| v * v).sum();
        for axis in [0, 3, 5] {
            let velocity_growth = (UNSEEN_ACCELERATION * dt).powi(2);
            let velocity = held.velocity_cov[axis] + velocity_growth;
            held.position_cov[axis] += (speed_squared + velocity) * dt * dt;
            held.velocity_cov[axis] = velocity;
            held.attitude_cov[axis] += (UNSEEN_RATE * dt).powi(2);
        }
        for sigma in &mut held.sigma_rpy {
            *sigma = (*sigma * *sigma + (UNSEEN_RATE * dt).powi(2)).sqrt();
        }
        for age in &mut held.aiding_age {
            *age += dt;
        }
        held.mode = Mode::Invalid as u32;
        held
    }

    /// Starts anew from `base` over the samples kept.
    fn stand_on(&mut self, base: Base) {
        self.increment = Preintegration::new(base.anchor.state.accel_bias, base.anchor.state.gyro_bias);
        self.has_bridged_gap = false;
        self.is_blind = false;
        let t_keyframe = base.t_keyframe;
        self.base = Some(base);
        // The first sample after the keyframe; its predecessor gives the interpolated start.
        let start = self.samples.partition_point(|sample| sample.t <= t_keyframe);
        for index in start..self.samples.len() {
            let previous = index.checked_sub(1).map(|before| self.samples[before]);
            let next = self.samples[index];
            self.absorb(previous, &next);
        }
    }

    /// Adds the stretch from `previous` to `next`, or the part of it after the keyframe.
    fn absorb(&mut self, previous: Option<TimedPoint>, next: &TimedPoint) {
        let Some(base) = &self.base else { return };
        let t_keyframe = base.t_keyframe;
        if next.t <= t_keyframe {
            return;
        }
        let (first, t_first, spacing) = match previous {
            Some(previous) if previous.t >= t_keyframe => (previous.point, previous.t, next.t - previous.t),
            Some(previous) => {
                let spacing = next.t - previous.t;
                let fraction = (t_keyframe - previous.t).as_seconds() / spacing.as_seconds();
                (ImuPoint::interpolate(&previous.point, &next.point, fraction), t_keyframe, spacing)
            }
            // Started after the keyframe: the first sample is held back to it.
            None => (next.point, t_keyframe, next.t - t_keyframe),
        };
        let gaps = &self.config.navigator.imu;
        let noise = &self.config.vehicle.imu;
        let inflation = match previous {
            Some(_) => Inflation::over(spacing, gaps, noise),
            None => Inflation::held(spacing, gaps, noise),
        };
        self.has_bridged_gap |= spacing > gaps.gap;
        self.is_blind |= spacing > BLIND;
        let dt = (next.t - t_first).as_seconds();
        self.increment.step(noise, dt, &first, &next.point, inflation);
    }

    fn estimate(&self, increment: &Preintegration, header: Header) -> NavEstimate {
        let Some(base) = &self.base else {
            return NavEstimate { header, ..self.last };
        };
        let t = Time(header.t_valid);
        let state = transport_from(&base.anchor, increment, &base.world);
        let r_enu_body = &base.anchor.r_enu_body;
        let uncertainty = Uncertainty::carried(&base.covariance, r_enu_body, increment, &base.world);
        let mode = self.mode_at(t, base, &uncertainty);
        NavEstimate {
            header,
            solution: base.solution,
            t_keyframe: base.t_keyframe.0,
            position_enu: state.position_enu.into(),
            velocity_enu: state.velocity_enu.into(),
            q_enu_body: state.quaternion_wxyz(),
            accel_bias: state.accel_bias.into(),
            gyro_bias: state.gyro_bias.into(),
            position_cov: upper_triangle(&uncertainty.position),
            velocity_cov: upper_triangle(&uncertainty.velocity),
            attitude_cov: upper_triangle(&uncertainty.attitude),
            sigma_rpy: uncertainty.sigma_rpy(&state.r_enu_body()),
            lat_lon_h: base.world.frame.to_geodetic(&state.position_enu).to_degrees(),
            aiding_age: base.aiding_age(t),
            mode: mode as u32,
            reserved: 0,
        }
    }
}

/// What is said before the first solution: nothing, with sigmas that say so.
fn nothing_known(origin_geodetic: Option<[f64; 3]>, position_sigma: f64) -> NavEstimate {
    let diagonal = |sigma: f64| upper_triangle(&(Matrix3::identity() * (sigma * sigma)));
    let [latitude, longitude, height] = origin_geodetic.unwrap_or([0.0; 3]);
    NavEstimate {
        header: Header::default(),
        solution: 0,
        t_keyframe: i64::MIN,
        position_enu: [0.0; 3],
        velocity_enu: [0.0; 3],
        q_enu_body: [1.0, 0.0, 0.0, 0.0],
        accel_bias: [0.0; 3],
        gyro_bias: [0.0; 3],
        position_cov: diagonal(position_sigma),
        velocity_cov: diagonal(UNKNOWN_VELOCITY_SIGMA),
        attitude_cov: diagonal(UNKNOWN_ATTITUDE_SIGMA),
        sigma_rpy: [UNKNOWN_ATTITUDE_SIGMA; 3],
        lat_lon_h: Geodetic::new(latitude, longitude, height).to_degrees(),
        aiding_age: [f64::INFINITY; 5],
        mode: Mode::Initialising as u32,
        reserved: 0,
    }
}
