//! When is the next sample to be expected, and is it time to get ready for it?
//!
//! Between two samples other processes have had the core: caches and the branch predictor are theirs, and an idle core sleeps. Who
//! rehearses the next sample shortly before it comes finds everything warm when it does.

/// So long before the next sample, ns: a rehearsal with cold caches takes a tenth of it.
const LEAD: i64 = 250_000;
/// A faster instrument leaves no time to cool down, ns.
const PERIOD_MIN: f64 = 3.0 * LEAD as f64;
/// Slower ones are none, ns.
const PERIOD_MAX: f64 = 100e6;
/// Over how many samples the period is averaged.
const MEMORY: f64 = 16.0;

/// The rhythm of the samples, on the monotonic clock.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Rhythm {
    last: Option<i64>,
    /// Mean of late, ns; zero while it is not known.
    period: f64,
    is_ready: bool,
}

impl Rhythm {
    /// A sample was heard at the monotonic time `mono`, ns.
    pub(crate) fn heard(&mut self, mono: i64) {
        if let Some(last) = self.last {
            let step = (mono - last) as f64;
            // After a silence, or samples that came together, the next step tells anew.
            self.period = if self.period == 0.0 {
                step
            } else if step < 2.0 * self.period {
                self.period + (step - self.period) / MEMORY
            } else {
                0.0
            };
        }
        self.last = Some(mono);
        self.is_ready = false;
    }

    /// When to get ready for the next sample; `None` if that has been done, or is not worth it.
    fn due_at(&self) -> Option<i64> {
        let is_worth_it = !self.is_ready && (PERIOD_MIN..=PERIOD_MAX).contains(&self.period);
        self.last.filter(|_| is_worth_it).map(|last| last + self.period as i64 - LEAD)
    }

    /// How long to sleep at most, ns, of `patience`.
    pub(crate) fn patience(&self, mono: i64, patience: i64) -> i64 {
        self.due_at().map_or(patience, |due| patience.min((due - mono).max(0)))
    }

    /// Whether to get ready now; said once per sample.
    pub(crate) fn is_due(&mut self, mono: i64) -> bool {
        let is_due = self.due_at().is_some_and(|due| mono >= due);
        self.is_ready |= is_due;
        is_due
    }

    /// Between two samples, ns.
    pub(crate) fn period(&self) -> f64 {
        self.period
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: i64 = 5_000_000;

    fn heard(times: impl IntoIterator<Item = i64>) -> Rhythm {
        let mut rhythm = Rhythm::default();
        times.into_iter().for_each(|mono| rhythm.heard(mono));
        rhythm
    }

    #[test]
    fn it_is_due_once_shortly_before_each_sample() {
        let mut rhythm = heard((0..100).map(|sample| sample * PERIOD));
        let last = 99 * PERIOD;
        assert_eq!(rhythm.patience(last, 18_000_000), PERIOD - LEAD);
        assert!(!rhythm.is_due(last + PERIOD - LEAD - 1000));
        assert!(rhythm.is_due(last + PERIOD - LEAD));
        assert!(!rhythm.is_due(last + PERIOD - LEAD + 1000));
        assert_eq!(rhythm.patience(last + PERIOD, 18_000_000), 18_000_000);
        rhythm.heard(last + PERIOD);
        assert!(rhythm.is_due(last + 2 * PERIOD));
    }

    #[test]
    fn one_sample_a_fast_instrument_and_a_silent_one_have_no_rhythm() {
        assert_eq!(heard([0]).patience(0, 18_000_000), 18_000_000);
        assert_eq!(heard((0..50).map(|sample| sample * 100_000)).patience(0, 18_000_000), 18_000_000);
        assert_eq!(heard((0..50).map(|sample| sample * 1_000_000_000)).patience(0, 18_000_000), 18_000_000);
    }

    #[test]
    fn a_gap_spoils_the_rhythm_for_a_few_samples_only() {
        let mut rhythm = heard((0..100).map(|sample| sample * PERIOD).chain([150 * PERIOD]));
        assert!(!rhythm.is_due(250 * PERIOD), "nothing is known of it");
        (151..154).for_each(|sample| rhythm.heard(sample * PERIOD));
        assert!((rhythm.period() - PERIOD as f64).abs() < 1e-2 * PERIOD as f64, "{}", rhythm.period());
    }
}
