//! The navigation state and its 15 error coordinates. The conventions of the state are written here, once.
//!
//! ```text
//! x = (p, v, R, b_a, b_g)         p, v of the IMU in ENU; R = R(q_enu_body) takes body vectors to ENU
//! δx = (δp, δv, δθ, δb_a, δb_g)   δp, δv in ENU, δθ in body axes (right perturbation)
//! x ⊞ δ = (p+δp, v+δv, R·Exp(δθ), b_a+δb_a, b_g+δb_g)
//! x ⊟ y = (p_x−p_y, v_x−v_y, Log(R_yᵀR_x), …)
//! ```
//!
//! Quaternions are Hamilton, (w, x, y, z) where they are written out. Residuals are predicted minus measured.

use nalgebra::{Matrix3, Quaternion, SMatrix, SVector, UnitQuaternion, Vector3};
use nav_geometry::so3;
use shared_types::Solution;

/// Length of the error state.
pub const ERROR_DIM: usize = 15;
/// First of the three position error coordinates, m.
pub const POSITION: usize = 0;
/// First of the three velocity error coordinates, m/s.
pub const VELOCITY: usize = 3;
/// First of the three attitude error coordinates, rad, body axes.
pub const ATTITUDE: usize = 6;
/// First of the three accelerometer bias error coordinates, m/s².
pub const ACCEL_BIAS: usize = 9;
/// First of the three gyroscope bias error coordinates, rad/s.
pub const GYRO_BIAS: usize = 12;

/// Position, velocity, attitude and IMU biases at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavState {
    /// IMU position, m.
    pub position_enu: Vector3<f64>,
    /// Velocity over ground, m/s.
    pub velocity_enu: Vector3<f64>,
    /// Body to ENU.
    pub q_enu_body: UnitQuaternion<f64>,
    /// Accelerometer bias, m/s², body axes.
    pub accel_bias: Vector3<f64>,
    /// Gyroscope bias, rad/s, body axes.
    pub gyro_bias: Vector3<f64>,
}

impl NavState {
    /// At the origin, at rest, level with the nose to the east, without bias.
    pub fn identity() -> NavState {
        NavState {
            position_enu: Vector3::zeros(),
            velocity_enu: Vector3::zeros(),
            q_enu_body: UnitQuaternion::identity(),
            accel_bias: Vector3::zeros(),
            gyro_bias: Vector3::zeros(),
        }
    }

    /// Rotation matrix of `q_enu_body`.
    #[inline]
    pub fn r_enu_body(&self) -> Matrix3<f64> {
        self.q_enu_body.to_rotation_matrix().into_inner()
    }

    /// `self ⊞ delta`.
    #[inline]
    #[must_use]
    pub fn retract(&self, delta: &SVector<f64, ERROR_DIM>) -> NavState {
        let part = |at: usize| delta.fixed_rows::<3>(at);
        let mut q_enu_body = self.q_enu_body * so3::exp_quaternion(&part(ATTITUDE).into_owned());
        // One Newton step keeps the norm: products drift by a rounding each.
        q_enu_body.renormalize_fast();
        NavState {
            position_enu: self.position_enu + part(POSITION),
            velocity_enu: self.velocity_enu + part(VELOCITY),
            q_enu_body,
            accel_bias: self.accel_bias + part(ACCEL_BIAS),
            gyro_bias: self.gyro_bias + part(GYRO_BIAS),
        }
    }

    /// `self ⊟ reference`: the δ with `reference ⊞ δ = self`.
    #[inline]
    pub fn local(&self, reference: &NavState) -> SVector<f64, ERROR_DIM> {
        let mut delta = SVector::<f64, ERROR_DIM>::zeros();
        let attitude = so3::log_quaternion(&(reference.q_enu_body.inverse() * self.q_enu_body));
        delta.fixed_rows_mut::<3>(POSITION).copy_from(&(self.position_enu - reference.position_enu));
        delta.fixed_rows_mut::<3>(VELOCITY).copy_from(&(self.velocity_enu - reference.velocity_enu));
        delta.fixed_rows_mut::<3>(ATTITUDE).copy_from(&attitude);
        delta.fixed_rows_mut::<3>(ACCEL_BIAS).copy_from(&(self.accel_bias - reference.accel_bias));
        delta.fixed_rows_mut::<3>(GYRO_BIAS).copy_from(&(self.gyro_bias - reference.gyro_bias));
        delta
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        let vectors = [&self.position_enu, &self.velocity_enu, &self.accel_bias, &self.gyro_bias];
        vectors.iter().all(|v| v.iter().all(|x| x.is_finite())) && self.q_enu_body.coords.iter().all(|x| x.is_finite())
    }

