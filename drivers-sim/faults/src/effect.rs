//! What a fault does to one reading.

use shared_types::{Duration, RawReading, Time};

use crate::draws::Draws;

/// A reading on its way, and how much later than usual it will arrive.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passing {
    pub(crate) reading: RawReading,
    pub(crate) delay: Duration,
}

impl Passing {
    /// Arrives so many s later than it would.
    pub(crate) fn later(&mut self, seconds: f64) {
        self.delay = Duration(self.delay.0.saturating_add(Duration::from_seconds(seconds).0));
    }
}

/// When a reading passes, by the data time that it had before any fault touched its stamp.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    pub(crate) t: Time,
    /// Since the fault began, s; where its span has no beginning, since the sensor's first reading.
    pub(crate) since: f64,
}

/// What became of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fate {
    /// As it was.
    Untouched,
    /// Changed, or on its way for longer.
    Touched,
    /// It does not arrive.
    Lost,
    /// It arrives again, so much later.
    Repeated(Duration),
}

impl Fate {
    pub(crate) fn touched_if(condition: bool) -> Fate {
        if condition { Fate::Touched } else { Fate::Untouched }
    }
}

/// A fault at work. It is asked for the readings of its sensor only.
pub(crate) trait Effect: std::fmt::Debug + Send {
    /// A reading within the span of the fault.
    fn apply(&mut self, at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate;

    /// A reading outside it, for a fault that must know what came before.
    fn outside(&mut self, _reading: &RawReading) {}
}
