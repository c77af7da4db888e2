//! The acoustic buoys: where they really are, and what they report.
//!
//! ```text
//! moored:    position                                                              one report, at the start
//! drifting:  position + velocity · t + wander · (sin(2π t/P + φ_e), sin(2π · 0.7 t/P + φ_n), 0)    one per `fix_every`
//! ```
//!
//! The phases come from the seed.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::Vector3;
use shared_types::{BuoyFix, Duration, Header, Sensor, Time};

use crate::noise::{Draws, Stream};
use crate::scenario::{Buoy, Drift};
use crate::world::Core;

/// North wanders more slowly than east, so that the path is no closed figure.
const NORTH_SLOWNESS: f64 = 0.7;

/// Where a buoy is at any time.
#[derive(Clone, Debug)]
pub(crate) struct BuoyPath {
    pub(crate) number: u32,
    position_enu: Vector3<f64>,
    drift: Option<Drift>,
    phases: [f64; 2],
}

impl BuoyPath {
    pub(crate) fn all(buoys: &[Buoy], draws: &mut Draws) -> Vec<BuoyPath> {
        let path = |buoy: &Buoy| BuoyPath {
            number: buoy.number,
            position_enu: buoy.position_enu.into(),
            drift: buoy.drift,
            phases: [TAU * draws.uniform(), TAU * draws.uniform()],
        };
        buoys.iter().map(path).collect()
    }

    /// ENU, m.
    pub(crate) fn at(&self, t: Time) -> Vector3<f64> {
        let Some(drift) = &self.drift else {
            return self.position_enu;
        };
        let t = t.as_seconds();
        let angle = TAU * t / drift.wander_period;
        let wander = Vector3::new(
            (angle + self.phases[0]).sin() - self.phases[0].sin(),
            (NORTH_SLOWNESS * angle + self.phases[1]).sin() - self.phases[1].sin(),
            0.0,
        );
        self.position_enu + Vector3::from(drift.velocity_enu) * t + wander * drift.wander
    }
}

/// The buoys' reports in order of time.
#[derive(Clone, Debug)]
pub(crate) struct BuoyFixes {
    core: Arc<Core>,
    draws: Draws,
    sigma: f64,
    clock_offset: Duration,
    /// How often each buoy has reported.
    reports: Vec<u64>,
    sequence: u64,
}

impl BuoyFixes {
    pub(crate) fn new(core: Arc<Core>) -> BuoyFixes {
        let setup = &core.scenario.buoys;
        BuoyFixes {
            draws: Draws::new(core.seed, core.preset, Stream::Of(Sensor::Buoys)),
            sigma: setup.sigma,
            clock_offset: setup.clock_offset,
            reports: vec![0; core.buoys.len()],
            sequence: 0,
            core,
        }
    }

    /// When the buoy reports next.
    fn next_report(&self, index: usize) -> Option<Time> {
        let count = self.reports[index];
        match &self.core.buoys[index].drift {
            None => (count == 0).then_some(Time(0)),
            Some(drift) => {
                let t = Time::from_seconds(count as f64 * drift.fix_every);
                (t <= Time(0) + self.core.trajectory.duration()).then_some(t)
            }
        }
    }
}

impl Iterator for BuoyFixes {
    type Item = BuoyFix;

    fn next(&mut self) -> Option<BuoyFix> {
        let (t, index) =
            (0..self.reports.len()).filter_map(|index| self.next_report(index).map(|t| (t, index))).min()?;
        self.reports[index] += 1;
        let path = &self.core.buoys[index];
        let reported_enu = path.at(t) + self.draws.normal3(self.sigma);
        let [lat_deg, lon_deg, height] = self.core.earth.frame.to_geodetic(&reported_enu).to_degrees();
        let header = Header { sequence: self.sequence, ..Header::at(t + self.clock_offset) };
        self.sequence += 1;
        let moored = u32::from(path.drift.is_none());
        Some(BuoyFix { header, buoy: path.number, moored, lat_deg, lon_deg, height })
    }
}
