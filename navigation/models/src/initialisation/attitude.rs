//! Motion, tilt, heading and velocity at the start.
//!
//! ```text
//! roll = atan2(f_y, f_z),  pitch = atan2(−f_x, √(f_y² + f_z²)),  yaw = 90° − heading           (FLU, ZYX)
//! moving: f is replaced by f − (du/dt + ω×u), u the velocity in the body that the DVL saw
//! ```

use core::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use shared_types::{Duration, Time};

use super::{Initialiser, READING_AGE_MAX, STILL_VELOCITY_SIGMA, UNKNOWN_VELOCITY_SIGMA, quaternion};
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

/// Mean and largest standard deviation of an axis.
fn mean_and_deviation(vectors: impl Iterator<Item = Vector3<f64>> + Clone) -> (Vector3<f64>, f64) {
    let count = vectors.clone().count() as f64;
    let mean = vectors.clone().sum::<Vector3<f64>>() / count;
    let variance = vectors.map(|v| (v - mean).component_mul(&(v - mean))).sum::<Vector3<f64>>() / count;
    (mean, variance.max().sqrt())
}

impl Initialiser {
    /// The longest still stretch up to the keyframe (10 s, else 2 s), else the last 2 s as moving; `None` before there are 2 s.
    pub(super) fn motion_at(&self, t_keyframe: Time) -> Option<Motion> {
        let (t_oldest, _) = *self.samples.front()?;
        let newest = self.samples.iter().rev().find(|(t, _)| *t <= t_keyframe)?.0;
        if t_keyframe - newest > READING_AGE_MAX || newest + SLACK - t_oldest < MEAN_OVER_AT_LEAST {
            return None;
        }
        let mut moving = None;
        for span in [MEAN_OVER_AT_MOST, MEAN_OVER_AT_LEAST] {
            let t_from = t_keyframe - span;
            let stretch = || self.samples.iter().filter(|(t, _)| *t >= t_from && *t <= t_keyframe);
            let (mean_gyro, gyro_deviation) = mean_and_deviation(stretch().map(|(_, point)| point.gyro_body));
            let (mean_accel, accel_deviation) = mean_and_deviation(stretch().map(|(_, point)| point.accel_body));
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
        by_dvl || self.track(t_to).is_some_and(|(velocity, sigma)| velocity.norm() > STILL_SPEED + TRACK_SIGMAS * sigma)
    }

    /// Horizontal velocity of the antenna between the newest fix and one about two seconds before it, with its sigma.
    fn track(&self, t_keyframe: Time) -> Option<(Vector3<f64>, f64)> {
        let recent = || self.heard.gnss.iter().rev().filter(|(t, ..)| *t <= t_keyframe + READING_AGE_MAX);
        let newest = recent().next()?;
        if (t_keyframe - newest.0).abs() > READING_AGE_MAX {
            return None;
        }
        let earlier = recent().find(|(t, ..)| newest.0 - *t >= MEAN_OVER_AT_LEAST).or_else(|| recent().next_back())?;
        let dt = (newest.0 - earlier.0).as_seconds();
        if dt <= 0.0 {
            return None;
        }
        let mut velocity = (newest.1 - earlier.1) / dt;
        velocity.z = 0.0;
        let variance = newest.2.xy().norm_squared() + earlier.2.xy().norm_squared();
        Some((velocity, (0.5 * variance).sqrt() / dt))
    }

    pub(super) fn attitude_at(&self, t_keyframe: Time, motion: &Motion, world: &WorldModel) -> Option<Attitude> {
        let initial = &self.config.vehicle.initial;
        if let Some(q) = initial.q_enu_body {
            return Some(Attitude { q_enu_body: quaternion(q), sigma: initial.sigma_attitude, is_levelled: false });
        }
        let (heading, heading_sigma) = self.heading_at(t_keyframe)?;
        let up = if motion.is_still { motion.mean_accel } else { self.force_without_motion(t_keyframe, motion) };
        let roll = up.y.atan2(up.z);
        let pitch = (-up.x).atan2(up.y.hypot(up.z));
        // Heading and level are those at the vehicle: turned to the axes of the origin.
        let near = self.heard.gnss.back().map_or_else(Vector3::zeros, |(_, antenna, _)| *antenna);
        let near = initial.position_enu.map_or(near, Vector3::from);
        let r_local_body = Rotation3::from_euler_angles(roll, pitch, FRAC_PI_2 - heading).into_inner();
        let r_enu_body = world.frame.local_axes_at(&near) * r_local_body;
        let tilt = |configured: f64| if motion.is_still { configured } else { configured.max(MOVING_TILT_SIGMA) };
        let [about_x, about_y, about_up] = initial.sigma_attitude;
        Some(Attitude {
            q_enu_body: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(r_enu_body)),
            sigma: [tilt(about_x), tilt(about_y), about_up.max(heading_sigma)],
            is_levelled: true,
        })
    }

