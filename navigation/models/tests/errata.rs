//! Equations of the paper as they are printed, beside what is right. Numbers in brackets are the paper's.

use nalgebra::{Matrix3, Matrix4x3, Quaternion, UnitQuaternion, Vector3, Vector4};
use nav_geometry::Geodetic;
use nav_geometry::so3;
use nav_geometry::wgs84::{ECCENTRICITY_SQUARED, meridian_radius, prime_vertical_radius};

const GRAVITY: f64 = 9.8;

/// Derivative of the Earth-centred position by latitude, longitude, height, as (16) prints it: R_E of the prime vertical.
fn printed_derivative(at: &Geodetic) -> Matrix3<f64> {
    let ((sl, cl), (so, co)) = (at.latitude.sin_cos(), at.longitude.sin_cos());
    let radius = prime_vertical_radius(at.latitude);
    let (r, p) = (radius + at.height, radius * (1.0 - ECCENTRICITY_SQUARED) + at.height);
    Matrix3::new(-r * sl * co, -r * cl * so, cl * co, -r * sl * so, -r * cl * co, cl * so, p * cl, 0.0, sl)
}

#[test]
fn the_printed_geodetic_derivative_has_a_wrong_sign_and_a_wrong_radius() {
    let at = Geodetic::from_degrees(36.38, 127.36, -50.0);
    let numeric = |latitude: f64, longitude: f64| {
        let moved = |sign: f64| {
            Geodetic::new(at.latitude + sign * latitude, at.longitude + sign * longitude, at.height).to_ecef()
        };
        (moved(1.0) - moved(-1.0)) / (2.0 * (latitude + longitude))
    };
    let printed = printed_derivative(&at);
    // By longitude: δx is right, δy as large with the other sign.
    let by_longitude = numeric(0.0, 1e-6);
    assert!((printed[(0, 1)] / by_longitude.x - 1.0).abs() < 1e-6, "{} {}", printed[(0, 1)], by_longitude.x);
    assert!((printed[(1, 1)] / by_longitude.y + 1.0).abs() < 1e-6, "{} {}", printed[(1, 1)], by_longitude.y);
    // By latitude: too long by N/M, 0.4 % at this latitude; its third row too short.
    let by_latitude = numeric(1e-6, 0.0);
    let excess = prime_vertical_radius(at.latitude) / meridian_radius(at.latitude) - 1.0;
    assert!((printed[(0, 0)] / by_latitude.x - 1.0 - excess).abs() < 1e-6 && excess > 4e-3, "{excess}");
    assert!((printed[(2, 0)] / by_latitude.z - 1.0).abs() > 1e-3, "{} {}", printed[(2, 0)], by_latitude.z);
}

#[test]
fn differences_that_share_a_buoy_are_correlated() {
    // (14) gives each difference a noise, and no covariance. Taken as independent, the information of the three depends on the choice
    // of the reference; with σ²(I + 11ᵀ) it does not.
    let at = Vector3::new(120.0, 300.0, -50.0);
    let buoys = [[0.0, -500.0, 0.0], [-400.0, 0.0, 0.0], [-200.0, 1000.0, 0.0], [200.0, 500.0, 0.0]];
    let units = buoys.map(|buoy| (at - Vector3::from(buoy)).normalize());
    let information = |reference: usize, covariance: Matrix3<f64>| {
        let rows: Vec<Vector3<f64>> =
            (0..4).filter(|&buoy| buoy != reference).map(|buoy| units[buoy] - units[reference]).collect();
        let jacobian = Matrix3::from_columns(&rows).transpose();
        jacobian.transpose() * covariance.try_inverse().expect("it is positive definite") * jacobian
    };
    let apart = |covariance: Matrix3<f64>| {
        let first = information(0, covariance);
        (1..4).map(|other| (information(other, covariance) - first).norm() / first.norm()).fold(0.0, f64::max)
    };
    let (independent, right) = (2.0 * Matrix3::identity(), Matrix3::identity() + Matrix3::repeat(1.0));
    assert!(apart(right) < 1e-12, "{}", apart(right));
    assert!(apart(independent) > 0.1, "{}", apart(independent));
    // And it is that of raw ranges with an offset that nobody knows: projected off the direction (1, 1, 1, 1).
    let raw = Matrix4x3::from_rows(&units.map(|unit| unit.transpose()));
    let ones = Vector4::repeat(0.5);
    let projected = raw - ones * (ones.transpose() * raw);
    assert!((projected.transpose() * projected - information(2, right)).norm() < 1e-12);
}

