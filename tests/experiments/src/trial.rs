//! One simulated mission through the navigator, scored; no file in between.

use std::convert::Infallible;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use nav_evaluation::{EstimatePoint, Pair, Score, Scorer, Window};
use nav_geometry::Geodetic;
use nav_pipeline::{Navigator, Output, Rebase, SolveClock, Unmeasured};
use rustix::time::{ClockId, clock_gettime};
use shared_types::{AIDING, Config, ConfigError, ConfigText, Duration, KeyframeReport, Mode, RawReading, Time};
use sim_faults::{ArrivalClock, FaultSpec, FaultStream};
use sim_world::{Manoeuvre, Preset, Scenario, ScenarioError, World};

/// What to run.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Built-in scenario.
    pub scenario: &'static str,
    /// Sensor errors.
    pub preset: Preset,
    /// Of the world.
    pub seed: u64,
    /// `section.key=value`.
    pub sets: Vec<String>,
    /// Seconds of data time to run; `None`: to the end.
    pub until: Option<f64>,
    /// Latitude and longitude in degrees to move the scenario to; `None`: where it is.
    pub moved_to: Option<[f64; 2]>,
    /// Number of the only buoy to be heard; `None`: all.
    pub only_buoy: Option<u32>,
    /// Injected into the readings, with draws of `seed`.
    pub faults: Vec<FaultSpec>,
    /// Of the heading that the estimation starts from, rad; its sigma is made as large.
    pub initial_heading_error: f64,
    /// What else is different about the scenario.
    pub change: Change,
    /// Seconds between the points of [`Outcome::curve`]; `None`: no points.
    pub curve_every: Option<f64>,
}

/// A built-in scenario that is not quite as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// As it is.
    Nothing,
    /// The compass works throughout.
    McpKept,
    /// It stays at the surface, where it sees satellites throughout, and the buoys are moored at this depth, m.
    OverMoorings(f64),
    /// DVL, MCP, PS and GNSS read once a second, so long (s) after the ping.
    AfterPing(f64),
}

/// A point of an error curve.
#[derive(Clone, Copy, Debug)]
pub struct CurvePoint {
    /// Data time, s.
    pub t: f64,
    /// Where the vehicle was, m.
    pub truth_enu: [f64; 3],
    /// Estimate minus truth, m.
    pub error_enu: [f64; 3],
    /// 1-sigma, m.
    pub sigma_enu: [f64; 3],
}

/// What came of it.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Over the whole run after the start.
    pub score: Score,
    /// Largest share of the horizontal 3-sigma bound that the error reached, and when, s.
    pub worst_sigmas: (f64, f64),
    /// Error (E, N, U) and sigma at the instants asked for.
    pub at: Vec<(f64, [f64; 3], [f64; 3])>,
    /// Keyframes.
    pub keyframes: u64,
    /// CPU time per keyframe, µs, sorted.
    pub solve_us: Vec<f64>,
    /// Passes per keyframe, mean.
    pub iterations: f64,
    /// States linearised anew per keyframe, mean.
    pub linearised: f64,
    /// CPU time of the whole, s.
    pub cpu_s: f64,
    /// Data time, s.
    pub duration_s: f64,
    /// First instant from which the horizontal error stays below 0.1 m, s.
    pub settled_at: Option<f64>,
    /// Per aiding sensor, in the order of [`AIDING`]: sum of squared normalised innovations and of their degrees of freedom.
    pub nis: [(f64, f64); AIDING.len()],
    /// Refusals per sensor name and reason.
    pub rejected: Vec<(&'static str, &'static str, u64)>,
    /// As often as it was asked for.
    pub curve: Vec<CurvePoint>,
}

/// What came of a batch.
#[derive(Clone, Debug)]
pub struct BatchOutcome {
    /// Over the whole run after the start.
    pub score: Score,
    /// CPU time of the optimisation, s.
    pub cpu_s: f64,
}

