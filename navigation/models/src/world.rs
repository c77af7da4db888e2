//! What the vehicle moves in: the local frame, gravity and the Earth's rotation.

use nalgebra::Vector3;
use nav_geometry::{Geodetic, GravityModel, LocalFrame};
use shared_types::Config;

/// Frame, gravity and Earth rate of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldModel {
    /// East-North-Up frame of the run.
    pub frame: LocalFrame,
    /// Gravity as a function of position.
    pub gravity: GravityModel,
    /// Rate of the Earth, rad/s; zero when its rotation is switched off.
    pub earth_rate_enu: Vector3<f64>,
}

impl WorldModel {
    /// The world around `origin` as configured: `world.gravity_in_water`, `world.earth_rotation`, `frame.surface_height`.
    pub fn new(origin: Geodetic, config: &Config) -> WorldModel {
        let frame = LocalFrame::new(origin);
        let water_surface = config.navigator.gravity_in_water.then_some(config.vehicle.frame.surface_height);
        WorldModel {
            frame,
            gravity: GravityModel::new(frame, water_surface),
            earth_rate_enu: if config.navigator.earth_rotation { frame.earth_rate_enu() } else { Vector3::zeros() },
        }
    }
}
