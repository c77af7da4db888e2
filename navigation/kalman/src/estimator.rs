//! The estimator around the filters: measurements in, a solution out at each keyframe, late readings by rolling back.
//!
//! ```text
//! IMU sample   → history
//! reading      → its place in the timeline; what stands before it is taken in
//! keyframe k   → everything up to t_k is taken in, the filters are carried to t_k, kept there, and published
//! late reading → back to the newest keyframe before it, and forward again over the kept samples and readings, at the next
//!                keyframe; one that is older than the horizon is counted and left
//! ```
//!
//! A reading is taken in at its own time: the IMU step in which it lies is split there, with the sample interpolated, as the
//! smoother does it. (The paper updates at the sample after it.) What a filter decides on a reading it may decide otherwise
//! after rolling back; counts follow. Before the first state the [`Initialiser`] listens.

use std::collections::VecDeque;

use nav_geometry::Geodetic;
use nav_models::estimator::{Effort, Estimator, EstimatorError};
use nav_models::imu_history::{ImuHistory, ImuModel};
use nav_models::initialisation::{Initialiser, LastKnown};
use nav_models::judging::Judges;
use nav_models::preintegration::ImuPoint;
use nav_models::state::{ERROR_DIM, NavState};
use nav_models::world::WorldModel;
use shared_types::{
    AIDING, Config, Duration, Header, KeyframeReport, Measurement, Reading, RejectReason, SENSORS, Sensor,
    SensorCounts, Solution, SolutionStatus, Time, TimeOffset,
};

use crate::bank::{Bank, Centralised, Stretch};
use crate::federated::Federated;
use crate::timeline::{Entry, Outcome, Timeline};
use crate::update::{Ledger, Surroundings, Updater, refuse};

/// EKF-ILNS: one error-state filter, tightly coupled.
pub type Ekf = KalmanEstimator<Centralised>;
/// FKF-ILNS plus: a local filter a sensor, fused.
pub type FederatedKf = KalmanEstimator<Federated>;

/// Samples kept for an initialisation that looks back.
const HISTORY_BEFORE_START: Duration = Duration(20_000_000_000);
/// Room for samples: 40 s at 200 Hz.
const SAMPLES_USUAL: usize = 8192;
/// Most keyframes for which room is made beforehand.
const KEYFRAMES_RESERVED: usize = 1024;

/// The update that lets a state go which was wrong by tens of metres is no small step: linearised once, ranges leave it metres off
/// at sigmas of decimetres, and everything after is refused.
const ITERATIONS_OF_A_JUMP: usize = 10;

/// Everything that changes when a reading is taken in, as it stands at one time.
#[derive(Clone, Debug)]
struct Standing<B> {
    t: Time,
    bank: B,
    judges: Judges,
    t_last_used: [Time; AIDING.len()],
}

/// What happened since the last solution.
#[derive(Clone, Copy, Debug, Default)]
struct Effects {
    passes: u32,
    linearised: u32,
    not_converged: bool,
    diverged: bool,
    loosened: bool,
}

/// A Kalman filter, or several, as an [`Estimator`].
#[derive(Clone, Debug)]
pub struct KalmanEstimator<B> {
    config: Config,
    imu: ImuModel,
    world: Option<WorldModel>,
    initialiser: Initialiser,
    history: ImuHistory,
    timeline: Timeline,
    /// At keyframes, oldest first; the last is the newest.
    kept: VecDeque<Standing<B>>,
    now: Option<Standing<B>>,
    /// The earliest late reading that has not been taken in yet.
    rewind: Option<Time>,
    /// Stamps are taken to be so late.
    stamp_offsets: [Duration; AIDING.len()],
    updater: Updater,
    counts: [SensorCounts; SENSORS.len()],
    solutions: u64,
    effects: Effects,
    gathering: KeyframeReport,
    report: KeyframeReport,
    /// Readings up to here are in the first state already.
    t_start: Time,
}

impl<B: Bank> KalmanEstimator<B> {
    /// An estimator without origin: it waits for [`KalmanEstimator::set_origin`].
    pub fn new(config: &Config) -> KalmanEstimator<B> {
        let navigator = &config.navigator;
        let keyframes = navigator.kalman.horizon.as_seconds() / navigator.keyframes.min_spacing.as_seconds();
        KalmanEstimator {
            config: config.clone(),
            imu: ImuModel { noise: config.vehicle.imu.clone(), gate: navigator.imu },
            world: None,
            initialiser: Initialiser::new(config),
            history: ImuHistory::with_capacity(SAMPLES_USUAL),
            timeline: Timeline::new(),
            kept: VecDeque::with_capacity((keyframes as usize + 4).min(KEYFRAMES_RESERVED)),
            now: None,
            rewind: None,
            stamp_offsets: navigator.sensors.map(|sensor| match sensor.time_offset {
                TimeOffset::Off => Duration::ZERO,
                TimeOffset::Fixed(offset) | TimeOffset::Estimated(offset) => Duration::from_seconds(offset),
            }),
            updater: Updater::new(),
            counts: [SensorCounts::default(); SENSORS.len()],
            solutions: 0,
            effects: Effects::default(),
            gathering: KeyframeReport::empty(),
            report: KeyframeReport::empty(),
            t_start: Time::MIN,
        }
    }

