//! The path of the vehicle: one function of time, whose derivatives are taken analytically.
//!
//! ```text
//! position    polynomial of degree 7 per axis and 0.1 s cell, through position, velocity, acceleration and jerk of the
//!             plan at both ends of the cell                                             (three times differentiable)
//! attitude    R_enu_body = Rz(yaw) Ry(pitch) Rx(roll), the angles being profiles         (twice differentiable)
//! ```
//!
//! Velocity and acceleration are derivatives of that same polynomial, so an IMU made from them agrees with the position to
//! rounding, whatever the plan. The path follows the surface of the Earth: `up = −depth − (east² + north²)/2R`.

use nalgebra::{Matrix3, Rotation3, Vector3};
use shared_types::{Duration, Time};

use crate::jet::Jet;
use crate::plan::Plan;

/// ns: so short that the polynomial follows the plan to less than a micrometre.
const CELL_NS: i64 = 100_000_000;
/// s.
const CELL: f64 = CELL_NS as f64 * 1e-9;
/// m: mean radius of the Earth. The depths of readings go through the ellipsoid; this only shapes the path.
const EARTH_RADIUS: f64 = 6_371_000.0;
/// Abscissae in [0, 1] and weights of the five-point Gauss-Legendre rule, exact to degree 9.
const GAUSS: [(f64, f64); 5] = [
    (0.046_910_077_030_668_0, 0.118_463_442_528_094_5),
    (0.230_765_344_947_158_45, 0.239_314_335_249_683_24),
    (0.5, 0.284_444_444_444_444_44),
    (0.769_234_655_052_841_6, 0.239_314_335_249_683_24),
    (0.953_089_922_969_332, 0.118_463_442_528_094_5),
];

/// Where the vehicle is and how it moves at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// m.
    pub position_enu: Vector3<f64>,
    /// m/s.
    pub velocity_enu: Vector3<f64>,
    /// Second derivative of `position_enu`, m/s².
    pub acceleration_enu: Vector3<f64>,
    /// R_enu_body = Rz(yaw) Ry(pitch) Rx(roll).
    pub r_enu_body: Rotation3<f64>,
    /// Rate of the body against the ENU frame, body axes, rad/s.
    pub rate_enu_body: Vector3<f64>,
}

/// Polynomial over one cell, in powers of the part of the cell that has passed.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// At the beginning of the cell, m.
    position_enu: Vector3<f64>,
    /// Coefficients of the powers 1 to 7, m.
    powers: [Vector3<f64>; 7],
}

/// The path of the vehicle.
#[derive(Clone, Debug)]
pub(crate) struct Trajectory {
    plan: Plan,
    cells: Vec<Cell>,
    end: Time,
}

impl Trajectory {
    /// Integrates the plan.
    pub(crate) fn new(plan: Plan) -> Trajectory {
        let end = Time::from_seconds(plan.end);
        let count = (end.0 + CELL_NS - 1) / CELL_NS;
        let mut cells = Vec::with_capacity(count as usize);
        let mut at = plan.start;
        let mut left = derivatives(&plan.velocity(0.0), &at);
        for index in 0..count {
            let t = Time(index * CELL_NS).as_seconds();
            let moved = displacement(&plan, t);
            let after = [at[0] + moved[0], at[1] + moved[1], at[2] + moved[2]];
            let right = derivatives(&plan.velocity(Time((index + 1) * CELL_NS).as_seconds()), &after);
            // The step of `up` without a difference of large numbers.
            let sagitta = (moved[0] * (at[0] + after[0]) + moved[1] * (at[1] + after[1])) / (2.0 * EARTH_RADIUS);
            let step_enu = Vector3::new(moved[0], moved[1], -moved[2] - sagitta);
            let up = -at[2] - (at[0] * at[0] + at[1] * at[1]) / (2.0 * EARTH_RADIUS);
            cells.push(Cell::hermite(Vector3::new(at[0], at[1], up), &step_enu, &left, &right));
            (at, left) = (after, right);
        }
        Trajectory { plan, cells, end }
    }

    /// Its length.
    pub(crate) fn duration(&self) -> Duration {
        self.end - Time(0)
    }

    /// Where the vehicle is at `t`; before the start and after the end, where it is then.
    pub(crate) fn at(&self, t: Time) -> Motion {
        let t = Time(t.0.clamp(0, self.end.0));
        let index = ((t.0 / CELL_NS) as usize).min(self.cells.len() - 1);
        let part = (t.0 - index as i64 * CELL_NS) as f64 / CELL_NS as f64;
        let (position_enu, velocity_enu, acceleration_enu) = self.cells[index].at(part);
        let (r_enu_body, rate_enu_body) = self.attitude(t.as_seconds());
        Motion { position_enu, velocity_enu, acceleration_enu, r_enu_body, rate_enu_body }
    }

