//! What holds exactly on linear problems, and what must hold in rounding.

use nalgebra::{SVector, Vector3};
use nav_geometry::Geodetic;
use nav_kalman::{Bank, Centralised, Federated, Filter, Stretch};
use nav_models::imu_history::{ImuHistory, ImuModel};
use nav_models::kernels::{Block, cholesky};
use nav_models::preintegration::ImuPoint;
use nav_models::row::{Row, SLOTS};
use nav_models::state::NavState;
use nav_models::world::WorldModel;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use shared_types::{Config, Time};

fn config(sets: &[&str]) -> Config {
    Config::load(&[], &sets.iter().map(|set| (*set).to_owned()).collect::<Vec<_>>()).expect("valid")
}

/// Sigmas of m, m/s, rad, m/s², rad/s with correlations.
fn covariance() -> Block<15> {
    let sigmas: [f64; 5] = [1.0, 0.1, 0.01, 1e-3, 1e-4];
    let root =
        Block::<15>::from_fn(|i, j| sigmas[i / 3] * if i == j { 1.0 } else { 0.1 * ((i * 5 + j * 11) as f64).sin() });
    root * root.transpose()
}

/// Ten seconds of a slow turn.
fn history(config: &Config) -> (ImuHistory, ImuModel, WorldModel) {
    let mut history = ImuHistory::with_capacity(2048);
    for index in 0..=2000_i64 {
        let t = index as f64 * 0.005;
        let point = ImuPoint {
            gyro_body: Vector3::new(0.01, 0.02 * t.sin(), 0.1),
            accel_body: Vector3::new(0.2 * t.cos(), 0.1, 9.8),
        };
        assert!(history.push(Time(index * 5_000_000), point));
    }
    let imu = ImuModel { noise: config.vehicle.imu.clone(), gate: config.navigator.imu };
    (history, imu, WorldModel::new(Geodetic::from_degrees(36.38, 127.36, 0.0), config))
}

/// A measurement of random directions of position and velocity of the state: linear in it.
#[derive(Clone)]
struct Linear {
    place: usize,
    t: Time,
    directions: Vec<SVector<f64, 15>>,
    offset: f64,
}

impl Linear {
    fn rows(&self, state: &NavState, rows: &mut Vec<Row>) {
        for direction in &self.directions {
            let predicted = direction.fixed_rows::<3>(0).dot(&state.position_enu)
                + direction.fixed_rows::<3>(3).dot(&state.velocity_enu);
            rows.push(Row {
                jacobian: *direction,
                residual: predicted - self.offset,
                inverse_sigma: 1.0,
                weight: 1.0,
                slopes: [0.0; SLOTS],
                mooring: None,
            });
        }
    }
}

fn measurements(rng: &mut Pcg64) -> Vec<Linear> {
    (1..=60_i64)
        .map(|index| Linear {
            place: rng.random_range(0..5),
            t: Time(index * 160_000_000 + rng.random_range(0..10_000_000)),
            directions: (0..rng.random_range(1..4))
                .map(|_| SVector::from_fn(|i, _| if i < 6 { rng.random_range(-3.0..3.0) } else { 0.0 }))
                .collect(),
            offset: rng.random_range(-1.0..1.0),
        })
        .collect()
}

fn run<B: Bank>(config: &Config, measurements: &[Linear]) -> Filter {
    let (history, imu, world) = history(config);
    let mut bank = B::start(config, &NavState::identity(), &covariance());
    let mut from = Time(0);
    let mut rows = Vec::new();
    for measurement in measurements {
        let to = measurement.t;
        let stretch = Stretch { from, to, history: &history, imu: &imu, world: &world };
        bank.predict(&stretch).expect("finite");
        let linearise = |state: &NavState, rows: &mut Vec<Row>| measurement.rows(state, rows);
        bank.local(measurement.place).update(1, linearise, &mut rows).expect("finite");
        bank.fuse().expect("positive definite");
        from = to;
    }
    bank.published()
}

