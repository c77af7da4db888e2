//! When a process that ended may be started again, and when it is given up.
//!
//! Whoever was killed from outside comes back, however often: that says nothing about the next start. Whoever ends by itself
//! (an error, a panic) or had to be killed because it hung comes back later and later, and is given up when it has done so
//! [`DEATHS`] times within [`WINDOW`].

use std::collections::VecDeque;

const SECOND: i64 = 1_000_000_000;

/// A process that lived so long was in its loop: its restart cannot be in anybody's way.
const SETTLED: i64 = 2 * SECOND;

/// Deaths of its own within [`WINDOW`] after which a process is given up.
pub const DEATHS: usize = 6;

/// How long a death of its own is held against a process, ns.
pub const WINDOW: i64 = 60 * SECOND;

/// Wait before the second restart within a window; it doubles with each.
const BACK_OFF: i64 = SECOND / 10;

/// Who ended a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Death {
    /// Somebody else: an operator, a test, the kernel short of memory.
    Killed,
    /// Itself, or its supervisor because it hung.
    Own,
}

/// What becomes of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Started again at this monotonic time, ns.
    RestartAt(i64),
    /// Not started again.
    GivenUp,
}

/// What is held against one process.
#[derive(Clone, Debug, Default)]
pub struct Restarts {
    /// Monotonic ns of its own deaths, the oldest first.
    own: VecDeque<i64>,
}

impl Restarts {
    /// It ended at `now` after `life` ns.
    pub fn after(&mut self, death: Death, now: i64, life: i64) -> Verdict {
        if death == Death::Killed {
            return Verdict::RestartAt(if life >= SETTLED { now } else { now + BACK_OFF });
        }
        self.own.push_back(now);
        while self.own.pop_front_if(|death| now - *death > WINDOW).is_some() {}
        match self.own.len() {
            1 => Verdict::RestartAt(now),
            deaths if deaths < DEATHS => Verdict::RestartAt(now + (BACK_OFF << (deaths - 2))),
            _ => Verdict::GivenUp,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_ends_by_itself_comes_back_later_and_later_and_is_given_up() {
        let mut restarts = Restarts::default();
        let waits = |verdict: Verdict| match verdict {
            Verdict::RestartAt(at) => Some(at),
            Verdict::GivenUp => None,
        };
        let found: Vec<Option<i64>> = (0..6).map(|_| waits(restarts.after(Death::Own, 0, 0))).collect();
        let ms = |ms: i64| Some(ms * SECOND / 1000);
        assert_eq!(found, [ms(0), ms(100), ms(200), ms(400), ms(800), None]);
    }

    #[test]
    fn a_long_life_between_its_deaths_does_not_save_a_process_that_dies_too_often() {
        let mut restarts = Restarts::default();
        let verdicts: Vec<Verdict> =
            (0..6).map(|death| restarts.after(Death::Own, death * 10 * SECOND, 10 * SECOND)).collect();
        assert_eq!(verdicts[5], Verdict::GivenUp);
        assert!(!verdicts[..5].contains(&Verdict::GivenUp));
    }

    #[test]
    fn what_was_long_ago_is_forgotten() {
        let mut restarts = Restarts::default();
        for death in 0..100 {
            let now = death * (WINDOW / 5 + 1);
            assert_ne!(restarts.after(Death::Own, now, WINDOW / 5), Verdict::GivenUp, "death {death}");
        }
        let now = 1000 * WINDOW;
        assert_eq!(restarts.after(Death::Own, now, SECOND), Verdict::RestartAt(now), "the first of its window");
    }

    #[test]
    fn a_process_that_is_killed_from_outside_comes_back_however_often() {
        let mut restarts = Restarts::default();
        for _ in 0..10_000 {
            assert_eq!(restarts.after(Death::Killed, 5, 3 * SECOND), Verdict::RestartAt(5));
            assert_eq!(restarts.after(Death::Killed, 5, SECOND), Verdict::RestartAt(5 + BACK_OFF));
        }
        assert_eq!(restarts.after(Death::Own, 5, 0), Verdict::RestartAt(5));
    }
}
