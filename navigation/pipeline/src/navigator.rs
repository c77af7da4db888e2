//! Preprocessor, estimator and propagator in line.

use nav_fgo::{KEEPING_ALL, Smoothed};
use nav_models::estimator::{Effort, Estimator};
use nav_models::propagator::Propagator;
use nav_preprocessing::{ImuGate, ImuVerdict, Preprocessor};
use shared_types::{
    AIDING, BuoyFix, CALIBRATIONS, Config, Duration, FrameOrigin, ImuSample, KeyframeReport, Measurement, NavEstimate,
    RawReading, RejectReason, SENSORS, SensorCounts, SensorHealth, Solution, Time,
};

use crate::chosen::ChosenEstimator;
use crate::rebase::{Arrivals, Rebase};

/// Intervals of the longest window that may be configured.
const LONGEST_WINDOW: usize = 500;

/// What comes out of the navigator.
#[derive(Clone, Copy, Debug)]
pub enum Output<'a> {
    /// The frame was fixed.
    Origin(&'a FrameOrigin),
    /// One per accepted IMU sample, and per refused one of an instrument that has frozen or cannot be right (INVALID).
    Estimate(&'a NavEstimate),
    /// One per solved keyframe, with what the keyframe held.
    Solution(&'a Solution, &'a KeyframeReport),
    /// With `fgo.fixed_lag`, after a solution: where the vehicle was a window ago, given all that has come since.
    Lagged(&'a NavEstimate),
}

/// The caller's clock around each keyframe's work; the navigator itself knows none.
pub trait SolveClock {
    /// CPU time of this thread, ns.
    fn thread_ns(&mut self) -> u64;
}

/// No clock: solutions say 0.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unmeasured;

impl SolveClock for Unmeasured {
    fn thread_ns(&mut self) -> u64 {
        0
    }
}

/// The whole navigator.
#[derive(Debug)]
pub struct Navigator {
    preprocessor: Preprocessor,
    back: Back,
    imu_gate: ImuGate,
    propagator: Propagator,
    knows_origin: bool,
}

/// What a measurement reaches: kept apart from the preprocessor, which lends it measurements.
#[derive(Debug)]
struct Back {
    estimator: ChosenEstimator,
    arrivals: Arrivals,
    t_imu: Time,
    keyframe_errors: u64,
}

impl Navigator {
    /// A navigator that hears of buoys as their fixes come, as a live one does.
    pub fn new(config: &Config, rebase: Rebase) -> Navigator {
        Navigator {
            preprocessor: Preprocessor::new(config),
            back: Back {
                estimator: ChosenEstimator::new(config),
                arrivals: Arrivals::new(rebase),
                t_imu: Time::MIN,
                keyframe_errors: 0,
            },
            imu_gate: ImuGate::new(&config.navigator.imu),
            propagator: Propagator::new(config),
            knows_origin: false,
        }
    }

    /// A navigator whose estimator keeps every keyframe, for [`Navigator::smooth`] at the end. Some 40 kB per keyframe.
    pub fn keeping_all(config: &Config) -> Navigator {
        let mut config = config.clone();
        // Readings find their keyframes as late as the longest window lets them.
        config.navigator.fgo.window = LONGEST_WINDOW;
        let mut navigator = Navigator::new(&config, Rebase::After(Duration::ZERO));
        config.navigator.fgo.window = KEEPING_ALL;
        navigator.back.estimator = ChosenEstimator::new(&config);
        navigator
    }

    /// The trajectory given all that was pushed. `None` before the first keyframe, or where the measurements do not
    /// determine it.
    pub fn smooth(&mut self, max_passes: u32) -> Option<Smoothed> {
        self.back.estimator.smooth(max_passes)
    }

    /// Shows a smoothed trajectory at every IMU sample from its first keyframe on.
    pub fn along(&self, smoothed: &Smoothed, show: impl FnMut(&NavEstimate)) {
        self.back.estimator.along(smoothed, show);
    }

    /// Gives all buoy positions of a log beforehand, to be interpolated.
    #[must_use]
    pub fn with_known_buoys(mut self, fixes: Vec<BuoyFix>) -> Navigator {
        self.preprocessor = self.preprocessor.with_known_buoys(fixes);
        self
    }

    /// Takes one raw reading, in order of arrival.
    pub fn push(&mut self, reading: &RawReading, clock: &mut impl SolveClock, sink: &mut impl FnMut(Output<'_>)) {
        if let RawReading::Imu(sample) = reading {
            let t = Time(sample.header.t_valid);
            self.back.t_imu = self.back.t_imu.max(t);
        }
        let back = &mut self.back;
        self.preprocessor.push(reading, &mut |measurement| back.ingest(&measurement, clock, sink));
        self.tell_origin(sink);
        if let RawReading::Imu(sample) = reading {
            self.advance(sample, sink);
        }
    }

    fn advance(&mut self, sample: &ImuSample, sink: &mut impl FnMut(Output<'_>)) {
        let t = Time(sample.header.t_valid);
        if let ImuVerdict::Reject(_) = self.imu_gate.check(sample) {
            if self.imu_gate.is_blind() {
                sink(Output::Estimate(&self.propagator.without_imu(t)));
            }
            return;
        }
        if let Some(solution) = self.back.arrivals.take(t)
            && self.propagator.rebase(&solution).is_err()
        {
            self.back.keyframe_errors += 1;
        }
        if let Ok(Some(estimate)) = self.propagator.advance(sample) {
            sink(Output::Estimate(&estimate));
        }
    }

    /// Ends the run: what still waits for company is taken as it is.
    pub fn finish(&mut self, clock: &mut impl SolveClock, sink: &mut impl FnMut(Output<'_>)) {
        let back = &mut self.back;
        self.preprocessor.finish(&mut |measurement| back.ingest(&measurement, clock, sink));
    }

    /// Hands the frame on as soon as it is fixed. A frame that the configuration gives is known from the first reading on.
    fn tell_origin(&mut self, sink: &mut impl FnMut(Output<'_>)) {
        if !self.knows_origin
            && let Some(origin) = self.preprocessor.origin()
        {
            self.back.estimator.set_origin(&origin);
            self.knows_origin = true;
            sink(Output::Origin(&origin));
        }
    }

    /// The frame, once fixed.
    pub fn origin(&self) -> Option<FrameOrigin> {
        self.preprocessor.origin()
    }

    /// Received and refused readings per sensor, in the order of [`SENSORS`].
    pub fn health(&self) -> &[SensorHealth; SENSORS.len()] {
        self.preprocessor.health()
    }

    /// How much too late each [`AIDING`] sensor's stamps are taken to be, and the sigmas of that, s.
    pub fn time_offsets(&self) -> ([f64; AIDING.len()], [f64; AIDING.len()]) {
        self.back.estimator.time_offsets()
    }

    /// What each of [`CALIBRATIONS`] is found to be off by, and the sigmas of that.
    pub fn calibrations(&self) -> ([f64; CALIBRATIONS.len()], [f64; CALIBRATIONS.len()]) {
        self.back.estimator.calibrations()
    }

    /// Used and refused measurements per sensor.
    pub fn counts(&self) -> &[SensorCounts] {
        self.back.estimator.counts()
    }

    /// Refusals of one sensor over all stages, by reason.
    pub fn rejected(&self, index: usize) -> impl Iterator<Item = (RejectReason, u64)> + '_ {
        let (early, late) = (&self.health()[index].rejected, &self.counts()[index].rejected);
        shared_types::REJECT_REASONS.into_iter().map(|reason| (reason, early[reason.index()] + late[reason.index()]))
    }

    /// Keyframes that gave no solution for want of IMU samples or of a regular matrix.
    pub fn keyframe_errors(&self) -> u64 {
        self.back.keyframe_errors
    }
}

impl Back {
    fn ingest(&mut self, measurement: &Measurement, clock: &mut impl SolveClock, sink: &mut impl FnMut(Output<'_>)) {
        if measurement.kind != Measurement::KEYFRAME {
            // A malformed one is counted by the estimator; there is nobody else to tell.
            let _counted = self.estimator.ingest(measurement, Effort::Full);
            return;
        }
        let began = clock.thread_ns();
        match self.estimator.ingest(measurement, Effort::Full) {
            Ok(Some(mut solution)) => {
                solution.solve_ns = clock.thread_ns() - began;
                sink(Output::Solution(&solution, self.estimator.report()));
                self.arrivals.push(self.t_imu, solution);
                if let Some(lagged) = self.estimator.lagged() {
                    sink(Output::Lagged(&lagged));
                }
            }
            Ok(None) => {}
            Err(_) => self.keyframe_errors += 1,
        }
    }
}
