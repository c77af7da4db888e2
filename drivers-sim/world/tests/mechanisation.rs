//! The noise-free IMU leads back to the truth: a strapdown mechanisation written here, in the inertial frame, from the
//! scenario's origin and WGS-84 alone.
//!
//! It integrates `r̈ = C f + gravitation(r)`, `Ċ = C [ω]×` with the classical Runge-Kutta rule over each sample interval; the
//! reading in its middle comes from the four samples around (a cubic) or from the two at its ends (a straight line).

use nalgebra::{Matrix3, Quaternion, Vector3};
use nav_geometry::wgs84::EARTH_RATE;
use nav_geometry::{Geodetic, GravityModel, LocalFrame};
use shared_types::{ImuSample, Time};
use sim_world::{Preset, Scenario, World};

/// Position, velocity (inertial axes, ECEF at t = 0) and attitude (body to inertial).
#[derive(Clone, Copy)]
struct State {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    attitude: Quaternion<f64>,
}

impl State {
    fn plus(&self, rate: &State, dt: f64) -> State {
        State {
            position: self.position + rate.position * dt,
            velocity: self.velocity + rate.velocity * dt,
            attitude: self.attitude + rate.attitude * dt,
        }
    }
}

/// How the reading in the middle of an interval is found.
#[derive(Clone, Copy)]
enum Middle {
    Cubic,
    Line,
}

struct Mechanisation {
    frame: LocalFrame,
    gravity: GravityModel,
    r_ecef_enu: Matrix3<f64>,
}

impl Mechanisation {
    fn new(origin_deg: [f64; 3]) -> Mechanisation {
        let [lat_deg, lon_deg, height] = origin_deg;
        let frame = LocalFrame::new(Geodetic::from_degrees(lat_deg, lon_deg, height));
        let (lat, lon) = (lat_deg.to_radians(), lon_deg.to_radians());
        let r_ecef_enu = Matrix3::new(
            -lon.sin(),
            -lat.sin() * lon.cos(),
            lat.cos() * lon.cos(),
            lon.cos(),
            -lat.sin() * lon.sin(),
            lat.cos() * lon.sin(),
            0.0,
            lat.cos(),
            lat.sin(),
        );
        Mechanisation { frame, gravity: GravityModel::new(frame, None), r_ecef_enu }
    }

