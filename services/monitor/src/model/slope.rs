//! How fast something grows: rates, CPU shares, and the speed of data time.

use std::collections::VecDeque;

/// Points (x, y) of the last stretch of x, and the slope from the first to the last.
#[derive(Clone, Debug)]
pub(super) struct Slope {
    window: i64,
    points: VecDeque<(i64, i64)>,
}

impl Slope {
    /// Over the last `window` of x, or the last two points if these are further apart.
    pub(super) fn over(window: i64) -> Slope {
        Slope { window, points: VecDeque::new() }
    }

    /// Adds a point. Whatever runs back has been restarted: the past says nothing about it.
    pub(super) fn enter(&mut self, x: i64, y: i64) {
        if let Some(&(x_last, y_last)) = self.points.back() {
            if x < x_last || y < y_last {
                self.points.clear();
            } else if x == x_last {
                self.points.pop_back();
            }
        }
        self.points.push_back((x, y));
        while self.points.len() > 2 && self.points[1].0 <= x.saturating_sub(self.window) {
            self.points.pop_front();
        }
    }

    /// Begins anew.
    pub(super) fn clear(&mut self) {
        self.points.clear();
    }

    /// Growth of y per x; `None` with less than two points.
    pub(super) fn value(&self) -> Option<f64> {
        let (&(x_first, y_first), &(x_last, y_last)) = (self.points.front()?, self.points.back()?);
        let run = x_last.saturating_sub(x_first);
        (run > 0).then(|| y_last.saturating_sub(y_first) as f64 / run as f64)
    }

    /// As [`Slope::value`], where x is in nanoseconds and y counts: per second.
    pub(super) fn per_second(&self) -> Option<f64> {
        self.value().map(|slope| slope * 1e9)
    }

    /// Longest way in x from one point to the next.
    pub(super) fn longest_step(&self) -> Option<i64> {
        self.points.iter().zip(self.points.iter().skip(1)).map(|(&(x, _), &(next, _))| next.saturating_sub(x)).max()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn a_rate_is_exact_whenever_it_is_looked_at() {
        let mut rate = Slope::over(5 * SECOND);
        assert_eq!(rate.per_second(), None);
        for (seconds, count) in [(0, 10), (3, 16), (4, 18), (40, 90)] {
            rate.enter(seconds * SECOND, count);
        }
        assert_eq!(rate.per_second(), Some(2.0));
        assert_eq!(rate.longest_step(), Some(36 * SECOND));
    }

    #[test]
    fn what_is_older_than_the_window_is_forgotten() {
        let mut rate = Slope::over(5 * SECOND);
        for seconds in 0..10 {
            rate.enter(seconds * SECOND, seconds);
        }
        for seconds in 10..16 {
            rate.enter(seconds * SECOND, 9 + (seconds - 9) * 3);
        }
        assert_eq!(rate.per_second(), Some(3.0));
        assert!(rate.points.len() <= 6, "{}", rate.points.len());
    }

    #[test]
    fn a_count_that_runs_back_begins_anew() {
        let mut rate = Slope::over(5 * SECOND);
        rate.enter(0, 100);
        rate.enter(SECOND, 200);
        rate.enter(2 * SECOND, 3);
        assert_eq!(rate.per_second(), None);
        rate.enter(3 * SECOND, 13);
        assert_eq!(rate.per_second(), Some(10.0));
    }
}
