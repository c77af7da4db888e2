//! The rotation group: exponential, logarithm and their Jacobians.
//!
//! ```text
//! Exp φ  = I + c₁[φ]× + c₂[φ]×²        J_l(φ) = I + c₂[φ]× + c₃[φ]×²        J_r(φ) = J_l(−φ)
//! Γ₂(φ)  = ½I + c₃[φ]× + c₄[φ]×²       (= ∫₀¹ (1−s) Exp(sφ) ds)
//! c₁ = sin t/t,  c₂ = (1−cos t)/t²,  c₃ = (t−sin t)/t³,  c₄ = (cos t−1+t²/2)/t⁴,  t = |φ|
//! ```
//!
//! The closed forms of c₂ … c₄ cancel for small t; there the series `c_m = Σ (−1)^k t^{2k}/(2k+m)!` stands. Only c₃ and c₄
//! need it: `c₁ = 1 − t²c₃` and `c₂ = ½ − t²c₄`. The logarithm uses atan2, never acos.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Below this angle (squared) the series are used; at 0.5 rad the closed form of c₄ has lost four digits.
const SERIES_BELOW_SQUARED: f64 = 0.25;
/// Below this angle (squared) five terms of the series are exact to rounding.
const SHORT_SERIES_BELOW_SQUARED: f64 = 0.01;

/// 1/3!, 1/5!, …: c₃ in powers of −t².
const INVERSE_ODD_FACTORIALS: [f64; 8] = [
    1.0 / 6.0,
    1.0 / 120.0,
    1.0 / 5_040.0,
    1.0 / 362_880.0,
    1.0 / 39_916_800.0,
    1.0 / 6_227_020_800.0,
    1.0 / 1_307_674_368_000.0,
    1.0 / 355_687_428_096_000.0,
];

/// 1/4!, 1/6!, …: c₄ in powers of −t².
const INVERSE_EVEN_FACTORIALS: [f64; 8] = [
    1.0 / 24.0,
    1.0 / 720.0,
    1.0 / 40_320.0,
    1.0 / 3_628_800.0,
    1.0 / 479_001_600.0,
    1.0 / 87_178_291_200.0,
    1.0 / 20_922_789_888_000.0,
    1.0 / 6_402_373_705_728_000.0,
];

/// c₁ … c₄ of the module's equations, from t².
#[inline]
fn coefficients(t_squared: f64) -> [f64; 4] {
    if t_squared < SERIES_BELOW_SQUARED {
        let terms = if t_squared < SHORT_SERIES_BELOW_SQUARED { 5 } else { 8 };
        let (mut c3, mut c4) = (0.0, 0.0);
        for k in (0..terms).rev() {
            c3 = INVERSE_ODD_FACTORIALS[k] - t_squared * c3;
            c4 = INVERSE_EVEN_FACTORIALS[k] - t_squared * c4;
        }
        [1.0 - t_squared * c3, 0.5 - t_squared * c4, c3, c4]
    } else {
        let t = t_squared.sqrt();
        let (sin, cos) = t.sin_cos();
        [
            sin / t,
            (1.0 - cos) / t_squared,
            (t - sin) / (t * t_squared),
            (cos - 1.0 + 0.5 * t_squared) / (t_squared * t_squared),
        ]
    }
}

/// `scale·I + first·[φ]× + second·[φ]×²`, with `[φ]×² = φφᵀ − t²I`.
#[inline]
fn combine(phi: &Vector3<f64>, t_squared: f64, scale: f64, first: f64, second: f64) -> Matrix3<f64> {
    let diagonal = scale - second * t_squared;
    let (x, y, z) = (phi.x, phi.y, phi.z);
    let (xy, xz, yz) = (second * x * y, second * x * z, second * y * z);
    let (fx, fy, fz) = (first * x, first * y, first * z);
    Matrix3::new(
        diagonal + second * x * x,
        xy - fz,
        xz + fy,
        xy + fz,
        diagonal + second * y * y,
        yz - fx,
        xz - fy,
        yz + fx,
        diagonal + second * z * z,
    )
}

