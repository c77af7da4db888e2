//! The processes: what each says of itself, and what the supervisor says of those who cannot.

use std::collections::BTreeMap;

use shared_types::{Heartbeat, Process, ProcessState};

use super::slope::Slope;
use crate::snapshot::{EventKind, ProcessRow};

/// CPU shares are over this, ns.
const CPU_WINDOW: i64 = 3_000_000_000;

/// One process.
#[derive(Clone, Debug)]
struct Account {
    own_word: Option<Heartbeat>,
    word_of_supervisor: Option<Heartbeat>,
    /// CPU time against the clock.
    cpu: Slope,
}

impl Account {
    fn new() -> Account {
        Account { own_word: None, word_of_supervisor: None, cpu: Slope::over(CPU_WINDOW) }
    }

    /// Who speaks for it: of two words the supervisor's counts, who alone knows of a death.
    fn word(&self) -> Option<&Heartbeat> {
        self.word_of_supervisor.as_ref().or(self.own_word.as_ref())
    }

    fn restarts(&self) -> Option<u32> {
        let words = [self.own_word, self.word_of_supervisor];
        words.iter().flatten().map(|word| word.restarts).max()
    }
}

/// Every process that was heard of.
#[derive(Clone, Debug, Default)]
pub(super) struct Processes(BTreeMap<Process, Account>);

impl Processes {
    /// Takes in a heartbeat of `process`, its own or the supervisor's word on it; deaths and restarts are news.
    pub(super) fn enter(&mut self, process: Process, beat: &Heartbeat) -> Option<EventKind> {
        let account = self.0.entry(process).or_insert_with(Account::new);
        let restarts_before = account.restarts();
        let state_before = account.word_of_supervisor.map(|word| word.state);
        if is_own_word(beat) {
            if account.own_word.is_some_and(|word| word.pid != beat.pid) {
                account.cpu.clear();
            }
            account.cpu.enter(beat.header.t_published, i64::try_from(beat.cpu_ns).unwrap_or(i64::MAX));
            account.own_word = Some(*beat);
            return restarts_before
                .filter(|&before| beat.restarts > before)
                .map(|_| EventKind::Restarted(process, beat.restarts));
        }
        account.word_of_supervisor = Some(*beat);
        if restarts_before.is_some_and(|before| beat.restarts > before) {
            return Some(EventKind::Restarted(process, beat.restarts));
        }
        if state_before == Some(beat.state) {
            return None;
        }
        match ProcessState::from_index(beat.state)? {
            ProcessState::Restarting => Some(EventKind::Ended(process)),
            ProcessState::Failed => Some(EventKind::GivenUp(process)),
            _ => None,
        }
    }

    /// The newest heartbeat of the process itself.
    pub(super) fn own_word(&self, process: Process) -> Option<&Heartbeat> {
        self.0.get(&process)?.own_word.as_ref()
    }

    /// Since the process spoke last, s; `now` monotonic ns.
    pub(super) fn silence(&self, process: Process, now: i64) -> Option<f64> {
        self.own_word(process).map(|beat| (now - beat.header.t_published).max(0) as f64 * 1e-9)
    }

    /// Every process in the order of the house.
    pub(super) fn rows(&self, now: i64) -> Vec<ProcessRow> {
        self.0.iter().filter_map(|(&process, account)| self.row(process, account, now)).collect()
    }

    fn row(&self, process: Process, account: &Account, now: i64) -> Option<ProcessRow> {
        let word = account.word()?;
        // The CPU and memory of a dead predecessor are not its own.
        let own_word = account.own_word.filter(|own| own.pid == word.pid);
        Some(ProcessRow {
            name: process,
            pid: word.pid,
            state: ProcessState::from_index(word.state),
            restarts: account.restarts().unwrap_or(0),
            cpu_percent: own_word.and(account.cpu.value()).map(|share| share * 100.0),
            resident_bytes: own_word.map(|own| own.resident_bytes),
            dropped: own_word.map_or(0, |own| own.dropped),
            silence: self.silence(process, now),
        })
    }
}

/// Whether the sender speaks of itself.
pub(super) fn is_own_word(beat: &Heartbeat) -> bool {
    u32::from(beat.header.source) == beat.process
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{heartbeat, word_of_supervisor};

    const SECOND: i64 = 1_000_000_000;

    fn beat(pid: u32, restarts: u32, at: i64, cpu_ns: u64) -> Heartbeat {
        let mut beat = heartbeat(Process::Solver, at);
        (beat.pid, beat.restarts, beat.cpu_ns) = (pid, restarts, cpu_ns);
        beat
    }

    #[test]
    fn the_cpu_share_is_that_of_the_last_seconds() {
        let mut processes = Processes::default();
        for half in 0..20 {
            let cpu_ns = if half < 10 { 0 } else { (half - 9) * 125_000_000 };
            processes.enter(Process::Solver, &beat(7, 0, half as i64 * SECOND / 2, cpu_ns));
        }
        let row = &processes.rows(10 * SECOND)[0];
        assert!((row.cpu_percent.expect("two beats") - 25.0).abs() < 1e-9, "{:?}", row.cpu_percent);
        assert_eq!((row.pid, row.silence), (7, Some(0.5)));
        assert!(row.is_well());
    }

    #[test]
    fn the_supervisor_speaks_for_the_dead_and_a_death_is_news_once() {
        let mut processes = Processes::default();
        let dead = word_of_supervisor(Process::Solver, ProcessState::Restarting, 0, 0);
        assert_eq!(processes.enter(Process::Solver, &beat(7, 0, 0, 0)), None);
        assert_eq!(processes.enter(Process::Solver, &dead), Some(EventKind::Ended(Process::Solver)));
        assert_eq!(processes.enter(Process::Solver, &dead), None);
        let row = &processes.rows(SECOND)[0];
        assert_eq!((row.state, row.pid, row.resident_bytes), (Some(ProcessState::Restarting), 0, None));
        assert!(!row.is_well());
        let news = processes.enter(Process::Solver, &beat(9, 1, 2 * SECOND, 0));
        assert_eq!(news, Some(EventKind::Restarted(Process::Solver, 1)));
        let alive = word_of_supervisor(Process::Solver, ProcessState::Running, 9, 1);
        assert_eq!(processes.enter(Process::Solver, &alive), None, "it is known already");
    }

    #[test]
    fn a_late_monitor_does_not_take_old_restarts_for_news() {
        let mut processes = Processes::default();
        assert_eq!(processes.enter(Process::Solver, &beat(7, 4, 0, 0)), None);
        assert_eq!(processes.rows(0)[0].restarts, 4);
    }

    #[test]
    fn who_has_not_spoken_for_long_is_not_well() {
        let mut processes = Processes::default();
        processes.enter(Process::Solver, &beat(7, 0, 0, 0));
        assert!(!processes.rows(3 * SECOND)[0].is_well());
    }
}
