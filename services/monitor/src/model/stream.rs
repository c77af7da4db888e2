//! The stream of estimates: the newest, how many, how fast, how many are missing.

use shared_types::{Header, Message, Mode, NavEstimate, Time};

use super::slope::Slope;
use crate::snapshot::{Estimates, EventKind};

const SECOND: i64 = 1_000_000_000;

/// Follows `nav/estimate`.
#[derive(Clone, Debug)]
pub(super) struct EstimateStream {
    newest: Option<NavEstimate>,
    received: u64,
    lost: u64,
    /// Received against data time.
    rate: Slope,
    /// Data time against the time of publication.
    speed: Slope,
}

impl EstimateStream {
    pub(super) fn new() -> EstimateStream {
        EstimateStream {
            newest: None,
            received: 0,
            lost: 0,
            rate: Slope::over(5 * SECOND),
            speed: Slope::over(5 * SECOND),
        }
    }

    /// Takes in an estimate; a change of mode is news.
    pub(super) fn enter(&mut self, estimate: &NavEstimate) -> Option<EventKind> {
        let previous = self.newest.replace(*estimate);
        self.received += 1;
        let Some(previous) = previous else {
            return Some(EventKind::Mode { from: None, to: estimate.mode() });
        };
        self.lost += missing_between(&previous.header, &estimate.header);
        let (from, to) = (previous.mode(), estimate.mode());
        (from != to).then_some(EventKind::Mode { from: Some(from), to })
    }

    /// Takes note of rate and speed: once a look is enough.
    pub(super) fn settle(&mut self) {
        if let Some(newest) = &self.newest {
            self.rate.enter(newest.header.t_valid, self.received as i64);
            self.speed.enter(newest.header.t_published, newest.header.t_valid);
        }
    }

    pub(super) fn newest(&self) -> Option<&NavEstimate> {
        self.newest.as_ref()
    }

    /// Data time of the newest.
    pub(super) fn t_newest(&self) -> Option<Time> {
        self.newest.map(|estimate| estimate.t_valid())
    }

    pub(super) fn mode(&self) -> Option<Mode> {
        self.newest.map(|estimate| estimate.mode())
    }

    /// Seconds of data time per second.
    pub(super) fn speed(&self) -> Option<f64> {
        self.speed.value()
    }

    /// In brief, at the monotonic time `now`, ns.
    pub(super) fn brief(&self, now: i64) -> Estimates {
        let age = |estimate: &NavEstimate| (now - estimate.header.t_published) as f64 * 1e-9;
        Estimates {
            rate: self.rate.per_second(),
            received: self.received,
            lost: self.lost,
            age: self.newest.as_ref().map(age),
        }
    }
}

/// Messages between two of one sender; a new epoch begins at 0.
fn missing_between(previous: &Header, next: &Header) -> u64 {
    if next.epoch != previous.epoch || next.sequence == 0 {
        next.sequence
    } else {
        next.sequence.saturating_sub(previous.sequence + 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::estimate_at;

    fn stamped(epoch: u32, sequence: u64) -> NavEstimate {
        let mut estimate = estimate_at(sequence as f64 * 0.005, [0.0; 3]);
        (estimate.header.epoch, estimate.header.sequence) = (epoch, sequence);
        estimate
    }

    #[test]
    fn gaps_are_counted_and_a_late_start_is_none() {
        let mut stream = EstimateStream::new();
        for (epoch, sequence) in [(0, 700), (0, 701), (0, 705), (1, 0), (1, 1), (2, 2)] {
            stream.enter(&stamped(epoch, sequence));
        }
        let brief = stream.brief(0);
        assert_eq!((brief.received, brief.lost), (6, 5), "three in a gap, two before the second restart was heard");
    }

    #[test]
    fn rate_and_speed_come_from_the_two_times() {
        let mut stream = EstimateStream::new();
        for sequence in 0..400 {
            let mut estimate = stamped(0, sequence);
            // Four times as fast as the clock.
            estimate.header.t_published = estimate.header.t_valid / 4;
            stream.enter(&estimate);
            stream.settle();
        }
        let rate = stream.brief(0).rate.expect("two points");
        assert!((rate - 200.0).abs() < 1e-9, "{rate}");
        assert!((stream.speed().expect("two points") - 4.0).abs() < 1e-9);
    }

    #[test]
    fn only_a_change_of_mode_is_news() {
        let mut stream = EstimateStream::new();
        let mut lost = stamped(0, 2);
        lost.mode = Mode::DeadReckoning as u32;
        assert_eq!(stream.enter(&stamped(0, 0)), Some(EventKind::Mode { from: None, to: Mode::Ok }));
        assert_eq!(stream.enter(&stamped(0, 1)), None);
        assert_eq!(stream.enter(&lost), Some(EventKind::Mode { from: Some(Mode::Ok), to: Mode::DeadReckoning }));
    }
}
