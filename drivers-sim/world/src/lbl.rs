//! Acoustic ranging: the distance from the transducer to every buoy at the one instant of the interrogation.
//!
//! A wild range is too long: a multipath only makes the way longer.

use std::sync::Arc;

use shared_types::{Header, LblRange, Time};

use crate::noise::Draws;
use crate::readings::Instrument;
use crate::scenario::LblSetup;
use crate::world::Core;

#[derive(Clone, Debug)]
pub(crate) struct Lbl {
    pub(crate) core: Arc<Core>,
    pub(crate) setup: LblSetup,
}

impl Instrument for Lbl {
    type Reading = LblRange;

    fn read(&mut self, t: Time, draws: &mut Draws, readings: &mut Vec<LblRange>) {
        let schedule = &self.setup.schedule;
        let transducer_enu = self.core.point_at(t, &self.setup.lever_arm_body);
        for path in &self.core.buoys {
            let error = draws.normal(self.core.noise.lbl_sigma)
                + draws.outlier(schedule.outlier_probability, schedule.outlier_size);
            let distance = (transducer_enu - path.at(t)).norm();
            if distance <= self.setup.max_range {
                readings.push(LblRange {
                    header: Header::at(t),
                    buoy: path.number,
                    in_epoch: 0,
                    range: distance + error,
                });
            }
        }
    }

    fn complete(epoch: &mut [LblRange]) {
        let count = epoch.len() as u32;
        epoch.iter_mut().for_each(|range| range.in_epoch = count);
    }
}
