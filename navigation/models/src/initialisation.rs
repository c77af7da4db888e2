//! The first state and its covariance, from the configuration where it says and from the data otherwise (§5 of the method).
//!
//! | part | still | moving |
//! |---|---|---|
//! | tilt | mean specific force over ≥ 2 s | the same, turned along by the gyroscope, less the acceleration that the DVL saw |
//! | heading | MCP | MCP, else the GNSS track (10°) |
//! | velocity | DVL, else 0 within what the GNSS track excludes | DVL, else the track, else the last one known, else 0 with the sigma of a vehicle under way |
//! | position | GNSS and depth, else ranges and depth, else the last one known and depth | the same |
//! | gyroscope bias | mean rate − Rᵀω | 0 |
//!
//! What a table's cell names is a guess. Readings are older than the keyframe, and the vehicle has moved on meanwhile: the
//! adjustment carries them there over the samples, and finds state and covariance together. An IMU alone cannot tell rest
//! from a smooth ride: what is called still has a velocity of 0 ± 1.5 m/s unless DVL or GNSS say more.
//!
//! `initial.*` of the configuration holds at `initial.t` (or at the first IMU sample) and is carried to the keyframe over the
//! samples between; where the samples begin later than that it is left aside. `sigma_attitude` is about body x, body y and the up axis: `P_θ = A diag(σ²)Aᵀ`, `A = [e₁ e₂ Rᵀẑ]`.
//! Levelled by the accelerometer, tilt and accelerometer bias share an error: `δθ = [ẑ_b]× b_a/g`, and the covariance says so.

mod adjustment;
mod attitude;
mod last_known;
mod position;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use nalgebra::{Matrix3, Quaternion, SMatrix, UnitQuaternion, Vector3};
use nav_geometry::so3;
use shared_types::{Config, Duration, Measurement, Reading, Time};

use adjustment::Adjustment;
use last_known::Aged;
pub use last_known::LastKnown;

use crate::imu_history::{ImuHistory, ImuModel};
use crate::preintegration::ImuPoint;
use crate::state::{ACCEL_BIAS, ATTITUDE, ERROR_DIM, GYRO_BIAS, NavState, POSITION, VELOCITY};
use crate::transport::{transport, transport_jacobians};
use crate::world::WorldModel;

/// IMU samples are kept for so long, and at first there is room for so many: 20 s at 200 Hz.
const SAMPLES_KEPT_FOR: Duration = Duration(20_000_000_000);
const SAMPLES_KEPT: usize = 4096;
/// Readings of slower sensors kept.
const READINGS_KEPT: usize = 64;
/// A reading older than this does not speak of the keyframe.
const READING_AGE_MAX: Duration = Duration(1_500_000_000);
/// 1-sigma of the velocity of a vehicle at rest, m/s.
const STILL_VELOCITY_SIGMA: f64 = 0.02;
/// 1-sigma of the velocity of a vehicle of which no sensor speaks, m/s.
const UNKNOWN_VELOCITY_SIGMA: f64 = 1.5;
/// The same before the DVL has spoken, m/s: it takes nothing from what that says.
const UNSAID_VELOCITY_SIGMA: f64 = 100.0;

/// Readings of one sensor in the order of their coming, each with the time at which it was valid.
type Readings<T> = VecDeque<(Time, T)>;

/// What the aiding sensors said, newest last.
#[derive(Clone, Debug, Default)]
struct Heard {
    /// Antenna and sigmas.
    gnss: Readings<(Vector3<f64>, Vector3<f64>)>,
    dvl: Readings<Vector3<f64>>,
    mcp: Readings<f64>,
    ps: Readings<f64>,
    ranges: position::Ranges,
}

/// Gathers measurements until a first state can be told. See the module.
#[derive(Clone, Debug)]
pub struct Initialiser {
    config: Config,
    imu: ImuModel,
    samples: ImuHistory,
    t_first_sample: Option<Time>,
    heard: Heard,
    last_known: Option<LastKnown>,
}

