//! The estimator: anchored measurements in, a solution out at each keyframe.
//!
//! ```text
//! IMU sample   → history, open interval (preintegrated at arrival)
//! reading      → waits for its keyframe
//! keyframe k   → make room (the oldest becomes the prior), close k−1 → k, predict x_k and C_k⁻, tie and gate what waited,
//!                solve, publish x_k with C_k, open k →
//! ```
//!
//! §4.1 of the method. Before the first state the [`Initialiser`] listens instead.

use nalgebra::Vector3;
use nav_geometry::Geodetic;
use nav_models::estimator::{Effort, Estimator, EstimatorError};
use nav_models::gaps::BLIND;
use nav_models::initialisation::{Initialiser, LastKnown};
use nav_models::prediction::predict_covariance;
use nav_models::preintegration::{ImuPoint, Preintegration};
use nav_models::state::NavState;
use nav_models::transport::transport;
use nav_models::world::WorldModel;
use shared_types::{
    AIDING, AnchorMethod, CALIBRATIONS, Config, Duration, FgoConfig, Header, KeyframeReport, Measurement, NavEstimate,
    Reading, RejectReason, Sensor, SensorCounts, Solution, SolutionStatus, Time,
};

use crate::alternatives::Alternatives;
use crate::interval::{ImuHistory, ImuModel, OpenInterval, TimedPoint};
use crate::kernels::Block;
use crate::realignment::{LOST, Realignment, instant, is_plausible, unseen};
use crate::recovery::{SUSPICIOUS_EPOCHS, loosening, loosening_by_fixes, loosening_by_shift, loosening_of_biases};
use crate::rows::DIM;
use crate::smoother::{self, Smoothed};
use crate::ties::{Closing, Pending, Ties, place};
use crate::window::{SolveReport, Window};

/// Samples kept for an initialisation that looks back.
const HISTORY_BEFORE_START: Duration = Duration(20_000_000_000);
/// Readings that may wait for one keyframe: some hundred a second over the longest interval.
const PENDING_MAX: usize = 4096;
/// Those for which there is room from the start: of some seconds of every sensor. Only an estimator that has fallen behind by more asks for
/// memory.
const PENDING_USUAL: usize = 256;
/// A window of so many intervals never forgets, for [`FgoEstimator::smooth`] at the end.
pub const KEEPING_ALL: usize = u32::MAX as usize;
/// Room for an interval's samples: 5 s at 200 Hz.
const INTERVAL_SAMPLES: usize = 1024;

/// The sliding-window factor-graph estimator.
#[derive(Clone, Debug)]
pub struct FgoEstimator {
    config: Config,
    imu: ImuModel,
    window: Option<Window>,
    /// What came before the window began anew, where nothing is to be forgotten: a batch of several pieces.
    earlier: Vec<Window>,
    initialiser: Initialiser,
    history: ImuHistory,
    open: OpenInterval,
    pending: Vec<Pending>,
    ties: Ties,
    realignment: Realignment,
    alternatives: Alternatives,
    newest_covariance: Block<DIM>,
    /// The last keyframe at which the biases were let loose.
    t_biases_loosened: Option<Time>,
    solutions: u64,
    report: KeyframeReport,
    is_started: bool,
    /// Readings up to here are in the prior of a resumed estimator already.
    t_resumed: Time,
}

impl FgoEstimator {
    /// An estimator without origin: it waits for [`FgoEstimator::set_origin`].
    pub fn new(config: &Config) -> FgoEstimator {
        let mut config = config.clone();
        if config.navigator.keyframes.anchor == AnchorMethod::Joint {
            // The columns beside the chain know nothing of the readings that are in an interval's factor.
            for sensor in &mut config.navigator.sensors {
                (sensor.time_offset, sensor.calibrate) = (sensor.time_offset.as_given(), false);
            }
        }
        FgoEstimator {
            imu: ImuModel { noise: config.vehicle.imu.clone(), gate: config.navigator.imu },
            window: None,
            earlier: Vec::new(),
            initialiser: Initialiser::new(&config),
            history: ImuHistory::with_capacity(8 * INTERVAL_SAMPLES),
            open: OpenInterval::with_capacity(INTERVAL_SAMPLES),
            pending: Vec::with_capacity(PENDING_USUAL),
            ties: Ties::new(&config),
            realignment: Realignment::default(),
            alternatives: Alternatives::new(&config),
            newest_covariance: Block::zeros(),
            t_biases_loosened: None,
            solutions: 0,
            report: KeyframeReport::empty(),
            is_started: false,
            t_resumed: Time::MIN,
            config,
        }
    }

