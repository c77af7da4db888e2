//! Has an instrument frozen?
//!
//! A frozen instrument repeats the same numbers, all of them to the bit, under running stamps (F5, F15, F16). So do honest
//! ones: a slow instrument behind a fast driver repeats each sample, and a coarse one rests on its last digit. What is honest
//! shows in the beginning, and at the end of a repetition: an instrument that was at rest goes on within a few of its finest
//! steps of where it stood, one that was frozen somewhere else.

/// How many times longer than any honest repetition one must be to be a fault.
const FROZEN_FACTOR: u32 = 4;
/// A rest ends within so many of the finest steps.
const REST_STEPS: f64 = 3.0;

/// How often the same numbers have come in a row.
#[derive(Clone, Debug)]
pub(crate) struct Repetition<const N: usize> {
    /// So many in a row are a fault at the least.
    least: u32,
    /// Readings of the beginning, from which nothing is refused.
    beginning: u32,
    numbers: [f64; N],
    /// Smallest change that each number has shown.
    finest: [f64; N],
    in_a_row: u32,
    longest: u32,
    seen: u32,
}

impl<const N: usize> Repetition<N> {
    /// An instrument of which nothing is known.
    pub(crate) fn new(least: u32, beginning: u32) -> Repetition<N> {
        Repetition {
            least,
            beginning,
            numbers: [f64::NAN; N],
            finest: [f64::INFINITY; N],
            in_a_row: 0,
            longest: 0,
            seen: 0,
        }
    }

    /// Takes the next reading in: whether the instrument has frozen.
    pub(crate) fn is_frozen(&mut self, numbers: &[f64; N]) -> bool {
        if *numbers == self.numbers {
            self.in_a_row = self.in_a_row.saturating_add(1);
        } else {
            self.end_of_run(numbers);
            self.numbers = *numbers;
            self.in_a_row = 1;
        }
        if self.seen < self.beginning {
            self.seen += 1;
            self.longest = self.longest.max(self.in_a_row);
            return false;
        }
        self.in_a_row >= self.least.max(FROZEN_FACTOR.saturating_mul(self.longest))
    }

    /// The smallest change that its coarsest number has shown, in that number's unit; infinite before any.
    pub(crate) fn finest_step(&self) -> f64 {
        self.finest.iter().copied().fold(0.0, f64::max)
    }

    fn end_of_run(&mut self, numbers: &[f64; N]) {
        let change: [f64; N] = core::array::from_fn(|at| (numbers[at] - self.numbers[at]).abs());
        let is_rest = change.iter().zip(&self.finest).all(|(change, finest)| *change <= REST_STEPS * finest);
        if self.in_a_row >= self.least && is_rest {
            self.longest = self.longest.max(self.in_a_row);
        }
        for (finest, change) in self.finest.iter_mut().zip(change) {
            if change > 0.0 {
                *finest = finest.min(change);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Varies by 1e-4 as noise does, for the beginning.
    fn begun() -> Repetition<2> {
        let mut repetition = Repetition::new(8, 100);
        for step in 0..200 {
            assert!(!repetition.is_frozen(&[1.0, 1e-4 * f64::from(step * 7919 % 101)]), "{step}");
        }
        repetition
    }

    #[test]
    fn the_eighth_of_the_same_is_a_fault_until_it_varies() {
        let mut repetition = begun();
        let frozen: Vec<bool> = (0..20).map(|_| repetition.is_frozen(&[2.0, 3.0])).collect();
        assert_eq!(frozen.iter().position(|&frozen| frozen), Some(7));
        assert!(frozen[7..].iter().all(|&frozen| frozen));
        assert!(!repetition.is_frozen(&[2.0, 3.1]));
        assert!((0..7).all(|_| !repetition.is_frozen(&[2.0, 3.0])), "it was no rest: nothing was learned");
        assert!(repetition.is_frozen(&[2.0, 3.0]));
    }

    #[test]
    fn a_rest_that_ends_a_digit_further_is_known_from_then_on() {
        let mut repetition = begun();
        assert_eq!((0..30).filter(|_| repetition.is_frozen(&[1.0, 0.0])).count(), 23);
        assert!(!repetition.is_frozen(&[1.0, 1e-4]));
        assert!((0..119).all(|_| !repetition.is_frozen(&[1.0, 0.0])), "four times as long as it rested before");
        assert!(repetition.is_frozen(&[1.0, 0.0]));
    }

    #[test]
    fn the_finest_step_is_that_of_the_coarsest_number() {
        let mut repetition = Repetition::new(8, 100);
        assert_eq!(repetition.finest_step(), f64::INFINITY);
        for numbers in [[0.0, 0.0], [0.25, 0.01], [0.5, 0.03]] {
            repetition.is_frozen(&numbers);
        }
        assert_eq!(repetition.finest_step(), 0.25);
    }
}