/// A covariance of the whole error state.
type Covariance = SMatrix<f64, ERROR_DIM, ERROR_DIM>;

fn keep<T>(readings: &mut VecDeque<T>, reading: T) {
    if readings.len() == READINGS_KEPT {
        readings.pop_front();
    }
    readings.push_back(reading);
}

/// The newest reading at a keyframe or shortly before it: what comes after it is the estimator's to use.
fn newest_at<T>(readings: &Readings<T>, t_keyframe: Time) -> Option<&(Time, T)> {
    let is_near = |t: Time| t <= t_keyframe && t_keyframe - t <= READING_AGE_MAX;
    readings.iter().filter(|(t, _)| is_near(*t)).max_by_key(|(t, _)| *t)
}

impl Initialiser {
    /// With the facts of the vehicle and `initial.*` of `config`.
    pub fn new(config: &Config) -> Initialiser {
        Initialiser {
            config: config.clone(),
            imu: ImuModel { noise: config.vehicle.imu.clone(), gate: config.navigator.imu },
            samples: ImuHistory::with_capacity(SAMPLES_KEPT),
            t_first_sample: None,
            heard: Heard::default(),
            last_known: None,
        }
    }

    /// Where the vehicle was before all that will be heard: it stands in where nothing else tells the place. The beginning that the
    /// configuration gives is past by then.
    pub fn remember(&mut self, last: &LastKnown) {
        self.last_known = Some(*last);
        self.config.vehicle.initial.forget_state();
        self.config.vehicle.initial.t = None;
    }

    /// Whether there is a place of before.
    pub fn remembers(&self) -> bool {
        self.last_known.is_some()
    }

    /// Where it may be now by what is known of before, if that tells anything yet.
    fn aged(&self, t_keyframe: Time, world: &WorldModel) -> Option<Aged> {
        let aged = self.last_known?.at(t_keyframe, &world.frame);
        let tells = aged.position_cov.diagonal().max() <= position::WORST_SIGMA.powi(2);
        tells.then_some(aged)
    }

    /// Takes a measurement as it comes; malformed ones and those of sensors that are switched off are left out.
    pub fn push(&mut self, measurement: &Measurement) {
        let Ok(reading) = Reading::try_from(measurement) else { return };
        if measurement.sensor().is_some_and(|sensor| !self.config.navigator.is_enabled(sensor)) {
            return;
        }
        let t = measurement.t_valid();
        match reading {
            Reading::Imu { gyro_body, accel_body } => {
                let point = ImuPoint { gyro_body: Vector3::from(gyro_body), accel_body: Vector3::from(accel_body) };
                if !self.samples.push(t, point) {
                    return;
                }
                self.samples.forget_before(t - SAMPLES_KEPT_FOR);
                if self.t_first_sample.is_none() {
                    self.t_first_sample = Some(t);
                    self.forget_what_is_past(t);
                }
            }
            Reading::Gnss { antenna_enu, sigma_enu } => {
                keep(&mut self.heard.gnss, (t, (Vector3::from(antenna_enu), Vector3::from(sigma_enu))));
            }
            Reading::Dvl { velocity_dvl } => keep(&mut self.heard.dvl, (t, Vector3::from(velocity_dvl))),
            Reading::Mcp { heading } => keep(&mut self.heard.mcp, (t, heading)),
            Reading::Ps { depth } => keep(&mut self.heard.ps, (t, depth)),
            Reading::Lbl { buoy, epoch, range, buoy_enu, buoy_sigma, .. } => {
                let buoy_enu = Vector3::from(buoy_enu);
                self.heard.ranges.hear(position::Range { t, buoy, epoch, range, buoy_enu, buoy_sigma });
            }
            Reading::Keyframe { .. } => {}
        }
    }

    /// A given state holds at its own time. Where the samples begin well after it, as after a restart under way, nothing
    /// carries it to a keyframe, and the vehicle is somewhere else by now.
    fn forget_what_is_past(&mut self, first_sample: Time) {
        let initial = &mut self.config.vehicle.initial;
        if initial.t.is_some_and(|t| first_sample - t > READING_AGE_MAX) {
            initial.forget_state();
        }
    }

