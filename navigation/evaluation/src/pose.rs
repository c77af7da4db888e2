//! Poses of two trajectories that belong together.
//!
//! A pose of the shorter trajectory goes with the nearest in time of the longer one, if that is near enough; of two equally near,
//! with the earlier. That is how `evo` and the TUM benchmark associate, so that figures compare with published ones. Nothing is
//! interpolated: a trajectory may come at any rate, and between two poses of a slow one there is no knowing.

use nalgebra::{UnitQuaternion, Vector3};
use shared_types::{Duration, Time};

/// Where a body was and how it was turned, in a frame with its z axis up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Data time.
    pub t: Time,
    /// m.
    pub position: Vector3<f64>,
    /// Body to the frame of `position`; `None` where the source has none.
    pub attitude: Option<UnitQuaternion<f64>>,
}

/// Poses of one instant: what was estimated and what was true.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PosePair {
    /// Of the trajectory that is scored.
    pub estimate: Pose,
    /// Of the reference.
    pub truth: Pose,
}

/// Pairs the poses of two trajectories, each in order of time, whose times differ by at most `max_difference`.
pub fn associate(estimates: &[Pose], truths: &[Pose], max_difference: Duration) -> Vec<PosePair> {
    if truths.len() > estimates.len() {
        let pairs = nearest(estimates, truths, max_difference);
        pairs.map(|(estimate, truth)| PosePair { estimate, truth }).collect()
    } else {
        let pairs = nearest(truths, estimates, max_difference);
        pairs.map(|(truth, estimate)| PosePair { estimate, truth }).collect()
    }
}

/// Each of `few` with the nearest of `many`.
fn nearest(few: &[Pose], many: &[Pose], max_difference: Duration) -> impl Iterator<Item = (Pose, Pose)> {
    few.iter().filter_map(move |pose| {
        let after = many.partition_point(|other| other.t < pose.t);
        // Of several at one instant the first, as a search from the beginning finds it.
        let before = after.checked_sub(1).map(|last| many.partition_point(|other| other.t < many[last].t));
        let candidates = before.into_iter().chain((after < many.len()).then_some(after));
        let best = candidates.min_by_key(|&index| (many[index].t - pose.t).abs())?;
        ((many[best].t - pose.t).abs() <= max_difference).then_some((*pose, many[best]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poses(millis: &[i64]) -> Vec<Pose> {
        let pose = |ms: &i64| Pose { t: Time(ms * 1_000_000), position: Vector3::zeros(), attitude: None };
        millis.iter().map(pose).collect()
    }

    fn pairs(estimates: &[i64], truths: &[i64]) -> Vec<(i64, i64)> {
        let ms = |pose: &Pose| pose.t.0 / 1_000_000;
        let associated = associate(&poses(estimates), &poses(truths), Duration(10_000_000));
        associated.iter().map(|pair| (ms(&pair.estimate), ms(&pair.truth))).collect()
    }

    #[test]
    fn each_pose_of_the_shorter_trajectory_goes_with_the_nearest_of_the_longer() {
        assert_eq!(pairs(&[0, 5, 10, 15, 20], &[4, 19]), [(5, 4), (20, 19)]);
        assert_eq!(pairs(&[4, 19], &[0, 5, 10, 15, 20]), [(4, 5), (19, 20)]);
    }

    #[test]
    fn of_two_equally_near_the_earlier_counts_and_none_beyond_the_limit() {
        assert_eq!(pairs(&[0, 10, 40], &[5, 60]), [(0, 5)]);
    }

    #[test]
    fn trajectories_without_a_common_time_have_no_pair() {
        assert_eq!(pairs(&[0, 5], &[1000]), []);
        assert_eq!(pairs(&[], &[1000]), []);
    }
}
