//! One mission with faults through the navigator, written down ten times a second.

use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use nav_evaluation::{EstimatePoint, Pair, Scorer, Window};
use nav_geometry::Geodetic;
use nav_pipeline::{Navigator, Output, Rebase, Unmeasured};
use shared_types::{
    AIDING, CALIBRATIONS, Config, ConfigText, Duration, Mode, NavEstimate, REJECT_REASONS, SENSORS, Solution,
};
use sim_faults::{FaultSpec, Tally};
use sim_world::{Preset, Scenario, World};

use crate::trial::{TrialError, turned_about_up};

/// Rows per second.
const RATE: f64 = 10.0;

/// What is different about the mission before anything goes wrong in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// Nothing.
    AsItIs,
    /// It lies at this latitude and longitude, deg.
    At([f64; 2]),
    /// All of it, buoys included, so many m further down; no satellite is ever seen.
    Deeper(f64),
    /// The heading that the estimation starts from is wrong by so many deg, and its sigma is as large.
    Heading(f64),
    /// The position that the estimation starts from is so many m too far east, and its sigma knows nothing of that.
    Position(f64),
    /// Another mission: `scenarios/one_buoy.toml`.
    OneBuoy(Start),
}

/// What is known of the position at the start of `scenarios/one_buoy.toml`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// To the 3 m that stand there.
    Known,
    /// Within so many m, 1-sigma per axis.
    Within(f64),
    /// As much, and it is the mirror image: as far to the west of the buoy as it is to its east.
    Mirrored(f64),
}

/// The buoy of `scenarios/one_buoy.toml`, and half the way from the vehicle on its straight course to its mirror image, m.
pub const BUOY: [f64; 3] = [0.0, 300.0, 0.0];
/// See [`BUOY`].
pub const ABEAM: f64 = 150.0;
/// From this time on it has been passed; s.
pub const PASSED: f64 = 200.0;
/// The turn begins and ends, s.
pub const TURN: [f64; 2] = [252.0, 262.0];

/// What to run.
#[derive(Clone, Debug)]
pub struct FaultRun {
    /// Before the faults.
    pub setting: Setting,
    /// In the order in which they act.
    pub faults: Vec<FaultSpec>,
    /// `section.key=value`.
    pub sets: Vec<String>,
    /// Of the world and of the faults.
    pub seed: u64,
}

/// The run at a truth row.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// s.
    pub t: f64,
    /// Where the vehicle was, m.
    pub truth_enu: [f64; 3],
    /// Estimate minus truth, m.
    pub error_enu: [f64; 3],
    /// 1-sigma, m.
    pub sigma_enu: [f64; 3],
    /// About the up axis, deg.
    pub heading_error_deg: f64,
    /// Largest step between two estimates since the last row, beyond what the velocity explains, in sigmas of its axis.
    pub step: f64,
}

/// What came of a run.
#[derive(Clone, Debug)]
pub struct Trace {
    /// In order of time.
    pub rows: Vec<Row>,
    /// Each change of mode, s.
    pub modes: Vec<(f64, Mode)>,
    /// Estimates with a number that is none.
    pub not_finite: u64,
    /// Per sensor in the order of [`SENSORS`].
    pub rejected: [[u64; REJECT_REASONS.len()]; SENSORS.len()],
    /// Used, per sensor.
    pub used: [u64; SENSORS.len()],
    /// What each fault has done.
    pub tallies: Vec<(FaultSpec, Tally)>,
    /// Instants at which the number of used readings of a sensor grew, s, per sensor.
    pub used_at: [Vec<f64>; SENSORS.len()],
    /// What the estimator says of its sensors' stamps, keyframe by keyframe.
    pub offsets: Vec<Offsets>,
}

/// Systematic errors at a keyframe: time offsets per aiding sensor, calibrations.
#[derive(Clone, Copy, Debug)]
pub struct Offsets {
    /// Of the keyframe, s.
    pub t: f64,
    /// How late the stamps are taken to be, s.
    pub found: [f64; AIDING.len()],
    /// 1-sigma of that, s.
    pub sigma: [f64; AIDING.len()],
    /// What [`shared_types::CALIBRATIONS`] are taken to be off by.
    pub calibration: [f64; CALIBRATIONS.len()],
    /// 1-sigma of that.
    pub calibration_sigma: [f64; CALIBRATIONS.len()],
}

/// A trace, or the panic that ended it.
pub type Outcome = Result<Trace, String>;

