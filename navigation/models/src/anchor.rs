//! The keyframe that readings are tied to, and carried from to their own times.
//!
//! ```text
//! g(p_k + ½T v_k) = g(p_k) + ½T [g(p_k + v_k·1 s) − g(p_k)]
//! ```
//!
//! Some thirty readings leave from one keyframe: its rotation matrix and gravity around it are worked out once for all of them. The line
//! stands for the curve to (vT/R)² g, some 1e-11 m/s² a second away.

use nalgebra::{Matrix3, Vector3};

use crate::state::NavState;
use crate::world::WorldModel;

/// A state, and what each reading tied to it needs to know of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    /// The state itself.
    pub state: NavState,
    /// R.
    pub r_enu_body: Matrix3<f64>,
    /// g at it, m/s².
    pub gravity_enu: Vector3<f64>,
    /// What g is more where its velocity would lead to within a second, m/s².
    gravity_change: Vector3<f64>,
}

impl Anchor {
    /// From `state`.
    pub fn new(state: &NavState, world: &WorldModel) -> Anchor {
        let gravity_enu = world.gravity.at(&state.position_enu);
        let gravity_change = world.gravity.at(&(state.position_enu + state.velocity_enu)) - gravity_enu;
        Anchor { state: *state, r_enu_body: state.r_enu_body(), gravity_enu, gravity_change }
    }

    /// g half way of a signed time, m/s².
    #[inline]
    pub(crate) fn gravity_over(&self, dt: f64) -> Vector3<f64> {
        self.gravity_enu + self.gravity_change * (0.5 * dt)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::world;

    #[test]
    fn gravity_on_the_way_is_that_of_the_place() {
        let world = world();
        let state = NavState {
            position_enu: Vector3::new(12e3, -7e3, -800.0),
            velocity_enu: Vector3::new(3.0, -4.0, 1.5),
            ..NavState::identity()
        };
        let anchor = Anchor::new(&state, &world);
        for dt in [-1.25, -0.3, 0.0, 0.6, 2.0] {
            let there = world.gravity.at(&(state.position_enu + state.velocity_enu * (0.5 * dt)));
            let off = (anchor.gravity_over(dt) - there).norm();
            assert!(off < 5e-11, "{dt} s: {off:e} m/s²");
        }
    }
}