    /// Fixes the origin of the frame. Later calls change nothing: a run has one frame.
    pub fn set_origin(&mut self, origin: Geodetic) {
        if self.window.is_none() {
            let world = WorldModel::new(origin, &self.config);
            self.window = Some(self.empty_window(world));
        }
    }

    fn empty_window(&self, world: WorldModel) -> Window {
        let mut window = Window::new(self.config.navigator.fgo, world);
        window.consider_moorings(self.config.vehicle.lbl.buoy_sigma);
        if self.config.navigator.keyframes.anchor == AnchorMethod::Joint {
            window.join_intervals();
        }
        window
    }

    /// Takes up from a solution of an earlier run of this estimator: its keyframe becomes the first, its covariance the
    /// prior. Returns `false`, changing nothing, when the solution holds no valid state.
    pub fn resume(&mut self, solution: &Solution) -> bool {
        let Some((state, covariance)) = NavState::from_solution(solution) else { return false };
        let [lat_deg, lon_deg, height] = solution.origin;
        if ![lat_deg, lon_deg, height].iter().all(|x| x.is_finite()) {
            return false;
        }
        let world = WorldModel::new(Geodetic::from_degrees(lat_deg, lon_deg, height), &self.config);
        let mut window = self.empty_window(world);
        if window.start(Time(solution.t_keyframe), &state, &covariance).is_err() {
            return false;
        }
        self.window = Some(window);
        self.is_started = true;
        self.t_resumed = Time(solution.t_keyframe);
        self.newest_covariance = covariance;
        self.alternatives.resume(&state, &covariance);
        // One more may have been published after this one was kept: its number is not given again.
        self.solutions = solution.id + 1;
        self.ties.counts = solution.counts;
        self.ties.t_last_used = solution.t_last_used.map(Time);
        self.ties.systematics.resume(
            [&solution.time_offset, &solution.time_offset_sigma],
            [&solution.calibration, &solution.calibration_sigma],
        );
        true
    }

    /// Tells a run that begins where the vehicle was before: its first state stands on that where nothing else tells the place.
    pub fn remember(&mut self, last: &LastKnown) {
        self.initialiser.remember(last);
    }

    /// What the newest keyframe holds.
    pub fn report(&self) -> &KeyframeReport {
        &self.report
    }

    /// Used and refused measurements per sensor since the start.
    pub fn counts(&self) -> &[SensorCounts] {
        &self.ties.counts
    }

    /// How much too late each [`AIDING`] sensor's stamps are taken to be, and the sigmas of that, s.
    pub fn time_offsets(&self) -> ([f64; AIDING.len()], [f64; AIDING.len()]) {
        self.ties.systematics.time_offsets()
    }

    /// What each of [`CALIBRATIONS`] is found to be off by, and the sigmas of that.
    pub fn calibrations(&self) -> ([f64; CALIBRATIONS.len()], [f64; CALIBRATIONS.len()]) {
        self.ties.systematics.calibrations()
    }

    /// Solves everything in the window as one batch, in at most `max_passes` linearisations, and leaves the window at the
    /// solution. With a window that never forgets this is the trajectory given the whole log, in as many pieces as there were
    /// beginnings. `None` before the first keyframe, or where the information does not determine the states.
    pub fn smooth(&mut self, max_passes: u32) -> Option<Smoothed> {
        let pieces = self.earlier.iter_mut().chain(self.window.as_mut());
        Smoothed::of(pieces, &self.history, &self.imu, max_passes)
    }

    /// With `fgo.fixed_lag` the keyframe that leaves the window with the next: where the vehicle was a window ago, given all that
    /// has come since. `None` while the window fills, and where the last solve found no solution.
    pub fn lagged(&self) -> Option<NavEstimate> {
        let FgoConfig { fixed_lag, window: intervals, .. } = self.config.navigator.fgo;
        let window = self.window.as_ref().filter(|window| fixed_lag && window.nodes().len() > intervals)?;
        smoother::oldest(window, &self.config, self.solutions)
    }

    /// Shows a smoothed trajectory at every IMU sample from its first keyframe on.
    pub fn along(&self, smoothed: &Smoothed, show: impl FnMut(&NavEstimate)) {
        if let Some(window) = &self.window {
            smoothed.along(window.world(), &self.config, &self.history, &self.imu, show);
        }
    }

