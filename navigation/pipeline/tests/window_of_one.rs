//! A window of one interval and a Kalman filter are the same estimator: each is the other's oracle.
//!
//! The window solves in information form on a block-tridiagonal chain, the filter in covariance form row by row; they have the
//! sensor models and the preintegration in common and nothing of the solution.

use nalgebra::{SMatrix, Vector3};
use nav_fgo::FgoEstimator;
use nav_fgo::chain::Link;
use nav_fgo::kernels::{Block, BlockVector, cholesky, inverse_from_cholesky};
use nav_geometry::{Geodetic, so3};
use nav_kalman::{Ekf, Filter};
use nav_models::gaps::Inflation;
use nav_models::inertial::ImuFactor;
use nav_models::preintegration::{ImuPoint, Preintegration};
use nav_models::row::Row;
use nav_models::sensors::{GyroAt, Model};
use nav_models::state::{ATTITUDE, NavState};
use nav_models::transport::transport;
use nav_models::{Effort, Estimator, WorldModel};
use shared_types::{Config, KeyframeCause, Measurement, Reading, Solution, Time};

const ORIGIN: [f64; 3] = [36.38, 127.36, 0.0];
const GYRO: [f64; 3] = [0.02, -0.03, 0.2];

/// Nothing is weighed, refused or guessed: what is left is linear algebra.
fn config(estimator: &str) -> Config {
    let sets = [
        "estimator=".to_owned() + estimator,
        "frame.origin=[36.38, 127.36, 0.0]".into(),
        "initial.t=0.0".into(),
        "initial.position=[120.0, -340.0, -55.0]".into(),
        "initial.velocity=[1.5, -0.7, 0.2]".into(),
        "initial.quaternion=[0.9055, 0.1006, -0.0503, 0.4094]".into(),
        "initial.sigma_attitude=[0.3, 0.3, 1.0]".into(),
        "fgo.max_iterations=1".into(),
        "dvl.lever_arm=[0.4, -0.15, 0.25]".into(),
        "lbl.lever_arm=[-0.2, 0.1, -0.3]".into(),
        "gnss.max_depth=1000.0".into(),
        "lbl.calibrate=false".into(),
    ];
    let plain = ["lbl", "gnss", "dvl", "mcp", "ps"]
        .into_iter()
        .flat_map(|name| ["kernel=none", "gate=false", "time_offset=off"].map(|set| format!("{name}.{set}")));
    Config::load(&[], &sets.into_iter().chain(plain).collect::<Vec<_>>()).expect("a valid configuration")
}

fn sample(t: f64) -> ImuPoint {
    let wave = |phase: f64| (3.0 * t + phase).sin();
    ImuPoint {
        gyro_body: Vector3::from(GYRO) + Vector3::new(wave(0.0), wave(1.0), wave(2.0)) * 0.05,
        accel_body: Vector3::new(0.3, -0.2, 9.8) + Vector3::new(wave(3.0), wave(4.0), wave(5.0)) * 0.4,
    }
}

/// What the sensors say at the end of the interval: off by a few sigmas of the prediction.
fn readings() -> Vec<Reading> {
    let buoys = [[0.0, -500.0, 0.0], [-400.0, 0.0, 0.0], [-200.0, 1000.0, 0.0], [200.0, 500.0, 0.0]];
    let ranges = [208.3, 627.4, 1379.0, 845.4];
    let ranges = buoys.into_iter().zip(ranges).enumerate().map(|(index, (buoy_enu, range))| Reading::Lbl {
        buoy: index as u32,
        epoch: 1,
        range,
        buoy_enu,
        buoy_sigma: 0.0,
        is_moored: true,
    });
    [
        Reading::Gnss { antenna_enu: [121.2, -340.9, -54.6], sigma_enu: [0.5, 0.5, 0.8] },
        Reading::Dvl { velocity_dvl: [1.2, -1.0, 0.4] },
        Reading::Mcp { heading: 0.62 },
        Reading::Ps { depth: 54.4 },
    ]
    .into_iter()
    .chain(ranges)
    .collect()
}

