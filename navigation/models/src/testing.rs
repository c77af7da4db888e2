//! What the tests of this crate share: the golden case of the method (§8.3 to §8.5) and random states.

use crate::anchor::Anchor;
use crate::gaps::Inflation;
use nalgebra::{Quaternion, SVector, UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, GravityModel, LocalFrame};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use shared_types::ImuNoise;

use crate::anchored::{Anchored, Pose, SensorModel};
use crate::preintegration::{ImuPoint, Preintegration};
use crate::state::{ERROR_DIM, NavState};
use crate::world::WorldModel;

pub(crate) use nav_geometry::testing::{assert_jacobians_agree, fingerprint, numeric_jacobian};

pub(crate) fn random(seed: u64) -> Pcg64 {
    Pcg64::seed_from_u64(seed)
}

/// The world of the golden numbers.
pub(crate) fn world() -> WorldModel {
    let frame = LocalFrame::new(Geodetic::from_degrees(36.38, 127.36, 0.0));
    WorldModel { frame, gravity: GravityModel::new(frame, None), earth_rate_enu: frame.earth_rate_enu() }
}

pub(crate) fn noise() -> ImuNoise {
    ImuNoise {
        gyro_noise_density: 2.9e-5,
        accel_noise_density: 1e-3,
        gyro_bias_random_walk: 1e-7,
        accel_bias_random_walk: 1e-6,
        gyro_bias_sigma: 1e-4,
        accel_bias_sigma: 1e-3,
    }
}

pub(crate) const GOLDEN_ACCEL_BIAS: Vector3<f64> = Vector3::new(0.01, -0.02, 0.03);
pub(crate) const GOLDEN_GYRO_BIAS: Vector3<f64> = Vector3::new(0.001, 0.002, -0.003);

/// Sample of §8.3 at s = 0.1·i; between samples on the straight line.
pub(crate) fn golden_sample(i: f64) -> ImuPoint {
    ImuPoint {
        gyro_body: Vector3::new(0.1, -0.2, 0.3) + Vector3::new(0.01, 0.02, -0.03) * i,
        accel_body: Vector3::new(0.5, 0.2, 9.8) + Vector3::new(-0.1, 0.05, 0.02) * i,
    }
}

/// Runs through the golden samples at these times, s.
pub(crate) fn golden_piece(times: &[f64]) -> Preintegration {
    let mut piece = Preintegration::new(GOLDEN_ACCEL_BIAS, GOLDEN_GYRO_BIAS);
    for pair in times.windows(2) {
        let (first, second) = (golden_sample(pair[0] * 10.0), golden_sample(pair[1] * 10.0));
        piece.step(&noise(), pair[1] - pair[0], &first, &second, Inflation::NONE);
    }
    piece
}

fn quaternion(w: f64, x: f64, y: f64, z: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
}

/// x_k of §8.4.
pub(crate) fn golden_from() -> NavState {
    NavState {
        position_enu: Vector3::new(120.0, -340.0, -55.0),
        velocity_enu: Vector3::new(1.5, -0.7, 0.2),
        q_enu_body: quaternion(0.9, 0.1, -0.05, 0.42),
        accel_bias: GOLDEN_ACCEL_BIAS + Vector3::new(0.002, -0.001, 0.0015),
        gyro_bias: GOLDEN_GYRO_BIAS + Vector3::new(1e-4, -2e-4, 1.5e-4),
    }
}

/// x_e of §8.4.
pub(crate) fn golden_to() -> NavState {
    NavState {
        position_enu: Vector3::new(120.8, -340.3, -54.8),
        velocity_enu: Vector3::new(1.7, -0.5, 0.4),
        q_enu_body: quaternion(0.88, 0.05, -0.09, 0.47),
        accel_bias: golden_from().accel_bias + Vector3::new(5e-4, 0.0, -5e-4),
        gyro_bias: golden_from().gyro_bias + Vector3::new(0.0, 1e-4, 0.0),
    }
}