    /// From ENU axes of the turning Earth to inertial axes at `t`.
    fn r_inertial_enu(&self, t: f64) -> Matrix3<f64> {
        let (s, c) = (EARTH_RATE * t).sin_cos();
        Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0) * self.r_ecef_enu
    }

    fn true_state(&self, world: &World, t: Time) -> State {
        let (motion, truth) = (world.motion(t), world.truth(t));
        let r = self.r_inertial_enu(t.as_seconds());
        let centre_enu = self.r_ecef_enu.tr_mul(&self.frame.to_ecef(&Vector3::zeros()));
        let position = r * (motion.position_enu + centre_enu);
        let [w, x, y, z] = truth.q_enu_body;
        let enu_to_inertial =
            nalgebra::UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(r));
        State {
            position,
            velocity: r * Vector3::from(truth.velocity_enu) + (Vector3::z() * EARTH_RATE).cross(&position),
            attitude: enu_to_inertial.into_inner() * Quaternion::new(w, x, y, z),
        }
    }

    fn position_enu(&self, state: &State, t: f64) -> Vector3<f64> {
        let centre_enu = self.r_ecef_enu.tr_mul(&self.frame.to_ecef(&Vector3::zeros()));
        self.r_inertial_enu(t).tr_mul(&state.position) - centre_enu
    }

    /// ṙ, r̈ and the quaternion's rate.
    fn rate(&self, state: &State, t: f64, gyro: &Vector3<f64>, accel: &Vector3<f64>) -> State {
        let earth_rate = Vector3::z() * EARTH_RATE;
        // The plumb line's gravity without its centrifugal part.
        let gravity_enu = self.gravity.at(&self.position_enu(state, t));
        let gravitation = self.r_inertial_enu(t) * gravity_enu + earth_rate.cross(&earth_rate.cross(&state.position));
        let q = state.attitude;
        let turned = q * Quaternion::from_imag(*accel) * q.conjugate() / q.norm_squared();
        State {
            position: state.velocity,
            velocity: turned.imag() + gravitation,
            attitude: q * Quaternion::from_imag(*gyro) * 0.5,
        }
    }

    /// One interval, from `samples[1]` to `samples[2]`; the outer two shape the cubic.
    fn step(&self, state: &State, samples: &[ImuSample; 4], middle: Middle) -> State {
        let (t0, t1) = (Time(samples[1].header.t_valid), Time(samples[2].header.t_valid));
        let (dt, t0) = ((t1 - t0).as_seconds(), t0.as_seconds());
        let weights = match middle {
            Middle::Cubic => [-1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0],
            Middle::Line => [0.0, 0.5, 0.5, 0.0],
        };
        let blend = |part: fn(&ImuSample) -> Vector3<f64>| {
            samples.iter().zip(weights).fold(Vector3::zeros(), |sum, (sample, weight)| sum + part(sample) * weight)
        };
        let gyro = |sample: &ImuSample| Vector3::from(sample.gyro_body);
        let accel = |sample: &ImuSample| Vector3::from(sample.accel_body);
        let (gyro_middle, accel_middle) = (blend(gyro), blend(accel));
        let k1 = self.rate(state, t0, &gyro(&samples[1]), &accel(&samples[1]));
        let k2 = self.rate(&state.plus(&k1, dt / 2.0), t0 + dt / 2.0, &gyro_middle, &accel_middle);
        let k3 = self.rate(&state.plus(&k2, dt / 2.0), t0 + dt / 2.0, &gyro_middle, &accel_middle);
        let k4 = self.rate(&state.plus(&k3, dt), t0 + dt, &gyro(&samples[2]), &accel(&samples[2]));
        let mut after = state.plus(&k1, dt / 6.0).plus(&k2, dt / 3.0).plus(&k3, dt / 3.0).plus(&k4, dt / 6.0);
        after.attitude = after.attitude.normalize();
        after
    }

    /// Distance from the truth after `seconds` from `from`, m.
    fn drift(&self, world: &World, from: i64, seconds: i64, middle: Middle) -> f64 {
        let start = Time::from_seconds(from as f64);
        let samples: Vec<ImuSample> = world
            .imu()
            .skip_while(|sample| sample.header.t_valid < start.0 - 5_000_000)
            .take(seconds as usize * 200 + 3)
            .collect();
        let mut state = self.true_state(world, Time(samples[1].header.t_valid));
        for window in samples.windows(4) {
            let window = window.first_chunk::<4>().expect("windows of four");
            state = self.step(&state, window, middle);
        }
        let end = Time(samples[samples.len() - 2].header.t_valid);
        assert_eq!(end.0, (from + seconds) * 1_000_000_000);
        (self.position_enu(&state, end.as_seconds()) - world.motion(end).position_enu).norm()
    }
}

/// From the start, and over the dive, the turns and the weaving.
const STARTS: [i64; 3] = [10, 380, 1400];

#[test]
fn a_cubic_mechanisation_returns_to_the_truth_within_a_centimetre_after_ten_minutes() {
    let scenario = Scenario::builtin("mission").expect("it is built in");
    let world = World::new(&scenario, Preset::None, 1).expect("it is valid");
    let mechanisation = Mechanisation::new(scenario.origin_deg);
    for from in STARTS {
        let drift = mechanisation.drift(&world, from, 600, Middle::Cubic);
        eprintln!("cubic, {from} s to {} s: {:.3e} m", from + 600, drift);
        assert!(drift < 0.01, "from {from} s: {drift} m");
    }
}

#[test]
fn samples_joined_by_straight_lines_drift_by_more_than_the_cubic() {
    let scenario = Scenario::builtin("mission").expect("it is built in");
    let world = World::new(&scenario, Preset::None, 1).expect("it is valid");
    let mechanisation = Mechanisation::new(scenario.origin_deg);
    for from in STARTS {
        let drift = mechanisation.drift(&world, from, 600, Middle::Line);
        let cubic = mechanisation.drift(&world, from, 600, Middle::Cubic);
        eprintln!("straight lines, {from} s to {} s: {:.3e} m", from + 600, drift);
        assert!(drift > 10.0 * cubic && drift < 0.3, "from {from} s: {drift} m, cubic {cubic} m");
    }
}
