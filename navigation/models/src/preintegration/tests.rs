//! Golden numbers of §8.3, closed-form motions, and the sample covariance of seeded noisy runs.

use approx::assert_relative_eq;
use nalgebra::{SMatrix, SVector, UnitQuaternion};
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::inertial::ImuWeight;
use crate::testing::{
    assert_jacobians_agree, fingerprint, golden_piece, noise, numeric_jacobian, random, random_increment, random_state,
    random_vector,
};

const FORWARD: [f64; 6] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
const BACKWARD: [f64; 6] = [0.5, 0.4, 0.3, 0.2, 0.1, 0.0];
const FORWARD_HALF: [f64; 4] = [0.0, 0.1, 0.2, 0.25];
const BACKWARD_HALF: [f64; 4] = [0.5, 0.4, 0.3, 0.25];

struct Golden {
    alpha: [f64; 3],
    beta: [f64; 3],
    gamma: [f64; 4],
    d: (f64, f64),
    p: (f64, f64),
}

fn check(piece: &Preintegration, golden: &Golden) {
    let relative = 2e-11;
    assert_relative_eq!(piece.alpha, Vector3::from(golden.alpha), max_relative = relative);
    assert_relative_eq!(piece.beta, Vector3::from(golden.beta), max_relative = relative);
    let q = quaternion_of(&piece.gamma);
    for (value, expected) in [q.w, q.i, q.j, q.k].into_iter().zip(golden.gamma) {
        assert_relative_eq!(value, expected, max_relative = relative);
    }
    let (s, f) = fingerprint(&piece.jacobian());
    assert_relative_eq!(s, golden.d.0, max_relative = 1e-10);
    assert_relative_eq!(f, golden.d.1, max_relative = 1e-10);
    let (s, f) = fingerprint(&(piece.covariance() * 1e9));
    assert_relative_eq!(s, golden.p.0, max_relative = 1e-10);
    assert_relative_eq!(f, golden.p.1, max_relative = 1e-10);
}

fn quaternion_of(rotation: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(*rotation))
}

#[test]
fn golden_numbers_of_the_forward_run_are_met() {
    let piece = golden_piece(&FORWARD);
    check(
        &piece,
        &Golden {
            alpha: [0.00228271208529, 0.0147325252208, 1.22601562318],
            beta: [-0.0918756887415, 0.0260320796123, 4.91023012189],
            gamma: [0.997174345815, 0.0309692149531, -0.0376641278042, 0.0571458244396],
            d: (-0.844115474734, 2.15809966103),
            p: (-377.847402907, 925.195212594),
        },
    );
    let d = piece.jacobian();
    let rows = [
        (0, 3, [-0.00739172403332, -0.208547699121, 0.00419710029222]),
        (3, 0, [-0.498142703742, 0.0318924598591, 0.0202665650284]),
        (6, 3, [-0.498668329414, -0.0251277138432, -0.0174623216585]),
    ];
    for (row, column, golden) in rows {
        for (offset, expected) in golden.into_iter().enumerate() {
            assert_relative_eq!(d[(row, column + offset)], expected, max_relative = 1e-10);
        }
    }
    let p = piece.covariance();
    let sigmas = [
        (0, 0.000203387002782),
        (3, 0.000709405471318),
        (6, 2.05054403435e-5),
        (9, 7.07106781187e-7),
        (12, 7.07106781187e-8),
    ];
    for (index, expected) in sigmas {
        assert_relative_eq!(p[(index, index)].sqrt(), expected, max_relative = 1e-10);
    }
    assert_relative_eq!(p[(0, 7)], 1.74043746472e-10, max_relative = 1e-10);
    assert_relative_eq!(p[(6, 12)], -9.99091176493e-16, max_relative = 1e-10);
}

#[test]
fn golden_numbers_of_the_backward_run_are_met() {
    let piece = golden_piece(&BACKWARD);
    check(
        &piece,
        &Golden {
            alpha: [0.0487143008949, 0.0745286218411, 1.22681946419],
            beta: [-0.298104948527, -0.318632936015, -4.89173641492],
            gamma: [0.997174345815, -0.0309692149531, 0.0376641278042, -0.0571458244396],
            d: (-1.22799723122, 2.15313550458),
            p: (-369.185548081, 925.179678603),
        },
    );
    assert_relative_eq!(piece.covariance()[(6, 12)], 9.98344203552e-16, max_relative = 1e-10);
}

