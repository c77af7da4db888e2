//! The preintegration of the interval that is still open.
//!
//! One run per interval (§2.3 of the method): the recursion advances at sample arrival and its state after every sample is
//! kept, so that the piece up to any instant costs one side step, and the closing of the interval costs nothing more.

use nalgebra::Vector3;
use nav_models::gaps::Inflation;
use nav_models::imu_history::interpolate;
pub use nav_models::imu_history::{ImuHistory, ImuModel, TimedPoint};
use nav_models::preintegration::{ImuPoint, Preintegration};
use shared_types::Time;

/// Times between samples that are prepared in advance; an interval holds some tens of readings.
const WANTED_MAX: usize = 256;

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
    /// Of the step that led to it.
    inflation: Inflation,
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
            inflation: Inflation::NONE,
        });
        for sample in history.between(t_keyframe, Time::MAX) {
            // The keyframe may lie in a gap, which is longer than what is left of it.
            self.step(sample, model, history.inflation_at(sample.t, model));
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
        let Some(last) = self.prefixes.last() else { return };
        self.step(sample, model, model.inflation(sample.t - last.sample.t));
    }

    fn step(&mut self, sample: &TimedPoint, model: &ImuModel, inflation: Inflation) {
        let Some(newest) = self.prefixes.len().checked_sub(1) else { return };
        // The copy of the newest prefix is made in its place: it is a kilobyte and a half, 200 times a second.
        self.prefixes.extend_from_within(newest..);
        if let [.., last, next] = self.prefixes.as_mut_slice() {
            let dt = sample.t - last.sample.t;
            next.sample = *sample;
            next.inflation = inflation;
            next.increment.step(&model.noise, dt.as_seconds(), &last.sample.point, &sample.point, inflation);
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
            let (from, at, inflation) = side_of(before, next, t);
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
        let (from, at, inflation) = side_of(before, next, t);
        side.clone_from(&before.increment);
        side.step(&model.noise, (t - from.t).as_seconds(), &from.point, &at, inflation);
        Some(side)
    }
}

/// Start, end and inflation of the step from a prefix to `t`: it is a share of a step that may itself bridge a gap.
fn side_of(before: &Prefix, next: &Prefix, t: Time) -> (TimedPoint, ImuPoint, Inflation) {
    (before.sample, interpolate(&before.sample, &next.sample, t), next.inflation)
}