    fn ingest_imu(&mut self, t: Time, point: ImuPoint) -> Result<(), EstimatorError> {
        if !self.history.push(t, point) {
            self.ties.refuse(Sensor::Imu, RejectReason::BackwardsTime);
            let last = self.history.newest().unwrap_or(Time::MIN);
            return Err(EstimatorError::TimeRunsBackwards { what: "IMU sample", last, t });
        }
        self.ties.counts[Sensor::Imu.index()].used += 1;
        if !self.is_started {
            self.history.forget_before(t - HISTORY_BEFORE_START);
        } else if self.open.t_start().is_some() {
            self.open.advance(&TimedPoint { t, point }, &self.imu);
        }
        Ok(())
    }

    /// Starts the interval after the newest keyframe, if its samples have come. Not at the end of the keyframe itself: its
    /// solution need not wait for this.
    fn open_interval(&mut self) {
        let Some(newest) = self.window.as_ref().and_then(|window| window.nodes().back()) else { return };
        let state = newest.state;
        self.open.start(newest.t, &state.accel_bias, &state.gyro_bias, &self.history, &self.imu);
    }

    fn first_keyframe(&mut self, t: Time) -> Result<Option<Solution>, EstimatorError> {
        let Some(window) = &mut self.window else { return Ok(None) };
        let Some((state, covariance)) = self.initialiser.first_state(t, window.world()) else { return Ok(None) };
        if window.start(t, &state, &covariance).is_err() {
            return Err(EstimatorError::Unsolvable { t, reason: "the covariance of the first state is singular" });
        }
        self.is_started = true;
        self.newest_covariance = covariance;
        // The configuration's sigmas are not those of a place of before.
        if self.initialiser.remembers() {
            self.alternatives.resume(&state, &covariance);
        }
        // What was valid before the first state has been the initialiser's.
        for (measurement, _) in self.pending.drain(..) {
            if let Some(sensor) = measurement.sensor() {
                self.ties.refuse(sensor, RejectReason::BeforeStart);
            }
        }
        self.history.forget_before(t);
        self.report = KeyframeReport::empty();
        Ok(Some(self.solution(t, SolveReport { converged: true, ..SolveReport::default() }, None)))
    }

