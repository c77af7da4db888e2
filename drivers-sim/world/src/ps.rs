//! Pressure sensor: depth of its port below the mean surface, through the ellipsoid.

use std::sync::Arc;

use shared_types::{Header, PsDepth, Time};

use crate::noise::Draws;
use crate::readings::Instrument;
use crate::scenario::PsSetup;
use crate::world::Core;

#[derive(Clone, Debug)]
pub(crate) struct Ps {
    pub(crate) core: Arc<Core>,
    pub(crate) setup: PsSetup,
}

impl Instrument for Ps {
    type Reading = PsDepth;

    fn read(&mut self, t: Time, draws: &mut Draws, readings: &mut Vec<PsDepth>) {
        let schedule = &self.setup.schedule;
        let error = draws.normal(self.core.noise.ps_sigma)
            + draws.sign() * draws.outlier(schedule.outlier_probability, schedule.outlier_size);
        let port_enu = self.core.point_at(t, &self.setup.lever_arm_body);
        let depth = self.core.scenario.surface_height - self.core.earth.frame.height_at(&port_enu);
        readings.push(PsDepth { header: Header::at(t), depth: depth + error });
    }
}
