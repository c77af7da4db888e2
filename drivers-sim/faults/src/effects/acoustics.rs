//! Wrong ranges: ways longer than the straight one, and answers of the wrong beacon.

use shared_types::RawReading;

use crate::draws::Draws;
use crate::effect::{Effect, Fate, Moment, Passing};

/// A share of the ranges, each by itself, too long by `least` to `most` m. A reflected way is never shorter.
#[derive(Debug)]
pub(crate) struct Multipath {
    pub(crate) share: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
}

impl Effect for Multipath {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let (is_hit, excess) = (draws.happens(self.share), draws.between(self.least, self.most));
        if let (RawReading::Lbl(range), true) = (&mut passing.reading, is_hit) {
            range.range += excess;
        }
        Fate::touched_if(is_hit)
    }
}

/// Runs of `pings` ranges of one beacon, one after another, too long: each by its own excess, or all by one (a reflector that
/// stands still), which is the harder, for such ranges agree with each other. `share` of all ranges lie in a run.
#[derive(Debug)]
pub(crate) struct Runs {
    pub(crate) share: f64,
    pub(crate) pings: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
    pub(crate) coherent: bool,
    /// Beacon, ranges left in its run, excess of the run.
    pub(crate) under_way: Vec<(u32, u32, f64)>,
}

impl Runs {
    /// Of two ranges of one reflector, m.
    const SPREAD: f64 = 0.3;

    /// Probability that a range outside a run begins one: between two runs lie 1/p ranges in the mean.
    fn begins(&self) -> f64 {
        if self.share >= 1.0 { 1.0 } else { self.share / (self.pings * (1.0 - self.share) + self.share) }
    }
}

impl Effect for Runs {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let RawReading::Lbl(range) = &mut passing.reading else { return Fate::Untouched };
        let begins = self.begins();
        let (is_begun, own) = (draws.happens(begins), draws.between(self.least, self.most));
        let spread = draws.normal(Runs::SPREAD);
        let index = match self.under_way.iter().position(|(buoy, ..)| *buoy == range.buoy) {
            Some(index) => index,
            None => {
                self.under_way.push((range.buoy, 0, 0.0));
                self.under_way.len() - 1
            }
        };
        let (_, left, of_run) = &mut self.under_way[index];
        if *left == 0 && is_begun {
            (*left, *of_run) = (self.pings.round().max(1.0) as u32, own);
        }
        if *left == 0 {
            return Fate::Untouched;
        }
        *left -= 1;
        range.range += if self.coherent { (*of_run + spread).max(0.0) } else { own };
        Fate::Touched
    }
}

/// A turn-around time that is wrong: ranges of one beacon (0: of all) off by so many m.
#[derive(Debug)]
pub(crate) struct RangeBias {
    pub(crate) bias: f64,
    pub(crate) buoy: u32,
}

impl Effect for RangeBias {
    fn apply(&mut self, _at: &Moment, passing: &mut Passing, _draws: &mut Draws) -> Fate {
        match &mut passing.reading {
            RawReading::Lbl(range) if self.buoy == 0 || range.buoy == self.buoy => {
                range.range += self.bias;
                Fate::Touched
            }
            _ => Fate::Untouched,
        }
    }
}

/// Two beacons are taken for each other.
#[derive(Debug)]
pub(crate) struct Identity {
    pub(crate) one: u32,
    pub(crate) other: u32,
    pub(crate) share: f64,
    /// Both replies of one interrogation are mistaken, or neither.
    pub(crate) last: Option<(shared_types::Time, bool)>,
}

impl Effect for Identity {
    fn apply(&mut self, at: &Moment, passing: &mut Passing, draws: &mut Draws) -> Fate {
        let drawn = draws.happens(self.share);
        let is_hit = match self.last {
            Some((t, is_hit)) if t == at.t => is_hit,
            _ => drawn,
        };
        self.last = Some((at.t, is_hit));
        match &mut passing.reading {
            RawReading::Lbl(range) if is_hit && range.buoy == self.one => range.buoy = self.other,
            RawReading::Lbl(range) if is_hit && range.buoy == self.other => range.buoy = self.one,
            _ => return Fate::Untouched,
        }
        Fate::Touched
    }
}