    /// The first state and its 15 × 15 covariance at a keyframe; `None` while something is missing, or before `initial.t`.
    pub fn first_state(&self, t_keyframe: Time, world: &WorldModel) -> Option<(NavState, Covariance)> {
        let initial = &self.config.vehicle.initial;
        if initial.t.is_some_and(|t| t_keyframe < t) {
            return None;
        }
        if let (Some(position), Some(velocity), Some(q)) =
            (initial.position_enu, initial.velocity_enu, initial.q_enu_body)
        {
            let state = NavState {
                position_enu: Vector3::from(position),
                velocity_enu: Vector3::from(velocity),
                q_enu_body: quaternion(q),
                accel_bias: Vector3::zeros(),
                gyro_bias: Vector3::zeros(),
            };
            let t_given = initial.t.or(self.t_first_sample)?;
            return self.carried(t_given, t_keyframe, &state, &self.prior_covariance(&state), world);
        }
        self.measured_state(t_keyframe, world)
    }

    fn measured_state(&self, t_keyframe: Time, world: &WorldModel) -> Option<(NavState, Covariance)> {
        let vehicle = &self.config.vehicle;
        let samples = self.samples_to(t_keyframe)?;
        let motion = self.motion_at(t_keyframe)?;
        let attitude = self.attitude_at(t_keyframe, &motion, &samples, world)?;
        let r_enu_body = attitude.q_enu_body.to_rotation_matrix().into_inner();
        let velocity = self.velocity_at(t_keyframe, &motion, &attitude, world);
        let place = self.position_at(t_keyframe, &r_enu_body, &velocity, world)?;
        // A mean rate that no turn-on bias explains is a turn, and tells nothing of the bias.
        let rest_rate = motion.mean_gyro - r_enu_body.tr_mul(&world.earth_rate_enu);
        let is_bias = motion.is_still && rest_rate.amax() < 4.0 * vehicle.imu.gyro_bias_sigma;
        let guess = NavState {
            position_enu: place.position_enu,
            velocity_enu: velocity.velocity_enu,
            q_enu_body: attitude.q_enu_body,
            accel_bias: Vector3::zeros(),
            gyro_bias: if is_bias && vehicle.initial.q_enu_body.is_none() { rest_rate } else { Vector3::zeros() },
        };
        let mut covariance = self.prior_covariance(&guess);
        covariance.fixed_view_mut::<3, 3>(POSITION, POSITION).copy_from(&place.covariance);
        covariance.fixed_view_mut::<3, 3>(VELOCITY, VELOCITY).copy_from(&velocity.covariance);
        let attitude_cov = attitude_covariance(&r_enu_body, &attitude.sigma);
        covariance.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE).copy_from(&attitude_cov);
        if attitude.is_levelled {
            self.add_levelling(&r_enu_body, &attitude.sigma, &mut covariance);
        }
        let around = (&self.imu, &self.config, world);
        let mut adjustment = Adjustment::around(&guess, t_keyframe, &samples, around);
        // One that the samples do not reach is left out; whether enough is left, the covariance says.
        for (t, reading) in place.readings.iter().chain(&velocity.readings) {
            adjustment.take(*t, reading);
        }
        let (state, covariance) = adjustment.solve(&covariance)?;
        let is_placed = (0..3).all(|axis| covariance[(axis, axis)] <= position::WORST_SIGMA.powi(2));
        ((is_placed || place.readings.is_empty()) && state.is_finite()).then_some((state, covariance))
    }

    /// The samples, the newest of them held to the keyframe where they end before it.
    fn samples_to(&self, t_keyframe: Time) -> Option<ImuHistory> {
        let mut samples = self.samples.clone();
        let newest = samples.newest()?;
        if newest < t_keyframe {
            samples.push(t_keyframe, samples.at(newest)?);
        }
        Some(samples)
    }

    /// diag of the configured sigmas, attitude by its three axes.
    fn prior_covariance(&self, state: &NavState) -> Covariance {
        let (initial, imu) = (&self.config.vehicle.initial, &self.config.vehicle.imu);
        let mut covariance = Covariance::zeros();
        for (at, sigma) in [
            (POSITION, initial.sigma_position),
            (VELOCITY, initial.sigma_velocity),
            (ACCEL_BIAS, imu.accel_bias_sigma),
            (GYRO_BIAS, imu.gyro_bias_sigma),
        ] {
            covariance.fixed_view_mut::<3, 3>(at, at).copy_from(&(Matrix3::identity() * (sigma * sigma)));
        }
        let attitude = attitude_covariance(&state.r_enu_body(), &initial.sigma_attitude);
        covariance.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE).copy_from(&attitude);
        covariance
    }

    /// Tilt levelled by the accelerometer: the part of its error that is the bias, with its correlation.
    fn add_levelling(&self, r_enu_body: &Matrix3<f64>, sigma: &[f64; 3], covariance: &mut Covariance) {
        const GRAVITY: f64 = 9.81;
        // What remains of a tilt sigma once the bias is taken out; never nothing.
        const LEAST_TILT_SIGMA: f64 = 1e-4;
        let bias_variance = self.config.vehicle.imu.accel_bias_sigma.powi(2);
        let by_bias = so3::skew(&r_enu_body.row(2).transpose()) / GRAVITY;
        let from_bias = bias_variance / (GRAVITY * GRAVITY);
        let own = |sigma: f64| (sigma * sigma - from_bias).max(LEAST_TILT_SIGMA * LEAST_TILT_SIGMA).sqrt();
        let attitude = attitude_covariance(r_enu_body, &[own(sigma[0]), own(sigma[1]), sigma[2]])
            + by_bias * by_bias.transpose() * bias_variance;
        let cross = by_bias * bias_variance;
        covariance.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE).copy_from(&attitude);
        covariance.fixed_view_mut::<3, 3>(ATTITUDE, ACCEL_BIAS).copy_from(&cross);
        covariance.fixed_view_mut::<3, 3>(ACCEL_BIAS, ATTITUDE).copy_from(&cross.transpose());
    }

    /// A state given at `t_given`, at the keyframe.
    fn carried(
        &self,
        t_given: Time,
        t_keyframe: Time,
        state: &NavState,
        covariance: &Covariance,
        world: &WorldModel,
    ) -> Option<(NavState, Covariance)> {
        if t_keyframe <= t_given {
            return Some((*state, *covariance));
        }
        let mut samples = self.samples.clone();
        samples.hold_back_to(t_given);
        let increment = samples.integrate(t_given, t_keyframe, &state.accel_bias, &state.gyro_bias, &self.imu)?;
        let jacobians = transport_jacobians(state, &increment, world);
        let mut by_state = Covariance::identity();
        by_state.fixed_view_mut::<9, ERROR_DIM>(0, 0).copy_from(&jacobians.state);
        let mut by_increment = Covariance::identity();
        by_increment.fixed_view_mut::<9, 9>(0, 0).copy_from(&jacobians.increment);
        let carried = by_state * covariance * by_state.transpose()
            + by_increment * increment.covariance() * by_increment.transpose();
        Some((transport(state, &increment, world), (carried + carried.transpose()) * 0.5))
    }
}

fn quaternion([w, x, y, z]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
}

/// A diag(σ²) Aᵀ, `A = [e₁ e₂ Rᵀẑ]`: sigmas about body x, body y and the up axis.
fn attitude_covariance(r_enu_body: &Matrix3<f64>, sigma: &[f64; 3]) -> Matrix3<f64> {
    let axes = Matrix3::from_columns(&[Vector3::x(), Vector3::y(), r_enu_body.row(2).transpose()]);
    axes * Matrix3::from_diagonal(&Vector3::from(sigma.map(|s| s * s))) * axes.transpose()
}
