//! Motion, tilt, heading and velocity at the start.
//!
//! ```text
//! roll = atan2(f_y, f_z),  pitch = atan2(−f_x, √(f_y² + f_z²)),  yaw = 90° − heading           (FLU, ZYX)
//! moving: f is the mean (β₁ − β₀)/(t₁ − t₀) in the axes of the body at the keyframe, less that of du/dt:
//!         (γ₁u₁ − γ₀u₀)/(t₁ − t₀),  u the velocity that the DVL saw, α, β, γ from the keyframe back
//! ```
//!
//! A vehicle that rolls in the swell is not tilted by the mean of what its accelerometer said in the meantime, nor heads where
//! its compass pointed half a turn of a second ago: both are turned along with the gyroscope.

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use shared_types::{Duration, Reading, Time};

use super::{
    Initialiser, READING_AGE_MAX, STILL_VELOCITY_SIGMA, UNKNOWN_VELOCITY_SIGMA, UNSAID_VELOCITY_SIGMA, newest_at,
    quaternion,
};
use crate::imu_history::ImuHistory;
use crate::preintegration::Preintegration;
use crate::world::WorldModel;

/// Shortest stretch of samples that is averaged, and the longest.
const MEAN_OVER_AT_LEAST: Duration = Duration(2_000_000_000);
const MEAN_OVER_AT_MOST: Duration = Duration(10_000_000_000);
/// Samples may come this late and the stretch still counts as whole.
const SLACK: Duration = Duration(50_000_000);
/// A still vehicle: standard deviation of the rates below this, rad/s, and of the forces, m/s².
const STILL_GYRO_DEVIATION: f64 = 0.02;
const STILL_ACCEL_DEVIATION: f64 = 0.2;
/// No faster than this, m/s, by DVL or GNSS.
const STILL_SPEED: f64 = 0.1;
/// 1-sigma of tilt found under way, and of a heading found from the track, rad.
const MOVING_TILT_SIGMA: f64 = 0.0524;
const TRACK_HEADING_SIGMA: f64 = 0.175;
/// A track over more than this is no velocity.
const TRACK_OVER_AT_MOST: Duration = Duration(10_000_000_000);
/// A track shorter than this many of its own sigmas has no direction.
const TRACK_SIGMAS: f64 = 5.0;

/// What the IMU says of the stretch before the keyframe.
pub(super) struct Motion {
    pub(super) is_still: bool,
    pub(super) mean_gyro: Vector3<f64>,
    mean_accel: Vector3<f64>,
    t_from: Time,
}

/// First attitude.
pub(super) struct Attitude {
    pub(super) q_enu_body: UnitQuaternion<f64>,
    /// About body x, body y and up, rad.
    pub(super) sigma: [f64; 3],
    /// Whether tilt came from the accelerometer.
    pub(super) is_levelled: bool,
}

/// A way that is not straight is longer than its chord, by no more than this share of it.
const TURNED: f64 = 0.3;

/// First velocity, and the readings that say more of it.
pub(super) struct Velocity {
    pub(super) velocity_enu: Vector3<f64>,
    /// What is known without `readings`.
    pub(super) covariance: Matrix3<f64>,
    pub(super) readings: Vec<(Time, Reading)>,
}

/// Velocity of the antenna, m/s, over the stretch between two fixes.
struct Track {
    velocity_enu: Vector3<f64>,
    /// Of a horizontal axis, m/s.
    sigma: f64,
    t_middle: Time,
}

/// Mean and largest standard deviation of an axis.
fn mean_and_deviation<I: Iterator<Item = Vector3<f64>>>(vectors: impl Fn() -> I) -> (Vector3<f64>, f64) {
    let count = vectors().count() as f64;
    let mean = vectors().sum::<Vector3<f64>>() / count;
    let variance = vectors().map(|v| (v - mean).component_mul(&(v - mean))).sum::<Vector3<f64>>() / count;
    (mean, variance.max().sqrt())
}

impl Initialiser {
    /// The longest still stretch up to the keyframe (10 s, else 2 s), else the last 2 s as moving; `None` before there are 2 s.
    pub(super) fn motion_at(&self, t_keyframe: Time) -> Option<Motion> {
        let t_oldest = self.samples.oldest()?;
        let newest = self.samples.newest()?.min(t_keyframe);
        if t_keyframe - newest > READING_AGE_MAX || newest + SLACK - t_oldest < MEAN_OVER_AT_LEAST {
            return None;
        }
        let mut moving = None;
        for span in [MEAN_OVER_AT_MOST, MEAN_OVER_AT_LEAST] {
            let t_from = t_keyframe - span;
            // Both ends too.
            let stretch = || self.samples.between(t_from - Duration(1), t_keyframe + Duration(1));
            let (mean_gyro, gyro_deviation) = mean_and_deviation(|| stretch().map(|sample| sample.point.gyro_body));
            let (mean_accel, accel_deviation) = mean_and_deviation(|| stretch().map(|sample| sample.point.accel_body));
            let is_still = gyro_deviation < STILL_GYRO_DEVIATION
                && accel_deviation < STILL_ACCEL_DEVIATION
                && !self.is_seen_moving(t_from, t_keyframe);
            let motion = Motion { is_still, mean_gyro, mean_accel, t_from };
            if is_still {
                return Some(motion);
            }
            moving = Some(motion);
        }
        moving
    }

