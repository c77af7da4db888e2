//! Estimate against truth, both at the truth's own time.
//!
//! ```text
//! error = estimate(t_truth) − truth,      estimate(t) on the straight line between its two neighbours
//! ```
//!
//! Truth and estimates come from different processes and in any order, so each waits for the other. The angles are compared
//! in the axes of the origin, where both are given.

use std::collections::VecDeque;

use nalgebra::{Matrix2, UnitQuaternion, Vector2, Vector3};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Duration, Message, Mode, NavEstimate, Time, Truth, channel};

use super::attitude::{roll_pitch_heading, unit_quaternion, wrapped};
use crate::snapshot::TruthError;

/// An estimate this far from the truth's time says nothing about it.
const NEAR: Duration = Duration(20_000_000);

/// What a comparison needs of an estimate.
#[derive(Clone, Copy, Debug)]
struct Point {
    t: Time,
    position_enu: Vector3<f64>,
    q_enu_body: UnitQuaternion<f64>,
    position_cov: [f64; 6],
    sigma_rpy: [f64; 3],
}

/// Brings truths and estimates together.
#[derive(Clone, Debug, Default)]
pub(super) struct Comparison {
    /// By time.
    estimates: VecDeque<Point>,
    waiting: VecDeque<Truth>,
    count: u64,
    sum_of_squares: [f64; 3],
    newest: Option<TruthError>,
}

impl Comparison {
    /// Takes in an estimate; those of no place are left out.
    pub(super) fn estimate(&mut self, estimate: &NavEstimate) {
        let Some(q_enu_body) = unit_quaternion(estimate.q_enu_body) else { return };
        if estimate.mode() == Mode::Initialising || !estimate.position_enu.iter().all(|x| x.is_finite()) {
            return;
        }
        let t = estimate.t_valid();
        // A restarted propagator repeats a little.
        while self.estimates.back().is_some_and(|last| last.t >= t) {
            self.estimates.pop_back();
        }
        if self.estimates.len() == channel::ESTIMATE.spec.queue {
            self.estimates.pop_front();
        }
        self.estimates.push_back(Point {
            t,
            position_enu: estimate.position_enu.into(),
            q_enu_body,
            position_cov: estimate.position_cov,
            sigma_rpy: estimate.sigma_rpy,
        });
    }

    /// Takes in a truth.
    pub(super) fn truth(&mut self, truth: &Truth) {
        if self.waiting.len() == channel::TRUTH.spec.queue {
            self.waiting.pop_front();
        }
        self.waiting.push_back(*truth);
    }

    /// Compares what can be compared by now.
    pub(super) fn settle(&mut self, frame: &LocalFrame) {
        while let Some(truth) = self.waiting.front().copied() {
            let t = truth.t_valid();
            if self.estimates.back().is_none_or(|last| last.t < t) {
                return;
            }
            self.waiting.pop_front();
            if let Some(estimate) = self.at(t) {
                self.compare(&estimate, &truth, frame);
            }
        }
    }

    /// The newest error.
    pub(super) fn newest(&self) -> Option<&TruthError> {
        self.newest.as_ref()
    }

    fn at(&self, t: Time) -> Option<Point> {
        let index = self.estimates.partition_point(|point| point.t < t);
        let after = *self.estimates.get(index)?;
        if after.t == t {
            return Some(after);
        }
        let before = *self.estimates.get(index.checked_sub(1)?)?;
        if t - before.t > NEAR || after.t - t > NEAR {
            return None;
        }
        let fraction = (t - before.t).as_seconds() / (after.t - before.t).as_seconds();
        let nearer = if fraction < 0.5 { before } else { after };
        // Half a turn within 40 ms has no way between.
        let q_enu_body = before.q_enu_body.try_slerp(&after.q_enu_body, fraction, 1e-9).unwrap_or(nearer.q_enu_body);
        Some(Point { t, position_enu: before.position_enu.lerp(&after.position_enu, fraction), q_enu_body, ..nearer })
    }

