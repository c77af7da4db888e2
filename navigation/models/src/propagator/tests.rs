//! The estimate is a function of solution and samples; modes, gaps and bad input.

use crate::gaps::Inflation;
use approx::assert_relative_eq;
use nalgebra::SVector;
use shared_types::Duration;

use super::*;
use crate::testing::{solution, world};
use crate::transport::transport;
use crate::transport::transport_jacobians;

fn config() -> Config {
    Config::default()
}

/// A turning, accelerating vehicle, sampled at 200 Hz.
fn sample(index: i64) -> ImuSample {
    let t = Time(index * 5_000_000);
    let phase = t.as_seconds();
    ImuSample {
        header: Header { sequence: index as u64, t_arrival: 17 + index, ..Header::at(t) },
        gyro_body: [0.02 * phase.sin(), -0.01, 0.1 * phase.cos()],
        accel_body: [0.3 * phase.cos(), 0.1, 9.8 + 0.05 * phase.sin()],
    }
}

fn covariance() -> SMatrix<f64, ERROR_DIM, ERROR_DIM> {
    let root = SMatrix::<f64, ERROR_DIM, ERROR_DIM>::from_fn(|row, column| {
        let scale = [0.3, 0.02, 0.01, 1e-3, 1e-4][row / 3];
        scale * if row == column { 1.0 } else { 0.2 * ((row * 7 + column * 3) as f64).sin() }
    });
    root * root.transpose()
}

fn solution_at(t: Time) -> Solution {
    let state = NavState {
        position_enu: Vector3::new(120.0, -340.0, -55.0),
        velocity_enu: Vector3::new(1.5, -0.7, 0.2),
        q_enu_body: nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7),
        accel_bias: Vector3::new(0.01, -0.02, 0.03),
        gyro_bias: Vector3::new(1e-3, 2e-3, -3e-3),
    };
    solution(&state, &covariance(), t)
}

/// Estimates from sample `from` to sample `to`, when the solution comes after sample `rebase_after`.
fn run(solution: &Solution, rebase_after: i64, range: core::ops::Range<i64>) -> Vec<NavEstimate> {
    let mut propagator = Propagator::new(&config());
    let mut estimates = Vec::new();
    for index in range {
        let estimate = propagator.advance(&sample(index)).expect("good sample").expect("new sample");
        estimates.push(estimate);
        if index == rebase_after {
            propagator.rebase(solution).expect("good solution");
        }
    }
    estimates
}

#[test]
fn the_estimate_is_the_same_to_the_bit_whenever_the_solution_came() {
    // Keyframe between samples 200 and 201.
    let solution = solution_at(Time(1_002_500_000));
    let last: Vec<NavEstimate> = [150, 199, 200, 201, 240, 398]
        .map(|after| *run(&solution, after, 0..400).last().expect("400 samples"))
        .to_vec();
    for other in &last[1..] {
        assert_eq!(*other, last[0]);
    }
    assert_eq!(last[0].solution, 7);
    assert_eq!((last[0].header.origin_sequence, last[0].header.origin_t_arrival), (399, 416));
    // A run that began later, but before the keyframe, says the same.
    let later = *run(&solution, 240, 199..400).last().expect("samples");
    assert_eq!(later, last[0]);
}

#[test]
fn a_solution_ahead_of_the_samples_waits_for_them() {
    let first = solution_at(Time(0));
    let ahead = Solution { id: 8, ..solution_at(Time(1_000_000_000)) };
    let mut propagator = Propagator::new(&config());
    propagator.advance(&sample(0)).expect("good");
    propagator.rebase(&first).expect("good");
    propagator.rebase(&ahead).expect("good");
    for index in 1..200 {
        let estimate = propagator.advance(&sample(index)).expect("good").expect("new");
        assert_eq!(estimate.solution, 7, "at sample {index}");
    }
    let estimate = propagator.advance(&sample(200)).expect("good").expect("new");
    assert_eq!(estimate.solution, 8);
    assert_relative_eq!(Vector3::from(estimate.position_enu), Vector3::new(120.0, -340.0, -55.0));
}

