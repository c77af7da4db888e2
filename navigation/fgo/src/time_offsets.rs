//! Are a sensor's stamps right? The second half of the time-offset detector: what the first half, in the preprocessor, cannot
//! see without an estimate.
//!
//! The columns beside the chain (`columns.rs`) say at every keyframe what a sensor's offset would be, and how surely. A reading
//! that was refused stands in no row of the chain, and may have been refused because of its stamp; it is heard here with its
//! innovation. Then, σ_τ being the sigma of what is found,
//!
//! ```text
//! |τ̂| > 4.5 σ_τ      the stamps are moved: by τ̂ in the window and for the readings to come; once they have been moved,
//!                    4 σ_τ, or 3 σ_τ if that is surer than what was known
//! |τ̂| > 2.5 σ_τ      not sure enough, but possible: covariances cover it, τ̂² + σ_τ²
//! moved before       covariances cover what is still unknown of it
//! ```
//!
//! An error of another kind may look like an offset for a while: a heading that is disturbed while the vehicle turns. So σ_τ is
//! what the columns say times √χ², χ² being what the offset leaves of the sensor's squared innovations per degree of freedom:
//! an offset explains them, the other error does not.
//!
//! Two covariances cover an offset of sigma σ: that of a reading to come, by ḣ²σ², and that of the state, by VVᵀσ² with
//! V = ∂x/∂τ of the readings that have been. A sensor whose stamps are right costs nothing by this: its rows stay what they were.

use shared_types::{AIDING, Duration, TimeOffset};

use crate::columns::{OffsetScore, TERMS, fadings};
use nav_models::innovation::Innovation;

/// Standard deviations at which stamps are moved for the first time. Chance does that to one of five good sensors with two
/// memories once in some hundred hours.
const SURE: f64 = 4.5;
/// The same once they have been moved, when an offset is no surprise any more; and where the new sigma is below the old.
const SURE_AGAIN: f64 = 4.0;
const SURER: f64 = 3.0;
/// Standard deviations at which an offset is possible.
const POSSIBLE: f64 = 2.5;
/// An offset smaller than this, s, is not worth a move: what it does is below a centimetre at usual speeds.
const SMALLEST: f64 = 0.01;
/// Largest offset that is believed, s: a stamp may be late by this, and early by some of a sensor's own filtering.
const LARGEST: f64 = 1.0;
const EARLIEST: f64 = -0.2;
/// An offset that is known no better than this, s, is covered but moves nothing: what little motion there is tells as much of
/// other errors.
const VAGUE: f64 = 0.12;
/// How far an offset may wander after it was found, s/√s, and how far at most, s.
const WANDERING: f64 = 5e-3;
const WANDERING_MOST: f64 = 0.1;

/// One sensor's.
#[derive(Clone, Copy, Debug)]
struct Offset {
    kind: TimeOffset,
    /// Taken off its stamps, s.
    applied: f64,
    /// 1-sigma of that, s; 0 while nothing speaks against the stamps.
    sigma: f64,
    /// The memory that says so.
    term: usize,
    /// Stamps have been moved.
    was_moved: bool,
    /// Of refused readings, fading.
    refused: [OffsetScore; TERMS],
    /// Squared innovations and their degrees of freedom, fading.
    innovations: [(f64, f64); TERMS],
}

/// Those of all aiding sensors.
#[derive(Clone, Debug)]
pub struct TimeOffsets {
    offsets: [Offset; AIDING.len()],
}

/// Stamps of a sensor are to be moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// By so many s.
    pub by: f64,
    /// As this memory has it.
    pub term: usize,
}

impl TimeOffsets {
    /// As configured.
    pub fn new(kinds: [TimeOffset; AIDING.len()]) -> TimeOffsets {
        TimeOffsets {
            offsets: kinds.map(|kind| Offset {
                kind,
                applied: match kind {
                    TimeOffset::Off => 0.0,
                    TimeOffset::Fixed(offset) | TimeOffset::Estimated(offset) => offset,
                },
                sigma: 0.0,
                term: 0,
                was_moved: matches!(kind, TimeOffset::Estimated(offset) if offset != 0.0),
                refused: [OffsetScore::default(); TERMS],
                innovations: [(0.0, 0.0); TERMS],
            }),
        }
    }

    /// Goes on with offsets found before, s, and their sigmas.
    pub fn resume(&mut self, found: &[f64; AIDING.len()], sigmas: &[f64; AIDING.len()]) {
        for ((offset, &found), &sigma) in self.offsets.iter_mut().zip(found).zip(sigmas) {
            let is_sane = (EARLIEST..=LARGEST).contains(&found) && (0.0..=LARGEST).contains(&sigma);
            if offset.is_estimated() && is_sane {
                offset.applied = found;
                offset.sigma = sigma;
                offset.was_moved = found != 0.0;
            }
        }
    }

