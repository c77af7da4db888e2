//! Page faults of the fast path while it is measured: a page that is not there costs up to a millisecond.

use std::collections::BTreeMap;
use std::{fmt, fs};

use serde::Serialize;
use shared_types::Process;

use crate::supervisor::Supervisor;

/// Whose faults are told: those whose loops allocate nothing.
const WATCHED: [Process; 3] = [Process::EmulatorImu, Process::Propagator, Process::Solver];

/// Page faults of one process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct PageFaults {
    /// The page was in memory, but not yet this process's.
    minor: u64,
    /// The page came from the disk.
    major: u64,
}

impl fmt::Display for PageFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} + {}", self.minor, self.major)
    }
}

/// By process number and name; a process that was restarted has another number.
pub(super) type Counted = BTreeMap<(u32, &'static str), PageFaults>;

/// Page faults of the watched processes since their start.
pub(super) fn count(supervisor: &Supervisor) -> Counted {
    let one = |process: Process| {
        let pid = supervisor.pid_of(process)?;
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
        Some(((pid, process.name()), parse(&stat)?))
    };
    WATCHED.into_iter().filter_map(one).collect()
}

/// Those between two counts. A process that was restarted in between is left out: its start is no part of its loop.
pub(super) fn between(before: &Counted, after: &Counted) -> BTreeMap<&'static str, PageFaults> {
    let one = |(key, after): (&(u32, &'static str), &PageFaults)| {
        let before = before.get(key)?;
        Some((key.1, PageFaults { minor: after.minor - before.minor, major: after.major - before.major }))
    };
    after.iter().filter_map(one).collect()
}

/// Fields 10 and 12 of `proc_pid_stat(5)`, counted from behind the name, which may hold anything.
fn parse(stat: &str) -> Option<PageFaults> {
    let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(7);
    let minor = fields.next()?.parse().ok()?;
    let major = fields.nth(1)?.parse().ok()?;
    Some(PageFaults { minor, major })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_behind_whatever_the_name_is() {
        let stat = "4711 (a) b) S 1 4711 4711 0 -1 4194560 123 4 56 7 0 0 0 0 20 0";
        assert_eq!(parse(stat), Some(PageFaults { minor: 123, major: 56 }));
        assert_eq!(parse("4711 (ilns) S"), None);
    }

    #[test]
    fn a_process_that_was_restarted_in_between_is_left_out() {
        let faults = |minor| PageFaults { minor, major: 0 };
        let before = Counted::from([((1, "solver"), faults(5)), ((2, "propagator"), faults(5))]);
        let after = Counted::from([((3, "solver"), faults(900)), ((2, "propagator"), faults(6))]);
        assert_eq!(between(&before, &after), BTreeMap::from([("propagator", faults(1))]));
    }
}
