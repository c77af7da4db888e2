//! Which ranges belong together?
//!
//! All ranges with one `t_valid` are one epoch: they share one ping, and the estimator gives them one common offset. The
//! number goes with the instant, so that a range that comes after its epoch was closed still finds the right one.
//!
//! An epoch is closed when the IMU has passed its time by `keyframes.settle` (`event_time.rs`). Closing it at its
//! `in_epoch`-th range would be 50 ms sooner, but then what is tied to its keyframe would depend on which channel was
//! read first.

use std::collections::VecDeque;

use shared_types::Time;

/// Epochs that a late range can still join: four minutes of pings at 1 Hz.
const MEMORY: usize = 256;

/// Numbers of the recent epochs.
#[derive(Clone, Debug)]
pub(crate) struct LblEpochs {
    recent: VecDeque<(Time, u32)>,
    last: u32,
}

impl LblEpochs {
    pub(crate) fn new() -> LblEpochs {
        LblEpochs { recent: VecDeque::with_capacity(MEMORY), last: 0 }
    }

    /// Number of the epoch at that instant, from 1; a new one for a new instant.
    pub(crate) fn number(&mut self, t_valid: Time) -> u32 {
        if let Some(&(_, number)) = self.recent.iter().rev().find(|&&(t, _)| t == t_valid) {
            return number;
        }
        if self.recent.len() == MEMORY {
            self.recent.pop_front();
        }
        // 0 says "no epoch" in a measurement.
        self.last = self.last.checked_add(1).unwrap_or(1);
        self.recent.push_back((t_valid, self.last));
        self.last
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_one_instant_share_a_number() {
        let mut epochs = LblEpochs::new();
        assert_eq!([epochs.number(Time(10)), epochs.number(Time(10)), epochs.number(Time(20))], [1, 1, 2]);
    }

    #[test]
    fn a_late_range_joins_its_own_epoch() {
        let mut epochs = LblEpochs::new();
        let first = epochs.number(Time(10));
        epochs.number(Time(20));
        assert_eq!(epochs.number(Time(10)), first);
        assert_eq!(epochs.number(Time(30)), 3);
    }
}