    /// Attitude and body rate against ENU at `t`, s.
    fn attitude(&self, t: f64) -> (Rotation3<f64>, Vector3<f64>) {
        let plan = &self.plan;
        let yaw = plan.heading.at(t);
        // y points left: a positive pitch lowers the nose. A positive roll lowers the right side, as a right turn
        // (a falling yaw angle) does.
        let pitch = -(plan.path_angle.at(t) + plan.pitch_wave.at(t));
        let wave = plan.roll_wave.at(t);
        let (roll, roll_rate) = (wave.value() - plan.bank * yaw.0[1], wave.rate() - plan.bank * yaw.0[2]);
        let (sin_roll, cos_roll) = roll.sin_cos();
        let (sin_pitch, cos_pitch) = pitch.value().sin_cos();
        let (sin_yaw, cos_yaw) = yaw.value().sin_cos();
        let r_enu_body = Matrix3::new(
            cos_yaw * cos_pitch,
            cos_yaw * sin_pitch * sin_roll - sin_yaw * cos_roll,
            cos_yaw * sin_pitch * cos_roll + sin_yaw * sin_roll,
            sin_yaw * cos_pitch,
            sin_yaw * sin_pitch * sin_roll + cos_yaw * cos_roll,
            sin_yaw * sin_pitch * cos_roll - cos_yaw * sin_roll,
            -sin_pitch,
            cos_pitch * sin_roll,
            cos_pitch * cos_roll,
        );
        let rate_enu_body = Vector3::new(
            roll_rate - yaw.rate() * sin_pitch,
            pitch.rate() * cos_roll + yaw.rate() * cos_pitch * sin_roll,
            -pitch.rate() * sin_roll + yaw.rate() * cos_pitch * cos_roll,
        );
        (Rotation3::from_matrix_unchecked(r_enu_body), rate_enu_body)
    }
}

/// East, north and depth gained in the cell that begins at `t`, m.
fn displacement(plan: &Plan, t: f64) -> [f64; 3] {
    let mut moved = [0.0; 3];
    for (abscissa, weight) in GAUSS {
        let velocity = plan.velocity(t + abscissa * CELL);
        for axis in 0..3 {
            moved[axis] += weight * CELL * velocity[axis].value();
        }
    }
    moved
}

/// Velocity, acceleration and jerk in ENU from those east, north and downwards at a place.
fn derivatives(velocity: &[Jet; 3], east_north_depth: &[f64; 3]) -> [Vector3<f64>; 3] {
    let position = |axis: usize| {
        let [v, a, j, _] = velocity[axis].0;
        Jet([east_north_depth[axis], v, a, j])
    };
    let (east, north) = (position(0), position(1));
    let up = -position(2) + (east * east + north * north).scaled(-0.5 / EARTH_RADIUS);
    [1, 2, 3].map(|order| Vector3::new(east.0[order], north.0[order], up.0[order]))
}

impl Cell {
    /// The polynomial of degree 7 that moves by `step` and has the given velocity, acceleration and jerk at both ends.
    fn hermite(
        position_enu: Vector3<f64>,
        step: &Vector3<f64>,
        left: &[Vector3<f64>; 3],
        right: &[Vector3<f64>; 3],
    ) -> Cell {
        // Derivatives per cell instead of per second.
        let scale = [CELL, CELL * CELL, CELL * CELL * CELL];
        let [v0, a0, j0] = [left[0] * scale[0], left[1] * scale[1], left[2] * scale[2]];
        let [v1, a1, j1] = [right[0] * scale[0], right[1] * scale[1], right[2] * scale[2]];
        // What the first four terms leave at the end of the cell: position, velocity, acceleration, jerk.
        let p = step - v0 - a0 / 2.0 - j0 / 6.0;
        let v = v1 - v0 - a0 - j0 / 2.0;
        let a = a1 - a0 - j0;
        let j = j1 - j0;
        Cell {
            position_enu,
            powers: [
                v0,
                a0 / 2.0,
                j0 / 6.0,
                p * 35.0 - v * 15.0 + a * 2.5 - j / 6.0,
                p * -84.0 + v * 39.0 - a * 7.0 + j / 2.0,
                p * 70.0 - v * 34.0 + a * 6.5 - j / 2.0,
                p * -20.0 + v * 10.0 - a * 2.0 + j / 6.0,
            ],
        }
    }