    fn compare(&mut self, estimate: &Point, truth: &Truth, frame: &LocalFrame) {
        let truth_geodetic = Geodetic::from_degrees(truth.lat_deg, truth.lon_deg, truth.height);
        let truth_enu = frame.to_enu(&truth_geodetic);
        let error = estimate.position_enu - truth_enu;
        let Some(q_truth) = unit_quaternion(truth.q_enu_body) else { return };
        if !error.iter().all(|x| x.is_finite()) {
            return;
        }
        self.count += 1;
        for (sum, axis) in self.sum_of_squares.iter_mut().zip(error.iter()) {
            *sum += axis * axis;
        }
        let angles = roll_pitch_heading(estimate.q_enu_body.to_rotation_matrix().matrix());
        let true_angles = roll_pitch_heading(q_truth.to_rotation_matrix().matrix());
        let angle_error: [f64; 3] = core::array::from_fn(|index| wrapped(angles[index] - true_angles[index]));
        let [ee, en, _, nn, _, uu] = estimate.position_cov;
        let horizontal = Vector2::new(error.x, error.y);
        let squared_distance = Matrix2::new(ee, en, en, nn)
            .try_inverse()
            .map_or(f64::NAN, |information| (horizontal.transpose() * information * horizontal)[0]);
        self.newest = Some(TruthError {
            t: truth.t_valid().as_seconds(),
            truth_enu: truth_enu.into(),
            position_enu: error.into(),
            position_in_sigmas: [error.x / ee.sqrt(), error.y / nn.sqrt(), error.z / uu.sqrt()],
            horizontal: horizontal.norm(),
            horizontal_in_sigmas: squared_distance.sqrt(),
            roll_pitch_heading_deg: angle_error.map(f64::to_degrees),
            roll_pitch_heading_in_sigmas: core::array::from_fn(|index| angle_error[index] / estimate.sigma_rpy[index]),
            rms_position_enu: self.sum_of_squares.map(|sum| (sum / self.count as f64).sqrt()),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{estimate_at, frame, truth_at};

    #[test]
    fn a_truth_between_two_estimates_is_compared_at_its_own_time() {
        let mut comparison = Comparison::default();
        // One metre per second east; the truth lies 2 ms after the first estimate and 0.5 m north of the way.
        comparison.truth(&truth_at(10.002, [0.002, -0.5, 0.0]));
        comparison.estimate(&estimate_at(10.0, [0.0, 0.0, 0.0]));
        comparison.settle(&frame());
        assert_eq!(comparison.newest(), None, "the estimate after it has not come yet");
        comparison.estimate(&estimate_at(10.005, [0.005, 0.0, 0.0]));
        comparison.settle(&frame());
        let error = comparison.newest().expect("both neighbours are there");
        let [east, north, up] = error.position_enu;
        assert!(east.abs() < 1e-7 && (north - 0.5).abs() < 1e-7 && up.abs() < 1e-7, "{:?}", error.position_enu);
        // The fixture's sigmas are 0.2, 0.25 and 0.1 m.
        assert!((error.position_in_sigmas[1] - 2.0).abs() < 1e-6, "{:?}", error.position_in_sigmas);
        assert!((error.horizontal - 0.5).abs() < 1e-7 && (error.horizontal_in_sigmas - 2.0).abs() < 1e-6);
        assert!(error.roll_pitch_heading_deg.iter().all(|angle| angle.abs() < 1e-9));
    }

    #[test]
    fn a_truth_without_a_near_estimate_is_not_compared() {
        let mut comparison = Comparison::default();
        comparison.truth(&truth_at(10.5, [0.0; 3]));
        comparison.estimate(&estimate_at(10.0, [0.0; 3]));
        comparison.estimate(&estimate_at(11.0, [0.0; 3]));
        comparison.settle(&frame());
        assert_eq!(comparison.newest(), None);
        assert!(comparison.waiting.is_empty());
    }

    #[test]
    fn the_rms_is_that_of_all_comparisons() {
        let mut comparison = Comparison::default();
        for (t, east) in [(1.0, 0.3), (2.0, 0.4)] {
            comparison.estimate(&estimate_at(t, [east, 0.0, 0.0]));
            comparison.truth(&truth_at(t, [0.0; 3]));
            comparison.settle(&frame());
        }
        let rms = comparison.newest().expect("compared").rms_position_enu[0];
        assert!((rms - 0.125_f64.sqrt()).abs() < 1e-7, "{rms}");
    }

    #[test]
    fn a_repetition_by_a_restarted_propagator_keeps_the_order() {
        let mut comparison = Comparison::default();
        for t in [1.0, 1.005, 1.010, 1.0, 1.005] {
            comparison.estimate(&estimate_at(t, [t, 0.0, 0.0]));
        }
        let times: Vec<i64> = comparison.estimates.iter().map(|point| point.t.0).collect();
        assert_eq!(times, [1_000_000_000, 1_005_000_000]);
    }
}
