//! When the heading itself is wrong: the window begins anew, and the heading that explains it best is taken.
//!
//! Loosening (`nav_models::recovery`) brings back a position and a velocity; a heading that is wrong by more than some degrees
//! it does not: the step from there is wrong too, at 180° it has not even a direction, and the next epochs are refused
//! again. So the third loosening, each within two minutes of the last, begins a realignment:
//!
//! ```text
//! keyframe 0    the window starts anew here: position as loosened, velocity and heading unknown, tilt from the
//!               mean specific force to 3°, biases as at the start
//! 1 to 10       as ever, while the covariance covers a heading of which nothing is known:  C + JJᵀ·(104°)²,
//!               J = ∂x/∂(heading) = (0, ẑ×v, Rᵀẑ, 0, 0)
//! 10 to 20      eight headings, 45° apart, each carried through the samples and solved as one batch; one is taken if it
//!               explains the readings better by 9 in ½χ² than all that end elsewhere, at 20 in any case
//! ```
//!
//! The same is done where the state has become absurd, from where it was last well, and after a gap of the IMU that nothing bridges,
//! from where the vehicle was before.
//!
//! That is the moving initialisation of §5 of the method, within the window. It takes some tens of ms, once, and allocates: it
//! is no part of steady work.

use core::f64::consts::{FRAC_PI_4, PI};

use nalgebra::{UnitQuaternion, Vector3};
use nav_models::preintegration::{ImuPoint, Increment, Preintegration};
use nav_models::recovery::Loosening;
use nav_models::state::{ATTITUDE, NavState, VELOCITY};
use shared_types::{Duration, ImuNoise, Time};

use crate::interval::{ImuHistory, ImuModel};
use crate::kernels::{Block, BlockVector};
use crate::rows::DIM;
use crate::window::Window;

/// Loosenings, none later than [`SOON`] after the one before, that begin a realignment: a good state is loosened never.
const LOOSENINGS: u32 = 3;
const SOON: Duration = Duration(120_000_000_000);
/// Headings tried; an eighth of a turn is well within the reach of Gauss-Newton.
const HEADINGS: usize = 8;
/// Intervals after which headings are first compared, and at the latest decided upon.
const COMPARED_AFTER: usize = 10;
const DECIDED_AFTER: usize = 20;
/// Sweeps per heading.
const PASSES: u32 = 12;
/// Difference of ½χ² that decides: the worse one is less probable than 1 in 8000.
const DECISIVE: f64 = 9.0;
/// Headings that end within this of each other, rad, are the same solution.
const SAME_HEADING: f64 = 0.1;
/// 1-sigma of a heading of which nothing is known, rad: that of a uniform one, π/√3.
const UNKNOWN_HEADING: f64 = 1.8137993642342178;
/// 1-sigma of the tilt, rad, and least and largest of the velocity, m/s.
const TILT: f64 = 0.05;
/// Specific force of a vehicle that does not accelerate, and how far from it one may be that manoeuvres, m/s².
const GRAVITY: f64 = 9.8;
const GRAVITY_WITHIN: f64 = 1.0;
const VELOCITY_LEAST: f64 = 3.0;
const VELOCITY_MOST: f64 = 30.0;

/// What is known of a vehicle whose state has become absurd: that it is within a kilometre of where it was last well.
pub const LOST: Loosening = Loosening { position: 1e3, velocity: 30.0, attitude: 0.05, ..Loosening::NONE };
/// A vehicle that nobody sees for so many s may have gone anywhere at the speed that it had, or at this one, m/s.
const UNSEEN_SPEED: f64 = 1.0;

/// What is known of a vehicle after a gap of the IMU that nothing bridges: how far it may have gone.
pub fn unseen(before: &NavState, gap: Duration) -> Loosening {
    let speed = before.velocity_enu.norm().max(UNSEEN_SPEED);
    Loosening { position: speed * gap.as_seconds(), velocity: speed, ..LOST }
}

