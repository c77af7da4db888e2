//! A scenario brought to life: the truth at any time, and what every sensor says of it.

use std::sync::Arc;

use nalgebra::{UnitQuaternion, Vector3};
use shared_types::{
    BuoyFix, Duration, DvlVelocity, GnssFix, Header, ImuSample, LblRange, McpHeading, PsDepth, RawReading, Sensor,
    Time, Truth,
};

use sim_faults::{ArrivalClock, FaultSpec, FaultStream};

use crate::buoys::{BuoyFixes, BuoyPath};
use crate::dvl::Dvl;
use crate::gnss::Gnss;
use crate::imu::Imu;
use crate::lbl::Lbl;
use crate::mcp::Mcp;
use crate::merge::Merged;
use crate::noise::{Draws, Preset, SensorNoise, Stream};
use crate::ps::Ps;
use crate::readings::{Instrument, Readings};
use crate::scenario::{Scenario, ScenarioError, Schedule};
use crate::sensors_toml::{InitialState, sensors_toml};
use crate::strapdown::Earth;
use crate::trajectory::{Motion, Trajectory};

/// A pure function of (scenario, preset, seed): it has no clock and does no I/O. Clones share what was precomputed, and
/// the iterators own all that they need.
#[derive(Clone, Debug)]
pub struct World {
    core: Arc<Core>,
}

/// What all sensors share.
#[derive(Debug)]
pub(crate) struct Core {
    pub(crate) scenario: Scenario,
    pub(crate) preset: Preset,
    pub(crate) seed: u64,
    pub(crate) noise: SensorNoise,
    pub(crate) trajectory: Trajectory,
    pub(crate) earth: Earth,
    pub(crate) buoys: Vec<BuoyPath>,
}

impl Core {
    /// ENU position of a point of the body at `t`, m.
    pub(crate) fn point_at(&self, t: Time, lever_arm_body: &[f64; 3]) -> Vector3<f64> {
        let motion = self.trajectory.at(t);
        motion.position_enu + motion.r_enu_body * Vector3::from(*lever_arm_body)
    }
}

impl World {
    /// Precomputes the trajectory.
    ///
    /// # Errors
    /// [`ScenarioError::Value`] when the manoeuvres cannot be sailed, which only a scenario changed after it was parsed
    /// can bring.
    pub fn new(scenario: &Scenario, preset: Preset, seed: u64) -> Result<World, ScenarioError> {
        let trajectory = Trajectory::new(scenario.plan()?);
        let buoys = BuoyPath::all(&scenario.buoys.all, &mut Draws::new(seed, preset, Stream::BuoyPaths));
        Ok(World {
            core: Arc::new(Core {
                scenario: scenario.clone(),
                preset,
                seed,
                noise: preset.noise(),
                trajectory,
                earth: Earth::around(scenario.origin_deg),
                buoys,
            }),
        })
    }

    #[cfg(test)]
    pub(crate) fn core(&self) -> Arc<Core> {
        self.core.clone()
    }

    /// The faults of the scenario and `more`, with the draws of `seed` (`None`: of the world), to be put between its
    /// readings and whoever takes them. The sensors themselves, and the truth, know nothing of them.
    pub fn faults(&self, more: &[FaultSpec], seed: Option<u64>) -> FaultStream {
        let specs: Vec<FaultSpec> = self.core.scenario.faults.iter().chain(more).cloned().collect();
        FaultStream::new(&specs, seed.unwrap_or(self.core.seed), ArrivalClock::Valid)
    }

    /// Length of the scenario.
    pub fn duration(&self) -> Duration {
        self.core.trajectory.duration()
    }

    /// Sizes of the sensors' errors, as `sensors.toml` states them.
    pub fn noise(&self) -> SensorNoise {
        self.core.noise
    }

    /// How the IMU moves at `t`; before the start and after the end, where it is then.
    pub fn motion(&self, t: Time) -> Motion {
        self.core.trajectory.at(t)
    }

    /// Where the IMU is at `t`, as logs and the monitor want it.
    pub fn truth(&self, t: Time) -> Truth {
        let motion = self.motion(t);
        let [lat_deg, lon_deg, height] = self.core.earth.frame.to_geodetic(&motion.position_enu).to_degrees();
        Truth {
            header: Header::at(t),
            lat_deg,
            lon_deg,
            height,
            q_enu_body: scalar_first(&UnitQuaternion::from_rotation_matrix(&motion.r_enu_body)),
            velocity_enu: motion.velocity_enu.into(),
        }
    }

    /// The truth `rate` times per second, from 0 to the end.
    pub fn truth_rows(&self, rate: f64) -> impl Iterator<Item = Truth> + Send + use<> {
        let world = self.clone();
        let end = Time(0) + self.duration();
        (0_u64..)
            .map(move |sequence| (sequence, Time((sequence as f64 * 1e9 / rate).round() as i64)))
            .take_while(move |(_, t)| *t <= end)
            .map(move |(sequence, t)| {
                let mut truth = world.truth(t);
                truth.header.sequence = sequence;
                truth
            })
    }

    /// The facts of the vehicle, as they lie in a log directory: origin, noise, lever arms, and a first state with an error
    /// drawn from the stated sigmas (exact with [`Preset::None`]). Sensors that are not fitted have no section.
    pub fn sensors_toml(&self) -> String {
        sensors_toml(&self.core, &self.initial_state())
    }