/// An attitude (w, x, y, z) turned about the up axis by so many rad.
pub fn turned_about_up([w, x, y, z]: [f64; 4], angle: f64) -> [f64; 4] {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
    let turned = turn * UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    [turned.w, turned.i, turned.j, turned.k]
}

/// The middle of sorted values; NaN of none.
pub fn median(sorted: &[f64]) -> f64 {
    sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
}

/// A trial that cannot be run.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    /// The scenario.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The configuration.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The navigator panicked in a run whose figures are needed.
    #[error("the navigator panicked: {0}")]
    Panicked(String),
    /// No estimate met the truth.
    #[error("scenario {scenario}, seed {seed}: no estimate was published")]
    NoEstimate {
        /// Which.
        scenario: &'static str,
        /// Which.
        seed: u64,
    },
}

impl Change {
    fn apply(self, scenario: &mut Scenario) {
        match self {
            Change::Nothing => {}
            Change::McpKept => scenario.mcp.iter_mut().for_each(|mcp| mcp.schedule.outages.clear()),
            Change::OverMoorings(depth) => {
                scenario.buoys.all.iter_mut().for_each(|buoy| buoy.position_enu[2] = -depth);
                scenario.gnss.iter_mut().for_each(|gnss| gnss.schedule.outages.clear());
                for segment in &mut scenario.segments {
                    if matches!(segment.manoeuvre, Manoeuvre::Sink { .. } | Manoeuvre::Rise { .. }) {
                        segment.manoeuvre = Manoeuvre::Cruise;
                    }
                }
            }
            Change::AfterPing(offset) => {
                let ping = scenario.lbl.as_ref().map_or(0.0, |lbl| lbl.schedule.phase);
                let schedules = [
                    scenario.gnss.as_mut().map(|gnss| &mut gnss.schedule),
                    scenario.dvl.as_mut().map(|dvl| &mut dvl.schedule),
                    scenario.mcp.as_mut().map(|mcp| &mut mcp.schedule),
                    scenario.ps.as_mut().map(|ps| &mut ps.schedule),
                ];
                for schedule in schedules.into_iter().flatten() {
                    (schedule.rate, schedule.phase) = (1.0, ping + offset);
                }
            }
        }
    }
}

/// CPU time of this thread.
pub struct ThreadClock;

impl SolveClock for ThreadClock {
    fn thread_ns(&mut self) -> u64 {
        let time = clock_gettime(ClockId::ThreadCPUTime);
        time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
    }
}

/// Truth rows per second.
const TRUTH_RATE: f64 = 10.0;

impl Trial {
    /// A built-in scenario as it is, to its end, with the settings of the house.
    pub fn new(scenario: &'static str, preset: Preset, seed: u64) -> Trial {
        Trial {
            scenario,
            preset,
            seed,
            sets: Vec::new(),
            until: None,
            moved_to: None,
            only_buoy: None,
            faults: Vec::new(),
            initial_heading_error: 0.0,
            change: Change::Nothing,
            curve_every: None,
        }
    }

    /// The scenario where it is to be.
    ///
    /// # Errors
    /// [`TrialError::Scenario`].
    pub fn place(&self) -> Result<Scenario, TrialError> {
        let mut scenario = Scenario::builtin(self.scenario)?;
        if let Some([lat_deg, lon_deg]) = self.moved_to {
            scenario.origin_deg[..2].copy_from_slice(&[lat_deg, lon_deg]);
        }
        self.change.apply(&mut scenario);
        Ok(scenario)
    }

    /// Whether the navigator is to hear a reading.
    pub fn hears(&self, reading: &RawReading) -> bool {
        match reading {
            RawReading::Lbl(range) => self.only_buoy.is_none_or(|only| range.buoy == only),
            _ => true,
        }
    }

    /// What the navigator is told of the vehicle, and how it is set.
    ///
    /// # Errors
    /// [`TrialError::Config`].
    pub fn config(&self, world: &World) -> Result<Config, TrialError> {
        let facts = ConfigText::new("sensors.toml", world.sensors_toml());
        let mut config = Config::load(&[facts], &self.sets)?;
        if self.initial_heading_error != 0.0 {
            let initial = &mut config.vehicle.initial;
            initial.q_enu_body = initial.q_enu_body.map(|q| turned_about_up(q, self.initial_heading_error));
            initial.sigma_attitude[2] = self.initial_heading_error.abs();
        }
        Ok(config)
    }