    fn keyframe(&mut self, t: Time, effort: Effort) -> Result<Option<Solution>, EstimatorError> {
        if !self.is_started {
            return self.first_keyframe(t);
        }
        let Some(window) = &mut self.window else { return Ok(None) };
        let Some(last) = window.nodes().back().map(|node| node.t) else { return Ok(None) };
        if t <= last {
            return Err(EstimatorError::TimeRunsBackwards { what: "keyframe", last, t });
        }
        if self.open.t_start() != Some(last) {
            bridge_to_history(window, &mut self.history, last);
            self.open_interval();
        }
        let Some(window) = &mut self.window else { return Ok(None) };
        let mut side = Preintegration::new(Vector3::zeros(), Vector3::zeros());
        let Some(&whole) = self.open.up_to(t, &self.imu, &mut side) else {
            return Err(EstimatorError::Unsolvable {
                t,
                reason: "no IMU samples reach from the last keyframe to this one",
            });
        };

        window.make_room();
        let before = window.nodes()[window.nodes().len() - 1].state;
        let mut predicted = transport(&before, &whole, window.world());
        let height_sigma = self.newest_covariance[(2, 2)].max(0.0).sqrt();
        let gap = self.history.sampling_period_at(t);
        let is_blind = gap > BLIND;
        let is_lost = !is_blind && !is_plausible(&predicted);
        let moved = predicted.position_enu - before.position_enu;
        self.ties.rounds.advance(t, &moved, &predicted);
        let by_rounds = self.ties.rounds.loosening(&predicted, height_sigma, &self.config.vehicle);
        let loosened = match self.ties.epochs_refused() {
            _ if is_blind => Some(unseen(&before, gap)),
            _ if is_lost => Some(LOST),
            (count, Some(since)) if count >= SUSPICIOUS_EPOCHS => {
                loosening(&self.pending, t, &predicted, height_sigma, t - since, &self.config)
            }
            _ => loosening_by_fixes(&self.pending, &predicted, t, self.ties.fixes_improbable()),
        };
        let loosened = loosened.or(by_rounds.map(|(loosening, shift)| {
            predicted.position_enu += shift;
            loosening
        }));
        let is_inertial_to_blame = loosened.is_none() && self.ties.is_inertial_to_blame();
        let imu_noise = &self.config.vehicle.imu;
        let of_biases = loosening_of_biases(self.t_biases_loosened.map(|last| t - last), imu_noise)
            .filter(|_| is_inertial_to_blame);
        let by_shift = self.ties.take_shift(t).map(|shift| loosening_by_shift(shift, imu_noise));
        let elsewhere = match loosened {
            None => self.alternatives.look(window, &self.newest_covariance, &self.config),
            Some(_) => None,
        };
        let is_loosened = loosened.is_some() || by_shift.is_some() || elsewhere.is_some();
        let singular = EstimatorError::Unsolvable { t, reason: "the interval's covariance is singular" };
        let covariance = match (&loosened, &elsewhere) {
            (Some(loosening), _) if is_blind || is_lost || self.realignment.is_due(t) => {
                self.ties.begin_anew();
                let noise = &self.config.vehicle.imu;
                let mut tilt_from = whole.increment;
                if is_blind {
                    // What was heard during the gap belongs to places that nobody can tie to this one.
                    for (measurement, _) in self.pending.extract_if(.., |(measurement, _)| measurement.t_valid() < t) {
                        if let Some(sensor) = measurement.sensor() {
                            self.ties.refuse(sensor, RejectReason::NoImu);
                        }
                    }
                    // The one sample after it tells the tilt; the line over the gap tells nothing.
                    tilt_from = self.history.at(t).map_or(tilt_from, |point| instant(&point));
                }
                let place = match (is_blind, is_lost) {
                    (true, _) => before,
                    (_, true) => self.realignment.last_well(),
                    _ => predicted,
                };
                let (first, covariance) = self.realignment.begin(&place, loosening, height_sigma, &tilt_from, noise);
                if self.config.navigator.fgo.window == KEEPING_ALL {
                    self.earlier.push(window.take());
                }
                window.start(t, &first, &covariance).map_err(|_| singular)?;
                covariance
            }
            (_, Some(place)) => {
                self.ties.begin_anew();
                let covariance = predict_covariance(&self.newest_covariance, &before, &whole, window.world());
                let (first, covariance) = place.applied(&predicted, &covariance);
                if self.config.navigator.fgo.window == KEEPING_ALL {
                    self.earlier.push(window.take());
                }
                window.start(t, &first, &covariance).map_err(|_| singular)?;
                covariance
            }
            _ => {
                if of_biases.is_some() {
                    self.t_biases_loosened = Some(t);
                }
                let loosening = loosened.or(of_biases).or(by_shift);
                let mut increment = whole;
                if let Some(loosening) = &loosening {
                    loosening.apply(&mut increment);
                }
                window.append(t, &predicted, whole, loosening).map_err(|_| singular)?;
                predict_covariance(&self.newest_covariance, &before, &increment, window.world())
            }
        };

        self.report = KeyframeReport::empty();
        let closing = Closing {
            open: &self.open,
            whole: &whole,
            history: &self.history,
            imu: &self.imu,
            covariance_before: &self.newest_covariance,
            covariance_newest: &covariance,
        };
        // A stamp that is taken to be early may put its reading behind this keyframe: it waits for the next.
        let ready = self.ties.sort_out(&mut self.pending, t);
        self.alternatives.hear(&self.pending[..ready]);
        self.ties.tie_all(&self.pending[..ready], window, &closing, &mut self.report);
        self.pending.drain(..ready);
        window.join(&self.history, &self.imu);
        self.report.cost[0] = window.measurement_cost();

        let max_passes = match effort {
            Effort::Full => self.config.navigator.fgo.max_iterations,
            Effort::Reduced | Effort::Hold => 1,
        };
        let mut solve = window.solve(max_passes, &self.history, &self.imu);
        let mut moved = false;
        if !solve.damped {
            window.sweep_columns();
            if let Some(correction) = self.ties.systematics.judge(|error| window.score(error), t - last) {
                window.correct(&correction, &self.history, &self.imu);
                moved = true;
            }
        }
        if moved {
            let again = window.solve(max_passes, &self.history, &self.imu);
            window.sweep_columns();
            solve = SolveReport {
                passes: solve.passes + again.passes,
                linearised: solve.linearised + again.linearised,
                swept: solve.swept + again.swept,
                ..again
            };
        }
        let is_aligned = !self.realignment.is_searching()
            || self.realignment.search(window, self.config.navigator.fgo.window, &self.history, &self.imu);
        // What damps a solve is no information: the covariance of a damped matrix would be sure of what nobody has seen.
        let of_solve = if solve.damped { None } else { window.newest_covariance() };
        self.newest_covariance = of_solve.unwrap_or(covariance);
        if let Some(newest) = window.nodes().back() {
            if is_aligned && !is_loosened && !is_inertial_to_blame && is_plausible(&newest.state) {
                self.realignment.is_well(&newest.state);
            }
            self.realignment.cover(&newest.state, &mut self.newest_covariance);
            self.alternatives.cover(&newest.state, &mut self.newest_covariance);
        }
        for (error, term, variance) in self.ties.systematics.to_cover() {
            let by_error = window.state_by_error(error, term);
            self.newest_covariance += by_error * by_error.transpose() * variance;
        }
        self.report.cost[1] = window.measurement_cost();
        let oldest = self.earlier.first().unwrap_or(&*window).nodes().front();
        if let Some(oldest) = oldest.map(|node| node.t) {
            self.history.forget_before(oldest);
        }
        self.open.stop();
        if effort == Effort::Hold {
            return Ok(None);
        }
        let status = match (is_inertial_to_blame, is_loosened || !is_aligned) {
            (true, _) => Some(SolutionStatus::Inconsistent),
            (false, true) => Some(SolutionStatus::Loosened),
            (false, false) => None,
        };
        Ok(Some(self.solution(t, solve, status)))
    }

