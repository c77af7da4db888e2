//! Mean and spread over seeds, and when two of them are a tie.

/// Of one figure over seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation of one seed; 0 of a single one.
    pub sd: f64,
}

/// How one method's figure stands to another's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Lower by more than the spread.
    Lower,
    /// Within the spread.
    Tie,
    /// Higher by more than the spread.
    Higher,
}

impl Spread {
    /// Of values, one per seed.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Spread {
        let values: Vec<f64> = values.into_iter().collect();
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        Spread { mean, sd: if values.len() > 1 { (squares / (count - 1.0)).sqrt() } else { 0.0 } }
    }

    /// `0.143 ± 0.012`.
    pub fn text(&self) -> String {
        let decimals = decimals(self.mean);
        format!("{:.decimals$} ± {:.decimals$}", self.mean, self.sd)
    }

    /// Against `other` of the same seeds: a tie is a difference of the means within the larger spread of one seed, or within what the
    /// table shows.
    pub fn against(&self, other: &Spread) -> Standing {
        let difference = self.mean - other.mean;
        let shown = 0.5 * 10_f64.powi(-(decimals(self.mean.min(other.mean)) as i32));
        if difference.abs() <= self.sd.max(other.sd).max(shown) {
            Standing::Tie
        } else if difference < 0.0 {
            Standing::Lower
        } else {
            Standing::Higher
        }
    }
}

/// Three digits that count, for metres at least millimetres.
fn decimals(value: f64) -> usize {
    match value.abs() {
        value if value >= 100.0 => 0,
        value if value >= 10.0 => 1,
        value if value >= 1.0 => 2,
        value if value >= 0.02 => 3,
        _ => 4,
    }
}

/// A figure with three digits that count.
pub fn number(value: f64) -> String {
    let decimals = decimals(value);
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spread_is_that_of_one_seed() {
        let spread = Spread::of([1.0, 2.0, 3.0]);
        assert_eq!((spread.mean, spread.sd), (2.0, 1.0));
        assert_eq!(Spread::of([0.123_44]).text(), "0.123 ± 0.000");
    }

    #[test]
    fn a_difference_within_the_spread_is_a_tie_and_beyond_it_is_not() {
        let of = |mean: f64, sd: f64| Spread { mean, sd };
        assert_eq!(of(0.50, 0.1).against(&of(0.55, 0.02)), Standing::Tie);
        assert_eq!(of(0.50, 0.01).against(&of(0.55, 0.02)), Standing::Lower);
        assert_eq!(of(0.60, 0.01).against(&of(0.55, 0.02)), Standing::Higher);
        assert_eq!(of(0.0050, 0.0).against(&of(0.005_02, 0.0)), Standing::Tie, "the same as shown");
    }
}
