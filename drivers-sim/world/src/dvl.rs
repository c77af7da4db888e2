//! Doppler log: velocity of its transducer over ground, in its own axes.
//!
//! ```text
//! u = Mᵀ(Rᵀ v + ω_nb × l),   M = Rz(yaw) Ry(pitch) Rx(roll) of the mounting angles
//! ```

use std::sync::Arc;

use nalgebra::{Rotation3, Vector3};
use shared_types::{DvlVelocity, Header, Time};

use crate::noise::Draws;
use crate::readings::Instrument;
use crate::scenario::DvlSetup;
use crate::world::Core;

#[derive(Clone, Debug)]
pub(crate) struct Dvl {
    core: Arc<Core>,
    setup: DvlSetup,
    r_body_dvl: Rotation3<f64>,
}

impl Dvl {
    pub(crate) fn new(core: Arc<Core>, setup: DvlSetup) -> Dvl {
        let [roll, pitch, yaw] = setup.mounting_rpy_deg.map(f64::to_radians);
        let r_body_dvl = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), pitch)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), roll);
        Dvl { core, setup, r_body_dvl }
    }
}

impl Instrument for Dvl {
    type Reading = DvlVelocity;

    fn read(&mut self, t: Time, draws: &mut Draws, readings: &mut Vec<DvlVelocity>) {
        let schedule = &self.setup.schedule;
        let mut error_dvl = draws.normal3(self.core.noise.dvl_sigma);
        for axis in 0..3 {
            error_dvl[axis] += draws.sign() * draws.outlier(schedule.outlier_probability, schedule.outlier_size);
        }
        let motion = self.core.trajectory.at(t);
        let lever_arm_body = Vector3::from(self.setup.lever_arm_body);
        let velocity_body =
            motion.r_enu_body.inverse() * motion.velocity_enu + motion.rate_enu_body.cross(&lever_arm_body);
        let velocity_dvl = self.r_body_dvl.inverse() * velocity_body + error_dvl;
        readings.push(DvlVelocity { header: Header::at(t), velocity_dvl: velocity_dvl.into() });
    }
}