/// A body that turns and pushes: rate and specific force at a time.
fn motion(t: f64) -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(0.1 * t.sin(), -0.2, 0.4), Vector3::new(0.5 + t, 1.0, GRAVITY - 0.3 * t))
}

const STEPS: u32 = 200;

/// (21): velocity increment and rotation over a second, samples at the beginning of each step.
fn printed_forward() -> (Vector3<f64>, Matrix3<f64>) {
    let dt = 1.0 / f64::from(STEPS);
    (0..STEPS).fold((Vector3::zeros(), Matrix3::identity()), |(beta, gamma), step| {
        let (rate, force) = motion(f64::from(step) * dt);
        (beta + gamma * force * dt, gamma * so3::exp(&(rate * dt)))
    })
}

/// (24): the same second backwards, samples at the end of each step; its β̂ is the change from the end to the beginning.
fn printed_backward() -> (Vector3<f64>, Matrix3<f64>) {
    let dt = 1.0 / f64::from(STEPS);
    (0..STEPS).rev().fold((Vector3::zeros(), Matrix3::identity()), |(beta, gamma), step| {
        let (rate, force) = motion(f64::from(step + 1) * dt);
        (beta - gamma * force * dt, gamma * so3::exp(&(-rate * dt)))
    })
}

#[test]
fn the_printed_forward_and_backward_sums_are_not_inverses() {
    let ((beta, gamma), (back_beta, back_gamma)) = (printed_forward(), printed_backward());
    // Inverses have γ_b = γ_fᵀ and β_b = −γ_fᵀ β_f; these are apart by millimetres a second, far beyond rounding.
    let velocity = (back_beta + gamma.transpose() * beta).norm();
    assert!(velocity > 1e-3, "{velocity}");
    let rotation = (back_gamma * gamma - Matrix3::identity()).norm();
    assert!(rotation > 1e-5, "{rotation}");
}

#[test]
fn the_printed_backward_velocity_is_wrong_by_twice_its_change() {
    // Level at the end, so that the axes of body and world agree there; gravity points up, as (22) has it.
    let (back_beta, _) = printed_backward();
    let gravity = Vector3::new(0.0, 0.0, GRAVITY);
    let at_end = Vector3::new(1.0, -2.0, 0.5);
    // Force less gravity, over a second.
    let change = -back_beta - gravity;
    let at_beginning = at_end - change;
    let printed = at_end - gravity - back_beta;
    let right = at_end + gravity + back_beta;
    assert!((right - at_beginning).norm() < 1e-12);
    assert!((printed - at_beginning - 2.0 * change).norm() < 1e-12 && change.norm() > 0.5, "{change}");
}

#[test]
fn twice_the_vector_part_jumps_where_the_logarithm_does_not() {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(0.01, -0.02, 0.03));
    let other_sign = UnitQuaternion::new_unchecked(Quaternion::from(-rotation.coords));
    let printed = |q: &UnitQuaternion<f64>| 2.0 * q.imag();
    assert!((printed(&rotation) + printed(&other_sign)).norm() < 1e-15, "one rotation, two residuals of opposite sign");
    assert!((so3::log_quaternion(&rotation) - so3::log_quaternion(&other_sign)).norm() < 1e-15);
}
