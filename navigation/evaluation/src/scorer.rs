//! Takes estimates and truth in the order of their times and adds up the errors.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};
use nav_geometry::{Geodetic, LocalFrame};
use shared_types::{Duration, Time, Truth};

use crate::alignment::Alignment;
use crate::association::{EstimatePoint, unit_quaternion};
use crate::axis::{Axis, of_three};
use crate::score::{Score, Window};

/// Where each quantity begins in the table of axes.
const POSITION: usize = 0;
const VELOCITY: usize = 3;
const ATTITUDE: usize = 6;

/// Scores a run as it passes by.
///
/// Truth rows wait for the estimate after them, so the memory is as small as the caller keeps the two streams together.
#[derive(Debug)]
pub struct Scorer {
    frame: LocalFrame,
    window: Window,
    waiting: VecDeque<TruthPoint>,
    last_estimate: Option<EstimatePoint>,
    axes: [Axis; 9],
    horizontal: Axis,
    alignment: Alignment,
    samples: u64,
    missed: u64,
    first: Option<Time>,
    last: Option<(Time, Vector3<f64>, EstimatePoint)>,
    distance: f64,
}

/// A truth row and the estimate carried to its time.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// At the truth's time.
    pub estimate: EstimatePoint,
    /// Where the vehicle was, m.
    pub truth_position_enu: Vector3<f64>,
    /// Estimate minus truth, m.
    pub position_error_enu: Vector3<f64>,
    /// Estimate minus truth, m/s; NaN where the truth has none.
    pub velocity_error_enu: Vector3<f64>,
    /// About body x, body y and the up axis, rad; NaN where the truth has none.
    pub attitude_error: Vector3<f64>,
}

/// A truth row in the navigation frame.
#[derive(Clone, Copy, Debug)]
struct TruthPoint {
    t: Time,
    position_enu: Vector3<f64>,
    velocity_enu: Vector3<f64>,
    q_enu_body: UnitQuaternion<f64>,
}

impl Scorer {
    /// A scorer for estimates in the ENU frame of `origin`, for truth rows within `window`.
    pub fn new(origin: Geodetic, window: Window) -> Scorer {
        Scorer {
            frame: LocalFrame::new(origin),
            window,
            waiting: VecDeque::new(),
            last_estimate: None,
            axes: Default::default(),
            horizontal: Axis::default(),
            alignment: Alignment::default(),
            samples: 0,
            missed: 0,
            first: None,
            last: None,
            distance: 0.0,
        }
    }

    /// Takes a truth row, not earlier than the last one. Give it before the first estimate that is later.
    ///
    /// A row without a position says nothing and is passed over.
    pub fn truth(&mut self, truth: &Truth) {
        let t = Time(truth.header.t_valid);
        let position_enu = self.frame.to_enu(&Geodetic::from_degrees(truth.lat_deg, truth.lon_deg, truth.height));
        if self.window.holds(t) && position_enu.iter().all(|x| x.is_finite()) {
            self.waiting.push_back(TruthPoint {
                t,
                position_enu,
                velocity_enu: truth.velocity_enu.into(),
                q_enu_body: unit_quaternion(truth.q_enu_body),
            });
        }
    }

    /// Takes an estimate, not earlier than the last one.
    pub fn estimate(&mut self, estimate: &EstimatePoint) {
        self.estimate_with(estimate, |_| {});
    }

    /// As [`Scorer::estimate`], and shows every pair that it makes to `see`.
    pub fn estimate_with(&mut self, estimate: &EstimatePoint, mut see: impl FnMut(&Pair)) {
        while let Some(truth) = self.waiting.front().copied().filter(|truth| truth.t <= estimate.t) {
            self.waiting.pop_front();
            let at_truth = match &self.last_estimate {
                Some(last) => last.at(estimate, truth.t),
                None if truth.t == estimate.t => Some(*estimate),
                // Before the first estimate: nobody promised one.
                None => continue,
            };
            match at_truth {
                Some(at_truth) => see(&self.pair(&at_truth, &truth)),
                None => self.missed += 1,
            }
        }
        self.last_estimate = Some(*estimate);
    }

