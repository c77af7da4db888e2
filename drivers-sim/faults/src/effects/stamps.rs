//! Stamps that are wrong: the reading is of one instant and says another. It arrives when it always would.
//!
//! `stamp = true time + offset`: a positive offset is a stamp that is late. An offset that appears, vanishes or steps once is
//! a fault with a span, or two of them.

use std::f64::consts::TAU;

use shared_types::{Duration, Time};

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};
use crate::effects::content::header_mut;

/// How the offset goes with the time since the fault began.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Offset {
    /// The same for ever, s.
    Constant(f64),
    /// mean + amplitude · sin(2π t / period).
    Wander { mean: f64, amplitude: f64, period: f64 },
    /// A clock that runs too fast by `rate`, s/s.
    Ramp { rate: f64 },
    /// Two values by turns.
    Steps { first: f64, second: f64, every: f64 },
}

impl Offset {
    fn at(self, since: f64) -> f64 {
        match self {
            Offset::Constant(offset) => offset,
            Offset::Wander { mean, amplitude, period } => mean + amplitude * (TAU * since / period).sin(),
            Offset::Ramp { rate } => rate * since,
            Offset::Steps { first, second, every } => {
                if since.rem_euclid(2.0 * every) < every {
                    first
                } else {
                    second
                }
            }
        }
    }
}

/// A clock that is off.
#[derive(Debug)]
pub(crate) struct Stamp(pub(crate) Offset);

impl Effect for Stamp {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let offset = Duration::from_seconds(self.0.at(at.since));
        let header = header_mut(&mut passing.reading);
        header.t_valid = (Time(header.t_valid) + offset).0;
        Fate::Touched
    }
}

/// Stamps of the operating system's mood: normal with `sigma`. Readings of one instant (an LBL epoch) share their error.
#[derive(Debug)]
pub(crate) struct Jitter {
    pub(crate) sigma: f64,
    pub(crate) last: Option<(Time, Duration)>,
}

impl Effect for Jitter {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let error = match self.last {
            Some((t, error)) if t == at.t => error,
            _ => Duration::from_seconds(draws.normal(self.sigma)),
        };
        self.last = Some((at.t, error));
        let header = header_mut(&mut passing.reading);
        header.t_valid = (Time(header.t_valid) + error).0;
        Fate::Touched
    }
}

/// A counter that begins again every `period` s, as 32 bits of microseconds do.
#[derive(Debug)]
pub(crate) struct Wrap {
    pub(crate) period: f64,
}

impl Effect for Wrap {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let header = header_mut(&mut passing.reading);
        let wrapped = header.t_valid.rem_euclid(Duration::from_seconds(self.period).0.max(1));
        let is_wrapped = wrapped != header.t_valid;
        header.t_valid = wrapped;
        Fate::touched_if(is_wrapped)
    }
}

/// The instrument has restarted: its clock counts from zero.
#[derive(Debug)]
pub(crate) struct Reset;

impl Effect for Reset {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        header_mut(&mut passing.reading).t_valid = Duration::from_seconds(at.since).0;
        Fate::Touched
    }
}
