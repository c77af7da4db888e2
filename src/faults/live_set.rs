//! The set that things are done to: `ilns run` as a process of its own, in a scratch folder and under its own prefix.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use ilns_bus::Prefix;
use ilns_recording::{Checkpoint, Durability, kept_file, read_checkpoint, write_checkpoint};
use ilns_runtime::{StartClock, monotonic_now};
use rustix::process::{Pid, Resource, Rlimit, Signal, getrlimit, kill_process, prlimit};
use shared_types::{Clocks, Process, Time};

use crate::faults::mission;
use crate::legacy::leave;

/// From the start to the first reading, ns.
const LEAD: i64 = 800_000_000;

/// How long killed processes may take to be gone, ns.
const DEATH: i64 = 2_000_000_000;

/// The set at work; dropped, it is killed.
#[derive(Debug)]
pub(super) struct LiveSet {
    prefix: Prefix,
    scratch: PathBuf,
    child: Child,
    /// How often a supervisor was started: each records into a folder of its own.
    starts: u32,
    /// The clock of the world, which goes on whatever happens to the set.
    clock: StartClock,
}

impl LiveSet {
    /// Starts it on the bench's mission, a moment before the estimation begins, with faults of its sensors.
    pub(super) fn start(
        prefix: &Prefix,
        scratch: &Path,
        rate: f64,
        starts: u32,
        faults: &[String],
    ) -> std::io::Result<LiveSet> {
        // Data time need not begin at the mission's beginning: this set goes on where none has been.
        let folder = prefix.run_directory();
        fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder)?;
        let clock = StartClock { data: mission::START, mono: monotonic_now(), rate };
        let begun = StartClock { data: clock.data_at(clock.mono - LEAD), ..clock };
        leave(&folder, &begun)?;
        let child = spawn(prefix, scratch, starts, faults)?;
        Ok(LiveSet { prefix: prefix.clone(), scratch: scratch.to_owned(), child, starts, clock: begun })
    }

    /// Another supervisor in the place of one that was killed.
    pub(super) fn take_over(&mut self) -> std::io::Result<()> {
        self.child.wait()?;
        self.starts += 1;
        self.child = spawn(&self.prefix, &self.scratch, self.starts, &[])?;
        Ok(())
    }

    /// What a loss of power leaves: nobody lives, nothing is in memory or in /tmp, and what is kept on the disk is of an earlier start
    /// of the machine.
    pub(super) fn lose_power(&mut self) -> io::Result<()> {
        // Stopped first, it starts none of those anew that go before it.
        signal(self.child.id(), Signal::STOP)?;
        let children = self.children();
        for (pid, _) in &children {
            signal(*pid, Signal::KILL)?;
        }
        self.child.kill()?;
        self.child.wait()?;
        let limit = monotonic_now() + DEATH;
        while children.iter().any(|(pid, _)| name_of(*pid).is_some()) && monotonic_now() < limit {
            thread::sleep(Duration::from_millis(1));
        }
        for path in leftovers(&self.prefix) {
            if path.is_dir() { fs::remove_dir_all(path)? } else { fs::remove_file(path)? }
        }
        let kept = kept_file(&keep(&self.scratch), self.prefix.name());
        let Some(checkpoint) = read_checkpoint(&kept).map_err(io::Error::other)? else {
            return Err(io::Error::new(io::ErrorKind::NotFound, format!("{}: nothing was kept", kept.display())));
        };
        // Another start of the machine has another name, and its monotonic clock counted from elsewhere. The wall clock goes on.
        let Clocks { boot, mono, wall } = checkpoint.written;
        let written = Clocks { boot: boot ^ 1, mono: mono / 3, wall };
        write_checkpoint(&kept, &Checkpoint { written, ..checkpoint }, Durability::Power).map_err(io::Error::other)
    }

    /// The machine is started again: the same command, on a world that has gone on, with faults of its sensors.
    pub(super) fn start_again(&mut self, faults: &[String]) -> io::Result<()> {
        let folder = self.prefix.run_directory();
        fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder)?;
        leave(&folder, &self.clock)?;
        self.starts += 1;
        self.child = spawn(&self.prefix, &self.scratch, self.starts, faults)?;
        Ok(())
    }

    /// The configuration that the solver has taken up, as it says.
    pub(super) fn in_force(&self) -> io::Result<String> {
        fs::read_to_string(self.prefix.run_directory().join("in-force-solver.toml"))
    }

    /// Asks the set to take up another configuration.
    pub(super) fn reload(&self, arguments: &[&str]) -> io::Result<Child> {
        let mut request = Command::new(std::env::current_exe()?);
        let request = request.args(["reload", "--prefix", self.prefix.name()]).args(arguments);
        request.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()
    }

    /// Data time now.
    pub(super) fn data_now(&self) -> Time {
        self.clock.data_now()
    }

    /// How often a supervisor was started so far.
    pub(super) fn starts(&self) -> u32 {
        self.starts
    }

    /// Folder of the run, with the solver's checkpoint.
    pub(super) fn checkpoint(&self) -> PathBuf {
        self.prefix.run_directory().join("solution")
    }

    /// Folder that the recorder writes into.
    pub(super) fn record(&self) -> PathBuf {
        record(&self.scratch, self.starts)
    }

    /// What the processes have said so far.
    pub(super) fn log(&self) -> String {
        fs::read(log_file(&self.scratch)).map_or_else(|_| String::new(), |text| String::from_utf8_lossy(&text).into())
    }

    /// Number of the supervisor, or of a process that lives.
    pub(super) fn pid_of(&self, process: Process) -> Option<u32> {
        if process == Process::Supervisor {
            return Some(self.child.id());
        }
        self.children().into_iter().find(|(_, found)| *found == process).map(|(pid, _)| pid)
    }

    /// Number and name of every process of the set that runs under its own name already.
    pub(super) fn children(&self) -> Vec<(u32, Process)> {
        let supervisor = self.child.id();
        let list = fs::read_to_string(format!("/proc/{supervisor}/task/{supervisor}/children")).unwrap_or_default();
        let pids = list.split_whitespace().filter_map(|pid| pid.parse().ok());
        pids.filter_map(|pid| Some((pid, name_of(pid)?))).collect()
    }

    /// Whether the supervisor has ended by itself.
    pub(super) fn has_ended(&mut self) -> bool {
        !matches!(self.child.try_wait(), Ok(None))
    }

    /// Asks it to stop, and waits; exit code, and what bears its name on this machine afterwards.
    pub(super) fn stop(&mut self) -> std::io::Result<(Option<i32>, Vec<PathBuf>)> {
        // A supervisor that has ended by itself is told by its code.
        let _ = signal(self.child.id(), Signal::TERM);
        let code = self.child.wait()?.code();
        Ok((code, leftovers(&self.prefix)))
    }
}