    /// Runs it. `instants`: seconds at which error and sigma are wanted.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn run(&self, instants: &[f64]) -> Result<Outcome, TrialError> {
        let scenario = self.place()?;
        let world = World::new(&scenario, self.preset, self.seed)?;
        let config = self.config(&world)?;
        let [lat_deg, lon_deg, height] = scenario.origin_deg;
        let mut scorer = Scorer::new(Geodetic::from_degrees(lat_deg, lon_deg, height), Window::default());
        let at = instants.iter().map(|&t| (t, [0.0; 3], [0.0; 3])).collect();
        let mut tally = Tally { at, curve_every: self.curve_every, ..Tally::default() };
        let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
        let mut clock = ThreadClock;
        let t_end = self.until.map_or(Time::MAX, Time::from_seconds);
        let began = clock.thread_ns();
        let mut truth = world.truth_rows(TRUTH_RATE).peekable();
        let readings = world.readings().take_while(|reading| reading.t_valid() <= t_end);
        let faults = FaultStream::new(&self.faults, self.seed, ArrivalClock::Valid);
        for reading in faults.over(readings.map(Ok::<_, Infallible>)) {
            let Ok(reading) = reading;
            if let RawReading::Imu(sample) = &reading {
                while let Some(row) = truth.next_if(|row| row.header.t_valid <= sample.header.t_valid) {
                    scorer.truth(&row);
                }
            }
            if !self.hears(&reading) {
                continue;
            }
            navigator.push(&reading, &mut clock, &mut |output| match output {
                Output::Estimate(estimate) if estimate.mode() != Mode::Initialising => {
                    scorer.estimate_with(&EstimatePoint::from(estimate), |pair| tally.pair(pair));
                }
                Output::Solution(solution, report) => {
                    tally.innovations(report);
                    tally.solve_us.push(solution.solve_ns as f64 * 1e-3);
                    tally.iterations += f64::from(solution.iterations);
                    tally.linearised += f64::from(solution.linearised);
                }
                Output::Estimate(_) | Output::Origin(_) | Output::Lagged(_) => {}
            });
        }
        let cpu_s = (clock.thread_ns() - began) as f64 * 1e-9;
        let score = scorer.score().ok_or(TrialError::NoEstimate { scenario: self.scenario, seed: self.seed })?;
        let mut rejected = Vec::new();
        for sensor in shared_types::SENSORS {
            for (reason, count) in navigator.rejected(sensor.index()).filter(|(_, count)| *count > 0) {
                rejected.push((sensor.name(), reason.name(), count));
            }
        }
        Ok(tally.outcome(score, cpu_s, rejected))
    }
}

