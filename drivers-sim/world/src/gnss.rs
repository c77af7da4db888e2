//! Satellite receiver: the antenna's position while it is above the water, with errors along the local east, north and up.

use std::sync::Arc;

use nalgebra::Vector3;
use shared_types::{GnssFix, Header, Time};

use crate::noise::Draws;
use crate::readings::Instrument;
use crate::scenario::GnssSetup;
use crate::world::Core;

#[derive(Clone, Debug)]
pub(crate) struct Gnss {
    pub(crate) core: Arc<Core>,
    pub(crate) setup: GnssSetup,
}

impl Instrument for Gnss {
    type Reading = GnssFix;

    fn read(&mut self, t: Time, draws: &mut Draws, readings: &mut Vec<GnssFix>) {
        let sigma_enu = self.core.noise.gnss_sigma_enu;
        let mut error_local = Vector3::from(sigma_enu.map(|sigma| draws.normal(sigma)));
        let schedule = &self.setup.schedule;
        for axis in 0..3 {
            error_local[axis] += draws.sign() * draws.outlier(schedule.outlier_probability, schedule.outlier_size);
        }
        let antenna_enu = self.core.point_at(t, &self.setup.lever_arm_body);
        let frame = &self.core.earth.frame;
        if frame.height_at(&antenna_enu) <= self.core.scenario.surface_height {
            return;
        }
        let measured_enu = antenna_enu + frame.local_axes_at(&antenna_enu) * error_local;
        let [lat_deg, lon_deg, height] = frame.to_geodetic(&measured_enu).to_degrees();
        readings.push(GnssFix { header: Header::at(t), lat_deg, lon_deg, height, sigma_enu });
    }
}
