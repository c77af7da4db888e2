//! The IMU factor between two keyframes (§2.5 of the method).
//!
//! ```text
//! r_p = R_kᵀ(E(p_e − p_k) − v_kT − G_α) − α(b_k)
//! r_v = R_kᵀ(E(v_e + ω×(p_e − p_k)) − v_k − G_β) − β(b_k)
//! r_θ = Log(γ(b_k)ᵀ R_kᵀ E R_e)
//! r_b = b_e − b_k
//! ```
//!
//! 15 rows in the order of the error state; covariance P15 of the preintegration as it stands. Gravity is computed anew
//! at each evaluation and held constant in the Jacobians (below 3e-6·T s⁻¹).
//!
//! The paper's vector part of a quaternion is a logarithm here: its residual has no sign that jumps.

use nalgebra::{Matrix3, SMatrix, SVector};
use nav_geometry::so3;

use crate::blocks::{product, product_transposed, product_with_skew, times, transposed_product, transposed_times};
use crate::kernels::{cholesky, solve_lower_transposed};
use crate::preintegration::{CorrectedIncrement, Preintegration};
use crate::state::{ACCEL_BIAS, ATTITUDE, ERROR_DIM, GYRO_BIAS, NavState, POSITION, VELOCITY};
use crate::transport::EarthMotion;
use crate::wide;
use crate::world::WorldModel;

/// The increment between two keyframes as a factor on both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuFactor {
    /// From the first keyframe to the second, `dt_total` > 0.
    pub preintegration: Preintegration,
}

/// Jacobians of [`ImuFactor::residual`], 15 × 15 each.
///
/// By 3 × 3 blocks in the order (p, v, θ, b_a, b_g), `x` full, `.` zero, `I` identity:
///
/// ```text
/// from:  r_p   x x x x x        to:  r_p   x . . . .
///        r_v   x x x x x             r_v   x x . . .
///        r_θ   . . x . x             r_θ   . . x . .
///        r_ba  . . . -I .            r_ba  . . . I .
///        r_bg  . . . . -I            r_bg  . . . . I
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuJacobians {
    /// With respect to the first keyframe.
    pub from: SMatrix<f64, ERROR_DIM, ERROR_DIM>,
    /// With respect to the second keyframe.
    pub to: SMatrix<f64, ERROR_DIM, ERROR_DIM>,
}

/// The three turned differences that residual and Jacobians share.
struct Difference {
    /// R_kᵀE.
    r_body_enu: Matrix3<f64>,
    moved: CorrectedIncrement,
    position: nalgebra::Vector3<f64>,
    velocity: nalgebra::Vector3<f64>,
    /// r_θ.
    attitude: nalgebra::Vector3<f64>,
    /// R_kᵀE R_e.
    relative_rotation: Matrix3<f64>,
}

impl ImuFactor {
    /// The factor of a closed interval.
    pub fn new(preintegration: Preintegration) -> ImuFactor {
        ImuFactor { preintegration }
    }

    /// `position` and `velocity` are what r_p + α(b_k) and r_v + β(b_k) are made of.
    #[inline]
    fn difference(&self, from: &NavState, to: &NavState, world: &WorldModel) -> Difference {
        let dt = self.preintegration.dt_total;
        let gravity = world.gravity.at(&(from.position_enu + from.velocity_enu * (0.5 * dt)));
        let earth = EarthMotion::over(dt, gravity, world);
        let moved = self.preintegration.corrected(&from.accel_bias, &from.gyro_bias);
        let r_from = from.r_enu_body();
        let step = to.position_enu - from.position_enu;
        let end_velocity = to.velocity_enu + world.earth_rate_enu.cross(&step);
        let r_body_enu = transposed_product(&r_from, &earth.turn);
        let relative_rotation = product(&r_body_enu, &to.r_enu_body());
        Difference {
            position: times(&r_body_enu, &step) - transposed_times(&r_from, &(from.velocity_enu * dt + earth.fall)),
            velocity: times(&r_body_enu, &end_velocity)
                - transposed_times(&r_from, &(from.velocity_enu + earth.fall_velocity)),
            attitude: so3::log(&transposed_product(&moved.gamma, &relative_rotation)),
            relative_rotation,
            r_body_enu,
            moved,
        }
    }