    /// Fixes the origin of the frame. Later calls change nothing: a run has one frame.
    pub fn set_origin(&mut self, origin: Geodetic) {
        if self.world.is_none() {
            self.world = Some(WorldModel::new(origin, &self.config));
        }
    }

    /// Takes up from a solution of an earlier run. Returns `false`, changing nothing, when it holds no valid state.
    pub fn resume(&mut self, solution: &Solution) -> bool {
        let Some((state, covariance)) = NavState::from_solution(solution) else { return false };
        let [lat_deg, lon_deg, height] = solution.origin;
        let is_place = [lat_deg, lon_deg, height].iter().all(|x| x.is_finite());
        if !is_place || (0..ERROR_DIM).any(|axis| covariance[(axis, axis)] <= 0.0) {
            return false;
        }
        self.world = Some(WorldModel::new(Geodetic::from_degrees(lat_deg, lon_deg, height), &self.config));
        let t = Time(solution.t_keyframe);
        self.start(Standing {
            t,
            bank: B::start(&self.config, &state, &covariance),
            judges: Judges::default(),
            t_last_used: solution.t_last_used.map(Time),
        });
        // One more may have been published after this one was kept: its number is not given again.
        self.solutions = solution.id + 1;
        self.counts = solution.counts;
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
        &self.counts
    }

    /// How much too late each [`AIDING`] sensor's stamps are taken to be, s: as configured, a filter does not ask.
    pub fn time_offsets(&self) -> ([f64; AIDING.len()], [f64; AIDING.len()]) {
        (self.stamp_offsets.map(Duration::as_seconds), [0.0; AIDING.len()])
    }

    fn start(&mut self, standing: Standing<B>) {
        self.t_start = standing.t;
        self.kept.clear();
        self.kept.push_back(standing.clone());
        self.now = Some(standing);
        self.rewind = None;
    }

    fn refuse(&mut self, sensor: Sensor, reason: RejectReason) {
        self.counts[sensor.index()].rejected[reason.index()] += 1;
    }

    fn ingest_imu(&mut self, t: Time, point: ImuPoint) -> Result<(), EstimatorError> {
        if !self.history.push(t, point) {
            self.refuse(Sensor::Imu, RejectReason::BackwardsTime);
            let last = self.history.newest().unwrap_or(Time::MIN);
            return Err(EstimatorError::TimeRunsBackwards { what: "IMU sample", last, t });
        }
        self.counts[Sensor::Imu.index()].used += 1;
        if self.now.is_none() {
            self.history.forget_before(t - HISTORY_BEFORE_START);
        }
        Ok(())
    }

    fn ingest_reading(&mut self, measurement: &Measurement, reading: Reading) {
        let Some(sensor) = measurement.sensor() else { return };
        let offset = AIDING.iter().position(|&aiding| aiding == sensor).map(|place| self.stamp_offsets[place]);
        let t = measurement.t_valid() - offset.unwrap_or(Duration::ZERO);
        let Some(entry) = Entry::new(t, measurement, reading) else {
            return self.refuse(sensor, RejectReason::Malformed);
        };
        let is_late = match (&self.now, self.kept.front(), self.kept.back()) {
            (Some(_), Some(oldest), _) if t <= oldest.t => {
                let is_before_start = t <= self.t_start;
                let reason = if is_before_start { RejectReason::BeforeStart } else { RejectReason::OlderThanWindow };
                return self.refuse(sensor, reason);
            }
            (Some(now), _, Some(newest)) => t < now.t || t <= newest.t,
            _ => false,
        };
        match self.timeline.insert(entry) {
            None => self.refuse(sensor, RejectReason::TooMany),
            Some(is_behind) if is_late || !is_behind => {
                self.rewind = Some(self.rewind.map_or(t, |earliest| earliest.min(t)));
            }
            // What is older than this reading waits for nobody any more, unless there is something to go back for.
            Some(_) if self.rewind.is_none() => self.take_in_before(t),
            Some(_) => {}
        }
    }