    /// How much too late a sensor's stamps are taken to be.
    pub fn of(&self, sensor: usize) -> Duration {
        Duration::from_seconds(self.offsets[sensor].applied)
    }

    /// 1-sigma that its covariance has to cover, s; `None` where nobody asks for its offset.
    pub fn sigma(&self, sensor: usize) -> Option<f64> {
        let offset = &self.offsets[sensor];
        offset.is_estimated().then_some(offset.sigma)
    }

    /// What the covariance of the state has to cover: sensor, memory and variance, s².
    pub fn to_cover(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let doubtful =
            self.offsets.iter().enumerate().filter(|(_, offset)| offset.is_estimated() && offset.sigma > 0.0);
        doubtful.map(|(sensor, offset)| (sensor, offset.term, offset.sigma * offset.sigma))
    }

    /// Offsets and their sigmas, s.
    pub fn published(&self) -> ([f64; AIDING.len()], [f64; AIDING.len()]) {
        (self.offsets.map(|offset| offset.applied), self.offsets.map(|offset| offset.sigma))
    }

    /// A reading was judged, with this weight of its kernel.
    pub fn observe(&mut self, sensor: usize, innovation: &Innovation, components: usize, weight: f64) {
        for (squares, freedom) in &mut self.offsets[sensor].innovations {
            *squares += weight * innovation.nis;
            *freedom += components as f64;
        }
    }

    /// A reading was refused by its gate; `weight` is that of its kernel at its innovation.
    pub fn observe_refused(&mut self, sensor: usize, innovation: &Innovation, weight: f64) {
        for refused in &mut self.offsets[sensor].refused {
            for (slope, value) in innovation.slope.iter().zip(&innovation.whitened) {
                refused.information += weight * slope * slope;
                refused.right -= weight * slope * value;
            }
        }
    }

    /// Judges a sensor after a solve `dt` after the last, given what the chain's columns say.
    pub fn judge(&mut self, sensor: usize, scores: [OffsetScore; TERMS], dt: Duration) -> Option<Move> {
        let offset = &mut self.offsets[sensor];
        if !offset.is_estimated() {
            return None;
        }
        for (refused, faded) in offset.refused.iter_mut().zip(fadings(dt)) {
            refused.information *= faded * faded;
            refused.right *= faded;
        }
        for ((squares, freedom), faded) in offset.innovations.iter_mut().zip(fadings(dt)) {
            *squares *= faded * faded;
            *freedom *= faded * faded;
        }
        let wandered = if offset.was_moved { WANDERING * dt.as_seconds().sqrt() } else { 0.0 };
        offset.sigma = if offset.was_moved { offset.sigma.hypot(wandered).min(WANDERING_MOST) } else { 0.0 };
        // The memory that is surest of an offset.
        let (term, found, sigma) = (0..TERMS)
            .filter_map(|term| {
                let (found, sigma) = scores[term].plus(&offset.refused[term]).found()?;
                let (squares, freedom) = offset.innovations[term];
                let left = (squares - (found / sigma).powi(2)) / freedom.max(1.0);
                Some((term, found, sigma * left.max(1.0).sqrt()))
            })
            .max_by(|a, b| (a.1.abs() / a.2).total_cmp(&(b.1.abs() / b.2)))?;
        let deviation = found.abs() / sigma;
        let sure = match offset.was_moved {
            false => SURE,
            true if sigma < offset.sigma => SURER,
            true => SURE_AGAIN,
        };
        if deviation > POSSIBLE {
            offset.term = term;
            offset.sigma = offset.sigma.max(found.hypot(sigma).min(LARGEST));
        } else if offset.was_moved {
            offset.term = term;
            offset.sigma = offset.sigma.min(sigma);
        }
        let moved = offset.applied + found;
        let is_believable = sigma < VAGUE && (EARLIEST..=LARGEST).contains(&moved);
        if deviation < sure || found.abs() < SMALLEST || !is_believable {
            return None;
        }
        offset.applied = moved;
        offset.sigma = sigma;
        offset.was_moved = true;
        for refused in &mut offset.refused {
            refused.right -= refused.information * found;
        }
        Some(Move { by: found, term })
    }
}

impl Offset {
    fn is_estimated(&self) -> bool {
        matches!(self.kind, TimeOffset::Estimated(_))
    }
}

impl OffsetScore {
    fn plus(&self, other: &OffsetScore) -> OffsetScore {
        OffsetScore { information: self.information + other.information, right: self.right + other.right }
    }