    fn pair(&mut self, estimate: &EstimatePoint, truth: &TruthPoint) -> Pair {
        let pair = Pair {
            estimate: *estimate,
            truth_position_enu: truth.position_enu,
            position_error_enu: estimate.position_enu - truth.position_enu,
            velocity_error_enu: estimate.velocity_enu - truth.velocity_enu,
            attitude_error: attitude_error(&estimate.q_enu_body, &truth.q_enu_body),
        };
        for axis in 0..3 {
            self.axes[POSITION + axis].add(pair.position_error_enu[axis], estimate.sigma_position_enu[axis]);
            self.axes[VELOCITY + axis].add(pair.velocity_error_enu[axis], estimate.sigma_velocity_enu[axis]);
            self.axes[ATTITUDE + axis].add(pair.attitude_error[axis], estimate.sigma_rpy[axis]);
        }
        self.horizontal.add(pair.position_error_enu.xy().norm(), f64::NAN);
        self.alignment.add(&estimate.position_enu, &truth.position_enu);
        self.samples += 1;
        self.first.get_or_insert(truth.t);
        if let Some((_, before, _)) = &self.last {
            self.distance += (truth.position_enu - before).norm();
        }
        self.last = Some((truth.t, truth.position_enu, *estimate));
        pair
    }

    /// The figures so far; `None` while no truth row has met an estimate.
    pub fn score(&self) -> Option<Score> {
        let (t_last, last_truth, last_estimate) = self.last.as_ref()?;
        let t_first = self.first?;
        let position = &self.axes[POSITION..VELOCITY];
        let velocity = &self.axes[VELOCITY..ATTITUDE];
        let attitude = &self.axes[ATTITUDE..];
        let rms_enu = of_three(position, Axis::rms)?;
        let nees_enu = of_three(position, Axis::nees);
        let duration: Duration = *t_last - t_first;
        let degrees = |values: [f64; 3]| values.map(f64::to_degrees);
        Some(Score {
            samples: self.samples,
            missed: self.missed,
            t_first_s: t_first.as_seconds(),
            t_last_s: t_last.as_seconds(),
            duration_s: duration.as_seconds(),
            distance_m: self.distance,
            rms_enu,
            rms_horizontal: self.horizontal.rms()?,
            rms_3d: Vector3::from(rms_enu).norm(),
            max_enu: of_three(position, Axis::max)?,
            max_horizontal: self.horizontal.max()?,
            velocity_rms_enu: of_three(velocity, Axis::rms),
            attitude_rms_deg: of_three(attitude, Axis::rms).map(degrees),
            attitude_max_deg: of_three(attitude, Axis::max).map(degrees),
            nees_enu,
            nees_position: nees_enu.map(|axes| axes.iter().sum()),
            nees_velocity_enu: of_three(velocity, Axis::nees),
            nees_attitude: of_three(attitude, Axis::nees),
            three_sigma_share_enu: of_three(position, Axis::inside),
            three_sigma_share_velocity_enu: of_three(velocity, Axis::inside),
            three_sigma_share_attitude: of_three(attitude, Axis::inside),
            ate_aligned: self.alignment.rms()?,
            final_error_enu: (last_estimate.position_enu - last_truth).into(),
            final_sigma_enu: last_estimate.sigma_position_enu.into(),
        })
    }
}

/// δθ of q_estimate = q_truth ⊗ Exp(δθ), rad: about body x, body y, and the up component of R·δθ.
fn attitude_error(estimate: &UnitQuaternion<f64>, truth: &UnitQuaternion<f64>) -> Vector3<f64> {
    let rotation_body = (truth.inverse() * estimate).scaled_axis();
    let rotation_enu = truth * rotation_body;
    Vector3::new(rotation_body.x, rotation_body.y, rotation_enu.z)
}
