//! A Doppler log that measures something else than the ground under the vehicle.

use nalgebra::{Rotation3, Vector3};
use shared_types::RawReading;

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};

/// Locked to fish or a layer that goes along with the vehicle: `share` of the true velocity remains, and the layer's own comes
/// on top, m/s in the axes of the instrument.
#[derive(Debug)]
pub(crate) struct FalseLock {
    pub(crate) share: f64,
    pub(crate) layer_dvl: [f64; 3],
}

impl Effect for FalseLock {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let RawReading::Dvl(velocity) = &mut passing.reading else { return Fate::Untouched };
        for (axis, layer) in velocity.velocity_dvl.iter_mut().zip(self.layer_dvl) {
            *axis = self.share * *axis + layer;
        }
        Fate::Touched
    }
}

/// Mounted otherwise than the configuration says: turned about its own vertical, deg.
#[derive(Debug)]
pub(crate) struct Mounting {
    pub(crate) yaw_deg: f64,
}

impl Effect for Mounting {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let RawReading::Dvl(velocity) = &mut passing.reading else { return Fate::Untouched };
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), self.yaw_deg.to_radians());
        velocity.velocity_dvl = (turn.inverse() * Vector3::from(velocity.velocity_dvl)).into();
        Fate::Touched
    }
}
