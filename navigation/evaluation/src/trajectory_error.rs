//! Absolute and relative trajectory error of associated poses: the figures of the SLAM benchmarks.
//!
//! ```text
//! absolute (ATE, APE):  |M p̂ᵢ − pᵢ|,  M the motion that was allowed
//! relative (RPE):       |trans( (Pᵢ⁻¹ Pⱼ)⁻¹ (P̂ᵢ⁻¹ P̂ⱼ) )|  over stretches i to j of one length along the estimate's path
//! ```
//!
//! As `evo_ape` and `evo_rpe --delta D --delta_unit m` have them (translation part). Stretches follow each other without overlap
//! from the first pose on; what is left at the end is no stretch.

use serde::Serialize;

use crate::pose::{Pose, PosePair};
use crate::rigid_motion::{Motion, RigidMotion};

/// Of a set of distances, m.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Distances {
    /// How many.
    pub count: u64,
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean.
    pub mean: f64,
    /// Of an even number, the mean of the middle two.
    pub median: f64,
    /// Least.
    pub min: f64,
    /// Greatest.
    pub max: f64,
}

impl Distances {
    /// `None` of nothing.
    pub fn of(mut values: Vec<f64>) -> Option<Distances> {
        let count = values.len();
        if count == 0 {
            return None;
        }
        values.sort_by(f64::total_cmp);
        let mean_of = |sum: f64| sum / count as f64;
        Some(Distances {
            count: count as u64,
            rmse: mean_of(values.iter().map(|value| value * value).sum()).sqrt(),
            mean: mean_of(values.iter().sum()),
            median: (values[(count - 1) / 2] + values[count / 2]) / 2.0,
            min: values[0],
            max: values[count - 1],
        })
    }
}

/// Absolute trajectory error, m, after the best `motion`. `None` without a pair.
pub fn absolute_error(pairs: &[PosePair], motion: Motion) -> Option<Distances> {
    let motion = RigidMotion::fit(motion, pairs)?;
    let error = |pair: &PosePair| (motion.apply(&pair.estimate).position - pair.truth.position).norm();
    Distances::of(pairs.iter().map(error).collect())
}

/// Relative pose error, m, over stretches of `length` m of the estimate's path.
///
/// `None` if a pose has no attitude, or the path is shorter than a stretch.
pub fn relative_error(pairs: &[PosePair], length: f64) -> Option<Distances> {
    let ends = ends_of_stretches(pairs, length);
    let errors: Option<Vec<f64>> = ends.windows(2).map(|ends| change_error(&pairs[ends[0]], &pairs[ends[1]])).collect();
    Distances::of(errors?)
}

fn ends_of_stretches(pairs: &[PosePair], length: f64) -> Vec<usize> {
    let mut ends = vec![0];
    let mut path = 0.0;
    for (index, step) in pairs.windows(2).enumerate() {
        path += (step[1].estimate.position - step[0].estimate.position).norm();
        if path >= length {
            ends.push(index + 1);
            path = 0.0;
        }
    }
    ends
}

/// |trans( (Pᵢ⁻¹ Pⱼ)⁻¹ (P̂ᵢ⁻¹ P̂ⱼ) )|: the rotation in front leaves the length as it is.
fn change_error(from: &PosePair, to: &PosePair) -> Option<f64> {
    let change = |from: &Pose, to: &Pose| Some(from.attitude?.inverse() * (to.position - from.position));
    // Without an attitude at either end there is no pose to compare.
    to.truth.attitude.and(to.estimate.attitude)?;
    Some((change(&from.estimate, &to.estimate)? - change(&from.truth, &to.truth)?).norm())
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use shared_types::Time;

    use super::*;

    /// Straight east in steps of 1 m; the estimate is `scale` times as far, and turned by `yaw` against the truth.
    fn pairs(scale: f64, yaw: f64) -> Vec<PosePair> {
        let at = |east: f64, yaw: f64| Pose {
            t: Time(0),
            position: Vector3::new(east, 0.0, 0.0),
            attitude: Some(UnitQuaternion::from_euler_angles(0.0, 0.0, yaw)),
        };
        let pair = |index: i32| {
            let east = f64::from(index);
            PosePair { estimate: at(scale * east, yaw), truth: at(east, 0.0) }
        };
        (0..=100).map(pair).collect()
    }

    #[test]
    fn a_median_of_an_even_number_lies_between_the_middle_two() {
        let distances = Distances::of(vec![4.0, 1.0, 3.0, 0.0]).expect("four values");
        assert_eq!((distances.median, distances.mean, distances.min, distances.max), (2.0, 2.0, 0.0, 4.0));
        assert_eq!(distances.rmse, 6.5_f64.sqrt());
        assert_eq!(Distances::of(Vec::new()), None);
    }

    #[test]
    fn a_path_of_double_scale_errs_by_the_way_it_went() {
        let distances = absolute_error(&pairs(2.0, 0.0), Motion::None).expect("there are pairs");
        assert_eq!((distances.median, distances.max), (50.0, 100.0));
        // Scale is no rigid motion: half of the way stays on either side.
        let aligned = absolute_error(&pairs(2.0, 0.0), Motion::Se3).expect("there are pairs");
        assert!((aligned.max - 50.0).abs() < 1e-9, "{aligned:?}");
    }

    #[test]
    fn a_scale_error_of_one_percent_is_one_percent_of_every_stretch() {
        let distances = relative_error(&pairs(1.01, 0.0), 10.0).expect("ten stretches");
        // The path of the estimate reaches 10 m every 10 steps; 101 m are ten stretches.
        assert_eq!(distances.count, 10);
        assert!((distances.rmse - 0.1).abs() < 1e-12, "{distances:?}");
    }

    #[test]
    fn a_heading_error_turns_every_stretch() {
        let distances = relative_error(&pairs(1.0, 0.1), 10.0).expect("ten stretches");
        assert!((distances.mean - 20.0 * (0.05_f64).sin()).abs() < 1e-12, "{distances:?}");
    }

    #[test]
    fn a_path_shorter_than_a_stretch_has_no_relative_error() {
        assert_eq!(relative_error(&pairs(1.0, 0.0), 101.0), None);
        let mut without = pairs(1.0, 0.0);
        without.iter_mut().for_each(|pair| pair.truth.attitude = None);
        assert_eq!(relative_error(&without, 10.0), None);
    }
}