#[test]
fn golden_numbers_of_the_halves_are_met() {
    check(
        &golden_piece(&FORWARD_HALF),
        &Golden {
            alpha: [0.00725876202698, 0.00552199349676, 0.306040068018],
            beta: [0.0329308578263, 0.0388381015171, 2.45034853638],
            gamma: [0.999107543127, 0.0139332769801, -0.0220846742638, 0.0332001238129],
            d: (-0.19371322374, 0.753209900323),
            p: (-202.900709394, 440.213659079),
        },
    );
    check(
        &golden_piece(&BACKWARD_HALF),
        &Golden {
            alpha: [0.00590498570143, 0.0170532089189, 0.307609584924],
            beta: [-0.0682950015994, -0.143286623802, -2.45799891419],
            gamma: [0.999444961701, -0.0170593282743, 0.0158383016236, -0.0238305696564],
            d: (-0.327676175142, 0.753993116898),
            p: (-200.630532164, 440.247808653),
        },
    );
}

#[test]
fn the_mean_alone_is_the_same_mean() {
    let whole = golden_piece(&FORWARD);
    let mut mean = Preintegration::new(whole.accel_bias, whole.gyro_bias);
    for pair in FORWARD.windows(2) {
        let (first, second) = (pair[0] * 10.0, pair[1] * 10.0);
        mean.step_mean(
            pair[1] - pair[0],
            &crate::testing::golden_sample(first),
            &crate::testing::golden_sample(second),
        );
    }
    assert_eq!(
        (mean.alpha, mean.beta, mean.gamma, mean.dt_total),
        (whole.alpha, whole.beta, whole.gamma, whole.dt_total)
    );
}

/// (α, β, φ) of `piece` against `reference`.
fn difference(piece: &Preintegration, reference: &Preintegration) -> SVector<f64, 9> {
    let mut all = SVector::<f64, 9>::zeros();
    all.fixed_rows_mut::<3>(0).copy_from(&(piece.alpha - reference.alpha));
    all.fixed_rows_mut::<3>(3).copy_from(&(piece.beta - reference.beta));
    all.fixed_rows_mut::<3>(6).copy_from(&so3::log(&reference.gamma.tr_mul(&piece.gamma)));
    all
}

fn turning_samples(seed: u64, count: usize) -> Vec<ImuPoint> {
    let mut rng = random(seed);
    let (gyro, accel) = (random_vector(&mut rng, 0.6), random_vector(&mut rng, 2.0) + Vector3::z() * 9.8);
    let wave = random_vector(&mut rng, 0.4);
    (0..count)
        .map(|i| {
            let phase = i as f64 * 0.05;
            ImuPoint { gyro_body: gyro + wave * phase.sin(), accel_body: accel + wave * phase.cos() }
        })
        .collect()
}

fn run(samples: &[ImuPoint], dt: f64, accel_bias: Vector3<f64>, gyro_bias: Vector3<f64>) -> Preintegration {
    let mut piece = Preintegration::new(accel_bias, gyro_bias);
    for pair in samples.windows(2) {
        piece.step(&noise(), dt, &pair[0], &pair[1], Inflation::NONE);
    }
    piece
}

#[test]
fn bias_jacobians_agree_with_reintegration_both_ways() {
    for (seed, dt) in [(1, 0.005), (2, -0.005), (3, 0.02), (4, -0.02)] {
        let samples = turning_samples(seed, 60);
        let (accel_bias, gyro_bias) = (Vector3::new(0.01, -0.02, 0.03), Vector3::new(0.001, 0.002, -0.003));
        let reference = run(&samples, dt, accel_bias, gyro_bias);
        let numeric = numeric_jacobian(1e-3, |delta: &SVector<f64, 6>| {
            let moved = run(&samples, dt, accel_bias + delta.fixed_rows::<3>(0), gyro_bias + delta.fixed_rows::<3>(3));
            difference(&moved, &reference)
        });
        assert_jacobians_agree(&reference.jacobian(), &numeric, 1e-10);
    }
}

