//! What runs at every IMU sample, in two processes, and at every reading: `cargo bench -p nav-models`.

use nav_models::anchor::Anchor;
use nav_models::gaps::Inflation;
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, GravityModel, LocalFrame};
use nav_models::sensors::{DvlModel, PsModel};
use nav_models::{
    Anchored, ImuFactor, ImuPoint, NavState, Piece, Preintegration, Propagator, Turned, WorldModel, transport,
};
use shared_types::{Config, Header, ImuSample, Solution, SolutionStatus, Time};

fn point(phase: f64) -> ImuPoint {
    ImuPoint {
        gyro_body: Vector3::new(0.1 * phase.sin(), -0.2, 0.3),
        accel_body: Vector3::new(0.5, 0.2 * phase.cos(), 9.8),
    }
}

fn increment(config: &Config) -> Preintegration {
    let mut increment = Preintegration::new(Vector3::zeros(), Vector3::zeros());
    for step in 0..200 {
        let phase = f64::from(step) * 0.02;
        increment.step(&config.vehicle.imu, 0.005, &point(phase), &point(phase + 0.02), Inflation::NONE);
    }
    increment
}

fn benches(criterion: &mut Criterion) {
    let config = Config::default();
    let frame = LocalFrame::new(Geodetic::from_degrees(36.38, 127.36, 0.0));
    let world = WorldModel { frame, gravity: GravityModel::new(frame, None), earth_rate_enu: frame.earth_rate_enu() };
    let state = NavState {
        position_enu: Vector3::new(120.0, -340.0, -55.0),
        velocity_enu: Vector3::new(1.5, -0.7, 0.2),
        q_enu_body: UnitQuaternion::from_euler_angles(0.1, -0.2, 0.7),
        ..NavState::identity()
    };
    let (first, second) = (point(0.0), point(0.02));
    let whole = increment(&config);

    criterion.bench_function("gravity", |b| b.iter(|| world.gravity.at(black_box(&state.position_enu))));
    criterion.bench_function("preintegration_step", |b| {
        let mut running = whole;
        b.iter(|| running.step(&config.vehicle.imu, 0.005, black_box(&first), black_box(&second), Inflation::NONE));
    });
    criterion.bench_function("preintegration_step_mean", |b| {
        let mut running = whole;
        b.iter(|| running.step_mean(0.005, black_box(&first), black_box(&second)));
    });
    criterion.bench_function("backward_piece", |b| {
        let mut room = Turned::default();
        b.iter(|| *Piece::backward(black_box(&whole), black_box(&whole), &mut room).increment());
    });
    criterion.bench_function("transport", |b| b.iter(|| transport(black_box(&state), &whole, &world)));
    let factor = ImuFactor::new(whole);
    let end = transport(&state, &whole, &world);
    criterion.bench_function("imu_residual_and_jacobians", |b| {
        b.iter(|| factor.residual_and_jacobians(black_box(&state), &end, &world));
    });
    criterion.bench_function("imu_weight", |b| b.iter(|| black_box(&factor).weight()));
    let from = Anchor::new(&state, &world);
    let dvl = DvlModel::new([1.0; 3], first.gyro_body, &config.vehicle.dvl, &config.vehicle.imu, 0.005);
    criterion.bench_function("anchored_dvl", |b| {
        b.iter(|| Anchored::new(&dvl, black_box(&from), &whole, &world));
    });
    let ps = PsModel::new(55.0, &config.vehicle);
    criterion.bench_function("anchored_ps", |b| {
        b.iter(|| Anchored::new(&ps, black_box(&from), &whole, &world));
    });
    criterion.bench_function("propagator_advance", |b| {
        let mut propagator = Propagator::new(&config);
        propagator.rebase(&solution(&state)).expect("a usable solution");
        let mut t = 0;
        b.iter(|| {
            t += 5_000_000;
            let sample = ImuSample {
                header: Header::at(Time(t)),
                gyro_body: first.gyro_body.into(),
                accel_body: first.accel_body.into(),
            };
            propagator.advance(black_box(&sample))
        });
    });
}

fn solution(state: &NavState) -> Solution {
    let mut solution = Solution {
        id: 1,
        origin: [36.38, 127.36, 0.0],
        t_last_used: [0; 5],
        keyframes: 1,
        iterations: 1,
        linearised: 1,
        status: SolutionStatus::Converged as u32,
        ..Solution::empty()
    };
    state.write_solution(&(nalgebra::SMatrix::<f64, 15, 15>::identity() * 1e-4), &mut solution);
    solution
}

criterion_group! {
    name = group;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_millis(600))
        .warm_up_time(std::time::Duration::from_millis(200));
    targets = benches
}
criterion_main!(group);
