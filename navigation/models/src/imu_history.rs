//! Raw IMU samples in order of time, and what lies between two instants.

use std::collections::VecDeque;

use nalgebra::Vector3;
use shared_types::{Duration, ImuGateConfig, ImuNoise, Time};

use crate::gaps::Inflation;
use crate::preintegration::{ImuPoint, Preintegration};

/// What integrating a step needs to know of the instrument.
#[derive(Clone, Debug)]
pub struct ImuModel {
    /// Noise densities and bias random walks.
    pub noise: ImuNoise,
    /// What counts as a gap.
    pub gate: ImuGateConfig,
}

impl ImuModel {
    /// Factors on the white noise densities in a step of this length between two samples.
    pub fn inflation(&self, step: Duration) -> Inflation {
        Inflation::over(step, &self.gate, &self.noise)
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
    /// The oldest is none that was taken: the second, held back.
    is_held_back: bool,
}

impl ImuHistory {
    /// With room for `capacity` samples before it grows.
    pub fn with_capacity(capacity: usize) -> ImuHistory {
        ImuHistory { samples: VecDeque::with_capacity(capacity), is_held_back: false }
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
        let after = self.first_from(Time(t.0.saturating_add(1)));
        let forgotten = after.saturating_sub(1);
        if forgotten > 0 {
            self.samples.drain(..forgotten);
            self.is_held_back = false;
        }
    }

    /// Place of the first sample that is not before `t`. An instrument samples evenly: mostly it is where the time says, and a
    /// search through all samples would fetch a dozen of them from far memory.
    fn first_from(&self, t: Time) -> usize {
        let is_before = |sample: &TimedPoint| sample.t < t;
        if let (Some(oldest), Some(newest)) = (self.samples.front(), self.samples.back())
            && (oldest.t..=newest.t).contains(&t)
            && oldest.t < newest.t
        {
            let share = (t - oldest.t).0 as f64 / (newest.t - oldest.t).0 as f64;
            let guess = (share * (self.samples.len() - 1) as f64) as usize;
            for place in guess.saturating_sub(1)..(guess + 3).min(self.samples.len()) {
                let is_after = place == 0 || is_before(&self.samples[place - 1]);
                if is_after && !is_before(&self.samples[place]) {
                    return place;
                }
            }
        }
        self.samples.partition_point(is_before)
    }

    /// The sample at `t`, interpolated linearly; `None` outside the history.
    pub fn at(&self, t: Time) -> Option<ImuPoint> {
        let after = self.first_from(t);
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
        let after = self.first_from(t).max(1);
        match (self.samples.get(after - 1), self.samples.get(after)) {
            (Some(first), Some(second)) => second.t - first.t,
            _ => USUAL,
        }
    }

    /// Factors on the white noise densities in the step between two samples that ends at `t` or has `t` in it.
    pub fn inflation_at(&self, t: Time, model: &ImuModel) -> Inflation {
        let step = self.sampling_period_at(t);
        if self.is_held_back && self.first_from(t) <= 1 {
            return Inflation::held(step, &model.gate, &model.noise);
        }
        model.inflation(step)
    }

