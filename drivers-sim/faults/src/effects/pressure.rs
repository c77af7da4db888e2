//! Slow faults of one number: swell over a pressure port, a clogged port, iron beside a compass.

use std::f64::consts::{PI, TAU};

use shared_types::{RawReading, Time};

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};
use crate::effects::content::{each_number, wrap_heading};

/// A wave of the sea: amplitude · sin(2π t / period).
#[derive(Debug)]
pub(crate) struct Swell {
    pub(crate) amplitude: f64,
    pub(crate) period: f64,
}

impl Effect for Swell {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let wave = self.amplitude * (TAU * at.since / self.period).sin();
        each_number(&mut passing.reading, |_, number| *number += wave);
        Fate::Touched
    }
}

/// A clogged port: the pressure creeps after the truth with a time constant, s.
#[derive(Debug)]
pub(crate) struct Lag {
    pub(crate) time_constant: f64,
    pub(crate) state: Option<(Time, f64)>,
}

impl Effect for Lag {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let RawReading::Ps(depth) = &mut passing.reading else { return Fate::Untouched };
        let (t_before, before) = self.state.unwrap_or((at.t, depth.depth));
        let share = 1.0 - (-(at.t - t_before).as_seconds() / self.time_constant).exp();
        depth.depth = before + share * (depth.depth - before);
        self.state = Some((at.t, depth.depth));
        Fate::Touched
    }

    fn outside(&mut self, reading: &RawReading) {
        if let RawReading::Ps(depth) = reading {
            self.state = Some((reading.t_valid(), depth.depth));
        }
    }
}

/// A ship or a pipeline passes: size · sin²(π t / period), deg, one swelling after another.
#[derive(Debug)]
pub(crate) struct Disturbance {
    pub(crate) size_deg: f64,
    pub(crate) period: f64,
}

impl Effect for Disturbance {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let error = self.size_deg * (PI * at.since / self.period).sin().powi(2);
        each_number(&mut passing.reading, |_, number| *number += error);
        wrap_heading(&mut passing.reading);
        Fate::Touched
    }
}
