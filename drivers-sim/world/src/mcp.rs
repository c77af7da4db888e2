//! Compass: heading of the body x axis, clockwise from true north **at the vehicle**, less the declination.

use std::sync::Arc;

use shared_types::{Header, McpHeading, Time};

use crate::noise::Draws;
use crate::readings::Instrument;
use crate::scenario::McpSetup;
use crate::world::Core;

#[derive(Clone, Debug)]
pub(crate) struct Mcp {
    pub(crate) core: Arc<Core>,
    pub(crate) setup: McpSetup,
}

impl Instrument for Mcp {
    type Reading = McpHeading;

    fn read(&mut self, t: Time, draws: &mut Draws, readings: &mut Vec<McpHeading>) {
        let schedule = &self.setup.schedule;
        let error_deg = draws.normal(self.core.noise.mcp_sigma_deg)
            + draws.sign() * draws.outlier(schedule.outlier_probability, schedule.outlier_size);
        let motion = self.core.trajectory.at(t);
        let r_enu_local = self.core.earth.frame.local_axes_at(&motion.position_enu);
        let ahead_local = r_enu_local.tr_mul(&motion.r_enu_body.matrix().column(0));
        let heading_deg = ahead_local[0].atan2(ahead_local[1]).to_degrees();
        let reported = (heading_deg - self.setup.declination_deg + error_deg).rem_euclid(360.0);
        readings.push(McpHeading { header: Header::at(t), heading_deg: reported });
    }
}
