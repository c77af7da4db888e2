//! Readings that never arrive.

use shared_types::RawReading;

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};

/// All of them.
#[derive(Debug)]
pub(crate) struct Blackout;

impl Effect for Blackout {
    fn apply(&mut self, _at: &Moment, _passing: &mut Passing, _draws: &mut Draws) -> Fate {
        Fate::Lost
    }
}

/// A share of them, each by itself.
#[derive(Debug)]
pub(crate) struct Dropout {
    pub(crate) share: f64,
}

impl Effect for Dropout {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        if draws.happens(self.share) {
            return Fate::Lost;
        }
        forget_epoch_size(passing);
        Fate::Untouched
    }
}

/// A silence of `length` s every `every` s, the first of them when the fault begins.
#[derive(Debug)]
pub(crate) struct Gaps {
    pub(crate) length: f64,
    pub(crate) every: f64,
}

impl Effect for Gaps {
    fn apply(&mut self, at: &Moment, _passing: &mut Passing, _draws: &mut Draws) -> Fate {
        if at.since.rem_euclid(self.every) < self.length { Fate::Lost } else { Fate::Untouched }
    }
}

/// One beacon does not answer.
#[derive(Debug)]
pub(crate) struct Silent {
    pub(crate) buoy: u32,
}

impl Effect for Silent {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        match &passing.reading {
            RawReading::Lbl(range) if range.buoy == self.buoy => Fate::Lost,
            _ => {
                forget_epoch_size(passing);
                Fate::Untouched
            }
        }
    }
}

/// An epoch that may have lost a range, or got one twice, no longer knows its size.
pub(crate) fn forget_epoch_size(passing: &mut Passing) {
    if let RawReading::Lbl(range) = &mut passing.reading {
        range.in_epoch = 0;
    }
}