    /// Whether DVL or GNSS saw it move; a smooth ride looks still to an IMU.
    fn is_seen_moving(&self, t_from: Time, t_to: Time) -> bool {
        let by_dvl = self
            .heard
            .dvl
            .iter()
            .filter(|(t, _)| *t >= t_from && *t <= t_to)
            .any(|(_, velocity)| velocity.norm() > STILL_SPEED + 3.0 * self.config.vehicle.dvl.sigma);
        let is_way = |track: Track| track.velocity_enu.norm() > STILL_SPEED + TRACK_SIGMAS * track.sigma;
        by_dvl || self.track(t_to).is_some_and(is_way)
    }

    /// Horizontal track between the newest fix and one about two seconds before it.
    fn track(&self, t_keyframe: Time) -> Option<Track> {
        let (t_newest, (antenna, sigma)) = newest_at(&self.heard.gnss, t_keyframe)?;
        let before =
            || self.heard.gnss.iter().rev().filter(|(t, _)| t < t_newest && *t_newest - *t <= TRACK_OVER_AT_MOST);
        let is_long = |fix: &&(Time, _)| *t_newest - fix.0 >= MEAN_OVER_AT_LEAST;
        let (t_earlier, (earlier, sigma_earlier)) = before().find(is_long).or_else(|| before().next_back())?;
        let span = *t_newest - *t_earlier;
        let dt = span.as_seconds();
        let mut velocity_enu = (antenna - earlier) / dt;
        velocity_enu.z = 0.0;
        let variance = sigma.xy().norm_squared() + sigma_earlier.xy().norm_squared();
        Some(Track { velocity_enu, sigma: (0.5 * variance).sqrt() / dt, t_middle: *t_newest - Duration(span.0 / 2) })
    }

