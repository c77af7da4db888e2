//! One process of the set, as its supervisor knows it: its number, its state, and when it may be started again.

use std::ffi::OsString;
use std::os::fd::OwnedFd;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{self, Command, ExitStatus, Stdio};

use ilns_runtime::monotonic_now;
use rustix::process::{Pid, PidfdFlags, Signal, kill_process, pidfd_open};
use shared_types::{Heartbeat, Process, ProcessState};

use crate::restarts::{Death, Restarts, Verdict};

/// What is started.
#[derive(Clone, Debug)]
pub struct ChildPlan {
    /// Which process.
    pub process: Process,
    /// Arguments of its own, after those of every process.
    pub arguments: Vec<OsString>,
    /// It shows itself in the terminal: it keeps standard input and output, and Ctrl-C reaches it.
    pub owns_terminal: bool,
}

const SECOND: i64 = 1_000_000_000;

/// A running process without a heartbeat for so long hangs (or was stopped) and is killed.
const SILENCE: i64 = 5 * SECOND;

/// A process that has not said a word for so long after its start hangs, too: none has more to do before its first than to
/// go through the readings of a long log.
const START_LIMIT: i64 = 30 * SECOND;

/// A process of the set.
#[derive(Debug)]
pub struct Child {
    /// What is started.
    pub plan: ChildPlan,
    /// As it says itself, or as the supervisor found it.
    pub state: ProcessState,
    /// How often it was started again.
    pub restarts: u32,
    running: Option<Running>,
    history: Restarts,
    /// When it may be started again, monotonic ns.
    restart_at: i64,
}

#[derive(Debug)]
struct Running {
    handle: process::Child,
    /// Becomes readable when the process ends.
    end: OwnedFd,
    since: i64,
    heard: i64,
    /// It was killed because it hung.
    hung: bool,
}

impl Child {
    /// Not started yet.
    pub fn new(plan: ChildPlan) -> Child {
        let history = Restarts::default();
        Child { plan, state: ProcessState::Starting, restarts: 0, running: None, history, restart_at: i64::MIN }
    }

    /// Which process.
    pub fn process(&self) -> Process {
        self.plan.process
    }

    /// Its number; 0 while it is dead.
    pub fn pid(&self) -> u32 {
        self.running.as_ref().map_or(0, |running| running.handle.id())
    }

    /// What becomes readable when it ends.
    pub fn end(&self) -> Option<&OwnedFd> {
        self.running.as_ref().map(|running| &running.end)
    }

    /// Starts it with `common` arguments, then those that differ at each start, then its own. Call from the main thread:
    /// a process is told of the end of the *thread* that started it.
    pub fn start(&mut self, common: &[OsString]) -> std::io::Result<()> {
        let mut command = Command::new(std::env::current_exe()?);
        command
            .arg(self.process().name())
            .args(common)
            .arg("--epoch")
            .arg(self.restarts.to_string())
            .args(&self.plan.arguments);
        if !self.plan.owns_terminal {
            // Ctrl-C is for the supervisor, which stops the others in order.
            command.stdin(Stdio::null()).stdout(Stdio::null()).process_group(0);
        }
        let mut handle = command.spawn()?;
        let end = pidfd_open(pid_of(&handle), PidfdFlags::empty()).inspect_err(|_| {
            // It must not run on unwatched beside the next one. It is a child that has not been waited for: it can be killed.
            let _ = handle.kill().and_then(|()| handle.wait());
        })?;
        let now = monotonic_now();
        self.running = Some(Running { handle, end, since: now, heard: now, hung: false });
        self.state = ProcessState::Starting;
        Ok(())
    }

    /// Takes note of its own heartbeat.
    pub fn hear(&mut self, beat: &Heartbeat) {
        let Some(running) = self.running.as_mut().filter(|running| running.handle.id() == beat.pid) else {
            return;
        };
        running.heard = monotonic_now();
        if let Some(state) = ProcessState::from_index(beat.state) {
            self.state = state;
        }
    }

    /// How it ended, if it has just ended; its next start is then set, or it is given up.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        let running = self.running.as_mut()?;
        // A process that cannot be waited for is gone, too.
        let status = running.handle.try_wait().unwrap_or_else(|_| Some(ExitStatus::default()))?;
        let now = monotonic_now();
        let death = if was_killed(status) && !running.hung { Death::Killed } else { Death::Own };
        let life = now - running.since;
        self.running = None;
        self.died(death, now, life);
        Some(status)
    }

    fn died(&mut self, death: Death, now: i64, life: i64) {
        match self.history.after(death, now, life) {
            Verdict::RestartAt(at) => {
                self.state = ProcessState::Restarting;
                self.restart_at = at;
            }
            Verdict::GivenUp => self.state = ProcessState::Failed,
        }
    }

    /// Starts it again if that is due. A start that the system refuses is a death like another.
    pub fn restart_if_due(&mut self, common: &[OsString]) -> std::io::Result<bool> {
        if self.state != ProcessState::Restarting || self.running.is_some() || monotonic_now() < self.restart_at {
            return Ok(false);
        }
        self.restarts += 1;
        self.start(common).inspect_err(|_| self.died(Death::Own, monotonic_now(), 0))?;
        Ok(true)
    }

    /// Kills it if it has been silent for too long, and says for how long (s) that is.
    pub fn kill_if_hung(&mut self) -> Option<i64> {
        let limit = if self.state == ProcessState::Starting { START_LIMIT } else { SILENCE };
        let running = self.running.as_mut().filter(|running| !running.hung)?;
        if monotonic_now() - running.heard <= limit {
            return None;
        }
        running.hung = true;
        self.signal(Signal::KILL);
        Some(limit / SECOND)
    }

    /// Sends it a signal if it lives.
    pub fn signal(&self, signal: Signal) {
        if let Some(running) = &self.running {
            // It may have ended in between; it has not been waited for, so the number is still its own.
            let _ = kill_process(pid_of(&running.handle), signal);
        }
    }
}

/// Whether somebody else ended it: an operator, a test, the kernel short of memory. That says nothing about the next start.
fn was_killed(status: ExitStatus) -> bool {
    [Signal::KILL, Signal::TERM].iter().any(|signal| status.signal() == Some(signal.as_raw()))
}

fn pid_of(handle: &process::Child) -> Pid {
    Pid::from_child(handle)
}
