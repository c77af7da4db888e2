//! One trial after another: something is done to the set, and a consumer of its estimates sees what comes of it.

use std::fs;
use std::io::Write;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use ilns_bus::{BusError, Prefix};
use ilns_runtime::{Shutdown, monotonic_now};
use rand::RngExt;
use rand_pcg::Pcg64;
use rustix::process::Signal;
use shared_types::Process;

use super::class::{Class, Damage, Deed, Expect};
use super::consumer::{Consumer, News, Word};
use super::figures::Observer;
use super::live_set::{LiveSet, forbid_writing, permit_writing, signal};
use super::mission;
use super::report::{Found, Matrix};
use crate::latency::load;

const MILLISECOND: i64 = 1_000_000;
const SECOND: i64 = 1_000 * MILLISECOND;

/// How long a set may take until it navigates, ns.
const PATIENCE: i64 = 60 * SECOND;

/// After so long (ns) a victim is no longer waited for.
const GIVE_UP: i64 = 20 * SECOND;

/// A solver that comes back publishes again within so long (ns), or it has to begin anew.
const SOLUTION: i64 = 30 * SECOND;

/// After the death of a supervisor, ns: its drivers die too, and what their silence does to the estimate is its own doing and
/// not that of the next trial.
const AFTERMATH: i64 = 8 * SECOND;

/// After a loss of power, ns: until ranges and then satellites are heard again, and for a moment more.
const UNDER_WATER: i64 = 28 * SECOND;

/// Data time from a start of the machine until ranges are heard, and until satellites are, s.
const WITHOUT_RANGES: f64 = 10.0;
const WITHOUT_FIXES: f64 = 25.0;

/// Configurations that are to be refused: a value out of its domain, no key, and what may not change, also beside what may.
const BAD: [&[&str]; 6] = [
    &["--set", "dvl.sigma=-1"],
    &["--set", "dvl.sgma=1"],
    &["--set", "estimator=ekf"],
    &["--set", "imu.gyro_noise_density=1"],
    &["--set", "dvl.sigma=0.02", "--set", "frame.origin=[0.0, 0.0, 0.0]"],
    &["--config", "/dev/null"],
];

/// Data time at which the DVL is taken off, and for how long it is missed, s.
const SWAP_AT: f64 = 45.0;
const SWAP_TAKES: f64 = 3.0;

/// How the one that is put on is mounted, deg: that of the mission, turned about its own vertical.
const TURN: f64 = 90.0;
const TURNED: &[&str] = &["--set", "dvl.mounting_rpy=[-0.3, -0.5, 93.0]", "--set", "dvl.sigma=0.03"];

/// A trial that could not be made.
#[derive(Debug, thiserror::Error)]
pub(super) enum BenchError {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Bus(#[from] BusError),
    /// It never began, or does not come back after something.
    #[error("the set does not navigate within {} s; the last of what it said: {said}", PATIENCE / SECOND)]
    NotNavigating { said: String },
    #[error("stopped")]
    Stopped,
}

/// A set, its consumer, and random numbers.
pub(super) struct Bench {
    prefix: Prefix,
    scratch: PathBuf,
    rate: f64,
    shutdown: Shutdown,
    draws: Pcg64,
    set: LiveSet,
    consumer: Option<Consumer>,
    observer: Observer,
    news: News,
    /// When the first signal of this trial was sent, monotonic ns.
    struck: Option<i64>,
    /// Whether requests for another configuration were answered as they ought to be.
    answered: bool,
    step_at_take: f64,
    /// The world is not as the other trials expect it.
    is_spoilt: bool,
}

impl Bench {
    /// Starts a set and waits until it navigates.
    pub(super) fn start(
        prefix: &Prefix,
        scratch: &Path,
        rate: f64,
        draws: Pcg64,
        shutdown: Shutdown,
    ) -> Result<Bench, BenchError> {
        let set = LiveSet::start(prefix, scratch, rate, 0, &[])?;
        let mut bench = Bench {
            prefix: prefix.clone(),
            scratch: scratch.to_owned(),
            rate,
            shutdown,
            draws,
            set,
            consumer: None,
            observer: Observer::default(),
            news: News::default(),
            struck: None,
            answered: false,
            step_at_take: 0.0,
            is_spoilt: false,
        };
        bench.settle()?;
        bench.observer.take();
        Ok(bench)
    }