    /// The state of a solution, and its covariance. `None` if a number is not finite or the quaternion is not a unit one.
    pub fn from_solution(solution: &Solution) -> Option<(NavState, SMatrix<f64, ERROR_DIM, ERROR_DIM>)> {
        // An estimator writes unit quaternions; what is further from one than rounding was not written by one.
        const NORM_TOLERANCE: f64 = 1e-6;
        let [w, x, y, z] = solution.q_enu_body;
        let quaternion = Quaternion::new(w, x, y, z);
        let norm_error = (quaternion.norm() - 1.0).abs();
        if norm_error.is_nan() || norm_error > NORM_TOLERANCE {
            return None;
        }
        let state = NavState {
            position_enu: Vector3::from(solution.position_enu),
            velocity_enu: Vector3::from(solution.velocity_enu),
            q_enu_body: UnitQuaternion::new_normalize(quaternion),
            accel_bias: Vector3::from(solution.accel_bias),
            gyro_bias: Vector3::from(solution.gyro_bias),
        };
        let covariance = SMatrix::<f64, ERROR_DIM, ERROR_DIM>::from_fn(|row, column| solution.covariance[row][column]);
        (state.is_finite() && covariance.iter().all(|x| x.is_finite())).then_some((state, covariance))
    }

    /// Writes the state and its covariance into a solution; the other fields stay as they are.
    pub fn write_solution(&self, covariance: &SMatrix<f64, ERROR_DIM, ERROR_DIM>, solution: &mut Solution) {
        solution.position_enu = self.position_enu.into();
        solution.velocity_enu = self.velocity_enu.into();
        solution.q_enu_body = self.quaternion_wxyz();
        solution.accel_bias = self.accel_bias.into();
        solution.gyro_bias = self.gyro_bias.into();
        for row in 0..ERROR_DIM {
            for column in 0..ERROR_DIM {
                solution.covariance[row][column] = covariance[(row, column)];
            }
        }
    }

    /// The attitude quaternion as (w, x, y, z).
    pub fn quaternion_wxyz(&self) -> [f64; 4] {
        let q = self.q_enu_body.quaternion();
        [q.w, q.i, q.j, q.k]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{random, random_state};

    #[test]
    fn local_undoes_retract() {
        let mut rng = random(1);
        for _ in 0..20 {
            let (state, other) = (random_state(&mut rng), random_state(&mut rng));
            let delta = other.local(&state);
            let again = state.retract(&delta);
            assert!(again.local(&other).norm() < 1e-12, "{:e}", again.local(&other).norm());
            assert!((again.q_enu_body.norm() - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn a_state_survives_the_wire_and_a_broken_one_does_not() {
        let mut rng = random(2);
        let state = random_state(&mut rng);
        let covariance = SMatrix::<f64, ERROR_DIM, ERROR_DIM>::from_fn(|row, column| (row * 15 + column) as f64);
        let mut solution = blank_solution();
        state.write_solution(&covariance, &mut solution);
        let (back, covariance_back) = NavState::from_solution(&solution).expect("whole");
        assert!(back.local(&state).norm() < 1e-15);
        assert_eq!(covariance_back, covariance);
        let broken = |spoil: fn(&mut Solution)| {
            let mut spoilt = solution;
            spoil(&mut spoilt);
            NavState::from_solution(&spoilt).is_none()
        };
        assert!(broken(|s| s.q_enu_body = [0.0; 4]));
        assert!(broken(|s| s.q_enu_body[2] = f64::NAN));
        assert!(broken(|s| s.position_enu[0] = f64::INFINITY));
        assert!(broken(|s| s.covariance[3][4] = f64::NAN));
    }

    fn blank_solution() -> Solution {
        crate::testing::solution(&NavState::identity(), &SMatrix::zeros(), shared_types::Time(0))
    }
}
