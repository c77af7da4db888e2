//! Readings that arrive twice, late, in the wrong order or in heaps; what they say stays right.

use shared_types::Duration;

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};
use crate::effects::loss::forget_epoch_size;

/// A share of them comes again, `after` s later, bit for bit.
#[derive(Debug)]
pub(crate) struct Duplicate {
    pub(crate) share: f64,
    pub(crate) after: f64,
}

impl Effect for Duplicate {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        forget_epoch_size(passing);
        if draws.happens(self.share) { Fate::Repeated(Duration::from_seconds(self.after)) } else { Fate::Untouched }
    }
}

/// A share of them is overtaken by those of the next `by` s.
#[derive(Debug)]
pub(crate) struct OutOfOrder {
    pub(crate) share: f64,
    pub(crate) by: f64,
}

impl Effect for OutOfOrder {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let is_late = draws.happens(self.share);
        if is_late {
            // A nanosecond more than the period of the sensor puts a reading behind its successor.
            passing.later(self.by + 1e-9);
        }
        Fate::touched_if(is_late)
    }
}

/// All of them are late, by `delay` s and up to `jitter` s more.
#[derive(Debug)]
pub(crate) struct Delay {
    pub(crate) delay: f64,
    pub(crate) jitter: f64,
}

impl Effect for Delay {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        passing.later(self.delay + self.jitter * draws.uniform());

        Fate::Touched
    }
}

/// Silence for `every` s, then all that was read meanwhile at once.
#[derive(Debug)]
pub(crate) struct Batch {
    pub(crate) every: f64,
}

impl Effect for Batch {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        let wait = self.every - at.since.rem_euclid(self.every);
        passing.later(wait);
        Fate::Touched
    }
}
