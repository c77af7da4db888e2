//! A state carried to another instant by an increment, on the rotating Earth, exactly (§2.4, §2.6 of the method).
//!
//! ```text
//! E = Exp(ωT),  G_β = T·J_l(ωT) g,  G_α = T²·Γ₂(ωT) g,  g = g(p_k + ½T v_k),  T signed
//! p_j = p_k + Eᵀ(v_k T + G_α + R_k α)
//! v_j = Eᵀ(v_k + G_β + R_k β) − ω×(p_j − p_k)
//! R_j = Eᵀ R_k γ
//! ```
//!
//! The paper leaves the Earth's rotation out; here it stands in this one place and the preintegration knows nothing of it.
//! Dropped: ω×(ω×Δp) beside gravity, below 3e-7 m/s² within 50 m. In the Jacobians g is held constant.

use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};
use nav_geometry::so3;

use crate::anchor::Anchor;
use crate::anchored::Pose;
use crate::blocks::{product, product_with_skew, skew_product, times, transposed_product, transposed_times};
use crate::preintegration::{CorrectedIncrement, Increment};
use crate::state::{ACCEL_BIAS, ATTITUDE, ERROR_DIM, GYRO_BIAS, NavState, POSITION, VELOCITY};
use crate::world::WorldModel;

/// What gravity and the turning Earth do over a signed time: E, G_α, G_β of the module's equations.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EarthMotion {
    /// E = Exp(ωT).
    pub(crate) turn: Matrix3<f64>,
    /// G_α, m.
    pub(crate) fall: Vector3<f64>,
    /// G_β, m/s.
    pub(crate) fall_velocity: Vector3<f64>,
    /// g, m/s².
    gravity: Vector3<f64>,
}

impl EarthMotion {
    /// Over `dt`, with `gravity` half way.
    #[inline]
    pub(crate) fn over(dt: f64, gravity: Vector3<f64>, world: &WorldModel) -> EarthMotion {
        let [turn, left_jacobian, gamma2] = so3::exp_left_jacobian_and_gamma2(&(world.earth_rate_enu * dt));
        EarthMotion {
            turn,
            fall: times(&gamma2, &gravity) * (dt * dt),
            fall_velocity: times(&left_jacobian, &gravity) * dt,
            gravity,
        }
    }
}

/// Jacobians of [`transport`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TransportJacobians {
    /// T_j = ∂(p_j, v_j, θ_j)/∂δx_k, 9 × 15.
    pub state: SMatrix<f64, 9, ERROR_DIM>,
    /// L = ∂(p_j, v_j, θ_j)/∂(α, β, φ), 9 × 9.
    pub increment: SMatrix<f64, 9, 9>,
}

/// The state at the end of `increment`, which begins (in its own sense of time) at `from`. Biases stay.
#[inline]
pub fn transport(from: &NavState, increment: &Increment, world: &WorldModel) -> NavState {
    let half_way = from.position_enu + from.velocity_enu * (0.5 * increment.dt_total);
    Carried::under(world.gravity.at(&half_way), &from.r_enu_body(), from, increment, world).state(from)
}

/// [`transport`] where more than one increment is followed from a state: its rotation matrix and gravity are not worked out anew.
#[inline]
pub fn transport_from(from: &Anchor, increment: &Increment, world: &WorldModel) -> NavState {
    Carried::new(from, increment, world).state(&from.state)
}

/// A state on its way: what its new place and the rows of a sensor there have in common.
pub(crate) struct Carried<'a> {
    earth: EarthMotion,
    r_enu_body: Matrix3<f64>,
    moved: CorrectedIncrement,
    increment: &'a Increment,
    earth_rate_enu: Vector3<f64>,
}

impl<'a> Carried<'a> {
    #[inline]
    pub(crate) fn new(from: &Anchor, increment: &'a Increment, world: &WorldModel) -> Carried<'a> {
        let gravity = from.gravity_over(increment.dt_total);
        Carried::under(gravity, &from.r_enu_body, &from.state, increment, world)
    }

    #[inline]
    fn under(
        gravity: Vector3<f64>,
        r_enu_body: &Matrix3<f64>,
        from: &NavState,
        increment: &'a Increment,
        world: &WorldModel,
    ) -> Carried<'a> {
        Carried {
            earth: EarthMotion::over(increment.dt_total, gravity, world),
            r_enu_body: *r_enu_body,
            moved: increment.corrected(&from.accel_bias, &from.gyro_bias),
            increment,
            earth_rate_enu: world.earth_rate_enu,
        }
    }

    /// g over the way, m/s².
    pub(crate) fn gravity_enu(&self) -> Vector3<f64> {
        self.earth.gravity
    }