#[test]
fn corrected_increments_follow_the_biases_to_first_order_and_say_when_they_no_longer_do() {
    let samples = turning_samples(9, 200);
    let reference = run(&samples, 0.005, Vector3::zeros(), Vector3::zeros());
    let (accel_bias, gyro_bias) = (Vector3::new(2e-3, -1e-3, 1e-3), Vector3::new(1e-4, -2e-4, 1e-4));
    let moved = run(&samples, 0.005, accel_bias, gyro_bias);
    let corrected = reference.corrected(&accel_bias, &gyro_bias);
    // What is left is of second order: |δb_g|²T² f ≈ 6e-7.
    assert_relative_eq!(corrected.alpha, moved.alpha, epsilon = 6e-7);
    assert_relative_eq!(corrected.beta, moved.beta, epsilon = 1e-6);
    assert_relative_eq!(corrected.gamma, moved.gamma, epsilon = 1e-7);
    assert!(!reference.needs_reintegration(&accel_bias, &gyro_bias));
    assert!(reference.needs_reintegration(&accel_bias, &Vector3::new(0.0, 1.2e-3, 0.0)));
    assert!(reference.needs_reintegration(&Vector3::new(0.06, 0.0, 0.0), &gyro_bias));
}

#[test]
fn running_back_is_the_inverse_of_running_forth() {
    let samples = turning_samples(5, 201);
    let forth = run(&samples, 0.005, Vector3::new(0.01, 0.0, -0.01), Vector3::zeros());
    let turned: Vec<ImuPoint> = samples.iter().rev().copied().collect();
    let back = run(&turned, -0.005, Vector3::new(0.01, 0.0, -0.01), Vector3::zeros());
    let reversed = forth.reversed();
    assert_relative_eq!(reversed.alpha, back.alpha, epsilon = 1e-13);
    assert_relative_eq!(reversed.beta, back.beta, epsilon = 1e-13);
    assert_relative_eq!(reversed.gamma, back.gamma, epsilon = 1e-13);
    assert_relative_eq!(reversed.jacobian(), back.jacobian(), epsilon = 1e-12);
    // The walk steps at the end of a sample one way and at its start the other way; all else is equal.
    assert_covariances_agree(&reversed, &back, 3e-5);
    assert_covariances_agree(&reversed.reversed(), &forth, 1e-9);
}

/// Entries against the product of their sigmas.
#[track_caller]
fn assert_covariances_agree(one: &Preintegration, other: &Preintegration, tolerance: f64) {
    let (p, q) = (one.covariance(), other.covariance());
    for row in 0..15 {
        for column in 0..15 {
            let scale = (q[(row, row)] * q[(column, column)]).sqrt();
            let error = (p[(row, column)] - q[(row, column)]).abs() / scale;
            assert!(error <= tolerance, "({row}, {column}): {} and {}, {error:e}", p[(row, column)], q[(row, column)]);
        }
    }
}

#[test]
fn pieces_put_together_are_the_whole_and_taken_apart_are_the_pieces() {
    for dt in [0.005, -0.005] {
        let samples = turning_samples(6, 201);
        let biases = (Vector3::new(0.01, 0.0, -0.01), Vector3::new(1e-3, 0.0, 0.0));
        let whole = run(&samples, dt, biases.0, biases.1);
        let first = run(&samples[..=73], dt, biases.0, biases.1);
        let second = run(&samples[73..], dt, biases.0, biases.1);
        for (made, expected) in
            [(first.compose(&second), whole), (Preintegration::piece_from_prefixes(&first, &whole), second)]
        {
            assert_relative_eq!(made.dt_total, expected.dt_total, epsilon = 1e-14);
            assert_relative_eq!(made.alpha, expected.alpha, epsilon = 1e-13);
            assert_relative_eq!(made.beta, expected.beta, epsilon = 1e-13);
            assert_relative_eq!(made.gamma, expected.gamma, epsilon = 1e-13);
            assert_relative_eq!(made.jacobian(), expected.jacobian(), epsilon = 1e-12);
            assert_covariances_agree(&made, &expected, 1e-9);
        }
    }
}