    /// The 15 rows, predicted minus preintegrated.
    pub fn residual(&self, from: &NavState, to: &NavState, world: &WorldModel) -> SVector<f64, ERROR_DIM> {
        self.residual_of(&self.difference(from, to, world), from, to)
    }

    /// The Jacobians at these states, which may be linearisation points other than the states of the residual
    /// (first-estimates Jacobians).
    pub fn jacobians(&self, from: &NavState, to: &NavState, world: &WorldModel) -> ImuJacobians {
        self.jacobians_of(&self.difference(from, to, world), from, world)
    }

    /// Residual and Jacobians at the same states, at the price of little more than one.
    pub fn residual_and_jacobians(
        &self,
        from: &NavState,
        to: &NavState,
        world: &WorldModel,
    ) -> (SVector<f64, ERROR_DIM>, ImuJacobians) {
        let difference = self.difference(from, to, world);
        (self.residual_of(&difference, from, to), self.jacobians_of(&difference, from, world))
    }

    #[inline]
    fn residual_of(&self, difference: &Difference, from: &NavState, to: &NavState) -> SVector<f64, ERROR_DIM> {
        let mut residual = SVector::<f64, ERROR_DIM>::zeros();
        let mut put = |row: usize, part: &nalgebra::Vector3<f64>| residual.fixed_rows_mut::<3>(row).copy_from(part);
        put(POSITION, &(difference.position - difference.moved.alpha));
        put(VELOCITY, &(difference.velocity - difference.moved.beta));
        put(ATTITUDE, &difference.attitude);
        put(ACCEL_BIAS, &(to.accel_bias - from.accel_bias));
        put(GYRO_BIAS, &(to.gyro_bias - from.gyro_bias));
        residual
    }

    #[inline]
    fn jacobians_of(&self, difference: &Difference, from: &NavState, world: &WorldModel) -> ImuJacobians {
        let d = &self.preintegration.bias_jacobian;
        let r_from_transposed = from.r_enu_body().transpose();
        let body_earth_rate = product_with_skew(&difference.r_body_enu, &world.earth_rate_enu);
        let attitude_inverse = so3::right_jacobian_inverse(&difference.attitude);

        let mut from_jacobian = SMatrix::<f64, ERROR_DIM, ERROR_DIM>::zeros();
        let mut put = |row: usize, column: usize, block: Matrix3<f64>| {
            from_jacobian.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        };
        put(POSITION, POSITION, -difference.r_body_enu);
        put(POSITION, VELOCITY, r_from_transposed * -self.preintegration.dt_total);
        put(POSITION, ATTITUDE, so3::skew(&difference.position));
        put(POSITION, ACCEL_BIAS, -d.alpha_accel);
        put(POSITION, GYRO_BIAS, -d.alpha_gyro);
        put(VELOCITY, POSITION, -body_earth_rate);
        put(VELOCITY, VELOCITY, -r_from_transposed);
        put(VELOCITY, ATTITUDE, so3::skew(&difference.velocity));
        put(VELOCITY, ACCEL_BIAS, -d.beta_accel);
        put(VELOCITY, GYRO_BIAS, -d.beta_gyro);
        put(ATTITUDE, ATTITUDE, -product_transposed(&attitude_inverse, &difference.relative_rotation));
        // J_l⁻¹(r) = J_r⁻¹(r)ᵀ.
        put(
            ATTITUDE,
            GYRO_BIAS,
            -product(&transposed_product(&attitude_inverse, &difference.moved.right_jacobian), &d.phi_gyro),
        );
        put(ACCEL_BIAS, ACCEL_BIAS, -Matrix3::identity());
        put(GYRO_BIAS, GYRO_BIAS, -Matrix3::identity());

        let mut to_jacobian = SMatrix::<f64, ERROR_DIM, ERROR_DIM>::zeros();
        let mut put = |row: usize, column: usize, block: Matrix3<f64>| {
            to_jacobian.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        };
        put(POSITION, POSITION, difference.r_body_enu);
        put(VELOCITY, POSITION, body_earth_rate);
        put(VELOCITY, VELOCITY, difference.r_body_enu);
        put(ATTITUDE, ATTITUDE, attitude_inverse);
        put(ACCEL_BIAS, ACCEL_BIAS, Matrix3::identity());
        put(GYRO_BIAS, GYRO_BIAS, Matrix3::identity());
        ImuJacobians { from: from_jacobian, to: to_jacobian }
    }

