//! Magnetic compass (MCP): heading of the body x axis from true north **at the vehicle** (§3.7 of the method).
//!
//! ```text
//! R' = C_locᵀ R,  ψ = atan2(R'₁₁, R'₂₁)  (east over north),  residual = wrap(ψ − heading)      [rad], 1 row
//! H_θ = [0, −(R'₂₁R'₁₃ − R'₁₁R'₂₃)/s, (R'₂₁R'₁₂ − R'₁₁R'₂₂)/s],   s = R'₁₁² + R'₂₁²
//! ```
//!
//! The paper compares whole quaternions: a compass knows no roll and no pitch, three rows would invent information. North
//! at the vehicle and north at the origin differ by the convergence of the meridians, 0.007° per km at 36°. √s is the
//! cosine of pitch: near the vertical heading means nothing and the reading must be left out ([`McpModel::is_usable`]).

use core::f64::consts::PI;

use nalgebra::{Matrix3, SMatrix, Vector1, Vector3};
use shared_types::Mcp;

use crate::anchored::{Pose, Seen, SensorModel};
use crate::blocks::transposed_times;
use crate::state::{ATTITUDE, NavState};
use crate::world::WorldModel;

/// Cosine of pitch below which heading is not used: 78° from level.
const MIN_COSINE_OF_PITCH: f64 = 0.2;

/// Below every radius of curvature of the Earth by more than the ocean is deep, m.
const LEAST_RADIUS: f64 = 6.3e6;

/// One heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct McpModel {
    /// Measured, clockwise from true north at the vehicle, declination added, rad.
    pub heading: f64,
    /// 1-sigma when level, rad.
    pub sigma: f64,
}

/// The angle in (−π, π] that equals `angle` but for whole turns.
pub fn wrap(angle: f64) -> f64 {
    let turned = angle - 2.0 * PI * (angle / (2.0 * PI)).round();
    if turned <= -PI { turned + 2.0 * PI } else { turned }
}

impl McpModel {
    /// A heading with the vehicle's sigma.
    pub fn new(heading: f64, mcp: &Mcp) -> McpModel {
        McpModel { heading, sigma: mcp.sigma }
    }

    /// Heading of the body x axis, clockwise from north at the vehicle, rad.
    pub fn predicted_heading(state: &NavState, world: &WorldModel) -> f64 {
        let [east, north] = east_and_north(&state.position_enu, &state.r_enu_body(), world);
        east.x.atan2(north.x)
    }

    /// Whether the body x axis is far enough from the vertical to have a heading.
    pub fn is_usable(state: &NavState, world: &WorldModel) -> bool {
        let r_enu_body = state.r_enu_body();
        // The vertical at the vehicle leans by at most the distance over the smallest radius of curvature from that at the origin:
        // nearly always that settles it, at a tenth of the price.
        let leaning = state.position_enu.norm() / LEAST_RADIUS;
        let sine_of_pitch = r_enu_body[(2, 0)].abs() + leaning;
        if sine_of_pitch * sine_of_pitch <= 1.0 - MIN_COSINE_OF_PITCH * MIN_COSINE_OF_PITCH {
            return true;
        }
        let [east, north] = east_and_north(&state.position_enu, &r_enu_body, world);
        east.x * east.x + north.x * north.x >= MIN_COSINE_OF_PITCH * MIN_COSINE_OF_PITCH
    }
}

/// The first two rows of R': east and north at the vehicle along the axes of the body.
fn east_and_north(position_enu: &Vector3<f64>, r_enu_body: &Matrix3<f64>, world: &WorldModel) -> [Vector3<f64>; 2] {
    world.frame.east_and_north_at(position_enu).map(|axis| transposed_times(r_enu_body, &axis))
}

impl SensorModel<1> for McpModel {
    const SEES_MOTION: bool = false;

    /// ∂ψ/∂p, at most tan φ/N, is left out; R_z is (σ/cos pitch)².
    fn see(&self, pose: &Pose, world: &WorldModel) -> Seen<1> {
        let [east, north] = east_and_north(&pose.position_enu, &pose.r_enu_body, world);
        let s = (east.x * east.x + north.x * north.x).max(MIN_COSINE_OF_PITCH * MIN_COSINE_OF_PITCH);
        let mut jacobian = SMatrix::<f64, 1, 9>::zeros();
        jacobian[ATTITUDE + 1] = -(north.x * east.z - east.x * north.z) / s;
        jacobian[ATTITUDE + 2] = (north.x * east.y - east.x * north.y) / s;
        Seen {
            residual: Vector1::new(wrap(east.x.atan2(north.x) - self.heading)),
            jacobian,
            covariance: SMatrix::<f64, 1, 1>::new(self.sigma * self.sigma / s),
        }
    }
}