    /// Heading and its sigma: the compass, else the direction of the track.
    fn heading_at(&self, t_keyframe: Time) -> Option<(f64, f64)> {
        let nearest = self.heard.mcp.iter().min_by_key(|(t, _)| (*t - t_keyframe).abs());
        if let Some((t, heading)) = nearest
            && (*t - t_keyframe).abs() <= READING_AGE_MAX
        {
            return Some((*heading, self.config.vehicle.mcp.sigma));
        }
        let (velocity, sigma) = self.track(t_keyframe)?;
        let speed = velocity.norm();
        (speed > STILL_SPEED + TRACK_SIGMAS * sigma)
            .then(|| (velocity.x.atan2(velocity.y), TRACK_HEADING_SIGMA.max(sigma / speed)))
    }

    /// f − (du/dt + ω×u), averaged: what the accelerometer would say at rest.
    fn force_without_motion(&self, t_keyframe: Time, motion: &Motion) -> Vector3<f64> {
        let during = || self.heard.dvl.iter().filter(|(t, _)| *t >= motion.t_from && *t <= t_keyframe);
        let (Some(first), Some(last)) = (during().next(), during().next_back()) else { return motion.mean_accel };
        let dt = (last.0 - first.0).as_seconds();
        if dt < 0.5 * MEAN_OVER_AT_LEAST.as_seconds() {
            return motion.mean_accel;
        }
        let r_body_dvl = self.r_body_dvl();
        let count = during().count() as f64;
        let mean_velocity = r_body_dvl * (during().map(|(_, velocity)| *velocity).sum::<Vector3<f64>>() / count);
        let change = r_body_dvl * (last.1 - first.1) / dt;
        motion.mean_accel - change - motion.mean_gyro.cross(&mean_velocity)
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
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let (initial, dvl) = (&self.config.vehicle.initial, &self.config.vehicle.dvl);
        let isotropic = |sigma: f64| Matrix3::identity() * (sigma * sigma);
        if let Some(velocity) = initial.velocity_enu {
            return (Vector3::from(velocity), isotropic(initial.sigma_velocity));
        }
        if motion.is_still {
            return (Vector3::zeros(), isotropic(STILL_VELOCITY_SIGMA));
        }
        let nearest = self.heard.dvl.iter().min_by_key(|(t, _)| (*t - t_keyframe).abs());
        if let Some((t, velocity_dvl)) = nearest
            && (*t - t_keyframe).abs() <= READING_AGE_MAX
        {
            let q = attitude.q_enu_body;
            let rate_body = motion.mean_gyro - q.inverse() * world.earth_rate_enu;
            let velocity_body = self.r_body_dvl() * velocity_dvl - rate_body.cross(&Vector3::from(dvl.lever_arm_body));
            let velocity_enu = q * velocity_body;
            // The attitude turns it; meanwhile it may have changed by half a metre per second squared.
            let turned = velocity_enu.norm() * attitude.sigma.iter().fold(0.0_f64, |worst, s| worst.max(*s));
            let changed = 0.5 * (*t - t_keyframe).abs().as_seconds();
            return (velocity_enu, isotropic(dvl.sigma.hypot(turned).hypot(changed)));
        }
        if let Some((velocity, sigma)) = self.track(t_keyframe) {
            let vertical = UNKNOWN_VELOCITY_SIGMA.min(0.3 * velocity.norm() + sigma);
            // Between two fixes lies a second or two in which it may have turned.
            let horizontal = sigma.hypot(0.3 * velocity.norm());
            let sigmas = Vector3::new(horizontal, horizontal, vertical);
            return (velocity, Matrix3::from_diagonal(&sigmas.component_mul(&sigmas)));
        }
        (Vector3::zeros(), isotropic(UNKNOWN_VELOCITY_SIGMA))
    }
}