    /// `samples` reach to the keyframe.
    pub(super) fn attitude_at(
        &self,
        t_keyframe: Time,
        motion: &Motion,
        samples: &ImuHistory,
        world: &WorldModel,
    ) -> Option<Attitude> {
        let initial = &self.config.vehicle.initial;
        if let Some(q) = initial.q_enu_body {
            return Some(Attitude { q_enu_body: quaternion(q), sigma: initial.sigma_attitude, is_levelled: false });
        }
        let (t_heading, heading, heading_sigma) = self.heading_at(t_keyframe)?;
        let back = |t: Time| samples.integrate(t_keyframe, t, &Vector3::zeros(), &Vector3::zeros(), &self.imu);
        let up = if motion.is_still { motion.mean_accel } else { self.force_without_motion(t_keyframe, motion, back)? };
        let roll = up.y.atan2(up.z);
        let pitch = (-up.x).atan2(up.y.hypot(up.z));
        // Heading and level are those at the vehicle: turned to the axes of the origin.
        let before = || self.aged(t_keyframe, world).map_or_else(Vector3::zeros, |aged| aged.position_enu);
        let near = self.heard.gnss.back().map_or_else(before, |(_, (antenna, _))| *antenna);
        let near = initial.position_enu.map_or(near, Vector3::from);
        let level = Rotation3::from_euler_angles(roll, pitch, 0.0);
        // Where x points at the reading, had the keyframe a yaw of 0: the rest is the yaw.
        let forward = level * back(t_heading).map_or_else(Vector3::x, |back| back.gamma * Vector3::x());
        let yaw = FRAC_PI_2 - heading - forward.y.atan2(forward.x);
        let r_local_body = Rotation3::from_euler_angles(roll, pitch, yaw).into_inner();
        let r_enu_body = world.frame.local_axes_at(&near) * r_local_body;
        let tilt = |configured: f64| if motion.is_still { configured } else { configured.max(MOVING_TILT_SIGMA) };
        let [about_x, about_y, about_up] = initial.sigma_attitude;
        Some(Attitude {
            q_enu_body: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r_enu_body)),
            sigma: [tilt(about_x), tilt(about_y), about_up.max(heading_sigma)],
            is_levelled: true,
        })
    }

    /// A heading, when it was that, and its sigma: the compass, else the direction of the track, less the angle at which the DVL saw
    /// the vehicle cross it. A track that the DVL did not see is that of a wild fix.
    fn heading_at(&self, t_keyframe: Time) -> Option<(Time, f64, f64)> {
        if let Some((t, heading)) = newest_at(&self.heard.mcp, t_keyframe) {
            return Some((*t, *heading, self.config.vehicle.mcp.sigma));
        }
        let Track { velocity_enu: way, sigma, t_middle } = self.track(t_keyframe)?;
        let is_fast = |speed: f64| speed > STILL_SPEED + TRACK_SIGMAS * sigma;
        let speed = way.norm();
        if !is_fast(speed) {
            return None;
        }
        let course = way.x.atan2(way.y);
        let seen = self.heard.dvl.iter().min_by_key(|(t, _)| (*t - t_middle).abs());
        let crossing = match seen.filter(|(t, _)| (*t - t_middle).abs() <= READING_AGE_MAX) {
            Some((_, velocity)) => {
                let along = (self.r_body_dvl() * velocity).xy();
                let is_same_way = (along.norm() - speed).abs() <= TURNED * speed + TRACK_SIGMAS * sigma;
                if !is_same_way || !is_fast(along.norm()) {
                    return None;
                }
                along.y.atan2(along.x)
            }
            None => 0.0,
        };
        Some((t_middle, course + crossing, TRACK_HEADING_SIGMA.max(sigma / speed)))
    }

    /// What the accelerometer would say at rest in the attitude of the keyframe; `back` goes from there to an instant before.
    fn force_without_motion(
        &self,
        t_keyframe: Time,
        motion: &Motion,
        back: impl Fn(Time) -> Option<Preintegration>,
    ) -> Option<Vector3<f64>> {
        let during = || self.heard.dvl.iter().filter(|(t, _)| *t >= motion.t_from && *t <= t_keyframe);
        let (first, last) = (during().min_by_key(|(t, _)| *t), during().max_by_key(|(t, _)| *t));
        if let (Some((t_first, first)), Some((t_last, last))) = (first, last)
            && *t_last - *t_first >= Duration(MEAN_OVER_AT_LEAST.0 / 2)
            && let (Some(from), Some(to)) = (back(*t_first), back(*t_last))
        {
            // The lever arm's own velocity is left out: a few cm/s, of which the mean is next to nothing.
            let r_body_dvl = self.r_body_dvl();
            let change = to.gamma * r_body_dvl * last - from.gamma * r_body_dvl * first;
            return Some((to.beta - from.beta - change) / (to.dt_total - from.dt_total));
        }
        let t_oldest = self.samples.oldest()?;
        let whole = back(motion.t_from.max(t_oldest))?;
        Some(whole.beta / whole.dt_total)
    }

    fn r_body_dvl(&self) -> Matrix3<f64> {
        let [roll, pitch, yaw] = self.config.vehicle.dvl.mounting_rpy;
        Rotation3::from_euler_angles(roll, pitch, yaw).into_inner()
    }

    /// Velocity and its covariance, by the best that is there.
    pub(super) fn velocity_at(
        &self,
        t_keyframe: Time,
        motion: &Motion,
        attitude: &Attitude,
        world: &WorldModel,
    ) -> Velocity {
        let (initial, dvl) = (&self.config.vehicle.initial, &self.config.vehicle.dvl);
        let guess = |velocity_enu: Vector3<f64>, sigmas: Vector3<f64>| Velocity {
            velocity_enu,
            covariance: Matrix3::from_diagonal(&sigmas.component_mul(&sigmas)),
            readings: Vec::new(),
        };
        let isotropic = |sigma: f64| Vector3::repeat(sigma);
        if let Some(velocity) = initial.velocity_enu {
            return guess(Vector3::from(velocity), isotropic(initial.sigma_velocity));
        }
        if let Some((t, velocity_dvl)) = newest_at(&self.heard.dvl, t_keyframe) {
            let q = attitude.q_enu_body;
            let rate_body = motion.mean_gyro - q.inverse() * world.earth_rate_enu;
            let velocity_body = self.r_body_dvl() * velocity_dvl - rate_body.cross(&Vector3::from(dvl.lever_arm_body));
            let sigma = if motion.is_still { STILL_SPEED } else { UNSAID_VELOCITY_SIGMA };
            // All of the last second or so: each is carried along, and their noise is white.
            let recent = self.heard.dvl.iter().filter(|(at, _)| at <= t && *t - *at <= READING_AGE_MAX);
            let readings =
                recent.map(|(t, velocity)| (*t, Reading::Dvl { velocity_dvl: (*velocity).into() })).collect();
            let from = if motion.is_still { Vector3::zeros() } else { q * velocity_body };
            return Velocity { readings, ..guess(from, isotropic(sigma)) };
        }
        match self.track(t_keyframe) {
            Some(track) if motion.is_still => {
                let excluded = track.sigma.clamp(STILL_VELOCITY_SIGMA, UNKNOWN_VELOCITY_SIGMA);
                guess(Vector3::zeros(), isotropic(excluded))
            }
            Some(Track { velocity_enu: velocity, sigma, .. }) => {
                let vertical = UNKNOWN_VELOCITY_SIGMA.min(0.3 * velocity.norm() + sigma);
                // Between two fixes lies a second or two in which it may have turned.
                let horizontal = sigma.hypot(0.3 * velocity.norm());
                guess(velocity, Vector3::new(horizontal, horizontal, vertical))
            }
            None => match self.aged(t_keyframe, world) {
                Some(aged) if aged.velocity_cov.diagonal().max() <= UNKNOWN_VELOCITY_SIGMA.powi(2) => {
                    Velocity { velocity_enu: aged.velocity_enu, covariance: aged.velocity_cov, readings: Vec::new() }
                }
                _ => guess(Vector3::zeros(), isotropic(UNKNOWN_VELOCITY_SIGMA)),
            },
        }
    }
}
