//! What happened, the newest of it.

use std::collections::VecDeque;

use shared_types::Time;

use crate::snapshot::{Event, EventKind};

/// Older events are forgotten beyond so many.
const KEPT: usize = 100;

/// A bounded list of events.
#[derive(Clone, Debug, Default)]
pub(super) struct Events(VecDeque<Event>);

impl Events {
    /// `kind` was noticed at the data time `t`.
    pub(super) fn enter(&mut self, t: Option<Time>, kind: EventKind) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        self.0.push_back(Event { t: t.map(Time::as_seconds), kind });
    }

    /// Oldest first.
    pub(super) fn list(&self) -> Vec<Event> {
        self.0.iter().cloned().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::Process;

    #[test]
    fn the_oldest_events_make_room() {
        let mut events = Events::default();
        for restarts in 0..150 {
            events.enter(None, EventKind::Restarted(Process::Solver, restarts));
        }
        let list = events.list();
        assert_eq!(list.len(), KEPT);
        assert_eq!(list[0].kind, EventKind::Restarted(Process::Solver, 50));
        assert_eq!(list[KEPT - 1].kind, EventKind::Restarted(Process::Solver, 149));
    }
}