/// The mission that every fault meets.
pub fn scenario() -> Result<Scenario, TrialError> {
    Ok(Scenario::parse(include_str!("../../scenarios/faults.toml"), Path::new("scenarios/faults.toml"))?)
}

impl Setting {
    /// What a run in this setting is held against.
    pub fn reference(self) -> Setting {
        match self {
            Setting::OneBuoy(_) => Setting::OneBuoy(Start::Known),
            _ => Setting::AsItIs,
        }
    }

    fn scenario(self) -> Result<Scenario, TrialError> {
        let Setting::OneBuoy(_) = self else { return scenario() };
        Ok(Scenario::parse(include_str!("../../scenarios/one_buoy.toml"), Path::new("scenarios/one_buoy.toml"))?)
    }

    /// As in the table; `None`: nothing to say.
    pub fn name(self) -> Option<String> {
        match self {
            Setting::AsItIs => None,
            Setting::At([latitude, longitude]) => Some(format!("at {latitude}, {longitude} deg")),
            Setting::Deeper(depth) => Some(format!("{depth} m deeper")),
            Setting::Heading(error) => Some(format!("start with a heading wrong by {error} deg")),
            Setting::Position(error) => Some(format!("start {error} m off")),
            Setting::OneBuoy(Start::Known) => Some("one buoy, no compass: start known".to_owned()),
            Setting::OneBuoy(Start::Within(sigma)) => Some(format!("one buoy, no compass: start within {sigma} m")),
            Setting::OneBuoy(Start::Mirrored(sigma)) => {
                Some(format!("one buoy, no compass: start within {sigma} m, mirrored"))
            }
        }
    }

    fn place(self, scenario: &mut Scenario) {
        match self {
            Setting::At(place) => scenario.origin_deg[..2].copy_from_slice(&place),
            Setting::Deeper(depth) => scenario.origin_deg[2] -= depth,
            Setting::OneBuoy(Start::Within(sigma) | Start::Mirrored(sigma)) => scenario.initial.sigma_position = sigma,
            Setting::AsItIs | Setting::Heading(_) | Setting::Position(_) | Setting::OneBuoy(Start::Known) => {}
        }
    }

    fn tell(self, config: &mut Config) {
        let initial = &mut config.vehicle.initial;
        match self {
            Setting::Heading(error) => {
                let error = error.to_radians();
                initial.q_enu_body = initial.q_enu_body.map(|q| turned_about_up(q, error));
                initial.sigma_attitude[2] = error.abs();
            }
            Setting::Position(error) => {
                initial.position_enu = initial.position_enu.map(|[east, north, up]| [east + error, north, up]);
            }
            Setting::OneBuoy(Start::Mirrored(_)) => {
                initial.position_enu = initial.position_enu.map(|[_, north, up]| [BUOY[0] - ABEAM, north, up]);
            }
            Setting::AsItIs | Setting::At(_) | Setting::Deeper(_) | Setting::OneBuoy(_) => {}
        }
    }
}

