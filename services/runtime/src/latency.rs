//! How long something took, over and over: an HDR histogram, and the percentiles that are told of it.

use hdrhistogram::Histogram;
use shared_types::HopLatency;

/// Longest latency told apart from longer ones, ns.
const LONGEST: u64 = 60_000_000_000;

/// Told percentiles, besides the largest value.
const QUANTILES: [f64; 5] = [0.5, 0.9, 0.99, 0.999, 0.9999];

/// A latency distribution, unfiltered. Recording allocates nothing and costs some 15 ns.
#[derive(Clone, Debug)]
pub struct Latency(Histogram<u64>);

impl Latency {
    /// Nothing recorded yet; 1 ns to a minute, two significant digits.
    pub fn new() -> Latency {
        Latency::with_digits(2)
    }

    /// As [`Latency::new`] with three significant digits, for whoever can spare 200 kB.
    pub fn precise() -> Latency {
        Latency::with_digits(3)
    }

    fn with_digits(digits: u8) -> Latency {
        Latency(
            Histogram::new_with_bounds(1, LONGEST, digits).expect("1 < LONGEST / 2, and 2 and 3 digits are in bounds"),
        )
    }

    /// Records a time in ns; a negative one counts as none.
    pub fn record(&mut self, ns: i64) {
        self.0.saturating_record(ns.max(0) as u64);
    }

    /// In brief. One pass over the histogram, for it is asked for between two samples; nothing is allocated.
    pub fn brief(&self) -> HopLatency {
        let count = self.0.len();
        let mut at = [0; QUANTILES.len()];
        let ranks = QUANTILES.map(|quantile| ((quantile * count as f64).ceil() as u64).max(1));
        let (mut seen, mut next) = (0, 0);
        for step in self.0.iter_recorded() {
            seen += step.count_at_value();
            while next < ranks.len() && ranks[next] <= seen {
                at[next] = step.value_iterated_to();
                next += 1;
            }
            if next == ranks.len() {
                break;
            }
        }
        let [p50_ns, p90_ns, p99_ns, p99_9_ns, p99_99_ns] = at;
        HopLatency { count, p50_ns, p90_ns, p99_ns, p99_9_ns, p99_99_ns, max_ns: self.0.max() }
    }
}

impl Default for Latency {
    fn default() -> Latency {
        Latency::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_what_was_recorded() {
        let mut latency = Latency::precise();
        assert_eq!(latency.brief(), HopLatency::default());
        (1..=100_000).for_each(|us| latency.record(us * 1_000));
        let brief = latency.brief();
        let near = |found: u64, us: f64| (found as f64 / (us * 1e3) - 1.0).abs() < 2e-3;
        assert_eq!(brief.count, 100_000);
        assert!(near(brief.p50_ns, 50_000.0) && near(brief.p90_ns, 90_000.0), "{brief:?}");
        assert!(near(brief.p99_ns, 99_000.0) && near(brief.p99_9_ns, 99_900.0), "{brief:?}");
        assert!(near(brief.p99_99_ns, 99_990.0) && near(brief.max_ns, 100_000.0), "{brief:?}");
    }

    #[test]
    fn a_single_value_is_every_percentile_of_itself() {
        let mut latency = Latency::new();
        latency.record(100);
        let brief = latency.brief();
        assert_eq!([brief.p50_ns, brief.p99_99_ns, brief.max_ns], [100; 3]);
    }

    #[test]
    fn a_latency_beyond_every_bound_is_recorded_as_the_longest() {
        let mut latency = Latency::new();
        latency.record(i64::MAX);
        latency.record(-5);
        assert_eq!(latency.brief().count, 2);
        assert!(latency.brief().max_ns >= LONGEST);
    }
}