pub(crate) fn random_vector(rng: &mut impl Rng, scale: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-scale..scale))
}

/// Tilted, moving, biased, a few hundred metres from the origin.
pub(crate) fn random_state(rng: &mut impl Rng) -> NavState {
    NavState {
        position_enu: random_vector(rng, 300.0),
        velocity_enu: random_vector(rng, 2.0),
        q_enu_body: UnitQuaternion::new(random_vector(rng, 1.2)),
        accel_bias: random_vector(rng, 0.02),
        gyro_bias: random_vector(rng, 2e-3),
    }
}

/// A second of turning, accelerating samples at 200 Hz near these biases; `direction` −1 runs backward.
pub(crate) fn random_increment(rng: &mut impl Rng, near: &NavState, direction: f64) -> Preintegration {
    let mut increment =
        Preintegration::new(near.accel_bias + random_vector(rng, 2e-3), near.gyro_bias + random_vector(rng, 2e-4));
    let (gyro, accel) = (random_vector(rng, 0.5), random_vector(rng, 3.0) + Vector3::new(0.0, 0.0, 9.8));
    let (gyro_wave, accel_wave) = (random_vector(rng, 0.3), random_vector(rng, 1.0));
    let at = |step: u32| {
        let phase = f64::from(step) * 0.03;
        ImuPoint { gyro_body: gyro + gyro_wave * phase.sin(), accel_body: accel + accel_wave * phase.cos() }
    };
    for step in 0..200 {
        increment.step(&noise(), 0.005 * direction, &at(step), &at(step + 1), Inflation::NONE);
    }
    increment
}

/// Holds the whole 15-column Jacobian of an anchored reading against central differences, at random states, forward and
/// backward, with linearisation away from the biases of the increment.
pub(crate) fn check_anchored_jacobian<const ROWS: usize, M: SensorModel<ROWS>>(
    seed: u64,
    tolerance: f64,
    model_at: impl Fn(&NavState) -> M,
) {
    check_anchored_jacobian_where(seed, tolerance, |state| Some(model_at(state)));
}

/// [`check_anchored_jacobian`] at those states of which the sensor has something to say.
pub(crate) fn check_anchored_jacobian_where<const ROWS: usize, M: SensorModel<ROWS>>(
    seed: u64,
    tolerance: f64,
    model_at: impl Fn(&NavState) -> Option<M>,
) {
    let (world, mut rng) = (world(), random(seed));
    let mut checked = 0;
    for trial in 0..20 {
        let state = random_state(&mut rng);
        let increment = random_increment(&mut rng, &state, if trial % 2 == 0 { 1.0 } else { -1.0 });
        let Some(model) = model_at(&crate::transport::transport(&state, &increment, &world)) else { continue };
        let analytic = Anchored::new(&model, &Anchor::new(&state, &world), &increment, &world).jacobian;
        let numeric = numeric_jacobian(1e-3, |delta: &SVector<f64, ERROR_DIM>| {
            let moved = state.retract(delta);
            model.see(&Pose::from(&crate::transport::transport(&moved, &increment, &world)), &world).residual
        });
        assert_jacobians_agree(&analytic, &numeric, tolerance);
        checked += 1;
    }
    assert!(checked >= 10, "only {checked} states were checked");
}

/// A converged solution with every sensor just used.
pub(crate) fn solution(
    state: &NavState,
    covariance: &nalgebra::SMatrix<f64, ERROR_DIM, ERROR_DIM>,
    t_keyframe: shared_types::Time,
) -> shared_types::Solution {
    let mut solution = shared_types::Solution {
        header: shared_types::Header::at(t_keyframe),
        id: 7,
        t_keyframe: t_keyframe.0,
        origin: world().frame.origin().to_degrees(),
        t_last_used: [t_keyframe.0; 5],
        keyframes: 1,
        iterations: 1,
        linearised: 1,
        status: shared_types::SolutionStatus::Converged as u32,
        ..shared_types::Solution::empty()
    };
    state.write_solution(covariance, &mut solution);
    solution
}
