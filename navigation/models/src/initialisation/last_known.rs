//! Where the vehicle was when its navigation was cut off, and where it may be by now.
//!
//! ```text
//! p(τ) = p₀ + v₀τ,   P_p(τ) = P_pp + τ(P_pv + P_vp) + τ²P_vv + diag(σ²),   σ = hypot(|v₀|·σ_τ, τ·min(aτ/2, |v₀| + u))
//! v(τ) = v₀,         P_v(τ) = P_vv + diag(σ²),                             σ = min(aτ, |v₀| + u)
//! ```
//!
//! Nobody saw what it did meanwhile. At first it cannot have done much: accelerations of `a` change a velocity by `aτ` and a way by
//! `aτ²/2`. In the long run it may have stopped, turned round or been carried off: three sigmas hold a vehicle that went the other way at
//! twice its speed. The age is that of a wall clock, which a machine reads to a second when it starts.
//!
//! Kept as a place on Earth with a velocity along its own east, north and up: the frame need not be the one that it was found in.
//! Attitude and biases are not kept: a computer that was off has not felt the turns, and an IMU that was off has other biases.

use nalgebra::{Matrix3, SMatrix, Vector3};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Duration, Solution, Time};

use crate::state::{NavState, POSITION, VELOCITY};

/// 1-sigma of what a vehicle does to its velocity, m/s²: at 1.5 m/s a turn of 11 deg/s.
const ACCELERATION: f64 = 0.3;
/// What a vehicle at rest may come to beside its own speed, m/s, 1-sigma: currents, and vertically the float up of one whose thrusters
/// have stopped.
const CARRIED: f64 = 0.5;
/// 1-sigma of an age told by wall clocks, s.
const CLOCK_SIGMA: f64 = 1.0;

/// A place and a velocity of before, with their covariances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LastKnown {
    t: Time,
    place: Geodetic,
    velocity_local: Vector3<f64>,
    position_cov: Matrix3<f64>,
    cross_cov: Matrix3<f64>,
    velocity_cov: Matrix3<f64>,
}

/// The same, later.
pub(super) struct Aged {
    pub(super) position_enu: Vector3<f64>,
    pub(super) position_cov: Matrix3<f64>,
    pub(super) velocity_enu: Vector3<f64>,
    pub(super) velocity_cov: Matrix3<f64>,
}

impl LastKnown {
    /// Of a solution that held at `t`, on the clock of the readings that are to come: its own `t_keyframe` may be that of a clock that
    /// began anew since. `None` if it holds no valid state.
    pub fn of(solution: &Solution, t: Time) -> Option<LastKnown> {
        let (state, covariance) = NavState::from_solution(solution)?;
        let [lat_deg, lon_deg, height] = solution.origin;
        if ![lat_deg, lon_deg, height].iter().all(|x| x.is_finite()) {
            return None;
        }
        let frame = LocalFrame::new(Geodetic::from_degrees(lat_deg, lon_deg, height));
        let axes = frame.local_axes_at(&state.position_enu);
        let local = |row: usize, column: usize| {
            let block: SMatrix<f64, 3, 3> = covariance.fixed_view::<3, 3>(row, column).into_owned();
            axes.tr_mul(&block) * axes
        };
        Some(LastKnown {
            t,
            place: frame.to_geodetic(&state.position_enu),
            velocity_local: axes.tr_mul(&state.velocity_enu),
            position_cov: local(POSITION, POSITION),
            cross_cov: local(POSITION, VELOCITY),
            velocity_cov: local(VELOCITY, VELOCITY),
        })
    }

