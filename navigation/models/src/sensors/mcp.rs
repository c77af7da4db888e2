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

use nalgebra::{Matrix3, SMatrix, SVector, Vector1};
use shared_types::Mcp;

use crate::anchored::SensorModel;
use crate::state::{ATTITUDE, NavState};
use crate::world::WorldModel;

/// Cosine of pitch below which heading is not used: 78° from level.
const MIN_COSINE_OF_PITCH: f64 = 0.2;

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
        let r_local_body = r_local_body(state, world);
        r_local_body[(0, 0)].atan2(r_local_body[(1, 0)])
    }

    /// Whether the body x axis is far enough from the vertical to have a heading.
    pub fn is_usable(state: &NavState, world: &WorldModel) -> bool {
        let r_local_body = r_local_body(state, world);
        let (east, north) = (r_local_body[(0, 0)], r_local_body[(1, 0)]);
        east * east + north * north >= MIN_COSINE_OF_PITCH * MIN_COSINE_OF_PITCH
    }
}

fn r_local_body(state: &NavState, world: &WorldModel) -> Matrix3<f64> {
    world.frame.local_axes_at(&state.position_enu).tr_mul(&state.r_enu_body())
}

impl SensorModel<1> for McpModel {
    fn residual(&self, state: &NavState, world: &WorldModel) -> SVector<f64, 1> {
        Vector1::new(wrap(McpModel::predicted_heading(state, world) - self.heading))
    }

    /// ∂ψ/∂p, at most tan φ/N, is left out.
    fn jacobian(&self, state: &NavState, world: &WorldModel) -> SMatrix<f64, 1, 9> {
        let r = r_local_body(state, world);
        let (east, north) = (r[(0, 0)], r[(1, 0)]);
        let s = (east * east + north * north).max(MIN_COSINE_OF_PITCH * MIN_COSINE_OF_PITCH);
        let mut jacobian = SMatrix::<f64, 1, 9>::zeros();
        jacobian[ATTITUDE + 1] = -(north * r[(0, 2)] - east * r[(1, 2)]) / s;
        jacobian[ATTITUDE + 2] = (north * r[(0, 1)] - east * r[(1, 1)]) / s;
        jacobian
    }

    /// (σ/cos pitch)².
    fn covariance(&self, state: &NavState, world: &WorldModel) -> SMatrix<f64, 1, 1> {
        let r = r_local_body(state, world);
        let s = r[(0, 0)] * r[(0, 0)] + r[(1, 0)] * r[(1, 0)];
        SMatrix::<f64, 1, 1>::new(self.sigma * self.sigma / s.max(MIN_COSINE_OF_PITCH * MIN_COSINE_OF_PITCH))
    }
}