    /// What a sensor sees at the end; `from` is the state of [`Carried::new`].
    #[inline]
    pub(crate) fn pose(&self, from: &NavState) -> Pose {
        let (dt, turn) = (self.increment.dt_total, &self.earth.turn);
        let by_force = times(&self.r_enu_body, &self.moved.alpha);
        let step = transposed_times(turn, &(from.velocity_enu * dt + self.earth.fall + by_force));
        let by_force = times(&self.r_enu_body, &self.moved.beta);
        let velocity = transposed_times(turn, &(from.velocity_enu + self.earth.fall_velocity + by_force));
        Pose {
            position_enu: from.position_enu + step,
            velocity_enu: velocity - self.earth_rate_enu.cross(&step),
            r_enu_body: transposed_product(turn, &product(&self.r_enu_body, &self.moved.gamma)),
            gyro_bias: from.gyro_bias,
        }
    }

    /// The state at the end; `from` is the state of [`Carried::new`].
    #[inline]
    pub(crate) fn state(&self, from: &NavState) -> NavState {
        let Pose { position_enu, velocity_enu, r_enu_body, gyro_bias } = self.pose(from);
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(r_enu_body);
        let mut q_enu_body = UnitQuaternion::from_rotation_matrix(&rotation);
        q_enu_body.renormalize_fast();
        NavState { position_enu, velocity_enu, q_enu_body, accel_bias: from.accel_bias, gyro_bias }
    }

    /// `H·T_j` and `H·L` of a sensor's rows H, from right to left: a tenth of the work of the matrices themselves. Without
    /// `sees_motion` only the columns of the attitude are not zero.
    #[inline(always)]
    pub(crate) fn rows<const ROWS: usize>(
        &self,
        h: &SMatrix<f64, ROWS, 9>,
        sees_motion: bool,
    ) -> (SMatrix<f64, ROWS, ERROR_DIM>, SMatrix<f64, ROWS, 9>) {
        let d = &self.increment.bias_jacobian;
        let turn = &self.earth.turn;
        let mut by_state = SMatrix::<f64, ROWS, ERROR_DIM>::zeros();
        let mut by_increment = SMatrix::<f64, ROWS, 9>::zeros();
        for row in 0..ROWS {
            let part = |at: usize| Vector3::new(h[(row, at)], h[(row, at + 1)], h[(row, at + 2)]);
            let [by_position, by_velocity, by_attitude] = [part(POSITION), part(VELOCITY), part(ATTITUDE)];
            let by_end_rate = transposed_times(&self.moved.right_jacobian, &by_attitude);
            let mut put = |at: usize, values: Vector3<f64>| {
                for axis in 0..3 {
                    by_state[(row, at + axis)] = values[axis];
                }
            };
            for axis in 0..3 {
                by_increment[(row, 6 + axis)] = by_attitude[axis];
            }
            if !sees_motion {
                put(ATTITUDE, times(&self.moved.gamma, &by_attitude));
                put(GYRO_BIAS, transposed_times(&d.phi_gyro, &by_end_rate));
                continue;
            }
            // −(hᵀ[ω]×)ᵀ = ω×h: the velocity loses ω×(p_j − p_k), so a step of position counts that much less.
            let by_step = by_position + self.earth_rate_enu.cross(&by_velocity);
            let (turned_step, turned_velocity) = (times(turn, &by_step), times(turn, &by_velocity));
            let by_alpha = transposed_times(&self.r_enu_body, &turned_step);
            let by_beta = transposed_times(&self.r_enu_body, &turned_velocity);
            put(POSITION, by_position);
            put(VELOCITY, turned_step * self.increment.dt_total + turned_velocity);
            // −(qᵀ[α]×)ᵀ = α×q.
            put(
                ATTITUDE,
                self.moved.alpha.cross(&by_alpha)
                    + self.moved.beta.cross(&by_beta)
                    + times(&self.moved.gamma, &by_attitude),
            );
            put(ACCEL_BIAS, transposed_times(&d.alpha_accel, &by_alpha) + transposed_times(&d.beta_accel, &by_beta));
            put(
                GYRO_BIAS,
                transposed_times(&d.alpha_gyro, &by_alpha)
                    + transposed_times(&d.beta_gyro, &by_beta)
                    + transposed_times(&d.phi_gyro, &by_end_rate),
            );
            for axis in 0..3 {
                by_increment[(row, axis)] = by_alpha[axis];
                by_increment[(row, 3 + axis)] = by_beta[axis];
            }
        }
        (by_state, by_increment)
    }
}

