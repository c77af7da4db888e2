//! Raw IMU samples of the window, and the preintegration of the interval that is still open.
//!
//! One run per interval (§2.3 of the method): the recursion advances at sample arrival and its state after every sample is
//! kept, so that the piece up to any instant costs one side step, and the closing of the interval costs nothing more.

use std::collections::VecDeque;

use nalgebra::Vector3;
use nav_models::preintegration::{ImuPoint, Preintegration};
use nav_models::propagator::{GAP_INFLATION, LONG_GAP_INFLATION};
use shared_types::{Duration, ImuGateConfig, ImuNoise, Time};

/// Times between samples that are prepared in advance; an interval holds some tens of readings.
const WANTED_MAX: usize = 256;

/// What integrating a step needs to know of the instrument.
#[derive(Clone, Debug)]
pub struct ImuModel {
    /// Noise densities and bias random walks.
    pub noise: ImuNoise,
    /// What counts as a gap.
    pub gate: ImuGateConfig,
}

impl ImuModel {
    /// Factor on the white noise densities in a step of this length.
    pub fn inflation(&self, step: Duration) -> f64 {
        if step.abs() > self.gate.long_gap {
            LONG_GAP_INFLATION
        } else if step.abs() > self.gate.gap {
            GAP_INFLATION
        } else {
            1.0
        }
    }
}

/// A sample and its time.
#[derive(Clone, Copy, Debug)]
pub struct TimedPoint {
    /// Data time.
    pub t: Time,
    /// Raw rate and specific force.
    pub point: ImuPoint,
}

/// Raw samples from the oldest keyframe on, in order of time.
#[derive(Clone, Debug)]
pub struct ImuHistory {
    samples: VecDeque<TimedPoint>,
}

impl ImuHistory {
    /// With room for `capacity` samples before it grows.
    pub fn with_capacity(capacity: usize) -> ImuHistory {
        ImuHistory { samples: VecDeque::with_capacity(capacity) }
    }

    /// Time of the newest sample.
    pub fn newest(&self) -> Option<Time> {
        self.samples.back().map(|sample| sample.t)
    }

    /// Time of the oldest sample.
    pub fn oldest(&self) -> Option<Time> {
        self.samples.front().map(|sample| sample.t)
    }

    /// Appends a sample; `false` if it is not later than the newest, and then nothing happens.
    pub fn push(&mut self, t: Time, point: ImuPoint) -> bool {
        if self.newest().is_some_and(|newest| t <= newest) {
            return false;
        }
        self.samples.push_back(TimedPoint { t, point });
        true
    }

    /// Forgets what is older than `t`, but for the one sample from which `t` itself is interpolated.
    pub fn forget_before(&mut self, t: Time) {
        while self.samples.get(1).is_some_and(|second| second.t <= t) {
            self.samples.pop_front();
        }
    }

    /// The sample at `t`, interpolated linearly; `None` outside the history.
    pub fn at(&self, t: Time) -> Option<ImuPoint> {
        let after = self.samples.partition_point(|sample| sample.t < t);
        let second = self.samples.get(after)?;
        if second.t == t {
            return Some(second.point);
        }
        let first = self.samples.get(after.checked_sub(1)?)?;
        Some(interpolate(first, second, t))
    }

    /// Whether a sample was taken at exactly `t`.
    pub fn is_sample(&self, t: Time) -> bool {
        self.samples.binary_search_by_key(&t, |sample| sample.t).is_ok()
    }

    /// Sampling period around `t`; that of the usual instrument where it cannot be told.
    pub fn sampling_period_at(&self, t: Time) -> Duration {
        const USUAL: Duration = Duration(5_000_000);
        let after = self.samples.partition_point(|sample| sample.t < t).max(1);
        match (self.samples.get(after - 1), self.samples.get(after)) {
            (Some(first), Some(second)) => second.t - first.t,
            _ => USUAL,
        }
    }