/// An interval of a second that ends with these readings.
fn measurements(readings: &[Reading]) -> Vec<Measurement> {
    let (start, end) = (Time(0), Time::from_seconds(1.0));
    let imu = |index: i64| {
        let t = Time(index * 5_000_000);
        let point = sample(t.as_seconds());
        let reading = Reading::Imu { gyro_body: point.gyro_body.into(), accel_body: point.accel_body.into() };
        Measurement::new(t, t, &reading)
    };
    let keyframe = |t: Time, cause| Measurement::new(t, t, &Reading::Keyframe { cause });
    let mut all = vec![imu(0), keyframe(start, KeyframeCause::Start)];
    all.extend((1..=210).map(imu));
    all.extend(readings.iter().map(|reading| Measurement::new(end, end, reading)));
    all.push(keyframe(end, KeyframeCause::Lbl));
    all
}

fn last_of(estimator: &mut impl Estimator, readings: &[Reading]) -> Solution {
    let mut last = None;
    for measurement in measurements(readings) {
        last = estimator.ingest(&measurement, Effort::Full).expect("a valid stream").or(last);
    }
    last.expect("two keyframes")
}

/// G P Gᵀ: the covariance of a window is that at its linearisation point, a filter's that at its estimate.
fn turned(covariance: &Block<15>, turn: &nalgebra::Matrix3<f64>) -> Block<15> {
    let mut g = Block::<15>::identity();
    g.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE).copy_from(turn);
    g * covariance * g.transpose()
}

#[track_caller]
fn assert_covariances(one: &Block<15>, other: &Block<15>) {
    for i in 0..15 {
        for j in 0..15 {
            let scale = (one[(i, i)] * one[(j, j)]).sqrt();
            let difference = (one[(i, j)] - other[(i, j)]).abs() / scale;
            assert!(difference < 1e-7, "({i}, {j}): {} {}", one[(i, j)], other[(i, j)]);
        }
    }
}

#[test]
fn the_first_interval_of_the_smoother_is_the_filter() {
    let origin = Geodetic::from_degrees(ORIGIN[0], ORIGIN[1], ORIGIN[2]);
    let run = |estimator: &str, offset: &str, readings: &[Reading]| {
        let text = shared_types::ConfigText::new("base", config(estimator).to_toml());
        let sets = [format!("lbl.common_offset_sigma={offset}")];
        let config = Config::load(&[text], &sets).expect("valid");
        let solution = if estimator == "fgo" {
            let mut fgo = FgoEstimator::new(&config);
            fgo.set_origin(origin);
            last_of(&mut fgo, readings)
        } else {
            let mut ekf = Ekf::new(&config);
            ekf.set_origin(origin);
            last_of(&mut ekf, readings)
        };
        let used: u64 = solution.counts[1..].iter().map(|count| count.used).sum();
        assert_eq!(used, readings.len() as u64, "{estimator}");
        NavState::from_solution(&solution).expect("a state")
    };
    let all = readings();
    let (others, ranges) = all.split_at(4);
    let cases = others.chunks(1).map(|one| ("0.0", one)).chain(["0.0", "0.4", "inf"].map(|offset| (offset, ranges)));
    let (predicted, _) = run("ekf", "0.0", &[]);
    for (offset, readings) in cases {
        let (window, window_cov) = run("fgo", offset, readings);
        let (filter, filter_cov) = run("ekf", offset, readings);
        let difference = window.local(&filter).amax();
        // Normal equations in f64 leave some 3e-9 sigmas (§4.3); the sigma of the position is 1 m.
        assert!(difference < 1e-8, "{readings:?}, offset {offset}: {difference:e}");
        let step = filter.local(&predicted).fixed_rows::<3>(ATTITUDE).into_owned();
        assert_covariances(&turned(&window_cov, &so3::right_jacobian(&step)), &filter_cov);
        assert!(filter.local(&predicted).amax() > 1e-3, "{readings:?} said nothing");
    }
}

struct Interval {
    world: WorldModel,
    first: Filter,
    increment: Preintegration,
    models: Vec<Model>,
}