/// It goes the way of the next sample, and leaves no trace of having done so.
#[test]
fn a_rehearsal_is_what_the_sample_would_give_and_changes_nothing() {
    let solution = solution_at(Time(0));
    let mut propagator = Propagator::new(&config());
    assert!(propagator.rehearse(0.005).is_none(), "nothing to stand on");
    for index in 0..=200 {
        propagator.advance(&sample(index)).expect("good");
        if index == 0 {
            propagator.rebase(&solution).expect("good");
        }
        let rehearsed = propagator.rehearse(0.005).expect("it stands");
        assert!(rehearsed.position_enu.iter().all(|coordinate| coordinate.is_finite()));
    }
    let untouched = *run(&solution, 0, 0..202).last().expect("samples");
    let same_again = ImuSample { header: sample(201).header, ..sample(200) };
    let rehearsed = propagator.rehearse(0.005).expect("it stands");
    let mut other = propagator.clone();
    let heard = other.advance(&same_again).expect("good").expect("new");
    assert_eq!(NavEstimate { header: heard.header, ..rehearsed }, heard);
    assert_eq!(propagator.advance(&sample(201)).expect("good"), Some(untouched));
}

#[test]
fn state_and_covariance_are_those_of_transport() {
    let solution = solution_at(Time(0));
    let estimates = run(&solution, 0, 0..201);
    let last = estimates.last().expect("samples");
    let (state, c) = NavState::from_solution(&solution).expect("whole");
    let mut increment = Preintegration::new(state.accel_bias, state.gyro_bias);
    let point = |index: i64| ImuPoint {
        gyro_body: Vector3::from(sample(index).gyro_body),
        accel_body: Vector3::from(sample(index).accel_body),
    };
    for index in 0..200 {
        increment.step(&config().vehicle.imu, 0.005, &point(index), &point(index + 1), Inflation::NONE);
    }
    let end = transport(&state, &increment, &world());
    assert_relative_eq!(Vector3::from(last.position_enu), end.position_enu, epsilon = 1e-9);
    assert_relative_eq!(Vector3::from(last.velocity_enu), end.velocity_enu, epsilon = 1e-12);
    let jacobians = transport_jacobians(&state, &increment, &world());
    let dense = jacobians.state * c * jacobians.state.transpose()
        + jacobians.increment * increment.increment_covariance() * jacobians.increment.transpose();
    for (at, found) in [(0, last.position_cov), (3, last.velocity_cov), (6, last.attitude_cov)] {
        let expected = upper_triangle(&dense.fixed_view::<3, 3>(at, at).into_owned());
        for (found, expected) in found.into_iter().zip(expected) {
            assert_relative_eq!(found, expected, max_relative = 1e-9, epsilon = 1e-16);
        }
    }
    let up_body = end.r_enu_body().row(2).transpose();
    let about_up = (up_body.transpose() * dense.fixed_view::<3, 3>(6, 6) * up_body)[0].sqrt();
    assert_relative_eq!(last.sigma_rpy[2], about_up, max_relative = 1e-9);
    let [lat_deg, lon_deg, height] = last.lat_lon_h;
    let back = world().frame.to_enu(&Geodetic::from_degrees(lat_deg, lon_deg, height));
    assert_relative_eq!(back, end.position_enu, epsilon = 1e-7);
}

fn mode_with(change: impl FnOnce(&mut Solution), samples: i64) -> Mode {
    let mut solution = solution_at(Time(0));
    change(&mut solution);
    run(&solution, 0, 0..samples).last().expect("samples").mode()
}