/// The increment of a moment at this sample.
pub fn instant(point: &ImuPoint) -> Increment {
    const MOMENT: f64 = 1e-3;
    let mut increment = Preintegration::new(Vector3::zeros(), Vector3::zeros());
    increment.step_mean(MOMENT, point, point);
    increment.increment
}

/// Beyond these nothing that navigates by sound is: m from the origin, m/s. Long before numbers become none, too.
const FARTHEST: f64 = 1e6;
const FASTEST: f64 = 300.0;

/// Whether a vehicle can be there.
pub fn is_plausible(state: &NavState) -> bool {
    state.is_finite() && state.position_enu.norm() < FARTHEST && state.velocity_enu.norm() < FASTEST
}

/// Where a realignment stands.
#[derive(Clone, Debug, Default)]
pub struct Realignment {
    loosenings: u32,
    last_loosening: Option<Time>,
    /// First state of the window that was begun anew, and its covariance.
    search: Option<(NavState, Block<DIM>)>,
    last_well: Option<NavState>,
}

impl Realignment {
    /// Whether a keyframe that was loosened at `t` is one too many.
    pub fn is_due(&mut self, t: Time) -> bool {
        let is_soon = self.last_loosening.is_some_and(|last| t - last <= SOON);
        self.loosenings = if is_soon { self.loosenings + 1 } else { 1 };
        self.last_loosening = Some(t);
        self.search.is_none() && self.loosenings >= LOOSENINGS
    }

    /// The newest state is one that nothing speaks against.
    pub fn is_well(&mut self, state: &NavState) {
        self.last_well = Some(*state);
    }

    /// The last state of which that was said; the origin before.
    pub fn last_well(&self) -> NavState {
        self.last_well.unwrap_or_else(NavState::identity)
    }

    /// Whether the heading is still looked for.
    pub fn is_searching(&self) -> bool {
        self.search.is_some()
    }

