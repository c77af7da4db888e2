//! Latencies that the monitor itself reads off the messages, as histograms on a log scale.
//!
//! ```text
//! bin = ⌊10 log10(seconds)⌋ + 10 · 7          100 ns .. 100 s, ten bins a decade
//! ```
//!
//! Both times of a difference are stamped by the same clock of the machine, by driver and sender: how often this process
//! looks does not matter.

use crate::detail::Histogram;

/// The lowest edge is 10^FIRST s.
const FIRST_DECADE: i32 = -7;

const BINS_PER_DECADE: f64 = 10.0;

const BINS: usize = 90;

/// A distribution of times.
#[derive(Clone, Debug)]
pub(super) struct LogHistogram([u64; BINS]);

impl LogHistogram {
    pub(super) fn new() -> LogHistogram {
        LogHistogram([0; BINS])
    }

    /// Counts a time in ns; what is not positive was not measured.
    pub(super) fn record(&mut self, ns: i64) {
        if ns > 0 {
            let place = ((ns as f64 * 1e-9).log10() - f64::from(FIRST_DECADE)) * BINS_PER_DECADE;
            self.0[(place.max(0.0) as usize).min(BINS - 1)] += 1;
        }
    }

    /// For views; `None` when nothing was counted.
    pub(super) fn brief(&self, what: &'static str) -> Option<Histogram> {
        let used = self.0.iter().rposition(|&count| count > 0)? + 1;
        Some(Histogram { what, first_decade: FIRST_DECADE, counts: self.0[..used].to_vec() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ten_bins_make_a_decade_and_the_ends_take_what_lies_beyond() {
        let mut histogram = LogHistogram::new();
        // 105 and 1050 µs are a decade apart, 1 ns and 20 minutes beyond the ends.
        for ns in [105_000, 1_050_000, 1, 1_200_000_000_000, 0, -5] {
            histogram.record(ns);
        }
        let counts = histogram.brief("solve").expect("four were measured").counts;
        let filled: Vec<usize> = (0..BINS).filter(|&bin| counts[bin] > 0).collect();
        assert_eq!(filled, [0, 30, 40, BINS - 1]);
    }

    #[test]
    fn without_a_time_there_is_no_histogram() {
        assert_eq!(LogHistogram::new().brief("solve"), None);
    }
}