    /// Holds the oldest sample back to an earlier instant `t`: what a restarted estimator knows of the time before.
    pub fn hold_back_to(&mut self, t: Time) {
        if let Some(&oldest) = self.samples.front()
            && t < oldest.t
        {
            self.samples.push_front(TimedPoint { t, point: oldest.point });
        }
    }

    /// Samples strictly between two instants.
    pub fn between(&self, from: Time, to: Time) -> impl DoubleEndedIterator<Item = &TimedPoint> {
        let first = self.samples.partition_point(|sample| sample.t <= from);
        let last = self.samples.partition_point(|sample| sample.t < to).max(first);
        self.samples.range(first..last)
    }

    /// Preintegrates directly from one instant to another, backward when `to` is earlier. `None` outside the history.
    pub fn integrate(
        &self,
        from: Time,
        to: Time,
        accel_bias: &Vector3<f64>,
        gyro_bias: &Vector3<f64>,
        model: &ImuModel,
    ) -> Option<Preintegration> {
        let mut piece = Preintegration::new(*accel_bias, *gyro_bias);
        let mut last = TimedPoint { t: from, point: self.at(from)? };
        let end = TimedPoint { t: to, point: self.at(to)? };
        let mut step = |next: &TimedPoint| {
            let dt = next.t - last.t;
            if dt != Duration::ZERO {
                piece.step(&model.noise, dt.as_seconds(), &last.point, &next.point, model.inflation(dt));
            }
            last = *next;
        };
        if from <= to {
            self.between(from, to).for_each(&mut step);
        } else {
            self.between(to, from).rev().for_each(&mut step);
        }
        step(&end);
        Some(piece)
    }
}

fn interpolate(first: &TimedPoint, second: &TimedPoint, t: Time) -> ImuPoint {
    let share = (t - first.t).as_seconds() / (second.t - first.t).as_seconds();
    ImuPoint::interpolate(&first.point, &second.point, share)
}

/// The interval since the newest keyframe, preintegrated as far as samples have come.
///
/// Besides the prefix up to every sample it keeps those up to the times that were asked for with [`OpenInterval::want`]:
/// a reading's side step is done when its samples arrive, and the keyframe finds it ready.
#[derive(Clone, Debug)]
pub struct OpenInterval {
    prefixes: Vec<Prefix>,
    /// Times between samples from the keyframe on, each once, in the order of their asking.
    wanted: Vec<Time>,
    /// Prefixes up to wanted times that samples have passed.
    sides: Vec<Preintegration>,
    /// The times of `sides`.
    side_times: Vec<Time>,
}

#[derive(Clone, Debug)]
struct Prefix {
    sample: TimedPoint,
    increment: Preintegration,
}

impl OpenInterval {
    /// Starts at a keyframe and takes in the samples that `history` already holds after it. `None` when the keyframe is
    /// outside the history.
    pub fn start(
        &mut self,
        t_keyframe: Time,
        accel_bias: &Vector3<f64>,
        gyro_bias: &Vector3<f64>,
        history: &ImuHistory,
        model: &ImuModel,
    ) -> Option<()> {
        let point = history.at(t_keyframe)?;
        self.prefixes.clear();
        // What was wanted after this keyframe has been integrated from the one before.
        self.wanted.append(&mut self.side_times);
        self.sides.clear();
        self.wanted.retain(|&t| t > t_keyframe);
        self.prefixes.push(Prefix {
            sample: TimedPoint { t: t_keyframe, point },
            increment: Preintegration::new(*accel_bias, *gyro_bias),
        });
        for sample in history.between(t_keyframe, Time::MAX) {
            self.advance(sample, model);
        }
        Some(())
    }

    /// An interval that has not been started, with room for `capacity` samples.
    pub fn with_capacity(capacity: usize) -> OpenInterval {
        OpenInterval {
            prefixes: Vec::with_capacity(capacity),
            wanted: Vec::with_capacity(WANTED_MAX),
            sides: Vec::with_capacity(WANTED_MAX),
            side_times: Vec::with_capacity(WANTED_MAX),
        }
    }

