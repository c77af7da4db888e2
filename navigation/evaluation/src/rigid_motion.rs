//! The rigid motion, without scale, that lays one trajectory best upon another.
//!
//! ```text
//! min over R, t of Σ |R p̂ + t − p|²:   R = U S Vᵀ of Σ (p − mean p)(p̂ − mean p̂)ᵀ = U D Vᵀ,   t = mean p − R mean p̂
//! S = diag(1, 1, det(U V)), which keeps R a rotation.                                       Umeyama 1991, eq. (40) to (42)
//! about the up axis alone:  tan ψ = Σ (x̂ y − ŷ x) / Σ (x̂ x + ŷ y), both about their means
//! ```
//!
//! A tightly coupled system knows where it is, and is scored without. Odometry and visual SLAM start in a frame of their own: with
//! an inertial sensor only heading and place are arbitrary (`Yaw`), without one the tilt is too (`Se3`).

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::pose::{Pose, PosePair};

/// What may be moved before errors are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// Nothing: the frames are the same.
    #[default]
    None,
    /// Place, and heading about the up axis: 4 degrees of freedom.
    Yaw,
    /// Place and attitude: 6 degrees of freedom.
    Se3,
}

/// A rotation, then a translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigidMotion {
    /// Of the frame of the estimates into that of the truth.
    pub rotation: UnitQuaternion<f64>,
    /// m.
    pub translation: Vector3<f64>,
}

impl RigidMotion {
    /// The best of its kind for `pairs`. `None` if they do not determine it: no pair, or an SVD that does not converge.
    pub fn fit(motion: Motion, pairs: &[PosePair]) -> Option<RigidMotion> {
        if pairs.is_empty() {
            return None;
        }
        let mean = |of: fn(&PosePair) -> Vector3<f64>| pairs.iter().map(of).sum::<Vector3<f64>>() / pairs.len() as f64;
        let (mean_estimate, mean_truth) = (mean(|pair| pair.estimate.position), mean(|pair| pair.truth.position));
        let mut cross = Matrix3::zeros();
        for pair in pairs {
            cross += (pair.truth.position - mean_truth) * (pair.estimate.position - mean_estimate).transpose();
        }
        let rotation = match motion {
            Motion::None => {
                return Some(RigidMotion { rotation: UnitQuaternion::identity(), translation: Vector3::zeros() });
            }
            Motion::Yaw => {
                let yaw = (cross[(1, 0)] - cross[(0, 1)]).atan2(cross[(0, 0)] + cross[(1, 1)]);
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
            }
            Motion::Se3 => UnitQuaternion::from_matrix(&rotation_of(&cross)?),
        };
        Some(RigidMotion { rotation, translation: mean_truth - rotation * mean_estimate })
    }

    /// The pose in the frame of the truth.
    pub fn apply(&self, pose: &Pose) -> Pose {
        Pose {
            t: pose.t,
            position: self.rotation * pose.position + self.translation,
            attitude: pose.attitude.map(|attitude| self.rotation * attitude),
        }
    }
}

fn rotation_of(cross: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = cross.svd(true, true);
    let (mut u, v_t) = (svd.u?, svd.v_t?);
    if u.determinant() * v_t.determinant() < 0.0 {
        let least = svd.singular_values.imin();
        u.column_mut(least).neg_mut();
    }
    Some(u * v_t)
}

#[cfg(test)]
mod tests {
    use shared_types::Time;

    use super::*;

    /// A tilted figure of eight, m, turned and moved by `motion` in the estimate.
    fn pairs(motion: &RigidMotion) -> Vec<PosePair> {
        let path = |index: i32| {
            let phase = f64::from(index) * 0.01;
            let position = Vector3::new(300.0 * phase.sin(), 120.0 * (2.0 * phase).sin(), 5.0 * (3.0 * phase).cos());
            Pose { t: Time(0), position, attitude: Some(UnitQuaternion::from_euler_angles(0.0, 0.1, phase)) }
        };
        (0..1000).map(|index| PosePair { estimate: motion.apply(&path(index)), truth: path(index) }).collect()
    }

    fn largest_error(fitted: &RigidMotion, pairs: &[PosePair]) -> f64 {
        pairs.iter().map(|p| (fitted.apply(&p.estimate).position - p.truth.position).norm()).fold(0.0, f64::max)
    }

    #[test]
    fn a_turned_and_shifted_path_is_laid_back_upon_itself() {
        let rotation = UnitQuaternion::from_euler_angles(0.1, -0.2, 2.5);
        let pairs = pairs(&RigidMotion { rotation, translation: Vector3::new(4000.0, -7000.0, 30.0) });
        let fitted = RigidMotion::fit(Motion::Se3, &pairs).expect("there are pairs");
        assert!(fitted.rotation.angle_to(&rotation.inverse()) < 1e-9);
        assert!(largest_error(&fitted, &pairs) < 1e-7);
        let attitude = fitted.apply(&pairs[7].estimate).attitude.expect("it has one");
        assert!(attitude.angle_to(&pairs[7].truth.attitude.expect("it has one")) < 1e-9);
    }

    #[test]
    fn heading_alone_is_turned_back_but_no_tilt() {
        let turned = UnitQuaternion::from_euler_angles(0.0, 0.0, -1.3);
        let level = pairs(&RigidMotion { rotation: turned, translation: Vector3::new(10.0, 20.0, 30.0) });
        let fitted = RigidMotion::fit(Motion::Yaw, &level).expect("there are pairs");
        assert!(largest_error(&fitted, &level) < 1e-9);
        let tilted = UnitQuaternion::from_euler_angles(0.2, 0.0, -1.3);
        let tilted = pairs(&RigidMotion { rotation: tilted, translation: Vector3::zeros() });
        let fitted = RigidMotion::fit(Motion::Yaw, &tilted).expect("there are pairs");
        assert!(largest_error(&fitted, &tilted) > 10.0, "a tilt of 0.2 rad stays");
        assert!(fitted.rotation.axis().is_none_or(|axis| axis.z.abs() > 1.0 - 1e-12));
    }

    #[test]
    fn a_mirrored_path_is_not_mirrored_back() {
        let mut mirrored = pairs(&RigidMotion { rotation: UnitQuaternion::identity(), translation: Vector3::zeros() });
        mirrored.iter_mut().for_each(|pair| pair.estimate.position.z *= -1.0);
        let fitted = RigidMotion::fit(Motion::Se3, &mirrored).expect("there are pairs");
        assert!(largest_error(&fitted, &mirrored) > 1.0);
        let rotation = fitted.rotation.to_rotation_matrix();
        assert!((rotation.matrix().determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn without_a_pair_there_is_no_motion() {
        assert_eq!(RigidMotion::fit(Motion::Se3, &[]), None);
    }
}