    /// Position, velocity and acceleration after `part` of the cell.
    fn at(&self, part: f64) -> (Vector3<f64>, Vector3<f64>, Vector3<f64>) {
        let [c1, c2, c3, c4, c5, c6, c7] = &self.powers;
        let u = part;
        let moved = (((((((c7 * u) + c6) * u + c5) * u + c4) * u + c3) * u + c2) * u + c1) * u;
        let first =
            (((((c7 * (7.0 * u) + c6 * 6.0) * u + c5 * 5.0) * u + c4 * 4.0) * u + c3 * 3.0) * u + c2 * 2.0) * u + c1;
        let second = ((((c7 * (42.0 * u) + c6 * 30.0) * u + c5 * 20.0) * u + c4 * 12.0) * u + c3 * 6.0) * u + c2 * 2.0;
        (self.position_enu + moved, first / CELL, second / (CELL * CELL))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scenario;
    use nav_geometry::so3;

    fn mission() -> Trajectory {
        Trajectory::new(Scenario::builtin("mission").and_then(|s| s.plan()).expect("it is built in"))
    }

    #[test]
    fn velocity_and_acceleration_are_derivatives_of_the_position() {
        let trajectory = mission();
        let step = Duration(1_000_000);
        for tick in 0..19_800_i64 {
            // Off the joints and across them: 111 ms against cells of 100 ms.
            let t = Time(10_000_000 + tick * 110_900_017);
            let [before, here, after] = [t - step, t, t + step].map(|t| trajectory.at(t));
            let velocity = (after.position_enu - before.position_enu) / 2e-3;
            let acceleration = (after.velocity_enu - before.velocity_enu) / 2e-3;
            assert!((velocity - here.velocity_enu).norm() < 1e-6, "{t}: {velocity} {}", here.velocity_enu);
            assert!((acceleration - here.acceleration_enu).norm() < 1e-6, "{t}");
        }
    }

    #[test]
    fn nothing_jumps_at_the_joint_of_two_cells() {
        let trajectory = mission();
        for index in 1..trajectory.cells.len() {
            let (position, velocity, acceleration) = trajectory.cells[index - 1].at(1.0);
            let (next_position, next_velocity, next_acceleration) = trajectory.cells[index].at(0.0);
            // Rounding of a kilometre, of a step divided by the cell and by its square.
            assert!((position - next_position).norm() < 1e-12, "{index}");
            assert!((velocity - next_velocity).norm() < 1e-13, "{index}");
            assert!((acceleration - next_acceleration).norm() < 1e-11, "{index}");
        }
    }

    #[test]
    fn the_rate_turns_the_attitude() {
        let trajectory = mission();
        let step = Duration(1_000_000);
        for tick in 0..1_980_i64 {
            let t = Time(10_000_000 + tick * 1_109_000_170);
            let [before, here, after] = [t - step, t, t + step].map(|t| trajectory.at(t));
            let turned = so3::log((before.r_enu_body.inverse() * after.r_enu_body).matrix()) / 2e-3;
            assert!((turned - here.rate_enu_body).norm() < 1e-6, "{t}: {turned} {}", here.rate_enu_body);
            let not_a_rotation = here.r_enu_body.matrix().tr_mul(here.r_enu_body.matrix()) - Matrix3::identity();
            assert!(not_a_rotation.norm() < 1e-14, "{t}");
        }
    }

    #[test]
    fn dives_end_at_the_depth_that_the_scenario_names() {
        let trajectory = mission();
        for (t, depth) in [(400.0, 0.0), (500.0, 50.0)] {
            let position = trajectory.at(Time::from_seconds(t)).position_enu;
            let sagitta = position.xy().norm_squared() / (2.0 * EARTH_RADIUS);
            let reached = -position.z - sagitta;
            // Simpson against Gauss.
            assert!((reached - depth).abs() < 1e-6, "at {t} s: {reached} instead of {depth}");
        }
    }

    #[test]
    fn a_right_turn_turns_right_and_leans_right_and_a_dive_lowers_the_nose() {
        let text = "origin = [36.0, 127.0, 0.0]\n\
            [initial]\nt = 0.0\nsigma_position = 1.0\nsigma_velocity = 1.0\nsigma_attitude = [1.0, 1.0, 1.0]\n\
            [vehicle]\nheading = 0.0\nspeed = 1.0\nbank = 1.0\n\
            [[segment]]\nmanoeuvre = \"turn\"\nrate = 5.0\nuntil = 20.0\n\
            [[segment]]\nmanoeuvre = \"sink\"\ndepth = 10.0\nuntil = 60.0\n";
        let scenario = Scenario::parse(text, std::path::Path::new("turn.toml")).expect("it is valid");
        let trajectory = Trajectory::new(scenario.plan().expect("it is valid"));
        let turning = trajectory.at(Time::from_seconds(10.0));
        let left_enu = turning.r_enu_body * Vector3::y();
        assert!(turning.position_enu.x > 0.0, "north bound, right is east");
        assert!(left_enu.z > 0.05, "the left side is up: {left_enu}");
        let diving = trajectory.at(Time::from_seconds(40.0));
        assert!((diving.r_enu_body * Vector3::x()).z < -0.2, "the nose is down");
        assert!(diving.velocity_enu.z < -0.2, "{}", diving.velocity_enu);
    }
}