    /// At a later time, in a frame.
    pub(super) fn at(&self, t: Time, frame: &LocalFrame) -> Aged {
        let age = (t - self.t).max(Duration::ZERO).as_seconds();
        let before_enu = frame.to_enu(&self.place);
        let axes = frame.local_axes_at(&before_enu);
        let speeds = [self.velocity_local.xy().norm(), self.velocity_local.z.abs()];
        let diagonal = |sigma: [f64; 2]| {
            let [horizontal, vertical] = sigma.map(|sigma| sigma * sigma);
            Matrix3::from_diagonal(&Vector3::new(horizontal, horizontal, vertical))
        };
        let way = speeds.map(|speed| {
            let unseen = age * (0.5 * ACCELERATION * age).min(speed + CARRIED);
            unseen.hypot(speed * CLOCK_SIGMA)
        });
        let change = speeds.map(|speed| (ACCELERATION * age).min(speed + CARRIED));
        let crossing = self.cross_cov + self.cross_cov.transpose();
        let position_cov = self.position_cov + crossing * age + self.velocity_cov * (age * age) + diagonal(way);
        let velocity_cov = self.velocity_cov + diagonal(change);
        Aged {
            position_enu: before_enu + axes * self.velocity_local * age,
            position_cov: axes * position_cov * axes.transpose(),
            velocity_enu: axes * self.velocity_local,
            velocity_cov: axes * velocity_cov * axes.transpose(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORIGIN: [f64; 3] = [36.38, 127.36, 20.0];

    fn frame() -> LocalFrame {
        LocalFrame::new(Geodetic::from_degrees(ORIGIN[0], ORIGIN[1], ORIGIN[2]))
    }

    /// 400 m east of the origin at 50 m depth, sailing north at 1.5 m/s; sigmas of 0.2 m and 0.05 m/s.
    fn last() -> Solution {
        let mut solution = Solution { origin: ORIGIN, position_enu: [400.0, 0.0, -50.0], ..Solution::empty() };
        solution.velocity_enu = [0.0, 1.5, 0.0];
        for axis in 0..3 {
            solution.covariance[axis][axis] = 0.04;
            solution.covariance[3 + axis][3 + axis] = 0.0025;
        }
        solution
    }

    fn after(seconds: f64) -> Aged {
        LastKnown::of(&last(), Time::from_seconds(100.0))
            .expect("valid")
            .at(Time::from_seconds(100.0 + seconds), &frame())
    }

    #[test]
    fn it_is_carried_on_with_its_velocity_and_never_before_its_own_time() {
        let at_once = after(0.0);
        assert!((at_once.position_enu - Vector3::new(400.0, 0.0, -50.0)).norm() < 1e-6, "{}", at_once.position_enu);
        assert!((after(20.0).position_enu - Vector3::new(400.0, 30.0, -50.0)).norm() < 1e-3);
        assert!((after(20.0).velocity_enu - Vector3::new(0.0, 1.5, 0.0)).norm() < 1e-6);
        assert_eq!(after(-5.0).position_enu, at_once.position_enu);
        // A second of the wall clock at 1.5 m/s.
        assert!((at_once.position_cov[(0, 0)].sqrt() - 0.2_f64.hypot(1.5)).abs() < 1e-3);
    }

    /// Whatever a vehicle does with accelerations of up to two sigmas, and twice its speed.
    #[test]
    fn three_sigmas_hold_whatever_a_vehicle_may_have_done_meanwhile() {
        let velocity = Vector3::new(0.0, 1.5, 0.0);
        let deeds: [(&str, Vector3<f64>); 5] = [
            ("sails on", velocity),
            ("stops", Vector3::zeros()),
            ("turns aside", Vector3::new(1.5, 0.0, 0.0)),
            ("turns round", -velocity * 2.0),
            ("floats up", Vector3::new(0.3, 0.0, 1.0)),
        ];
        for (deed, aim) in deeds {
            let (mut position_enu, mut now, dt) = (Vector3::new(400.0, 0.0, -50.0), velocity, 0.01);
            for step in 0..30_000 {
                if step % 100 == 0 {
                    let aged = after(f64::from(step) * dt);
                    let error = [position_enu - aged.position_enu, now - aged.velocity_enu];
                    for (error, cov) in error.iter().zip([aged.position_cov, aged.velocity_cov]) {
                        let beyond = (0..3).find(|&axis| error[axis].abs() > 3.0 * cov[(axis, axis)].sqrt());
                        assert_eq!(beyond, None, "{deed}, after {} s: {error} {cov}", f64::from(step) * dt);
                    }
                }
                let change = aim - now;
                now += change * (2.0 * ACCELERATION * dt / change.norm().max(1e-9)).min(1.0);
                position_enu += now * dt;
            }
        }
    }

    #[test]
    fn another_frame_finds_it_at_the_same_place_on_earth() {
        let elsewhere = LocalFrame::new(Geodetic::from_degrees(ORIGIN[0] + 0.05, ORIGIN[1] - 0.03, 0.0));
        let last = LastKnown::of(&last(), Time(0)).expect("valid");
        let (here, there) = (last.at(Time(0), &frame()), last.at(Time(0), &elsewhere));
        let distance = (frame().to_ecef(&here.position_enu) - elsewhere.to_ecef(&there.position_enu)).norm();
        assert!(distance < 1e-6, "{distance} m");
        assert!((here.position_cov.trace() - there.position_cov.trace()).abs() < 1e-9);
    }

    #[test]
    fn a_solution_without_a_state_is_none() {
        assert_eq!(LastKnown::of(&Solution { q_enu_body: [0.0; 4], ..last() }, Time(0)), None);
        assert_eq!(LastKnown::of(&Solution { origin: [f64::NAN, 0.0, 0.0], ..last() }, Time(0)), None);
        assert_eq!(LastKnown::of(&Solution { position_enu: [f64::INFINITY, 0.0, 0.0], ..last() }, Time(0)), None);
    }
}