    /// Who can be done something to: the processes of the set, in the order of their numbers.
    pub(super) fn victims(&self) -> Vec<Process> {
        let mut victims: Vec<Process> = self.set.children().into_iter().map(|(_, process)| process).collect();
        victims.sort();
        victims
    }

    /// A number below `limit`.
    pub(super) fn below(&mut self, limit: u32) -> u32 {
        self.draws.random_range(0..limit.max(1))
    }

    /// Does it, waits until the victim is back and the set is well, and then for a moment more.
    pub(super) fn carry_out(&mut self, class: &Class) -> Result<Found, BenchError> {
        let log_before = self.set.log().len();
        self.news.invalid = None;
        let dropped = |bench: &Bench| bench.news.beats.get(&class.victim).map_or(0, |word| word.dropped);
        let dropped_before = dropped(self);
        (self.struck, self.answered, self.step_at_take) = (None, false, 0.0);
        let since = self.act(class)?;
        let struck = self.struck.unwrap_or(since);
        let back = self.back(class, since);
        // What the solver says when it is back is where its return can be seen in the pose.
        if class.victim == Process::Solver {
            let solution = |bench: &Bench| bench.news.solution.is_some_and(|published| published > since);
            self.until(SOLUTION, solution);
        }
        let is_well = self.settle();
        let aftermath = match class.deed {
            Deed::PowerLoss => UNDER_WATER,
            _ if class.victim == Process::Supervisor && class.is_a_kill() => AFTERMATH,
            _ => 0,
        };
        let pause = self.draws.random_range(20..300) * MILLISECOND + aftermath;
        self.until(pause, |_| false);
        let said = class.expectations().into_iter().all(|expect| match expect {
            Expect::Says(line) => self.has_said(log_before, line),
            _ => true,
        });
        let counted = dropped(self).saturating_sub(dropped_before);
        let collapsed = is_well.is_err() || self.news.given_up || self.set.has_ended();
        if self.shutdown.requested() {
            return Err(BenchError::Stopped);
        }
        Ok(Found {
            figures: self.observer.take(),
            declared: self.declared(class, struck, since),
            back: back.map(|published| seconds((published - since).max(0))),
            said,
            step_at_take: self.step_at_take,
            answered: self.answered,
            counted,
            collapsed,
        })
    }

    /// How long it took until the estimates said that something is wrong: from the deed on, or from the start of a set that comes
    /// after a loss of power.
    fn declared(&self, class: &Class, struck: i64, since: i64) -> Option<f64> {
        if class.deed == Deed::PowerLoss {
            return self.news.first.map(|published| seconds(published - since));
        }
        // Others that wait for the CPU may be INVALID for a moment, too; that says nothing about this deed.
        let invalid = self.news.invalid.filter(|&published| published >= struck);
        invalid.filter(|_| class.victim == Process::EmulatorImu).map(|published| seconds(published - struck))
    }

    /// Whether the set has gone so far through its mission, or so wrong, that another should take its place.
    pub(super) fn is_spent(&mut self) -> bool {
        self.is_spoilt || self.news.t_valid > mission::END.0 || self.news.given_up || self.set.has_ended()
    }

    /// Stops the set, tells the matrix what it has left, and starts another.
    pub(super) fn begin_anew(&mut self, matrix: &mut Matrix) -> Result<(), BenchError> {
        self.begin_anew_with(&[], matrix)
    }

    /// Another set where a class needs a world of its own.
    pub(super) fn make_ready(&mut self, class: &Class, matrix: &mut Matrix) -> Result<(), BenchError> {
        if class.deed != Deed::Swap {
            return Ok(());
        }
        let back = SWAP_AT + SWAP_TAKES;
        let faults = [format!("dvl.blackout@{SWAP_AT}..{back}"), format!("dvl.mounting={TURN}@{SWAP_AT}..")];
        self.begin_anew_with(&faults, matrix)?;
        self.is_spoilt = true;
        Ok(())
    }

    fn begin_anew_with(&mut self, faults: &[String], matrix: &mut Matrix) -> Result<(), BenchError> {
        self.is_spoilt = false;
        self.consumer = None;
        let starts = self.set.starts() + 1;
        let fresh = |bench: &Bench| LiveSet::start(&bench.prefix, &bench.scratch, bench.rate, starts, faults);
        // The old one has to be gone before the new one takes its prefix.
        let (code, left) = self.set.stop()?;
        matrix.set_ended(code, left.iter().map(|path| path.display().to_string()));
        let _ = fs::remove_dir_all(self.set.record());
        self.set = fresh(self)?;
        self.news = News::default();
        self.observer.forget();
        self.settle()?;
        self.observer.take();
        Ok(())
    }