    /// Ends it: another is to be started before samples are taken in again.
    pub fn stop(&mut self) {
        self.prefixes.clear();
    }

    /// Takes in the next sample. Does nothing before [`OpenInterval::start`].
    pub fn advance(&mut self, sample: &TimedPoint, model: &ImuModel) {
        let Some(newest) = self.prefixes.len().checked_sub(1) else { return };
        // The copy of the newest prefix is made in its place: it is a kilobyte and a half, 200 times a second.
        self.prefixes.extend_from_within(newest..);
        if let [.., last, next] = self.prefixes.as_mut_slice() {
            let dt = sample.t - last.sample.t;
            next.sample = *sample;
            next.increment.step(&model.noise, dt.as_seconds(), &last.sample.point, &sample.point, model.inflation(dt));
        }
        let mut index = 0;
        while index < self.wanted.len() {
            if self.wanted[index] <= sample.t {
                let t = self.wanted.swap_remove(index);
                self.side_step(t, model);
            } else {
                index += 1;
            }
        }
    }

    /// Asks for the prefix up to `t` in advance. One that is not wanted in time, or for which there is no room, is made
    /// when it is needed.
    pub fn want(&mut self, t: Time, model: &ImuModel) {
        let is_known = self.wanted.contains(&t) || self.side_times.contains(&t);
        if is_known || self.wanted.len() + self.sides.len() >= WANTED_MAX {
            return;
        }
        let Some(newest) = self.prefixes.last() else { return };
        if t > newest.sample.t {
            self.wanted.push(t);
        } else {
            self.side_step(t, model);
        }
    }

    fn side_step(&mut self, t: Time, model: &ImuModel) {
        if let Some((before, next)) = self.around(t) {
            let (from, at, inflation) = side_of(before, next, t, model);
            // Made in its place, as above.
            self.sides.push(before.increment);
            self.side_times.push(t);
            if let Some(side) = self.sides.last_mut() {
                side.step(&model.noise, (t - from.t).as_seconds(), &from.point, &at, inflation);
            }
        }
    }

    /// Prefixes right before and right after `t`; `None` at a sample or outside the interval.
    fn around(&self, t: Time) -> Option<(&Prefix, &Prefix)> {
        let after = self.prefixes.partition_point(|prefix| prefix.sample.t <= t);
        let (before, next) = (self.prefixes.get(after.checked_sub(1)?)?, self.prefixes.get(after)?);
        (before.sample.t < t).then_some((before, next))
    }

    /// Keyframe at which it starts.
    pub fn t_start(&self) -> Option<Time> {
        self.prefixes.first().map(|prefix| prefix.sample.t)
    }

    /// Preintegration from the keyframe to `t`, made in `side` if it was not wanted in time; `None` before the keyframe or
    /// beyond the newest sample.
    pub fn up_to<'a>(&'a self, t: Time, model: &ImuModel, side: &'a mut Preintegration) -> Option<&'a Preintegration> {
        if let Some(ready) = self.side_times.iter().position(|&ready| ready == t) {
            return self.sides.get(ready);
        }
        if let Ok(at) = self.prefixes.binary_search_by_key(&t, |prefix| prefix.sample.t) {
            return self.prefixes.get(at).map(|prefix| &prefix.increment);
        }
        let (before, next) = self.around(t)?;
        let (from, at, inflation) = side_of(before, next, t, model);
        side.clone_from(&before.increment);
        side.step(&model.noise, (t - from.t).as_seconds(), &from.point, &at, inflation);
        Some(side)
    }
}

/// Start, end and inflation of the step from a prefix to `t`: it is a share of a step that may itself bridge a gap.
fn side_of(before: &Prefix, next: &Prefix, t: Time, model: &ImuModel) -> (TimedPoint, ImuPoint, f64) {
    let at = interpolate(&before.sample, &next.sample, t);
    (before.sample, at, model.inflation(next.sample.t - before.sample.t))
}