/// Jacobians of [`transport`] at `from` (which may be a linearisation point other than the state that is carried).
#[inline]
pub fn transport_jacobians(from: &NavState, increment: &Increment, world: &WorldModel) -> TransportJacobians {
    let dt = increment.dt_total;
    let turn_back = so3::exp(&(world.earth_rate_enu * -dt));
    let moved = increment.corrected(&from.accel_bias, &from.gyro_bias);
    let d = &increment.bias_jacobian;
    let k = product(&turn_back, &from.r_enu_body());
    let turning = |block: &Matrix3<f64>| skew_product(&world.earth_rate_enu, block);

    let position_by_velocity = turn_back * dt;
    let position_by_attitude = -product_with_skew(&k, &moved.alpha);
    let position_by_accel = product(&k, &d.alpha_accel);
    let position_by_gyro = product(&k, &d.alpha_gyro);
    let mut state = SMatrix::<f64, 9, ERROR_DIM>::zeros();
    let mut put = |row: usize, column: usize, block: Matrix3<f64>| {
        state.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
    };
    put(POSITION, POSITION, Matrix3::identity());
    put(POSITION, VELOCITY, position_by_velocity);
    put(POSITION, ATTITUDE, position_by_attitude);
    put(POSITION, ACCEL_BIAS, position_by_accel);
    put(POSITION, GYRO_BIAS, position_by_gyro);
    put(VELOCITY, VELOCITY, turn_back - turning(&position_by_velocity));
    put(VELOCITY, ATTITUDE, -product_with_skew(&k, &moved.beta) - turning(&position_by_attitude));
    put(VELOCITY, ACCEL_BIAS, product(&k, &d.beta_accel) - turning(&position_by_accel));
    put(VELOCITY, GYRO_BIAS, product(&k, &d.beta_gyro) - turning(&position_by_gyro));
    put(ATTITUDE, ATTITUDE, moved.gamma.transpose());
    put(ATTITUDE, GYRO_BIAS, product(&moved.right_jacobian, &d.phi_gyro));

    let mut increment = SMatrix::<f64, 9, 9>::zeros();
    increment.fixed_view_mut::<3, 3>(0, 0).copy_from(&k);
    increment.fixed_view_mut::<3, 3>(3, 0).copy_from(&-turning(&k));
    increment.fixed_view_mut::<3, 3>(3, 3).copy_from(&k);
    increment.fixed_view_mut::<3, 3>(6, 6).fill_with_identity();
    TransportJacobians { state, increment }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preintegration::Preintegration;
    use crate::testing::{
        assert_jacobians_agree, fingerprint, golden_from, golden_piece, golden_to, numeric_jacobian, random,
        random_increment, random_state, world,
    };
    use approx::assert_relative_eq;
    use nalgebra::SVector;

    #[track_caller]
    fn assert_state(state: &NavState, position: [f64; 3], velocity: [f64; 3], quaternion: [f64; 4]) {
        // 12 digits are printed.
        assert_relative_eq!(state.position_enu, Vector3::from(position), epsilon = 1e-9);
        assert_relative_eq!(state.velocity_enu, Vector3::from(velocity), epsilon = 1e-10);
        for (value, expected) in state.quaternion_wxyz().into_iter().zip(quaternion) {
            assert_relative_eq!(value, expected, epsilon = 1e-11);
        }
    }

    #[test]
    fn golden_numbers_of_the_method_are_met_both_ways() {
        let world = world();
        let whole = golden_piece(&[0.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_state(
            &transport(&golden_from(), &whole, &world),
            [120.732513293, -340.611511656, -54.9272535836],
            [1.39040408178, -1.84338895305, 0.0748754326474],
            [0.868982644415, 0.140579946739, -0.0764826026292, 0.468248709315],
        );
        let forward = golden_piece(&[0.0, 0.1, 0.2, 0.25]);
        assert_state(
            &transport(&golden_from(), &forward, &world),
            [120.373513998, -340.234132575, -54.955847379],
            [1.4760568741, -1.19561374001, 0.150083554927],
            [0.883254615515, 0.120108021155, -0.0673247696767, 0.448221733982],
        );
        let backward = golden_piece(&[0.5, 0.4, 0.3, 0.25]);
        assert_state(
            &transport(&golden_to(), &backward, &world),
            [120.329901458, -340.213533236, -54.9038584335],
            [2.05469852761, -0.213155186321, 0.429358719656],
            [0.890356038083, 0.0295925633011, -0.0825948020018, 0.446730908187],
        );
        let (s, f) = fingerprint(&transport_jacobians(&golden_from(), &forward, &world).state);
        assert_relative_eq!(s, 2.02471737512, max_relative = 1e-10);
        assert_relative_eq!(f, 4.68530480122, max_relative = 1e-10);
        let (s, f) = fingerprint(&transport_jacobians(&golden_to(), &backward, &world).state);
        assert_relative_eq!(s, -0.943755654166, max_relative = 1e-10);
        assert_relative_eq!(f, 4.69865399351, max_relative = 1e-10);
    }

    #[test]
    fn jacobians_agree_with_central_differences_both_ways() {
        let (world, mut rng) = (world(), random(3));
        for trial in 0..20 {
            let state = random_state(&mut rng);
            let increment = random_increment(&mut rng, &state, if trial % 2 == 0 { 1.0 } else { -1.0 });
            let reference = transport(&state, &increment, &world);
            let jacobians = transport_jacobians(&state, &increment, &world);
            let numeric = numeric_jacobian(1e-3, |delta: &SVector<f64, ERROR_DIM>| {
                transport(&state.retract(delta), &increment, &world).local(&reference).fixed_rows::<9>(0).into_owned()
            });
            // Gravity is held constant: 3.1e-6 T in velocity by position, half of it T² in position.
            assert_jacobians_agree(&jacobians.state, &numeric, 4e-6);
            let numeric = numeric_jacobian(1e-3, |delta: &SVector<f64, 9>| {
                let mut moved = increment;
                moved.alpha += delta.fixed_rows::<3>(0);
                moved.beta += delta.fixed_rows::<3>(3);
                moved.gamma = perturbed_gamma(&increment, &state, &delta.fixed_rows::<3>(6).into_owned());
                transport(&state, &moved, &world).local(&reference).fixed_rows::<9>(0).into_owned()
            });
            assert_jacobians_agree(&jacobians.increment, &numeric, 1e-9);
        }
    }

    #[test]
    fn from_an_anchor_it_is_the_same() {
        let (world, mut rng) = (world(), random(12));
        for trial in 0..20 {
            let state = random_state(&mut rng);
            let increment = random_increment(&mut rng, &state, if trial % 2 == 0 { 1.0 } else { -1.0 });
            let from_anchor = transport_from(&Anchor::new(&state, &world), &increment, &world);
            let off = from_anchor.local(&transport(&state, &increment, &world)).norm();
            assert!(off < 1e-9, "{off:e}");
        }
    }

    #[test]
    fn rows_carried_from_right_to_left_equal_the_product_of_the_matrices() {
        let (world, mut rng) = (world(), random(11));
        for trial in 0..20 {
            let state = random_state(&mut rng);
            let increment = random_increment(&mut rng, &state, if trial % 2 == 0 { 1.0 } else { -1.0 });
            let h = SMatrix::<f64, 3, 9>::from_fn(|i, j| ((7 * i + j + trial) as f64).sin());
            let (by_state, by_increment) =
                Carried::new(&Anchor::new(&state, &world), &increment, &world).rows(&h, true);
            let matrices = transport_jacobians(&state, &increment, &world);
            assert_relative_eq!(by_state, h * matrices.state, epsilon = 1e-13);
            assert_relative_eq!(by_increment, h * matrices.increment, epsilon = 1e-13);
        }
    }

    /// γ such that the corrected γ is turned by `phi` on its right.
    fn perturbed_gamma(increment: &Increment, state: &NavState, phi: &Vector3<f64>) -> Matrix3<f64> {
        let turn = so3::exp(&increment.corrected(&state.accel_bias, &state.gyro_bias).c);
        increment.gamma * turn * so3::exp(phi) * turn.transpose()
    }

    #[test]
    fn there_and_back_again_is_no_move() {
        let (world, mut rng) = (world(), random(4));
        for _ in 0..10 {
            let state = random_state(&mut rng);
            let increment = random_increment(&mut rng, &state, 1.0);
            // At the biases of the run; elsewhere the first-order corrections differ by their second order.
            let state = NavState { accel_bias: increment.accel_bias, gyro_bias: increment.gyro_bias, ..state };
            let back = transport(&transport(&state, &increment, &world), &increment.reversed(), &world);
            // Gravity is evaluated at the two guesses of the middle, p_k + ½Tv_k and p_e − ½Tv_e: some metres apart.
            assert!(
                (back.position_enu - state.position_enu).norm() < 1e-5,
                "{:e}",
                back.position_enu - state.position_enu
            );
            assert!(back.q_enu_body.angle_to(&state.q_enu_body) < 1e-12);
        }
    }

    #[test]
    fn a_vehicle_at_rest_on_the_turning_earth_stays_at_rest() {
        let world = world();
        let rest = NavState { position_enu: Vector3::new(30.0, 40.0, -20.0), ..NavState::identity() };
        let point = crate::preintegration::ImuPoint {
            gyro_body: world.earth_rate_enu,
            accel_body: -world.gravity.at(&rest.position_enu),
        };
        let mut increment = Preintegration::new(Vector3::zeros(), Vector3::zeros());
        for _ in 0..2000 {
            increment.step_mean(0.005, &point, &point);
        }
        let moved = transport(&rest, &increment, &world).local(&rest);
        // The midpoint rule leaves ω f dt³/12 in position per step: 1.2e-8 m in 10 s.
        assert!(moved.norm() < 2e-8, "{:e} after 10 s", moved.norm());
    }
}