    /// Offset and sigma, s; `None` where next to nothing is known.
    fn found(&self) -> Option<(f64, f64)> {
        // Rounding may leave less than nothing of no information; the comparison also refuses what is no number.
        let is_known = self.information > 1.0 / (LARGEST * LARGEST) && self.right.is_finite();
        is_known.then(|| (self.right / self.information, self.information.sqrt().recip()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nav_models::innovation::Innovation;

    const SECOND: Duration = Duration(1_000_000_000);
    const DVL: usize = 2;

    fn offsets(kind: TimeOffset) -> TimeOffsets {
        TimeOffsets::new([kind; AIDING.len()])
    }

    /// A score that says `found` with `sigma`, by the long memory alone.
    fn score(found: f64, sigma: f64) -> [OffsetScore; TERMS] {
        let information = 1.0 / (sigma * sigma);
        [OffsetScore::default(), OffsetScore { information, right: found * information }]
    }

    #[test]
    fn a_sure_offset_moves_the_stamps_and_is_published_with_its_sigma() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        assert_eq!(offsets.judge(DVL, score(0.2, 0.04), SECOND), Some(Move { by: 0.2, term: 1 }));
        assert_eq!(offsets.of(DVL), Duration::from_seconds(0.2));
        let (found, sigma) = offsets.published();
        assert!((found[DVL] - 0.2).abs() < 1e-15 && (sigma[DVL] - 0.04).abs() < 1e-15);
        assert_eq!(found[0], 0.0);
        // Another third of a sigma is no news; four sigmas are, though they would not have been before.
        assert_eq!(offsets.judge(DVL, score(0.01, 0.04), SECOND), None);
        assert!(offsets.judge(DVL, score(-0.16, 0.04), SECOND).is_some());
        assert!((offsets.published().0[DVL] - 0.04).abs() < 1e-12);
    }

    #[test]
    fn a_possible_offset_is_covered_and_nothing_is_moved() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        assert_eq!(offsets.judge(DVL, score(0.12, 0.04), SECOND), None);
        assert!((offsets.sigma(DVL).expect("asked for") - 0.12_f64.hypot(0.04)).abs() < 1e-15);
        assert_eq!(offsets.to_cover().count(), 1);
        assert_eq!(offsets.judge(DVL, score(0.04, 0.04), SECOND), None);
        assert_eq!(offsets.sigma(DVL), Some(0.0), "it was chance");
        assert_eq!(offsets.to_cover().count(), 0);
    }

    #[test]
    fn what_is_unknown_of_a_moved_stamp_grows_and_does_not_grow_for_ever() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        offsets.judge(DVL, score(0.2, 0.01), SECOND);
        for _ in 0..10_000 {
            assert_eq!(offsets.judge(DVL, [OffsetScore::default(); TERMS], SECOND), None);
        }
        assert_eq!(offsets.sigma(DVL), Some(WANDERING_MOST));
    }

    #[test]
    fn refused_readings_that_agree_on_an_offset_move_the_stamps() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        let refused = Innovation { whitened: [-8.0, 0.0, 0.0], nis: 64.0, state_share: 0.0, slope: [20.0, 0.0, 0.0] };
        let mut moved = None;
        for _ in 0..20 {
            offsets.observe_refused(DVL, &refused, 0.1);
            moved = moved.or(offsets.judge(DVL, [OffsetScore::default(); TERMS], SECOND));
        }
        let by = moved.expect("twenty agree").by;
        // An offset that has been there for a while is taken for one that has grown: a little too much.
        assert!((0.39..0.44).contains(&by), "{by}");
    }

    #[test]
    fn an_offset_that_nobody_asks_for_stays_what_it_is() {
        let mut fixed = offsets(TimeOffset::Fixed(0.1));
        assert_eq!(fixed.judge(DVL, score(0.3, 0.01), SECOND), None);
        assert_eq!((fixed.of(DVL), fixed.sigma(DVL)), (Duration::from_seconds(0.1), None));
        let mut off = offsets(TimeOffset::Off);
        assert_eq!(off.judge(DVL, score(0.3, 0.01), SECOND), None);
        assert_eq!((off.of(DVL), off.sigma(DVL)), (Duration::ZERO, None));
    }

    #[test]
    fn no_number_is_no_news() {
        let mut offsets = offsets(TimeOffset::Estimated(0.0));
        for information in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            let score = [OffsetScore { information, right: f64::NAN }; TERMS];
            assert_eq!(offsets.judge(DVL, score, SECOND), None);
        }
        assert_eq!(offsets.sigma(DVL), Some(0.0));
    }

    #[test]
    fn an_offset_found_before_is_taken_up_and_nonsense_is_not() {
        let mut taken_up = offsets(TimeOffset::Estimated(0.0));
        taken_up.resume(&[0.0, 0.0, 0.2, 0.0, f64::NAN], &[0.0, 0.0, 0.01, 0.0, 0.0]);
        assert_eq!(taken_up.published().0, [0.0, 0.0, 0.2, 0.0, 0.0]);
    }
}