#[test]
fn at_rest_the_force_adds_up_and_nothing_turns() {
    let point = ImuPoint { gyro_body: Vector3::zeros(), accel_body: Vector3::new(0.0, 0.0, 9.8) };
    let piece = run(&vec![point; 201], 0.005, Vector3::zeros(), Vector3::zeros());
    assert_relative_eq!(piece.alpha, Vector3::new(0.0, 0.0, 4.9), epsilon = 1e-12);
    assert_relative_eq!(piece.beta, Vector3::new(0.0, 0.0, 9.8), epsilon = 1e-12);
    assert_eq!(piece.gamma, Matrix3::identity());
    // ∫∫ of white noise: σ²T³/3 (from below, as the midpoint is a sum), and σ²T.
    let p = piece.covariance();
    assert_relative_eq!(p[(2, 2)], 1e-6 / 3.0, max_relative = 2e-4);
    // and the walk of the bias, σ_ba²T³/3.
    assert_relative_eq!(p[(5, 5)], 1e-6 + 1e-12 / 3.0, max_relative = 1e-7);
}

#[test]
fn a_constant_turn_has_its_closed_form_both_ways() {
    // Turning at ω about z with a force fixed in the body: β = R-turned force integrated, α its integral.
    let (rate, force) = (0.7, Vector3::new(1.0, 0.5, 9.8));
    let point = ImuPoint { gyro_body: Vector3::new(0.0, 0.0, rate), accel_body: force };
    for direction in [1.0, -1.0] {
        let piece = run(&vec![point; 401], 0.0025 * direction, Vector3::zeros(), Vector3::zeros());
        let angle = Vector3::new(0.0, 0.0, rate * direction);
        assert_relative_eq!(piece.gamma, so3::exp(&angle), epsilon = 1e-12);
        assert_relative_eq!(piece.beta, so3::left_jacobian(&angle) * force * direction, epsilon = 1e-6);
        assert_relative_eq!(piece.alpha, so3::gamma2(&angle) * force, epsilon = 1e-6);
    }
}

#[test]
fn inflated_noise_grows_the_covariance_and_not_the_mean() {
    let samples = turning_samples(8, 2);
    let (mut plain, mut inflated) = (
        Preintegration::new(Vector3::zeros(), Vector3::zeros()),
        Preintegration::new(Vector3::zeros(), Vector3::zeros()),
    );
    // Without the walks of the biases, which go on as they are.
    let white = ImuNoise { accel_bias_random_walk: 0.0, gyro_bias_random_walk: 0.0, ..noise() };
    let at = |step: u32| ImuPoint::interpolate(&samples[0], &samples[1], f64::from(step) / f64::from(BRIDGE_STEPS));
    for step in 0..BRIDGE_STEPS {
        plain.step(&white, 0.05 / f64::from(BRIDGE_STEPS), &at(step), &at(step + 1), Inflation::NONE);
    }
    let tenfold = Inflation { force: 10.0, rate: 10.0 };
    inflated.step(&white, 0.05, &samples[0], &samples[1], tenfold);
    assert_eq!(plain.increment, inflated.increment);
    assert_relative_eq!(plain.increment_covariance() * 100.0, inflated.increment_covariance(), max_relative = 1e-12);
    let mut walking = Preintegration::new(Vector3::zeros(), Vector3::zeros());
    walking.step(&noise(), 0.05, &samples[0], &samples[1], tenfold);
    let walks = [noise().accel_bias_random_walk, noise().gyro_bias_random_walk];
    for (found, walk) in walking.bias_walk().into_iter().zip(walks) {
        assert_relative_eq!(found, 0.05 * walk * walk, max_relative = 1e-12);
    }
}

