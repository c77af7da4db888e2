//! How often a loss that goes on is said.

/// Between two lines about the same loss, ns: whoever reads the log wants to know that it goes on, not each half second of it.
const BETWEEN: i64 = 10_000_000_000;

/// What was said of a count that grows.
#[derive(Debug, Default)]
pub(crate) struct DropsTold {
    count: u64,
    next: i64,
}

impl DropsTold {
    /// By how much `count` has grown since the last line, if it has and another is due at the monotonic time `mono`, ns.
    pub(crate) fn news(&mut self, count: u64, mono: i64) -> Option<u64> {
        let grown = count - self.count;
        if grown == 0 || mono < self.next {
            return None;
        }
        (self.count, self.next) = (count, mono.saturating_add(BETWEEN));
        Some(grown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_that_goes_on_is_said_at_once_and_then_every_ten_seconds() {
        let mut told = DropsTold::default();
        assert_eq!(told.news(0, 0), None);
        let said: Vec<(i64, u64)> = (1..=50_u64)
            .filter_map(|step| {
                let mono = step as i64 * 500_000_000;
                told.news(step * 3, mono).map(|grown| (mono / 500_000_000, grown))
            })
            .collect();
        assert_eq!(said, [(1, 3), (21, 60), (41, 60)]);
        assert_eq!(told.news(150, i64::MAX), Some(27), "the rest, at the end");
    }
}