/// `[v]×`, the matrix of the cross product: `skew(v)·w = v × w`.
#[inline]
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// Rotation matrix of a rotation vector, rad.
#[inline]
pub fn exp(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t_squared = phi.norm_squared();
    let [c1, c2, _, _] = coefficients(t_squared);
    combine(phi, t_squared, 1.0, c1, c2)
}

/// [`exp`] and [`right_jacobian`] of the same vector, at the price of one.
#[inline]
pub fn exp_and_right_jacobian(phi: &Vector3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let t_squared = phi.norm_squared();
    let [c1, c2, c3, _] = coefficients(t_squared);
    (combine(phi, t_squared, 1.0, c1, c2), combine(phi, t_squared, 1.0, -c2, c3))
}

/// [`exp`], [`left_jacobian`] and [`gamma2`] of the same vector, at the price of one.
#[inline]
pub fn exp_left_jacobian_and_gamma2(phi: &Vector3<f64>) -> [Matrix3<f64>; 3] {
    let t_squared = phi.norm_squared();
    let [c1, c2, c3, c4] = coefficients(t_squared);
    [combine(phi, t_squared, 1.0, c1, c2), combine(phi, t_squared, 1.0, c2, c3), combine(phi, t_squared, 0.5, c3, c4)]
}

/// Unit quaternion of a rotation vector, rad.
#[inline]
pub fn exp_quaternion(phi: &Vector3<f64>) -> UnitQuaternion<f64> {
    // sin(t/2)/t = ½·sin(h)/h and cos h, both from the half angle h.
    let half_squared = 0.25 * phi.norm_squared();
    let [c1, c2, _, _] = coefficients(half_squared);
    let v = phi * (0.5 * c1);
    UnitQuaternion::new_unchecked(Quaternion::new(1.0 - half_squared * c2, v.x, v.y, v.z))
}

/// Rotation vector of a rotation matrix, rad, of length at most π.
#[inline]
pub fn log(rotation: &Matrix3<f64>) -> Vector3<f64> {
    let sine = 0.5
        * Vector3::new(
            rotation[(2, 1)] - rotation[(1, 2)],
            rotation[(0, 2)] - rotation[(2, 0)],
            rotation[(1, 0)] - rotation[(0, 1)],
        );
    let cosine = 0.5 * (rotation.trace() - 1.0);
    // Beyond 120 degrees the sine fades and with it the axis: the quaternion keeps it.
    if cosine < -0.5 {
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(*rotation);
        return log_quaternion(&UnitQuaternion::from_rotation_matrix(&rotation));
    }
    let sine_squared = sine.norm_squared();
    // t/sin t = 1 + s²/6 + 3s⁴/40 + …, s = sin t; the next term is below rounding.
    if sine_squared < 1e-6 && cosine > 0.0 {
        return sine * (1.0 + sine_squared * (1.0 / 6.0 + sine_squared * (3.0 / 40.0)));
    }
    let norm = sine_squared.sqrt();
    sine * (norm.atan2(cosine) / norm)
}

/// Rotation vector of a unit quaternion, rad, of length at most π (q and −q give the same).
#[inline]
pub fn log_quaternion(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let (w, v) = if q.w < 0.0 { (-q.w, -q.imag()) } else { (q.w, q.imag()) };
    let norm_squared = v.norm_squared();
    // 2·atan(n/w)/n = (2/w)(1 − n²/(3w²) + n⁴/(5w⁴) − …)
    if norm_squared < 1e-6 {
        let ratio = norm_squared / (w * w);
        return v * (2.0 / w * (1.0 - ratio * (1.0 / 3.0 - ratio * (1.0 / 5.0))));
    }
    let norm = norm_squared.sqrt();
    v * (2.0 * norm.atan2(w) / norm)
}

/// `J_l(φ)`: `Exp(φ + δ) ≈ Exp(J_l δ)·Exp(φ)`.
#[inline]
pub fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t_squared = phi.norm_squared();
    let [_, c2, c3, _] = coefficients(t_squared);
    combine(phi, t_squared, 1.0, c2, c3)
}