#[test]
fn the_covariance_over_a_gap_is_that_of_white_noise_and_can_be_inverted() {
    let held = ImuPoint { accel_body: Vector3::new(0.0, 0.0, 9.8), ..ImuPoint::default() };
    let noise = noise();
    let inflation = Inflation { force: 300.0, rate: 700.0 };
    for (from, gap) in [(0.0, 0.7), (0.0, -0.7), (0.0, 0.03), (0.005, 2.0)] {
        let mut bridged = Preintegration::new(Vector3::zeros(), Vector3::zeros());
        bridged.step(&noise, from, &held, &held, Inflation::NONE);
        bridged.step(&noise, gap, &held, &held, inflation);
        // Of ∫n, ∫∫n over T: qT, qT²/2, qT³/3; horizontally gravity goes with the tilt. Upwards the forces are alone.
        let q = (noise.accel_noise_density * inflation.force).powi(2);
        let p = bridged.increment_covariance();
        let t: f64 = gap;
        for (row, column, expected) in
            [(2, 2, q * t.abs().powi(3) / 3.0), (2, 5, q * t * t.abs() / 2.0), (5, 5, q * t.abs())]
        {
            assert_relative_eq!(p[(row, column)], expected, max_relative = if from == 0.0 { 2e-3 } else { 1e-2 });
        }
        let weight = ImuWeight::new(&bridged).expect("it can be inverted");
        let p15 = bridged.covariance();
        for axis in 0..9 {
            let known_of_the_rest = 1.0 / (weight.whitener.column(axis).norm_squared() * p15[(axis, axis)]);
            assert!((1e-4..=1.0).contains(&known_of_the_rest), "{gap} s, axis {axis}: {known_of_the_rest:e}");
        }
    }
}

#[test]
fn an_increment_of_one_step_has_no_weight_whatever_rounding_makes_of_it() {
    for seed in 0..200 {
        let samples = turning_samples(seed, 2);
        let mut single = Preintegration::new(Vector3::zeros(), Vector3::zeros());
        single.step(&noise(), 0.005 * (1.0 + (seed % 40) as f64), &samples[0], &samples[1], Inflation::NONE);
        assert!(ImuWeight::new(&single).is_err(), "seed {seed}");
    }
}

/// Runs of noisy samples against the noise-free run; the error is true minus computed, counted from the bias at the start
/// of the run in its own sense of time.
fn sample_covariance(direction: f64, runs: usize, seed: u64) -> (SMatrix<f64, 15, 15>, SMatrix<f64, 15, 15>) {
    let dt = 0.01 * direction;
    // Walks large enough to show in the cross terms.
    let noise = ImuNoise {
        gyro_noise_density: 1e-3,
        accel_noise_density: 1e-2,
        gyro_bias_random_walk: 2e-3,
        accel_bias_random_walk: 2e-2,
        ..noise()
    };
    let samples = turning_samples(21, 101);
    let mut truth = Preintegration::new(Vector3::zeros(), Vector3::zeros());
    for pair in samples.windows(2) {
        truth.step(&noise, dt, &pair[0], &pair[1], Inflation::NONE);
    }
    let mut rng = random(seed);
    let mut normal = |scale: f64| -> Vector3<f64> {
        Vector3::from_fn(|_, _| {
            let value: f64 = StandardNormal.sample(&mut rng);
            value * scale
        })
    };
    let root_dt = dt.abs().sqrt();
    let mut sum = SMatrix::<f64, 15, 15>::zeros();
    for _ in 0..runs {
        let (mut accel_bias, mut gyro_bias) = (Vector3::zeros(), Vector3::zeros());
        let mut computed = Preintegration::new(Vector3::zeros(), Vector3::zeros());
        for pair in samples.windows(2) {
            // White noise averaged over the step, the same at both its ends.
            let gyro_error = gyro_bias + normal(noise.gyro_noise_density / root_dt);
            let accel_error = accel_bias + normal(noise.accel_noise_density / root_dt);
            let noisy = |point: &ImuPoint| ImuPoint {
                gyro_body: point.gyro_body + gyro_error,
                accel_body: point.accel_body + accel_error,
            };
            computed.step_mean(dt, &noisy(&pair[0]), &noisy(&pair[1]));
            accel_bias += normal(noise.accel_bias_random_walk * root_dt);
            gyro_bias += normal(noise.gyro_bias_random_walk * root_dt);
        }
        let mut error = SVector::<f64, 15>::zeros();
        error.fixed_rows_mut::<9>(0).copy_from(&difference(&truth, &computed));
        error.fixed_rows_mut::<3>(9).copy_from(&accel_bias);
        error.fixed_rows_mut::<3>(12).copy_from(&gyro_bias);
        sum += error * error.transpose();
    }
    (truth.covariance(), sum / runs as f64)
}