    /// The state to begin anew with in place of `predicted`, and its covariance, of which `height_sigma`, m, is known. `whole` is
    /// the closing interval: its mean specific force is taken for upwards, if it is as long as gravity.
    pub fn begin(
        &mut self,
        predicted: &NavState,
        loosening: &Loosening,
        height_sigma: f64,
        whole: &Increment,
        noise: &ImuNoise,
    ) -> (NavState, Block<DIM>) {
        let speed = predicted.velocity_enu.norm();
        let first = NavState {
            q_enu_body: levelled(&predicted.q_enu_body, whole),
            velocity_enu: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
            gyro_bias: Vector3::zeros(),
            ..*predicted
        };
        // A glitch that spoilt the rest spoilt the height as well.
        let height = height_sigma.max(loosening.position);
        let velocity = (2.0 * speed).clamp(VELOCITY_LEAST, VELOCITY_MOST);
        let sigmas = [
            [loosening.position, loosening.position, height],
            [velocity; 3],
            [TILT; 3],
            [noise.accel_bias_sigma; 3],
            [noise.gyro_bias_sigma; 3],
        ];
        let diagonal = BlockVector::<DIM>::from_fn(|at, _| sigmas[at / 3][at % 3].powi(2));
        let mut covariance = Block::from_diagonal(&diagonal);
        let up_body = first.q_enu_body.inverse() * Vector3::z();
        let mut tilt = covariance.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE);
        tilt += up_body * up_body.transpose() * UNKNOWN_HEADING.powi(2);
        self.search = Some((first, covariance));
        self.loosenings = 0;
        (first, covariance)
    }

    /// Compares headings, if the window is long enough; whether the search is over.
    pub fn search(&mut self, window: &mut Window, longest: usize, history: &ImuHistory, imu: &ImuModel) -> bool {
        let Some((first, covariance)) = &self.search else { return true };
        let intervals = window.nodes().len() - 1;
        if intervals < COMPARED_AFTER.min(longest) {
            return false;
        }
        let must_decide = intervals >= DECIDED_AFTER.min(longest);
        // The present solution is what remains if no heading leads anywhere.
        let kept = window.remember();
        let mut found = [(f64::INFINITY, 0.0, 0); HEADINGS];
        for (index, found) in found.iter_mut().enumerate() {
            if window.begin_at(&turned(first, index), covariance, history, imu).is_err() {
                continue;
            }
            let report = window.solve_batch(PASSES, history, imu);
            let heading = window.nodes().back().map_or(f64::NAN, |newest| heading(&newest.state));
            let cost = if heading.is_finite() { report.cost[1] } else { f64::INFINITY };
            *found = (cost, heading, index);
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (best, others) = (found[0], &found[1..]);
        let is_elsewhere = |other: &&(f64, f64, usize)| angle_between(other.1, best.1) > SAME_HEADING;
        let runner_up = others.iter().find(is_elsewhere).map_or(f64::INFINITY, |other| other.0);
        let is_decided = best.0.is_finite() && (must_decide || runner_up - best.0 > DECISIVE);
        if is_decided && window.begin_at(&turned(first, best.2), covariance, history, imu).is_ok() {
            window.solve_batch(PASSES, history, imu);
            self.search = None;
            return true;
        }
        window.go_back(kept, history, imu);
        window.solve_batch(PASSES, history, imu);
        if must_decide {
            self.search = None;
        }
        must_decide
    }

    /// What the covariance of the newest state lacks while nothing is known of its heading.
    pub fn cover(&self, state: &NavState, covariance: &mut Block<DIM>) {
        if self.search.is_none() {
            return;
        }
        let mut by_heading = BlockVector::<DIM>::zeros();
        by_heading.fixed_rows_mut::<3>(VELOCITY).copy_from(&Vector3::z().cross(&state.velocity_enu));
        by_heading.fixed_rows_mut::<3>(ATTITUDE).copy_from(&(state.q_enu_body.inverse() * Vector3::z()));
        *covariance += by_heading * by_heading.transpose() * UNKNOWN_HEADING.powi(2);
    }
}

/// The attitude with its tilt from the mean specific force of the interval that ends there, its heading as before.
fn levelled(q_enu_body: &UnitQuaternion<f64>, whole: &Increment) -> UnitQuaternion<f64> {
    // β/T is the mean in the axes at the beginning, biases removed; the state's biases may be what went wrong.
    let mean = whole.gamma.transpose() * (whole.beta / whole.dt_total + whole.accel_bias);
    let is_gravity = (mean.norm() - GRAVITY).abs() < GRAVITY_WITHIN;
    let up = Vector3::z();
    let tilt = UnitQuaternion::rotation_between(&(q_enu_body * mean), &up).filter(|_| is_gravity);
    tilt.map_or(*q_enu_body, |tilt| tilt * q_enu_body)
}

/// The same state with another heading.
fn turned(state: &NavState, index: usize) -> NavState {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_4 * index as f64);
    NavState { q_enu_body: turn * state.q_enu_body, ..*state }
}

/// Angle of the body's x axis in the horizontal, from east to north, rad.
fn heading(state: &NavState) -> f64 {
    let forward = state.q_enu_body * Vector3::x();
    forward.y.atan2(forward.x)
}