impl Trial {
    /// The whole mission as one batch.
    ///
    /// # Errors
    /// [`TrialError`].
    pub fn smooth(&self) -> Result<BatchOutcome, TrialError> {
        /// Sweeps; a handful is usual.
        const SWEEPS_MAX: u32 = 50;
        let scenario = self.place()?;
        let world = World::new(&scenario, self.preset, self.seed)?;
        let nothing = TrialError::NoEstimate { scenario: self.scenario, seed: self.seed };
        let fixes = world.readings().filter_map(|reading| match reading {
            RawReading::Buoy(fix) => Some(fix),
            _ => None,
        });
        let mut navigator = Navigator::keeping_all(&self.config(&world)?).with_known_buoys(fixes.collect());
        let t_end = self.until.map_or(Time::MAX, Time::from_seconds);
        let heard = world.readings().filter(|reading| self.hears(reading));
        let readings = heard.take_while(|reading| reading.t_valid() <= t_end);
        let faults = FaultStream::new(&self.faults, self.seed, ArrivalClock::Valid);
        for reading in faults.over(readings.map(Ok::<_, Infallible>)) {
            let Ok(reading) = reading;
            navigator.push(&reading, &mut Unmeasured, &mut |_| {});
        }
        navigator.finish(&mut Unmeasured, &mut |_| {});
        let began = ThreadClock.thread_ns();
        let Some(smoothed) = navigator.smooth(SWEEPS_MAX) else { return Err(nothing) };
        let cpu_s = (ThreadClock.thread_ns() - began) as f64 * 1e-9;
        let [lat_deg, lon_deg, height] = scenario.origin_deg;
        let mut scorer = Scorer::new(Geodetic::from_degrees(lat_deg, lon_deg, height), Window::default());
        let mut truth = world.truth_rows(TRUTH_RATE).peekable();
        navigator.along(&smoothed, |estimate| {
            while let Some(row) = truth.next_if(|row| row.header.t_valid <= estimate.header.t_valid) {
                scorer.truth(&row);
            }
            scorer.estimate(&EstimatePoint::from(estimate));
        });
        Ok(BatchOutcome { score: scorer.score().ok_or(nothing)?, cpu_s })
    }
}

#[derive(Default)]
struct Tally {
    curve_every: Option<f64>,
    curve: Vec<CurvePoint>,
    at: Vec<(f64, [f64; 3], [f64; 3])>,
    worst_sigmas: (f64, f64),
    settled_at: Option<f64>,
    solve_us: Vec<f64>,
    iterations: f64,
    linearised: f64,
    nis: [(f64, f64); AIDING.len()],
}

impl Tally {
    fn innovations(&mut self, report: &KeyframeReport) {
        for factor in &report.factors[..report.factor_count as usize] {
            let sensor = AIDING.iter().position(|&aiding| aiding as u32 == factor.sensor);
            // Refused for another reason than its innovation, it has none.
            if let Some(at) = sensor.filter(|_| factor.rows > 0) {
                self.nis[at].0 += factor.nis;
                self.nis[at].1 += f64::from(factor.rows);
            }
        }
    }

    fn pair(&mut self, pair: &Pair) {
        let t = pair.estimate.t.as_seconds();
        let (error, sigma) = (pair.position_error_enu, pair.estimate.sigma_position_enu);
        let due = |last: &CurvePoint, every: f64| t >= last.t + every - 0.5 / TRUTH_RATE;
        if let Some(every) = self.curve_every
            && self.curve.last().is_none_or(|last| due(last, every))
        {
            let truth_enu = pair.truth_position_enu.into();
            self.curve.push(CurvePoint { t, truth_enu, error_enu: error.into(), sigma_enu: sigma.into() });
        }
        for axis in 0..2 {
            let sigmas = (error[axis] / sigma[axis]).abs();
            if sigmas > self.worst_sigmas.0 {
                self.worst_sigmas = (sigmas, t);
            }
        }
        for (instant, at_error, at_sigma) in &mut self.at {
            if (*instant - t).abs() < 0.5 / TRUTH_RATE {
                (*at_error, *at_sigma) = (error.into(), sigma.into());
            }
        }
        if error.xy().norm() > 0.1 {
            self.settled_at = None;
        } else if self.settled_at.is_none() {
            self.settled_at = Some(t);
        }
    }

    fn outcome(mut self, score: Score, cpu_s: f64, rejected: Vec<(&'static str, &'static str, u64)>) -> Outcome {
        let keyframes = self.solve_us.len() as u64;
        let per_keyframe = 1.0 / (keyframes.max(1) as f64);
        self.solve_us.sort_by(f64::total_cmp);
        Outcome {
            worst_sigmas: self.worst_sigmas,
            at: self.at,
            keyframes,
            iterations: self.iterations * per_keyframe,
            linearised: self.linearised * per_keyframe,
            solve_us: self.solve_us,
            cpu_s,
            duration_s: score.duration_s,
            settled_at: self.settled_at,
            nis: self.nis,
            rejected,
            curve: self.curve,
            score,
        }
    }
}
