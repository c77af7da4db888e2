//! Watches the processes of a set: restarts the dead, kills the hung, tells everybody how they are, stops them in order.

use std::ffi::OsString;

use ilns_bus::{BusError, Owner, Publisher, Subscriber};
use ilns_runtime::{BEAT, HeartbeatBuilder, monotonic_now};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::Signal;
use shared_types::{Heartbeat, Process, ProcessState, channel};
use tracing::{debug, error, info, warn};

use crate::child::{Child, ChildPlan};
use crate::restarts::{DEATHS, WINDOW};

const MILLISECOND: i64 = 1_000_000;

/// How long the supervisor sleeps when nobody dies.
const NAP: i64 = 50 * MILLISECOND;

/// A process that is asked to stop is waited for so long before the next is asked.
const COURTESY: i64 = 400 * MILLISECOND;

/// After so long, whoever still lives is killed; with it the set is gone within 2 s.
const STOP_LIMIT: i64 = 1_600 * MILLISECOND;

/// The set at work. Its ports are dropped before the channels are.
#[derive(Debug)]
pub struct Supervisor {
    children: Vec<Child>,
    common: Vec<OsString>,
    health_in: Subscriber<Heartbeat>,
    health_out: Publisher<Heartbeat>,
    heartbeat: HeartbeatBuilder,
    owner: Owner,
}

impl Supervisor {
    /// Starts every process of `plans`, in that order.
    ///
    /// # Errors
    /// When the bus or the operating system refuses.
    pub fn start(
        owner: Owner,
        plans: Vec<ChildPlan>,
        common: Vec<OsString>,
    ) -> Result<Supervisor, Box<dyn std::error::Error>> {
        let (health_in, health_out) = ports(&owner)?;
        let mut heartbeat = HeartbeatBuilder::new(Process::Supervisor, 0);
        heartbeat.state = ProcessState::Running;
        let children = plans.into_iter().map(Child::new).collect();
        let mut supervisor = Supervisor { children, common, health_in, health_out, heartbeat, owner };
        for index in 0..supervisor.children.len() {
            if let Err(error) = supervisor.children[index].start(&supervisor.common) {
                supervisor.stop();
                return Err(error.into());
            }
        }
        Ok(supervisor)
    }

    /// One round: sleeps for 50 ms or until a process ends, then sees to all of them.
    pub fn watch(&mut self) {
        self.sleep(NAP);
        while let Some(beat) = self.health_in.receive() {
            if let Some(child) = self.child_of(&beat) {
                child.hear(&beat);
            }
        }
        for index in 0..self.children.len() {
            self.see_to(index);
        }
        if self.heartbeat.beat(monotonic_now()).is_some() {
            self.tell();
        }
    }

    /// Whether `process` is a part of the set and in `state`.
    pub fn has_in_state(&self, state: ProcessState, process: Process) -> bool {
        self.children.iter().any(|child| child.process() == process && child.state == state)
    }

    /// Number of a process of the set that lives.
    pub fn pid_of(&self, process: Process) -> Option<u32> {
        let child = self.children.iter().find(|child| child.process() == process)?;
        Some(child.pid()).filter(|&pid| pid != 0)
    }

    /// The processes of the set.
    pub fn processes(&self) -> impl Iterator<Item = Process> {
        self.children.iter().map(Child::process)
    }

    /// The processes that were given up.
    pub fn failed(&self) -> Vec<Process> {
        let failed = self.children.iter().filter(|child| child.state == ProcessState::Failed);
        failed.map(Child::process).collect()
    }

    fn child_of(&mut self, beat: &Heartbeat) -> Option<&mut Child> {
        // What this supervisor says of its children comes back to it, too.
        let own_word = u32::from(beat.header.source) == beat.process;
        let process = Process::from_index(beat.process).filter(|_| own_word)?;
        self.children.iter_mut().find(|child| child.process() == process)
    }

    fn see_to(&mut self, index: usize) {
        let child = &mut self.children[index];
        let process = child.process().name();
        if let Some(silent_s) = child.kill_if_hung() {
            error!(process, pid = child.pid(), silent_s, "no heartbeat for too long; it is killed");
        }
        if let Some(status) = child.ended() {
            // What it held must be free before it comes back.
            self.owner.cleanup_dead_nodes();
            if child.state == ProcessState::Failed {
                let (deaths, window_s) = (DEATHS, WINDOW / 1_000_000_000);
                error!(process, %status, deaths, window_s, "it ended by itself again and again and is given up");
            } else {
                warn!(process, %status, "it ended and is started again");
            }
            self.tell();
        }
        let child = &mut self.children[index];
        match child.restart_if_due(&self.common) {
            Ok(true) => info!(process, pid = child.pid(), restarts = child.restarts, "restarted"),
            Ok(false) => {}
            Err(error) => error!(process, %error, "it could not be started"),
        }
    }

    /// Its own heartbeat, and its word on every process: only it can speak for the dead.
    fn tell(&mut self) {
        self.heartbeat.handled = self.health_in.received();
        self.health_out.publish_quietly(self.heartbeat.build());
        for child in &self.children {
            let word = HeartbeatBuilder::new(child.process(), child.restarts).build();
            self.health_out.publish_quietly(Heartbeat {
                state: child.state as u32,
                pid: child.pid(),
                cpu_ns: 0,
                resident_bytes: 0,
                ..word
            });
        }
    }

    /// Sleeps until a process ends, a signal comes, or `limit` ns have passed.
    fn sleep(&self, limit: i64) {
        let ends = self.children.iter().filter_map(Child::end);
        let mut ends: Vec<PollFd> = ends.map(|end| PollFd::new(end, PollFlags::IN)).collect();
        let limit = limit.max(0);
        let limit = Timespec { tv_sec: limit / 1_000_000_000, tv_nsec: limit % 1_000_000_000 };
        if let Err(error) = poll(&mut ends, Some(&limit)) {
            debug!(%error, "the sleep was cut short");
        }
    }

    /// Stops every process in the reverse order of their start, and kills who does not listen; gives back the channels.
    pub fn stop(mut self) {
        let limit = monotonic_now() + STOP_LIMIT;
        self.heartbeat.state = ProcessState::Stopping;
        self.tell();
        for index in (0..self.children.len()).rev() {
            self.children[index].signal(Signal::TERM);
            self.wait_for(index, limit.min(monotonic_now() + COURTESY));
        }
        while self.children.iter().any(|child| child.pid() != 0) && monotonic_now() < limit {
            self.reap_all(limit - monotonic_now());
        }
        for child in &self.children {
            if child.pid() != 0 {
                warn!(process = child.process().name(), "it did not stop in time and is killed");
                child.signal(Signal::KILL);
            }
        }
        while self.children.iter().any(|child| child.pid() != 0) {
            self.reap_all(BEAT);
        }
        let Supervisor { health_in, health_out, owner, .. } = self;
        drop((health_in, health_out));
        owner.cleanup_dead_nodes();
        owner.close();
    }

    fn wait_for(&mut self, index: usize, limit: i64) {
        while self.children[index].pid() != 0 && monotonic_now() < limit {
            self.reap_all(limit - monotonic_now());
        }
    }

    fn reap_all(&mut self, limit: i64) {
        self.sleep(limit.min(NAP));
        for child in &mut self.children {
            child.ended();
        }
    }
}

fn ports(owner: &Owner) -> Result<(Subscriber<Heartbeat>, Publisher<Heartbeat>), BusError> {
    Ok((owner.bus().subscriber(&channel::HEALTH)?, owner.bus().publisher(&channel::HEALTH)?))
}