fn angle_between(a: f64, b: f64) -> f64 {
    ((a - b + PI).rem_euclid(2.0 * PI) - PI).abs()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_loosenings_in_a_row_are_one_too_many_and_scattered_ones_are_not() {
        let mut realignment = Realignment::default();
        let due = |realignment: &mut Realignment, t: f64| realignment.is_due(Time::from_seconds(t));
        assert!(!due(&mut realignment, 0.0) && !due(&mut realignment, 100.0));
        assert!(!due(&mut realignment, 250.0), "150 s later");
        assert!(!due(&mut realignment, 300.0) && due(&mut realignment, 400.0));
    }

    #[test]
    fn an_unknown_heading_is_covered_as_far_as_it_turns_the_velocity() {
        let mut state = NavState::identity();
        state.velocity_enu = Vector3::new(2.0, 0.0, 0.0);
        let mut realignment = Realignment::default();
        let mut covariance = Block::<DIM>::zeros();
        realignment.cover(&state, &mut covariance);
        assert_eq!(covariance, Block::<DIM>::zeros(), "nothing is searched");
        let loosening = Loosening { position: 5.0, velocity: 1.0, attitude: 0.05, ..Loosening::NONE };
        let noise =
            ImuNoise { accel_bias_sigma: 0.01, gyro_bias_sigma: 1e-4, ..shared_types::Config::default().vehicle.imu };
        let (first, begun) = realignment.begin(&state, &loosening, 0.1, &still(Vector3::z() * 9.8), &noise);
        assert_eq!(first.velocity_enu, Vector3::zeros());
        assert!((begun[(8, 8)].sqrt() - UNKNOWN_HEADING.hypot(TILT)).abs() < 1e-12);
        realignment.cover(&state, &mut covariance);
        assert!((covariance[(VELOCITY + 1, VELOCITY + 1)].sqrt() - 2.0 * UNKNOWN_HEADING).abs() < 1e-12);
        assert_eq!(covariance[(VELOCITY, VELOCITY)], 0.0);
    }

    /// A second at rest under this specific force.
    fn still(force_body: Vector3<f64>) -> Increment {
        let mut whole = Preintegration::new(Vector3::zeros(), Vector3::zeros());
        let point = ImuPoint { gyro_body: Vector3::zeros(), accel_body: force_body };
        whole.step_mean(1.0, &point, &point);
        whole.increment
    }

    #[test]
    fn a_tilt_that_gravity_contradicts_is_put_right_and_the_heading_stays() {
        let (roll, heading) = (1.0, 0.7);
        let wrong = UnitQuaternion::from_euler_angles(roll, 0.0, heading);
        let levelled_at_rest = levelled(&wrong, &still(Vector3::z() * 9.8));
        let up_body = levelled_at_rest.inverse() * Vector3::z();
        assert!((up_body - Vector3::z()).norm() < 1e-12);
        assert!(angle_between(levelled_at_rest.euler_angles().2, heading) < 1e-12);
        assert_eq!(levelled(&wrong, &still(Vector3::z() * 30.0)), wrong, "no gravity is that strong");
    }

    #[test]
    fn an_unseen_vehicle_may_have_gone_on_as_it_went_and_is_level_as_its_first_sample_says() {
        let mut before = NavState::identity();
        let gap = Duration::from_seconds(60.0);
        assert!((unseen(&before, gap).position - 60.0).abs() < 1e-9, "at rest before: a metre a second");
        before.velocity_enu.x = 2.0;
        assert!((unseen(&before, gap).position - 120.0).abs() < 1e-9);
        before.q_enu_body = UnitQuaternion::from_euler_angles(1.0, 0.0, 0.7);
        let rolled = ImuPoint { gyro_body: Vector3::x(), accel_body: Vector3::new(0.0, 9.8, 0.0) };
        let up_body = levelled(&before.q_enu_body, &instant(&rolled)).inverse() * Vector3::z();
        assert!((up_body - Vector3::y()).norm() < 1e-2, "{up_body}");
    }

    #[test]
    fn a_state_that_no_vehicle_has_is_lost() {
        let mut state = NavState::identity();
        assert!(is_plausible(&state));
        state.velocity_enu.x = 1e3;
        assert!(!is_plausible(&state));
        state.velocity_enu.x = f64::NAN;
        assert!(!is_plausible(&state));
    }

    #[test]
    fn angles_are_compared_across_the_seam() {
        assert!((angle_between(3.1, -3.1) - (2.0 * PI - 6.2)).abs() < 1e-12);
    }
}