#[test]
fn modes_say_what_the_estimate_may_be_trusted_for() {
    assert_eq!(run(&solution_at(Time(0)), i64::MAX, 0..3)[2].mode(), Mode::Initialising);
    assert_eq!(mode_with(|_| {}, 100), Mode::Ok);
    assert_eq!(mode_with(|s| s.status = SolutionStatus::Damped as u32, 100), Mode::Degraded);
    assert_eq!(mode_with(|s| s.status = 99, 100), Mode::Degraded);
    // LBL gone, GNSS there, and the other way round: position is aided.
    assert_eq!(mode_with(|s| s.t_last_used[0] = i64::MIN, 100), Mode::Ok);
    assert_eq!(mode_with(|s| s.t_last_used[1] = -60_000_000_000, 100), Mode::Ok);
    // DVL used a minute ago: missing. Never used: not missing.
    assert_eq!(mode_with(|s| s.t_last_used[2] = -60_000_000_000, 100), Mode::Degraded);
    assert_eq!(mode_with(|s| s.t_last_used[2] = i64::MIN, 100), Mode::Ok);
    let without_position = |s: &mut Solution| s.t_last_used[..2].fill(i64::MIN);
    assert_eq!(mode_with(without_position, 100), Mode::DeadReckoning);
    // Three seconds without a solution are three seconds without LBL and GNSS.
    assert_eq!(mode_with(|_| {}, 660), Mode::DeadReckoning);
    assert_eq!(mode_with(|s| s.covariance[0][0] = 1.1e8, 100), Mode::Invalid);
}

#[test]
fn a_solution_that_grows_old_degrades_before_position_times_out() {
    let mut config = config();
    config.navigator.propagator.solution_timeout = Duration::from_seconds(1.0);
    let mut propagator = Propagator::new(&config);
    propagator.advance(&sample(0)).expect("good");
    propagator.rebase(&solution_at(Time(0))).expect("good");
    let modes: Vec<Mode> =
        (1..260).map(|i| propagator.advance(&sample(i)).expect("good").expect("new").mode()).collect();
    assert_eq!((modes[199], modes[200]), (Mode::Ok, Mode::Degraded));
}

#[test]
fn a_gap_is_bridged_with_more_noise_and_declared() {
    let run_with_gap = |gap_samples: i64| {
        let mut propagator = Propagator::new(&config());
        propagator.advance(&sample(0)).expect("good");
        propagator.rebase(&solution_at(Time(0))).expect("good");
        for index in (1..=100).chain(100 + gap_samples..=300) {
            propagator.advance(&sample(index)).expect("good");
        }
        propagator.last
    };
    let (whole, short, long) = (run_with_gap(1), run_with_gap(40), run_with_gap(150));
    assert_eq!((whole.mode(), short.mode(), long.mode()), (Mode::Ok, Mode::Degraded, Mode::Degraded));
    assert!(whole.velocity_cov[0] < short.velocity_cov[0] && short.velocity_cov[0] < long.velocity_cov[0]);
    let error = (Vector3::from(short.position_enu) - Vector3::from(whole.position_enu)).norm();
    assert!(error < 0.01, "{error} m after a gap of 0.2 s");
    assert!(error < 3.0 * short.position_cov[0].sqrt());
}

#[test]
fn ages_are_data_time_and_never_is_infinite() {
    let mut solution = solution_at(Time(0));
    solution.t_last_used = [0, i64::MIN, -500_000_000, 0, 0];
    let last = *run(&solution, 0, 0..101).last().expect("samples");
    assert_eq!(last.aiding_age, [0.5, f64::INFINITY, 1.0, 0.5, 0.5]);
}

#[test]
fn without_imu_the_last_estimate_is_held_with_growing_sigmas_and_is_invalid() {
    let mut propagator = Propagator::new(&config());
    propagator.advance(&sample(0)).expect("good");
    assert_eq!(propagator.without_imu(Time(10_000_000)).mode(), Mode::Initialising);
    propagator.rebase(&solution_at(Time(0))).expect("good");
    let last = propagator.advance(&sample(1)).expect("good").expect("new");
    let held = propagator.without_imu(Time(2_005_000_000));
    assert_eq!((held.mode(), held.position_enu), (Mode::Invalid, last.position_enu));
    assert_eq!(held.header.t_valid, 2_005_000_000);
    // Two seconds at 1.7 m/s.
    assert!(held.position_cov[0].sqrt() > 3.0 && held.position_cov[0].is_finite());
    let longer = propagator.without_imu(Time(9_005_000_000));
    assert!(longer.position_cov[0] > held.position_cov[0] && longer.sigma_rpy[2] > held.sigma_rpy[2]);
}