fn interval() -> Interval {
    let config = config("ekf");
    let world = WorldModel::new(Geodetic::from_degrees(ORIGIN[0], ORIGIN[1], ORIGIN[2]), &config);
    let mut state = NavState::identity();
    state.position_enu = Vector3::new(120.0, -340.0, -55.0);
    state.velocity_enu = Vector3::new(1.5, -0.7, 0.2);
    state.q_enu_body = nalgebra::UnitQuaternion::from_euler_angles(0.1, -0.05, 0.8);
    state.gyro_bias = Vector3::new(1e-4, -2e-4, 1e-4);
    let sigmas: [f64; 5] = [1.0, 0.3, 0.1, 1e-2, 1e-3];
    let root = SMatrix::<f64, 15, 15>::from_fn(|i, j| {
        let own = if i == j { 1.0 } else { 0.15 * ((i * 7 + j * 3) as f64).sin() };
        sigmas[i / 3] * own
    });
    let mut increment = Preintegration::new(state.accel_bias, state.gyro_bias);
    for index in 0..200 {
        let (before, after) = (sample(f64::from(index) * 0.005), sample(f64::from(index + 1) * 0.005));
        increment.step(&config.vehicle.imu, 0.005, &before, &after, Inflation::NONE);
    }
    let gyro = || Some(GyroAt { gyro_body: sample(1.0).gyro_body, dt_imu: 0.005 });
    let models = readings()
        .iter()
        .map(|reading| Model::of(reading, &config.vehicle, &state, &world, gyro).expect("usable"))
        .collect();
    Interval { world, first: Filter::new(state, root * root.transpose()), increment, models }
}

impl Interval {
    fn rows_at(&self, state: &NavState, rows: &mut Vec<Row>) {
        for model in &self.models {
            rows.extend_from_slice(model.rows_at(state, &self.world).expect("usable").as_slice());
        }
    }

    /// Gauss-Newton on prior, increment and sensors of both states, the first linearised once, in information form.
    fn window(&self, iterations: usize) -> (NavState, Block<15>) {
        let factor = ImuFactor::new(self.increment);
        let predicted = transport(&self.first.state, &self.increment, &self.world);
        let near = factor.jacobians(&self.first.state, &predicted, &self.world).from;
        let inverse = |matrix: &Block<15>| inverse_from_cholesky(&cholesky(matrix).expect("positive definite"));
        let weight = inverse(&self.increment.covariance());
        let (mut newest, mut covariance) = (predicted, Block::zeros());
        for _ in 0..iterations {
            let residual = factor.residual(&self.first.state, &newest, &self.world);
            let far = factor.jacobians(&self.first.state, &newest, &self.world).to;
            let mut rows = Vec::new();
            self.rows_at(&newest, &mut rows);
            let mut links = [Link::<15>::default(), Link::default()];
            links[0].diagonal = inverse(&self.first.covariance) + near.transpose() * weight * near;
            links[0].right = -(near.transpose() * weight * residual);
            links[0].next_transposed = far.transpose() * weight * near;
            links[1].diagonal = far.transpose() * weight * far;
            links[1].right = -(far.transpose() * weight * residual);
            for row in &rows {
                links[1].diagonal += row.jacobian * row.jacobian.transpose();
                links[1].right -= row.jacobian * row.residual;
            }
            let [first, last] = &mut links;
            first.sweep(None, 0.0).expect("regular");
            last.sweep(Some(first), 0.0).expect("regular");
            let step: BlockVector<15> = last.substitute(None);
            let turn = so3::right_jacobian(&step.fixed_rows::<3>(ATTITUDE).into_owned());
            newest = newest.retract(&step);
            covariance = turned(&last.covariance(), &turn);
        }
        (newest, covariance)
    }

    fn filter(&self, iterations: usize) -> Filter {
        let mut filter = self.first;
        filter.predict(&self.increment, 1.0, &self.world).expect("finite");
        let mut rows = Vec::new();
        filter.update(iterations, |state, rows| self.rows_at(state, rows), &mut rows).expect("finite");
        filter
    }
}

#[test]
fn one_step_of_a_window_of_one_is_the_extended_filter() {
    let interval = interval();
    let (window, covariance) = interval.window(1);
    let filter = interval.filter(1);
    let difference = window.local(&filter.state).amax();
    assert!(difference < 1e-9, "{difference:e}");
    assert_covariances(&covariance, &filter.covariance);
}

#[test]
fn a_window_of_one_that_is_solved_to_the_end_is_the_iterated_filter() {
    let interval = interval();
    let (window, covariance) = interval.window(12);
    let filter = interval.filter(12);
    let difference = window.local(&filter.state).amax();
    assert!(difference < 1e-9, "{difference:e}");
    assert_covariances(&covariance, &filter.covariance);
    let once = interval.filter(1).state.local(&filter.state).amax();
    assert!(once > 1e-4, "one linearisation would have done: {once:e}");
}