/// `J_r(φ) = J_l(−φ)`: `Exp(φ + δ) ≈ Exp(φ)·Exp(J_r δ)`.
#[inline]
pub fn right_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t_squared = phi.norm_squared();
    let [_, c2, c3, _] = coefficients(t_squared);
    combine(phi, t_squared, 1.0, -c2, c3)
}

/// `(1/t² − cot(t/2)/(2t))`, the coefficient of `[φ]×²` in the inverse Jacobians.
#[inline]
fn inverse_coefficient(t_squared: f64) -> f64 {
    if t_squared < 0.01 {
        1.0 / 12.0 + t_squared * (1.0 / 720.0 + t_squared * (1.0 / 30_240.0 + t_squared / 1_209_600.0))
    } else {
        let t = t_squared.sqrt();
        let (sin, cos) = (0.5 * t).sin_cos();
        1.0 / t_squared - cos / (sin * 2.0 * t)
    }
}

/// `J_l⁻¹(φ)`, |φ| < 2π.
#[inline]
pub fn left_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t_squared = phi.norm_squared();
    combine(phi, t_squared, 1.0, -0.5, inverse_coefficient(t_squared))
}

/// `J_r⁻¹(φ) = J_l⁻¹(−φ)`, |φ| < 2π.
#[inline]
pub fn right_jacobian_inverse(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t_squared = phi.norm_squared();
    combine(phi, t_squared, 1.0, 0.5, inverse_coefficient(t_squared))
}