    /// Stops the set and tells the matrix what it has left.
    pub(super) fn end(mut self, matrix: &mut Matrix) -> Result<(), BenchError> {
        self.consumer = None;
        let (code, left) = self.set.stop()?;
        matrix.set_ended(code, left.iter().map(|path| path.display().to_string()));
        Ok(())
    }

    /// Does what the class says; returns the monotonic time from which on the victim may be back.
    fn act(&mut self, class: &Class) -> Result<i64, BenchError> {
        match class.deed {
            Deed::Nothing => {
                self.until(10 * SECOND, |_| false);
                Ok(monotonic_now())
            }
            Deed::Kill => self.kill(class.victim),
            Deed::KillTwice => {
                let first = self.kill(class.victim)?;
                if class.victim != Process::Supervisor {
                    let (victim, dead) = (class.victim, self.news.beats.get(&class.victim).map(|word| word.pid));
                    let appears = |bench: &Bench| bench.set.pid_of(victim).is_some_and(|pid| Some(pid) != dead);
                    if self.closely(GIVE_UP, appears).is_none() {
                        return Ok(first);
                    }
                }
                let into_its_start = self.draws.random_range(0..60) * MILLISECOND;
                self.closely(into_its_start, |_| false);
                self.kill(class.victim)
            }
            Deed::Stop => {
                let length = self.draws.random_range(50..2_000) * MILLISECOND;
                self.send(class.victim, Signal::STOP)?;
                self.until(length, |_| false);
                self.send(class.victim, Signal::CONT)?;
                Ok(monotonic_now())
            }
            Deed::StopForGood => {
                self.send(class.victim, Signal::STOP)?;
                Ok(monotonic_now())
            }
            Deed::Slow => self.slow_down(class.victim, 20, 90 * MILLISECOND, 10 * MILLISECOND),
            Deed::StarveAndSlow => {
                let load = load::saturate();
                let since = self.slow_down(class.victim, 100, 90 * MILLISECOND, 10 * MILLISECOND);
                drop(load);
                since
            }
            Deed::StarveAndHalt => {
                let load = load::saturate();
                // Below what the supervisor takes for a hang.
                let since = self.slow_down(class.victim, 2, 4_200 * MILLISECOND, 500 * MILLISECOND);
                drop(load);
                since
            }
            Deed::RecordDiskFull => self.fill_disk(class.victim),
            Deed::Damage(damage) => {
                // It must not write another meanwhile.
                self.send(class.victim, Signal::STOP)?;
                spoil(&self.set.checkpoint(), damage)?;
                self.kill(class.victim)
            }
            Deed::CheckpointDiskFull => {
                let partial = self.set.checkpoint().with_extension("partial");
                // A device that has no room: every write to it is refused as on a full disk.
                symlink("/dev/full", &partial)?;
                self.until(3 * SECOND, |_| false);
                fs::remove_file(partial)?;
                self.kill(class.victim)
            }
            Deed::Starve => {
                let load = load::saturate();
                self.until(3 * SECOND, |_| false);
                drop(load);
                Ok(monotonic_now())
            }
            Deed::SilentReader => {
                let guest = Consumer::join(&self.prefix)?;
                let silent = guest.silent_reader()?;
                self.until(4 * SECOND, |_| false);
                drop(silent);
                Ok(monotonic_now())
            }
            Deed::DyingReader => {
                for _ in 0..5 {
                    let arguments = ["status", "--json", "--prefix", self.prefix.name()];
                    let mut guest = Command::new(std::env::current_exe()?);
                    let mut guest = guest.args(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
                    let length = self.draws.random_range(0..80) * MILLISECOND;
                    self.closely(length, |_| false);
                    guest.kill().and_then(|()| guest.wait())?;
                }
                Ok(monotonic_now())
            }
            Deed::Reload => self.reload(),
            Deed::Swap => self.swap(),
            Deed::PowerLoss => {
                let dark = self.draws.random_range(3_000..15_000) * MILLISECOND;
                self.lose_power(dark)
            }
        }
    }

    /// What is refused, what is taken up for 5 s, and the configuration as it was.
    fn reload(&mut self) -> Result<i64, BenchError> {
        let before = self.set.in_force()?;
        let mut answered = true;
        for bad in BAD {
            answered &= !self.request(bad)?;
        }
        // Had one been left for them, they would have looked by then.
        self.until(2 * SECOND, |_| false);
        answered &= self.set.in_force()? == before;
        answered &= self.take_up(&["--set", "dvl.sigma=0.05", "--set", "lbl.sigma=1.0", "--set", "mcp.sigma=0.05"])?;
        self.until(5 * SECOND, |_| false);
        let file = self.scratch.join("before.toml");
        fs::write(&file, &before)?;
        answered &= self.take_up(&["--config", &file.to_string_lossy()])?;
        self.answered = answered && self.set.in_force()? == before;
        Ok(monotonic_now())
    }

    /// Tells of another DVL while it is being put on, and sails on with it.
    fn swap(&mut self) -> Result<i64, BenchError> {
        let half_way = SWAP_AT + 0.5 * SWAP_TAKES;
        self.until(PATIENCE, |bench| bench.set.data_now().as_seconds() > half_way);
        self.answered = self.take_up(TURNED)?;
        self.until(20 * SECOND, |_| false);
        Ok(monotonic_now())
    }

    /// Asks for what is to be taken up, and sees what the estimate does meanwhile and for a second more.
    fn take_up(&mut self, arguments: &[&str]) -> Result<bool, BenchError> {
        self.observer.recent_step();
        let taken = self.request(arguments)?;
        self.until(SECOND, |_| false);
        self.step_at_take = self.step_at_take.max(self.observer.recent_step());
        Ok(taken)
    }

    /// Asks for another configuration and listens until there is an answer: whether it was taken up.
    fn request(&mut self, arguments: &[&str]) -> Result<bool, BenchError> {
        let mut request = self.set.reload(arguments)?;
        loop {
            if let Some(status) = request.try_wait()? {
                return Ok(status.success());
            }
            if self.shutdown.requested() {
                request.kill().and_then(|()| request.wait())?;
                return Err(BenchError::Stopped);
            }
            self.until(20 * MILLISECOND, |_| false);
        }
    }

    /// Lets everything be as after a loss of power that lasted so long, ns.
    fn lose_power(&mut self, dark: i64) -> Result<i64, BenchError> {
        self.consumer = None;
        self.news.beats.clear();
        self.set.lose_power()?;
        self.until(dark, |_| false);
        self.news.first = None;
        let now = monotonic_now();
        let t = self.set.data_now().as_seconds();
        let silent = |sensor: &str, length: f64| format!("{sensor}.blackout@{t:.3}..{:.3}", t + length);
        self.set.start_again(&[silent("lbl", WITHOUT_RANGES), silent("gnss", WITHOUT_FIXES)])?;
        Ok(now)
    }

    /// Stops it and lets it go on, so many times in turn.
    fn slow_down(&mut self, victim: Process, turns: u32, stopped: i64, runs: i64) -> Result<i64, BenchError> {
        for _ in 0..turns {
            self.send(victim, Signal::STOP)?;
            self.closely(stopped, |_| false);
            self.send(victim, Signal::CONT)?;
            self.closely(runs, |_| false);
        }
        Ok(monotonic_now())
    }

    /// Lets every write of it fail for 4 s, and waits until it has written again.
    fn fill_disk(&mut self, victim: Process) -> Result<i64, BenchError> {
        let Some(pid) = self.set.pid_of(victim) else { return Ok(monotonic_now()) };
        let log_before = self.set.log().len();
        let before = forbid_writing(pid)?;
        self.until(4 * SECOND, |_| false);
        permit_writing(pid, before)?;
        let since = monotonic_now();
        self.until(GIVE_UP, |bench| bench.has_said(log_before, "the disk takes the record again"));
        Ok(since)
    }

    /// Whether the log holds this behind its byte `from`.
    fn has_said(&self, from: usize, line: &str) -> bool {
        self.set.log().get(from..).is_some_and(|log| log.contains(line))
    }

    fn kill(&mut self, victim: Process) -> Result<i64, BenchError> {
        if victim != Process::Supervisor {
            self.send(victim, Signal::KILL)?;
            return Ok(monotonic_now());
        }
        // Its ports go with the old set.
        self.consumer = None;
        self.news.beats.clear();
        self.send(victim, Signal::KILL)?;
        let now = monotonic_now();
        self.set.take_over()?;
        Ok(now)
    }

    fn send(&mut self, victim: Process, what: Signal) -> std::io::Result<()> {
        // It may be just dead or not yet born after an earlier deed; then there is nothing to do to it.
        let pid = self.set.pid_of(victim);
        self.struck.get_or_insert(monotonic_now());
        match pid.map(|pid| signal(pid, what)) {
            Some(Err(error)) if error.kind() != std::io::ErrorKind::NotFound => {
                if error.raw_os_error() == Some(rustix::io::Errno::SRCH.raw_os_error()) { Ok(()) } else { Err(error) }
            }
            _ => Ok(()),
        }
    }

    /// When the victim was back after the monotonic time `since`: its own word from its loop, and on the fast path a valid
    /// estimate after that.
    fn back(&mut self, class: &Class, since: i64) -> Option<i64> {
        let victim = class.victim;
        let word = |bench: &Bench| {
            let word: &Word = bench.news.beats.get(&victim)?;
            (word.published > since && bench.set.pid_of(victim) == Some(word.pid)).then_some(word.published)
        };
        self.until(GIVE_UP, |bench| word(bench).is_some())?;
        let spoken = word(self)?;
        if !class.is_on_fast_path() {
            return Some(spoken);
        }
        let valid = |bench: &Bench| bench.news.valid.map(|(published, _)| published).filter(|&at| at >= spoken);
        self.until(GIVE_UP, |bench| valid(bench).is_some())?;
        valid(self)
    }

    /// Waits until everybody runs and estimates are valid.
    fn settle(&mut self) -> Result<(), BenchError> {
        let is_well = |bench: &Bench| {
            let now = monotonic_now();
            let fresh = bench.news.valid.is_some_and(|(published, _)| now - published < SECOND / 2);
            let beats = &bench.news.beats;
            let runs = |(pid, process): (u32, Process)| beats.get(&process).is_some_and(|word| word.pid == pid);
            let children = bench.set.children();
            fresh && !children.is_empty() && children.into_iter().all(runs) && beats.contains_key(&Process::Recorder)
        };
        match self.until(PATIENCE, is_well) {
            Some(_) => Ok(()),
            None if self.shutdown.requested() => Err(BenchError::Stopped),
            None => {
                let said = self.set.log().lines().last().unwrap_or("nothing").to_owned();
                Err(BenchError::NotNavigating { said })
            }
        }
    }

    /// Listens until something holds, or for `limit` ns; when it was seen to hold, monotonic ns.
    fn until(&mut self, limit: i64, holds: impl Fn(&Bench) -> bool) -> Option<i64> {
        self.listen_until(limit, Duration::from_millis(20), holds)
    }

    /// As [`Bench::until`], to the millisecond.
    fn closely(&mut self, limit: i64, holds: impl Fn(&Bench) -> bool) -> Option<i64> {
        self.listen_until(limit, Duration::from_millis(1), holds)
    }

    fn listen_until(&mut self, limit: i64, nap: Duration, holds: impl Fn(&Bench) -> bool) -> Option<i64> {
        let limit = monotonic_now() + limit;
        loop {
            if holds(self) {
                return Some(monotonic_now());
            }
            let left = limit - monotonic_now();
            if left <= 0 || self.shutdown.requested() {
                return None;
            }
            let nap = nap.min(Duration::from_nanos(left as u64));
            match &mut self.consumer {
                Some(consumer) => consumer.listen(nap, &mut self.observer, &mut self.news),
                // Where nobody owns the prefix yet, this says so at once.
                None => match Consumer::join(&self.prefix) {
                    Ok(consumer) => self.consumer = Some(consumer),
                    Err(_) => std::thread::sleep(nap),
                },
            }
        }
    }
}

fn spoil(checkpoint: &Path, damage: Damage) -> std::io::Result<()> {
    let mut bytes = fs::read(checkpoint)?;
    let middle = bytes.len() / 2;
    match damage {
        Damage::Torn => bytes.truncate(middle),
        Damage::Flipped => bytes[middle] ^= 4,
        Damage::Foreign => bytes = b"[Unit]\nDescription=another file\n".to_vec(),
    }
    fs::File::create(checkpoint)?.write_all(&bytes)
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}