impl Drop for LiveSet {
    fn drop(&mut self) {
        // Its children end with it; whoever takes the prefix next wipes the rest.
        let _ = self.child.kill().and_then(|()| self.child.wait());
    }
}

fn spawn(prefix: &Prefix, scratch: &Path, starts: u32, faults: &[String]) -> std::io::Result<Child> {
    let mut log = OpenOptions::new().append(true).create(true).open(log_file(scratch))?;
    // With a monitor, which shows itself to nobody here: it is a part of the set, and dies like the others.
    let mut arguments: Vec<OsString> =
        ["run", "--web", "127.0.0.1:0", "--resume", "--preset", "realistic", "--log-level", "warn"]
            .map(OsString::from)
            .into();
    arguments.extend(["--prefix".into(), prefix.name().into()]);
    arguments.extend(["--scenario".into(), mission::write(scratch)?.into()]);
    arguments.extend(["--out".into(), record(scratch, starts).into()]);
    arguments.extend(["--keep".into(), keep(scratch).into()]);
    faults.iter().for_each(|fault| arguments.extend(["--fault".into(), fault.into()]));
    let mut child = Command::new(std::env::current_exe()?)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()?;
    // Through a pipe: what its processes say must reach the log even while they may not write to any file. It ends with the last of
    // them; a log that cannot be written is missed by whoever looks for a line in it.
    let mut said = child.stderr.take().expect("it was piped");
    thread::spawn(move || io::copy(&mut said, &mut log));
    Ok(child)
}

/// Forbids a process to write to files, as a full disk would, until what this returns is given back by [`permit_writing`].
pub(super) fn forbid_writing(pid: u32) -> io::Result<Rlimit> {
    // Its hard limit is that of this process, from which it descends: only the soft one is moved, which needs no rights.
    let none = Rlimit { current: Some(0), ..getrlimit(Resource::Fsize) };
    Ok(prlimit(Some(number(pid)?), Resource::Fsize, none)?)
}

/// Ends what [`forbid_writing`] began.
pub(super) fn permit_writing(pid: u32, before: Rlimit) -> io::Result<()> {
    prlimit(Some(number(pid)?), Resource::Fsize, before)?;
    Ok(())
}

fn number(pid: u32) -> io::Result<Pid> {
    Ok(i32::try_from(pid).ok().and_then(Pid::from_raw).ok_or(io::ErrorKind::NotFound)?)
}

fn log_file(scratch: &Path) -> PathBuf {
    scratch.join("log.txt")
}

fn record(scratch: &Path, starts: u32) -> PathBuf {
    scratch.join(format!("record-{starts}"))
}

/// What outlives a loss of power.
fn keep(scratch: &Path) -> PathBuf {
    scratch.join("keep")
}

/// By its command line; `None` between its birth and its own name.
fn name_of(pid: u32) -> Option<Process> {
    let line = fs::read(format!("/proc/{pid}/cmdline")).ok()?;
    let word = line.split(|byte| *byte == 0).nth(1)?;
    Process::ALL.into_iter().find(|process| process.name().as_bytes() == word)
}

/// Sends a signal; an error where nobody has that number.
pub(super) fn signal(pid: u32, signal: Signal) -> std::io::Result<()> {
    Ok(kill_process(number(pid)?, signal)?)
}

/// Everything on this machine that bears the name of the set.
fn leftovers(prefix: &Prefix) -> Vec<PathBuf> {
    let directory = prefix.directory();
    let objects = format!("ilns-{}_", prefix.name());
    let entries = fs::read_dir("/dev/shm").into_iter().flatten().filter_map(Result::ok);
    let shared = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&objects));
    shared.map(|entry| entry.path()).chain(directory.exists().then_some(directory.clone())).collect()
}

/// Creates the folder and makes sure that it is ours alone.
pub(super) fn scratch(prefix: &Prefix) -> std::io::Result<PathBuf> {
    let folder = std::env::temp_dir().join(format!("ilns-faults-{}", prefix.name()));
    fs::create_dir(&folder)?;
    File::create(log_file(&folder))?;
    Ok(folder)
}