    /// The newest keyframe as a message; also completes the report.
    fn solution(&mut self, t: Time, solve: SolveReport, status: Option<SolutionStatus>) -> Solution {
        self.solutions += 1;
        let mut solution = Solution {
            header: Header::at(t),
            id: self.solutions,
            t_keyframe: t.0,
            t_last_used: self.ties.t_last_used.map(|t| t.0),
            counts: self.ties.counts,
            time_offset: self.time_offsets().0,
            time_offset_sigma: self.time_offsets().1,
            calibration: self.calibrations().0,
            calibration_sigma: self.calibrations().1,
            cost: self.report.cost[1],
            iterations: solve.passes,
            linearised: solve.linearised,
            status: match (solve.damped, status, solve.converged) {
                (_, Some(SolutionStatus::Inconsistent), _) => SolutionStatus::Inconsistent,
                (true, _, _) => SolutionStatus::Damped,
                (false, Some(status), _) => status,
                (false, None, false) => SolutionStatus::NotConverged,
                (false, None, true) => SolutionStatus::Converged,
            } as u32,
            ..Solution::empty()
        };
        if let Some(window) = &self.window {
            solution.origin = window.world().frame.origin().to_degrees();
            solution.keyframes = window.nodes().len() as u32;
            if let Some(newest) = window.nodes().back() {
                newest.state.write_solution(&self.newest_covariance, &mut solution);
            }
        }
        self.report.header = Header::at(t);
        self.report.solution = solution.id;
        self.report.t_keyframe = t.0;
        self.report.iterations = solve.passes;
        self.report.keyframes = solution.keyframes;
        solution
    }
}

impl Estimator for FgoEstimator {
    fn ingest(&mut self, measurement: &Measurement, effort: Effort) -> Result<Option<Solution>, EstimatorError> {
        let reading = match Reading::try_from(measurement) {
            Ok(reading) => reading,
            Err(error) => {
                if let Some(sensor) = measurement.sensor() {
                    self.ties.refuse(sensor, RejectReason::Malformed);
                }
                return Err(error.into());
            }
        };
        if !self.is_started {
            self.initialiser.push(measurement);
        } else if self.open.t_start().is_none() {
            self.open_interval();
        }
        match reading {
            Reading::Imu { gyro_body, accel_body } => {
                let point = ImuPoint { gyro_body: gyro_body.into(), accel_body: accel_body.into() };
                self.ingest_imu(measurement.t_valid(), point)?;
                Ok(None)
            }
            Reading::Keyframe { .. } => self.keyframe(measurement.t_keyframe(), effort),
            _ if measurement.t_valid() <= self.t_resumed => {
                if let Some(sensor) = measurement.sensor() {
                    self.ties.refuse(sensor, RejectReason::BeforeStart);
                }
                Ok(None)
            }
            _ if self.pending.len() == PENDING_MAX => {
                if let Some(sensor) = measurement.sensor() {
                    self.ties.refuse(sensor, RejectReason::TooMany);
                }
                Ok(None)
            }
            _ => {
                let offset = place(measurement).map_or(Duration::ZERO, |sensor| self.ties.systematics.offset(sensor));
                self.open.want(measurement.t_valid() - offset, &self.imu);
                self.pending.push((*measurement, reading));
                Ok(None)
            }
        }
    }
}

/// A restarted estimator has samples only from some time after its keyframe: the first of them also stands at the keyframe,
/// so that the stretch between is bridged as a gap.
fn bridge_to_history(window: &Window, history: &mut ImuHistory, t_keyframe: Time) {
    debug_assert!(!window.nodes().is_empty(), "a started window holds a keyframe");
    if history.oldest().is_some_and(|oldest| oldest > t_keyframe) {
        history.hold_back_to(t_keyframe);
    }
}

const _: () = assert!(AIDING.len() == 5, "`Solution::t_last_used` has five places");