    /// Weight of the factor, to be made once per interval.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when the interval is empty or a noise is zero.
    pub fn weight(&self) -> Result<ImuWeight, NotPositiveDefinite> {
        ImuWeight::new(&self.preintegration)
    }
}

/// A covariance that cannot be inverted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the covariance of the inertial increment is not positive definite")]
pub struct NotPositiveDefinite;

/// A square root of the inverse of P15, of one interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuWeight {
    /// W = L⁻¹ with P15 = LLᵀ, lower triangular: W r has unit covariance, WᵀW = P15⁻¹.
    pub whitener: SMatrix<f64, ERROR_DIM, ERROR_DIM>,
}

impl ImuWeight {
    /// From the covariance of an increment.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when the interval is empty or a noise is zero.
    pub fn new(preintegration: &Preintegration) -> Result<ImuWeight, NotPositiveDefinite> {
        let covariance = preintegration.covariance();
        let factor = wide!(cholesky(&covariance)).map_err(|_| NotPositiveDefinite)?;
        let mut inverse_transposed = SMatrix::<f64, ERROR_DIM, ERROR_DIM>::identity();
        wide!(solve_lower_transposed(&factor, &mut inverse_transposed));
        let whitener = inverse_transposed.transpose();
        if whitener.iter().all(|x| x.is_finite()) { Ok(ImuWeight { whitener }) } else { Err(NotPositiveDefinite) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{
        assert_jacobians_agree, fingerprint, golden_from, golden_piece, golden_to, numeric_jacobian, random,
        random_increment, random_state, world,
    };
    use crate::transport::transport;
    use approx::assert_relative_eq;
    use nalgebra::Vector3;
    use nav_geometry::GravityModel;

    fn golden_factor() -> ImuFactor {
        ImuFactor::new(golden_piece(&[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]))
    }

    #[test]
    fn golden_residual_of_the_method_is_met() {
        let residual = golden_factor().residual(&golden_from(), &golden_to(), &world());
        let golden = [
            0.298122301804,
            0.161083756365,
            0.0544293941548,
            1.25859477707,
            0.649550806639,
            0.0165524104474,
            -0.172649744295,
            0.0634158805268,
            0.0103662472851,
            5e-4,
            0.0,
            -5e-4,
            0.0,
            1e-4,
            0.0,
        ];
        for (row, expected) in golden.into_iter().enumerate() {
            assert_relative_eq!(residual[row], expected, epsilon = 1e-10, max_relative = 1e-10);
        }
        let gravity = world().gravity.at(&golden_from().position_enu);
        let golden = Vector3::new(-0.000184714944997, 0.000524277538131, -9.79868480289);
        // g_k of the table is taken at p_k + ½T v_k.
        let middle = golden_from().position_enu + golden_from().velocity_enu * 0.25;
        assert_relative_eq!(world().gravity.at(&middle), golden, epsilon = 1e-10);
        assert!((gravity - golden).norm() > 1e-9);
    }

    #[test]
    fn golden_jacobians_of_the_method_are_met() {
        let jacobians = golden_factor().jacobians(&golden_from(), &golden_to(), &world());
        let (s, f) = fingerprint(&jacobians.from);
        assert_relative_eq!(s, -1.43568178614, max_relative = 1e-10);
        assert_relative_eq!(f, 8.72349445524, max_relative = 1e-10);
        let (s, f) = fingerprint(&jacobians.to);
        assert_relative_eq!(s, 0.252559582778, max_relative = 1e-10);
        assert_relative_eq!(f, 3.87371472652, max_relative = 1e-10);
        let entries = [
            (6, 6, [-0.992087471665, -0.117865080295, -0.047063171843]),
            (0, 6, [0.0, -1.28025322184, 0.175956091267]),
            (3, 0, [-2.20734442139e-5, 2.77600605381e-5, -3.76803604302e-5]),
            (6, 12, [0.4989073607, 0.0277743163075, 0.00159394551298]),
        ];
        for (row, column, golden) in entries {
            for (offset, expected) in golden.into_iter().enumerate() {
                let value = jacobians.from[(row, column + offset)];
                assert_relative_eq!(value, expected, epsilon = 1e-15, max_relative = 1e-10);
            }
        }
    }

    #[test]
    fn the_flat_textbook_form_is_what_remains_without_rotation_and_with_constant_gravity() {
        // A flat world is not offered; far from curvature means: gravity of the origin, taken from the residual.
        let flat = WorldModel { earth_rate_enu: Vector3::zeros(), ..world() };
        let (from, to) = (golden_from(), golden_to());
        let residual = golden_factor().residual(&from, &to, &flat);
        let gravity = flat.gravity.at(&(from.position_enu + from.velocity_enu * 0.25));
        let excess = from.r_enu_body().tr_mul(&(gravity - Vector3::new(0.0, 0.0, -9.8)));
        let position = residual.fixed_rows::<3>(POSITION) + excess * 0.125;
        let velocity = residual.fixed_rows::<3>(VELOCITY) + excess * 0.5;
        assert_relative_eq!(position, Vector3::new(0.298160608639, 0.161176318617, 0.0546021408788), epsilon = 1e-11);
        assert_relative_eq!(velocity, Vector3::new(1.25873290451, 0.649936827698, 0.0172468722268), epsilon = 1e-10);
        let attitude = residual.fixed_rows::<3>(ATTITUDE).into_owned();
        assert_relative_eq!(attitude, Vector3::new(-0.172678436676, 0.0633980180679, 0.0103524744865), epsilon = 1e-11);
    }

    #[test]
    fn jacobians_agree_with_central_differences_at_tilted_moving_biased_states() {
        let (world, mut rng) = (world(), random(5));
        for _ in 0..20 {
            let from = random_state(&mut rng);
            let factor = ImuFactor::new(random_increment(&mut rng, &from, 1.0));
            let to = transport(&from, &factor.preintegration, &world)
                .retract(&SVector::from_fn(|row, _| 0.1 * (row as f64 * 1.7).sin()));
            let (residual, jacobians) = factor.residual_and_jacobians(&from, &to, &world);
            assert_eq!(residual, factor.residual(&from, &to, &world));
            // Gravity is held constant in the Jacobian: 3.1e-6·T.
            let numeric = numeric_jacobian(1e-3, |d: &SVector<f64, 15>| factor.residual(&from.retract(d), &to, &world));
            assert_jacobians_agree(&jacobians.from, &numeric, 4e-6);
            let numeric = numeric_jacobian(1e-3, |d: &SVector<f64, 15>| factor.residual(&from, &to.retract(d), &world));
            assert_jacobians_agree(&jacobians.to, &numeric, 1e-9);
        }
    }

    #[test]
    fn a_transported_state_leaves_no_residual() {
        let (world, mut rng) = (world(), random(6));
        for _ in 0..10 {
            let from = random_state(&mut rng);
            let factor = ImuFactor::new(random_increment(&mut rng, &from, 1.0));
            let to = transport(&from, &factor.preintegration, &world);
            let residual = factor.residual(&from, &to, &world);
            assert!(residual.norm() < 1e-12, "{residual:e}");
        }
    }

    #[test]
    fn the_weight_whitens_the_covariance() {
        let mut rng = random(7);
        let state = random_state(&mut rng);
        let factor = ImuFactor::new(random_increment(&mut rng, &state, 1.0));
        let weight = factor.weight().expect("a second of noisy samples has a covariance");
        let p = factor.preintegration.covariance();
        let white = weight.whitener * p * weight.whitener.transpose();
        assert_relative_eq!(white, SMatrix::<f64, 15, 15>::identity(), epsilon = 1e-9);
    }

    #[test]
    fn an_empty_interval_has_no_weight() {
        let empty = ImuFactor::new(Preintegration::new(Vector3::zeros(), Vector3::zeros()));
        assert_eq!(empty.weight(), Err(NotPositiveDefinite));
    }

    #[test]
    fn gravity_in_water_is_another_world() {
        let water = WorldModel { gravity: GravityModel::new(world().frame, Some(0.0)), ..world() };
        let change = golden_factor().residual(&golden_from(), &golden_to(), &water)
            - golden_factor().residual(&golden_from(), &golden_to(), &world());
        // 8.61e-7·55 m·½T² and ·T.
        assert_relative_eq!(change.fixed_rows::<3>(POSITION).norm(), 8.61e-7 * 54.97 * 0.125, max_relative = 1e-2);
        assert_relative_eq!(change.fixed_rows::<3>(VELOCITY).norm(), 8.61e-7 * 54.97 * 0.5, max_relative = 1e-2);
    }
}