#[test]
fn a_federated_filter_with_reset_is_the_centralised_one_whatever_the_shares() {
    let mut rng = Pcg64::seed_from_u64(4);
    let measurements = measurements(&mut rng);
    let centralised = run::<Centralised>(&config(&["estimator=ekf"]), &measurements);
    for shares in [["1.0", "1.0"], ["10.0", "0.2"]] {
        let sets = [
            "estimator=fkf".to_owned(),
            format!("kalman.share_lbl={}", shares[0]),
            format!("kalman.share_ps={}", shares[1]),
        ];
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        let federated = run::<Federated>(&config(&sets), &measurements);
        let sigmas = centralised.covariance.diagonal().map(f64::sqrt);
        let difference = federated.state.local(&centralised.state).component_div(&sigmas).amax();
        assert!(difference < 1e-9, "{difference:e} sigmas");
        let off = (federated.covariance - centralised.covariance).component_div(&(sigmas * sigmas.transpose())).amax();
        assert!(off < 1e-9, "{off:e} of the covariance");
    }
}

#[test]
fn without_reset_the_federated_filter_claims_no_more_than_the_centralised_one() {
    let mut rng = Pcg64::seed_from_u64(5);
    let measurements = measurements(&mut rng);
    let centralised = run::<Centralised>(&config(&["estimator=ekf"]), &measurements);
    let apart = run::<Federated>(&config(&["estimator=fkf", "kalman.reset=false"]), &measurements);
    for axis in 0..6 {
        let (own, best) = (apart.covariance[(axis, axis)], centralised.covariance[(axis, axis)]);
        assert!(own > best, "axis {axis}: {own} {best}");
    }
    let difference = apart.state.local(&centralised.state);
    for axis in 0..6 {
        let sigma = apart.covariance[(axis, axis)].sqrt();
        assert!(difference[axis].abs() < 5.0 * sigma, "axis {axis}: {} {sigma}", difference[axis]);
    }
}

#[test]
fn after_a_million_rows_the_covariance_is_symmetric_and_positive() {
    let mut rng = Pcg64::seed_from_u64(6);
    let mut filter = Filter::new(NavState::identity(), covariance());
    let mut rows = Vec::new();
    for step in 0..300_000_u32 {
        // Sharp and dull ones by turns: a thousandth of a sigma, and a thousand sigmas.
        let scale = 10_f64.powi((step % 7) as i32 - 3);
        let linearise = |_: &NavState, rows: &mut Vec<Row>| {
            for _ in 0..3 {
                let jacobian = SVector::from_fn(|_, _| rng.random_range(-1.0..1.0) * scale);
                let residual = rng.random_range(-1.0..1.0);
                rows.push(Row {
                    jacobian,
                    residual,
                    inverse_sigma: 1.0,
                    weight: 1.0,
                    slopes: [0.0; SLOTS],
                    mooring: None,
                });
            }
        };
        filter.update(1, linearise, &mut rows).expect("finite");
        if step % 1000 == 0 {
            // The motion makes it uncertain again.
            for axis in 0..15 {
                filter.covariance[(axis, axis)] += 1e-9;
            }
        }
    }
    assert_eq!(filter.covariance, filter.covariance.transpose());
    assert!(cholesky(&filter.covariance).is_ok(), "{}", filter.covariance.diagonal());
}

#[test]
fn what_is_no_number_leaves_the_filter_as_it_was() {
    let mut filter = Filter::new(NavState::identity(), covariance());
    let before = filter;
    for residual in [f64::NAN, f64::INFINITY, 1e308] {
        let row = Row {
            jacobian: SVector::repeat(1e10),
            residual,
            inverse_sigma: 1.0,
            weight: 1.0,
            slopes: [0.0; SLOTS],
            mooring: None,
        };
        let done = filter.update(3, |_, rows| rows.extend([row, row]), &mut Vec::new());
        if residual == 1e308 {
            // A number, if no sensible one: whatever comes of it is finite.
            assert!(filter.state.is_finite());
            filter = before;
        } else {
            assert!(done.is_err());
            assert_eq!((filter.state, filter.covariance), (before.state, before.covariance));
        }
    }
}