impl FaultRun {
    /// Runs it; a panic of the navigator is an outcome like another.
    ///
    /// # Errors
    /// [`TrialError`]: the scenario or a setting is wrong.
    pub fn run(&self) -> Result<Outcome, TrialError> {
        let mut scenario = self.setting.scenario()?;
        self.setting.place(&mut scenario);
        let world = World::new(&scenario, Preset::Realistic, self.seed)?;
        let facts = ConfigText::new("sensors.toml", world.sensors_toml());
        let mut config = Config::load(&[facts], &self.sets)?;
        self.setting.tell(&mut config);
        let outcome = catch_unwind(AssertUnwindSafe(|| self.navigate(&scenario, &world, &config)));
        Ok(outcome.map_err(|panic| {
            let text = panic.downcast_ref::<String>().cloned();
            text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned())).unwrap_or_default()
        }))
    }

    fn navigate(&self, scenario: &Scenario, world: &World, config: &Config) -> Trace {
        let [lat_deg, lon_deg, height] = scenario.origin_deg;
        let mut scorer = Scorer::new(Geodetic::from_degrees(lat_deg, lon_deg, height), Window::default());
        let mut log = Logbook::default();
        let mut navigator = Navigator::new(config, Rebase::After(Duration::ZERO));
        // All of it beforehand: a wrong stamp of the IMU must not find it missing.
        world.truth_rows(RATE).for_each(|row| scorer.truth(&row));
        let mut faults = world.faults(&self.faults, None);
        let mut sink = |output: Output<'_>| match output {
            Output::Estimate(estimate) if estimate.mode() != Mode::Initialising => {
                log.estimate(estimate);
                scorer.estimate_with(&EstimatePoint::from(estimate), |pair| log.pair(pair));
            }
            Output::Solution(solution, _) => log.solution(solution),
            Output::Estimate(_) | Output::Origin(_) | Output::Lagged(_) => {}
        };
        for reading in world.readings().map(Ok::<_, Infallible>) {
            let Ok(reading) = reading;
            faults.push(reading);
            while let Some(reading) = faults.pop() {
                navigator.push(&reading, &mut Unmeasured, &mut sink);
            }
        }
        faults.finish();
        while let Some(reading) = faults.pop() {
            navigator.push(&reading, &mut Unmeasured, &mut sink);
        }
        // Without it the readings of the last moments would be counted nowhere.
        navigator.finish(&mut Unmeasured, &mut sink);
        let mut trace = Trace {
            rows: log.rows,
            modes: log.modes,
            not_finite: log.not_finite,
            rejected: Default::default(),
            used: Default::default(),
            tallies: faults.tallies().map(|(spec, tally)| (spec.clone(), tally)).collect(),
            used_at: log.used_at,
            offsets: log.offsets,
        };
        for sensor in SENSORS {
            let index = sensor.index();
            for (reason, count) in navigator.rejected(index) {
                trace.rejected[index][reason.index()] = count;
            }
            trace.used[index] = navigator.counts()[index].used;
        }
        trace
    }
}

#[derive(Default)]
struct Logbook {
    rows: Vec<Row>,
    modes: Vec<(f64, Mode)>,
    not_finite: u64,
    last: Option<EstimatePoint>,
    step: f64,
    used: [u64; SENSORS.len()],
    used_at: [Vec<f64>; SENSORS.len()],
    offsets: Vec<Offsets>,
}

impl Logbook {
    fn estimate(&mut self, estimate: &NavEstimate) {
        let t = estimate.header.t_valid as f64 * 1e-9;
        if self.modes.last().is_none_or(|(_, mode)| *mode != estimate.mode()) {
            self.modes.push((t, estimate.mode()));
        }
        let numbers =
            [&estimate.position_enu[..], &estimate.velocity_enu, &estimate.q_enu_body, &estimate.position_cov];
        self.not_finite += u64::from(numbers.iter().any(|values| values.iter().any(|value| !value.is_finite())));
        let now = EstimatePoint::from(estimate);
        if let Some(last) = &self.last {
            let dt = (now.t - last.t).as_seconds();
            let step = now.position_enu - last.position_enu - (now.velocity_enu + last.velocity_enu) * (0.5 * dt);
            for axis in 0..3 {
                // Where the sigma jumps with the estimate (a gap is over), the estimate has said so.
                let sigma = now.sigma_position_enu[axis].max(last.sigma_position_enu[axis]);
                self.step = self.step.max((step[axis] / sigma).abs());
            }
        }
        self.last = Some(now);
    }

    fn pair(&mut self, pair: &Pair) {
        self.rows.push(Row {
            t: pair.estimate.t.as_seconds(),
            truth_enu: pair.truth_position_enu.into(),
            error_enu: pair.position_error_enu.into(),
            sigma_enu: pair.estimate.sigma_position_enu.into(),
            heading_error_deg: pair.attitude_error.z.to_degrees(),
            step: std::mem::take(&mut self.step),
        });
    }

    fn solution(&mut self, solution: &Solution) {
        let t = solution.t_keyframe as f64 * 1e-9;
        for (index, count) in solution.counts.iter().enumerate() {
            if count.used > self.used[index] {
                self.used[index] = count.used;
                self.used_at[index].push(t);
            }
        }
        self.offsets.push(Offsets {
            t,
            found: solution.time_offset,
            sigma: solution.time_offset_sigma,
            calibration: solution.calibration,
            calibration_sigma: solution.calibration_sigma,
        });
    }
}

impl Trace {
    /// Root mean square of horizontal and vertical error from `from` s on, m.
    pub fn rms_since(&self, from: f64) -> [f64; 2] {
        let rows: Vec<&Row> = self.rows.iter().filter(|row| row.t >= from).collect();
        let mean =
            |of: &dyn Fn(&Row) -> f64| (rows.iter().map(|row| of(row)).sum::<f64>() / rows.len().max(1) as f64).sqrt();
        [mean(&|row| row.error_enu[0].powi(2) + row.error_enu[1].powi(2)), mean(&|row| row.error_enu[2].powi(2))]
    }