    /// Holds the oldest sample back to an earlier instant `t`: what a restarted estimator knows of the time before.
    pub fn hold_back_to(&mut self, t: Time) {
        if let Some(&oldest) = self.samples.front()
            && t < oldest.t
        {
            self.samples.push_front(TimedPoint { t, point: oldest.point });
            self.is_held_back = true;
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
        // The first step and the last may be parts of one between two samples, which may be a gap.
        let inflation = |one: Time, other: Time| self.inflation_at(one.max(other), model);
        let mut step = |next: &TimedPoint, inflation: Inflation| {
            let dt = next.t - last.t;
            if dt != Duration::ZERO {
                piece.step(&model.noise, dt.as_seconds(), &last.point, &next.point, inflation);
            }
            last = *next;
        };
        let mut t_last = from;
        let mut whole = |next: &TimedPoint| {
            let is_first = t_last == from;
            let of_step = if is_first { inflation(from, next.t) } else { model.inflation(next.t - t_last) };
            step(next, of_step);
            t_last = next.t;
        };
        if from <= to {
            self.between(from, to).for_each(&mut whole);
        } else {
            self.between(to, from).rev().for_each(&mut whole);
        }
        step(&end, inflation(t_last, to));
        Some(piece)
    }

    /// Preintegrates once from `from` on and gives each of `ends`, which are in order and not before `from`, the prefix up
    /// to it. `None` where the history ends before the last of them.
    pub fn prefixes<T>(
        &self,
        from: Time,
        ends: impl Iterator<Item = (Time, T)>,
        (accel_bias, gyro_bias): (&Vector3<f64>, &Vector3<f64>),
        model: &ImuModel,
        mut give: impl FnMut(T, &Preintegration),
    ) -> Option<()> {
        let mut run = Preintegration::new(*accel_bias, *gyro_bias);
        let mut last = TimedPoint { t: from, point: self.at(from)? };
        let mut samples = self.between(from, Time::MAX).peekable();
        for (t, end) in ends {
            while let Some(next) = samples.next_if(|sample| sample.t <= t) {
                let dt = (next.t - last.t).as_seconds();
                run.step(&model.noise, dt, &last.point, &next.point, self.inflation_at(next.t, model));
                last = *next;
            }
            if t == last.t {
                give(end, &run);
                continue;
            }
            // The main run goes on unsplit.
            let next = samples.peek()?;
            let at = interpolate(&last, next, t);
            let mut side = run;
            let inflation = self.inflation_at(next.t, model);
            side.step(&model.noise, (t - last.t).as_seconds(), &last.point, &at, inflation);
            give(end, &side);
        }
        Some(())
    }
}

/// The sample at `t` on the straight line between two.
pub fn interpolate(first: &TimedPoint, second: &TimedPoint, t: Time) -> ImuPoint {
    let share = (t - first.t).as_seconds() / (second.t - first.t).as_seconds();
    ImuPoint::interpolate(&first.point, &second.point, share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::noise;
    use shared_types::Config;

    #[test]
    fn a_piece_of_a_gap_is_as_uncertain_as_the_gap() {
        let model = ImuModel { noise: noise(), gate: Config::default().navigator.imu };
        let mut history = ImuHistory::with_capacity(16);
        for t in [0.0, 0.005, 1.005, 1.01] {
            history.push(Time::from_seconds(t), ImuPoint::default());
        }
        let variance = |from: f64, to: f64| {
            let (from, to) = (Time::from_seconds(from), Time::from_seconds(to));
            let zero = Vector3::zeros();
            let piece = history.integrate(from, to, &zero, &zero, &model).expect("inside");
            piece.covariance()[(6, 6)] / (to - from).abs().as_seconds()
        };
        let whole = variance(0.005, 1.005);
        assert!(whole > 1e3 * variance(0.0, 0.005));
        for (from, to) in [(0.1, 0.11), (0.11, 0.1), (0.005, 0.4), (0.4, 0.005), (0.9, 1.005), (1.005, 0.9)] {
            let piece = variance(from, to);
            assert!((piece / whole - 1.0).abs() < 1e-9, "{from} to {to}: {piece:e} {whole:e}");
        }
    }

    #[test]
    fn what_is_held_back_to_before_the_first_sample_is_less_certain_than_what_lies_between_two() {
        let model = ImuModel { noise: noise(), gate: Config::default().navigator.imu };
        let whole = |history: &ImuHistory| {
            let (from, to, zero) = (Time::from_seconds(0.0), Time::from_seconds(0.61), Vector3::zeros());
            let mut prefix = None;
            let ends = [(to, ())].into_iter();
            history.prefixes(from, ends, (&zero, &zero), &model, |(), run| prefix = Some(*run)).expect("inside");
            let piece = history.integrate(from, to, &zero, &zero, &model).expect("inside");
            assert_eq!(prefix, Some(piece));
            piece.covariance()[(6, 6)]
        };
        let mut between = ImuHistory::with_capacity(4);
        for t in [0.0, 0.6, 0.605, 0.61] {
            between.push(Time::from_seconds(t), ImuPoint::default());
        }
        let mut held = ImuHistory::with_capacity(4);
        for t in [0.6, 0.605, 0.61] {
            held.push(Time::from_seconds(t), ImuPoint::default());
        }
        held.hold_back_to(Time(0));
        // ωT/2 in place of (ωT)²/12.
        assert!((whole(&held).sqrt() / whole(&between).sqrt() - 5.0).abs() < 0.01);
        held.forget_before(Time::from_seconds(0.6));
        assert_eq!(held.inflation_at(Time::from_seconds(0.605), &model), Inflation::NONE);
    }

    #[test]
    fn a_sample_is_found_where_a_search_through_all_finds_it() {
        let mut history = ImuHistory::with_capacity(600);
        // Even, a gap, jitter, another rate.
        let mut t = 7.0_f64;
        for k in 0..600 {
            history.push(Time::from_seconds(t), ImuPoint::default());
            t += match k {
                0..200 => 0.005,
                200 => 0.9,
                201..400 => 0.005 + 0.004 * (f64::from(k) * 1.7).sin(),
                _ => 0.01,
            };
        }
        for step in -20..1200 {
            for offset in [-1, 0, 1] {
                let at = Time(Time::from_seconds(7.0 + 0.005 * f64::from(step)).0 + offset);
                assert_eq!(history.first_from(at), history.samples.partition_point(|sample| sample.t < at));
            }
        }
    }
}