    /// The truth at the start of the estimation, with its error.
    fn initial_state(&self) -> InitialState {
        let setup = &self.core.scenario.initial;
        let motion = self.motion(Time::from_seconds(setup.t));
        let mut draws = Draws::new(self.core.seed, self.core.preset, Stream::Initial);
        let position_error = draws.normal3(setup.sigma_position);
        let velocity_error = draws.normal3(setup.sigma_velocity);
        let [about_x, about_y, about_up] = setup.sigma_attitude_deg.map(|sigma| draws.normal(sigma.to_radians()));
        let q_enu_body = UnitQuaternion::from_scaled_axis(Vector3::z() * about_up)
            * UnitQuaternion::from_rotation_matrix(&motion.r_enu_body)
            * UnitQuaternion::from_scaled_axis(Vector3::new(about_x, about_y, 0.0));
        InitialState {
            position_enu: (motion.position_enu + position_error).into(),
            velocity_enu: (motion.velocity_enu + velocity_error).into(),
            q_enu_body: scalar_first(&q_enu_body),
        }
    }

    /// IMU samples.
    pub fn imu(&self) -> impl Iterator<Item = ImuSample> + Send + use<> {
        self.core
            .scenario
            .imu
            .as_ref()
            .map(|setup| {
                let imu = Imu::new(self.core.clone(), setup.schedule.rate);
                self.readings_of(imu, Sensor::Imu, &setup.schedule)
            })
            .into_iter()
            .flatten()
    }

    /// Slant ranges, those of one interrogation one after another with one `t_valid`.
    pub fn lbl(&self) -> impl Iterator<Item = LblRange> + Send + use<> {
        self.core
            .scenario
            .lbl
            .as_ref()
            .map(|setup| {
                let lbl = Lbl { core: self.core.clone(), setup: setup.clone() };
                self.readings_of(lbl, Sensor::Lbl, &setup.schedule)
            })
            .into_iter()
            .flatten()
    }

    /// Positions of the buoys: one of each moored one at the start, and the reports of the drifting ones.
    pub fn buoys(&self) -> impl Iterator<Item = BuoyFix> + Send + use<> {
        BuoyFixes::new(self.core.clone())
    }

    /// Satellite fixes.
    pub fn gnss(&self) -> impl Iterator<Item = GnssFix> + Send + use<> {
        self.core
            .scenario
            .gnss
            .as_ref()
            .map(|setup| {
                let gnss = Gnss { core: self.core.clone(), setup: setup.clone() };
                self.readings_of(gnss, Sensor::Gnss, &setup.schedule)
            })
            .into_iter()
            .flatten()
    }

    /// Doppler velocities.
    pub fn dvl(&self) -> impl Iterator<Item = DvlVelocity> + Send + use<> {
        self.core
            .scenario
            .dvl
            .as_ref()
            .map(|setup| {
                let dvl = Dvl::new(self.core.clone(), setup.clone());
                self.readings_of(dvl, Sensor::Dvl, &setup.schedule)
            })
            .into_iter()
            .flatten()
    }

    /// Compass headings.
    pub fn mcp(&self) -> impl Iterator<Item = McpHeading> + Send + use<> {
        self.core
            .scenario
            .mcp
            .as_ref()
            .map(|setup| {
                let mcp = Mcp { core: self.core.clone(), setup: setup.clone() };
                self.readings_of(mcp, Sensor::Mcp, &setup.schedule)
            })
            .into_iter()
            .flatten()
    }

    /// Depths.
    pub fn ps(&self) -> impl Iterator<Item = PsDepth> + Send + use<> {
        self.core
            .scenario
            .ps
            .as_ref()
            .map(|setup| {
                let ps = Ps { core: self.core.clone(), setup: setup.clone() };
                self.readings_of(ps, Sensor::Ps, &setup.schedule)
            })
            .into_iter()
            .flatten()
    }

    /// All readings by `t_valid`, equal times in the order imu, buoys, gnss, dvl, mcp, ps, lbl.
    pub fn readings(&self) -> impl Iterator<Item = RawReading> + Send + use<> {
        Merged::new(vec![
            Box::new(self.imu().map(RawReading::Imu)),
            Box::new(self.buoys().map(RawReading::Buoy)),
            Box::new(self.gnss().map(RawReading::Gnss)),
            Box::new(self.dvl().map(RawReading::Dvl)),
            Box::new(self.mcp().map(RawReading::Mcp)),
            Box::new(self.ps().map(RawReading::Ps)),
            Box::new(self.lbl().map(RawReading::Lbl)),
        ])
    }

    fn readings_of<I: Instrument>(&self, instrument: I, sensor: Sensor, schedule: &Schedule) -> Readings<I> {
        let draws = Draws::new(self.core.seed, self.core.preset, Stream::Of(sensor));
        Readings::new(instrument, schedule, draws, self.duration())
    }
}

/// (w, x, y, z) with w ≥ 0: of the two that are the same rotation, always the same one.
fn scalar_first(q: &UnitQuaternion<f64>) -> [f64; 4] {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w, q.i, q.j, q.k].map(|part| part * sign)
}