#[test]
fn a_gap_that_nothing_bridges_holds_the_estimate_until_a_solution_from_behind_it() {
    let mut propagator = Propagator::new(&config());
    propagator.advance(&sample(0)).expect("good");
    propagator.rebase(&solution_at(Time(0))).expect("good");
    let last = propagator.advance(&sample(1)).expect("good").expect("new");
    for index in [2000, 2001] {
        let held = propagator.advance(&sample(index)).expect("good").expect("new");
        assert_eq!((held.mode(), held.position_enu), (Mode::Invalid, last.position_enu));
        assert_eq!(held.header.origin_sequence, index as u64);
        assert!(held.position_cov[0].sqrt() > 10.0, "ten seconds at 1.7 m/s");
    }
    propagator.rebase(&solution_at(Time(2000 * 5_000_000))).expect("good");
    let found = propagator.advance(&sample(2002)).expect("good").expect("new");
    assert_ne!(found.mode(), Mode::Invalid);
}

#[test]
fn a_solution_that_its_sensors_contradict_is_invalid() {
    let mut solution = solution_at(Time(0));
    solution.t_last_used = [0; 5];
    assert_ne!(run(&solution, 0, 0..10)[9].mode(), Mode::Invalid);
    solution.status = SolutionStatus::Inconsistent as u32;
    assert_eq!(run(&solution, 0, 0..10)[9].mode(), Mode::Invalid);
}

#[test]
fn bad_samples_and_bad_solutions_are_named_and_change_nothing() {
    let mut propagator = Propagator::new(&config());
    propagator.advance(&sample(5)).expect("good");
    propagator.rebase(&solution_at(Time(25_000_000))).expect("good");
    let before = propagator.advance(&sample(6)).expect("good").expect("new");
    let mut broken = sample(7);
    broken.gyro_body[1] = f64::NAN;
    assert_eq!(propagator.advance(&broken), Err(PropagatorError::NotFinite { t: Time(35_000_000) }));
    assert_eq!(
        propagator.advance(&sample(4)),
        Err(PropagatorError::BackwardsTime { last: Time(30_000_000), t: Time(20_000_000) })
    );
    assert_eq!(propagator.advance(&sample(6)), Ok(None));
    let mut unusable = solution_at(Time(30_000_000));
    unusable.q_enu_body = [2.0, 0.0, 0.0, 0.0];
    assert_eq!(propagator.rebase(&unusable), Err(PropagatorError::UnusableSolution { id: 7 }));
    let old = solution_at(Time(-60_000_000_000));
    assert!(matches!(propagator.rebase(&old), Err(PropagatorError::SolutionTooOld { id: 7, .. })));
    assert_eq!(propagator.last, before);
}

#[test]
fn the_claimed_covariance_is_that_of_noisy_starts() {
    // Linear in the error of the start: a unit step of each coordinate, added up.
    let solution = solution_at(Time(0));
    let (state, c) = NavState::from_solution(&solution).expect("whole");
    let reference = *run(&solution, 0, 0..201).last().expect("samples");
    let quiet = {
        let mut config = config();
        config.vehicle.imu.gyro_noise_density = 1e-12;
        config.vehicle.imu.accel_noise_density = 1e-12;
        config
    };
    let mut propagator = Propagator::new(&quiet);
    propagator.advance(&sample(0)).expect("good");
    propagator.rebase(&solution).expect("good");
    for index in 1..201 {
        propagator.advance(&sample(index)).expect("good");
    }
    let mut by_start = SMatrix::<f64, 3, ERROR_DIM>::zeros();
    for column in 0..ERROR_DIM {
        let mut delta = SVector::<f64, ERROR_DIM>::zeros();
        delta[column] = 1e-4;
        let mut moved = solution;
        state.retract(&delta).write_solution(&c, &mut moved);
        let end = *run(&moved, 0, 0..201).last().expect("samples");
        let change = (Vector3::from(end.position_enu) - Vector3::from(reference.position_enu)) / 1e-4;
        by_start.set_column(column, &change);
    }
    let expected = upper_triangle(&(by_start * c * by_start.transpose()));
    for (found, expected) in propagator.last.position_cov.into_iter().zip(expected) {
        assert_relative_eq!(found, expected, max_relative = 1e-3);
    }
}