#[test]
fn the_covariance_is_that_of_noisy_runs_both_ways() {
    const RUNS: usize = 1500;
    for (direction, seed) in [(1.0, 31), (-1.0, 32)] {
        let (claimed, sampled) = sample_covariance(direction, RUNS, seed);
        for row in 0..15 {
            for column in 0..=row {
                let scale = (claimed[(row, row)] * claimed[(column, column)]).sqrt();
                let correlation = claimed[(row, column)] / scale;
                let error = (sampled[(row, column)] - claimed[(row, column)]) / scale;
                // Variance of a sample covariance: (1 + ρ²)/n; 120 entries a run, so four sigmas.
                let bound = 4.0 * ((1.0 + correlation * correlation) / RUNS as f64).sqrt();
                assert!(error.abs() < bound, "direction {direction}, ({row}, {column}): off by {error:.4}, {bound:.4}");
            }
        }
    }
}

#[test]
fn rows_see_the_noise_of_a_backward_piece_without_its_covariance() {
    let samples = turning_samples(8, 201);
    let biases = (Vector3::new(0.01, 0.0, -0.01), Vector3::new(1e-3, 0.0, 0.0));
    let whole = run(&samples, 0.005, biases.0, biases.1);
    let by_all = SMatrix::<f64, 3, 9>::from_fn(|i, j| ((3 * i + 2 * j) as f64).sin());
    let mut by_attitude = by_all;
    by_attitude.fixed_columns_mut::<6>(0).fill(0.0);
    let by_gyro = Some(SMatrix::<f64, 3, 3>::from_fn(|i, j| ((5 * i + j) as f64).cos()));
    for (split, by_gyro, sees_motion) in
        [(1, by_gyro, true), (73, by_gyro, true), (150, None, true), (150, None, false), (199, by_gyro, false)]
    {
        let by_increment = if sees_motion { by_all } else { by_attitude };
        let prefix = run(&samples[..=split], 0.005, biases.0, biases.1);
        let mut q = SMatrix::<f64, 3, 15>::zeros();
        q.fixed_columns_mut::<9>(0).copy_from(&by_increment);
        if let Some(by_gyro) = by_gyro {
            q.fixed_columns_mut::<3>(12).copy_from(&by_gyro);
        }
        let rows = NoiseRows { by_increment, by_gyro, sees_motion };
        let back = Preintegration::piece_from_prefixes(&prefix, &whole).reversed();
        let mut room = Turned::default();
        let piece = Piece::backward(&prefix, &whole, &mut room);
        assert_eq!(*piece.increment(), back.increment);
        for (piece, oracle) in [(piece, back), (Piece::Forward(&prefix), prefix)] {
            let expected = q * oracle.covariance() * q.transpose();
            let scale = expected.diagonal().amax();
            assert!(
                (piece.noise(&rows) - expected).amax() < 1e-9 * scale,
                "{split}: {} {expected}",
                piece.noise(&rows)
            );
        }
    }
}

#[test]
fn random_increments_have_positive_definite_covariances() {
    let mut rng = random(77);
    for direction in [1.0, -1.0] {
        let state = random_state(&mut rng);
        let increment = random_increment(&mut rng, &state, direction);
        assert!(increment.covariance().cholesky().is_some());
        assert!(increment.reversed().covariance().cholesky().is_some());
    }
}

#[test]
fn the_same_bits_with_and_without_wide_instructions() {
    let mut rng = random(5);
    let (noise, mut narrow) =
        (noise(), Preintegration::new(random_vector(&mut rng, 0.1), random_vector(&mut rng, 0.01)));
    let mut wider = narrow;
    for _ in 0..50 {
        let mut point =
            || ImuPoint { accel_body: random_vector(&mut rng, 10.0), gyro_body: random_vector(&mut rng, 1.0) };
        let (first, second) = (point(), point());
        narrow.step_wide(&noise, 0.005, &first, &second, Inflation::NONE);
        wider.step(&noise, 0.005, &first, &second, Inflation::NONE);
    }
    let bits = |piece: &Preintegration| -> Vec<u64> {
        let (mean, covariance, jacobian) = (piece.alpha, piece.covariance(), piece.jacobian());
        mean.iter().chain(covariance.iter()).chain(jacobian.iter()).map(|value| value.to_bits()).collect()
    };
    assert_eq!(bits(&wider), bits(&narrow));
}