    fn take_in_before(&mut self, t: Time) {
        if let Some(mut now) = self.now.take() {
            // A failure is told at the keyframe, where it is met again.
            let _told_later = self.run_to(&mut now, t - Duration(1), false);
            self.now = Some(now);
        }
    }

    /// Takes in every reading up to `t_end`, and with `carries` goes on to `t_end` itself.
    fn run_to(&mut self, now: &mut Standing<B>, t_end: Time, carries: bool) -> Result<(), EstimatorError> {
        let Some(world) = self.world else { return Ok(()) };
        while let Some(group) = self.timeline.next_group(t_end) {
            let first = *self.timeline.get_mut(group.start);
            let mut ledger = Ledger { judges: &mut now.judges, counts: &mut self.counts, report: &mut self.gathering };
            self.timeline.take(&group);
            if self.history.newest().is_none_or(|newest| first.t > newest) {
                group.for_each(|index| refuse(self.timeline.get_mut(index), RejectReason::NoImu, &mut ledger));
                continue;
            }
            if let Err(error) = carry(&mut now.bank, &mut now.t, first.t, &mut self.history, &self.imu, &world) {
                group.for_each(|index| refuse(self.timeline.get_mut(index), RejectReason::NoImu, &mut ledger));
                return Err(error);
            }
            let filter = now.bank.local(first.place);
            let loosened =
                self.updater.loosening(&mut self.timeline, group.clone(), filter, ledger.judges, &self.config);
            let mut iterations = self.config.navigator.kalman.iterations;
            if let Some(loosened) = &loosened {
                now.bank.loosen(loosened);
                self.effects.loosened = true;
                iterations = iterations.max(ITERATIONS_OF_A_JUMP);
            }
            let around = Surroundings { config: &self.config, world: &world, history: &self.history };
            let filter = now.bank.local(first.place);
            let done =
                self.updater.take_in(&mut self.timeline, group.clone(), filter, iterations, &around, &mut ledger);
            if let Some(done) = done {
                self.effects.diverged |= now.bank.fuse().is_err();
                now.t_last_used[first.place] = now.t_last_used[first.place].max(first.t);
                self.effects.passes = self.effects.passes.max(done.passes);
                self.effects.linearised += done.passes;
                self.effects.not_converged |= !done.converged;
                self.gathering.cost[0] += done.cost[0];
                self.gathering.cost[1] += done.cost[1];
            }
            let was_no_number =
                |index: usize| self.timeline.get_mut(index).outcome == Some(Outcome::Refused(RejectReason::NotFinite));
            self.effects.diverged |= group.into_iter().any(was_no_number);
        }
        if carries { carry(&mut now.bank, &mut now.t, t_end, &mut self.history, &self.imu, &world) } else { Ok(()) }
    }

    /// Goes back to the newest keyframe before `t` and forward again to the newest of all.
    fn roll_back(&mut self, t: Time) -> Result<Option<Standing<B>>, EstimatorError> {
        let Some(index) = self.kept.partition_point(|standing| standing.t < t).checked_sub(1) else { return Ok(None) };
        let mut now = self.kept[index].clone();
        self.timeline.rewind_to(now.t);
        for later in index + 1..self.kept.len() {
            let t_later = self.kept[later].t;
            if let Err(error) = self.run_to(&mut now, t_later, true) {
                // The estimate stays the one without the late reading, which has taken in all the others.
                let t_now = self.now.as_ref().map_or(t_later, |now| now.t);
                self.timeline.rewind_to(t_now);
                return Err(error);
            }
            self.kept[later] = now.clone();
        }
        // What was told of the interval so far is told again.
        self.effects = Effects::default();
        self.gathering.cost = [0.0; 2];
        Ok(Some(now))
    }

    fn first_keyframe(&mut self, t: Time) -> Option<Solution> {
        let world = self.world?;
        let (state, covariance) = self.initialiser.first_state(t, &world)?;
        self.start(Standing {
            t,
            bank: B::start(&self.config, &state, &covariance),
            judges: Judges::default(),
            t_last_used: [Time::MIN; AIDING.len()],
        });
        // What was valid before the first state has been the initialiser's.
        let counts = &mut self.counts;
        self.timeline.drain_up_to(t, |entry| {
            counts[entry.sensor.index()].rejected[RejectReason::BeforeStart.index()] += 1;
        });
        self.history.forget_before(t);
        Some(self.solution())
    }