/// `Γ₂(φ) = ∫₀¹ (1−s) Exp(sφ) ds`: what a force fixed to a turning frame adds to a position.
#[inline]
pub fn gamma2(phi: &Vector3<f64>) -> Matrix3<f64> {
    let t_squared = phi.norm_squared();
    let [_, _, c3, c4] = coefficients(t_squared);
    combine(phi, t_squared, 0.5, c3, c4)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_jacobians_agree, numeric_jacobian};
    use approx::assert_relative_eq;
    use nalgebra::{Rotation3, RowVector3};

    const PHI: Vector3<f64> = Vector3::new(0.1, -0.2, 0.3);
    const GOLDEN: f64 = 1e-11;

    /// Angles on both sides of every branch, in a direction without zeros.
    fn vectors() -> impl Iterator<Item = Vector3<f64>> {
        let direction = Vector3::new(0.6, -0.48, 0.64);
        [0.0, 1e-9, 1e-4, 9e-4, 1.1e-3, 0.0999, 0.1001, 0.4999, 0.5001, 1.3, 2.0, 2.2, 3.0, 3.13]
            .into_iter()
            .map(move |angle| direction * angle)
    }

    /// Exp by its power series, independent of the branches under test.
    fn series(phi: &Vector3<f64>, first_factorial: u32) -> Matrix3<f64> {
        let mut term = Matrix3::identity() / (1..=first_factorial).map(f64::from).product::<f64>();
        let mut sum = term;
        for k in 1..60 {
            term = term * skew(phi) / f64::from(k + first_factorial);
            sum += term;
        }
        sum
    }

    #[test]
    fn golden_numbers_of_the_method_are_met() {
        assert_relative_eq!(
            exp(&PHI).row(0).into_owned(),
            RowVector3::new(0.935754803278, -0.302932713403, -0.180540076694),
            epsilon = GOLDEN
        );
        assert_relative_eq!(
            exp(&PHI).row(2).into_owned(),
            RowVector3::new(0.210191705951, 0.0680313164049, 0.975290308953),
            epsilon = GOLDEN
        );
        assert_relative_eq!(
            right_jacobian(&PHI).row(0).into_owned(),
            RowVector3::new(0.978484495426, 0.144948068655, 0.103803880628),
            epsilon = GOLDEN
        );
        assert_relative_eq!(
            right_jacobian_inverse(&PHI).row(0).into_owned(),
            RowVector3::new(0.989141304334, -0.151670568564, -0.0974941471539),
            epsilon = GOLDEN
        );
        assert_relative_eq!(
            gamma2(&PHI).row(0).into_owned(),
            RowVector3::new(0.494608548015, -0.0504806185526, -0.03185659504),
            epsilon = GOLDEN
        );
        let r_enu_body = Rotation3::<f64>::from_euler_angles(0.1, -0.2, 0.7);
        let q = UnitQuaternion::from_rotation_matrix(&r_enu_body);
        let golden = [0.931800735822, 0.0809043958089, -0.0766114556571, 0.345445440442];
        for (value, expected) in [q.w, q.i, q.j, q.k].into_iter().zip(golden) {
            assert_relative_eq!(value, expected, epsilon = GOLDEN);
        }
        let heading = r_enu_body[(0, 0)].atan2(r_enu_body[(1, 0)]).to_degrees();
        assert_relative_eq!(heading, 49.8929543408, epsilon = 1e-9);
        assert_relative_eq!(
            r_enu_body.transpose() * Vector3::new(0.0, 0.0, 9.8),
            Vector3::new(1.94695944179, 0.958865271071, 9.55666920658),
            epsilon = 1e-10
        );
    }

    #[test]
    fn closed_forms_and_series_meet_at_every_branch() {
        for phi in vectors() {
            assert_relative_eq!(exp(&phi), series(&phi, 0), epsilon = 4e-15);
            assert_relative_eq!(left_jacobian(&phi), series(&phi, 1), epsilon = 4e-15);
            assert_relative_eq!(gamma2(&phi), series(&phi, 2), epsilon = 4e-15);
            let (turn, jacobian) = exp_and_right_jacobian(&phi);
            assert_eq!((turn, jacobian), (exp(&phi), right_jacobian(&phi)));
            assert_eq!(exp_left_jacobian_and_gamma2(&phi), [exp(&phi), left_jacobian(&phi), gamma2(&phi)]);
            assert_relative_eq!(right_jacobian(&phi), left_jacobian(&-phi), epsilon = 1e-15);
        }
    }

    #[test]
    fn logarithms_undo_exponentials() {
        for phi in vectors() {
            assert_relative_eq!(log(&exp(&phi)), phi, epsilon = 1e-13);
            assert_relative_eq!(log_quaternion(&exp_quaternion(&phi)), phi, epsilon = 1e-14);
            let rotation = exp_quaternion(&phi).to_rotation_matrix().into_inner();
            assert_relative_eq!(rotation, exp(&phi), epsilon = 4e-15);
            let negated = UnitQuaternion::new_unchecked(-exp_quaternion(&phi).into_inner());
            assert_relative_eq!(log_quaternion(&negated), phi, epsilon = 1e-14);
        }
    }

    #[test]
    fn half_a_turn_has_a_logarithm_of_length_pi() {
        for axis in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(0.6, -0.48, 0.64)] {
            let found = log(&exp(&(axis * std::f64::consts::PI)));
            assert_relative_eq!(found.norm(), std::f64::consts::PI, epsilon = 1e-13);
            assert_relative_eq!(found.dot(&axis).abs(), std::f64::consts::PI, epsilon = 1e-13);
        }
    }

    #[test]
    fn inverse_jacobians_invert() {
        for phi in vectors() {
            assert_relative_eq!(
                left_jacobian(&phi) * left_jacobian_inverse(&phi),
                Matrix3::identity(),
                epsilon = 1e-13
            );
            assert_relative_eq!(
                right_jacobian_inverse(&phi) * right_jacobian(&phi),
                Matrix3::identity(),
                epsilon = 1e-13
            );
        }
    }

    #[test]
    fn jacobians_are_derivatives_of_the_exponential() {
        for phi in vectors() {
            let right = numeric_jacobian(1e-3, |d: &Vector3<f64>| log(&(exp(&phi).transpose() * exp(&(phi + d)))));
            assert_jacobians_agree(&right_jacobian(&phi), &right, 1e-10);
            let left = numeric_jacobian(1e-3, |d: &Vector3<f64>| log(&(exp(&(phi + d)) * exp(&phi).transpose())));
            assert_jacobians_agree(&left_jacobian(&phi), &left, 1e-10);
        }
    }
}
