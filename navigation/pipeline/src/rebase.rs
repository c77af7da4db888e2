//! When the propagator learns of a solution.

use std::collections::VecDeque;

use shared_types::{Duration, Solution, Time};

/// The rule.
#[derive(Clone, Debug)]
pub enum Rebase {
    /// So much data time after the IMU sample that completed the keyframe; zero is at once.
    After(Duration),
    /// As a live run did: from the estimate at this time on, the solution of this number. In order of time.
    AsRecorded(VecDeque<(Time, u64)>),
}

/// Solutions on their way to the propagator.
#[derive(Clone, Debug)]
pub(crate) struct Arrivals {
    rule: Rebase,
    waiting: VecDeque<(Time, Solution)>,
}

impl Arrivals {
    pub(crate) fn new(rule: Rebase) -> Arrivals {
        Arrivals { rule, waiting: VecDeque::with_capacity(8) }
    }

    /// A solution was made when the newest IMU sample was that at `t_now`.
    pub(crate) fn push(&mut self, t_now: Time, solution: Solution) {
        self.waiting.push_back((t_now, solution));
    }

    /// The solution to rebase on before the sample at `t`, if one has arrived; the newest of several.
    pub(crate) fn take(&mut self, t: Time) -> Option<Solution> {
        let mut arrived = None;
        match &mut self.rule {
            Rebase::After(latency) => {
                while let Some((t_made, _)) = self.waiting.front()
                    && *t_made + *latency <= t
                {
                    arrived = self.waiting.pop_front().map(|(_, solution)| solution);
                }
            }
            Rebase::AsRecorded(schedule) => {
                let mut wanted = None;
                while let Some((t_first, id)) = schedule.front()
                    && *t_first <= t
                {
                    wanted = Some(*id);
                    schedule.pop_front();
                }
                if let Some(id) = wanted {
                    while let Some((_, solution)) = self.waiting.front()
                        && solution.id <= id
                    {
                        arrived = self.waiting.pop_front().map(|(_, solution)| solution);
                    }
                }
            }
        }
        arrived
    }
}