    fn keyframe(&mut self, t: Time, effort: Effort) -> Result<Option<Solution>, EstimatorError> {
        let Some(last) = self.kept.back().map(|standing| standing.t) else { return Ok(self.first_keyframe(t)) };
        if t <= last {
            return Err(EstimatorError::TimeRunsBackwards { what: "keyframe", last, t });
        }
        if self.history.newest().is_none_or(|newest| newest < t) {
            return Err(EstimatorError::Unsolvable {
                t,
                reason: "no IMU samples reach from the last keyframe to this one",
            });
        }
        let rolled_back = match self.rewind.take() {
            Some(t_late) => self.roll_back(t_late)?,
            None => None,
        };
        let Some(mut now) = rolled_back.or_else(|| self.now.take()) else { return Ok(None) };
        let carried = self.run_to(&mut now, t, true);
        if carried.is_ok() {
            self.kept.push_back(now.clone());
        }
        self.now = Some(now);
        carried?;
        self.forget(t - self.config.navigator.kalman.horizon);
        Ok((effort != Effort::Hold).then(|| self.solution()))
    }

    /// Forgets what no late reading after `t` can need.
    fn forget(&mut self, t: Time) {
        while self.kept.get(1).is_some_and(|second| second.t <= t) {
            self.kept.pop_front();
        }
        if let Some(oldest) = self.kept.front() {
            self.timeline.forget_up_to(oldest.t);
            self.history.forget_before(oldest.t);
        }
    }

    /// Where the filters stand, as a message; also completes the report.
    fn solution(&mut self) -> Solution {
        self.solutions += 1;
        let effects = core::mem::take(&mut self.effects);
        let (t, t_last_used) =
            self.now.as_ref().map_or((Time::MIN, [Time::MIN; AIDING.len()]), |now| (now.t, now.t_last_used));
        self.gathering.header = Header::at(t);
        self.gathering.solution = self.solutions;
        self.gathering.t_keyframe = t.0;
        self.gathering.iterations = effects.passes;
        self.gathering.keyframes = 1;
        self.report = core::mem::replace(&mut self.gathering, KeyframeReport::empty());
        let mut solution = Solution {
            header: Header::at(t),
            id: self.solutions,
            t_keyframe: t.0,
            origin: self.world.map_or([0.0; 3], |world| world.frame.origin().to_degrees()),
            t_last_used: t_last_used.map(|t| t.0),
            counts: self.counts,
            time_offset: self.time_offsets().0,
            time_offset_sigma: self.time_offsets().1,
            cost: self.report.cost[1],
            keyframes: 1,
            iterations: effects.passes,
            linearised: effects.linearised,
            status: match (effects.diverged, effects.loosened, effects.not_converged) {
                (true, _, _) => SolutionStatus::Damped,
                (false, true, _) => SolutionStatus::Loosened,
                (false, false, true) => SolutionStatus::NotConverged,
                (false, false, false) => SolutionStatus::Converged,
            } as u32,
            ..Solution::empty()
        };
        if let Some(now) = &self.now {
            let published = now.bank.published();
            published.state.write_solution(&published.covariance, &mut solution);
        }
        solution
    }
}

/// Carries a bank from `t` to `t_end`, and `t` with it.
fn carry<B: Bank>(
    bank: &mut B,
    t: &mut Time,
    t_end: Time,
    history: &mut ImuHistory,
    imu: &ImuModel,
    world: &WorldModel,
) -> Result<(), EstimatorError> {
    if t_end <= *t {
        return Ok(());
    }
    // A restarted estimator has samples only from some time after its keyframe: the first of them also stands there, so
    // that the stretch between is bridged as a gap.
    if history.oldest().is_some_and(|oldest| oldest > *t) {
        history.hold_back_to(*t);
    }
    let stretch = Stretch { from: *t, to: t_end, history, imu, world };
    bank.predict(&stretch).map_err(|_| EstimatorError::Unsolvable {
        t: t_end,
        reason: "the prediction from the IMU samples is not a finite state with a covariance",
    })?;
    *t = t_end;
    Ok(())
}

impl<B: Bank> Estimator for KalmanEstimator<B> {
    fn ingest(&mut self, measurement: &Measurement, effort: Effort) -> Result<Option<Solution>, EstimatorError> {
        let reading = match Reading::try_from(measurement) {
            Ok(reading) => reading,
            Err(error) => {
                if let Some(sensor) = measurement.sensor() {
                    self.refuse(sensor, RejectReason::Malformed);
                }
                return Err(error.into());
            }
        };
        if self.now.is_none() {
            self.initialiser.push(measurement);
        }
        match reading {
            Reading::Imu { gyro_body, accel_body } => {
                let point = ImuPoint { gyro_body: gyro_body.into(), accel_body: accel_body.into() };
                self.ingest_imu(measurement.t_valid(), point)?;
                Ok(None)
            }
            Reading::Keyframe { .. } => self.keyframe(measurement.t_keyframe(), effort),
            _ => {
                self.ingest_reading(measurement, reading);
                Ok(None)
            }
        }
    }
}