    /// Its first row, s.
    pub fn began(&self) -> f64 {
        self.rows.first().map_or(f64::INFINITY, |row| row.t)
    }

    /// The same without the rows before `from` s.
    #[must_use]
    pub fn since(&self, from: f64) -> Trace {
        let rows = self.rows.iter().filter(|row| row.t >= from).copied().collect();
        Trace { rows, ..self.clone() }
    }

    /// The same without the rows from `to` s on.
    #[must_use]
    pub fn until(&self, to: f64) -> Trace {
        let rows = self.rows.iter().filter(|row| row.t < to).copied().collect();
        Trace { rows, ..self.clone() }
    }

    /// The largest error in sigmas of its axis, and when.
    pub fn worst(&self) -> (f64, f64) {
        let each = self
            .rows
            .iter()
            .flat_map(|row| (0..3).map(|axis| ((row.error_enu[axis] / row.sigma_enu[axis]).abs(), row.t)));
        each.fold((0.0, 0.0), |worst, next| if next.0 > worst.0 || next.0.is_nan() { next } else { worst })
    }

    /// Components beyond three sigmas, and all components.
    pub fn outside(&self) -> (usize, usize) {
        let is_out = |row: &Row, axis: usize| {
            let deviation = (row.error_enu[axis] / row.sigma_enu[axis]).abs();
            deviation.is_nan() || deviation > 3.0
        };
        let out = self.rows.iter().map(|row| (0..3).filter(|axis| is_out(row, *axis)).count()).sum();
        (out, 3 * self.rows.len())
    }

    /// Mean of squared error over sigma: horizontal (mean of both axes) and vertical; 1 is honest.
    pub fn nees(&self) -> [f64; 2] {
        let axes = [0, 1, 2].map(|axis| {
            let sum: f64 = self.rows.iter().map(|row| (row.error_enu[axis] / row.sigma_enu[axis]).powi(2)).sum();
            sum / self.rows.len().max(1) as f64
        });
        [0.5 * (axes[0] + axes[1]), axes[2]]
    }

    /// Largest distance from the estimate of `clean` in sigmas that `clean` states, within `from..to` s; rows pair by time.
    pub fn deviation(&self, clean: &Trace, from: f64, to: f64) -> f64 {
        let within = self.deviations(clean).filter(|(t, _)| (from..to).contains(t));
        within.flat_map(|(_, squared)| squared).fold(0.0, f64::max).sqrt()
    }

    /// Time, and the squared distance from `clean` in its sigmas on each axis.
    fn deviations<'a>(&'a self, clean: &'a Trace) -> impl Iterator<Item = (f64, [f64; 3])> + 'a {
        let mut others = clean.rows.iter().peekable();
        self.rows.iter().filter_map(move |row| {
            while others.next_if(|other| other.t < row.t - 1e-6).is_some() {}
            let other = others.peek().filter(|other| other.t < row.t + 1e-6)?;
            let squared = |axis: usize| ((row.error_enu[axis] - other.error_enu[axis]) / other.sigma_enu[axis]).powi(2);
            Some((row.t, [0, 1, 2].map(squared)))
        })
    }

    /// How long after `end` s the estimate is for good as near to that of `clean` as an RMS of 1.2 times that of `clean`
    /// makes likely. `None`: not before the run is over.
    ///
    /// An RMS 1.2 times as large is an error of its own of variance 1.2² − 1 = 0.44 of the clean one; its three components
    /// stay within 7.81 of that in 95 of 100 cases (χ², three degrees of freedom).
    pub fn recovery(&self, clean: &Trace, end: f64) -> Option<f64> {
        const NEAR: f64 = 0.44 * 7.81;
        let mut since = None;
        for (t, squared) in self.deviations(clean).filter(|(t, _)| *t >= end) {
            if squared.iter().sum::<f64>() > NEAR {
                since = None;
            } else if since.is_none() {
                since = Some(t - end);
            }
        }
        since
    }

    /// From `end` s to the first keyframe that uses a reading of the sensor, s.
    pub fn accepted_after(&self, sensor: shared_types::Sensor, end: f64) -> Option<f64> {
        self.used_at[sensor.index()].iter().find(|t| **t >= end).map(|t| t - end)
    }
}
